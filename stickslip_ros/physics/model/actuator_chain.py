# SPDX-License-Identifier: Apache-2.0
"""The chain from a commanded to the real deflection: amplifier, hysteresis, creep, resonance.

The command c is the voltage times the gain, straight between kinks. Four optional stages follow;
all lengths are in metres:

    amplifier    y' = (c - y) / lag, but |y'| <= slew
    hysteresis   q = elastic y + sum of weights times plays of y, see `actuator.py`
    creep        s = q + sum of w c_i,   c_i' = (q - c_i) / tau_i
    resonance    u'' = omega^2 (s - u) - 2 zeta omega u'

`actuator_stages` computes the response to a command.

Creep is the usual logarithm of time, s = q (1 + gamma log10(t / t0)) after a jump (H. Jung, D.-G.
Gweon, Rev. Sci. Instrum. 71 (2000) 1896), as two exponentials a decade: from 10 to a million times
t0 this is within 0.003 gamma q; after a hundred million it ends.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array, weighted_sum
from stickslip_ros.base.compiled import compiled
from stickslip_ros.physics.laws.law import ALWAYS_PLASTIC, FOREIGN
from stickslip_ros.physics.model.actuator import Actuator
from stickslip_ros.physics.model.plant import NEARLY_SLIDING, Plant
from stickslip_ros.physics.parameters import ActuatorParameters, Parameters
from stickslip_ros.physics.parameters.groups import SolverParameters
from stickslip_ros.physics.waveforms.built_in import PER_MICROSECOND

#: Largest deviation (m) of the pieces from the curve, for the whole chain, near turns
ERROR = 5e-13
#: The deviation is this fraction of it for a contact that slides all the time, under a load or
#: because its law has no elastic range. Such a contact loses some deflection whenever lines return
#: to their curve; any other contact gets it back.
_YIELDING = 0.04
#: Damping ratio below which pieces are finer: errors of turns add up, there are 1 / zeta of them
_FIRM = 0.15
#: Deflection (m) at which a contact slides from which on it does not feel the deviation. For a
#: smaller one the lines are finer in proportion, down to this fraction.
_FELT, _FINEST = 5e-10, 0.01
#: Exponentials of creep in a decade, and decades from creep_start on
_PER_DECADE, _DECADES = 2, 8
#: Motion (m) below which the actuator is still; relative rounding error of sums
STILL, ROUNDING = 1e-15, 1e-14
#: Places of a state before those of plays and creep: command, y, u, u'
COMMAND, DRIVEN, DEFLECTION, RATE, PLAYS = range(5)
#: Largest number of ends of pieces in a window
CAPACITY = 2**17


class Chain(NamedTuple):
    """Constants of the stages, as compiled functions take them."""

    lag: float  #: of the amplifier, s; 0: none
    slew: float  #: of the amplifier in terms of deflection, m/s; infinite: no limit
    elastic: float  #: fraction of the deflection without hysteresis
    thresholds: Array  #: of the plays in terms of deflection, m
    weights: Array  #: of the plays
    creep_times: Array  #: tau_i, s
    creep_weight: float  #: w of each
    omega: float  #: of the resonance, 1/s; 0: none
    zeta: float  #: its damping ratio
    error: float  #: m
    #: Rate (m/s) of the actuator from which on only the mean of a line counts
    mean_only_rate: float
    runner: float  #: angular frequency of the runner on its contact, 1/s

    def rest(self) -> Array:
        """Return the state of an actuator that never moved, at 0."""
        return np.zeros(PLAYS + len(self.thresholds) + len(self.creep_times))

    @classmethod
    def of(cls, parameters: Parameters, creeping: bool = True) -> Chain:
        """Return the chain of the parameters; without an effect, the output is the command.

        Raises ParameterError.
        """
        p, plant = parameters.actuator, Plant.column(parameters)
        p = p if has_chain(p) else without_chain(p)
        actuator = Actuator.of(p)
        times = np.empty(0)
        if p.creep and creeping:
            # Exponentials of all times from e^0.5772 t0 on add up to the logarithm of t / t0.
            first = p.creep_start * math.exp(np.euler_gamma)
            places = range(_DECADES * _PER_DECADE)
            times = np.array([first * 10.0 ** ((k + 0.5) / _PER_DECADE) for k in places])
        error, mean_only_rate, runner = limits_of_pieces(p, plant)
        # The deviation suits the default; it falls with a smaller tolerance.
        finer = min(1.0, parameters.solver.tolerance / SolverParameters.tolerance)
        slew = PER_MICROSECOND * (p.amplifier_slew or 0.0)  # V/s
        return cls(
            lag=1.0 / (2.0 * math.pi * p.amplifier_bandwidth) if p.amplifier_bandwidth else 0.0,
            slew=slew * p.gain_in_force if slew else math.inf,
            elastic=actuator.elastic / p.gain_in_force,
            thresholds=actuator.thresholds * p.gain_in_force,
            weights=actuator.weights / p.gain_in_force,
            creep_times=times,
            creep_weight=(p.creep or 0.0) / _PER_DECADE,
            omega=2.0 * math.pi * p.actuator_resonance if p.actuator_resonance else 0.0,
            zeta=p.actuator_damping,
            error=finer * error,
            mean_only_rate=mean_only_rate / finer,
            runner=runner,
        )


def limits_of_pieces(p: ActuatorParameters, plant: Plant) -> tuple[float, float, float]:
    """Return error (m), mean_only_rate (m/s) and runner (1/s) of the `Chain` before a plant."""
    slides_on = plant.contact.kind == ALWAYS_PLASTIC or _is_carried(plant)  # it may, all the time
    error = ERROR * (_YIELDING if slides_on else 1.0) * _fineness_of(plant)
    error *= min(1.0, p.actuator_damping / _FIRM) if p.actuator_resonance else 1.0
    runner = math.sqrt((plant.contact.sigma_0 + plant.spring) / plant.mass)
    return error, _fastest(plant, p.gain_in_force * p.max_voltage), runner


def _fastest(plant: Plant, stroke: float) -> float:
    """Return the rate (m/s) above which only the mean of the lines matters for the contact.

    While w keeps its sign, a contact without a Stribeck curve depends on the path alone, so only
    the mean of the lines matters. w keeps its sign while the actuator is faster than any runner.
    Friction accelerates the runner along half the stroke (m) at most, because it lags behind the
    actuator; damping adds sigma_1 / m for each metre of deflection. With a Stribeck curve, and for
    a law with its own rate, friction depends on the rate, too; a runner that the load carries off
    may have any speed. Then the result is infinite.
    """
    contact = plant.contact
    if contact.z_s != contact.z_k or contact.kind >= FOREIGN or _is_carried(plant):
        return math.inf
    limit = max(contact.z_k, contact.z_ss if contact.kind < ALWAYS_PLASTIC else 0.0)
    force, path = contact.sigma_0 * limit + abs(plant.force), stroke + limit
    pushed = 2.0 * contact.sigma_1 * limit + contact.sigma_2 * path
    return math.sqrt(force * path / plant.mass) + pushed / plant.mass


def _fineness_of(plant: Plant) -> float:
    """Return the fraction of the deviation that the lines may have for so small a deflection."""
    least = min(plant.contact.z_s, plant.contact.z_k)
    return min(max(least / _FELT, _FINEST), 1.0)


def _is_carried(plant: Plant) -> bool:
    """Return whether the load is near the friction of sliding, so that it may carry the runner."""
    return abs(plant.force) > NEARLY_SLIDING * plant.contact.sigma_0 * plant.contact.z_k


def has_chain(p: ActuatorParameters) -> bool:
    """Return whether the deflection depends on more than the present command."""
    return bool(p.actuator_memory or p.creep or has_dynamics(p))


def has_dynamics(p: ActuatorParameters) -> bool:
    """Return whether amplifier or actuator take time; numbers in p may be columns (points,)."""
    stages: tuple[Any, ...] = (p.amplifier_bandwidth, p.amplifier_slew, p.actuator_resonance)
    return any(stage is not None and bool(np.any(stage > 0.0)) for stage in stages)


def without_chain(p: ActuatorParameters) -> ActuatorParameters:
    """Return the parameters of a linear actuator, whose deflection is the command."""
    return replace(
        p, actuator="linear", actuator_memory=False, creep=None,
        amplifier_bandwidth=None, amplifier_slew=None, actuator_resonance=None,
    )  # fmt: skip


def same_chain(one: Chain, other: Chain) -> bool:
    """Return whether two chains have the same constants."""
    pairs: list[tuple[Any, Any]] = list(zip(one, other, strict=True))
    return all(np.array_equal(a, b) for a, b in pairs)


def static_deflection(chain: Chain, state: Array) -> float:
    """Return the deflection (m) that hysteresis and creep give at present, without resonance."""
    plays, creep = np.split(state[PLAYS:], [len(chain.thresholds)])
    slow = chain.creep_weight * float(creep.sum())
    return float(chain.elastic * state[DRIVEN]) + weighted_sum(chain.weights, plays) + slow


def motion_left(chain: Chain, state: Array) -> float:
    """Return approximately how far (m) the actuator still moves while the command rests."""
    creep, s = state[PLAYS + len(chain.thresholds) :], static_deflection(chain, state)
    q = s - chain.creep_weight * float(creep.sum())
    left = abs(state[COMMAND] - state[DRIVEN])
    left += chain.creep_weight * float(np.abs(q - creep).sum())
    if chain.omega:
        left += abs(s - state[DEFLECTION]) + abs(state[RATE]) / chain.omega
    return float(left)


def adapt_state(old: Chain, new: Chain, state: Array) -> Array:
    """Return the state for a changed chain.

    Plays and creep keep their state if their constants are the same; otherwise the memory of the
    actuator holds only the path from 0 to its present command.
    """
    taken, operators = new.rest(), len(new.thresholds)
    taken[:PLAYS] = state[:PLAYS]
    if np.array_equal(old.thresholds, new.thresholds):
        taken[PLAYS : PLAYS + operators] = state[PLAYS : PLAYS + operators]
    if np.array_equal(old.creep_times, new.creep_times):
        taken[PLAYS + operators :] = state[PLAYS + len(old.thresholds) :]
    plays = taken[PLAYS : PLAYS + operators]
    np.clip(plays, taken[DRIVEN] - new.thresholds, taken[DRIVEN] + new.thresholds, out=plays)
    return taken


@compiled
def distance(one: NDArray, other: NDArray, omega: float) -> float:
    """Return how far (m) two states are apart, of a chain whose resonance is omega (1/s)."""
    apart = 0.0
    for k in range(len(one)):
        off = abs(one[k] - other[k])
        apart = max(apart, off / omega if k == RATE and omega > 0.0 else off)
    return apart
