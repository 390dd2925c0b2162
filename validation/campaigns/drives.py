# SPDX-License-Identifier: Apache-2.0
"""Random drives over all that the parameters allow, and one of three judges of their motion.

    python -m validation.campaigns.drives [--judge integrator|kernel|topics] [--real] [--count 20]

Every parameter is drawn from its whole range in the table, evenly in its logarithm; laws, waveforms
and effects as well. With --real they are drawn from what real drives span, with --corners some from
the ends of their ranges. A drive that the table refuses, or whose fastest pole turns over a million
radians within its cycles, is drawn anew. Judges are one integrator of the whole system, the kernel
itself at a thousandth of the tolerance, and the integrator for drives that are commanded over
topics. Drives are held to 0.01 nm a cycle. Those beyond are listed with their growth: how many
times a change of the start grows within their cycles. From a hundred on it is their own.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from stickslip_ros.base.errors import StickslipError
from stickslip_ros.physics.laws import LAWS
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.model.waveforms import command_of
from stickslip_ros.physics.parameters import PARAMETERS, Parameters
from stickslip_ros.physics.solver import Simulation
from stickslip_ros.physics.solver.driven import simulation_of
from validation.campaigns.arguments import arguments
from validation.draws import REAL, anywhere, corner, differing, even, loads, shape, waveform
from validation.whole_system import NoAnswerError, WholeSystem, positions

#: Cycles of a drive; error allowed in each (m)
CYCLES, ALLOWED = 4, 1e-11
#: Radians of the fastest pole in all cycles, and times a change of the start may grow
FASTEST, GROWTH = 1e6, 100.0
#: Hz
FREQUENCIES = (1.0, 1e5)
#: The change of the start: deflection of the contacts, nm
_PUSHED = 1e-4
#: Shares of z above its limit, and of the way, that count as rounding
_ROUNDING, _ROUNDING_OF_PLACE = 1e-9, 1e-15
#: What every drive draws
_PLAIN = ("preload", "mass", "mu", "sigma_1", "slewrate", "amplitude", "mu_s", "mu_k", "v_stribeck")
#: What some draw: their own constants, loads
_SOMETIMES = (
    *("sigma_0", "sigma_0ss", "z_ba", "z_ss", "sigma_2", "payload", "spring", "preload_ratio"),
    *("sigma_0_cap", "beta", "d_c", "theta_0"),
)
_SOMETIMES_SHARE = 0.2
#: Of which three are drawn from the whole of their ranges, the ends included
_CORNERS = (*_PLAIN, *_SOMETIMES[:7], "force")
#: What belongs to an effect; "all" draws each with even odds
EFFECTS: dict[str, tuple[str, ...]] = {
    "plain": (),
    "lag": ("amplifier_bandwidth",),
    "slew": ("amplifier_slew",),
    "current limit": ("amplifier_bandwidth", "amplifier_slew"),
    "resonance": ("actuator_resonance", "actuator_damping"),
    "memory": ("hysteresis",),
    "creep": ("creep", "creep_start"),
    "contacts": ("contacts", "contact_spread"),
    "spreads": ("surface_spread", "surface_length", "slip_spread"),
    "dwell and rate": ("dwell_growth", "dwell_start", "rate_growth", "rate_start"),
    "wear": ("wear_rate",),
    "temperature": ("temperature", "gain_temperature", "friction_temperature"),
}


class Outcome(NamedTuple):
    """A drive and how far it was off."""

    p: Parameters
    off: float  #: nm a cycle
    growth: float  #: of a change of the start; 0 where the drive is not off by more than allowed
    seconds: float  #: of the processor


def drives(
    effect: str,
    seed: int,
    real: bool = False,
    fastest: float = FASTEST,
    law: str = "",
    corners: bool = False,
) -> Iterator[Parameters]:
    """Yield drives with an effect for ever."""
    for number in range(10**9):
        draw = np.random.default_rng((seed, sum(map(ord, effect)), number))
        try:
            values: dict[str, Any] = _drawn(effect, draw, real)
            if corners:
                values["alpha_form"] = str(draw.choice(["dupont", "printed"]))
                for name in draw.choice(_CORNERS, 3, replace=False).tolist():
                    values[name] = corner(draw, PARAMETERS[name])
            p = Parameters.of({**values, "model": law} if law else values)
            command = command_of(p)
            system = WholeSystem(p)
        except StickslipError:
            continue
        if system.fastest * CYCLES * command.period <= fastest:
            yield p


def _run(p: Parameters, tolerance: float) -> Any:
    """Return what the kernel says of each cycle at a tolerance (m), and its simulation."""
    simulation = simulation_of(p.replace(tolerance=tolerance), Plant.of(p))
    simulation.start(command_of(p), CYCLES)
    return simulation.run_cycles(CYCLES), simulation


def by_integrator(p: Parameters, radians: float) -> float:
    """Return how far (m a cycle) the kernel is from the integrator. Raises NoAnswerError."""
    off = _run(p, p.solver.tolerance)[0].position - positions(p, CYCLES)
    return float((np.abs(off) / np.arange(1, CYCLES + 1)).max())


def by_kernel(p: Parameters, radians: float) -> float:
    """Return how far (m a cycle) the kernel is from itself; inf if z is beyond its limit."""
    found, simulation = _run(p, p.solver.tolerance)
    finer = _run(p, 1e-3 * p.solver.tolerance)[0].position
    c, size = simulation.plant.contact, np.maximum(np.abs(found.z_max), np.abs(found.z_min)).max()
    most = max(c.z_k, c.z_s, c.z_ba if c.kind < 2 else 0.0, c.z_ss if c.kind == 0 else 0.0)
    held = abs(simulation.plant.force) / c.sigma_0  # below breakaway the load may swing the contact
    limit = max(most, 2.0 * held) * (1.0 + _ROUNDING) + 1e-12
    if type(simulation) is Simulation and not size <= limit:
        return math.inf
    off = np.abs(found.position - finer) - _ROUNDING_OF_PLACE * np.abs(finer).max()
    return max(float((off / np.arange(1, CYCLES + 1)).max()), 0.0)


def over_topics(p: Parameters, radians: float) -> float:
    """Return how far (m a cycle) what a node says is from the integrator. Raises NoAnswerError."""
    from validation.campaigns.topics import off  # where there is ROS

    return off(p, CYCLES, radians)


JUDGES = {"integrator": by_integrator, "kernel": by_kernel, "topics": over_topics}


def check(p: Parameters, judge: str = "integrator", radians: float = FASTEST) -> Outcome:
    """Return how far a drive is off; NoAnswerError if the judge has no answer."""
    start, growth = time.process_time(), 0.0
    off = JUDGES[judge](p, radians)
    if not off <= ALLOWED:
        plain, pushed = (positions(p, CYCLES, pushed=1e-9 * one) for one in (0.0, _PUSHED))
        growth = 1e9 * float(np.abs(pushed - plain).max()) / _PUSHED
    return Outcome(p, 1e9 * off, growth, time.process_time() - start)


def _drawn(effect: str, draw: np.random.Generator, real: bool) -> dict[str, Any]:
    values: dict[str, Any] = {"model": str(draw.choice(list(LAWS)))}
    values["waveform"] = waveform(draw)
    values["frequency"] = even(draw, *FREQUENCIES)
    sometimes = [name for name in _SOMETIMES if draw.random() < _SOMETIMES_SHARE]
    chosen = [e for e in EFFECTS if draw.random() < 0.5] if effect == "all" else [effect]
    for name in (*_PLAIN, *sometimes, *(name for e in chosen for name in EFFECTS[e])):
        values[name] = anywhere(draw, name, REAL.get(name) if real else None)
    if "rate_growth" in values and draw.random() < 0.5:
        values["rate_growth"] = -float(draw.uniform(0.0, 0.05))
    for name in ("wear_rate", "gain_temperature", "friction_temperature"):
        if name in values and draw.random() < 0.3:
            values[name] = -min(values[name], -PARAMETERS[name].low)
    if "memory" in chosen:
        values |= {"actuator": "hysteresis", "actuator_memory": True}
    if "contacts" in chosen:
        values["contacts"] = int(draw.integers(2, 9))
        if draw.random() < 0.3:
            values |= {"contacts": 6, "contact_shares": "guide"}
        values["surface_seed"] = int(draw.integers(2**31))
    values |= loads(draw, values["preload"], values["mu"])
    return values | shape(draw, values)


def main(argv: list[str] | None = None, say: Callable[[str], object] = print) -> int:
    """Run the lots; the exit code is 1 if a drive is off by more than is allowed."""
    args = arguments(
        __doc__, argv, judge=list(JUDGES), count=20, seed=1, effects="", law="", real=False,
        corners=False, radians=FASTEST,
    )  # fmt: skip
    bad = 0
    for effect in args.effects.split(",") if args.effects else [*EFFECTS, "all"]:
        done: list[Outcome] = []
        unanswered, refused = 0, 0
        for p in drives(effect, args.seed, args.real, args.radians, args.law, args.corners):
            try:
                one = check(p, args.judge, args.radians)
            except NoAnswerError:
                unanswered += 1
                continue
            except (StickslipError, TimeoutError) as error:
                refused += 1
                say(f"  {effect}: {error}: {differing(p)}")
                continue
            done.append(one)
            if not one.off <= 1e9 * ALLOWED:
                say(f"  {effect}: off {one.off:.3g} nm, growth {one.growth:.3g}: {differing(p)}")
            if len(done) >= args.count:
                break
        off = np.array([one.off for one in done])
        tame = np.array([one.growth < GROWTH for one in done])
        beyond = int((tame & ~(off <= 1e9 * ALLOWED)).sum())
        bad += beyond
        say(
            f"{effect}: {len(done)} drives, median {np.median(off[tame]):.2g}, worst "
            f"{off[tame].max():.2g} nm a cycle, {beyond} beyond; besides, {(~tame).sum()} with a "
            f"growth above {GROWTH:g}, {unanswered} without an answer, {refused} refused; "
            f"{np.mean([one.seconds for one in done]):.2g} s a drive"
        )
    return int(bad > 0)


if __name__ == "__main__":
    raise SystemExit(main())
