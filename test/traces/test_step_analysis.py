# SPDX-License-Identifier: Apache-2.0
"""What is found in a trace is what the simulation that made it knows."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest
from table_1 import table_1

from stickslip_ros.model import Plant, drive_of
from stickslip_ros.motion.phases import points
from stickslip_ros.motion.sampling import trace_steps
from stickslip_ros.motion.steps import run_steps
from stickslip_ros.parameters import Parameters
from stickslip_ros.simulation.operating_points import zero_amplitude
from stickslip_ros.solver import Simulation
from stickslip_ros.traces import TraceError, analyse_steps
from stickslip_ros.traces.cycles import Cycles
from stickslip_ros.traces.step_analysis import analyse_cycles

TYPICAL = table_1()
NOISE = 1e-9


@cache
def _sampled(steps: int, rate: float, **values: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return t, x, u of steps from rest, sampled evenly at a rate (Hz)."""
    p = table_1(**values)
    simulation = Simulation(Plant.of(p), p.solver.tolerance)
    drive_cycle = drive_of(p, 1 if steps > 0 else -1)
    simulation.start(drive_cycle, abs(steps))
    t = np.arange(int(abs(steps) * drive_cycle.period * rate)) / rate
    seen = simulation.sample(t)
    return t, seen.x, seen.u


def _noisy(x: np.ndarray, noise: float) -> np.ndarray:
    return x + noise * np.random.default_rng(7).standard_normal(len(x))


def _ringing_of(p: Parameters) -> tuple[float, float]:
    plant = Plant.of(p)
    return plant.ringing_frequency, p.friction.sigma_1 / (2.0 * plant.mass)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("noise", "rate", "known"),
    [
        *product([0.0, NOISE], [1e5, 2e4], ["actuator", "drive"]),
        *product([NOISE], [1e5, 2e4], ["nothing"]),
    ],
)
def test_a_sampled_run_gives_back_what_made_it(noise: float, rate: float, known: str) -> None:
    """Step within 0.5 nm (0.1 nm without noise), backstep within 1.5 nm, ringing within 0.1 %.

    At 20 kHz, two and a half samples a ringing period, noise costs the mean of three steps 1 nm.
    """
    t, x, u = _sampled(10, rate)
    given: dict[str, dict[str, Any]] = {
        "actuator": {"u": u},
        "drive": {"frequency": 100.0, "start": 0.0},
        "nothing": {},
    }
    found = analyse_steps(t, _noisy(x, noise), **given[known])
    run = run_steps(TYPICAL, 10)
    frequency, decay = _ringing_of(TYPICAL)
    assert run.step_size == pytest.approx(133.83e-9, abs=0.01e-9)
    assert found.direction == 1
    assert found.period == pytest.approx(0.01, rel=1e-4)
    assert found.slips[0] == pytest.approx(0.01, abs=1.5 / rate + 1e-5)
    within = 0.1e-9 if not noise else 0.5e-9 if rate > 2e4 else 1e-9
    assert found.step_size == pytest.approx(run.step_size, abs=within)
    assert found.backstep == pytest.approx(run.backstep, abs=1.5e-9)
    assert found.ringing_frequency == pytest.approx(frequency, rel=1e-3)
    assert found.decay == pytest.approx(decay, rel=0.02)
    assert found.damping_ratio == pytest.approx(decay / (2 * np.pi * frequency), rel=0.02)
    assert found.mean_speed == pytest.approx(found.step_size / found.period, rel=1e-12)
    assert found.balance.step == found.step_size
    assert found.balance.backstep == found.backstep


OTHERS: list[dict[str, Any]] = [
    {"preload": 1.0, "mass": 3e-3},
    {"frequency": 1e3},
    {"preload": 3.0},
    {"sigma_0": 2.526619e6},
    {"model": "epm_fix"},
    {"sigma_1": 20.0},
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "known"),
    [
        *((values, True) for values in OTHERS),
        *((values, False) for values in OTHERS[:2]),
        *(pytest.param(values, False, marks=pytest.mark.long) for values in OTHERS[2:]),
    ],
    ids=str,
)
def test_other_axes(values: dict[str, Any], known: bool) -> None:
    p = table_1(**values)
    steps = 12
    t, x, u = _sampled(steps, 2e5 if p.drive.frequency < 500 else 1e6, **values)
    found = analyse_steps(t, _noisy(x, NOISE), u if known else None)
    run = run_steps(p, steps)
    frequency, decay = _ringing_of(p)
    assert found.period * p.drive.frequency == pytest.approx(1.0, rel=3e-4)
    assert found.step_size == pytest.approx(run.step_size, abs=0.5e-9)
    assert found.backstep == pytest.approx(run.backstep, rel=0.015, abs=3e-9)
    assert found.ringing_frequency == pytest.approx(frequency, rel=2e-3)
    assert found.decay == pytest.approx(decay, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("steps", [2, 3, 5, 8, 12])
@pytest.mark.parametrize("values", [{}, {"frequency": 1e4, "preload": 1.0}], ids=str)
def test_a_trace_says_what_the_run_that_made_it_says(values: dict[str, Any], steps: int) -> None:
    """One rule for what is settled: also in runs so short that nothing has."""
    p = table_1(**values)
    run, trace = run_steps(p, steps), trace_steps(p, steps)
    found = analyse_steps(trace.t, trace.x, trace.u, frequency=p.drive.frequency, start=0.0)
    assert found.step_size == pytest.approx(run.step_size, abs=1e-14)
    assert found.backstep == pytest.approx(run.backstep, abs=1e-11)  # between two samples


@pytest.mark.slow
@pytest.mark.parametrize("known", [True, False])
def test_backward_is_forward_in_the_mirror(known: bool) -> None:
    t, x, u = _sampled(10, 5e4)
    forward = analyse_steps(t, x, u if known else None)
    back = analyse_steps(t, -x, -u if known else None)
    assert (forward.direction, back.direction) == (1, -1)
    assert back.step_size == -forward.step_size
    assert np.array_equal(back.step_sizes, -forward.step_sizes)
    assert back.mean_speed == -forward.mean_speed
    assert back.backstep == forward.backstep
    assert back.decay == forward.decay


@pytest.mark.parametrize("known", [True, False])
def test_three_cycles_of_uneven_samples_are_enough(known: bool) -> None:
    """As `trace_steps` samples them: dense in the slip, wider apart in the rise."""
    trace = trace_steps(TYPICAL, 4)
    kept = np.sort(np.random.default_rng(3).choice(len(trace.t), 6000, replace=False))
    kept = kept[trace.t[kept] <= 0.03]
    x = _noisy(trace.x[kept], NOISE)
    given: dict[str, Any] = {"u": trace.u[kept]} if known else {"frequency": 100.0, "start": 0.0}
    found = analyse_steps(trace.t[kept], x, **given)
    assert len(found.step_sizes) >= 2
    assert found.step_size == pytest.approx(133.83e-9, abs=1e-9)
    assert found.ringing_frequency == pytest.approx(_ringing_of(TYPICAL)[0], rel=2e-3)


@pytest.mark.slow
def test_a_record_may_begin_anywhere_and_rest_at_both_ends() -> None:
    """A recorder is started before the drive; and one that runs already catches part of a cycle."""
    t, x, u = _sampled(10, 1e5)
    late = t > 0.0137
    inside = analyse_steps(t[late], _noisy(x[late], NOISE))
    assert inside.slips[0] == pytest.approx(0.02, abs=3e-5)
    assert inside.step_size == pytest.approx(133.83e-9, abs=0.5e-9)
    rest = np.arange(2000) * 1e-5
    t = np.concatenate([rest, 0.02 + t, 0.12 + rest])
    x = np.concatenate([np.zeros(2000), x, np.full(2000, x[-1])])
    framed = analyse_steps(t, _noisy(x, NOISE))
    assert framed.period == pytest.approx(0.01, rel=1e-3)
    assert framed.step_size == pytest.approx(133.83e-9, abs=0.5e-9)
    u = np.concatenate([np.zeros(2000), u, np.zeros(2000)])
    framed = analyse_steps(t, _noisy(x, NOISE), u)
    assert framed.starts[0] == pytest.approx(0.02, abs=2e-5)
    assert len(framed.starts) == 10
    assert framed.step_size == pytest.approx(133.83e-9, abs=0.5e-9)


def test_a_record_that_begins_with_a_slip_has_no_step_before_it() -> None:
    """There is no sample before that slip: the level just before it is that of the first one."""
    t, x, _ = _sampled(10, 1e5)
    cycles = Cycles.even(0.01 * np.arange(1.0, 11.0) - 3e-6, 0.01, 1)
    since = t >= cycles.slips[0]
    found = analyse_cycles(t[since], x[since], None, cycles).step_sizes
    assert found[0] == pytest.approx(0.0, abs=1e-12)
    assert found[1:] == pytest.approx(np.full(9, 133.9e-9), abs=0.3e-9)


def test_the_points_of_a_step_are_where_the_contact_says() -> None:
    """Without z, from the motion alone: within 3 us of `points`, ringing period 132 us."""
    trace = trace_steps(TYPICAL, 4)
    found = analyse_steps(trace.t, trace.x, trace.u)
    for cycle in range(3):
        true = points(trace, drive_of(TYPICAL), Plant.of(TYPICAL).contact, cycle)
        for name in "ABCEF":
            assert found.points[name][cycle] == pytest.approx(true[name], abs=3e-6), name
    assert np.isnan(found.points["D"]).all()


@pytest.mark.slow
def test_the_balance_of_eq_9_adds_up() -> None:
    """What ringing regains closes it: the stick loses less than 2 nm of 160 at 0.4 N."""
    trace = trace_steps(TYPICAL, 10)
    zero = zero_amplitude(TYPICAL)
    assert zero is not None
    balance = analyse_steps(trace.t, trace.x, trace.u, zero_amplitude=zero).balance
    assert balance.excitation == pytest.approx(160e-9, rel=1e-6)
    parts = balance.step + balance.backstep + balance.zero_amplitude + balance.remainder
    assert parts == pytest.approx(balance.excitation, rel=1e-12)
    assert abs(balance.left + balance.regained) < 2e-9
    noisy = analyse_steps(trace.t, _noisy(trace.x, NOISE), trace.u).balance
    assert noisy.regained == pytest.approx(balance.regained, abs=1e-9)
    given = analyse_steps(trace.t, trace.x, frequency=100.0, start=0.0, excitation=160e-9).balance
    assert given.left == pytest.approx(balance.left, abs=0.5e-9)
    assert np.isnan(given.remainder)


def test_what_is_not_there_is_nan() -> None:
    """No ringing in a ramp with falls, and no ringing told from less than two of its periods."""
    t = np.arange(5000) * 1e-5
    x = 100e-9 * (t / 0.01) + 20e-9 * (t / 0.01 % 1.0)
    quiet = analyse_steps(t, _noisy(x, NOISE), frequency=100.0, start=0.0)
    assert quiet.step_size == pytest.approx(100e-9, abs=1e-9)
    assert quiet.backstep == pytest.approx(20e-9, abs=2e-9)
    assert np.isnan([quiet.ringing_frequency, quiet.decay, quiet.balance.excitation]).all()
    t, x, u = _sampled(20, 1e6, frequency=1e4)
    fast = analyse_steps(t, x, u)
    assert np.isnan(fast.ringing_frequency)
    assert fast.step_size == pytest.approx(130.50e-9, abs=0.05e-9)


def test_a_decay_that_is_not_determined_is_given_nowhere() -> None:
    run = analyse_steps(*_sampled(12, 50e3))
    assert run.ringing and run.as_json()["damping_ratio"] > 0.0
    assert "of critical" in run.report()
    unknown = replace(run, ringing=replace(run.ringing, decay_error=math.inf))
    assert math.isnan(unknown.as_json()["damping_ratio"])
    assert "of critical" not in unknown.report() and "not determined" in unknown.report()


@pytest.mark.slow
def test_ringing_faster_than_the_samples_is_not_made_up() -> None:
    """10.1 kHz sampled at 20 kHz looks like 9.9 kHz."""
    t, x, _ = _sampled(10, 2e4, preload=1.0, mass=3e-3)
    assert np.isnan(analyse_steps(t, x, frequency=100.0, start=0.0).ringing_frequency)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t, x: (t[:20], x[:20]), "20 samples; at least 32 are needed"),
        (lambda t, x: (t[::-1], x), r"from sample 0 \(0.09995 s\) to the next \(0.0999 s\)"),
        (lambda t, x: (np.sort([*t[1:], t[5]]), x), "time does not increase from sample 4"),
        (lambda t, x: (t, np.where(t == t[7], np.nan, x)), "position sample 7 is nan"),
        (lambda t, x: (t, x[:-1]), "position has shape"),
        (lambda t, x: (t, 0 * x), "does not move"),
        (lambda t, x: (t, t * 1e-6 + x.max()), "shows no steps"),
    ],
)
def test_a_trace_without_steps_is_refused(change: Any, words: str) -> None:
    t, x, _ = _sampled(10, 2e4)
    with pytest.raises(TraceError, match=words):
        analyse_steps(*change(t, x))


def test_a_trace_shorter_than_a_cycle_is_refused() -> None:
    t, x, u = _sampled(10, 2e4)
    with pytest.raises(TraceError, match="no whole cycle"):
        analyse_steps(t, x, frequency=1.0, start=0.0)
    with pytest.raises(TraceError, match="no whole cycle"):
        analyse_steps(t[:150], x[:150], u[:150])


@pytest.mark.slow
@pytest.mark.parametrize("known", [True, False])
def test_the_origin_of_the_positions_does_not_matter(known: bool) -> None:
    """An interferometer may count from a metre away; 1 m is known to 2e-16 m."""
    t, x, _ = _sampled(10, 5e4)
    given: dict[str, Any] = {"frequency": 100.0, "start": 0.0} if known else {}
    near, far = (analyse_steps(t, x + origin, **given) for origin in (0.0, 3.0))
    assert far.period == pytest.approx(near.period, rel=1e-6)
    assert far.step_sizes == pytest.approx(near.step_sizes, abs=0.02e-9)
    assert far.backstep == pytest.approx(near.backstep, abs=0.1e-9)
