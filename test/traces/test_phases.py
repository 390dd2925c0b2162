# SPDX-License-Identifier: Apache-2.0
"""The seven phases of a step (Fig. 1) and the points A to F (Fig. 2)."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from table_1 import table_1

from stickslip_ros.model import Plant, drive_of
from stickslip_ros.motion.phases import phase_now, points, regime_now
from stickslip_ros.motion.sampling import trace_steps
from stickslip_ros.solver import Simulation

P = table_1()
CYCLE = drive_of(P)
RISE, FALL = (float(d) for d in CYCLE.durations)


def _phases(times: np.ndarray, sign: int) -> list[tuple[str, str]]:
    """Return phase and regime at the times (s) of one step, repetitions left out.

    A load against the step bends the contact, so that it has to unbend when the slip begins.
    """
    simulation = Simulation(Plant.of(P.replace(force=-0.05 * sign)), P.solver.tolerance)
    simulation.start(drive_of(P, sign), 1)
    seen = []
    for t in times:
        simulation.advance(float(t))
        seen.append((phase_now(simulation), regime_now(simulation)))
    return [key for key, _ in itertools.groupby(seen)]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_step_goes_through_its_seven_phases_in_order(sign: int) -> None:
    """Rest, presliding, stick, then in the slip slowdown, presliding back, slip, slowdown."""
    times = np.concatenate(
        (
            np.linspace(1e-9, 1e-4, 500),
            RISE + np.linspace(1e-10, FALL, 3000, endpoint=False),
            RISE + FALL + np.linspace(1e-9, 3e-4, 500),
            [0.5],
        )
    )
    simulation = Simulation(Plant.of(P), P.solver.tolerance)
    assert phase_now(simulation) == "rest"
    phases = [key for key, _ in itertools.groupby(_phases(times, sign), lambda seen: seen[0])]
    assert phases == [
        "presliding 1",
        *_ringing_of(phases),
        "slowdown 1",
        "presliding 2",
        "slip",
        "slowdown 2",
        "rest",
    ]


def test_presliding_is_of_the_first_cycle() -> None:
    """Later on the runner comes ringing, now slower and now faster than the actuator."""
    simulation = Simulation(Plant.of(P), P.solver.tolerance)
    simulation.start(CYCLE, 3)
    slower = 0
    for t in CYCLE.period + np.linspace(0.1, 0.9, 400) * RISE:
        simulation.advance(float(t))
        slower += simulation.state.v < simulation.state.rate
        assert phase_now(simulation) == "stick"
    assert 20 < slower < 380


def _ringing_of(phases: list[str]) -> list[str]:
    """Return what lies between the first presliding and the slip: stick, or ringing into it."""
    between = phases[1 : phases.index("slowdown 1")]
    assert set(between) <= {"presliding 1", "stick"}
    assert between[-1] == "stick"
    return between


def test_the_contact_is_elastic_until_it_breaks_away() -> None:
    """In the slip: elastic, then mixed beyond z_ba, and elastic again when the runner turns."""
    times = RISE + np.linspace(1e-10, FALL, 3000, endpoint=False)
    regimes = [key for key, _ in itertools.groupby(r for _, r in _phases(times, 1))]
    assert regimes[:2] == ["elastic", "mixed"]
    rest = Simulation(Plant.of(P), P.solver.tolerance)
    assert regime_now(rest) == "elastic"


def test_lugre_is_plastic_from_the_start() -> None:
    p = table_1(model="lugre")
    simulation = Simulation(Plant.of(p), p.solver.tolerance)
    simulation.start(drive_of(p), 1)
    simulation.advance(1e-3)
    assert regime_now(simulation) == "plastic"


def test_an_ageing_contact_goes_through_the_same_regimes() -> None:
    """It was plastic always, at rest too, for alpha of a law with a rate of its own was 1."""
    p = table_1(model="ceim_ageing")
    simulation = Simulation(Plant.of(p), p.solver.tolerance)
    assert regime_now(simulation) == "elastic"
    simulation.start(drive_of(p), 1)
    regimes = []
    for t in RISE + np.linspace(1e-10, FALL, 300, endpoint=False):
        simulation.advance(float(t))
        regimes.append(regime_now(simulation))
    assert [key for key, _ in itertools.groupby(regimes)][:2] == ["elastic", "mixed"]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("cycle", [0, 1, 2])
def test_the_points_come_in_order_and_mean_what_they_say(sign: int, cycle: int) -> None:
    trace = trace_steps(P, 4 * sign)
    drive_cycle = drive_of(P, sign)
    found = points(trace, drive_cycle, Plant.of(P).contact, cycle)
    assert list(found) == list("ABCDEF")
    times = list(found.values())
    assert all(a < b for a, b in itertools.pairwise(times))
    start = cycle * drive_cycle.period
    assert found["A"] == start
    assert found["C"] == pytest.approx(start + RISE, abs=1e-15)
    at = {name: int(np.argmin(np.abs(trace.t - t))) for name, t in found.items()}
    assert sign * trace.w[at["B"] - 1] < 0.0 <= sign * trace.w[at["B"]]
    z_ba = Plant.of(P).contact.z_ba
    assert sign * trace.z[at["D"] - 1] < z_ba <= sign * trace.z[at["D"]]
    lowest = at["C"] + int(np.argmin(sign * trace.x[at["C"] : at["F"]]))
    assert lowest in (at["E"] - 1, at["E"])  # E is the first sample on the way up
    assert sign * trace.z[at["F"]] >= 0.0


def test_a_point_that_does_not_occur_is_nan() -> None:
    """At 10 nm the contact never breaks away, and in a single cycle the backstep is cut off."""
    p = table_1(amplitude=10e-9 / P.actuator.gain)
    found = points(trace_steps(p, 1), drive_of(p), Plant.of(p).contact, 0)
    assert np.isnan(found["D"])
    assert np.isnan(found["F"])
    assert not np.isnan(found["B"])


@pytest.mark.parametrize("split", [0.3, 0.855])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_slip_in_two_parts(sign: int, split: float) -> None:
    """The slip lasts over its latency; the backstep ends where the runner is lowest."""
    p = table_1(waveform="shaped", split=split, latency=6.4e-5)
    drive_cycle, plant = drive_of(p, sign), Plant.of(p)
    trace = trace_steps(p, 3 * sign)
    found = points(trace, drive_cycle, plant.contact, 1)
    begin = drive_cycle.period + float(drive_cycle.durations[0])
    end = begin + drive_cycle.slip_duration
    assert found["C"] == pytest.approx(begin, abs=1e-15)
    x = sign * trace.x
    around = (trace.t >= begin) & (trace.t <= end + 9e-5)
    assert found["E"] == pytest.approx(trace.t[around][np.argmin(x[around])], abs=2e-6)
    simulation = Simulation(plant, p.solver.tolerance)
    simulation.start(drive_cycle, 3)
    for t, slipping in (
        (begin - 1e-6, False), (begin + 1e-7, True), (begin + 3e-5, True),
        (end - 1e-7, True), (end + 1e-7, False),
    ):  # fmt: skip
        simulation.advance(t)
        assert simulation.slipping == slipping
    simulation.advance(end + 2e-4)
    top = float(np.interp(begin, trace.t, x))
    assert simulation.backstep == pytest.approx(top - x[around].min(), abs=5e-11)
