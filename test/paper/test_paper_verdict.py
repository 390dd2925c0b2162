# SPDX-License-Identifier: Apache-2.0
"""Checks and the verdict that follows from them."""

from __future__ import annotations

import math

import pytest

from stickslip_ros.paper import Basis, Check, Result, Verdict
from stickslip_ros.paper.claim import Bounds, extra, number, trend

NEAR_ONE = Bounds(0.5, 1.5, "nearer to 1 than to 0 or 2")

TREND, NUMBER, NOTHING = Basis.TREND, Basis.NUMBER, Basis.NOTHING


def checks(*found: tuple[Basis, bool]) -> list[Check]:
    """Checks of these kinds, which hold or do not."""
    return [
        Check("x", 1.0 if holds else -1.0, low=0.0, high=2.0, basis=basis) for basis, holds in found
    ]


@pytest.mark.parametrize(
    ("found", "verdict"),
    [
        ([(NUMBER, True)], Verdict.AGREES),
        ([(TREND, True), (NUMBER, True), (NOTHING, False)], Verdict.AGREES),
        ([(TREND, True)], Verdict.IN_KIND),
        ([(TREND, True), (NUMBER, True), (NUMBER, False)], Verdict.IN_KIND),
        ([(NUMBER, True), (NUMBER, False)], Verdict.IN_KIND),
        ([(TREND, True), (NUMBER, False)], Verdict.DISAGREES),
        ([(NUMBER, False)], Verdict.DISAGREES),
        ([(TREND, True), (TREND, False), (NUMBER, True)], Verdict.DISAGREES),
    ],
)
def test_verdict(found: list[tuple[Basis, bool]], verdict: Verdict) -> None:
    assert Verdict.of(checks(*found)) is verdict


def test_the_joint_set_has_a_verdict_of_its_own() -> None:
    both = Result([number("x", 3.0, "N", 2.0, joint=2.1), trend("y", 1.0, "", "one", NEAR_ONE)])
    assert (both.verdict, both.joint_verdict) == (Verdict.DISAGREES, Verdict.AGREES)
    assert Result([trend("y", 1.0, "", "one", NEAR_ONE)]).joint_verdict is None


def test_a_settled_verdict_cannot_hide_a_check() -> None:
    """What can be judged is judged, and what cannot says why."""
    with pytest.raises(ValueError, match="either checks to judge"):
        Result([trend("y", 3.0, "", "one", NEAR_ONE)], settled=Verdict.DATA)
    with pytest.raises(ValueError, match="either checks to judge"):
        Result([extra("y", 1.0)])


@pytest.mark.parametrize(
    ("value", "holds"), [(0.0, True), (2.0, True), (2.1, False), (-0.1, False), (math.nan, False)]
)
def test_bounds_are_included_and_nan_never_holds(value: float, holds: bool) -> None:
    assert Check("x", value, low=0.0, high=2.0).holds is holds


def test_bounds_as_text() -> None:
    assert trend("x", 1.0, "", "one", NEAR_ONE).bounds == "0.5 to 1.5"
    assert trend("x", 1e-9, "m", "", Bounds(-1e-9, -1e-10, "")).bounds == "−1 to −0.1 nm"
    assert number("x", 128e-9, "m", 130e-9).bounds == "117 to 143 nm"
    assert number("x", 1.0, "", 1.0, within=0.0).bounds == "1"
    assert extra("x", 1.0).bounds == ""
    assert number("x", 2.527e6, "N/m", 2.5e6).text == "2.527 N/µm"
