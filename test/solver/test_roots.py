# SPDX-License-Identifier: Apache-2.0
"""The root finder of the kernel against SciPy's."""

import math
from typing import Any

import pytest
from scipy.optimize import brentq

from stickslip_ros.compiled import compiled_anew
from stickslip_ros.solver.roots import bisection, newton


def _value_and_slope(t: float, args: tuple[float, float]) -> tuple[float, float]:
    a, sign = args
    return sign * (math.exp(a * t) - 3.0), sign * a * math.exp(a * t)


def _below(t: float, args: tuple[float, float]) -> bool:
    return math.exp(args[0] * t) < 3.0


_root = newton(compiled_anew(_value_and_slope))
_end = bisection(compiled_anew(_below))


def cases() -> list[Any]:
    """Return steep and flat functions, rising and falling."""
    return [(a, sign) for a in (0.3, 1.0, 3.0, 10.0) for sign in (1.0, -1.0)]


@pytest.mark.parametrize(("a", "sign"), cases())
def test_newton(a: float, sign: float) -> None:
    true = brentq(lambda t: _value_and_slope(t, (a, sign))[0], 0.0, 4.0, xtol=1e-15, rtol=1e-15)
    for guess in (0.01, 2.0, 3.99):
        found = _root((a, sign), (0.0, 4.0), sign > 0.0, guess, 0.0)
        assert found == pytest.approx(true, rel=1e-14)


@pytest.mark.parametrize("a", [0.3, 1.0, 3.0, 10.0])
def test_bisection(a: float) -> None:
    found = _end((a, 1.0), 0.0, 4.0)
    assert not _below(found, (a, 1.0))
    assert _below(math.nextafter(found, 0.0), (a, 1.0))


def test_bisection_without_an_end() -> None:
    assert _end((1e-3, 1.0), 0.0, 4.0) == 4.0


def test_a_wide_bracket_costs_no_digits() -> None:
    assert _end((10.0, 1.0), 0.0, 1e12) == pytest.approx(math.log(3.0) / 10.0, rel=1e-14)
