# SPDX-License-Identifier: Apache-2.0
"""One measured motion, and the known parameters of its drive.

Before a fit, each contradiction of record and drive file, and each gap of a record, gets a message
with the numbers and the cure. The fit is done nevertheless, but without intervals if no record
shows the ringing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.base.reporting import format_si
from stickslip_ros.measurement.steps.analysis import determined_part, runs_of, why_left_out
from stickslip_ros.measurement.steps.disturbances import HARMONICS, MAINS
from stickslip_ros.measurement.steps.drive import Drive
from stickslip_ros.measurement.steps.noise import noise_of
from stickslip_ros.measurement.steps.ringing import Ringing
from stickslip_ros.measurement.steps.run import Run
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.model.low_pass import LowPass
from stickslip_ros.physics.model.waveforms import command_of
from stickslip_ros.physics.parameters import PARAMETERS, Parameters
from stickslip_ros.physics.solver.driven import simulation_of
from stickslip_ros.simulation.motion import Motion

#: Samples that runs are searched for in at most, and samples in a swing of the model's ringing that
#: their means keep at least: it may be several times as fast as the file says.
_SEARCHED, _FINE = 60_000, 30.0
#: Chance that a record of fresh samples repeats a value as often; noise (m) that any sensor has:
#: simulated records have less, and rest at 0.
_REPEATED, _LEAST_NOISE = 1e-4, 1e-12
#: Ratio of ringing to drive frequency at least; part of a harmonic of the mains within which it may
#: be hum.
_RINGING_OVER_DRIVE, _NEAR_HUM = 2.0, 0.05
#: Periods of rest without which the axis may have stepped before; periods after a run within which
#: the record may end with another cycle; cycles that are simulated before the start then.
_REST_BEFORE, _BEYOND, _LEAD_IN = 0.05, 1.1, 10
#: Difference of steps of alike runs, as a part and in standard errors, that the axis has changed by
_CHANGED_PART, _CHANGED_ERRORS = 0.08, 5.0
#: Samples in a swing without which the contact cannot be told; steps of a run without which its
#: frequency and size scatter too much; factor by which a stated noise may be off.
SAMPLES_A_SWING, FEW_STEPS, _NOISE_FACTOR = 4.0, 4, 3.0
#: Largest and smallest step, as parts of the stroke of the actuator; largest stroke (m) of any
#: actuator of a stick-slip drive.
_LONGEST_STEP, _SHORTEST_STEP, _LONGEST_STROKE = 1.1, 1e-3, 1e-4
#: Periods without samples in which the begin or the end of a run is not seen.
_SEEN = 0.5
#: Looks of a slow sensor in a swing of the ringing, and in a period of its bandwidth.
_LOOKS, _LOOKS_OF_SENSOR = 60.0, 12.0
#: Ratio of ringing and bandwidth up to which delay and width describe the low-pass of a sensor.
_FAST_SENSOR = 0.1


class IdentificationError(StickslipError, ValueError):
    """Nothing can be identified from the measurements; the message says what to change."""


@dataclass(frozen=True)
class Stepping:
    """Cycles of the drive in one go, as the measurement shows them."""

    start: float  #: by the clock of the measurement, s
    steps: int  #: sign: direction
    frequency: float  #: Hz

    @property
    def end(self) -> float:
        """When the last cycle ends, s."""
        return self.start + abs(self.steps) / self.frequency


@dataclass(frozen=True)
class Experiment:
    """A measured motion and the parameters of the drive that made it."""

    parameters: Parameters  #: known values, and starting values of free parameters
    motion: Motion  #: as measured
    runs: tuple[Stepping, ...]  #: the runs of the drive
    ringing: Ringing | None = None  #: as seen after the slips
    before: bool = False  #: the axis stepped before the measurement began
    doubtful: bool = False  #: starts and numbers of steps may be wrong by one
    beyond: bool = False  #: the axis stepped on after the last visible slip
    left_out: tuple[str, ...] = ()  #: samples that repeat others, and runs, in words
    #: "point" or "mean": samples are of an instant, or means over the time from one to the next
    samples: str | None = None

    @property
    def steps(self) -> int:
        """Steps of all runs, those forward and those backward."""
        return sum(abs(run.steps) for run in self.runs)

    @classmethod
    def of(cls, parameters: Parameters, motion: Motion, samples: str | None = None) -> Experiment:
        """Find the runs of the drive in a measurement.

        samples: "point" or "mean", None if that is not known. Raises IdentificationError if the
        measurement shows no steps, or a motion that is impossible with the drive.
        """
        frequency = parameters.drive.frequency
        _refuse_impossible(parameters, motion)
        motion, repeats = without_repeats(motion)
        found = _runs_in(parameters, motion)
        if not found:
            raise IdentificationError(
                f"{motion.source} shows no steps at {frequency:g} Hz; correct the frequency in the "
                "parameters, cut the measurement, name the column of the runner if this is the "
                "actuator's (--columns), or measure anew: at a larger amplitude if steps may be "
                "below the noise, with rests of two periods around fewer than three steps"
            )
        motion, kept = determined_part(motion, found)
        motion = _without_far_side(motion, kept, _SEEN / frequency)
        left_out = [
            f"{motion.source}: the {one.steps} steps from {one.span} are left out: {why}"
            for one, why in zip(found, why_left_out(found, kept), strict=True)
            if why
        ]
        left_out += [
            f"{motion.source}: the {one.steps} steps from {one.span} are fitted, but not "
            f"determined: {'; '.join(one.doubts)}"
            for one in kept
            if one.doubts
        ]
        _refuse_changes(motion, kept)
        doubtful = any(one.doubts or _is_hum(one.ringing_frequency, frequency) for one in kept)
        main = max(kept, key=lambda one: one.steps)
        ringing = main.ringing
        if not main.decay > 0.0 or _is_hum(main.ringing_frequency, frequency):
            ringing = None
        runs = tuple(Stepping(one.start, one.direction * one.steps, frequency) for one in kept)
        said = (*repeats, *left_out)
        return cls(
            parameters, motion, runs, ringing, doubtful=doubtful, left_out=said, samples=samples
        )

    @cached_property
    def slip(self) -> tuple[float, float]:
        """When the slip of the drive begins and ends, s after the begin of the cycle."""
        cycle = command_of(self.parameters)
        begin = float(np.sum(cycle.durations[: cycle.slip]))
        return begin, begin + cycle.slip_duration

    @property
    def variants(self) -> list[Experiment]:
        """The possible runs of the drive, if the measurement does not show the rest about them."""
        plain = replace(self, before=False, beyond=False)
        found = [plain]
        first, last = self.runs[0], self.runs[-1]
        if first.start < self.motion.t[0] + _REST_BEFORE / first.frequency:
            found.append(replace(plain, before=True))
        if last.end < self.motion.t[-1] < last.end + _BEYOND / last.frequency:
            found += [replace(one, beyond=True) for one in found]
        return found

    @property
    def unsure(self) -> tuple[float, float]:
        """The part of the measurement (s, s) in which all variants are equal after settling."""
        first, last = self.runs[0], self.runs[-1]
        begin, end = -math.inf, math.inf
        variants = self.variants
        if any(one.before for one in variants):
            begin = first.start + min(3, abs(first.steps) // 2) / first.frequency
        if any(one.beyond for one in variants):
            end = last.end
        return begin, end

    def simulate(self, p: Parameters, starts: Array, times: Array) -> tuple[Array, Array]:
        """Return position (m) and velocity (m/s), behind the sensor, at times (s) that rise.

        The axis has the parameters p, rests at x = 0 before its first run, and begins its runs at
        starts (s). ParameterError, SolverError.
        """
        # The variation along the track is not known for a measured axis.
        even = p
        if p.friction.surface_spread or p.friction.slip_spread:
            even = p.replace(surface_spread=0.0, slip_spread=0.0)
        # Without a memory the settled loop of a hysteresis runs, with and without a lag.
        simulation = simulation_of(even, Plant.of(even), settled=not p.actuator.actuator_memory)
        sensor, wanted = delay_and_width(p), times
        late, width = sensor or (0.0, 0.0)
        times = times - late
        if sensor is None:  # its past counts
            rate = max(_LOOKS * Plant.of(p).ringing_frequency, _LOOKS_OF_SENSOR * _bandwidth(p))
            count = math.ceil(float(times[-1] - times[0]) * rate)
            times = np.linspace(times[0], times[-1], max(count, 2))
        x, v = np.zeros(len(times)), np.zeros(len(times))
        at = int(np.searchsorted(times, starts[0])) if not self.before else 0
        for k, run in enumerate(self.runs):
            drive_cycle = command_of(p, 1 if run.steps > 0 else -1)
            begin, count = float(starts[k]), abs(run.steps)
            last = k == len(self.runs) - 1
            if k == 0:
                ahead = _LEAD_IN if self.before else 0
                origin = begin - ahead * drive_cycle.period
                count += ahead
            else:
                simulation.advance(max(begin - origin, simulation.state.t))
            if last and self.beyond:
                count += 2
            simulation.start(drive_cycle, count)
            end = math.inf if last else float(starts[k + 1])
            until = max(int(np.searchsorted(times, end)), at)
            seen = simulation.sample(np.maximum(times[at:until] - origin, simulation.t))
            x[at:until], v[at:until] = seen.x, seen.v
            at = until
        if sensor is None:
            return _behind(p, times, x, v, wanted)
        if width:
            x, v = x + 0.5 * width * bend_of(times, x), v + 0.5 * width * bend_of(times, v)
        return x, v


def bend_of(t: Array, x: Array) -> Array:
    """Return second derivatives of x at rising times t from neighbours, at the ends the next."""
    step = np.diff(t)
    inside = 2.0 * np.diff(np.diff(x) / step) / (step[1:] + step[:-1])
    return np.concatenate([inside[:1], inside, inside[-1:]])


def _bandwidth(p: Parameters) -> float:
    """Return the bandwidth of the sensor, Hz; 0 without one."""
    return p.sensor.sensor_bandwidth or 0.0


def _behind(p: Parameters, t: Array, x: Array, v: Array, wanted: Array) -> tuple[Array, Array]:
    """Return position (m) and velocity (m/s) behind the sensor at some of even times t (s)."""
    step = float(t[1] - t[0])
    slow = LowPass(p.sensor, step, float(x[0])).filter(x, v)
    rate = LowPass(p.sensor, step, 0.0).filter(v, np.gradient(v, step))
    found = scipy.interpolate.CubicHermiteSpline(t, slow, rate)(wanted)
    return np.asarray(found), np.interp(wanted, t, rate)


def delay_and_width(p: Parameters) -> tuple[float, float] | None:
    """Return by how much a sensor is late (s), and its squared width (s^2); None if it is slow.

    ln H(s) = -delay s + width s^2 / 2 - ... describes a low-pass that is far faster than the axis.
    """
    sensor = p.sensor
    if not sensor.sensor_bandwidth:
        return 0.0, 0.0
    if Plant.of(p).ringing_frequency > _FAST_SENSOR * sensor.sensor_bandwidth:
        return None
    time = 1.0 / (2.0 * math.pi * sensor.sensor_bandwidth)
    if sensor.sensor_order == 1:
        return time, time**2
    damping = sensor.sensor_damping
    return 2.0 * damping * time, (4.0 * damping**2 - 2.0) * time**2


def _runs_in(p: Parameters, motion: Motion) -> list[Run]:
    """Return the runs at the known frequency; many samples are averaged first, which is quicker."""
    swing = 1.0 / max(Plant.of(p).ringing_frequency, p.drive.frequency)
    many = min(len(motion.t) / _SEARCHED, swing / (_FINE * motion.spacing))
    each = max(1, math.ceil(many) if many > 1.0 else 1)
    whole = len(motion.t) // each * each
    t, x = (one[:whole].reshape(-1, each).mean(axis=1) for one in (motion.t, motion.x))
    return runs_of(replace(motion, t=t, x=x, v=None, u=None), Drive.given(p.drive.frequency))


def _without_far_side(motion: Motion, runs: Sequence[Run], longest: float) -> Motion:
    """Return a motion without what lies beyond gaps, longer than a time (s), in which runs end."""
    begins = np.flatnonzero(np.diff(motion.t) > longest)
    first, last = -math.inf, math.inf
    for begin, end in zip(motion.t[begins].tolist(), motion.t[begins + 1].tolist(), strict=True):
        if begin < runs[0].start < end:
            first = end
        elif begin < runs[-1].end < end:
            last = begin
    return motion.between(first, last)


def _refuse_impossible(p: Parameters, motion: Motion) -> None:
    """Raise IdentificationError where no axis moves like this: wrong units, or wrong columns."""
    stroke = p.drive.amplitude * p.actuator.gain_in_force
    if stroke > _LONGEST_STROKE:
        raise IdentificationError(
            f"amplitude and gain make the actuator go {format_si(stroke, 'm', 3)}, and no actuator "
            f"of a stick-slip drive goes farther than {format_si(_LONGEST_STROKE, 'm')}; gain is "
            "in m/V"
        )
    if motion.duration < 1.0 / p.drive.frequency:
        raise IdentificationError(
            f"{motion.source} takes {format_si(motion.duration, 's', 3)}, less than a cycle of "
            f"{p.drive.frequency:g} Hz; check the unit of the time, or correct the frequency"
        )
    later = np.interp(motion.t + 1.0 / p.drive.frequency, motion.t, motion.x)
    inside = motion.t + 1.0 / p.drive.frequency <= motion.t[-1]
    # Half of all cycles: a sensor may jump, and drift.
    cycle = float(np.quantile(np.abs(later - motion.x)[inside], 0.5))
    if cycle > _LONGEST_STEP * stroke:
        raise IdentificationError(
            f"{motion.source} moves by {format_si(cycle, 'm', 3)} in a cycle of "
            f"{p.drive.frequency:g} Hz, and the actuator goes {format_si(stroke, 'm', 3)}: no "
            "runner outruns it; are the columns of runner and actuator swapped (--columns), or are "
            "the units of the record, amplitude, gain or frequency others?"
        )


def without_repeats(motion: Motion) -> tuple[Motion, tuple[str, ...]]:
    """Return a motion without values that a recorder repeats, which are no data; and how many.

    A new sample repeats the last one by chance, more seldom the finer the record is beside its
    noise. Where it is coarser, as long as most of its values stand.
    """
    x = motion.x
    jumps = np.abs(np.diff(x))
    begins = np.flatnonzero(np.append(1.0, jumps))
    stand = np.diff(begins, append=len(x))
    noise, step = noise_of(x[begins]), float(np.min(jumps[jumps > 0.0], initial=math.inf))
    if not noise > _LEAST_NOISE or not step < math.inf:
        return motion, ()
    # Differences of noise have 2 sqrt(pi) times its deviation as the inverse of their density at 0.
    chance = step / (2.0 * math.sqrt(math.pi) * noise)
    if noise < 2.0 * step:
        chance = 0.01 ** (1.0 / float(np.quantile(stand, 0.99)))
    longest = 1.0 + math.log(_REPEATED / len(x)) / math.log(chance)
    if stand.max() <= longest:
        return motion, ()
    again = np.repeat(stand > longest, stand)
    again[begins] = False
    first = float(motion.t[begins[np.argmax(stand)]])
    text = (
        f"{motion.source}: {100.0 * float(np.mean(again)):.2g} % of the samples repeat the value "
        f"before, longest for {format_si(motion.spacing * float(stand.max()), 's', 3)} from "
        f"{first:.4g} s on; they are no data and left out"
    )
    return Motion(motion.source, motion.t[~again], x[~again]), (text,)


def _refuse_changes(motion: Motion, runs: Sequence[Run]) -> None:
    """Raise IdentificationError if equal runs have different steps: drive or axis changed."""
    for other, one in combinations(runs, 2):
        if one.direction != other.direction or min(one.steps, other.steps) < FEW_STEPS:
            continue
        difference = abs(one.step_size - other.step_size)
        error = math.hypot(one.step_size_error, other.step_size_error)
        larger = max(abs(one.step_size), abs(other.step_size))
        if difference > max(_CHANGED_PART * larger, _CHANGED_ERRORS * error):
            raise IdentificationError(
                f"{motion.source}: the run at {other.start:.4g} s steps "
                f"{format_si(abs(other.step_size), 'm')}, the one at {one.start:.4g} s "
                f"{format_si(abs(one.step_size), 'm')}: amplitude, preload or load changed between "
                "them; cut the measurement there, and give each part as a --run of its own"
            )


def _is_hum(found: float, frequency: float) -> bool:
    """Return whether an oscillation (Hz) is the drive's or the mains'; False for nan."""
    hum = [harmonic * mains for mains in MAINS for harmonic in range(1, HARMONICS + 1)]
    return found < _RINGING_OVER_DRIVE * frequency or any(
        abs(found / one - 1.0) < _NEAR_HUM for one in hum
    )


def check_record(experiment: Experiment) -> Iterator[str]:
    """Yield messages about a record before it is fitted, one line each."""
    p, motion = experiment.parameters, experiment.motion
    yield from experiment.left_out
    ringing = experiment.ringing.frequency if experiment.ringing else Plant.of(p).ringing_frequency
    rate, stroke = 1.0 / motion.spacing, p.drive.amplitude * p.actuator.gain_in_force
    if rate < SAMPLES_A_SWING * ringing:
        yield (
            f"{motion.source}: {rate / ringing:.2g} samples in a swing of the ringing at "
            f"{ringing:.4g} Hz; sample at {SAMPLES_A_SWING * ringing:.2g} Hz or more, or "
            "the contact cannot be told from another one"
        )
    for run in experiment.runs:
        if abs(run.steps) < FEW_STEPS:
            yield (
                f"{motion.source}: the run at {run.start:.4g} s has {abs(run.steps)} steps; "
                f"measure {FEW_STEPS} or more"
            )
        begin, end = np.interp((run.start, run.end), motion.t, motion.x)
        step = abs(float(end - begin)) / abs(run.steps)
        if step < _SHORTEST_STEP * stroke:
            yield (
                f"{motion.source}: steps of {format_si(step, 'm', 3)}, where the actuator goes "
                f"{format_si(stroke, 'm', 3)}; check the units of the record, amplitude and gain"
            )
    noise, stated = noise_of(motion.x), p.sensor.sensor_noise
    given = stated > 0.0 and stated != PARAMETERS["sensor_noise"].default
    if given and not 1.0 / _NOISE_FACTOR < noise / stated < _NOISE_FACTOR:
        yield (
            f"{motion.source}: the noise is {format_si(noise, 'm', 2)} a sample, the parameters "
            f"say {format_si(stated, 'm', 2)}; is the unit of the position right?"
        )


def is_too_coarse(experiment: Experiment, found: Parameters) -> bool:
    """Return True if a record has too few samples for the ringing that was found, or seen."""
    seen = experiment.ringing.frequency if experiment.ringing else 0.0
    fastest = max(seen, Plant.of(found).ringing_frequency)
    return 1.0 / experiment.motion.spacing < SAMPLES_A_SWING * fastest
