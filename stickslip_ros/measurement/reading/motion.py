# SPDX-License-Identifier: Apache-2.0
"""Measurements as motions and loops: columns chosen, scaled to SI, checked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.reporting import format_si
from stickslip_ros.measurement.reading.cells import UTC
from stickslip_ros.measurement.reading.choice import LOOP, MOTION, TIME, Quantity, Reading, choose
from stickslip_ros.measurement.reading.formats import naming, open_table
from stickslip_ros.measurement.reading.table import Clock, Column, Loaded, MeasurementError, Table
from stickslip_ros.measurement.steps.actuator_cycles import find_strokes
from stickslip_ros.simulation.motion import Motion

#: Values from here on mean that nothing was measured: 9.9e37 is what instruments send then.
_LARGEST = 1e30
#: Rows below which nothing can be said.
_FEWEST = 16
#: Times from here on (s) count from the first one: they are dates.
_DATES = 1e8
#: No actuator deflects by more (m), and none of a stick-slip drive: its unit is another one.
_WIDEST_LOOP, _WIDEST_STROKE = 0.01, 1e-3
#: Samples between which an hour repeats or is missing are closer (s): hourly logs have others.
_HOUR, _DENSE = 3600.0, 30.0


def read_measurement(path: Path, how: Reading | None = None) -> Motion:
    """Read position over time from a file of any format that `open_table` knows.

    Properties that neither the file nor how states are never guessed: the error asks for them.
    Raises MeasurementError.
    """
    how = how or Reading()
    with naming(path):
        return motion_of(open_table(path, how.decimal), path.name, how)


def motion_of(table: Table, source: str, how: Reading) -> Motion:
    """Return the motion in a table. Raises MeasurementError."""
    values, notes = _read(table, MOTION, how)
    t, x, u = values["t"], values["x"], values.get("u")
    stroke = 0.0 if u is None else float(np.ptp(u))
    if u is not None and stroke > np.ptp(x) > 0.0:
        of_x, of_u = (len(find_strokes(t, (one - one.min()) / np.ptp(one))) for one in (x, u))
        if of_x > max(5, 2 * of_u):
            raise MeasurementError(
                "the position goes back and forth in every cycle while the actuator moves on by "
                f"{stroke:g} m, as if both columns were swapped; name them: --columns x=NAME,u=NAME"
            )
    if stroke > _WIDEST_STROKE:
        raise _too_wide("u", stroke, "stick-slip drive")
    if how.wavelength is not None:
        x, note = without_fringe_jumps(x, 0.5 * how.wavelength)
        notes = (*notes, note)
    x = x / math.cos(how.angle) if how.angle else x
    return Motion(source, t, x, values.get("v"), u, notes, values.get("voltage"))


def _too_wide(key: str, span: float, what: str) -> MeasurementError:
    return MeasurementError(
        f"the actuator's deflection goes over {span:g} m, which no {what} does; say in which unit "
        f"it is: --units {key}=um, or in which column: --columns {key}=NAME"
    )


def without_fringe_jumps(x: Array, fringe: float) -> tuple[Array, str]:
    """Return positions (m), (samples,), without jumps by whole fringes (m), and what was done.

    An interferometer that loses count is off by whole fringes, half the wavelength each, from one
    sample to the next. In between the runner has to move by less than half a fringe.
    """
    steps = np.diff(x)
    fringes = np.rint(steps / fringe)
    jumps, size = int(np.count_nonzero(fringes)), format_si(fringe, "m")
    note = f"{jumps} jump{'s' * (jumps != 1)} by whole fringes of {size} taken out"
    unclear = int(np.sum(np.abs(steps - fringe * fringes) > 0.25 * fringe))
    if unclear:
        note += f"; {unclear} samples move by about half a fringe, where a jump is a guess"
    return x - fringe * np.concatenate(([0.0], np.cumsum(fringes))), note


@dataclass(frozen=True)
class ActuatorLoop:
    """Voltage and deflection of an actuator, each (samples,), in the order of time."""

    volts: Array  #: V
    deflection: Array  #: m
    times: Array | None  #: s, where they are known
    notes: tuple[str, ...] = ()  #: remarks of the reader, for people


def read_loop(path: Path, how: Reading | None = None) -> ActuatorLoop:
    """Read voltage and deflection of an actuator, and their times if the file has them.

    Numbers without units are in V and m. Raises MeasurementError.
    """
    how = how or Reading()
    with naming(path):
        return loop_of(open_table(path, how.decimal), how)


def loop_of(table: Table, how: Reading) -> ActuatorLoop:
    """Return the loops in a table. Raises MeasurementError."""
    values, notes = _read(table, LOOP, how)
    span = float(np.ptp(values["deflection"]))
    if span > _WIDEST_LOOP and "deflection" not in {**how.units, **how.scale}:
        raise _too_wide("deflection", span, "actuator")
    return ActuatorLoop(values["voltage"], values["deflection"], values.get("t"), notes)


def _read(
    table: Table, quantities: Sequence[Quantity], how: Reading
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Return the quantities in SI units, row by row, and notes. Raises MeasurementError."""
    known = {quantity.key: quantity for quantity in quantities}
    for key in (*how.columns, *how.units, *how.scale):
        if key not in known:
            listed = ", ".join(f"{q.key} ({q.what})" for q in quantities)
            raise MeasurementError(f"there is no quantity {key!r}; known: {listed}")
    chosen, remarks = choose(table, quantities, how)
    position = chosen.get("x") or chosen["deflection"]
    clock = Clock(0.0, 1.0 / how.rate) if how.rate else position.clock
    if "t" in chosen:
        clock = None
    counts = [c for c in table.columns if clock and c.counts and c.length == position.length]
    chosen |= dict(zip("t", counts, strict=False))
    loaded = table.load(list(chosen.values()))
    values = dict(zip(chosen, loaded.values, strict=True))
    notes = [*table.notes, *loaded.notes, *remarks]
    if clock and not counts and not how.rate:
        values, clock = _on_one_clock(values, chosen, clock, notes)
    if len({len(one) for one in values.values()}) > 1:
        lengths = ", ".join(f"{chosen[key]} has {len(v)}" for key, v in values.items())
        raise MeasurementError(
            f"the columns are not of one length: {lengths}; name others with --columns"
        )
    places = np.arange(len(values[next(iter(values))]))
    if clock:
        if not counts:
            _refuse_holes(clock, loaded, places, how)
        values["t"] = clock.start + clock.step * (values["t"] if counts else places.astype(float))
    kept = slice(how.rows[0] - 1, how.rows[1]) if how.rows else slice(None)
    values, places = {key: v[kept] for key, v in values.items()}, places[kept]
    # Comparisons are false for nan.
    good = {key: (v < _LARGEST) & (v > -_LARGEST) for key, v in values.items()}
    for key in [key for key in values if not (known[key].required or good[key].all())]:
        notes.append(f"the {known[key].what} has gaps and is left out")
        del values[key], good[key]
    whole = np.logical_and.reduce(list(good.values()))
    if left := int(np.sum(~whole)):
        notes.append(f"{left} of {len(whole)} rows have a gap and are left out")
        values, places = {key: v[whole] for key, v in values.items()}, places[whole]
    least = _FEWEST if TIME in quantities else 1
    if len(places) < least:
        rows = f"{len(places)} row{'s' * (len(places) != 1)} of numbers"
        raise MeasurementError(f"{rows}; {least} or more are needed")
    for key in values.keys() & chosen.keys() - {"t"}:
        values[key] = chosen[key].factor * (values[key] + chosen[key].origin)
    if "t" in values:
        time = chosen.get("t", Column("of time"))
        t = np.multiply(time.factor, _in_order(values["t"], places, loaded, time, notes))
        if time.stamped or time.origin or abs(t[0]) > _DATES:
            begin = time.factor * time.origin + t[0]
            notes.append(f"times count from the first row, {begin:.17g} s")
            t -= t[0]
        values["t"] = t
    return values, tuple(notes)


def _on_one_clock(
    values: dict[str, Array], chosen: Mapping[str, Column], clock: Clock, notes: list[str]
) -> tuple[dict[str, Array], Clock]:
    """Return columns that have clocks of their own at the times of the slowest, and its clock.

    Values in between are interpolated. Where all have one clock and length, nothing changes.
    Raises MeasurementError if they have no time in common.
    """
    own = {key: one for key in values if (one := chosen[key].clock) is not None}
    alike = {(one.start, one.step, len(values[key])) for key, one in own.items()}
    if len(alike) == 1 or len(own) < len(values):
        return values, clock
    base = max(own, key=lambda key: (own[key].step, own[key] == clock))
    step = own[base].step
    times = {key: own[key].start + own[key].step * np.arange(len(v)) for key, v in values.items()}
    begin, end = max(t[0] for t in times.values()), min(t[-1] for t in times.values())
    near = 1e-6 * step  # starts are rounded
    at = times[base][(times[base] >= begin - near) & (times[base] <= end + near)]
    if not len(at):
        spans = (f"{chosen[key]} from {t[0]:g} s to {t[-1]:g} s" for key, t in times.items())
        raise MeasurementError(f"its columns were recorded one after the other: {', '.join(spans)}")
    others = ", ".join(str(chosen[key]) for key in times if key != base)
    notes.append(
        f"the columns have times of their own: {others} is taken at those of {chosen[base]}, every "
        f"{step:g} s from {begin:g} s to {end:g} s"
    )
    values = {key: np.interp(at, times[key], value) for key, value in values.items()}
    return values, Clock(float(at[0]), step)


def _refuse_holes(clock: Clock, loaded: Loaded, places: NDArray[np.int64], how: Reading) -> None:
    """Raise MeasurementError if lines among the rows are left out: their duration is unknown."""
    count = len(places)
    first, last = how.rows or (1, count)
    for row in loaded.breaks:
        if first - (row == 0) <= row < min(last, count):
            raise MeasurementError(
                f"before {loaded.place(row)} there is a line that is not a row of numbers, and "
                f"there is no column of time; read one part: {_parts(places, row)}"
            )
    if clock.count not in (None, count) and how.rows is None and how.rate is None:
        raise MeasurementError(
            f"the file states {clock.count} samples and has {count}, so it is unclear which are "
            f"missing; if they are at the end, add --rows 1:{count}"
        )


def _parts(places: NDArray[np.int64], row: int) -> str:
    """Return the options that read the rows before one or from it on, of those that suffice."""
    parts = [f"--rows {places[0] + 1}:{places[row]}"] if row >= _FEWEST else []
    parts += [f"--rows {places[row] + 1}:"] if len(places) - row >= _FEWEST else []
    return " or ".join(parts)


def _in_order(
    t: Array, places: NDArray[np.int64], loaded: Loaded, column: Column, notes: list[str]
) -> Array:
    """Return times that increase; MeasurementError if they cannot be had without guessing."""
    steps = np.diff(t)
    if t[0] > _DATES and 0.0 <= np.mean(steps) < 8.0 * np.spacing(t[0]):
        raise MeasurementError(
            f"times such as {t[0]:.17g} have more digits than a number holds; take the first "
            "one from all of them, or give the samples per second with --rate"
        )
    usual = np.median(np.abs(steps)) if column.stamped and column.unit != UTC else _HOUR
    hours = (np.abs(np.abs(steps) - _HOUR) <= 1.5 * usual) & (usual < _DENSE)
    if not hours.any():
        if (steps > 0.0).all():
            return t
        if (steps >= 0.0).all() and (even := _unrounded(t)) is not None:
            notes.append("times are rounded so that some are alike; evenly spaced ones are taken")
            return even
    row = int(np.argmax(hours if hours.any() else steps <= 0.0)) + 1
    parts = _parts(places, row)
    if hours.any():
        what, when = ("repeats", "ends") if steps[row - 1] < 0.0 else ("is missing", "begins")
        why = f"an hour {what} before it, as where daylight saving {when}; write the times with "
        why += f"their offset from UTC, such as +02:00, or read one part: {parts}"
    else:
        why = f"the time {float(t[row])!r} does not come after {float(t[row - 1])!r}; sort the "
        why += "rows by time and keep each time once, or give the samples per second with --rate"
        if parts and t[row] < t[row - 1]:
            why += f"; if another measurement begins there, read one part: {parts}"
    raise MeasurementError(f"{loaded.place(int(places[row]))}, column {column}: {why}")


def _unrounded(t: Array) -> Array | None:
    """Return even times that the given ones may be rounded from, None if there are none.

    Rounded even times change by one step of the rounding or by none; both ends are known to that
    step, and no time is further than three quarters of it from its even one.
    """
    rises = np.diff(t)
    ties = int((rises == 0.0).sum())
    rises = rises[rises > 0.0]
    if len(rises) < _FEWEST // 2 or ties < len(t) / 20:
        return None  # a line that stands there twice is another matter
    grain = float(rises.min())
    number = np.arange(len(t), dtype=np.float64)
    even = t[0] + np.polyval(np.polyfit(number, t - t[0], 1), number)
    near = float(np.abs(t - even).max()) <= 0.75 * grain
    return even if near and float(rises.max()) < 1.5 * max(grain, even[1] - even[0]) else None
