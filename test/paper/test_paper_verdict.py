# SPDX-License-Identifier: Apache-2.0
"""Checks and the verdict that follows from them."""

import math

import pytest

from stickslip_ros.paper import Basis, Check, Result, Verdict

TREND, NUMBER, NOTHING = Basis.TREND, Basis.NUMBER, Basis.NOTHING


def checks(*found: tuple[Basis, bool]) -> list[Check]:
    """Checks of these kinds, which hold or do not."""
    return [
        Check("x", 1.0 if holds else -1.0, low=0.0, high=2.0, basis=basis) for basis, holds in found
    ]


def test_verdict() -> None:
    for found, verdict in [
        ([(NUMBER, True)], Verdict.AGREES),
        ([(TREND, True), (NUMBER, True), (NOTHING, False)], Verdict.AGREES),
        ([(TREND, True)], Verdict.IN_KIND),
        ([(TREND, True), (NUMBER, True), (NUMBER, False)], Verdict.IN_KIND),
        ([(NUMBER, True), (NUMBER, False)], Verdict.IN_KIND),
        ([(TREND, True), (NUMBER, False)], Verdict.DISAGREES),
        ([(NUMBER, False)], Verdict.DISAGREES),
        ([(TREND, True), (TREND, False), (NUMBER, True)], Verdict.DISAGREES),
    ]:
        assert Verdict.of(checks(*found)) is verdict


X, Y = Check("x", low=1.8, high=2.2, basis=NUMBER), Check("y", low=0.5, high=1.5)


def test_the_joint_set_has_a_verdict_of_its_own() -> None:
    both = Result({"x": (3.0, 2.1), "y": 1.0}).judged([X, Y])
    assert (both.verdict, both.joint_verdict) == (Verdict.DISAGREES, Verdict.AGREES)
    assert Result({"y": 1.0}).judged([Y]).joint_verdict is None


def test_a_settled_verdict_cannot_hide_a_check() -> None:
    """What can be judged is judged, and what cannot says why."""
    for found, check in ((Result({"y": 3.0}, settled=Verdict.DATA), Y),
                         (Result({"y": 1.0}), Check("y", basis=NOTHING))):  # fmt: skip
        with pytest.raises(ValueError, match="either checks to judge"):
            found.judged([check])


@pytest.mark.parametrize("checks", [[X], [X, Y, Check("z")]])
def test_each_value_has_one_check(checks: list[Check]) -> None:
    with pytest.raises(ValueError, match=r"no checks, or no values, of: [yz]"):
        Result({"x": 1.0, "y": 2.0}).judged(checks)


@pytest.mark.parametrize(
    ("value", "holds"), [(0.0, True), (2.0, True), (2.1, False), (-0.1, False), (math.nan, False)]
)
def test_bounds_are_included_and_nan_never_holds(value: float, holds: bool) -> None:
    assert Check("x", value, low=0.0, high=2.0).holds is holds


def test_bounds_as_text() -> None:
    assert Y.bounds == "0.5 to 1.5"
    assert Check("x", unit="m", low=-1e-9, high=-1e-10).bounds == "−1 to −0.1 nm"
    assert Check("x", low=1.0, high=1.0).bounds == "1"
    assert Check("x", basis=NOTHING, low=1.0, high=1.0).bounds == ""
    assert Check("x", 2.527e6, "N/m").text == "2.527 N/µm"
