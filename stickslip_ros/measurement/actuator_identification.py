# SPDX-License-Identifier: Apache-2.0
"""From a recording of an actuator to the play operators that repeat it.

The deflection is linear in the weights once the thresholds are chosen, and weights of a piezo
actuator are not negative: least squares with that bound has one answer (K. Kuhnen, European
Journal of Control 9 (2003) 407, has the bound too). Level and drift are fitted along, and so is
creep as `model.actuator_chain` has it, for which the answer is sought along one number.

A recording is cut at the turning points of the voltage. Between two of them the voltage rises or
falls, and the state of a play operator follows from its state at the first one. Changes below
`_LEAST_WAY` of the range, or within the noise, do not count.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy  # its parts load when they are used, which takes half a second
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import MEASURED, SIMULATED, draw_lines, format_si
from stickslip_ros.base.reporting.terminal import format_rows
from stickslip_ros.measurement.steps.noise import noise_of, without_spikes
from stickslip_ros.physics.model.actuator import Actuator
from stickslip_ros.physics.model.actuator_chain import Chain
from stickslip_ros.physics.parameters import ParameterError, Parameters

if TYPE_CHECKING:
    from matplotlib.axes import Axes


#: Least distance of two turning points, as a share of the range of the voltage, and in standard
#: deviations of its noise.
_LEAST_WAY, _NOISES = 0.01, 12.0
#: Largest noise, as share of the range, at which turning points can be found.
_NOISY = 0.5
#: A turning point so near to an end of the range, as a share of it, is at that end.
_END = 0.1
#: A voltage that changes by less than this share of the range stays where it is.
_STILL = 0.005
#: Samples that a fit sees at most, means of neighbours; neighbours whose lowest and highest may be
#: turning points.
_MOST, _SOUGHT = 20_000, 20_000
#: What counts as noise in a spike, as share of the range: a spike is eight times as far off.
_RIPPLE = 0.006
#: The range of a recording but for its spikes.
_RANGE = (0.001, 0.999)
#: Least weight of the voltage itself, as part of the mean slope: it moves every actuator.
_STIFFEST = 1e-3
#: Least deflection that is one, m: far below it, shares of it overflow.
_LEAST_SPAN = 1e-15
#: Largest creep per decade in the search, as a larger lag is not creep; part of it that is at the
#: bound; values that are tried first.
_MOST_CREEP, _BOUND, _TRIED = 0.1, 0.98, 11
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
    """Means of neighbouring samples, (means,), and the turning points between them, (turns,).

    The first and the last sample count as turning points.
    """

    times: Array  #: s, or numbers of samples where the time is not known
    volts: Array  #: V
    deflection: Array  #: m
    branch: NDArray[np.int64]  #: number of the turning point before each mean
    turn_volts: Array  #: voltage at each turning point
    first: int  #: the first mean from which on no earlier past plays a part; 0 if there is none
    loops: int  #: whole loops from there on

    @property
    def range(self) -> float:
        """Highest less lowest voltage (V)."""
        return float(np.ptp(self.turn_volts))

    @cached_property
    def longest_rest(self) -> float:
        """Longest time (s) from `first` on in which the voltage stays where it is."""
        near, longest = _STILL * self.range, 0.0
        times, volts = self.times[self.first :].tolist(), self.volts[self.first :].tolist()
        begin, low, high = times[0], volts[0], volts[0]
        for time, volt in zip(times, volts, strict=True):
            low, high = min(low, volt), max(high, volt)
            if high - low > near:
                begin, low, high = time, volt, volt
            longest = max(longest, time - begin)
        return longest

    def plays(self, thresholds: Array, start: Array) -> tuple[Array, Array]:
        """Return the plays (V) at each mean, (means, operators), and after the last.

        thresholds and start, the plays before the first sample, are in V, (operators,).
        """
        stands = np.empty((len(self.turn_volts), len(thresholds)))
        stand = start
        for k, volts in enumerate(self.turn_volts):
            stands[k] = stand = np.clip(stand, volts - thresholds, volts + thresholds)
        rises = np.diff(self.turn_volts) > 0.0
        before, volts = stands[self.branch], self.volts[:, None]
        up = np.maximum(before, volts - thresholds)
        down = np.minimum(before, volts + thresholds)
        return np.where(rises[self.branch][:, None], up, down), stands[-1]


def record(times: Array | None, volts: Array, deflection: Array) -> ActuatorRecording:
    """Cut a recording; times (s), volts (V) and deflection (m) have the shape (samples,).

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
    times = np.flatnonzero(kept).astype(np.float64) if times is None else times[kept]
    turns = _turning_points(volts)
    first, loops = _settled(volts[turns])
    share = -(-len(volts) // _MOST)
    starts = np.union1d(np.arange(0, len(volts), share), turns[1:-1])
    counts = np.diff(np.append(starts, len(volts)))
    means = [np.add.reduceat(one, starts) / counts for one in (times, volts, deflection)]
    branch = np.searchsorted(turns[1:-1], starts, side="right")
    return ActuatorRecording(
        times=means[0],
        volts=means[1],
        deflection=means[2],
        branch=branch,
        turn_volts=volts[turns],
        first=int(np.searchsorted(starts, turns[first])),
        loops=loops,
    )


def _turning_points(volts: Array) -> NDArray[np.int64]:
    """Return the places of the turning points in volts, both ends included. ParameterError."""
    whole, noise = float(np.ptp(volts)), noise_of(volts)
    least = max(_LEAST_WAY * whole, _NOISES * noise)
    if least > _NOISY * whole:
        raise ParameterError(
            f"the voltage goes over {whole:.3g} V and has {noise:.3g} V of noise: no loop is to be "
            "seen in it; is that the column of the voltage?"
        )
    share = max(1, len(volts) // _SOUGHT)
    rows = volts[: len(volts) // share * share].reshape(-1, share)
    # The lowest and the highest of neighbours are enough.
    lowest, highest = (np.arange(0, rows.size, share) + one
                       for one in (rows.argmin(axis=1), rows.argmax(axis=1)))  # fmt: skip
    found = [0, len(volts) - 1]
    for sign, places in ((1.0, highest), (-1.0, lowest)):
        # An end of the recording is as far from the next turning point as any.
        seen = np.pad(sign * volts[places], 1, constant_values=-np.abs(volts).max() - whole)
        found += places[scipy.signal.find_peaks(seen, prominence=least)[0] - 1].tolist()
    return np.unique(found)


def _settled(turns: Array) -> tuple[int, int]:
    """Return the turning point from which on the plays are known, and the number of loops after it.

    The plays are known once the voltage has been at both of its ends. 0 if no whole loop follows:
    then the initial plays have to be fitted. ParameterError without a loop.
    """
    low, high = float(turns.min()), float(turns.max())
    near = _END * (high - low)
    ends = [(k, volts > low + near) for k, volts in enumerate(turns.tolist())
            if not low + near < volts < high - near]  # fmt: skip
    met = [end for end, before in zip(ends, [None, *ends], strict=False)
           if before is None or end[1] != before[1]]  # fmt: skip
    closes = len(met) == 2 and abs(turns[-1] - turns[0]) < near
    if len(met) < 3 and not closes:
        raise ParameterError(
            f"the voltage begins at {turns[0]:g} V and ends at {turns[-1]:g} V, between "
            f"{low:g} V and {high:g} V, and never goes from end to end and back; "
            "a loop ends where it began"
        )
    later = (len(met) - 2) // 2
    return (met[1][0], later) if later else (0, 1)


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
    given = [volts, deflection, *([] if times is None else [times])]
    if len({one.shape for one in given}) > 1 or not all(np.isfinite(one).all() for one in given):
        raise ParameterError(
            "voltage, deflection and times have to be finite numbers, as many of each: "
            f"{', '.join(str(len(one)) for one in given)}"
        )
    if times is not None and not (np.diff(times) > 0.0).all():
        raise ParameterError("the times do not increase; sort the samples by time, or leave it out")
    least = 2 * (operators + 2)
    if len(volts) < least:
        raise ParameterError(
            f"the loop has {len(volts)} samples; {operators} play operators take {least} or more"
        )
    seen = record(times, volts, deflection)
    if len(seen.volts) - seen.first < least:
        raise ParameterError(f"{len(seen.volts) - seen.first} samples without spikes; "
                             f"{operators} play operators take {least} or more")  # fmt: skip
    thresholds = 0.5 * seen.range * (np.arange(operators) + 0.5) / operators
    # As after this recording, which then repeats, or never moved.
    fresh = np.zeros(operators)
    pasts = [fresh] if seen.first else [seen.plays(thresholds, fresh)[1], fresh]
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
    plays, _ = seen.plays(thresholds, past)
    columns = np.column_stack([seen.volts - seen.volts[0], plays - plays[0]]) / seen.range
    scale = float(np.ptp(seen.deflection[used]))
    if not scale > _LEAST_SPAN:
        raise ParameterError(
            f"the deflection of the loops spans {scale:g} m, and {_LEAST_SPAN:g} m or more show "
            "one; is it in the second column, in m?"
        )
    wanted = seen.deflection[used] / scale
    since = seen.times - seen.times[used][0]
    drifts = timed or seen.loops > 1  # one loop without times is taken to close
    others = np.column_stack([np.ones(len(since)), *([since / since[-1]] if drifts else [])])
    solve, creep = _solver(others[used], columns[used], wanted), 0.0
    if creep_start is not None:
        slow, fading = _behind_creep(seen.times, columns, creep_start)
        with_past = np.column_stack([others, fading])
        lagging = _solver(with_past[used], columns[used], wanted, slow[used])
        creep = _creep_of(solve, lagging)
        if creep > 0.0:
            solve, others, columns = lagging, with_past, columns + creep * slow
    weights, left = solve(creep)
    rest, others = wanted - columns[used] @ weights, others[used]
    shares = np.linalg.lstsq(others, rest, rcond=None)[0]
    clean, deviation = wanted - others[:, 1:] @ shares[1:], rest - others @ shares
    span, volts = float(np.ptp(clean)), seen.volts[used]
    area = 0.5 * float((clean[1:] + clean[:-1]) @ np.diff(volts))
    weights *= scale / seen.range
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
        creep=creep or None,
        curves=np.stack([volts, scale * clean, scale * (clean - deviation)]),
    )  # fmt: skip


#: Weights, not negative, and root mean square of the residuals for a creep per decade.
_Solver = Callable[[float], tuple[Array, float]]


def _solver(others: Array, columns: Array, wanted: Array, slow: Array | None = None) -> _Solver:
    """Return the solver of a least squares problem with the columns of others projected out.

    columns has the voltage and the plays, (samples, operators + 1), slow the same behind creep.
    """
    parts = [others, columns, *([] if slow is None else [slow]), wanted[:, None]]
    # A triangle has the same answers.
    triangle = np.asarray(np.linalg.qr(np.column_stack(parts), mode="r"))
    rest, n = triangle[others.shape[1] :, others.shape[1] :], columns.shape[1]

    def solve(creep: float) -> tuple[Array, float]:
        plain = rest[:, :n] if slow is None else rest[:, :n] + creep * rest[:, n:-1]
        weights, left = scipy.optimize.nnls(plain, rest[:, -1] - _STIFFEST * plain[:, 0])
        weights[0] += _STIFFEST
        return np.asarray(weights), float(left) / math.sqrt(len(wanted))

    return solve


def _creep_of(without: _Solver, lagging: _Solver) -> float:
    """Return the creep per decade with the smallest residual; 0 if it is hardly smaller."""

    def left(creep: float) -> float:
        return lagging(creep)[1]

    tried = np.linspace(0.0, _MOST_CREEP, _TRIED)
    best = tried[int(np.argmin([left(one) for one in tried.tolist()]))]
    step = float(tried[1])
    bounds = (max(0.0, best - step), min(_MOST_CREEP, best + step))
    creep = float(scipy.optimize.minimize_scalar(left, bounds=bounds, method="bounded").x)
    helps = left(creep) < (1.0 - _GAIN) * without(0.0)[1]
    return creep if helps and creep < _BOUND * _MOST_CREEP else 0.0


def _behind_creep(times: Array, columns: Array, creep_start: float) -> tuple[Array, Array]:
    """Return the creep of each column for 1 per decade, and the decay of the initial state.

    times (s) has the shape (means,), columns (means, n); columns are straight between their times.
    The recording is assumed to start with a jump at the first time.
    """
    chain = Chain.of(Parameters.of(creep=_MOST_CREEP, creep_start=creep_start))
    weight, tau = chain.creep_weight / _MOST_CREEP, chain.creep_times
    share = np.diff(times)[:, None] / tau
    fades = np.exp(-share)
    late = 1.0 + np.expm1(-share) / share  # of the column at the end of a stretch
    late = np.where(share > 1e-5, late, 0.5 * share)
    early = 1.0 - late - fades
    follows = np.repeat(columns[:1], len(tau), axis=0)
    found = np.empty_like(columns)
    found[0] = follows.sum(axis=0)
    for k in range(len(times) - 1):
        follows *= fades[k, :, None]
        follows += early[k, :, None] * columns[k] + late[k, :, None] * columns[k + 1]
        found[k + 1] = follows.sum(axis=0)
    past = np.exp(-(times[:, None] - times[0]) / tau).sum(axis=1)
    return weight * found, weight * past


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
