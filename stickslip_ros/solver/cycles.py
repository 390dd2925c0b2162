# SPDX-License-Identifier: Apache-2.0
"""What a cycle leaves behind when it ends, and the next ones taken from it unsolved."""

from __future__ import annotations

from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.solver import state as st

#: Share of the tolerance by which two cycles that count as the same may begin apart
_REPEATED = 1e-3


@compiled
def end_cycle(
    s: NDArray, n: NDArray, plant: NDArray, done: int, x: float, v: float, z: float
) -> None:
    """Let the running cycle, which is number done, end at x, z (m), v (m/s), and the next begin."""
    s[st.X], s[st.V], s[st.Z] = x, v, z
    s[st.LEVEL] += s[st.SHIFT]
    n[st.STEADY] = n[st.REPLAY] and done > 1 and _repeats(s, plant)
    s[st.LAST_STEP], s[st.LAST_LOST] = x - s[st.CYCLE_X], s[st.LOST]
    s[st.LAST_Z_MAX], s[st.LAST_Z_MIN] = s[st.Z_MAX], s[st.Z_MIN]
    s[st.CYCLE_X], s[st.CYCLE_V], s[st.CYCLE_Z] = x, v, z
    s[st.Z_MAX] = s[st.Z_MIN] = z
    s[st.LAST_X_MIN], s[st.LAST_X_MAX] = s[st.X_MIN], s[st.X_MAX]
    s[st.X_MIN] = s[st.X_MAX] = x
    s[st.LOST] = 0.0


@compiled
def _repeats(s: NDArray, plant: NDArray) -> bool:
    """True if the cycle that has just ended left all as it began, one step further on."""
    close = _REPEATED * plant[st.TOLERANCE]
    step = s[st.X] - s[st.CYCLE_X]
    return (
        abs(s[st.Z] - s[st.CYCLE_Z]) <= close
        and abs(s[st.V] - s[st.CYCLE_V]) * plant[st.MEMORY] <= close
        and abs(step - s[st.LAST_STEP]) <= close
        and (plant[st.SPRING] == 0.0 or abs(step) <= close)
    )


@compiled
def keeps_away(s: NDArray) -> bool:
    """True if the next cycle gets to no stop when it repeats the last one."""
    step = s[st.LAST_STEP]
    return s[st.LAST_X_MIN] + step >= s[st.NEAR_LOW] and s[st.LAST_X_MAX] + step <= s[st.NEAR_HIGH]


@compiled
def repeat(s: NDArray, n: NDArray, rows: NDArray) -> None:
    """End one more cycle just as the last one ended, one step further on."""
    step = s[st.LAST_STEP]
    s[st.CYCLE_X] = s[st.X] + step
    s[st.X] = s[st.CYCLE_X]
    s[st.SEG_X] = s[st.X]
    s[st.X_MIN] = s[st.X_MAX] = s[st.X]
    s[st.LAST_X_MIN] += step
    s[st.LAST_X_MAX] += step
    s[st.X_TOP] += n[st.SIGN] * step
    s[st.X_LOW] += n[st.SIGN] * step
    n[st.DONE] += 1
    if len(rows):
        write_row(s, rows[0])


@compiled
def write_row(s: NDArray, row: NDArray) -> None:
    row[st.ROW_X] = s[st.X]
    row[st.ROW_BACKSTEP] = s[st.BACKSTEP]
    row[st.ROW_Z_MAX], row[st.ROW_Z_MIN] = s[st.LAST_Z_MAX], s[st.LAST_Z_MIN]
    row[st.ROW_LOST] = s[st.LAST_LOST]
