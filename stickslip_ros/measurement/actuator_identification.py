# SPDX-License-Identifier: Apache-2.0
"""From a recording of an actuator to the play operators that repeat it.

The deflection is linear in the weights once the thresholds are chosen, and weights of a piezo
actuator are not negative: least squares with that bound has one answer (K. Kuhnen, European
Journal of Control 9 (2003) 407, has the bound too). Level and drift are fitted along, and so is
creep as `model.actuator_chain` has it, of the deflection that was fitted before.

A play operator is followed along the voltage, means of neighbouring samples, from a place on from
which no earlier past plays a part: the voltage has been at both ends of its range.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import MEASURED, SIMULATED, draw_lines, format_si
from stickslip_ros.base.reporting.terminal import format_rows
from stickslip_ros.measurement.steps.noise import noise_of, without_spikes
from stickslip_ros.physics.model.actuator import Actuator
from stickslip_ros.physics.model.actuator_chain import Chain
from stickslip_ros.physics.parameters import ParameterError, Parameters

if TYPE_CHECKING:
    from matplotlib.axes import Axes


#: Largest noise, as share of the range, beside which a loop is seen.
_NOISY = 0.04
#: A voltage so near to an end of its range, as a share of it, is at that end.
_END = 0.1
#: A voltage that changes by less than this share of the range stays where it is.
_STILL = 0.005
#: Samples that a fit sees at most, means of neighbours.
_MOST = 20_000
#: What counts as noise in a spike, as share of the range: a spike is eight times as far off.
_RIPPLE = 0.006
#: The range of a recording but for its spikes.
_RANGE = (0.001, 0.999)
#: Least weight of the voltage itself, as part of the mean slope: it moves every actuator.
_STIFFEST = 1e-3
#: Least deflection that is one, m: far below it, shares of it overflow.
_LEAST_SPAN = 1e-15
#: Largest creep per decade, as a larger lag is not creep; rounds of its fit.
_MOST_CREEP, _ROUNDS = 0.05, 3
#: Creep is fitted if the voltage rests for this many times `creep_start`,
#: and if creep takes this share off the deviations.
_LONG, _GAIN = 10.0, 0.02
#: Reject loops whose leading part exceeds this fraction of their area.
_LEADS = 0.01
#: A single loop begins where it ends unless an actuator that never moved explains it so many times
#: as well.
_LIKELIER = 0.5
#: Gains (m/V) that actuators have: a plate of one layer, a long bender.
_GAINS = (2e-10, 2e-5)
#: Deviations above this share of the deflection's scatter: it does not follow the voltage.
_UNRELATED = 0.5


@dataclass(frozen=True)
class ActuatorRecording:
    """Means of neighbouring samples, each array of shape (means,)."""

    times: Array  #: s, or numbers of samples where the time is not known
    volts: Array  #: V
    deflection: Array  #: m
    first: int  #: the first mean from which on no earlier past plays a part; 0 if there is none
    loops: int  #: whole loops from there on

    @property
    def range(self) -> float:
        """Highest less lowest voltage (V)."""
        return float(np.ptp(self.volts))

    @cached_property
    def longest_rest(self) -> float:
        """Longest time (s) from `first` on in which the voltage stays where it is."""
        times, volts = self.times[self.first :], self.volts[self.first :] / (_STILL * self.range)
        # A stretch as high as half a bin lies in one bin of two sets of them, half a bin apart.
        moves = [np.flatnonzero(np.diff(np.floor(0.5 * volts + part))) for part in (0.0, 0.5)]
        rests = [np.diff(times[np.concatenate([[0], one + 1, [-1]])]) for one in moves]
        return max(float(one.max()) for one in rests)

    def plays(self, thresholds: Array, start: Array) -> Array:
        """Return the plays (V) at each mean, (means, operators).

        thresholds and start, the plays before the first sample, are in V, (operators,).
        """
        found, stand = np.empty((len(self.volts), len(thresholds))), start
        for k, (low, high) in enumerate(
            zip(self.volts[:, None] - thresholds, self.volts[:, None] + thresholds, strict=True)
        ):
            found[k] = stand = np.minimum(np.maximum(stand, low), high)
        return found


def record(times: Array | None, volts: Array, deflection: Array) -> ActuatorRecording:
    """Average a recording; times (s), volts (V) and deflection (m) have the shape (samples,).

    Raises ParameterError if the voltage has no whole loop, or the deflection does not change.
    """
    if not float(np.ptp(volts)) > 0.0:
        raise ParameterError(f"the voltage stays at {volts[0]:g} V; a loop goes up and down")
    if not float(np.ptp(deflection)) > 0.0:
        raise ParameterError("the deflection never changes; is it in the second column, in m?")
    kept = np.logical_and(
        *(without_spikes(one, _RIPPLE * float(np.ptp(np.quantile(one, _RANGE))))
          for one in (volts, deflection))
    )  # fmt: skip
    volts, deflection = volts[kept], deflection[kept]
    whole, noise = float(np.ptp(volts)), noise_of(volts)
    if noise > _NOISY * whole:
        raise ParameterError(
            f"the voltage goes over {whole:.3g} V and has {noise:.3g} V of noise: no loop is to be "
            "seen in it; is that the column of the voltage?"
        )
    times = np.flatnonzero(kept).astype(np.float64) if times is None else times[kept]
    starts = np.arange(0, len(volts), -(-len(volts) // _MOST))
    counts = np.diff(np.append(starts, len(volts)))
    times, volts, deflection = (
        np.add.reduceat(one, starts) / counts for one in (times, volts, deflection)
    )
    return ActuatorRecording(times, volts, deflection, *_settled(volts))


def _settled(volts: Array) -> tuple[int, int]:
    """Return from where on the plays are known, by a voltage (V), and the number of loops after it.

    The plays are known once the voltage has been at both of its ends. 0 if no whole loop follows:
    then the initial plays have to be fitted. ParameterError without a loop.
    """
    low, high = float(volts.min()), float(volts.max())
    near = _END * (high - low)
    ends = np.flatnonzero((volts <= low + near) | (volts >= high - near))
    upper = volts[ends] > low + near
    visits = np.split(ends, np.flatnonzero(np.diff(upper)) + 1)
    closes = len(visits) == 2 and abs(volts[-1] - volts[0]) < near
    if len(visits) < 3 and not closes:
        raise ParameterError(
            f"the voltage begins at {volts[0]:g} V and ends at {volts[-1]:g} V, between "
            f"{low:g} V and {high:g} V, and never goes from end to end and back; "
            "a loop ends where it began"
        )
    loops = (len(visits) - 2) // 2
    second = visits[1][np.argmax(np.abs(volts[visits[1]] - volts[visits[0][0]]))]
    return (int(second), loops) if loops else (0, 1)


@dataclass(frozen=True)
class IdentifiedActuator:
    """An actuator with its likeness to the recording that it was identified from."""

    actuator: Actuator
    gain: float  #: mean slope of the full loop, m/V
    span: float  #: full scale: range of the deflection without drift, m
    error: float  #: largest deviation from the measurement, share of full scale
    rms_error: float  #: root mean square of the deviations, share of full scale
    width: float  #: largest difference of both branches at one voltage, share of full scale
    loops: int = 1  #: whole loops that it comes from
    drift: float | None = None  #: m/s; None where the time is not known
    creep: float | None = None  #: growth in a decade of time, as a share; None if there is none
    #: voltage (V), deflection as measured and as fitted, both without drift (m); (3, means)
    curves: Array = field(default_factory=lambda: np.empty((3, 0)), repr=False, compare=False)

    def __repr__(self) -> str:
        """Say the result in one line."""
        shares = f"loop {100 * self.width:.2f} % of it, error {100 * self.error:.2f} % at most"
        return f"IdentifiedActuator(stroke {format_si(self.span, 'm')}: {shares})"

    def report(self) -> str:
        """Return one line for each of loops, stroke, width and errors, drift and creep."""
        rows = [
            ("loops", str(self.loops)),
            ("stroke", f"{1e9 * self.span:.3f} nm, as measured"),
            ("loop width", f"{100 * self.width:.2f} % of the stroke"),
            ("error left", f"{100 * self.error:.2f} % of the stroke at most"),
            ("", f"{100 * self.rms_error:.2f} % of the stroke, root mean square"),
        ]
        if self.drift is not None:
            rows.append(("drift", f"{1e9 * self.drift:.3g} nm/s, taken out"))
        if self.creep is not None:
            rows.append(("creep", f"{100 * self.creep:.2f} % in a decade of time"))
        return format_rows(rows)

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw deflection over voltage, measured and fitted, into axes, or new ones."""
        volts, measured, fitted = self.curves
        lines = [
            (volts, measured, ".", MEASURED, "measured"),
            (volts, fitted, "-", SIMULATED, "fitted"),
        ]
        return draw_lines(axes, lines, "voltage (V)", "deflection (m)")


def identify_hysteresis(
    volts: Array,
    deflection: Array,
    operators: int,
    times: Array | None = None,
    creep_start: float = 0.1,
) -> IdentifiedActuator:
    """Fit an actuator to a recording of voltage and deflection.

    volts (V), deflection (m) and times (s, if known) have shape (samples,), in the order of time,
    with at least one whole loop of the voltage; rests, minor loops and changes of amplitude are
    allowed. Samples before the voltage has been at both of its ends are used only if there is no
    other loop. Level and linear drift are removed. Creep is fitted, from creep_start (s) on, if the
    times are known and the voltage rests long enough. Play operators make point-symmetric loops;
    the asymmetry of a measured loop stays in the error. Raises ParameterError.
    """
    given = [one for one in (volts, deflection, times) if one is not None]
    if len({one.shape for one in given}) > 1 or not all(np.isfinite(one).all() for one in given):
        raise ParameterError(
            "voltage, deflection and times have to be finite numbers, as many of each: "
            f"{', '.join(str(len(one)) for one in given)}"
        )
    if times is not None and not (np.diff(times) > 0.0).all():
        raise ParameterError("the times do not increase; sort the samples by time, or leave it out")
    least = 2 * (operators + 2)
    few = f"samples; {operators} play operators take {least} or more"
    if len(volts) < least:
        raise ParameterError(f"the loop has {len(volts)} {few}")
    seen = record(times, volts, deflection)
    if len(seen.volts) - seen.first < least:
        raise ParameterError(f"without spikes there are {len(seen.volts) - seen.first} {few}")
    thresholds = 0.5 * seen.range * (np.arange(operators) + 0.5) / operators
    # As after this recording, which then repeats, or never moved.
    fresh = np.zeros(operators)
    pasts = [fresh] if seen.first else [seen.plays(thresholds, fresh)[-1], fresh]
    rests = times is not None and seen.longest_rest > _LONG * creep_start
    creeps = creep_start if rests else None
    fits = [_fit(seen, thresholds, past, times is not None, creeps) for past in pasts]
    _, lead, best = fits[0] if fits[0][0] * _LIKELIER <= fits[-1][0] else fits[-1]
    _check(seen, lead, best)
    return best


def _fit(
    seen: ActuatorRecording, thresholds: Array, past: Array, timed: bool, creep_start: float | None
) -> tuple[float, float, IdentifiedActuator]:
    """Fit the recording, given the plays (V) before its start.

    creep_start (s) is None if creep cannot be fitted. Return what is left, root mean square, the
    area by which the loops lead the voltage, share of range and full scale, and the actuator.
    """
    used = slice(seen.first, None)
    plays = seen.plays(thresholds, past)
    columns = np.column_stack([seen.volts - seen.volts[0], plays - plays[0]]) / seen.range
    scale = float(np.ptp(seen.deflection[used]))
    if not scale > _LEAST_SPAN:
        raise ParameterError(
            f"the deflection of the loops spans {scale:g} m, and {_LEAST_SPAN:g} m or more show "
            "one; is it in the second column, in m?"
        )
    wanted, volts = seen.deflection[used] / scale, seen.volts[used]
    since = seen.times - seen.times[used][0]
    drifts = timed or seen.loops > 1  # one loop without times is taken to close
    others = np.column_stack([np.ones(len(since)), *([since / since[-1]] if drifts else [])])
    weights, shares, left = _solve(columns[used], others[used], wanted)
    creep, slow = 0.0, np.zeros(len(since))
    if creep_start is not None:
        lagging, first = weights, left
        for _ in range(_ROUNDS):  # creep is small: that of the last fit is nearly that of the next
            behind, fading = _behind_creep(seen.times, columns @ lagging, creep_start)
            more = np.column_stack([others, fading, behind])
            lagging, (*also, creep), left = _solve(columns[used], more[used], wanted)
        if 0.0 < creep < _MOST_CREEP and left < (1.0 - _GAIN) * first:
            weights, shares, slow, others = lagging, np.array(also), behind, more[:, :-1]
        else:
            creep, left = 0.0, first
    clean = wanted - others[used, 1:] @ shares[1:]
    deviation = clean - shares[0] - columns[used] @ weights - creep * slow[used]
    span = float(np.ptp(clean))
    area = 0.5 * float((clean[1:] + clean[:-1]) @ np.diff(volts))
    weights = weights * scale / seen.range
    actuator = Actuator(float(weights[0]), thresholds, weights[1:])
    return left, area / (seen.range * span * seen.loops), IdentifiedActuator(
        actuator,
        gain=actuator.stroke(seen.range) / seen.range,
        span=span * scale,
        error=0.5 * float(np.ptp(deviation)) / span,
        rms_error=float(np.std(deviation)) / span,
        width=_width(actuator, seen.range),
        loops=seen.loops,
        drift=float(shares[1]) * scale / float(since[-1]) if timed else None,
        creep=float(creep) or None,
        curves=np.stack([volts, scale * clean, scale * (clean - deviation)]),
    )  # fmt: skip


def _solve(columns: Array, others: Array, wanted: Array) -> tuple[Array, Array, float]:
    """Return weights of columns, none negative, shares of others, and what both leave (RMS).

    columns has the voltage and the plays, (samples, operators + 1).
    """
    # A triangle has the same answers.
    parts = np.column_stack([columns, others, wanted])
    triangle = np.asarray(np.linalg.qr(parts, mode="r"))
    low = np.full(triangle.shape[1] - 1, -np.inf)
    low[: columns.shape[1]] = 0.0
    low[0] = _STIFFEST
    found = scipy.optimize.lsq_linear(
        triangle[:, :-1], triangle[:, -1], (low, np.inf), method="bvls"
    )
    weights, shares = np.split(found.x, [columns.shape[1]])
    return weights, shares, math.sqrt(2.0 * found.cost / len(wanted))


def _behind_creep(times: Array, x: Array, creep_start: float) -> tuple[Array, Array]:
    """Return the creep of a deflection for 1 per decade, and the decay of the initial state.

    times (s) and the deflection x, which is straight between them, have the shape (means,). The
    recording is assumed to start with a jump at the first time.
    """
    chain = Chain.of(Parameters.of(creep=_MOST_CREEP, creep_start=creep_start))
    weight, tau = chain.creep_weight / _MOST_CREEP, chain.creep_times
    share = np.diff(times)[:, None] / tau
    fades = np.exp(-share)
    late = 1.0 + np.expm1(-share) / share  # of the deflection at the end of a stretch
    gains = (1.0 - late - fades) * x[:-1, None] + late * x[1:, None]
    follows = np.empty((len(x), len(tau)))
    follows[0] = x[0]
    for k, (fade, gain) in enumerate(zip(fades, gains, strict=True)):
        follows[k + 1] = fade * follows[k] + gain
    past = np.exp(-(times[:, None] - times[0]) / tau)
    return weight * follows.sum(axis=1), weight * past.sum(axis=1)


def _check(seen: ActuatorRecording, lead: float, best: IdentifiedActuator) -> None:
    """Raise ParameterError if voltage and deflection cannot be those of an actuator."""
    slope = best.actuator.elastic + float(best.actuator.weights.sum())
    if not slope * seen.range > 2.0 * _STIFFEST * best.span:
        raise ParameterError(
            "the deflection does not rise with the voltage: the first column has to be the "
            "voltage (V), the second the deflection (m), and both have to run in time"
        )
    if best.rms_error * best.span > _UNRELATED * float(np.std(seen.deflection[seen.first :])):
        raise ParameterError(
            "the deflection does not follow the voltage; is it noise, or another column?"
        )
    gain = best.span / seen.range
    if not _GAINS[0] <= gain <= _GAINS[1]:
        raise ParameterError(
            f"the deflection goes over {format_si(best.span, 'm')} for "
            f"{format_si(seen.range, 'V')}, {gain:.2g} m/V, where actuators have {_GAINS[0]:g} to "
            f"{_GAINS[1]:g}; are both columns swapped (--columns), or is a unit another one "
            "(--units)?"
        )
    if lead > _LEADS:
        raise ParameterError(
            "the deflection runs ahead of the voltage, which no actuator's does; are both columns "
            "swapped (--columns), or is one delayed?"
        )


def _width(actuator: Actuator, full: float) -> float:
    """Return the width of the loop between 0 and full (V), share of its stroke."""
    r = actuator.thresholds  # all of them less than half of full
    volts = np.linspace(0.0, full, 201)[:, None]
    up, down = np.maximum(volts - r, r), np.minimum(volts + r, full - r)
    return float(((down - up) @ actuator.weights).max() / actuator.stroke(full))
