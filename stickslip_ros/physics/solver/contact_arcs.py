# SPDX-License-Identifier: Apache-2.0
"""Arcs of a runner on several contacts: the branch of each contact, the end, the motion within.

All contacts move with the same w = v - u', each has its own z. Along the direction of w, contact i
is elastic below z_ba and plastic above. An arc ends where w turns or where a contact reaches a
border of its law, so that every contact stays on one smooth branch within an arc:

- none slides: the contacts together are one damped oscillator, solved in closed form;
- some slide: Taylor series of w and of the z of each contact that slides, mirrored so that w > 0;
- all slide steadily: no z changes any more, and w has a closed form.

The rest of the solver sees one contact, with the sums of stiffness and damping and the mean of z
weighted by stiffness: sigma_0 z is then the sum of all sigma_0,i z_i. An ARC holds that mean.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.compiled import compiled, compiled_inline
from stickslip_ros.physics.laws.law import ALWAYS_PLASTIC
from stickslip_ros.physics.solver.arc_motion import end_at, glide_of, is_at_rest
from stickslip_ros.physics.solver.branches import beyond_steady
from stickslip_ros.physics.solver.closed_arcs import glide, glide_end, rest_line
from stickslip_ros.physics.solver.layout import (
    ELASTIC,
    GLIDE,
    GRADED,
    ORDER,
    PLASTIC,
    REST,
    STICKS,
    TAYLOR,
    TURN,
)
from stickslip_ros.physics.solver.oscillator import (
    CLOSE,
    Oscillator,
    Span,
    first_turn,
    newton,
    next_turn,
    overdamped_end,
    passes,
    propagate,
    within,
)
from stickslip_ros.physics.solver.taylor import (
    PER_NEXT,
    P,
    W,
    Z,
    integral,
    loading_coefficient,
    polynomial,
    time_at_level,
    turn_end,
)

#: Error of one step of a series, as a fraction of the tolerance per cycle
_PER_STEP = 1e-3
#: What a z may lack to its limit and counts as reached, as the same fraction
_REACHED = 1e-4


@compiled
def contacts_arc(arc: np.record, plant: np.record, contacts: NDArray, limit: float) -> None:
    """Find the end of the arc that `begin_arc` started, at most limit (s) long; fill each z_end."""
    z, w = arc.z, arc.w
    arc.cost = len(contacts)
    net = arc.force - plant.spring * arc.x - plant.sigma_0 * z
    if is_at_rest(arc, plant, net):
        stay(arc, contacts, limit, 0.0)
        return
    arc.mirror = 1.0 if w > 0.0 or (w == 0.0 and net > 0.0) else -1.0
    slide, room = _choose_branches(contacts, arc.mirror)
    if slide and w != 0.0 and _is_settled(arc, plant, contacts):  # to the z_end of each
        z = mean_at_end(contacts)
        arc.kind, arc.z_slide, arc.approach_rate = GLIDE, z, 0.0
        arc.net = arc.mirror * (arc.force - plant.spring * arc.x - plant.sigma_0 * z)
        g = glide_of(arc, plant)
        t, slowed = glide_end(g, 0.0, limit)
        dr, w_end = glide(g, t) if t < math.inf else (math.inf, g.w)
        end_at(arc, t, z, 0.0 if slowed else arc.mirror * w_end, arc.mirror * dr)
    elif slide:
        _series_arc(arc, plant, contacts, room, limit)
    else:
        _elastic_arc(arc, plant, contacts, room, limit)


@compiled
def stay(arc: np.record, contacts: NDArray, t: float, w: float) -> None:
    """Let each contact end the arc as it began it, after t (s), at w (m/s)."""
    arc.kind = REST
    end_at(arc, t, arc.z, w, 0.0)
    for c in contacts:
        c.z_end, c.second_end = c.z, c.second


@compiled
def _choose_branches(contacts: NDArray, mirror: float) -> tuple[bool, float]:
    """Set each branch; return whether one slides, and the path (m) until the next one does."""
    slide, room = False, math.inf
    for c in contacts:
        z = mirror * c.z
        if c.kind == ALWAYS_PLASTIC:
            c.branch = PLASTIC
        elif z < c.z_ba:
            c.branch = STICKS
            room = min(room, c.z_ba - z)
            continue
        else:
            above = z > c.z_ss or (z == c.z_ss and c.z_k >= c.z_ss)
            c.branch = PLASTIC if above else GRADED
        slide = True
    return slide, room


# -- none slides


@compiled
def _elastic_arc(
    arc: np.record, plant: np.record, contacts: NDArray, room: float, limit: float
) -> None:
    """Fill an arc on which no contact slides: until w turns, or a contact breaks away."""
    z, w, mirror = arc.z, arc.w, arc.mirror
    line = rest_line(arc, plant)
    o = Oscillator(plant.delta, plant.kappa, plant.omega)
    y, wy = z - line.a, w - line.b
    arc.kind = ELASTIC
    arc.line, arc.line_rate = line
    turn = first_turn(y, wy, o) if line.b == 0.0 else next_turn(y, wy, o, line.b, 0.0, limit)
    t, w_end = min(turn, limit), 0.0
    z_end = line.a  # line.b is 0 where time has no end
    if t < math.inf:
        y_end, wy_end = propagate(y, wy, t, o)
        z_end = line.a + line.b * t + y_end
        if turn > limit:
            w_end = line.b + wy_end
    broken = mirror * (z_end - z) > room
    if broken:
        if t == math.inf:
            t = overdamped_end(o)
        level = z + mirror * room
        t, w_end = passes(y, wy, o, line, level, Span(0.0, z, t, z_end))
        z_end = level
    end_at(arc, t, z_end, w_end, z_end - z)
    for c in contacts:
        c.z_end = c.z + (z_end - z)
        if broken and c.z_ba - mirror * c.z == room:
            c.z_end = mirror * c.z_ba


# -- all slide steadily


@compiled
def _is_settled(arc: np.record, plant: np.record, contacts: NDArray) -> bool:
    """Return whether all contacts slide with a z near that of steady sliding; set z_end to that.

    There alpha z = z_lim; one step of Newton's method leaves a rounding.
    """
    for c in contacts:
        if c.branch == STICKS:
            return False
        z = arc.mirror * c.z
        beyond, slope = z - c.z_k, 1.0
        if c.branch == GRADED:
            beyond, slope = beyond_steady(z, (c.z_ba, math.pi / (c.z_ss - c.z_ba), c.z_k))
        if not abs(beyond) <= _REACHED * plant.tolerance:
            return False
        c.z_end = arc.mirror * (z - beyond / slope)
    return True


# -- some slide


@compiled
def _series_arc(
    arc: np.record, plant: np.record, contacts: NDArray, room: float, limit: float
) -> None:
    """Fill an arc on which contacts slide, until w turns or one reaches a border of its law."""
    arc.kind = TAYLOR
    work, mirror = arc.work, arc.mirror
    _expand(arc, plant, contacts)
    whole, event = turn_end(work, min(_step_length(arc, plant, contacts), limit), 0.0)
    dr = integral(work, W, whole)
    opened = math.inf
    if dr > room:
        guess = whole * within(room / dr)
        opened = _path_root((work, room), (0.0, whole), True, guess, CLOSE * whole)
    t = min(whole, opened)
    for c in contacts:
        t = min(t, _border_at(c, whole))
    early = t < whole
    dr = integral(work, W, t)
    for c in contacts:
        if c.branch != STICKS:
            passed = early and _border_at(c, whole) == t
            c.z_end = mirror * (c.z_ss if passed else polynomial(c.series, Z, t))
        elif early and opened == t and c.z_ba - mirror * c.z == room:
            c.z_end = mirror * c.z_ba
        else:
            c.z_end = c.z + mirror * dr
    w_end = 0.0 if event == TURN and not early else mirror * polynomial(work, W, t)
    end_at(arc, t, mean_at_end(contacts), w_end, mirror * dr)


@compiled
def _expand(arc: np.record, plant: np.record, contacts: NDArray) -> None:
    """Fill rows W (m/s) and Z (m, the mean) of the arc, and the series of contacts that slide."""
    work, mirror = arc.work, arc.mirror
    stiffness = damping = held = 0.0  # of the contacts that stick: they move as one
    for c in contacts:
        if c.branch == STICKS:
            stiffness += c.sigma_0
            damping += c.sigma_1
            held += c.sigma_0 * mirror * c.z
        else:
            c.series[Z, 0] = mirror * c.z
    damping += plant.sigma_2
    work[W, 0] = mirror * arc.w
    for n in range(ORDER + 1):
        dr = work[W, n - 1] / n if n > 0 else 0.0
        elastic = held if n == 0 else stiffness * dr
        damped = damping * work[W, n] if n < ORDER else 0.0
        for c in contacts:
            if c.branch != STICKS:
                elastic += c.sigma_0 * c.series[Z, n]
                if n < ORDER:
                    z_rate = _rate_coefficient(work, c, n)
                    c.series[Z, n + 1] = z_rate * PER_NEXT[n]
                    damped += c.sigma_1 * z_rate
        work[Z, n] = elastic / plant.sigma_0
        if n < ORDER:
            pull = arc.force - plant.spring * arc.x if n == 0 else 0.0
            x = dr + mirror * arc.pulled if n == 1 else dr
            net = mirror * pull - plant.spring * x - elastic - damped
            work[W, n + 1] = net / plant.mass * PER_NEXT[n]


@compiled
def _rate_coefficient(work: NDArray, c: np.record, n: int) -> float:
    """Return coefficient n of z' = w (1 - alpha z / z_lim) of a contact; it fills its series."""
    series = c.series
    q = series[Z, n]
    if c.branch == GRADED:
        scale = math.pi / (c.z_ss - c.z_ba)
        q = loading_coefficient(series, Z, scale * (series[Z, 0] - c.z_ba), scale, n)
    series[P, n] = -q / c.z_k
    if n == 0:
        series[P, 0] += 1.0
    z_rate = 0.0
    for j in range(n + 1):
        z_rate += work[W, j] * series[P, n - j]
    return z_rate


@compiled
def _step_length(arc: np.record, plant: np.record, contacts: NDArray) -> float:
    """Return the step (s) whose truncation stays below the tolerance, by the last three terms."""
    tolerance, h = _PER_STEP * plant.tolerance, math.inf
    for n in range(ORDER, ORDER - 3, -1):
        size = arc.weight * abs(arc.work[W, n])
        for c in contacts:
            if c.branch != STICKS:
                share = c.sigma_0 / plant.sigma_0
                size = max(size, share * abs(c.series[Z, n]))
        if size > 0.0 and (h == math.inf or size * h**n > tolerance):
            h = (tolerance / size) ** (1.0 / n)
    return h


@compiled
def _border_at(c: np.record, h: float) -> float:
    """Return when (s) a contact that slides for h (s) passes its z_ss; inf if it does not."""
    if c.branch == STICKS or c.kind == ALWAYS_PLASTIC:
        return math.inf
    z, z_end = c.series[Z, 0], polynomial(c.series, Z, h)
    crossed = z < c.z_ss < z_end if c.branch == GRADED else z_end < c.z_ss < z
    return time_at_level(c.series, Z, c.z_ss, h) if crossed else math.inf


@compiled_inline
def _beyond_path(t: float, args: tuple[NDArray, float]) -> tuple[float, float]:
    """Return how far the path is above a length (m) at t (s), and its derivative."""
    work, length = args
    return integral(work, W, t) - length, polynomial(work, W, t)


_path_root = newton(_beyond_path)


@compiled
def deflection_after(arc: np.record, c: np.record, dr: float, t: float) -> float:
    """Return the deflection (m) of a contact after t (s) and the path dr (m) within the arc."""
    if arc.kind == GLIDE:
        return c.z_end
    if arc.kind == TAYLOR and c.branch != STICKS:
        return arc.mirror * polynomial(c.series, Z, t)
    return c.z + dr


@compiled
def mean_at_end(contacts: NDArray) -> float:
    """Return the mean of the deflections at the end of the arc by stiffness, m."""
    force = stiffness = 0.0
    for c in contacts:
        force += c.sigma_0 * c.z_end
        stiffness += c.sigma_0
    return force / stiffness
