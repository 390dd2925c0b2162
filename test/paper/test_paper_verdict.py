# SPDX-License-Identifier: Apache-2.0
"""Checks and the verdict that follows from them."""

from __future__ import annotations

import math

import pytest

from stickslip_ros.paper import Check, Kind, Verdict, verdict_of

TREND, NUMBER, OURS = Kind.TREND, Kind.NUMBER, Kind.OURS


def checks(*found: tuple[Kind, bool]) -> list[Check]:
    """Checks of these kinds, which hold or do not."""
    return [
        Check("x", 1.0 if holds else -1.0, low=0.0, high=2.0, kind=kind) for kind, holds in found
    ]


@pytest.mark.parametrize(
    ("found", "verdict"),
    [
        ([], Verdict.UNTOLD),
        ([(OURS, False), (OURS, True)], Verdict.UNTOLD),
        ([(NUMBER, True)], Verdict.AGREES),
        ([(TREND, True), (NUMBER, True), (OURS, False)], Verdict.AGREES),
        ([(TREND, True)], Verdict.IN_KIND),
        ([(TREND, True), (NUMBER, True), (NUMBER, False)], Verdict.IN_KIND),
        ([(NUMBER, True), (NUMBER, False)], Verdict.IN_KIND),
        ([(TREND, True), (NUMBER, False)], Verdict.DISAGREES),
        ([(NUMBER, False)], Verdict.DISAGREES),
        ([(TREND, True), (TREND, False), (NUMBER, True)], Verdict.DISAGREES),
    ],
)
def test_verdict(found: list[tuple[Kind, bool]], verdict: Verdict) -> None:
    assert verdict_of(checks(*found)) is verdict


@pytest.mark.parametrize(
    ("ours", "holds"), [(0.0, True), (2.0, True), (2.1, False), (-0.1, False), (math.nan, False)]
)
def test_bounds_are_included_and_nan_never_holds(ours: float, holds: bool) -> None:
    assert Check("x", ours, low=0.0, high=2.0).holds is holds


def test_bounds_as_text() -> None:
    assert Check("x", 1.0, low=0.5).bounds == "at least 0.5"
    assert Check("x", 1.0, high=127.85).bounds == "at most 127.85"
    assert Check("x", 1.0, low=127.75, high=127.85).bounds == "127.75 to 127.85"
    assert Check("x", 1.0, low=1.0, high=1.0).bounds == "1"
    assert Check("x", 1.0, low=0.5, kind=OURS).bounds == ""
