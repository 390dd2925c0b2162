# SPDX-License-Identifier: Apache-2.0
"""Drive cycles of the actuator itself, left to the integrators of the whole system and of SciPy.

Restarted at every kink of u(t), wherever the load changes and, by SciPy, where a stop is hit or
left.
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from stickslip_ros.physics.model import Contact, DriveCycle, Plant
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver import Simulation, State
from validation.whole_system import WholeSystem, contact_rates

_UNIT = 1e-9  # states in nm and nm/us-like units, so that one absolute tolerance serves all
_SPEED = 1e-4
#: So far (nm) beyond a stop it is hit: a runner just let go is not there yet
_TOUCH = 1e-7


def z_rate_and_force(z: float, w: float, c: Contact) -> tuple[float, float]:
    """Return z' (m/s) and F (N)."""
    z_rate, _, force = contact_rates(z, 0.0, w, np.array(c))
    return z_rate, force


def _rates(_: float, y: NDArray[np.float64], plant: Plant, u_rate: float) -> list[float]:
    x, v, z = y[0] * _UNIT, y[1] * _SPEED, y[2] * _UNIT
    z_rate, force = z_rate_and_force(z, v - u_rate, plant.contact)
    a = (-force + plant.force - plant.spring * x) / plant.mass
    return [v / _UNIT, a / _SPEED, z_rate / _UNIT]


def states_at(simulation: Simulation, times: NDArray[np.float64]) -> list[State]:
    """Advance to each of the times (s) by itself; return the states."""
    found = []
    for t in times.tolist():
        simulation.advance(t)
        found.append(simulation.state)
    return found


def heat_of(simulation: Simulation, kinks: Sequence[float], count: int = 8001) -> float:
    """Advance from kink to kink (s); return the work (J) on the contact less what it still holds.

    Of count samples between two kinks, which are left out themselves: there w and F jump.
    """
    work = 0.0
    for start, end in itertools.pairwise(kinks):
        times = start + (end - start) * np.linspace(1e-7, 1 - 1e-7, count)
        seen = simulation.sample(times)
        power = seen.force * (seen.v - seen.rate)
        work += float(np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(times)))
    return work - 0.5 * simulation.plant.contact.sigma_0 * simulation.state.z**2


def _kinks(drive_cycle: DriveCycle, until: float) -> NDArray[np.float64]:
    """Return the ends (s) of all segments of the cycles up to a time (s)."""
    cycles = math.ceil(until / drive_cycle.period * (1.0 - 1e-12))
    return np.cumsum(np.tile(drive_cycle.durations, cycles))


def integrate(p: Parameters, drive_cycle: DriveCycle, cycles: int) -> NDArray[np.float64]:
    """Return x (m) at the end of each cycle from rest."""
    kinks = np.cumsum(np.tile(drive_cycle.durations, cycles))
    ends = kinks[len(drive_cycle.durations) - 1 :: len(drive_cycle.durations)]
    return follow(p, drive_cycle, ends.tolist())


def follow(
    p: Parameters,
    drive_cycle: DriveCycle,
    times: Sequence[float],
    forces: Sequence[tuple[float, float]] = (),
) -> NDArray[np.float64]:
    """Return x (m) at times (s) of drive cycles of the actuator itself, from rest.

    forces are times (s) from which on the external force is another (N).
    """
    system, plant, found = WholeSystem(p.replace(actuator="linear")), Plant.of(p), {}
    kinks, t = _kinks(drive_cycle, max(times)), 0.0
    moments = np.unique(np.concatenate([kinks, times, [t for t, _ in forces]]))
    for end in moments[(moments > 0.0) & (moments <= max(times))]:
        segment = int(np.searchsorted(kinks, 0.5 * (t + end))) % len(drive_cycle.rates)
        for since, force in forces:
            if since <= t:
                system.take(plant._replace(force=force))
        system.segment(end - t, drive_cycle.rates[segment] / p.actuator.gain)
        t, found[end] = end, system.x
    return np.array([found[moment] for moment in times])


def follow_between(
    plant: Plant,
    drive_cycle: DriveCycle,
    times: Sequence[float],
    low: float,
    high: float,
    longest: float = 2e-6,
    accuracy: float = 1e-10,
) -> tuple[NDArray[np.float64], int]:
    """Return x (m) at times (s) from rest between two stops (m), and how often one was hit.

    Free, until the way to a stop is 0; held, until the force on the runner turns.
    """
    found, kinks = {}, _kinks(drive_cycle, max(times))
    moments = np.unique(np.concatenate([kinks, times]))
    y, t, held, hits = np.zeros(3), 0.0, 0, 0
    for end in moments[(moments > 0.0) & (moments <= max(times))]:
        rate = drive_cycle.rates[
            int(np.searchsorted(kinks, 0.5 * (t + end))) % len(drive_cycle.rates)
        ]

        def push(_: float, z: NDArray[np.float64], side: int, rate: float = rate) -> float:
            force = z_rate_and_force(z[0] * _UNIT, -rate, plant.contact)[1]
            stop = high if side > 0 else low
            return side * (plant.force - plant.spring * stop - force)

        def creep(_: float, z: NDArray[np.float64], __: int, rate: float = rate) -> list[float]:
            return [z_rate_and_force(z[0] * _UNIT, -rate, plant.contact)[0] / _UNIT]

        def to_low(_: float, y: NDArray[np.float64], *__: object) -> float:
            return float(y[0] - low / _UNIT) + _TOUCH

        def to_high(_: float, y: NDArray[np.float64], *__: object) -> float:
            return float(y[0] - high / _UNIT) - _TOUCH

        for event, direction in ((push, -1), (to_low, -1), (to_high, 1)):
            vars(event).update(terminal=True, direction=direction)
        while t < end:
            if held and push(t, y[2:], held) < 0.0:
                held = 0
            solution = solve_ivp(
                creep if held else _rates,
                (t, end),
                y[2:] if held else y,
                method="DOP853",
                rtol=accuracy,
                atol=accuracy,
                max_step=min(longest, abs(2e-9 / rate) if rate else longest),
                args=(held,) if held else (plant, rate),
                events=push if held else [to_low, to_high],
            )
            assert solution.success
            t = float(solution.t[-1])
            if held:
                y[2] = solution.y[0, -1]
                held = 0 if solution.status == 1 else held
                continue
            y = solution.y[:, -1]
            if solution.status == 1:
                held = 1 if len(solution.t_events[1]) else -1
                hits += 1
                y[:2] = (high if held > 0 else low) / _UNIT, 0.0
        found[end] = y[0] * _UNIT
    return np.array([found[moment] for moment in times]), hits
