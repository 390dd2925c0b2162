# SPDX-License-Identifier: Apache-2.0
"""The root finder of the kernel: bisection, and Newton's method in a bracket.

Each root finder is made for one function, because compiled code with functions as arguments cannot
be cached. Only `oscillator.passes` uses another method: Halley's, which needs a step less there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from stickslip_ros.compiled import compiled, compiled_anew, compiled_inline

#: Bisections, more than a double has digits: the bracket may begin at 0
_HALVINGS = 200
#: Steps of Newton's method; most roots take five
STEPS = 100
#: Share of the bracket at which Newton's method stops: rounding of the times in it
CLOSE = 1e-14
#: Shares of the bracket between which a first guess lies: at an end the slope may be 0
_INNERMOST, _OUTERMOST = 0.05, 0.95


@compiled
def within(share: float) -> float:
    """Return a share of a bracket for a first guess, from one that may be near an end."""
    return min(_OUTERMOST, max(_INNERMOST, share))


def bisection(holds: Callable[[float, Any], bool]) -> Callable[[Any, float, float], float]:
    """Return the compiled function (args, left, right) that finds where a condition ends.

    holds(t, args) is True from left on and becomes False at some t, at right at the latest. The
    result is the first t at which it is False, or right.
    """

    def end(args: Any, left: float, right: float) -> float:
        for _ in range(_HALVINGS):
            middle = 0.5 * (left + right)
            if not left < middle < right:
                break
            if holds(middle, args):
                left = middle
            else:
                right = middle
        return right

    return compiled_anew(end)


def newton(
    value_and_slope: Callable[[float, Any], tuple[float, float]],
) -> Callable[[Any, tuple[float, float], bool, float, float], float]:
    """Return the compiled function (args, bracket, rising, t, close) that finds a root.

    value_and_slope(t, args) gives the function and its derivative; rising says whether it passes
    from below 0 to above within the bracket; t is the first guess. A step that would leave the
    bracket is replaced by a bisection; one shorter than close is the last.
    """

    def root(
        args: Any, bracket: tuple[float, float], rising: bool, t: float, close: float
    ) -> float:
        left, right = bracket
        for _ in range(STEPS):
            value, slope = value_and_slope(t, args)
            if value == 0.0:
                return t
            if (value > 0.0) == rising:
                right = t
            else:
                left = t
            step = value / slope if slope != 0.0 else math.inf
            if not left < t - step < right:
                step = t - 0.5 * (left + right)
            t -= step
            if abs(step) <= close or not left < t < right:
                return t
        return t

    return compiled_inline(root)
