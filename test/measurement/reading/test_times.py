# SPDX-License-Identifier: Apache-2.0
"""Times as clocks, loggers and ROS write them: exact, in order, of one day and one zone."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from stickslip_ros.measurement.reading import MeasurementError, Reading, read_measurement
from stickslip_ros.measurement.reading.given import given_motion
from stickslip_ros.simulation.motion import Motion

EPOCH = 1_700_000_000_123_456_789  # ns
COUNT = 40
NM = Reading(units={"x": "nm"})


def read(path: Path, lines: list[str], how: Reading = NM) -> Motion:
    path.write_text("\n".join([*lines, ""]))
    return read_measurement(path, how)


def stamped(stamps: list[str]) -> list[str]:
    return ["stamp;x (nm)", *(f"{stamp};{k}.5" for k, stamp in enumerate(stamps))]


def test_whole_nanoseconds_since_the_epoch_are_exact_in_every_form(tmp_path: Path) -> None:
    """Floats hold them to 128 ns: 10 MHz was refused, slower ones were 110 ns off."""
    stamps, x = EPOCH + 100 * np.arange(COUNT), np.arange(COUNT)
    rows = [f"{stamp},{k}" for k, stamp in enumerate(stamps.tolist())]
    np.savez(tmp_path / "a.npz", time_ns=stamps, x_nm=x)
    np.savez(tmp_path / "b.npz", time_ns=stamps.astype(np.uint64), x_nm=x)
    table = pd.DataFrame({"time (ns)": stamps, "x (nm)": x})
    for found in (
        read(tmp_path / "a.csv", ["time (ns),x (nm)", *rows]),
        read(tmp_path / "b.csv", ["time (ns),x (nm)", *rows, "again"]),
        read_measurement(tmp_path / "a.npz"),
        read_measurement(tmp_path / "b.npz"),
        given_motion(table),
    ):
        assert found.t == pytest.approx(1e-7 * np.arange(COUNT), rel=1e-15, abs=0.0)
        assert f"times count from the first row, {1e-9 * EPOCH:.17g} s" in found.notes
    with pytest.raises(MeasurementError, match="have more digits than a number holds"):
        given_motion(table.astype(float))


@pytest.mark.parametrize(
    ("lines", "how"),
    [
        # ros2 topic echo --csv of JointState and PointStamped; rostopic echo -p, Float64, too
        ("{s},{n},base,axis_slider,axis_piezo,{x},{u},0.0,0.0,,", {"x": "6"}),
        ("{s},{n},,{x},0.0,0.0", {"x": "4"}),
        (
            "%time,field.header.seq,field.header.stamp,field.name0,field.position0,field.position1\n"
            "{ns},{k},{ns},axis_slider,{x},{u}", {"x": "field.position0"},
        ),
        ("%time,field.header.stamp,field.point.x\n{ns},{ns},{x}", {}),
        ("%time,field.data\n{ns},{x}", {}),
        ("time,position[0],position[1]\n{t},{x},{u}", {"x": "position[0]"}),
    ],
)  # fmt: skip
def test_text_of_ros_is_understood(lines: str, how: dict[str, str], tmp_path: Path) -> None:
    """Also that `position[0]` is an index and no unit."""
    *head, form = lines.split("\n")
    stamps = [EPOCH + 10**6 * k for k in range(1200)]
    rows = [
        form.format(k=k, t=1e-3 * k, s=ns // 10**9, n=ns % 10**9, ns=ns, x=1e-9 * k, u=2e-9 * k)
        for k, ns in enumerate(stamps)
    ]
    units = {"x": "m"} | ({"t": "s"} if lines[:5] == "time," else {})
    found = read(tmp_path / "echo.csv", [*head, *rows], Reading(columns=how, units=units))
    assert found.t == pytest.approx(1e-3 * np.arange(1200), rel=1e-14, abs=1e-15)
    assert found.x == pytest.approx(1e-9 * np.arange(1200), rel=1e-12, abs=1e-24)


def test_numbers_of_ros_without_stamps_take_a_rate(tmp_path: Path) -> None:
    rows = [f"{1e-9 * k}" for k in range(COUNT)]
    assert read(tmp_path / "a.csv", rows, Reading(units="x=m", rate=1e3)).t[-1] == 0.039  # type: ignore[arg-type]


def test_an_offset_from_utc_is_used(tmp_path: Path) -> None:
    """Where the clock changes from one offset to the other, the times go on."""
    stamps = [f"2024-10-27T02:59:59.{k}+02:00" for k in range(10)]
    stamps += [f"2024-10-27T02:00:00.{k}+01:00" for k in range(10)]
    found = read(tmp_path / "a.csv", stamped(stamps))
    assert found.t == pytest.approx(0.1 * np.arange(20))
    stamps = [f"2024-10-27T23:59:59.{k}Z" for k in range(10)]
    stamps += [f"2024-10-27T20:00:00.{k}-0400" for k in range(10)]
    assert read(tmp_path / "a.csv", stamped(stamps)).t == pytest.approx(0.1 * np.arange(20))
    mixed = [stamp.removesuffix("-0400") for stamp in stamps]
    with pytest.raises(MeasurementError, match="10 of 20 lines are no rows"):
        read(tmp_path / "a.csv", stamped(mixed))


@pytest.mark.parametrize(("before", "after", "what"), [
    ("02:59:59", "02:00:00", "an hour repeats before it, as where daylight saving ends"),
    ("01:59:59", "03:00:00", "an hour is missing before it, as where daylight saving begins"),
])  # fmt: skip
def test_an_hour_that_repeats_or_is_missing_is_named(
    before: str, after: str, what: str, tmp_path: Path
) -> None:
    stamps = [f"2024-10-27 {before}.{k:02d}" for k in range(0, 100, 5)]
    stamps += [f"2024-10-27 {after}.{k:02d}" for k in range(0, 100, 5)]
    with pytest.raises(MeasurementError, match=f"line 22, column 1 stamp: {what}") as refused:
        read(tmp_path / "a.csv", stamped(stamps))
    assert "+02:00, or read one part: --rows 1:20 or --rows 21:" in str(refused.value)
    part = Reading(rows="21:")  # type: ignore[arg-type]
    assert read(tmp_path / "a.csv", stamped(stamps), part).t[-1] == pytest.approx(0.95)


def test_a_day_with_a_pause_is_no_midnight(tmp_path: Path) -> None:
    stamps = [f"2024-05-01 {hour:02d}:00:{k:02d}" for hour in (1, 20) for k in range(20)]
    assert read(tmp_path / "a.csv", stamped(stamps)).t[20] == 19 * 3600.0
    stamps = [f"{hour:02d}:{minute}:{k:02d}" for hour, minute in ((23, 59), (0, "00"))
              for k in range(40, 60)]  # fmt: skip
    assert read(tmp_path / "a.csv", stamped(stamps)).t[20] == 60.0
