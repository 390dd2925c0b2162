# SPDX-License-Identifier: Apache-2.0
"""A bag of an axis of ours whose samples do not show its slips is simulated again."""

from pathlib import Path

import numpy as np
import pytest
from bags import EVENTS, JOINTS, SECOND, START, event, header, serialized, topic
from table_1 import TABLE_1, table_1

import stickslip_ros as ss
from stickslip_ros.axis import Axis
from stickslip_ros.axis.events import event_texts
from stickslip_ros.measurement.bags.finer import _times
from stickslip_ros.measurement.bags.load_motion import load_motion
from stickslip_ros.recordings import BagWriter

STEPS, FIRST = 20, 50
AXIS_EVENTS = topic("/stickslip_axis/events", EVENTS.type)


def record(
    folder: Path,
    rate: int,
    with_commands: bool = True,
    part: float = 1.0,
    lost: int = -1,
    then: str = "",
    value: float | None = None,
) -> None:
    """Write what an axis and a recorder write of steps there and back, at a rate in Hz.

    lost: number of an event that the recorder did not hear; then, value: a command within the steps
    back.
    """
    axis = Axis(dict(TABLE_1))
    with BagWriter(folder) as bag:
        for one in (JOINTS, AXIS_EVENTS):
            bag.add_topic(one)
        for number in range(round(part * rate)):
            axis.advance(number / rate)
            if number * 1000 == FIRST * rate:
                axis.command("steps", STEPS)
            elif number * 2 == rate:
                axis.command("steps", -STEPS)
            elif then and number * 100 == 55 * rate:
                axis.command(then, *([] if value is None else [value]))
            ns = START + number * SECOND // rate
            for told in axis.take_events() if with_commands else ():
                if told.number == lost:
                    continue
                at = START + round(told.time * SECOND)
                data = event(at, **event_texts(told))
                bag.write(AXIS_EVENTS.name, data, log_ns=ns, publish_ns=ns)
            state = axis.state
            row = np.array([state.x, state.u]), np.array([state.v, state.rate])
            data = serialized(
                JOINTS.type, header=header(ns), name=["axis_slider", "axis_piezo"],
                position=row[0], velocity=row[1], effort=np.zeros(2),
            )  # fmt: skip
            bag.write(JOINTS.name, data, log_ns=ns, publish_ns=ns)


def test_the_events_of_a_bag_tell_how_its_axis_was_driven(tmp_path: Path) -> None:
    """Begins count from its first message, as its times do; some of the events tell nothing."""
    record(tmp_path / "whole", 1000)
    found = load_motion(tmp_path / "whole")
    assert found.drive is not None
    assert (found.drive.frequencies, found.drive.steps) == ((100.0, 100.0), (STEPS, -STEPS))
    # Commands come between two messages, at the time of the first of them.
    assert found.drive.begins == pytest.approx((1e-3 * FIRST, 0.5))
    x = found.motion.position_at(np.array([1e-3 * FIRST, 0.5]))
    assert abs(x[0] - found.motion.x[0]) < 1e-8 < abs(x[1])
    record(tmp_path / "lost", 1000, lost=2)
    record(tmp_path / "jog", 1000, then="jog", value=100.0)
    record(tmp_path / "stopped", 1000, then="stop")
    record(tmp_path / "foreign", 1000, with_commands=False)
    for name in ("lost", "jog", "stopped", "foreign"):
        assert load_motion(tmp_path / name).drive is None, name


def test_the_ringing_after_a_motion_is_part_of_it() -> None:
    """A bag that was simulated again lacked it after the last step: up to 30 nm."""
    recorded = np.arange(0.0, 1.0, 0.01)
    t = _times(recorded, (recorded > 0.195) & (recorded < 0.305), 1e-4)
    dense = t[(t >= 0.2) & (t <= 0.3 + 1200e-4)]
    assert np.diff(dense) == pytest.approx(1e-4)
    assert len(dense) == 2200
    assert t[t < 0.18] == pytest.approx(recorded[recorded < 0.18])
    assert t[t > 0.45] == pytest.approx(recorded[recorded > 0.45])


@pytest.mark.long
@pytest.mark.parametrize("rate", [20, 1000])
def test_analyse_gives_the_backstep_of_the_simulation(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], rate: int
) -> None:
    """6.5 nm were "determined" at 1 kHz where it is 87, and at 20 Hz there was no run."""
    record(tmp_path / "run", rate)
    truth = ss.analyse(ss.simulate(table_1(), steps=STEPS))
    found = ss.analyse(tmp_path / "run")
    assert "do not show the slips; simulated again from its commands" in capfd.readouterr().err
    assert found.steps == STEPS and not found.doubts
    assert found.backstep == pytest.approx(truth.backstep, abs=3.0 * found.backstep_error)
    assert found.backstep_error < 0.2e-9
    assert found.step_size == pytest.approx(truth.step_size, abs=0.02e-9)
    assert ss.compare("table1_typical.yaml", tmp_path / "run").differing == []


@pytest.mark.long
def test_samples_that_suffice_and_bags_without_commands_stay_as_they_are(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    record(tmp_path / "fine", 80_000, part=0.3)
    record(tmp_path / "foreign", 1000, with_commands=False)
    assert ss.analyse(tmp_path / "fine").steps == STEPS
    assert np.isnan(ss.analyse(tmp_path / "foreign").backstep)
    assert "simulated again" not in capfd.readouterr().err


def test_a_bag_that_lost_a_command_is_taken_as_it_is(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """What the lost command did would be missing in silence."""
    record(tmp_path / "run", 1000, lost=2)
    assert np.isnan(ss.analyse(tmp_path / "run").backstep)
    assert "it lacks events" in capfd.readouterr().err
