# SPDX-License-Identifier: Apache-2.0
"""Steps, backsteps, ringing and points of the cycles of a trace, simulated or measured.

The analysis uses the position of the runner over time, and of the actuator if known. The sampling
may be uneven. Positions at single times come from smooth fits around them, so noise of a nanometre
causes an error of a fraction of a nanometre.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.motion.settled import settled_from, settled_mean
from stickslip_ros.traces.backstep import EXACT, SETTINGS, estimate_backstep
from stickslip_ros.traces.cycles import Cycles
from stickslip_ros.traces.even_samples import noise_of
from stickslip_ros.traces.hum import HUMMING
from stickslip_ros.traces.measured_value import estimate_settled_mean
from stickslip_ros.traces.ringing import Ringing, Window, fit_ringing, may_be_folded
from stickslip_ros.traces.runs import Run

#: Length of the fit before a slip, in periods of the drive and of the ringing; of the fit after a
#: slip, in periods of the ringing.
_RUN_UP, _RINGING_BEFORE, _RINGING_AFTER = 0.1, 1.5, 1.5
#: Part of a period of ringing after a slip in which the contact slides.
_SLIDING = 0.3
#: Part of a period of the drive after the last slip that is looked at; swings of the ringing after
#: a slip where few samples show it, and that it has to be seen for.
_NEARLY, _SWINGS, _SEEN = 0.98, 4.0, 0.75
#: Where nothing rings: parts of a period for the run before a slip, and for means after it.
_QUIET_RUN_UP, _QUIET_MEAN = 0.02, 0.005
#: Time in which ringing dies away, s.
_RINGS_FOR = 5e-3
#: Fewest samples of a fit; times at which a fit is evaluated for its extremes.
_FEWEST, _LOOKS = 6, 2000


#: A fit to a run is bad if it leaves that many times the noise.
_MISFIT = 3.0


def analyse_cycles(
    time: Array,
    position: Array,
    actuator: Array | None,
    cycles: Cycles,
    noise: float | None = None,
) -> Run:
    """Analyse given cycles of a trace: times (s), runner (m), actuator (m) if known.

    noise (m) is that of a sample, estimated if not given. The estimators depend on it: to apply
    those of a noisy motion to another one, pass the noise of the noisy motion.
    """
    forward, count = cycles.direction * position, len(cycles.slips)
    windows = [_after(time, forward, cycles, k) for k in range(count)]
    ringing = _ringing_in(windows)
    first = settled_from(count)  # the last slip runs into rest
    if ringing is not None and may_be_folded(windows[first : max(count - 1, first + 1)], ringing):
        ringing = replace(ringing, folded=True)
    own_noise = noise_of(position)
    noise = own_noise if noise is None else noise
    before = np.array([_just_before(time, forward, cycles, k, ringing, noise)
                       for k in range(count)])  # fmt: skip
    levels = before
    if noise < EXACT and (cycles.ends > cycles.slips).all():
        levels = np.interp(cycles.ends, time, forward)  # as the simulation counts its steps
    step_sizes = np.diff(levels, prepend=np.interp(cycles.starts[0], time, forward))
    fits = [None if ringing is None else _after_fit(window, ringing) for window in windows]
    lowest = np.array([_lowest(window, cycles.period, ringing, fit, noise)
                       for window, fit in zip(windows, fits, strict=True)])  # fmt: skip
    backsteps = np.maximum(before - lowest[:, 1], 0.0)
    exact = own_noise < EXACT
    step = estimate_settled_mean(step_sizes, exact)
    backstep = estimate_backstep(
        time, forward, cycles, ringing, backsteps, noise, exact and noise < EXACT
    )
    few = ringing is not None and ringing.frequency * cycles.period < SETTINGS.swings
    if ringing is not None and (ringing.folded or (few and not exact)):
        backstep = replace(backstep, error=math.inf)
    return Run(
        cycles=cycles,
        step_sizes=cycles.direction * step_sizes,
        mean_step=replace(step, value=cycles.direction * step.value),
        backsteps=backsteps,
        mean_backstep=backstep,
        ringing=ringing,
        points=_points(time, forward, actuator, cycles, ringing, fits, lowest[:, 0]),
        regained=settled_mean(lowest[:, 2]),
        excitation=math.nan if actuator is None else _stroke(time, actuator, cycles),
    )


def ringing_after(time: Array, position: Array, cycles: Cycles) -> Ringing | None:
    """Return the ringing after the slips of given cycles; time (s), position (m)."""
    forward = cycles.direction * position
    return _ringing_in([_after(time, forward, cycles, k) for k in range(len(cycles.slips))])


def _ringing_in(windows: list[Window]) -> Ringing | None:
    """Return the ringing in windows; in their first part where drift and hum hide it in all."""
    ringing = fit_ringing([window for window in windows if len(window[0]) >= _FEWEST])
    if ringing is not None and ringing.frequency > HUMMING:
        return ringing
    early = [(t[t < _RINGS_FOR], x[t < _RINGS_FOR]) for t, x in windows]
    shorter = fit_ringing([window for window in early if len(window[0]) >= _FEWEST])
    if shorter is None and ringing is not None and ringing.decay > 2.0 * ringing.decay_error:
        return ringing  # hum does not decay
    return shorter


def _between(t: Array, x: Array, begin: float, end: float) -> Window:
    part = slice(*np.searchsorted(t, [begin, end]))
    return t[part], x[part]


def _after(t: Array, x: Array, cycles: Cycles, k: int) -> Window:
    """Return the samples after slip k, up to the next slip; times from the end of the slip."""
    begin = float(cycles.ends[k])
    last = k + 1 == len(cycles.slips)
    end = begin + _NEARLY * cycles.period if last else float(cycles.slips[k + 1])
    times, positions = _between(t, x, begin, end)
    if cycles.ends[k] == cycles.slips[k]:  # found to a sample only: that one may lie in the slip
        times, positions = times[1:], positions[1:]
    return times - begin, positions


def _design(t: Array, origin: float, scale: float, ringing: Ringing | None) -> Array:
    design = np.column_stack([np.ones_like(t), (t - origin) / scale])
    return design if ringing is None else np.hstack([design, ringing.columns(t - origin)])


def _just_before(
    t: Array, x: Array, cycles: Cycles, k: int, ringing: Ringing | None, noise: float
) -> float:
    """Return the position just before slip k, from a fit to the run up to it."""
    slip, start = float(cycles.slips[k]), float(cycles.starts[k])
    if ringing is None:
        length = _QUIET_RUN_UP * cycles.period
    else:
        length = max(_RUN_UP * cycles.period, _RINGING_BEFORE / ringing.frequency)
    begin = max(slip - length, start)
    times, positions = _between(t, x, begin, slip)
    if len(times) < _FEWEST:
        if cycles.ends[k] > cycles.slips[k]:
            return float(np.interp(slip, t, x))
        return float(x[max(int(np.searchsorted(t, slip)) - 1, 0)])  # the next may be in the fall
    design = _design(times, begin, length, ringing)
    found, *_ = np.linalg.lstsq(design, positions, rcond=None)
    left = float(np.sqrt(np.mean((design @ found - positions) ** 2)))
    if ringing is not None and left > _MISFIT * noise + EXACT:  # the runner does not ring so
        return _just_before(t, x, cycles, k, None, noise)
    return float((_design(np.array([slip]), begin, length, ringing) @ found)[0])


def _lowest(
    window: Window, period: float, ringing: Ringing | None, fit: Array | None, noise: float
) -> tuple[float, float, float]:
    """Return time (s after the slip) and position (m) of the lowest point, and the rest above (m).

    fit is that of trend and ringing in the window. nan for values that cannot be measured.
    """
    t, x = window
    first = t <= 0.5 * period
    if noise < EXACT and first.sum() >= _FEWEST:
        time, low = _vertex(t, x, int(np.argmin(x[first])))
        return time, low, math.nan if fit is None else float(fit[0] - low)
    if ringing is None:
        return *find_lowest_mean(t, x, period), math.nan
    if fit is None:
        return math.nan, math.nan, math.nan
    times, design = _first_swing(ringing)
    values = design @ fit
    at = int(np.argmin(values))
    return float(times[at]), float(values[at]), float(fit[0] - values[at])


def _vertex(t: Array, x: Array, at: int) -> tuple[float, float]:
    """Return time (s) and height (m) of the lowest point of a parabola through three samples.

    at is the lowest sample, which counts itself where it is the first or the last one.
    """
    if not 0 < at < len(x) - 1:
        return float(t[at]), float(x[at])
    before, after = t[at - 1] - t[at], t[at + 1] - t[at]
    left, right = (x[at - 1] - x[at]) / before, (x[at + 1] - x[at]) / after
    bend = (right - left) / (after - before)
    if not bend > 0.0:
        return float(t[at]), float(x[at])
    slope = left - bend * before
    return float(t[at] - 0.5 * slope / bend), float(x[at] - 0.25 * slope**2 / bend)


def find_lowest_mean(t: Array, x: Array, period: float) -> tuple[float, float]:
    """Return when (s after the slip) the mean over a while is lowest, and where (m).

    nan for samples further apart than two such whiles: the runner may fall and rise between them.
    """
    first = t <= 0.5 * period
    t, x = t[first], x[first]
    width = max(1, int(np.sum(t <= _QUIET_MEAN * period)))
    if len(t) < max(width, 3) or t[1] - t[0] > 2.0 * _QUIET_MEAN * period:
        return math.nan, math.nan
    mean = np.convolve(x, np.full(width, 1.0 / width), mode="valid")
    at = int(np.argmin(mean))
    return float(t[at : at + width].mean()), float(mean[at])


def _after_fit(window: Window, ringing: Ringing) -> Array | None:
    """Fit trend and ringing after a slip, if there are enough samples.

    The first part, in which the contact slides, is left out.
    """
    t, x = window
    scale = 1.0 / ringing.frequency
    for first, last in ((_SLIDING, _RINGING_AFTER), (0.0, _RINGING_AFTER), (0.0, _SWINGS)):
        kept = (t >= first * scale) & (t <= last * scale)
        if kept.sum() >= 2 * _FEWEST:
            break
    if kept.sum() < _FEWEST or t[kept][-1] < _SEEN * scale:
        return None
    found, *_ = np.linalg.lstsq(_design(t[kept], 0.0, scale, ringing), x[kept], rcond=None)
    return found.astype(np.float64)


def _stroke(t: Array, u: Array, cycles: Cycles) -> float:
    """Return the actuator's deflection peak to peak, mean over the settled cycles, m."""
    strokes = [
        np.ptp(part) if len(part) else math.nan
        for part in (
            _between(t, u, start, end)[1]
            for start, end in zip(cycles.starts, cycles.ends, strict=True)
        )
    ]
    return settled_mean(np.array(strokes))


def _points(
    t: Array,
    x: Array,
    u: Array | None,
    cycles: Cycles,
    ringing: Ringing | None,
    fits: list[Array | None],
    falling: Array,
) -> dict[str, Array]:
    count = len(cycles.slips)
    found = {name: np.full(count, math.nan) for name in "ABCDEF"}
    found["A"], found["C"] = cycles.starts.copy(), cycles.slips.copy()
    found["E"] = cycles.ends + falling
    if ringing is None:
        return found
    period = 1.0 / ringing.frequency
    for k, fit in enumerate(fits):
        if fit is not None:  # the swing after the lowest point passes its middle: no force
            ahead = period / (2.0 * math.pi) * (math.atan2(fit[3], fit[2]) - 0.5 * math.pi)
            late = (ahead - falling[k]) % period
            found["F"][k] = found["E"][k] + (late if late < 0.5 * period else 0.0)
        if u is None:
            continue
        start = float(cycles.starts[k])
        times, positions = _between(t, x, start, float(cycles.slips[k]))
        rise = _after_fit((times - start, positions), ringing)
        if rise is not None:
            rising = _between(t, cycles.direction * u, start, start + 2.0 * period)
            rate = float(np.polyfit(*rising, 1)[0]) if len(rising[0]) > 2 else math.nan
            swing, design = _first_swing(ringing)
            fast = np.gradient(design @ rise, swing)[1:] >= rate  # as fast as the actuator
            found["B"][k] = start + (swing[1:][np.argmax(fast)] if fast.any() else math.nan)
    return found


@lru_cache(maxsize=1)
def _first_swing(ringing: Ringing) -> tuple[Array, Array]:
    """Return times (s) over one period of ringing and the design of a fit at them."""
    period = 1.0 / ringing.frequency
    times = np.linspace(0.0, period, _LOOKS)
    return times, _design(times, 0.0, period, ringing)
