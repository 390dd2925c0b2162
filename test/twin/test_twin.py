# SPDX-License-Identifier: Apache-2.0
"""The twin beside an axis that somebody else integrates, changed in ways that it is not told."""

import math
from functools import cache

import numpy as np
import pytest

from stickslip_ros.axis import Axis
from stickslip_ros.parameters import Parameters
from stickslip_ros.twin import Twin, TwinCommand, TwinSettings
from stickslip_ros.twin.settings import TwinError
from stickslip_ros.twin.timeline import OperatingPoint
from stickslip_ros.twin.twin import BLIND, CHANGED, DRIFTING, OK, UNLIKE
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
            axis.command_steps(205)
            twin.command(TwinCommand(axis.state.t, "steps", 205.0))
        axis.advance(0.01 * k + (1.25e-4 if k >= 10 else 0.01))
        twin.measure(axis.state.t, axis.state.x + noise[k])
    assert not twin.changes and twin.driven > 1.0


@pytest.mark.slow
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
    ("name", "value"),
    [("sensor", 1.1), ("preload", 0.95), ("amplifier", 0.97)],
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


def test_two_amplitudes_tell_sensor_from_amplifier() -> None:
    """The amplifier takes a share of the stroke, the sensor one of the step."""
    axis = RealAxis(P, lambda t, _: Hidden(amplifier=0.97 if t >= 2.5 else 1.0), seed=5)
    for volts in (300.0, 100.0, 300.0, 100.0, 300.0):
        axis.command("amplitude", volts)
        axis.step(100)
    (change,) = _told(axis.log).changes
    assert change.verdict is not None and change.verdict.cause == "amplifier"


def test_readings_go_on_while_a_cause_is_judged() -> None:
    """A piece at a time; then the tracker starts anew from the cause and has lost no reading."""
    twin, axis, random = Twin(P), Axis(P), _random()
    twin.command(TwinCommand(0.0, "steps", 10_000))
    axis.command_steps(10_000)
    judged_at = math.nan
    while math.isnan(judged_at) or axis.state.t < judged_at + 0.5:
        axis.advance(axis.state.t + 0.01 + 1e-3 * random.random())
        if 1.0 < axis.state.t < 1.02:
            axis.set_parameters({"preload": 0.32})
        assert twin.measure(axis.state.t, axis.state.x + 2e-9 * random.standard_normal()) or (
            axis.state.t < 0.03
        )
        if math.isnan(judged_at) and twin.changes and twin.changes[0].verdict:
            judged_at = axis.state.t
        assert axis.state.t < 60.0
    (change,) = twin.changes
    assert judged_at > change.told + 2.5  # not with the reading that is the last of 200
    assert change.verdict and "preload" in change.verdict.possible
    (step,) = (one for one in twin.estimates() if one.name == "step size")
    assert step.low - 0.1e-9 < 136.7e-9 < step.high + 0.1e-9
    assert twin.troubles.keys() <= {"jumps of the position"}  # that of the preload


def test_what_changes_slowly_drifts() -> None:
    """The preload falls by 6 % in a second, which is no change where drift may be as large."""
    twin, axis, random = Twin(P, TwinSettings(drift_hour=0.3, drift_window=4.0)), Axis(P), _random()
    twin.command(TwinCommand(0.0, "steps", 10_000))
    axis.command_steps(10_000)
    while axis.state.t < 6.0:
        axis.advance(axis.state.t + 0.01 + 1e-3 * random.random())
        axis.set_parameters({"preload": 0.4 * math.exp(-0.06 * axis.state.t)})
        twin.measure(axis.state.t, axis.state.x + 2e-9 * random.standard_normal())
    rate, deviation = twin.drift
    assert twin.level[0] == DRIFTING
    assert abs(rate - 0.005) < 3.0 * deviation < 0.005
    assert not twin.changes


def test_a_wrong_file_is_told_from_the_start() -> None:
    twin = _told(_log(), P.replace(preload=0.8, mu=0.4))
    assert twin.changes[0].at_start
    assert "file" in twin.changes[0].text


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
    twin.measure(t - 50.0, x)
    assert twin.troubles["jumps of the clock"] == 1
    twin.command(TwinCommand(t - 50.0, "start"))
    assert twin.troubles["restarts of the axis"] == 1
    assert twin.measure(t - 49.9, x) is None


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
    with pytest.raises(TwinError, match="certainty is 2"):
        TwinSettings(certainty=2.0)
