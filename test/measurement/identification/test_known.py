# SPDX-License-Identifier: Apache-2.0
"""What an identification takes: arrays, tables with units, uncertain inputs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from experiments import holds, small, truth_of

from stickslip_ros.measurement.identification import IdentificationError, identify
from stickslip_ros.measurement.identification.known import Known, known_runs
from stickslip_ros.physics.parameters import ParameterError, Parameters

DRIVE = {"preload": 0.5, "mass": 5e-3, "frequency": 800.0, "amplitude": 250.0}
T = np.arange(0.0, 0.01, 1e-4)
X = 1e-7 * np.sin(500.0 * T)


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    path = tmp_path / "drive.yaml"
    path.write_text("/**:\n  ros__parameters:\n    preload: 0.4 +- 0.02\n    mass: 4g ± 80mg\n")
    return path


def test_an_input_with_a_deviation_is_read_from_files_and_mappings(drive: Path) -> None:
    known = Known.of(drive)
    assert known.parameters.friction.preload == 0.4
    assert known.deviations == {"preload": 0.02, "mass": pytest.approx(8e-5)}
    assert known.parts({}) == {"preload": pytest.approx(0.05), "mass": pytest.approx(0.02)}
    half = Known.of({"preload": "400mN +/- 5 mN"}).parts({"mass": 2e-4})
    assert half == {"preload": pytest.approx(0.0125), "mass": pytest.approx(0.05)}
    with pytest.raises(IdentificationError, match="spring is 0 with a standard deviation of 1; bo"):
        known.parts({"spring": 1.0})
    assert Parameters.of(drive).friction.preload == 0.4  # every other command reads it, too
    with pytest.raises(IdentificationError, match="frequency cannot be uncertain; those that can"):
        Known.of({"frequency": "100 +- 1"})
    with pytest.raises(IdentificationError, match="preload: the standard deviation 'much' is not"):
        Known.of({"preload": "0.4 +- much"})
    with pytest.raises(ParameterError, match="preload is 'half'; it has to be"):
        Known.of({"preload": "half +- 0.1"})


def test_arrays_frames_and_labelled_arrays_with_units_are_motions(drive: Path) -> None:
    pandas, xarray = pytest.importorskip("pandas"), pytest.importorskip("xarray")
    frame = pandas.DataFrame({"time (ms)": 1e3 * T, "position (nm)": 1e9 * X})
    array = xarray.DataArray(
        1e9 * X, coords={"t": ("t", 1e3 * T, {"units": "ms"})}, dims="t", name="position",
        attrs={"units": "nm"},
    )  # fmt: skip
    path = drive.with_name("trace.csv")
    frame.to_csv(path, index=False)
    for measured in ([frame], [array], [array.to_dataset()], [path], [str(path)], [T, X]):
        ((_, motion),) = known_runs([(DRIVE, *measured)])
        assert motion.t == pytest.approx(T)
        assert motion.x == pytest.approx(X, abs=1e-15)
    ((known, motion),) = known_runs([(drive, T.tolist(), X.tolist())])
    assert (known.parameters.friction.preload, motion.source) == (0.4, "run 1")


@pytest.mark.parametrize(
    ("runs", "words"),
    [
        ("drive.yaml", r"runs is 'drive.yaml'; it has to be a list such as \[\('drive.yaml', 't"),
        (["trace.csv"], r"run 1 is 'trace.csv'; each run is \(drive, motion\) or \(drive, t, x\)"),
        ([(DRIVE, T, X, X)], "run 1 is a tuple; each run is"),
        ([("trace.csv", DRIVE)], "run 1 begins with 'trace.csv', a measurement; give the drive"),
        ([(7, T, X)], "a int is no drive"),
        ([(DRIVE, 7)], "the motion of run 1: arrays: int 7 is no mea"),
        ([(DRIVE, T, X[1:])], "position has 99 samples and time has 100"),
        ([(DRIVE, T[::-1], X)], "does not come after"),
    ],
)
def test_a_wrong_call_says_which_argument_was_expected(runs: Any, words: str) -> None:
    with pytest.raises(IdentificationError, match=words):
        identify(runs)


def test_a_second_positional_file_is_no_list_of_names() -> None:
    with pytest.raises(IdentificationError, match=r"runs is 'drive.yaml'; it has to be a list"):
        identify("drive.yaml", "a.csv")  # type: ignore[arg-type]


@pytest.mark.long
def test_intervals_grow_by_what_an_input_is_uncertain() -> None:
    """A preload off by 4 % moves sigma_0ss as much, and no record can tell."""
    axis, (known, motion) = small()
    wrong = known.replace(preload=0.52)
    exact = identify([(wrong, motion)], fit_lag=False, samples="point").parameters["sigma_0ss"]
    wide = identify([(wrong, motion)], fit_lag=False, samples="point", uncertain={"preload": 0.02})
    told = wide.parameters["sigma_0ss"]
    assert told.low is not None and exact.low is not None
    assert told.value == pytest.approx(exact.value, rel=0.02)
    assert holds(told.low, truth_of(axis)["sigma_0ss"], told.high)
    assert told.low < exact.low * 0.97
    assert not any("preload would not show" in line for line in wide.given)
