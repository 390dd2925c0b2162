# SPDX-License-Identifier: Apache-2.0
"""Steps from rest in complex numbers, whose imaginary parts become derivatives.

The equations of all laws but those with a rate of their own, integrated by explicit steps of order
8 that end at every kink and event. One input is moved by a tiny step along the imaginary axis, and
the imaginary part of a result over that step is its derivative, without a difference (W. Squire, G.
Trapp, SIAM Rev. 40 (1998) 110). Kinks of the waveform lie at complex times; what is decided is
decided by real parts, and |w| is w times its sign.

At events of the contact nothing has to be corrected: alpha rises from 0 and reaches 1 without a
slope, and the branch changes at w = 0, where |w| = 0, so that all rates are continuous there and
the saltation matrix is the identity. Steps end at events, for each branch is smooth by itself.

A state is x, v, u, then the z and the age of each contact.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.arrays import Array
from stickslip_ros.compiled import compiled
from stickslip_ros.laws.law import ALWAYS_PLASTIC, ELASTOPLASTIC_CALC
from stickslip_ros.model.friction import alpha_at, z_limit
from stickslip_ros.solver.dop853 import ERRORS, STEP, THIRD, A
from stickslip_ros.solver.layout import GRADED, PLASTIC, STICKS

#: The numbers of a runner, before those of its contacts: kg, N, N/m; the constants of ageing, 0, m,
#: s; time over which ringing is measured, s
RUNNER_NUMBERS = ("mass", "force", "spring", "beta", "d_c", "theta_0", "window")
#: The numbers of a contact, see `Contact`
CONTACT_NUMBERS = ("sigma_0", "sigma_1", "sigma_2", "z_ba", "z_ss", "z_k", "z_s", "v_s")
_MASS, _FORCE, _SPRING, _BETA, _D_C, _THETA_0, _WINDOW = range(len(RUNNER_NUMBERS))
_SIGMA_0, _SIGMA_1, _SIGMA_2, _Z_BA, _Z_SS, _Z_K, _Z_S, _V_S = range(len(CONTACT_NUMBERS))
#: Error of a step, as a fraction of what the contact can deflect, and of that times the ringing
_TOLERANCE = 1e-14
#: Imaginary part below which nothing counts
_LEAST = 1e-60
#: Steps in a segment of the drive cycle, at most
_MOST = 1_000_000
#: Trials for the time of an event: a third of them halve, which is enough for the last bit
_TRIALS = 100
#: First step, in units of the ringing; its length soon adapts to the allowed error
_FIRST = 0.1
#: Least factor from one step to the next
_SHORTER = 0.2
#: Largest factor from one step to the next
_LONGER = 4.0
#: Step taken, as a fraction of the one whose error would be just allowed: so the next try succeeds
_SAFE = 0.9
#: A swing goes on by twice the way to the place where nothing accelerates
_AWAY = 2.0
#: Fraction of a bracket that a guess of an event's time keeps from its ends
_INNER = 1e-3
#: Fraction of the time at which the bracket ends: rounding
_CLOSE = 1e-15
#: What ends a step: w = 0, v = 0, then two borders of each contact; in a log also a kink
TURN, STOP, BORDER, KINK = 0, 1, 2, -1
#: Numbers of a run: signs of w and of v; whether w = 0 ends a step (1, or 2 while ringing is
#: watched) and v = 0, until the backstep is over; the next step to try, s
_W_SIDE, _V_SIDE, _WATCH_W, _WATCH_V, _TRIAL = range(5)
#: Where the backstep began and how far it went; what is left of the window, s; largest and smallest
#: x - u in it: m
_TOP, _LOWEST, _LEFT, _HIGH, _LOW = range(5)


class _Run(NamedTuple):
    """What the rates follow from, and what a run remembers."""

    m: NDArray[np.complex128]  #: of the runner
    contacts: NDArray[np.complex128]  #: (contacts, numbers)
    kind: int  #: of alpha, see `Contact`
    branches: NDArray[np.int64]  #: of each contact
    quick: float  #: ringing while all contacts only bend, 1/s
    sides: Array
    #: what errors of the state are weighed by: its deflections, and its derivatives up to now
    scale: Array
    marks: NDArray[np.complex128]
    work: NDArray[np.complex128]  #: rates at the stages of a step, and its end
    borders: Array  #: at the end of a step and at its start


@compiled
def _edges(y: NDArray, i: int, w: complex, run: _Run) -> tuple[complex, complex, complex]:
    """Return the |z| (m) between which alpha rises at contact i, and the limit of z (m)."""
    c, m, age = run.contacts[i], run.m, 1.0 + 0.0j
    if m[_BETA] != 0.0:
        age += m[_BETA] * np.log(1.0 + y[3 + len(run.contacts) + i] / m[_THETA_0])
    limit = z_limit(w, c[_Z_K], c[_Z_S], c[_V_S])
    high = limit if run.kind == ELASTOPLASTIC_CALC else c[_Z_SS]
    return age * c[_Z_BA], age * high, age * limit


@compiled
def _rates(y: NDArray, rate: complex, run: _Run, dy: NDArray) -> None:
    """Write the derivatives of the state by time, at u' = rate (m/s)."""
    m, contacts, side = run.m, run.contacts, run.sides[_W_SIDE]
    w, count, force = y[1] - rate, len(contacts), 0.0j
    for i in range(count):
        c, z, dz = contacts[i], y[3 + i], w
        if run.branches[i] != STICKS:
            low, high, limit = _edges(y, i, w, run)
            share = 1.0 + 0.0j
            if run.branches[i] == GRADED:
                share = alpha_at(math.pi * (side * z - low) / (high - low))[0]
            dz -= share * side * w / limit * z
        force += c[_SIGMA_0] * z + c[_SIGMA_1] * dz + c[_SIGMA_2] * w
        dy[3 + i], dy[3 + count + i] = dz, 0.0j
        if m[_BETA] != 0.0:
            dy[3 + count + i] = 1.0 - side * w * y[3 + count + i] / m[_D_C]
    dy[0], dy[1], dy[2] = y[1], (m[_FORCE] - m[_SPRING] * y[0] - force) / m[_MASS], rate


@compiled
def _find_borders(y: NDArray, rate: complex, run: _Run, found: NDArray) -> None:
    """Write what is above 0 as long as no step has to end: of w, of v, two of each contact."""
    sides, w = run.sides, y[1] - rate
    watched = sides[_WATCH_W] != 0.0
    found[:] = math.inf
    if watched:
        found[TURN] = sides[_W_SIDE] * w.real
    if sides[_WATCH_V] != 0.0 and not (rate.real == 0.0 and watched):  # else w is v
        found[STOP] = sides[_V_SIDE] * y[1].real
    for i in range(len(run.contacts) if run.kind != ALWAYS_PLASTIC else 0):
        low, high, _ = _edges(y, i, w, run)
        q = sides[_W_SIDE] * y[3 + i].real if watched else abs(y[3 + i].real)
        at = BORDER + 2 * i
        if run.branches[i] == STICKS:
            found[at] = low.real - q
        elif run.branches[i] == GRADED:
            found[at], found[at + 1] = q - low.real, high.real - q
        else:
            found[at] = q - high.real


@compiled
def _turn(y: NDArray, rate: complex, run: _Run, side: float) -> None:
    """Let w have a sign from now on, and find the branch of each contact."""
    run.sides[_W_SIDE] = side
    for i in range(len(run.contacts)):
        run.branches[i] = PLASTIC
        if run.kind != ALWAYS_PLASTIC:
            low, high, _ = _edges(y, i, y[1] - rate, run)
            q = side * y[3 + i].real
            if q < high.real:
                run.branches[i] = GRADED if q > low.real else STICKS


@compiled
def _try_step(y: NDArray, h: complex, rate: complex, run: _Run) -> float:
    """Make a step of h (s), whose end is work[STEP]; return its error over the tolerance."""
    size, work, tried, scale = len(y), run.work, run.work[STEP], run.scale
    for k in range(STEP + 1):
        tried[:] = y
        for i in range(k):
            if A[k, i] != 0.0:
                part = A[k, i] * h
                for j in range(size):
                    tried[j] += part * work[i, j]
        if k < STEP:
            _rates(tried, rate, run, work[k])
    high = low = 0.0
    for j in range(size):
        fifth = third = 0.0j
        for i in range(STEP):
            fifth += ERRORS[0, i] * work[i, j]
            third += ERRORS[1, i] * work[i, j]
        within = scale[0, j] + abs(y[j].real)
        moved = max(scale[1, j], abs(tried[j].imag), _LEAST)
        high += (fifth.real / within) ** 2 + (fifth.imag / moved) ** 2
        low += (third.real / within) ** 2 + (third.imag / moved) ** 2
    if high == 0.0:
        return 0.0
    return abs(h) * high / math.sqrt((high + THIRD * low) * size) / _TOLERANCE


@compiled
def _watch_turns(y: NDArray, rate: complex, run: _Run) -> None:
    """Let steps end where w turns, unless all contacts only bend until then and beyond.

    A step over such a turn could leave out that a contact yields there.
    """
    sides, watched = run.sides, run.kind == ALWAYS_PLASTIC or run.m[_BETA] != 0.0
    _rates(y, rate, run, run.work[0])
    w, swing = y[1] - rate, abs((y[1] - rate).real) / run.quick
    swing += _AWAY * abs(run.work[0, 1].real) / run.quick**2
    for i in range(len(run.contacts)):
        low, _, _ = _edges(y, i, w, run)
        watched |= run.branches[i] != STICKS or abs(y[3 + i].real) + swing > low.real
    if watched and sides[_WATCH_W] == 0.0 and sides[_W_SIDE] * w.real < 0.0:
        _turn(y, rate, run, -sides[_W_SIDE])  # it turned while nobody watched
    sides[_WATCH_W] = 1.0 if watched else 0.0


@compiled
def _advance(y: NDArray, rest: complex, rate: complex, run: _Run) -> tuple[complex, int]:
    """Advance by a step, at most rest (s); return its length and which border ends it, or -1."""
    sides, (after, before) = run.sides, (run.borders[0], run.borders[1])
    if sides[_WATCH_W] != 2.0:
        _watch_turns(y, rate, run)
    while True:
        h = rest if sides[_TRIAL] >= rest.real else sides[_TRIAL] + 0.0j
        error = _try_step(y, h, rate, run)
        if error <= 1.0:
            if h != rest or error > 0.5:
                sides[_TRIAL] = h.real * min(_LONGER, _SAFE * max(error, 1e-8) ** -0.125)
            break
        factor = max(_SHORTER, _SAFE * error**-0.125) if error < math.inf else _FIRST
        sides[_TRIAL] = h.real * factor
    _find_borders(y, rate, run, before)
    _find_borders(run.work[STEP], rate, run, after)
    event = -1
    for k in range(len(before)):
        if after[k] < 0.0:
            event = k
            h = _time_of_event(y, k, h.real, rate, run)
    for j in range(len(y)):
        y[j] = run.work[STEP, j]
        run.scale[1, j] = max(run.scale[1, j], abs(y[j].imag))
    return h, event


@compiled
def _time_of_event(y: NDArray, k: int, right: float, rate: complex, run: _Run) -> complex:
    """Make the step that ends where border k falls to 0; return its length (s), at most right."""
    after, left, f_left = run.borders[0], 0.0, max(run.borders[1, k], 0.0)
    f_right, h = after[k], right
    for trial in range(_TRIALS):
        share = 0.5
        if trial % 3 != 2:  # by the chord, but for each third time
            share = min(max(f_left / (f_left - f_right), _INNER), 1.0 - _INNER)
        h = left + share * (right - left)
        _try_step(y, h + 0.0j, rate, run)
        _find_borders(run.work[STEP], rate, run, after)
        if after[k] < 0.0:
            right, f_right = h, after[k]
        else:
            left, f_left = h, after[k]
        if right - left <= _CLOSE * right:
            break
    return h + 0.0j


@compiled
def _cross(y: NDArray, event: int, rate: complex, run: _Run) -> int:
    """Go on beyond the border that ended a step; return the branch of its contact before."""
    sides = run.sides
    if event == TURN:
        _turn(y, rate, run, -sides[_W_SIDE])
        if rate.real == 0.0:
            sides[_V_SIDE] = sides[_W_SIDE]
    elif event == STOP:
        sides[_V_SIDE] = -sides[_V_SIDE]
    else:
        i = (event - BORDER) // 2
        before = run.branches[i]
        if before == STICKS and sides[_WATCH_W] == 0.0:
            sides[_W_SIDE] = 1.0 if y[3 + i].real > 0.0 else -1.0
        run.branches[i] += 1 if before == STICKS or (event - BORDER) % 2 == 1 else -1
        return before
    return 0


@compiled
def _log(log: NDArray, cycle: int, event: int, branch: int) -> None:
    """Add an event of a cycle to the log (room + 1, 3), whose first row counts them."""
    if log[0, 0] < len(log) - 1:
        log[0, 0] += 1
        log[log[0, 0], 0], log[log[0, 0], 1], log[log[0, 0], 2] = cycle, event, branch


@compiled
def _prepare(inputs: NDArray, segments: int, kind: int) -> _Run:
    """Return a run from rest."""
    m = inputs[: len(RUNNER_NUMBERS)]
    contacts = inputs[len(RUNNER_NUMBERS) : len(inputs) - 2 * segments].copy()
    contacts = contacts.reshape(-1, len(CONTACT_NUMBERS))
    count, deflects, stiffness = len(contacts), math.inf, 0.0
    for c in contacts:
        deflects, stiffness = min(deflects, c[_Z_K].real), stiffness + c[_SIGMA_0].real
    quick, size = math.sqrt(stiffness / m[_MASS].real), 3 + 2 * count
    scale, sides = np.zeros((2, size)), np.zeros(5)
    scale[0] = deflects
    scale[0, 1] *= quick
    scale[0, 3 + count :] = m[_THETA_0].real
    sides[_W_SIDE] = sides[_V_SIDE] = 1.0
    sides[_TRIAL] = _FIRST / quick
    work, borders = np.empty((STEP + 1, size), np.complex128), np.empty((2, BORDER + 2 * count))
    branches, marks = np.zeros(count, np.int64), np.zeros(5, np.complex128)
    return _Run(m, contacts, kind, branches, quick, sides, scale, marks, work, borders)


@compiled
def complex_steps(
    inputs: NDArray,
    segments: int,
    kind: int,
    slip: tuple[int, int, int],
    results: NDArray,
    log: NDArray,
) -> bool:
    """Run steps from rest, as many as results (3, steps) has room for; False if that takes ages.

    inputs are RUNNER_NUMBERS, CONTACT_NUMBERS for each contact, and of the segments of a drive
    cycle the durations (s) and the strokes (m). kind is that of alpha. slip: its first segment, the
    one after its last, and the direction of the step. results are position, backstep and ringing
    (m) of each step. log (room + 1, 3) takes how many events follow, then cycle, event and branch
    before it, of each; of a kink the segment that begins.
    """
    durations, strokes = inputs[len(inputs) - 2 * segments : -segments], inputs[-segments:]
    run, cycles, (first, end, sign) = _prepare(inputs, segments, kind), results.shape[1], slip
    y, sides, marks = np.zeros(len(run.scale[0]), np.complex128), run.sides, run.marks
    results[:] = complex(math.nan, math.nan)
    log[0, 0] = 0
    dwell = np.sum(durations) - np.sum(durations[first:end])
    window = run.m[_WINDOW] if run.m[_WINDOW].real <= dwell.real else dwell
    for number in range((cycles + 1) * segments):
        cycle, k = number // segments, number % segments
        rate = strokes[k] / durations[k]
        if k == first:
            if sides[_WATCH_W] == 2.0:  # the window is as long as the dwell, but for rounding
                results[2, cycle - 1], sides[_WATCH_W] = marks[_HIGH] - marks[_LOW], 0.0
            if sides[_WATCH_V] != 0.0:  # it never turned back
                results[1, cycle - 1] = marks[_TOP] - marks[_LOWEST]
            if cycle == cycles:
                break
            sides[_V_SIDE], sides[_WATCH_V] = (1.0 if y[1].real > 0.0 else -1.0), 1.0
            marks[_TOP] = marks[_LOWEST] = sign * y[0]
        if k == end % segments and (cycle > 0 or end < segments) and run.m[_WINDOW] != 0.0:
            marks[_LEFT], sides[_WATCH_W] = window, 2.0
            marks[_HIGH] = marks[_LOW] = y[0] - y[2]
        _log(log, cycle, KINK, k)
        began = cycle if k >= end else cycle - 1  # the cycle whose slip is the last
        after = sign if k < first or k >= end else 0
        if not _run_segment(
            y, (durations[k], rate), run, (cycle, began, after, sign), results, log
        ):
            return False
        if k == segments - 1 and cycle < cycles:
            results[0, cycle] = y[0]
    return True


@compiled
def _run_segment(
    y: NDArray,
    segment: tuple[complex, complex],
    run: _Run,
    at: tuple[int, int, int, int],
    results: NDArray,
    log: NDArray,
) -> bool:
    """Advance over a segment, duration (s) and rate (m/s); return whether its end is reached.

    at: the cycle, the one whose slip is the last, the sign of v after a backstep that is over (0
    within the slip), and the direction of the step.
    """
    (rest, rate), (cycle, began, after, sign), sides, marks = segment, at, run.sides, run.marks
    _turn(y, rate, run, 1.0 if (y[1] - rate).real > 0.0 else -1.0)
    if (y[1] - rate).real == 0.0:
        _rates(y, rate, run, run.work[0])
        _turn(y, rate, run, 1.0 if run.work[0, 1].real > 0.0 else -1.0)
    for _ in range(_MOST):
        shorter = sides[_WATCH_W] == 2.0 and marks[_LEFT].real < rest.real
        taken, event = _advance(y, marks[_LEFT] if shorter else rest, rate, run)
        rest, marks[_LEFT] = rest - taken, marks[_LEFT] - taken
        if event >= 0:
            yielded = run.branches.max()
            branch = _cross(y, event, rate, run)
            if event != TURN or max(yielded, run.branches.max()) != STICKS:  # else it only bends
                _log(log, cycle, event, branch)
        if sides[_WATCH_V] != 0.0:
            if (sign * y[0]).real < marks[_LOWEST].real:
                marks[_LOWEST] = sign * y[0]
            turned = event == STOP or (event == TURN and rate.real == 0.0)
            if turned and sides[_V_SIDE] == after:
                results[1, began], sides[_WATCH_V] = marks[_TOP] - marks[_LOWEST], 0.0
        if sides[_WATCH_W] == 2.0:
            away = y[0] - y[2]
            marks[_HIGH] = away if away.real > marks[_HIGH].real else marks[_HIGH]
            marks[_LOW] = away if away.real < marks[_LOW].real else marks[_LOW]
            if marks[_LEFT].real <= 0.0:
                results[2, began], sides[_WATCH_W] = marks[_HIGH] - marks[_LOW], 0.0
        if rest.real <= 0.0:
            return True
    return False
