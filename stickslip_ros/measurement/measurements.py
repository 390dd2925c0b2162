# SPDX-License-Identifier: Apache-2.0
"""Measurements read, analysed, compared with a run, and used to identify an actuator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stickslip_ros.base.compiled import report_compilation
from stickslip_ros.base.reporting.terminal import SEARCH, announce_if_slow
from stickslip_ros.base.shared_files import sample_file
from stickslip_ros.measurement.actuator_identification import (
    IdentifiedActuator,
    identify_hysteresis,
)
from stickslip_ros.measurement.as_measured import simulate_as_measured
from stickslip_ros.measurement.bags.finer import finest_motion
from stickslip_ros.measurement.bags.load_motion import is_bag, is_parameter_file, load_motion
from stickslip_ros.measurement.comparison import Comparison, compare_motions
from stickslip_ros.measurement.motion_pair import Fits
from stickslip_ros.measurement.reading import MeasurementError, Reading, read_loop
from stickslip_ros.measurement.reading.given import given_loop, given_motion
from stickslip_ros.measurement.steps.analysis import find_steps, runs_of
from stickslip_ros.measurement.steps.drive import Drive
from stickslip_ros.measurement.steps.run import Run, main_run
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.simulation.motion import Motion
from stickslip_ros.simulation.run import SimulatedRun
from stickslip_ros.simulation.trace import Trace

#: Whatever holds the position of a runner over time: a Motion, SimulatedRun or Trace, a file, or a
#: DataFrame, a Dataset of xarray or a pair of arrays (s, m), as `given_motion` takes them.
MotionSource = Any


def read_measurement(path: MotionSource, *, joint: str | None = None, **how: Any) -> Motion:
    """Read the motion in a trace, table, array file, instrument's file or bag.

    Parameters
    ----------
    path : str, path, DataFrame, Dataset or pair of arrays
        The file or bag, or a sample of the package by its name; or what a program holds.
    joint : str, optional
        The joint to use in a bag.
    **how
        What the file does not state, by key (``t``, ``x``, ``u``) or as an option takes it
        (``units="x=nm"``): columns, units, scale, rate (Hz), angle (rad), wavelength (m), rows,
        decimal; see docs/compare.md.

    Returns
    -------
    Motion
        Time (s) and position (m), each of shape (samples,).

    Raises
    ------
    MeasurementError, BagError
        The file cannot be read as a motion, or holds no such joint; the message names the option
        that helps.

    Examples
    --------
    >>> import stickslip_ros as ss
    >>> motion = ss.read_measurement("steps_100hz.csv")
    >>> print(f"{len(motion.t)} samples over {motion.duration:.2f} s")
    14000 samples over 0.14 s
    """
    if isinstance(path, Motion | SimulatedRun | Trace):
        raise MeasurementError(
            f"a {type(path).__name__} is a motion already; expected is a file, a DataFrame, a "
            "Dataset, or times (s) and positions (m) as arrays"
        )
    if not isinstance(path, str | PathLike):
        return given_motion(path, how=_reading(how))
    if is_parameter_file(Path(path)):
        raise MeasurementError(
            f"{path} is a parameter file and no measurement; compare takes it first, as the run, "
            "and simulate runs it"
        )
    return load_motion(
        sample_file(Path(path), MeasurementError), how=_reading(how), joint=joint
    ).motion


def find_runs(
    measurement: MotionSource,
    frequency: float | Sequence[float] | None = None,
    steps: int | Sequence[int] | None = None,
) -> list[Run]:
    """Return the runs of steps in a measurement, from rest to rest, in the order of time.

    Parameters
    ----------
    measurement : Motion, SimulatedRun, Trace, str, path, DataFrame, Dataset or pair of arrays
        The motion, a file of it, or a table or arrays (s, m) that hold it.
    frequency, steps : float and int, or a sequence of them, optional
        What is known of the drive: its frequency, Hz, and the number of steps that were sent, the
        sign being the direction; one for all runs, or one a run.

    Returns
    -------
    list of Run
        Each with its start, end, steps and frequency; empty where nothing steps.

    Raises
    ------
    TraceError
        The drive cannot be as given, or the record holds no whole cycle of it.

    Examples
    --------
    >>> import stickslip_ros as ss
    >>> (run,) = ss.find_runs("steps_100hz.csv")
    >>> run.steps, round(run.frequency)
    (10, 100)
    """
    motion, drive = _driven(measurement, Drive.given(frequency, steps))
    with announce_if_slow(SEARCH):
        return runs_of(motion, drive)


def analyse(
    measurement: MotionSource,
    *arrays: ArrayLike,
    frequency: float | Sequence[float] | None = None,
    steps: int | Sequence[int] | None = None,
    zero_amplitude: float | None = None,
) -> Run:
    """Return steps, backsteps and ringing of a measurement, of its longest run if it has several.

    Parameters
    ----------
    measurement, frequency, steps
        As in `find_runs`; of arrays, also the times (s) alone.
    *arrays : array_like
        Positions (m) and, where it was measured, the actuator's deflection (m) at these times, each
        of shape (samples,).
    zero_amplitude : float, optional
        0-amplitude, m, measured separately, for Eq. 9.

    Returns
    -------
    Run
        Steps and backsteps of shape (cycles,), m, and the ringing.

    Raises
    ------
    TraceError
        No steps are found, or the drive cannot be as given.

    Examples
    --------
    >>> import stickslip_ros as ss
    >>> found = ss.analyse(ss.simulate("table1_typical", steps=12))
    >>> print(f"{1e9 * found.step_size:.1f} nm, ringing at {found.ringing_frequency:.0f} Hz")
    133.8 nm, ringing at 7549 Hz
    """
    motion, drive = _driven(measurement, Drive.given(frequency, steps), *arrays)
    with announce_if_slow(SEARCH):
        run = main_run(find_steps(motion.t, motion.x, drive, motion.u).runs)
    return run if zero_amplitude is None else replace(run, zero_amplitude=zero_amplitude)


def compare(
    run: MotionSource | Parameters | Mapping[str, Any],
    measurement: MotionSource,
    *,
    fits: Fits | None = None,
    frequency: float | Sequence[float] | None = None,
    steps: int | Sequence[int] | None = None,
) -> Comparison:
    """Return how a measurement differs from a run of the same motion.

    Parameters
    ----------
    run : Motion, SimulatedRun, Trace, Parameters, mapping, str or path
        The run; of parameters, also in a YAML file, the steps that the measurement shows are
        simulated.
    measurement, frequency, steps
        As in `find_runs`; parameters tell the frequency.
    fits : Fits, optional
        Which corrections of clock and sensor are fitted.

    Returns
    -------
    Comparison
        Differences of shape (samples,), m, with metrics and tolerances.

    Raises
    ------
    ComparisonError, MeasurementError, TraceError
        The two cannot be brought together; a file cannot be read; the drive cannot be as given.

    Examples
    --------
    >>> import stickslip_ros as ss
    >>> found = ss.compare("table1_typical.yaml", "steps_100hz.csv")
    >>> found.differing
    []
    >>> print(f"rmse {1e9 * found.rmse:.1f} nm, noise of the sensor {1e9 * found.noise:.1f} nm")
    rmse 2.0 nm, noise of the sensor 2.0 nm
    """
    measured, drive = _driven(measurement, Drive.given(frequency, steps))
    with report_compilation(), announce_if_slow("comparing"):
        if hasattr(run, "data_vars"):  # a Dataset, which is a mapping, too
            raise MeasurementError(
                "a Dataset is no run; expected is a Motion, as read_measurement makes it of one, a "
                "SimulatedRun, a Trace, Parameters, a mapping of them, or a file"
            )
        if isinstance(run, Parameters | Mapping) or (
            isinstance(run, str | PathLike) and is_parameter_file(Path(run))
        ):
            p = Parameters.of(run)  # type: ignore[arg-type]
            period = 1.0 / p.drive.frequency
            runs = runs_of(measured, drive.or_at(p.drive.frequency))
            simulated = simulate_as_measured(p, measured, runs, "simulation")
            return compare_motions(simulated, measured, fits, runs, period)
        return compare_motions(_driven(run, Drive())[0], measured, fits, drive=drive)


def identify_actuator(
    loop: Any,
    *,
    operators: int = 16,
    creep_start: float = 0.1,
    **how: Any,
) -> IdentifiedActuator:
    """Return the play operators that repeat a recording of voltage and deflection.

    Parameters
    ----------
    loop : str, path, DataFrame, Dataset or tuple of array_like
        A file or table, or voltage (V), deflection (m) and, where known, times (s), each of shape
        (samples,). The recording may contain many loops, rests and drift.
    operators : int
        How many play operators.
    creep_start : float
        Time that creep counts from, s.
    **how
        How the file is read, as in `read_measurement`; arrays take none.

    Returns
    -------
    IdentifiedActuator
        The operators, their error, drift and creep.

    Raises
    ------
    MeasurementError, ParameterError
        The file cannot be read; an option is not known, or given with arrays; there is no loop.

    Examples
    --------
    >>> import stickslip_ros as ss
    >>> found = ss.identify_actuator("actuator_loop.csv")
    >>> print(f"loop of {100 * found.width:.0f} % of the stroke, {1e9 * found.gain:.3f} nm/V")
    loop of 14 % of the stroke, 0.532 nm/V
    """
    if isinstance(loop, tuple):
        if how:
            raise MeasurementError(f"{', '.join(how)}: options of files; arrays are in V, m and s")
        volts, deflection, *rest = (np.asarray(one, dtype=np.float64) for one in loop)
        times = rest[0] if rest else None
        return identify_hysteresis(volts, deflection, operators, times, creep_start)
    if isinstance(loop, str | PathLike):
        read = read_loop(sample_file(Path(loop), MeasurementError), _reading(how))
    else:
        read = given_loop(loop, _reading(how))
    return identify_hysteresis(read.volts, read.deflection, operators, read.times, creep_start)


def _reading(how: Mapping[str, Any]) -> Reading:
    """Return how a file is read by options. Raises MeasurementError for an unknown one."""
    known = [one.name for one in fields(Reading)]
    for name in how:
        if name not in known:
            raise MeasurementError(f"there is no option {name!r}; known: {', '.join(known)}")
    return Reading(**how)


def _driven(source: MotionSource, given: Drive, *arrays: ArrayLike) -> tuple[Motion, Drive]:
    """Return a motion, and what is known of its drive beside what is given.

    The motion in a bag of ours is simulated again where its samples are too few.
    """
    if isinstance(source, str | PathLike) and not arrays and is_bag(Path(source)):
        loaded = load_motion(Path(source))
        return finest_motion(Path(source), loaded), given.or_recorded(loaded.motion, loaded.drive)
    if isinstance(source, Parameters | dict):
        raise MeasurementError(
            f"{type(source).__name__} is no measurement: compare takes parameters first, as the run"
        )
    if isinstance(source, SimulatedRun):
        motion = source.motion
    elif isinstance(source, Trace):
        motion = Motion.of_trace(source, "trace")
    elif isinstance(source, str | PathLike):
        motion = read_measurement(source)
    elif isinstance(source, Motion):
        motion = source
    else:
        motion, arrays = given_motion(source, *arrays), ()
    if arrays:
        raise MeasurementError(
            f"{motion.source} is a measurement of its own; give it alone, or times (s) and "
            "positions (m) as arrays"
        )
    return motion, given.or_recorded(motion, None)
