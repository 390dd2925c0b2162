# SPDX-License-Identifier: Apache-2.0
"""The findings of the paper, in the data that the report is made of."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray
from table_1 import table_1

from stickslip_ros.paper import ITEMS, Kind, Result, Verdict

BY_NAME = {item.name: item for item in ITEMS}
NANO = 1e-9


@cache
def result(name: str) -> Result:
    """The result of an item, computed once in this process."""
    return BY_NAME[name].compute()


def column(name: str, title: str, table: str = "") -> NDArray[np.float64]:
    return np.asarray(result(name).tables[table][title])


def ours(name: str, what: str) -> float:
    """Our number in the row that begins so."""
    (found,) = [row.ours for row in result(name).checks if row.what.startswith(what)]
    return found


def test_ceim_falls_linearly_with_preload_to_nothing() -> None:
    preload, step = column("fig14", "preload (N)"), column("fig14", "step CEIM (m)")
    assert step[preload <= 1.0].min() > 100 * NANO
    middle = (preload >= 0.5) & (preload <= 3.5)
    assert np.corrcoef(preload[middle], step[middle])[0, 1] ** 2 > 0.98
    assert abs(np.interp(5.0, preload, step)) < 6 * NANO
    assert result("fig14").verdict is Verdict.AGREES


def test_the_laws_before_never_reach_zero() -> None:
    preload = column("fig05", "preload (N)")
    assert preload[-1] == 10.0
    for title in ("step LuGre (m)", "step EPM_fix (m)", "step EPM_fix Eq. 7 to the letter (m)"):
        assert column("fig05", title).min() > 1 * NANO
    calculated = column("fig05", "step EPM_calc (m)")
    assert np.isnan(calculated[preload < 0.5]).all()
    assert np.isfinite(calculated[preload >= 0.5]).all()


def test_the_calculated_z_ss_goes_backwards_near_the_ringing_only() -> None:
    preload = column("fig05", "preload (N)")
    assert column("fig05", "step EPM_calc (m)")[preload >= 0.5].min() > 0.0
    assert np.nanmin(column("fig05", "step EPM_calc 2.5 kHz (m)")) < -1 * NANO


def test_lugre_steps_at_every_amplitude_and_the_others_do_not() -> None:
    deflection, lugre = column("fig03", "deflection (m)"), column("fig03", "step LuGre (m)")
    assert deflection[0] == pytest.approx(5 * NANO)
    assert lugre.min() > 0.0
    assert np.diff(lugre[deflection <= 80 * NANO], 2).min() > 0.0
    for title, z_ba in (("step CEIM 1 N (m)", 30), ("step EPM_fix (m)", 50)):
        step = column("fig03", title)
        assert np.abs(step[deflection <= 0.9 * z_ba * NANO]).max() < 0.05 * NANO
        assert step[-1] > 50 * NANO
    assert result("fig03").verdict is Verdict.IN_KIND


def test_a_larger_ratio_enlarges_the_zero_amplitude() -> None:
    late, half, early = column("fig04", "0-amplitude (m)", "_zero")
    assert late > 1.2 * half > 1.2 * early
    assert result("fig04").verdict is Verdict.IN_KIND


def test_negative_steps_come_with_the_ringing_not_with_the_ratio() -> None:
    assert column("fig04", "step at 5 % (m)").min() > -0.01 * NANO
    assert result("fig04c").verdict is Verdict.DISAGREES
    for title, lowest in (("step CEIM at 50 % (m)", -20), ("step CEIM at 90 % (m)", -40)):
        assert column("fig04c", title, "_ceim").min() < lowest * NANO


@pytest.mark.slow
def test_generated_force_over_preload() -> None:
    preload = column("fig15", "preload (N)")
    constant, linear, capped = (
        column("fig15", f"force {name} (N)") for name in ("constant", "linear", "capped")
    )
    at = preload[np.argmax(constant)]
    assert 1.2 <= at <= 2.4
    turns = np.flatnonzero(np.diff(np.sign(np.diff(constant))))
    assert len(turns) == 1
    assert 1.7 <= linear.max() / constant.max() <= 2.6
    assert preload[np.argmax(linear)] > at
    above = preload > 2.05
    assert (constant < capped)[above].all()
    assert (capped < linear)[above].all()
    assert np.array_equal(capped[preload < 1.95], linear[preload < 1.95])


def test_slewrate_moves_the_zero_amplitude_a_little_and_methods_differ() -> None:
    slewrate = column("fig07", "slewrate (V/us)")
    assert (slewrate[0], slewrate[-1]) == (50.0, 1000.0)
    direct = column("fig07", "0-amplitude direct forward (m)")
    assert (column("fig07", "0-amplitude intersection forward (m)") > direct).all()
    assert np.ptp(direct) < 0.5 * direct.mean()
    backward = column("fig07", "0-amplitude direct backward (m)")
    assert backward == pytest.approx(direct, rel=1e-3)


def test_points_of_the_response_are_in_order() -> None:
    assert ours("fig02", "points A to F") == 0
    assert ours("fig02", "swings") >= 3
    assert column("fig02", "time (s)")[-1] == pytest.approx(0.04)


def test_typical_drive() -> None:
    assert column("tab01", "step size (m)") == pytest.approx(130 * NANO, rel=0.1)
    force_fit, vibration_fit = column("tab01", "ringing frequency (Hz)")
    assert vibration_fit == pytest.approx(4e3, rel=0.01)
    assert force_fit > 1.5 * vibration_fit
    assert result("tab01").verdict is Verdict.IN_KIND


def test_ringing_gives_the_stiffness_back() -> None:
    given = column("fig10", "sigma_0 set (N/m)")
    assert column("fig10", "sigma_0 from ringing (N/m)") == pytest.approx(given, rel=0.005)


def test_the_actuator_is_two_decades_stiffer() -> None:
    rows = [row for row in result("fig11").checks if row.kind is Kind.NUMBER]
    assert [row.ours >= 100.0 for row in rows] == [True, True]


def test_every_digit_of_table_5() -> None:
    rows = [row for row in result("tab05").checks if row.kind is Kind.NUMBER]
    assert [round(row.ours, 1) for row in rows[:6]] == [74.3, 67.1, 74.3, 67.1, 155.1, 127.8]
    assert (round(rows[6].ours, 3), round(rows[7].ours, 1)) == (0.566, 2.8)
    assert result("tab05").verdict is Verdict.AGREES


def test_holds_lengthen_the_step_at_10_kilohertz() -> None:
    assert ours("elongation", "best step over") >= 1.4
    assert ours("elongation", "plain step") == pytest.approx(130, rel=0.1)


@pytest.mark.slow
def test_a_slip_in_two_parts_takes_the_ringing_out() -> None:
    for preload in ("0.4", "1"):
        assert ours("shaping", f"ringing, single slip over two parts, at {preload} N") >= 20
        single = ours("shaping", f"step, single slip, at {preload} N")
        assert 0.0 < ours("shaping", f"step, two parts, at {preload} N") < single
        assert np.nanmin(column("shaping", "ringing (m)", f"_{preload}N")) < 10 * NANO


def test_hysteresis_bends_the_run_and_leaves_the_step() -> None:
    assert ours("sec45", "first stick away") > 5 * ours("sec45", "the same, linear")
    assert column("sec45", "step size (m)") == pytest.approx(134 * NANO, rel=0.01)
    assert ours("sec45", "width of a loop") == pytest.approx(15.0, abs=1.0)
    assert ours("sec45", "largest error") < 1.0  # % of full scale
    assert result("sec45").verdict is Verdict.IN_KIND


def test_friction_of_the_ceim_does_not_know_velocity() -> None:
    for preload in ("0.4", "1", "2"):
        assert np.ptp(column("fig13", f"CEIM {preload} N F/f")) < 1e-6
    lugre = column("fig13", "LuGre F/f")
    assert (lugre[0], lugre[-1]) == (pytest.approx(0.3, rel=0.02), pytest.approx(0.2))


def test_what_the_text_gives_no_numbers_for_is_left_open() -> None:
    for name in ("fig06", "fig08", "fig09", "tab03"):
        assert result(name).verdict is Verdict.UNTOLD
        assert "no values" in result(name).remark
    assert (np.diff(column("fig06", "0-amplitude (m)")) > 0.0).all()
    assert (np.diff(column("fig09", "blocking preload (N)")) < 0.0).all()


@pytest.mark.parametrize("name", ["fig02b", "fig12", "eq09", "sec22", "tab02"])
def test_the_others_come_to_a_verdict(name: str) -> None:
    assert result(name).verdict is not Verdict.UNTOLD
    assert all(np.isfinite(row.ours) for row in result(name).checks)


@pytest.mark.parametrize("item", ITEMS, ids=lambda item: item.name)
def test_every_item_has_its_data_and_a_drawing_with_units(item: object) -> None:
    found = result(item.name)  # type: ignore[attr-defined]
    for table in found.tables.values():
        assert len({len(values) for values in table.values()}) == 1
    assert bool(found.draw) <= bool(found.tables)
    if found.draw:
        figure = Figure(figsize=found.size)
        found.draw(figure)
        labels = [text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel())]
        assert any("(" in text for text in labels)


def test_the_items_are_those_of_the_paper() -> None:
    names = [item.name for item in ITEMS]
    assert len(set(names)) == len(names)
    figures = {f"fig{number:02}" for number in (2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)}
    assert figures | {"tab01", "tab02", "tab03", "tab05", "elongation", "shaping"} <= set(names)


def test_defaults_are_the_typical_drive() -> None:
    # The items say "Table 1" where they change nothing.
    p = table_1()
    assert (p.runner.mass, p.friction.preload, p.drive.amplitude) == (4e-3, 0.4, 300.0)
    assert (p.drive.frequency, p.drive.slewrate) == (100.0, 100.0)
