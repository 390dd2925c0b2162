# SPDX-License-Identifier: Apache-2.0
"""What the paper claims, in the data that the report is made of; the whole is journey 6."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from stickslip_ros.paper import CLAIMS, Check, Result
from stickslip_ros.paper.parameter_sets import EPM_CALC, EPM_FIX, JOINT, JOINT_SENSOR, Set, columns
from stickslip_ros.paper.parameter_sets import steps as steps_over
from stickslip_ros.parameters import Parameters, read_yaml
from validation.whole_system import positions

BY_NAME = {claim.name: claim for claim in CLAIMS}
CONFIG = Path(__file__).resolve().parent.parent.parent / "config"
NANO = 1e-9


@cache
def result(name: str) -> Result:
    """The result of a claim, computed once in this process."""
    return BY_NAME[name].compute()


def column(name: str, title: str, table: str = "") -> NDArray[np.float64]:
    return np.asarray(result(name).tables[table][title])


def check(name: str, what: str) -> Check:
    """The check that begins so."""
    (found,) = [row for row in result(name).checks if row.what.startswith(what)]
    return found


def test_the_claims_are_those_of_the_paper() -> None:
    names = [claim.name for claim in CLAIMS]
    assert len(set(names)) == len(names)
    figures = {f"fig{number:02}" for number in (2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)}
    others = {"tab01", "tab02", "tab03", "tab05", "elongation", "shaping", "sec22", "sec45", "eq09"}
    added = {"fig02b", "fig04c", "sec3", "sec43", "sec52", "sec53", "joint"}
    assert set(names) == figures | others | added


@pytest.mark.long
@pytest.mark.parametrize(
    ("base", "printed"),
    [
        ({**EPM_FIX, "preload": 0.1}, 91e-9),
        ({**EPM_FIX, "preload": 1.0}, 33e-9),
        ({**EPM_CALC, "preload": 1.0}, 3.77e-9),
        ({**EPM_CALC, "preload": 1.5}, -10.7e-9),
        (JOINT, 136.5e-9),
    ],
    ids=["fix 0.1 N", "fix 1 N", "calc 1 N", "calc 1.5 N", "joint set"],
)
def test_steps_are_those_of_an_integrator_that_shares_no_code(base: Set, printed: float) -> None:
    """At 1 kHz, where ten cycles are soon integrated, and at 100 Hz in the known numbers."""
    fast = {**base, "frequency": 1e3}
    p = Parameters.of(fast)
    (step,) = steps_over(fast, 10, preload=np.array([p.friction.preload]))
    found = float(np.mean(np.diff(positions(p, 10))[-3:]))
    assert found == pytest.approx(step, abs=0.02 * NANO)
    (slow,) = steps_over(base, preload=np.array([p.friction.preload]))
    assert slow == pytest.approx(printed, abs=0.5 * NANO)


def test_the_joint_set_is_shipped() -> None:
    shipped = read_yaml(CONFIG / "paper_joint_set.yaml")
    fit = {name: shipped.flat()[name] for name in ("sigma_0_slope", "sigma_0_offset")}
    assert shipped == columns({**JOINT, **fit, "sigma_0": None})
    comment = (CONFIG / "paper_joint_set.yaml").read_text(encoding="utf-8")
    assert "ridge" in comment
    assert f"{1e-5 * JOINT_SENSOR:.1f}e5 N/m" in comment


@pytest.mark.long
def test_negative_steps_come_with_alpha_as_printed_and_with_the_ringing() -> None:
    assert column("fig04c", "step at 5 %, alpha as printed (m)", "_100Hz").min() < -0.1 * NANO
    assert column("fig04c", "step at 5 %, |z| (m)", "_100Hz").min() > -0.01 * NANO
    for title, lowest in (("step CEIM at 50 % (m)", -20), ("step CEIM at 90 % (m)", -40)):
        assert column("fig04c", title, "_ceim").min() < lowest * NANO


@pytest.mark.long
@pytest.mark.parametrize("table", ["", "_joint"])
def test_a_bound_of_the_stiffness_acts_above_it_alone(table: str) -> None:
    preload = column("fig15", "preload (N)", table)
    linear, capped = (column("fig15", f"force {name} (N)", table) for name in ("linear", "capped"))
    assert np.array_equal(capped[preload < 1.95], linear[preload < 1.95])


def test_slewrate_moves_the_zero_amplitude_a_little_and_methods_differ() -> None:
    slewrate = column("fig07", "slewrate (V/us)")
    assert (slewrate[0], slewrate[-1]) == (pytest.approx(50.0), pytest.approx(1000.0))
    direct = column("fig07", "0-amplitude direct forward (m)")
    assert (column("fig07", "0-amplitude intersection forward (m)") > direct).all()
    assert np.ptp(direct) < 0.5 * direct.mean()
    backward = column("fig07", "0-amplitude direct backward (m)")
    assert backward == pytest.approx(direct, rel=1e-3)
    assert check("fig07", "what it would take").value == pytest.approx(2.9, abs=0.1)
    assert check("fig07", "depth of the minimum with").value == pytest.approx(1 * NANO, rel=0.2)


def test_a_fresh_actuator_rises_further_the_first_time() -> None:
    assert check("fig02b", "first rise").value == pytest.approx(184 * NANO, rel=1e-3)
    assert check("fig02b", "second rise of the actuator short").value == pytest.approx(24e-9, 1e-3)
    x, t = column("fig02b", "runner (m)"), column("fig02b", "time (s)")
    assert np.interp(0.00999, t, x) == pytest.approx(184 * NANO, abs=2 * NANO)


@pytest.mark.long
def test_a_slip_in_two_parts_takes_the_ringing_out() -> None:
    for preload in ("0.4", "1"):
        single = check("shaping", f"step, single slip, at {preload} N").value
        assert 0.0 < check("shaping", f"step, two parts, at {preload} N").value < single
        assert np.nanmin(column("shaping", "ringing (m)", f"_{preload}N")) < 10 * NANO


def test_hysteresis_bends_the_run_and_leaves_the_step() -> None:
    assert column("sec45", "step size (m)") == pytest.approx(134 * NANO, rel=0.01)
    assert check("sec45", "width of a loop").value == pytest.approx(15.0, abs=1.0)
    assert check("sec45", "largest error").value < 1.0  # % of full scale


def test_lugre_drifts_in_vibration_in_proportion_to_it() -> None:
    vibration, drift = (column("sec3", t) for t in ("vibration (m)", "drift in a cycle, LuGre (m)"))
    assert drift / vibration == pytest.approx(drift[0] / vibration[0], rel=0.05)


def test_table_1_and_2_are_what_the_claims_say() -> None:
    p = columns({})  # the claims say "Table 1" where they change nothing
    assert (p.runner.mass, p.friction.preload, p.drive.amplitude) == (4e-3, 0.4, 300.0)
    assert (p.drive.frequency, p.drive.slewrate) == (100.0, 100.0)
