# SPDX-License-Identifier: Apache-2.0
"""The waveforms: what each looks like, what contradicts it, and tables from files."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from table_1 import table_1

from stickslip_ros.physics.model import WAVEFORMS, DriveCycle, drive_of
from stickslip_ros.physics.model.waveforms import Shape, drives_of, largest_slip
from stickslip_ros.physics.parameters import DriveParameters, ParameterError
from stickslip_ros.physics.waveforms.built_in import slip_time, slip_too_long

STROKE = 160e-9


def drive_cycle_of(sign: int = 1, **values: Any) -> DriveCycle:
    return drive_of(table_1(**values), sign)


def corners(drive_cycle: DriveCycle) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (s) and deflections (m) at the kinks, the start included."""
    ways = drive_cycle.durations * drive_cycle.rates
    return np.append(0.0, np.cumsum(drive_cycle.durations)), np.append(0.0, np.cumsum(ways))


@pytest.fixture
def table(tmp_path: Path) -> Path:
    return tmp_path / "own.csv"


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("values", "times", "levels", "slip"),
    [
        ({"waveform": "sawtooth", "hold_before": 0.3, "split": 0.2, "latency": 1e-4},
         [0, 9.997, 10], [0, 1, 0], (1, 2)),
        ({"waveform": "hold", "hold_before": 0.2, "hold_after": 0.3},
         [0, 4.997, 6.997, 7, 10], [0, 1, 1, 0, 0], (2, 3)),
        ({"waveform": "hold", "hold_after": 0.5}, [0, 4.997, 5, 10], [0, 1, 0, 0], (1, 2)),
        ({"waveform": "shaped", "split": 0.8, "latency": 1e-4},
         [0, 9.897, 9.8994, 9.9994, 10], [0, 1, 0.2, 0.2, 0], (1, 4)),
        ({"waveform": "shaped", "split": 0.5, "latency": 1e-4, "hold_before": 0.1,
          "hold_after": 0.2}, [0, 6.897, 7.897, 7.8985, 7.9985, 8, 10],
         [0, 1, 1, 0.5, 0.5, 0, 0], (2, 5)),
        ({"waveform": "shaped", "split": 1.0, "latency": 1e-4},
         [0, 9.897, 9.9, 10], [0, 1, 0, 0], (1, 2)),
        ({"waveform": "shaped", "split": 0.0, "latency": 1e-4},
         [0, 9.897, 9.997, 10], [0, 1, 1, 0], (2, 3)),
        ({"waveform": "shaped"}, [0, 9.997, 9.9985, 10], [0, 1, 0.5, 0], (1, 3)),
        ({"waveform": "triangle", "slewrate": 1e-3}, [0, 5, 10], [0, 1, 0], (1, 2)),
    ],
)  # fmt: skip
def test_corners(
    values: dict[str, Any],
    times: list[float],
    levels: list[float],
    slip: tuple[int, int],
    sign: int,
) -> None:
    """At 100 Hz and 300 V: times in ms, levels in parts of the stroke; sign -1 mirrors."""
    drive_cycle = drive_cycle_of(sign, **values)
    t, u = corners(drive_cycle)
    assert u[-1] == pytest.approx(0.0, abs=1e-20)
    np.testing.assert_allclose(1e3 * t, times, atol=1e-12)
    np.testing.assert_allclose(u / (sign * STROKE), levels, atol=1e-12)
    assert (drive_cycle.slip, drive_cycle.slip_end, drive_cycle.sign) == (*slip, sign)
    assert drive_cycle.slip_duration == pytest.approx(t[slip[1]] - t[slip[0]])


def test_a_hold_of_no_time_is_the_sawtooth() -> None:
    """To the last bit: segments that take no time are not there."""
    for amplitude, frequency in ((300.0, 100.0), (123.4, 18.5e3)):
        drive: dict[str, Any] = {"amplitude": amplitude, "frequency": frequency}
        plain, held = drive_cycle_of(**drive), drive_cycle_of(waveform="hold", **drive)
        np.testing.assert_array_equal(held.durations, plain.durations)
        np.testing.assert_array_equal(held.rates, plain.rates)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"waveform": "sine"}, "'sine'; known: " + ", ".join(WAVEFORMS)),
        ({"waveform": "hold", "hold_before": 0.5, "hold_after": 0.6},
         r"10000 us a cycle, of which holds and latency take 11000 us.*lower hold_before"),
        ({"waveform": "shaped", "latency": 9.9999e-3}, r"take 9999\.9 us.*takes 3 us.*latency"),
        ({"waveform": "shaped", "frequency": 1e5, "latency": 8e-6}, r"10 us.*lower.*frequency"),
        ({"waveform": "hold", "frequency": 1e6, "max_frequency": 1e6},
         r"1 us a cycle, but the slip.*takes 3 us: stay below 333333 Hz"),
        ({"waveform": "table"}, "waveform_table names no file"),
        ({"waveform": "table", "waveform_table": "none.csv"}, "cannot read none.csv: No such"),
        ({"waveform": "table", "waveform_table": "."}, r"cannot read \.: "),
        ({"waveform": "table", "waveform_table": "a\0b"}, "cannot read"),
    ],
)  # fmt: skip
def test_what_contradicts(values: dict[str, Any], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        drive_cycle_of(**values)


def test_limits_of_the_amplifier() -> None:
    """max_voltage and max_frequency bound the drive."""
    refused: list[tuple[dict[str, Any], str]] = [
        ({"amplitude": 301.0}, "amplitude is 301 V; it has to lie between 1e-09 and 300 V"),
        ({"frequency": 2e5}, "frequency is 200000 Hz; it has to lie between 1e-06 and 100000 Hz"),
    ]
    for values, words in refused:
        with pytest.raises(ParameterError, match=words):
            drive_cycle_of(**values)


def test_a_shape_that_says_nothing_of_its_slip_has_a_cure_too() -> None:
    shape = Shape((-1e-3, 2e-3), (1.0, -1.0), (1, 2))
    assert slip_too_long(table_1().drive, shape) == (
        "frequency 100 Hz leaves 10000 us a cycle, too little for a segment of the waveform: "
        "lower the frequency"
    )


def test_the_largest_slip_just_fits() -> None:
    """A little less than `largest_slip` is possible, a little more is not."""
    for values in (
        {"waveform": "sawtooth"},
        {"waveform": "hold", "hold_before": 0.2, "hold_after": 0.1},
        {"waveform": "shaped", "latency": 2e-6, "hold_after": 0.1},
    ):
        p = table_1(**{"max_voltage": 1e4, "frequency": 5e4, **values})
        volts = float(largest_slip(p.drive))
        drive_of(p.replace(amplitude=0.999 * volts))
        with pytest.raises(ParameterError):
            drive_of(p.replace(amplitude=1.001 * volts))
    assert largest_slip(DriveParameters(waveform="triangle")) == np.inf


# -- tables


def test_a_table_of_levels(table: Path) -> None:
    """The 256 points of a controller that plays a sawtooth, and its way back to the first."""
    levels = [*np.linspace(0.0, 1.0, 256).tolist(), 0.0]
    table.write_text("# points of the controller\n" + "\n".join(map(repr, levels)))
    drive_cycle = drive_cycle_of(waveform="table", waveform_table=str(table))
    t, u = corners(drive_cycle)
    np.testing.assert_allclose(t, np.linspace(0.0, 10e-3, 257), atol=1e-15)
    np.testing.assert_allclose(u / STROKE, levels, atol=1e-12)
    assert (drive_cycle.slip, drive_cycle.slip_end) == (255, 256)


def test_a_table_with_times(table: Path) -> None:
    """Comments, blank lines, semicolons; it begins at a level of its own; the slip holds within."""
    table.write_text(
        "# share; level\n0; 0.25\n0.5; 1.0 # top\n\n0.6; 1.0\n0.61; 0.5\n0.7; 0.5\n"
        "0.72; 0.1\n0.8; 0.1\n1; 0.25\n"
    )
    drive_cycle = drive_cycle_of(-1, waveform="table", waveform_table=str(table))
    t, u = corners(drive_cycle)
    np.testing.assert_allclose(1e3 * t, [0, 5, 6, 6.1, 7, 7.2, 8, 10], atol=1e-12)
    levels = 0.25 - u / STROKE
    np.testing.assert_allclose(levels, [0.25, 1, 1, 0.5, 0.5, 0.1, 0.1, 0.25], atol=1e-12)
    assert (drive_cycle.slip, drive_cycle.slip_end) == (2, 5)
    assert drive_cycle.slip_duration == pytest.approx(1.2e-3)


def test_a_level_that_is_held_but_for_rounding_is_no_part_of_the_slip(table: Path) -> None:
    table.write_text("0, 0\n0.5, 1\n0.51, 7e-17\n1, 0\n")
    drive_cycle = drive_cycle_of(waveform="table", waveform_table=str(table))
    assert (drive_cycle.slip, drive_cycle.slip_end) == (1, 2)


def test_a_table_is_read_again_when_it_changed(table: Path) -> None:
    table.write_text("0\n1\n0\n")
    name: dict[str, Any] = {"waveform": "table", "waveform_table": str(table)}
    assert corners(drive_cycle_of(**name))[1].max() == pytest.approx(STROKE)
    table.write_text("0\n.5\n0\n")
    os.utime(table, ns=(1, 1))
    assert corners(drive_cycle_of(**name))[1].max() == pytest.approx(STROKE / 2)
    table.unlink()
    with pytest.raises(ParameterError, match="cannot read"):
        drive_cycle_of(**name)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds 0 points; a waveform has 3 or more"),
        ("0\n0\n", "holds 2 points"),
        ("0\n1\n1.1\n0", "line 3: level 1.1 has to lie between 0 and 1"),
        ("0\n-0.1\n0", "line 2: level -0.1"),
        ("0\nnan\n0", "line 2: every number has to be finite"),
        ("0\ninf\n0", "line 2: every number has to be finite"),
        ("0\n1\n# c\n0.5", "line 4: the waveform ends at level 0.5, but begins at 0; .*close"),
        ("0.5\n0.5\n0.5", "all levels are 0.5"),
        ("level\n0\n1\n0", "line 1 is not a row of numbers.*one column of levels"),
        ("0,0,0\n1,1,1\n0,0,0", "line 1: 3 columns"),
        ("0\n1,1\n0", "line 2: 2 columns; .*as many in every line"),
        ("0,0\n0.5,1\n0.5,0.5\n1,0", "line 3: time share 0.5 follows 0.5"),
        ("0.1,0\n0.5,1\n1,0", "line 1: time share 0.1 has to be 0"),
        ("0,0\n0.5,1\n10,0", "line 3: time share 10 has to be 1"),
    ],
)
def test_a_broken_table_is_refused_with_the_line(text: str, words: str, table: Path) -> None:
    table.write_text(text)
    with pytest.raises(ParameterError, match=words) as error:
        drive_cycle_of(waveform="table", waveform_table=str(table))
    assert str(table) in str(error.value)


def test_bytes_that_are_no_text(table: Path) -> None:
    table.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ParameterError, match="is not a text file"):
        drive_cycle_of(waveform="table", waveform_table=str(table))


# -- columns


@pytest.mark.parametrize("actuator", ["linear", "hysteresis"])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("waveform", WAVEFORMS)
def test_a_column_is_as_one_by_one(waveform: str, sign: int, actuator: str, table: Path) -> None:
    """Rows of as many segments as each point has, to the last bit."""
    table.write_text("0\n0.3\n0.3\n1\n0.5\n0\n0\n0.0\n")
    draw = np.random.default_rng(5)
    p = table_1(waveform=waveform, waveform_table=str(table), max_frequency=1e6)
    p = p.replace(actuator=actuator, hysteresis=draw.uniform(0.0, 0.4, 80))
    p = p.replace(amplitude=draw.uniform(10, 320, 80), frequency=10.0 ** draw.uniform(1, 6.1, 80))
    p = p.replace(hold_before=draw.choice([0.0, 0.3, 0.6], 80))
    p = p.replace(hold_after=draw.choice([0.0, 0.3, 0.5], 80))
    p = p.replace(split=draw.choice([0.0, 0.4, 1.0], 80))
    p = p.replace(latency=draw.choice([0.0, 1e-6, 1e-4], 80))
    drive_cycles, possible = drives_of(p, 80, sign)
    assert 0 < possible.sum() < 80
    for k in range(80):
        try:
            wanted = drive_of(p.point(k), sign)
        except ParameterError:
            assert not possible[k]
            continue
        assert possible[k]
        found = drive_cycles.row(k)
        assert (wanted.durations > 0.0).all()
        np.testing.assert_array_equal(found.durations, wanted.durations)
        np.testing.assert_array_equal(found.rates, wanted.rates)
        assert not drive_cycles.durations[k, len(wanted.durations) :].any()
        assert (found.slip, found.slip_parts) == (wanted.slip, wanted.slip_parts)


def test_a_new_waveform_is_one_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    """Slow way down, fast way up: a shape of its own, by a function and its name."""

    def fast_rise(d: DriveParameters) -> Shape:
        period, rise = 1.0 / d.frequency, slip_time(d)
        return Shape((rise, period - rise), (1.0, -1.0), slip=(1, 2))

    monkeypatch.setitem(WAVEFORMS, "fast_rise", fast_rise)  # type: ignore[arg-type]
    t, u = corners(drive_cycle_of(waveform="fast_rise"))
    np.testing.assert_allclose(t, [0.0, 3e-6, 0.01])
    np.testing.assert_allclose(u, [0.0, STROKE, 0.0], atol=1e-20)
