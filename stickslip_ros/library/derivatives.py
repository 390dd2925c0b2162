# SPDX-License-Identifier: Apache-2.0
"""Exact derivatives of steps by the parameters and by the points of the waveform.

`solver.complex_steps` integrates the equations; here are its inputs, and what becomes of results.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.compiled import report_compilation
from stickslip_ros.laws import LAWS
from stickslip_ros.laws.ceim_ageing import CEIM_AGEING, Ageing
from stickslip_ros.library.run import check_steps
from stickslip_ros.model import Plant, drive_of
from stickslip_ros.model.actuator_chain import has_chain
from stickslip_ros.model.surface import Surface
from stickslip_ros.parameters import ParameterError, Parameters, ParameterSource, parameter
from stickslip_ros.solver import SolverError
from stickslip_ros.solver.complex_steps import (
    BORDER,
    CONTACT_NUMBERS,
    KINK,
    STOP,
    TURN,
    complex_steps,
)
from stickslip_ros.solver.layout import PLASTIC, STICKS

#: How far an input is moved along the imaginary axis
_MOVED = 1e-30
#: Events that are kept
_ROOM = 10_000
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


class StepLengths(NamedTuple):
    """Lengths (m), or their derivatives, of each step: arrays whose last axis is (steps,)."""

    position: Array  #: at the end of each drive cycle
    backstep: Array  #: after the slip of each cycle; nan if the runner never turns
    #: after the slip, peak to peak of the runner against the actuator over three ringing periods,
    #: but not beyond the next slip; nan if the contact is damped too much to ring
    ringing: Array


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
    #: what happens, in its order: the cycle (from 1) and a kink or an event of the contact
    events: tuple[tuple[int, str], ...]

    def __repr__(self) -> str:
        """Say the result in one line."""
        return f"Sensitivities({len(self.values.position)} steps by {', '.join(self.by)})"


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
    or another event, or grazes, the second derivative jumps: differences converge slowly there, and
    ``events`` on either side are not the same.

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
    >>> found = ss.sensitivities("table1_typical", by=["preload"], preload=0.4, steps=5)
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
    log = np.empty((_ROOM + 1, 3), np.int64)
    with report_compilation():
        for direction, result in zip(directions, results, strict=True):
            moved = inputs + 1j * _MOVED * direction
            if not complex_steps(moved, segments, kind, slip, result, log):
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
        tuple((int(c) + 1, _name(e, b)) for c, e, b in log[1 : log[0, 0] + 1] if c < abs(steps)),
    )


def _name(event: int, branch: int) -> str:
    """Return the name of an event of `complex_steps` and the branch before it."""
    if event == KINK:
        return f"segment {branch + 1} begins"
    if event in (TURN, STOP):
        return "w turns" if event == TURN else "the runner turns"
    contact, upper = divmod(event - BORDER, 2)
    border = "z_ss" if branch == PLASTIC or upper else "z_ba"
    verb = "passes" if branch == STICKS or upper else "falls below"
    return f"contact {contact + 1} {verb} {border}"


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


def _inputs(p: Parameters, sign: int) -> Array:
    """Return all numbers that a run follows from: plant, contacts, durations (s), strokes (m)."""
    plant, drive = Plant.of(p), drive_of(p, sign)
    ages = p.friction.own(Ageing) if LAWS[p.friction.model] is CEIM_AGEING else Ageing(beta=0.0)
    frequency = plant.ringing_frequency
    numbers = [
        plant.mass, plant.force, plant.spring, ages.beta, ages.d_c, ages.theta_0,
        _WINDOW / frequency if frequency > 0.0 else 0.0,
    ]  # fmt: skip
    for contact in plant.contacts or (plant.contact,):
        numbers += [getattr(contact, name) for name in CONTACT_NUMBERS]
    return np.array([*numbers, *drive.durations, *(drive.durations * drive.rates)])


def _by_parameter(p: Parameters, sign: int, name: str, size: int) -> Array:
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
