# SPDX-License-Identifier: Apache-2.0
"""Exact derivatives of steps by the parameters and by the points of the waveform.

The equations are integrated in complex numbers, with one input moved by 1e-30 i. The imaginary part
of a result over 1e-30 then is its derivative, without a difference (W. Squire, G. Trapp, SIAM Rev.
40 (1998) 110). Kinks of the waveform lie at complex times; what is decided is decided by real
parts, and |w| is w times its sign.

At events of the contact nothing has to be corrected: alpha rises from 0 and reaches 1 without a
slope, and the branch changes at w = 0, where |w| = 0, so that all rates are continuous there and
the saltation matrix is the identity. Steps end at events, for each branch is smooth by itself.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled, report_compilation
from stickslip_ros.laws.ceim_ageing import CEIM_AGEING, Ageing
from stickslip_ros.library.run import check_steps
from stickslip_ros.model import Plant, drive_of
from stickslip_ros.model.actuator_chain import has_chain
from stickslip_ros.model.friction import ALWAYS_PLASTIC, ELASTOPLASTIC_CALC, LAWS
from stickslip_ros.model.surface import Surface
from stickslip_ros.parameters import ParameterError, Parameters, ParameterSource, parameter
from stickslip_ros.solver import SolverError
from stickslip_ros.solver.dop853 import ERRORS, STEP, A

#: How far an input is moved along the imaginary axis
_MOVED = 1e-30
#: Imaginary part below which nothing counts
_LEAST = 1e-60
#: Error of a step, as a share of what the contact can deflect, and of that times the ringing
_TOLERANCE = 1e-14
#: Ringing periods over which ringing is measured, as `waveform_search.ringing_and_step` does
_WINDOW = 3.0
#: Share of a parameter by which closed forms are moved for differences of order 4
_SHARE = 1e-4
#: Multiples of that and their weights over 12: about the value, or to one side at an end of a range
_DIFFERENCES = (
    ((-2, -1, 1, 2), (1.0, -8.0, 8.0, -1.0)),
    ((0, 1, 2, 3, 4), (-25.0, 48.0, -36.0, 16.0, -3.0)),
    ((0, -1, -2, -3, -4), (25.0, -48.0, 36.0, -16.0, 3.0)),
)
#: Steps of the integrator in a drive cycle, at most; trials for the time of an event
_MOST, _TRIALS = 1_000_000, 100
#: Constants of a contact in the order of `_inputs`, and the numbers before them
_OF_CONTACT = ("sigma_0", "sigma_1", "sigma_2", "z_ba", "z_ss", "z_k", "z_s", "v_s")
_FIRST = 7
#: Branches of alpha
_ELASTIC, _RISING, _PLASTIC = range(3)


class StepLengths(NamedTuple):
    """Lengths (m), or their derivatives, of each step: arrays whose last axis is (steps,)."""

    position: NDArray[np.float64]  #: at the end of each drive cycle
    backstep: NDArray[np.float64]  #: after the slip of each cycle; nan if the runner never turns
    #: after the slip, peak to peak of the runner against the actuator over three ringing periods,
    #: but not beyond the next slip; nan if the contact is damped too much to ring
    ringing: NDArray[np.float64]


@dataclass(frozen=True)
class Sensitivities:
    """Steps from rest with their derivatives; made by `sensitivities`."""

    values: StepLengths
    #: per unit of each parameter
    by: Mapping[str, StepLengths]
    #: by the time (s) of each kink within the drive cycle, (kinks, steps)
    by_time: StepLengths
    #: by the deflection (m) of the actuator at each kink, (kinks, steps)
    by_level: StepLengths


def sensitivities(
    parameters: ParameterSource = None,
    /,
    *,
    by: Sequence[str] = ("amplitude", "frequency", "slewrate", "preload", "mass"),
    steps: int = 12,
    **values: Any,
) -> Sensitivities:
    """Return the derivatives of steps from rest, by parameters and by the points of the waveform.

    They are those of the equations, right to 1e-6 and mostly to 1e-9. Where an event meets a kink
    or another event the second derivative jumps; differences converge slowly there.

    Parameters
    ----------
    parameters : Parameters, mapping, path or None
        As in `simulate`.
    by : sequence of str
        Names of numbers of friction, runner, actuator and drive.
    steps : int
        Number of steps; negative steps go backwards.
    **values
        Parameters by name, laid over the others.

    Returns
    -------
    Sensitivities
        Position, backstep and ringing of each step, and their derivatives.

    Raises
    ------
    ParameterError
        A value is out of range, or an effect or law is on that has no derivatives here.
    SolverError
        The contact is too stiff or too quick for explicit steps.

    Examples
    --------
    >>> import stickslip_ros as ss
    >>> found = ss.sensitivities(by=["preload"], preload=0.4, steps=5)
    >>> print(f"{1e9 * found.by['preload'].position[-1]:.1f} nm per N after five steps")
    -138.0 nm per N after five steps
    """
    p = Parameters.of(parameters, **values)
    check_steps(steps)
    _check(p)
    sign = 1 if steps > 0 else -1
    drive = drive_of(p, sign)
    segments, inputs = len(drive.durations), _inputs(p, sign)
    kinks = np.eye(segments)[: segments - 1] - np.eye(segments)[1:]
    by_points = np.zeros((2, segments - 1, len(inputs)))
    by_points[0, :, -2 * segments : -segments] = kinks
    by_points[1, :, -segments:] = kinks
    directions = [_by_parameter(p, sign, name, len(inputs)) for name in by]
    directions += list(by_points.reshape(-1, len(inputs))) or [np.zeros_like(inputs)]
    slip = drive.slip, drive.slip_end, sign
    kind = Plant.of(p).contact.kind
    if LAWS[p.friction.model] is CEIM_AGEING:
        kind = 0
    results = np.empty((len(directions), 3, abs(steps)), np.complex128)
    with report_compilation():
        for direction, result in zip(directions, results, strict=True):
            if not _run(inputs + 1j * _MOVED * direction, segments, kind, slip, result):
                raise SolverError("a drive cycle takes more steps than the integrator may make")
    slopes = results.imag / _MOVED
    points = slopes[len(by) :].reshape(-1, 3, abs(steps))[: 2 * (segments - 1)]
    times, levels = (points.swapaxes(0, 1)[:, part] for part in (
        slice(segments - 1), slice(segments - 1, None)
    ))  # fmt: skip
    return Sensitivities(
        StepLengths(*results[0].real),
        {name: StepLengths(*one) for name, one in zip(by, slopes, strict=False)},
        StepLengths(*times),
        StepLengths(*levels),
    )


def _check(p: Parameters) -> None:
    """Refuse what the equations here are without; ParameterError."""
    law = LAWS[p.friction.model]
    refused = {
        "an actuator that follows its command in time": has_chain(p.actuator),
        "contacts that vary from step to step": Surface.of(p.friction) is not None,
        "alpha as printed, which jumps": p.friction.alpha_form == "printed",
        f"the law {p.friction.model}": law.rate is not None and law is not CEIM_AGEING,
    }
    if found := [what for what, there in refused.items() if there]:
        raise ParameterError(f"sensitivities are without {', '.join(found)}: unset it")


def _inputs(p: Parameters, sign: int) -> NDArray[np.float64]:
    """Return all numbers that a run follows from: plant, contacts, durations (s), strokes (m)."""
    plant, drive = Plant.of(p), drive_of(p, sign)
    ages = p.friction.own(Ageing) if LAWS[p.friction.model] is CEIM_AGEING else Ageing(beta=0.0)
    frequency = plant.ringing_frequency
    numbers = [
        plant.mass, plant.force, plant.spring, ages.beta, ages.d_c, ages.theta_0,
        _WINDOW / frequency if frequency > 0.0 else 0.0,
    ]  # fmt: skip
    for contact in plant.contacts or (plant.contact,):
        numbers += [getattr(contact, name) for name in _OF_CONTACT]
    return np.array([*numbers, *drive.durations, *(drive.durations * drive.rates)])


def _by_parameter(p: Parameters, sign: int, name: str, size: int) -> NDArray[np.float64]:
    """Return the derivatives of `_inputs` by a parameter: closed forms, by differences."""
    row, value = parameter(name), p.value(name)
    if row.kind is not float or value is None:
        raise ParameterError(f"{name} is {value}: give numbers that are set")
    h, refused = _SHARE * (abs(value) or row.high), ""
    for shifts, weights in _DIFFERENCES:
        try:
            around = [_inputs(p.replace(**{name: value + k * h}), sign) for k in shifts]
        except ParameterError as error:
            refused = refused or str(error)
            continue
        if all(len(one) == size for one in around):
            return np.asarray(np.dot(weights, around) / (12.0 * h))
        refused = "the waveform changes its form"
    raise ParameterError(f"no derivative by {name} at {value:g}: {refused}")


# -- inside: the integrator, in complex numbers; a state is x, v, u, then z and age of each contact


class _Model(NamedTuple):
    """What the rates follow from."""

    m: NDArray[np.complex128]  #: the first of `_inputs`
    contacts: NDArray[np.complex128]  #: (contacts, constants), in the order of _OF_CONTACT
    kind: int  #: of alpha, see `Contact`
    branches: NDArray[np.int64]  #: of each contact
    #: signs of w and of v; whether w = 0 and v = 0 end a step (not 0); the next step to try, s
    sides: NDArray[np.float64]
    #: what errors of the state are weighed by: its deflections, and its derivatives up to now
    scale: NDArray[np.float64]


@compiled
def _z_limit(w: complex, c: NDArray) -> complex:
    if c[5] == c[6]:
        return c[5]  # type: ignore[no-any-return]
    ratio = w / c[7]
    return c[5] + (c[6] - c[5]) * cmath.exp(-ratio * ratio)  # type: ignore[no-any-return]


@compiled
def _edges(y: NDArray, i: int, w: complex, model: _Model) -> tuple[complex, complex, complex]:
    """Return the |z| (m) between which alpha rises at contact i, and the limit of z (m)."""
    c, m, age = model.contacts[i], model.m, 1.0 + 0.0j
    if m[3] != 0.0:
        age += m[3] * cmath.log(1.0 + y[3 + len(model.contacts) + i] / m[5])
    limit = _z_limit(w, c)
    high = limit if model.kind == ELASTOPLASTIC_CALC else c[4]
    return age * c[3], age * high, age * limit


@compiled
def _rates(y: NDArray, rate: complex, model: _Model, dy: NDArray) -> None:
    """Write the derivatives of the state by time, at u' = rate (m/s)."""
    m, contacts, side = model.m, model.contacts, model.sides[0]
    w, count, force = y[1] - rate, len(contacts), 0.0j
    for i in range(count):
        c, z, dz = contacts[i], y[3 + i], w
        if model.branches[i] != _ELASTIC:
            low, high, limit = _edges(y, i, w, model)
            share = 1.0 + 0.0j
            if model.branches[i] == _RISING:
                share = 0.5 - 0.5 * cmath.cos(math.pi * (side * z - low) / (high - low))
            dz -= share * side * w / limit * z
        force += c[0] * z + c[1] * dz + c[2] * w
        dy[3 + i], dy[3 + count + i] = dz, 0.0j
        if m[3] != 0.0:
            dy[3 + count + i] = 1.0 - side * w * y[3 + count + i] / m[4]
    dy[0], dy[1], dy[2] = y[1], (m[1] - m[2] * y[0] - force) / m[0], rate


@compiled
def _borders(y: NDArray, rate: complex, model: _Model, found: NDArray) -> None:
    """Write what is above 0 as long as no step has to end: of w, of v, two of each contact."""
    sides, w = model.sides, y[1] - rate
    found[:] = math.inf
    if sides[2] != 0.0:
        found[0] = sides[0] * w.real
    if sides[3] != 0.0 and not (rate.real == 0.0 and sides[2] != 0.0):  # else w is v
        found[1] = sides[1] * y[1].real
    for i in range(len(model.contacts) if model.kind != ALWAYS_PLASTIC else 0):
        low, high, _ = _edges(y, i, w, model)
        q = sides[0] * y[3 + i].real if sides[2] != 0.0 else abs(y[3 + i].real)
        if model.branches[i] == _ELASTIC:
            found[2 + 2 * i] = low.real - q
        elif model.branches[i] == _RISING:
            found[2 + 2 * i], found[3 + 2 * i] = q - low.real, high.real - q
        else:
            found[2 + 2 * i] = q - high.real


@compiled
def _turn(y: NDArray, rate: complex, model: _Model, side: float) -> None:
    """Let w have a sign from now on, and find the branch of each contact."""
    model.sides[0] = side
    for i in range(len(model.contacts)):
        model.branches[i] = _PLASTIC
        if model.kind != ALWAYS_PLASTIC:
            low, high, _ = _edges(y, i, y[1] - rate, model)
            q = side * y[3 + i].real
            if q < high.real:
                model.branches[i] = _RISING if q > low.real else _ELASTIC


@compiled
def _step(y: NDArray, h: complex, rate: complex, model: _Model, work: NDArray) -> float:
    """Make a step of h (s), whose end is work[STEP]; return its error over the tolerance."""
    size, tried, scale = len(y), work[STEP], model.scale
    for k in range(STEP + 1):
        tried[:] = y
        for i in range(k):
            if A[k, i] != 0.0:
                part = A[k, i] * h
                for j in range(size):
                    tried[j] += part * work[i, j]
        if k < STEP:
            _rates(tried, rate, model, work[k])
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
    return abs(h) * high / math.sqrt((high + 0.01 * low) * size) / _TOLERANCE  # type: ignore[no-any-return]


@compiled
def _next(
    y: NDArray, rest: complex, rate: complex, model: _Model, work: NDArray, borders: NDArray
) -> tuple[complex, int]:
    """Advance by a step, at most rest (s); return its length and which border ends it, or -1."""
    sides, before = model.sides, borders[1]
    if sides[2] != 2.0:  # unless ringing is watched
        sides[2] = 1.0 if model.kind == ALWAYS_PLASTIC or model.m[3] != 0.0 else 0.0
        for i in range(len(model.contacts)):
            low, _, _ = _edges(y, i, y[1] - rate, model)
            if model.branches[i] != _ELASTIC or abs(y[3 + i].real) > low.real:
                sides[2] = 1.0
    while True:
        h = rest if sides[4] >= rest.real else sides[4] + 0.0j
        error = _step(y, h, rate, model, work)
        if not error <= 1.0:
            sides[4] = h.real * max(0.2, 0.9 * error**-0.125) if error < math.inf else 0.1 * h.real
            continue
        if h != rest or error > 0.5:
            sides[4] = h.real * min(4.0, 0.9 * max(error, 1e-8) ** -0.125)
        break
    _borders(y, rate, model, before)
    _borders(work[STEP], rate, model, borders[0])
    event = -1
    for k in range(len(before)):
        if not borders[0, k] < 0.0:
            continue
        event = k
        left, right, f_left, f_right = 0.0, h.real, max(before[k], 0.0), borders[0, k]
        for trial in range(_TRIALS):
            share = f_left / (f_left - f_right)
            if trial % 3 == 2 or not 1e-3 < share < 0.999:
                share = min(max(share, 1e-3), 0.999) if trial % 3 != 2 else 0.5
            h = left + share * (right - left) + 0.0j
            _step(y, h, rate, model, work)
            _borders(work[STEP], rate, model, borders[0])
            if borders[0, k] < 0.0:
                right, f_right = h.real, borders[0, k]
            else:
                left, f_left = h.real, borders[0, k]
            if right - left <= 1e-15 * right:
                break
    for j in range(len(y)):
        y[j] = work[STEP, j]
        model.scale[1, j] = max(model.scale[1, j], abs(y[j].imag))
    return h, event


@compiled
def _cross(y: NDArray, event: int, rate: complex, model: _Model) -> None:
    """Go on beyond the border that ended a step."""
    if event == 0:
        _turn(y, rate, model, -model.sides[0])
        if rate.real == 0.0:
            model.sides[1] = model.sides[0]
    elif event == 1:
        model.sides[1] = -model.sides[1]
    elif event > 1:
        i = (event - 2) // 2
        if model.branches[i] == _ELASTIC and model.sides[2] == 0.0:
            model.sides[0] = 1.0 if y[3 + i].real > 0.0 else -1.0
        outwards = model.branches[i] == _ELASTIC or event % 2 == 1
        model.branches[i] += 1 if outwards else -1


@compiled
def _run(
    inputs: NDArray, segments: int, kind: int, slip: tuple[int, int, int], results: NDArray
) -> bool:
    """Run steps from rest, as many as results (3, steps) has room for; False if that takes ages.

    slip: its first segment, the one after its last, and the direction of the step.
    """
    durations, strokes = inputs[len(inputs) - 2 * segments : -segments], inputs[-segments:]
    contacts = inputs[_FIRST : len(inputs) - 2 * segments].copy().reshape(-1, len(_OF_CONTACT))
    count, m, cycles = len(contacts), inputs[:_FIRST], results.shape[1]
    deflects, stiffness = math.inf, 0.0
    for c in contacts:
        deflects, stiffness = min(deflects, c[5].real), stiffness + c[0].real
    quick = math.sqrt(stiffness / m[0].real)
    scale = np.zeros((2, 3 + 2 * count))
    scale[0] = deflects
    scale[0, 1] *= quick
    scale[0, 3 + count :] = m[5].real
    y, work = (
        np.zeros(3 + 2 * count, np.complex128),
        np.empty((STEP + 1, 3 + 2 * count), np.complex128),
    )
    borders, sides = np.empty((2, 2 + 2 * count)), np.zeros(5)
    model = _Model(m, contacts, kind, np.zeros(count, np.int64), sides, scale)
    sides[0] = sides[1] = 1.0
    sides[4] = 0.1 / quick
    first, end, sign = slip
    window, period = m[6], np.sum(durations)
    dwell = period - np.sum(durations[first:end])
    if window.real > dwell.real:
        window = dwell
    results[:] = complex(math.nan, math.nan)
    top = lowest = left = high = low = 0.0j
    for number in range((cycles + 1) * segments):
        cycle, k = number // segments, number % segments
        rate, rest = strokes[k] / durations[k], durations[k]
        if k == first:
            if sides[2] == 2.0:  # the window is as long as the dwell, but for rounding
                results[2, cycle - 1], sides[2] = high - low, 0.0
            if sides[3] != 0.0:  # it never turned back
                results[1, cycle - 1] = top - lowest
            if cycle == cycles:
                break
            sides[1], sides[3] = (1.0 if y[1].real > 0.0 else -1.0), 1.0
            top = lowest = sign * y[0]
        if k == end % segments and (cycle > 0 or end < segments) and m[6] != 0.0:
            left, sides[2] = window, 2.0
            high = low = y[0] - y[2]
        after = k < first or k >= end
        _turn(y, rate, model, 1.0 if (y[1] - rate).real > 0.0 else -1.0)
        if (y[1] - rate).real == 0.0:
            _rates(y, rate, model, work[0])
            _turn(y, rate, model, 1.0 if work[0, 1].real > 0.0 else -1.0)
        for _ in range(_MOST):
            piece = left if sides[2] == 2.0 and left.real < rest.real else rest
            taken, event = _next(y, piece, rate, model, work, borders)
            rest, left = rest - taken, left - taken
            _cross(y, event, rate, model)
            if sides[3] != 0.0:
                if (sign * y[0]).real < lowest.real:
                    lowest = sign * y[0]
                turned = event == 1 or (event == 0 and rate.real == 0.0)
                if turned and sides[1] == sign and after:
                    results[1, cycle if k >= end else cycle - 1] = top - lowest
                    sides[3] = 0.0
            if sides[2] == 2.0:
                away = y[0] - y[2]
                high = away if away.real > high.real else high
                low = away if away.real < low.real else low
                if left.real <= 0.0:
                    results[2, cycle if k >= end else cycle - 1] = high - low
                    sides[2] = 0.0
            if rest.real <= 0.0:
                break
        if rest.real > 0.0:
            return False
        if k == segments - 1 and cycle < cycles:
            results[0, cycle] = y[0]
    return True
