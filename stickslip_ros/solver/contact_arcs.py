# SPDX-License-Identifier: Apache-2.0
"""Arcs of a runner on several contacts: which of them slide, where the arc ends, where it is.

All contacts move with the same w = v - u', each has its own z. Along the direction of w, contact i
is elastic below z_ba and plastic above. An arc ends where w turns or where a contact gets to a
border of its law, so that within an arc every one keeps to one smooth branch:

- none slides: the contacts together are one damped oscillator, solved in closed form;
- some slide: Taylor series of w and of the z of each contact that slides, mirrored so that w > 0;
- all slide steadily: no z changes any more, and w has a closed form.

Towards the rest of the solver the contacts are one, with the sums of stiffness and damping and with
the mean z by stiffness: sigma_0 z is then the sum of all sigma_0,i z_i. An ARC holds that mean.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled, compiled_inline
from stickslip_ros.model.friction import ALWAYS_PLASTIC
from stickslip_ros.model.friction.contact import alpha
from stickslip_ros.solver.arcs import end_at, glide_of, within_arc
from stickslip_ros.solver.elastic import rest_line
from stickslip_ros.solver.glide import glide, glide_end
from stickslip_ros.solver.layout import ELASTIC, GLIDE, ORDER, REST, SERIES, TAYLOR, TURN
from stickslip_ros.solver.oscillator import (
    Oscillator,
    Span,
    first_turn,
    next_turn,
    passes,
    propagate,
)
from stickslip_ros.solver.roots import newton
from stickslip_ros.solver.taylor import W, Z, path, polynomial, reaches, turn_end

#: Columns of the constants of a contact, as `Contact` has them
SIGMA_0, SIGMA_1, SIGMA_2, Z_BA, Z_SS, Z_LIM, _, _, KIND, _ = range(10)
CONSTANTS = 10
#: Branches of a contact: alpha = 0, between 0 and 1, alpha = 1
STICKS, GRADED, PLASTIC = range(3)
#: Parts of the tolerance per cycle: one step of a series; a ringing that counts as rest; what a z
#: may lack to its limit and counts as settled
_PER_STEP, _AT_REST, _SETTLED = 1e-3, 1e-3, 1e-4
#: Time constants after which an overdamped motion has ended
_LONG = 120.0
_PER_NEXT = 1.0 / np.arange(1.0, ORDER + 2.0)


class Contacts(NamedTuple):
    """The contacts under a runner."""

    constants: NDArray  #: (contacts, CONSTANTS)
    z: NDArray  #: deflections at the anchor, m, (contacts,)
    end: NDArray  #: deflections at the end of the arc, m, (contacts,)
    branch: NDArray  #: STICKS, GRADED or PLASTIC within the arc, (contacts,)
    rows: NDArray  #: series of z, mirrored, and of what they need, (SERIES contacts, ORDER + 1)


@compiled
def contact_arc(arc: np.record, plant: np.record, on: Contacts, limit: float) -> None:
    """Find the end of the arc that `begin_arc` started, at most limit (s) long; fill on.end."""
    z, w = arc.z, arc.w
    arc.z_max, arc.z_min = -math.inf, math.inf
    net = plant.force - plant.spring * arc.x - plant.sigma_0 * z
    if (
        plant.spring * arc.rate == 0.0
        and abs(w) * plant.inv_omega + abs(net) / plant.sigma_0 < _AT_REST * plant.tolerance
    ):
        arc.kind = REST
        end_at(arc, limit, z, 0.0, 0.0)
        on.end[:] = on.z
        return
    arc.mirror = 1.0 if w > 0.0 or (w == 0.0 and net > 0.0) else -1.0
    slide, room = _choose_branches(on, arc.mirror)
    if slide and w != 0.0 and _is_settled(arc, plant, on):
        _glide_arc(arc, plant, on, limit)
    elif slide:
        _series_arc(arc, plant, on, room, limit)
    else:
        _elastic_arc(arc, plant, on, room, limit)


@compiled
def _choose_branches(on: Contacts, mirror: float) -> tuple[bool, float]:
    """Fill on.branch; return whether a contact slides, and the path (m) until the next one does."""
    slide, room = False, math.inf
    for i in range(len(on.z)):
        z, z_ba, z_ss = mirror * on.z[i], on.constants[i, Z_BA], on.constants[i, Z_SS]
        if on.constants[i, KIND] == ALWAYS_PLASTIC:
            on.branch[i] = PLASTIC
        elif z < z_ba:
            on.branch[i] = STICKS
            room = min(room, z_ba - z)
            continue
        else:
            above = z > z_ss or (z == z_ss and on.constants[i, Z_LIM] >= z_ss)
            on.branch[i] = PLASTIC if above else GRADED
        slide = True
    return slide, room


# -- none slides


@compiled
def _elastic_arc(arc: np.record, plant: np.record, on: Contacts, room: float, limit: float) -> None:
    """Fill an arc on which no contact slides: until w turns, or a contact breaks away."""
    z, w, mirror = arc.z, arc.w, arc.mirror
    damping = plant.sigma_1 + plant.sigma_2
    line = rest_line(arc.x, z, arc.rate, plant.force, plant.spring, (plant.sigma_0, damping))
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
            t = _LONG * o.delta / o.kappa
        level = z + mirror * room
        t, w_end = passes(y, wy, o, line, level, Span(0.0, z, t, z_end))
        z_end = level
    end_at(arc, t, z_end, w_end, z_end - z)
    for i in range(len(on.z)):
        on.end[i] = on.z[i] + (z_end - z)
        z_ba = on.constants[i, Z_BA]
        if broken and z_ba - mirror * on.z[i] == room:
            on.end[i] = mirror * z_ba


# -- all slide steadily


@compiled
def _is_settled(arc: np.record, plant: np.record, on: Contacts) -> bool:
    """Return whether all contacts slide with a z near that of steady sliding; fill on.end with it.

    There alpha z = z_lim; one step of Newton's method leaves a rounding.
    """
    for i in range(len(on.z)):
        z, share, slope = arc.mirror * on.z[i], 1.0, 1.0
        if on.branch[i] == STICKS:
            return False
        if on.branch[i] == GRADED:
            z_ba = on.constants[i, Z_BA]
            scale = math.pi / (on.constants[i, Z_SS] - z_ba)
            share = 0.5 - 0.5 * math.cos(scale * (z - z_ba))
            slope = share + 0.5 * scale * math.sin(scale * (z - z_ba)) * z
        lacking = on.constants[i, Z_LIM] - share * z
        if not abs(lacking) <= _SETTLED * plant.tolerance:
            return False
        on.end[i] = arc.mirror * (z + lacking / slope)
    return True


@compiled
def _glide_arc(arc: np.record, plant: np.record, on: Contacts, limit: float) -> None:
    """Fill an arc of steady sliding, with the deflections in on.end: until w has come down to 0."""
    mirror = arc.mirror
    z = mean_deflection(on.constants, on.end)
    arc.kind, arc.z_slide, arc.settling = GLIDE, z, 0.0
    arc.net = mirror * (plant.force - plant.spring * arc.x - plant.sigma_0 * z)
    g = glide_of(arc, plant)
    t, slowed = glide_end(g, 0.0, limit)
    gone, w_end = glide(g, t) if t < math.inf else (math.inf, g.w)
    end_at(arc, t, z, 0.0 if slowed else mirror * w_end, mirror * gone)


# -- some slide


@compiled
def _series_arc(arc: np.record, plant: np.record, on: Contacts, room: float, limit: float) -> None:
    """Fill an arc on which contacts slide: until w turns, or one gets to a border of its law."""
    arc.kind = TAYLOR
    work, mirror = arc.work, arc.mirror
    _expand(arc, plant, on)
    whole, event = turn_end(work, min(_step_length(arc, plant, on), limit), 0.0)
    gone = path(work, whole)
    opened = math.inf
    if gone > room:
        guess = whole * min(0.95, max(0.05, room / gone))
        opened = _path_root((work, room), (0.0, whole), True, guess, 1e-14 * whole)
    t = min(whole, opened)
    for i in range(len(on.z)):
        z_end = on.z[i] + mirror * gone
        if on.branch[i] != STICKS:
            z_end = mirror * polynomial(on.rows, SERIES * i, whole)
            t = min(t, _border_at(on, i, whole, mirror * z_end))
        on.end[i] = z_end
    if t < whole:
        gone = path(work, t)
        _end_early(arc, on, t, whole, room if opened == t else math.inf)
    w_end = 0.0 if event == TURN and t == whole else mirror * polynomial(work, W, t)
    end_at(arc, t, mean_deflection(on.constants, on.end), w_end, mirror * gone)


@compiled
def _end_early(arc: np.record, on: Contacts, t: float, whole: float, room: float) -> None:
    """Fill on.end at t (s), where contacts get to a border within a step of whole (s).

    Contacts with the path room (m) before them break away there.
    """
    mirror, gone = arc.mirror, path(arc.work, t)
    for i in range(len(on.z)):
        if on.branch[i] != STICKS:
            passed = _border_at(on, i, whole, mirror * on.end[i]) == t
            z_ss = on.constants[i, Z_SS]
            on.end[i] = mirror * (z_ss if passed else polynomial(on.rows, SERIES * i, t))
        elif on.constants[i, Z_BA] - mirror * on.z[i] == room:
            on.end[i] = mirror * on.constants[i, Z_BA]
        else:
            on.end[i] = on.z[i] + mirror * gone


@compiled
def _expand(arc: np.record, plant: np.record, on: Contacts) -> None:
    """Fill rows W (m/s) and Z (m, the mean) of the arc, and the series of contacts that slide."""
    work, rows, mirror = arc.work, on.rows, arc.mirror
    stiffness = damping = held = 0.0  # of the contacts that stick: they move as one
    for i in range(len(on.z)):
        if on.branch[i] == STICKS:
            stiffness += on.constants[i, SIGMA_0]
            damping += on.constants[i, SIGMA_1]
            held += on.constants[i, SIGMA_0] * mirror * on.z[i]
        else:
            rows[SERIES * i, 0] = mirror * on.z[i]
    damping += plant.sigma_2
    work[W, 0] = mirror * arc.w
    for n in range(ORDER + 1):
        gone = work[W, n - 1] / n if n > 0 else 0.0
        elastic = held if n == 0 else stiffness * gone
        damped = 0.0
        if n < ORDER:
            damped = damping * work[W, n]
        for i in range(len(on.z)):
            if on.branch[i] != STICKS:
                elastic += on.constants[i, SIGMA_0] * rows[SERIES * i, n]
                if n < ORDER:
                    z_rate = _rate_coefficient(work, rows, on.constants, on.branch[i], i, n)
                    rows[SERIES * i, n + 1] = z_rate * _PER_NEXT[n]
                    damped += on.constants[i, SIGMA_1] * z_rate
        work[Z, n] = elastic / plant.sigma_0
        if n < ORDER:
            pull = plant.force - plant.spring * arc.x if n == 0 else 0.0
            x = gone + mirror * arc.rate if n == 1 else gone
            net = mirror * pull - plant.spring * x - elastic - damped
            work[W, n + 1] = net / plant.mass * _PER_NEXT[n]


@compiled
def _rate_coefficient(
    work: NDArray, rows: NDArray, constants: NDArray, branch: float, i: int, n: int
) -> float:
    """Return coefficient n of z' = w (1 - alpha z / z_lim) of contact i; it fills its rows."""
    z, c, s, p = SERIES * i, SERIES * i + 1, SERIES * i + 2, SERIES * i + 3
    q = rows[z, n]
    if branch == GRADED:
        z_ba = constants[i, Z_BA]
        scale = math.pi / (constants[i, Z_SS] - z_ba)
        if n == 0:
            angle = scale * (q - z_ba)
            rows[c, 0], rows[s, 0] = math.cos(angle), math.sin(angle)
        else:
            cosine = sine = 0.0
            for j in range(1, n + 1):
                d = j * rows[z, j]
                cosine -= d * rows[s, n - j]
                sine += d * rows[c, n - j]
            scale *= _PER_NEXT[n - 1]
            rows[c, n], rows[s, n] = scale * cosine, scale * sine
        for j in range(n + 1):
            q -= rows[c, j] * rows[z, n - j]
        q *= 0.5
    rows[p, n] = -q / constants[i, Z_LIM]
    if n == 0:
        rows[p, 0] += 1.0
    z_rate = 0.0
    for j in range(n + 1):
        z_rate += work[W, j] * rows[p, n - j]
    return z_rate


@compiled
def _step_length(arc: np.record, plant: np.record, on: Contacts) -> float:
    """Return the step (s) whose truncation stays below the tolerance, by the last three terms."""
    tolerance, h = _PER_STEP * plant.tolerance, math.inf
    for n in range(ORDER, ORDER - 3, -1):
        size = arc.weight * abs(arc.work[W, n])
        for i in range(len(on.z)):
            if on.branch[i] != STICKS:
                share = on.constants[i, SIGMA_0] / plant.sigma_0
                size = max(size, share * abs(on.rows[SERIES * i, n]))
        if size > 0.0 and (h == math.inf or size * h**n > tolerance):
            h = (tolerance / size) ** (1.0 / n)
    return h


@compiled
def _border_at(on: Contacts, i: int, h: float, z_end: float) -> float:
    """Return when (s) a contact that slides to z_end (m, mirrored) in h (s) passes its z_ss.

    inf if it does not.
    """
    if on.constants[i, KIND] == ALWAYS_PLASTIC:
        return math.inf
    z_ss, row = on.constants[i, Z_SS], SERIES * i
    z = on.rows[row, 0]
    crossed = z < z_ss < z_end if on.branch[i] == GRADED else z_end < z_ss < z
    return reaches(on.rows, row, z_ss, h) if crossed else math.inf


@compiled_inline
def _beyond_path(t: float, args: tuple[NDArray, float]) -> tuple[float, float]:
    """Return how far the path is above a length (m) at t (s), and its derivative."""
    work, length = args
    return path(work, t) - length, polynomial(work, W, t)


_path_root = newton(_beyond_path)


# -- within an arc


@compiled
def deflections(arc: np.record, plant: np.record, on: Contacts, t: float, z: NDArray) -> None:
    """Fill z (contacts,) with the deflections (m) at t (s) within the arc."""
    gone = within_arc(arc, plant, t)[0] if arc.kind != GLIDE else 0.0
    for i in range(len(z)):
        if arc.kind == GLIDE:
            z[i] = on.end[i]
        elif arc.kind == TAYLOR and on.branch[i] != STICKS:
            z[i] = arc.mirror * polynomial(on.rows, SERIES * i, t)
        else:
            z[i] = on.z[i] + gone


@compiled
def mean_deflection(constants: NDArray, z: NDArray) -> float:
    """Return the mean of deflections z (contacts,) by stiffness, m."""
    force = stiffness = 0.0
    for i in range(len(z)):
        force += constants[i, SIGMA_0] * z[i]
        stiffness += constants[i, SIGMA_0]
    return force / stiffness


@compiled
def alpha_in(constants: NDArray, i: int, z: float, w: float) -> float:
    """Return alpha of contact i at deflection z (m) and differential velocity w (m/s)."""
    if constants[i, KIND] == ALWAYS_PLASTIC:
        return 1.0
    return alpha(z, w, constants[i, Z_BA], constants[i, Z_SS], 0)


@compiled
def force_of(constants: NDArray, z: NDArray, w: float) -> float:
    """Return the sum of F (N, Eq. 1) of contacts at deflections z (contacts,) and w (m/s)."""
    force = 0.0
    for i in range(len(z)):
        alpha_i = alpha_in(constants, i, z[i], w)
        z_rate = w - alpha_i * abs(w) / constants[i, Z_LIM] * z[i]
        force += constants[i, SIGMA_0] * z[i] + constants[i, SIGMA_1] * z_rate
        force += constants[i, SIGMA_2] * w
    return force
