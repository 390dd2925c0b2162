# SPDX-License-Identifier: Apache-2.0
"""Arrays, tables and datasets of a program go in wherever a file does."""

from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import stickslip_ros as ss

NM, MS = 1e9, 1e3


@pytest.fixture(scope="module")
def motion() -> ss.Motion:
    """The sample measurement."""
    return ss.read_measurement("steps_100hz.csv")


def forms_of(motion: ss.Motion) -> dict[str, Any]:
    t, x = motion.t, motion.x
    position = xr.DataArray(
        NM * x, coords={"time": ("time", t, {"units": "s"})}, dims="time", attrs={"units": "nm"}
    )
    return {
        "pair": (t, x),
        "frame": pd.DataFrame({"t (ms)": MS * t, "x (nm)": NM * x}),
        "index": pd.DataFrame({"position_nm": NM * x}, index=pd.Index(t, name="time (s)")),
        "durations": pd.DataFrame({"position_nm": NM * x}, index=pd.to_timedelta(t, unit="s")),
        "array": position,
        "dataset": position.to_dataset(name="position"),
    }


@pytest.mark.parametrize("form", ["pair", "frame", "index", "durations", "array", "dataset"])
def test_every_form_is_the_motion_of_the_file(motion: ss.Motion, form: str) -> None:
    read = ss.read_measurement(forms_of(motion)[form])
    np.testing.assert_allclose(read.t, motion.t, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(read.x, motion.x, rtol=0.0, atol=1e-15)


def test_a_loop_in_a_table_is_identified() -> None:
    volts = 240.0 * np.abs(np.linspace(-1.0, 1.0, 401))
    table = pd.DataFrame({"voltage (V)": volts, "deflection (nm)": 0.9 * volts})
    assert ss.identify_actuator(table).gain == pytest.approx(0.9e-9)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("a.csv", "b.csv"), "cannot read a.csv"),
        (("steps_100hz.csv", [0.0]), "steps_100hz.csv is a measurement of its own"),
        (("table1_typical.yaml",), "is a parameter file and no measurement"),
        ((5,), "int 5 is no measurement; expected is a file"),
        ((np.arange(40.0),), "is no measurement; expected is"),
        ((np.arange(40.0), "x"), "position is str 'x', no numbers"),
        ((np.arange(40.0), 1j * np.arange(40.0)), "holds complex numbers; expected is one real"),
        ((pd.DataFrame({"t (s)": range(40), "x (m)": 40 * ["a"]}),), "x .m. holds objects; expec"),
        ((np.arange(40.0), np.arange(39.0)), "position has 39 samples and time has 40"),
        ((np.arange(40.0), np.zeros((40, 2))), r"position has shape \(40, 2\)"),
        (4 * (np.arange(40.0),), "tuple .* is no measurement; expected is a file"),
        ((pd.DataFrame({"a": np.arange(40.0), "b": np.arange(40.0)}),), "states no unit"),
    ],
)
def test_a_wrong_call_says_what_was_expected(arguments: tuple[Any, ...], words: str) -> None:
    with pytest.raises(ss.MeasurementError, match=words):
        ss.analyse(*arguments)
