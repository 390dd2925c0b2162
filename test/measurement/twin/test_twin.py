# SPDX-License-Identifier: Apache-2.0
"""The twin beside an axis that somebody else integrates, changed in ways that it is not told."""

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from stickslip_ros.axis import Axis
from stickslip_ros.measurement.twin import Twin, TwinCommand, TwinSettings
from stickslip_ros.measurement.twin.response import Blur, CycleCurve
from stickslip_ros.measurement.twin.settings import TwinError
from stickslip_ros.measurement.twin.timeline import OperatingPoint, Piece
from stickslip_ros.measurement.twin.tracker import ReadingFilter
from stickslip_ros.measurement.twin.twin import BLIND, CHANGED, DRIFTING, OK, UNLIKE
from stickslip_ros.physics.parameters import Parameters
from validation.twin_axis import Hidden, RealAxis, feed

P = Parameters.of(frequency=100.0)
CHANGE = 1.5  # s
Log = list[TwinCommand | tuple[float, float]]


def _random() -> np.random.Generator:
    return np.random.default_rng(4)


@cache
def _log(cycles: int = 450, **hidden: float) -> tuple[TwinCommand | tuple[float, float], ...]:
    """Steps at 100 Hz, read at 100 Hz with 2 nm of noise; the change comes at `CHANGE`."""
    axis = RealAxis(P, lambda t, _: Hidden(**hidden) if t >= CHANGE - 1e-9 else Hidden(), seed=8)
    axis.step(cycles)
    return tuple(axis.log)


def _through(gain: float) -> Log:
    """The axis that stays the same, by a sensor whose gain changes."""
    return [
        one if isinstance(one, TwinCommand) or one[0] < CHANGE else (one[0], gain * one[1])
        for one in _log()
    ]


def _told(log: Log | tuple[TwinCommand | tuple[float, float], ...], p: Parameters = P) -> Twin:
    twin = Twin(p)
    for _ in feed(twin, list(log)):
        pass
    return twin


def test_estimates_that_come_back_have_a_model_again() -> None:
    """EPM_calc has no contact below 0.625 N, so half the preload is no axis."""
    tracker = Twin(P.replace(model="epm_calc", preload=0.66)).tracker
    drive = OperatingPoint(300.0, 100.0, 1, 0)
    for preload, lost in ((0.0, False), (-0.7, True), (0.01, False), (3.0, True), (0.0, False)):
        tracker.state[1] = preload
        tracker.step_size(drive)
        assert tracker.lost is lost


def test_readings_at_one_phase_of_the_ringing_are_no_change() -> None:
    """Each falls into the ringing 0.1 ms after a slip: all differ from the curve alike."""
    p = Parameters.of("table1_typical.yaml")
    twin, axis = Twin(p), Axis(p)
    noise = 2e-9 * np.random.default_rng(0).standard_normal(220)
    for k in range(1, 220):
        if k == 10:
            axis.command("steps", 205)
            twin.command(TwinCommand(axis.state.t, "steps", 205.0))
        axis.advance(0.01 * k + (1.25e-4 if k >= 10 else 0.01))
        twin.measure(axis.state.t, axis.state.x + noise[k])
    assert not twin.changes and twin.driven > 1.0


@pytest.mark.long
def test_causes_beyond_what_a_law_knows_are_left_out() -> None:
    """EPM_calc has no contact below 0.625 N: most preloads that could be asked of it are none."""
    p = P.replace(model="epm_calc", preload=0.66)
    axis = RealAxis(p, lambda t, _: Hidden(preload=1.25 if t >= CHANGE else 1.0), seed=8)
    axis.step(450)
    change = _told(tuple(axis.log), p).changes[0]
    assert change.verdict and change.verdict.explained and "preload" in change.verdict.possible


def test_an_axis_that_stays_the_same_is_ok_and_known() -> None:
    twin = Twin(P)
    updates = [one for one in feed(twin, list(_log())) if one]
    assert twin.level[0] == OK and not twin.changes
    z = np.array([(one.measured - one.expected) / one.deviation for one in updates])
    assert 0.8 < z.std() < 1.15
    for one, truth in (("preload", 0.4), ("gain", P.actuator.gain)):
        estimate = next(e for e in twin.estimates() if e.name == one)
        assert estimate.low < truth < estimate.high


@pytest.mark.long
def test_a_fifth_of_the_preload_is_told_within_fifty_cycles() -> None:
    twin = _told(_log(preload=0.8))
    (change,) = twin.changes
    assert CHANGE < change.told < CHANGE + 0.5
    assert abs(change.onset - CHANGE) < 0.1
    assert change.step_after == pytest.approx(136.69e-9, abs=0.15e-9)
    assert twin.level[0] == CHANGED
    assert change.verdict is not None and "preload" in change.verdict.possible
    assert math.expm1(change.verdict.sizes["preload"]) == pytest.approx(-0.2, abs=0.012)
    preload = next(one for one in twin.estimates() if one.name == "preload")
    assert preload.low < 0.32 < preload.high


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "value"), [("sensor", 1.1), ("preload", 0.95), ("amplifier", 0.97)]
)
def test_the_cause_is_among_those_named(name: str, value: float) -> None:
    log = _through(value) if name == "sensor" else _log(**{name: value})
    twin = _told(log)
    (change,) = twin.changes
    named = "sensor gain" if name == "sensor" else name
    assert change.told < CHANGE + 5.0
    assert change.verdict is not None and named in change.verdict.possible
    size = change.verdict.sizes[named]
    assert math.expm1(size) == pytest.approx(value - 1.0, abs=0.012)


@pytest.mark.long
def test_two_amplitudes_tell_sensor_from_amplifier() -> None:
    """The amplifier takes a share of the stroke, the sensor one of the step."""
    axis = RealAxis(P, lambda t, _: Hidden(amplifier=0.97 if t >= 2.5 else 1.0), seed=5)
    for volts in (300.0, 100.0, 300.0, 100.0, 300.0):
        axis.command("amplitude", volts)
        axis.step(100)
    (change,) = _told(axis.log).changes
    assert change.verdict is not None and change.verdict.cause == "amplifier"


@pytest.mark.long
def test_readings_go_on_while_a_cause_is_judged() -> None:
    """A piece at a time; then the tracker starts anew from the cause and has lost no reading."""
    twin, axis, random = Twin(P), Axis(P), _random()
    twin.command(TwinCommand(0.0, "steps", 10_000))
    axis.command("steps", 10_000)
    judged_at, times = math.nan, list[float]()
    while math.isnan(judged_at) or axis.state.t < judged_at + 0.5:
        axis.advance(axis.state.t + 0.01 + 1e-3 * random.random())
        if 1.0 < axis.state.t < 1.02:
            axis.command("parameters", {"preload": 0.32})
        assert twin.measure(axis.state.t, axis.state.x + 2e-9 * random.standard_normal()) or (
            axis.state.t < 0.03
        )
        times.append(axis.state.t)
        if math.isnan(judged_at) and twin.changes and twin.changes[0].verdict:
            judged_at = axis.state.t
        assert axis.state.t < 60.0
    (change,) = twin.changes
    last_of_200 = [t for t in times if t > change.onset][199]
    assert judged_at > last_of_200 + 0.2
    assert change.verdict and "preload" in change.verdict.possible
    (step,) = (one for one in twin.estimates() if one.name == "step size")
    assert step.low - 0.1e-9 < 136.7e-9 < step.high + 0.1e-9
    assert twin.troubles.keys() <= {"jumps of the position"}  # that of the preload


def test_what_changes_slowly_drifts() -> None:
    """The preload falls by 6 % in a second, which is no change where drift may be as large."""
    twin, axis, random = Twin(P, TwinSettings(drift_hour=0.3, drift_window=4.0)), Axis(P), _random()
    twin.command(TwinCommand(0.0, "steps", 10_000))
    axis.command("steps", 10_000)
    while axis.state.t < 6.0:
        axis.advance(axis.state.t + 0.01 + 1e-3 * random.random())
        axis.command("parameters", {"preload": 0.4 * math.exp(-0.06 * axis.state.t)})
        twin.measure(axis.state.t, axis.state.x + 2e-9 * random.standard_normal())
    rate, deviation = twin.drift
    assert twin.level[0] == DRIFTING
    assert abs(rate - 0.005) < 3.0 * deviation < 0.005
    assert not twin.changes


def test_steps_to_and_fro_do_not_drift() -> None:
    """A step back is no step that has fallen by twice its size."""
    twin, axis, random = Twin(P, TwinSettings(drift_window=4.0)), Axis(P), _random()
    for k in range(1, 800):
        if k % 100 == 1:
            steps = 80 if k % 200 == 1 else -80
            axis.command("steps", steps)
            twin.command(TwinCommand(axis.state.t, "steps", steps))
        axis.advance(0.01 * k + 0.003 * random.random())
        twin.measure(axis.state.t, axis.state.x + 2e-9 * random.standard_normal())
        assert twin.level[0] in (OK, BLIND)
        assert abs(twin.drift[0]) < 0.01  # what it learns; back and forth would be 0.5


def _changing(seconds: float) -> tuple[Twin, Axis]:
    """Return a twin and its axis, whose preload changes at 1 s while it steps without end."""
    twin, axis, random = Twin(P), Axis(P), _random()
    twin.command(TwinCommand(0.0, "jog", 100.0))
    axis.command("jog", 100.0)
    _go_on(twin, axis, random, 1.0)
    axis.command("parameters", {"preload": 0.32})
    _go_on(twin, axis, random, seconds - 1.0)
    return twin, axis


def _go_on(twin: Twin, axis: Axis, random: np.random.Generator, seconds: float) -> None:
    for at in np.arange(axis.state.t + 0.0107, axis.state.t + seconds, 0.0107).tolist():
        axis.advance(at)
        twin.measure(at, axis.state.x + 2e-9 * random.standard_normal())


def test_a_gap_before_the_last_reading_leaves_a_change_to_be_judged() -> None:
    twin, axis = _changing(3.6)
    axis.advance(axis.state.t + 2.0)
    twin.measure(axis.state.t, axis.state.x)
    twin.settle()
    (change,) = twin.changes
    assert change.verdict is not None and "preload" in change.verdict.possible
    assert twin.troubles["gaps"] == 1


def test_a_late_command_takes_back_a_change_that_waits_to_be_judged() -> None:
    twin, axis = _changing(1.7)
    (change,) = twin.changes
    assert change.verdict is None
    twin.command(TwinCommand(change.told - 1e-3, "amplitude", 300.0))
    assert not twin.changes
    _go_on(twin, axis, _random(), 4.0)
    twin.settle()
    assert twin.troubles["late commands"] == 1
    (step,) = (one for one in twin.estimates() if one.name == "step size")
    assert step.low - 0.1e-9 < 136.7e-9 < step.high + 0.1e-9


@pytest.mark.long
def test_a_wrong_file_is_told_from_the_start() -> None:
    twin = _told(_log(), P.replace(preload=0.8, mu=0.4))
    assert twin.changes[0].at_start
    assert "file" in twin.changes[0].text


@pytest.mark.long
def test_what_no_parameter_explains_is_unlike_the_model() -> None:
    random = np.random.default_rng(2)
    log: Log = [
        one if isinstance(one, TwinCommand) or one[0] < CHANGE
        else (one[0], one[1] + 30e-9 * random.standard_normal()) for one in _log()
    ]  # fmt: skip
    assert _told(log).level[0] == UNLIKE


def test_a_prediction_holds_what_comes() -> None:
    axis, twin = RealAxis(P, lambda *_: Hidden(), seed=2), Twin(P)
    axis.step(200)
    axis.rest(0.05)
    for _ in feed(twin, axis.log):
        pass
    found = twin.predict_steps(250)
    axis.step(250)
    axis.rest(0.05)
    assert found.end - found.begin == pytest.approx(2.5)
    assert found.low < axis.x < found.high
    assert found.high - found.low < 80e-9
    there = twin.predict_position(found.position)
    assert there.steps == 250
    assert abs(twin.predict_position(-1e-5).position + 1e-5) < 70e-9
    with pytest.raises(TwinError, match="no reading"):
        Twin(P).predict_steps(1)
    twin.command(TwinCommand(twin.t, "jog", 100.0))
    with pytest.raises(TwinError, match="without end"):
        twin.predict_steps(1)


def test_troubles_are_told_and_survived() -> None:
    log = list(_log())
    bad: Log = [*log[:100], (math.nan, 0.0), (1.0, math.nan), log[50], log[99]]
    bad += [
        TwinCommand(0.9, "amplitude", math.nan),
        TwinCommand(0.9, "frequency", -1.0),
        *log[100:200],
    ]
    bad += log[230:]  # 0.3 s missing
    twin = _told(bad)
    assert not twin.changes
    assert twin.troubles["readings that are no numbers"] == 2
    assert twin.troubles["late readings"] == 1 and twin.troubles["doubled readings"] == 1
    assert twin.troubles["commands that are no numbers"] == 1
    assert twin.troubles["commands that no axis like this carries out"] == 1
    t, x = twin.t, 1e-5
    twin.measure(t + 5.0, x)
    assert twin.troubles["gaps"] == 1
    for k in range(120):
        twin.measure(t - 50.0 + 0.01 * k, x)
    assert twin.troubles["jumps of the clock"] == 1
    assert t - 49.0 < twin.t < t - 48.0 and not twin.changes
    twin.command(TwinCommand(t - 40.0, "start"))
    assert twin.troubles["restarts of the axis"] == 1
    assert twin.measure(t - 39.9, x) is None


def test_old_readings_among_new_ones_move_nothing() -> None:
    """Somebody sends readings of seconds ago once more: that is no jump of the clock."""
    log, random = list(_log()), _random()
    bad = list(log[:200])
    for number, one in enumerate(log[200:], 200):
        # Rising, from both sides of a gap
        old = [log[number - int(k)] for k in (199, *sorted(random.integers(90, 120, 3))[::-1])]
        bad += [one, *(reading for reading in old if not isinstance(reading, TwinCommand))]
    twin, good = _told(bad), _told(log)
    assert twin.troubles.keys() == {"late readings"} and not twin.changes
    assert twin.tracker.x == good.tracker.x and (twin.tracker.theta == good.tracker.theta).all()


def test_a_command_that_comes_late_makes_no_change() -> None:
    """The axis was stopped 0.3 s ago; the readings since deviate, but are no evidence."""
    twin, axis, random = Twin(P), Axis(P), _random()
    twin.command(TwinCommand(0.0, "steps", 1000.0))
    axis.command("steps", 1000)
    for k in range(1, 400):
        if k == 250:
            axis.command("stop")
        if k == 280:
            assert twin.changes  # told: nobody said that the axis was stopped
            twin.command(TwinCommand(axis.state.t - 0.3, "stop"))
            assert not twin.changes and twin.troubles["late commands"] == 1
            twin.command(TwinCommand(axis.state.t, "steps", 100.0))
            axis.command("steps", 100)
        axis.advance(0.01 * k + 0.003 * random.random())
        twin.measure(axis.state.t, axis.state.x + 2e-9 * random.standard_normal())
    assert not twin.changes
    (step,) = (one for one in twin.estimates() if one.name == "step size")
    assert step.low < 133.85e-9 < step.high


@pytest.mark.long
@pytest.mark.parametrize("trouble", ["late", "twice", "old", "none", "gap", "clock", "restart"])
def test_an_axis_that_stays_the_same_is_not_accused_in_disorder(trouble: str) -> None:
    """Random steps back and forth, and one trouble in each move; the axis is another one a time."""
    for seed in (1, 2):
        random = np.random.default_rng(seed)
        values = np.exp(random.normal(0.0, [0.05, 0.01])) * [0.4, P.actuator.gain]
        p = P.replace(preload=values[0], gain=values[1])
        axis, arrivals, t, begun, ahead = Axis(p), list[tuple[float, Any]](), 0.0, 0.0, 0.0
        following, hurt = 0.5, math.inf
        while t < 30.0:
            t += 0.01 + 0.003 * float(random.random())
            axis.advance(t - begun)
            if t >= following:
                steps = int(random.integers(50, 300)) * int(random.choice([-1, 1]))
                axis.command("steps", steps)
                late = float(random.uniform(0.1, 0.6)) if trouble == "late" else 0.0
                arrivals.append((t + late, TwinCommand(t + ahead, "steps", steps)))
                following, hurt = t + float(random.uniform(0.5, 5.0)), t + 0.5
            if t >= hurt:
                if trouble == "clock":
                    ahead, hurt = ahead + float(random.choice([-20.0, -0.5, 0.4, 30.0])), math.inf
                elif trouble == "restart":
                    axis, begun, hurt = Axis(p), t, math.inf
                    arrivals.append((t, TwinCommand(t, "start")))
                elif trouble == "gap" and t < hurt + 1.5:
                    continue
            reading = t + ahead, axis.state.x + 2e-9 * float(random.standard_normal())
            arrivals.append((t, reading))
            if t >= hurt and random.random() < 0.3:
                arrivals += {
                    "twice": [(t + 0.03, reading)], "none": [(t, (t, math.nan))],
                    "old": [next(a for a in arrivals[-200:] if isinstance(a[1], tuple))],
                }.get(trouble, [])  # fmt: skip
        twin = Twin(P)
        changed = [u for u in feed(twin, [what for _, what in sorted(arrivals, key=_arrival)]) if u]
        assert not any(one.changed for one in changed) or trouble == "late"
        assert not twin.changes and sum(twin.troubles.values()) > 0 and twin.driven > 3.0


def _arrival(one: tuple[float, Any]) -> float:
    return one[0]


def test_rest_and_closed_loop_make_blind_and_move_no_estimate() -> None:
    twin = _told(_log())
    before = twin.tracker.theta.copy()
    for k in range(1, 3000):
        twin.measure(twin.t + 0.01, twin.tracker.x + 1e-9 * (-1) ** k)
    assert twin.level[0] == BLIND
    assert np.abs(twin.tracker.theta - before).max() < 1e-3
    twin.command(TwinCommand(twin.t, "position", 1e-6))
    twin.measure(twin.t + 0.01, 5e-6)
    assert twin.troubles["readings during unknown cycles"] == 1
    with pytest.raises(TwinError, match="closed loop"):
        twin.predict_steps(5)


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(TwinError, match="noise is -1"):
        TwinSettings(noise=-1.0)
    with pytest.raises(TwinError, match=r"noise is 0.5 m, .* such as 0.5nm"):
        TwinSettings(noise=0.5)
    with pytest.raises(TwinError, match="certainty is 2"):
        TwinSettings(certainty=2.0)


@pytest.mark.long
@pytest.mark.parametrize("begins", [0.0, 3.0])
def test_a_drift_is_told_and_forecasts_go_with_it(begins: float) -> None:
    """The preload falls by 3 % a second, at 80 V: a move of a second ends 2 % beyond.

    From the start it is a drift at once; later it is first a change, which goes on.
    """
    p, random, steps = P.replace(amplitude=80.0), _random(), round(500 + 100 * begins)
    twin, axis = Twin(p), Axis(p)
    twin.command(TwinCommand(0.0, "steps", steps))
    axis.command("steps", steps)
    for k in range(1, steps + 20):
        axis.advance(0.01 * k + 0.003 * random.random())
        drifts = min(max(axis.state.t - begins, 0.0), 5.0)
        axis.command("parameters", {"preload": 0.4 * math.exp(-0.03 * drifts)})
        twin.measure(axis.state.t, axis.state.x + 2e-9 * random.standard_normal())
    assert twin.level[0] == DRIFTING
    assert [one.goes_on for one in twin.changes] == [True] * bool(begins)
    found, begin = twin.predict_steps(100), axis.state.t
    axis.command("steps", 100)
    while axis.state.t < begin + 1.1:
        axis.advance(axis.state.t + 0.01)
        axis.command(
            "parameters", {"preload": 0.4 * math.exp(-0.03 * (axis.state.t - begin + 5.0))}
        )
    assert found.low < axis.state.x < found.high
    assert found.high - found.low < 40e-9


def test_a_curve_is_the_motion_from_rest_to_rest() -> None:
    """The rest behind the cycles has no part in them: half a nanometre at each begin told."""
    axis = Axis(P)
    axis.command("steps", 10)
    axis.advance(0.2)
    begin, x = axis.state.t, axis.state.x
    curve = CycleCurve.of(P, OperatingPoint(300.0, 100.0, 1, 1))
    axis.command("steps", 12)
    for cycles in (0.3, 0.6, 5.5, 11.7):  # where the ringing is small
        axis.advance(begin + 0.01 * cycles)
        (found,) = curve.at(np.array([cycles]), np.zeros(1))
        assert abs(found - (axis.state.x - x)) < 0.25e-9
    axis.advance(begin + 0.14)
    (found,) = curve.at(np.array([12.0]), np.array([0.02]))
    assert abs(found - (axis.state.x - x)) < 0.02e-9


def test_a_reading_in_the_ringing_is_no_better_anchor_than_it_is() -> None:
    blur, filtered = Blur(ringing=1e-8), ReadingFilter(1, 2e-9)
    filtered.anchor(5e-9, blur)
    filtered.move(0.0, np.zeros(1), 0.0)
    *_, z = filtered.read(5e-9 + 1e-8, Blur())
    assert abs(z) == pytest.approx(1e-8 / math.sqrt(1e-16 + 8e-18))


def test_uncertain_times_leave_as_much_in_common_as_chance_says() -> None:
    """Of the ringing in two readings, each at a time that is known to 8 us."""
    drive, late = OperatingPoint(300.0, 100.0, 1, 1), _random().normal(0.0, 8e-6, (2, 200_000))
    curve = CycleCurve.of(P, drive)
    common = np.cos(2.0 * np.pi * curve.ringing_frequency * (late[0] - late[1])).mean()
    found = curve.blur(Piece(0.0, drive, 10.0), 0.055, 8e-6)
    assert found.coherence == pytest.approx(common, abs=5e-3)


def _in_moves(changes: dict[str, float], moves: int, gain: float = 1.0) -> Twin:
    """Return the twin of an axis in moves of 363 Hz to and fro, which changes after a quarter.

    At this frequency the ringing outlasts a cycle. gain is that of the sensor from then on.
    """
    p, random, t = Parameters.of(preload=0.341, frequency=363.0, amplitude=288.0), _random(), 0.2
    axis, twin, seen = Axis(p), Twin(p), 1.0
    for number in range(moves):
        steps = int((-1) ** number * random.integers(30, 200))
        if number == moves // 4:
            axis.command("parameters", changes)
            seen = gain
        axis.advance(t)
        axis.command("steps", steps)
        twin.command(TwinCommand(t, "steps", float(steps)))
        end = t + abs(steps) / 363.0 + random.uniform(0.1, 0.4)
        for now in np.arange(t, end, 0.005).tolist():
            axis.advance(now)
            twin.measure(now, seen * axis.state.x + 2e-9 * random.standard_normal())
        t = end
    twin.settle()
    return twin


def test_a_step_that_waves_with_the_parameters_is_no_change() -> None:
    """What is known of the parameters moves by 5 % along what the step does not show."""
    twin = _in_moves({}, 24)
    assert not twin.changes
    (step,) = (one for one in twin.estimates() if one.name == "step size")
    assert abs(abs(step.value) - 125.725e-9) < 0.05e-9


@pytest.mark.long
def test_a_force_is_named_and_told_once() -> None:
    (force,) = _in_moves({"force": 6e-3}, 12).changes
    assert force.verdict and force.verdict.cause == "force"
    assert abs(force.verdict.sizes["force"] - 6e-3) < 6e-4


@pytest.mark.long
def test_a_sensor_that_makes_the_position_jump_is_judged_from_there_on() -> None:
    (sensor,) = _in_moves({}, 12, gain=1.1).changes
    assert sensor.verdict and "sensor gain" in sensor.verdict.possible
    assert abs(sensor.verdict.sizes["sensor gain"] - np.log(1.1)) < 3e-3


def test_an_axis_that_makes_no_step_does_not_drift() -> None:
    """The contact takes a stroke of half a nanometre elastically."""
    tracker, drive = Twin(P).tracker, OperatingPoint(1.0, 1.0, 1, 1)
    assert tracker.step_size(drive)[0] == 0.0
    assert tracker.drift(drive) == (0.0, 0.0)
