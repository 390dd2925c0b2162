# SPDX-License-Identifier: Apache-2.0
"""Measurements as motions and loops: columns chosen, scaled to SI, checked.

How a file begins says which reader takes it, and its suffix where that is not enough. A new format
is a function from a path to a `Table` and a line in `_BY_START` or `_BY_SUFFIX`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.opening import ReadError, open_regular
from stickslip_ros.base.reporting import format_si
from stickslip_ros.measurement.reading import arrays, instruments
from stickslip_ros.measurement.reading.choice import (
    LOOP,
    MOTION,
    TIME,
    Quantity,
    Reading,
    choose,
    contradictions,
)
from stickslip_ros.measurement.reading.layout import LARGEST
from stickslip_ros.measurement.reading.table import Clock, Column, Loaded, MeasurementError, Table
from stickslip_ros.measurement.reading.text import UNPACKING, numbers_of, read_text_table
from stickslip_ros.measurement.steps.actuator_cycles import find_strokes
from stickslip_ros.simulation.motion import Motion

Reader = Callable[[Path], Table]

_BY_START: tuple[tuple[bytes, Reader], ...] = (
    (b"\x93NUMPY", arrays.read_npy),
    (b"\x89HDF\r\n\x1a\n", arrays.read_hdf5),
    (b"MATLAB 5.0 MAT-file", arrays.read_mat),
    (b"MATLAB 7.3 MAT-file", arrays.read_mat),
    (b"TDSm", instruments.read_tdms),
)
#: LeCroy's mark may come after what an interface put before it.
_WAVEFORM = b"WAVEDESC"
#: What is not read, by its start or the end of its name, and the cure.
_NOT_READ: tuple[tuple[str, bytes, tuple[str, ...], str], ...] = (
    ("waveforms of Yokogawa", rb"\$PublicInfo|\A%WDF", (".wvf", ".wdf"), "export it as CSV"),
    ("binary waveforms of Rohde & Schwarz", rb"(?s)\A\s*<\?xml.*<Database", (".wfm.bin",),
     "export it as CSV"),
    ("Octave's text", rb"(?s)\A#.*# name:.*\n# type:", (), "save it with save -v7"),
)  # fmt: skip
_BY_SUFFIX: dict[str, Reader] = {
    ".npz": arrays.read_npz,
    ".mat": arrays.read_mat,
    ".uff": instruments.read_uff,
    ".unv": instruments.read_uff,
    ".uf": instruments.read_uff,
    ".tdms": instruments.read_tdms,
    ".wfm": instruments.read_waveform,
    ".trc": instruments.read_waveform,
    ".isf": instruments.read_waveform,
    ".bin": instruments.read_waveform,
}
_KNOWN = (
    "read are text (also packed with gzip, bzip2 or xz), .npy, .npz, .mat, HDF5, .lvm, .uff, "
    ".tdms, .wfm, .trc, .isf, .bin of oscilloscopes, and bags"
)


def open_table(path: Path, decimal: str | None = None) -> Table:
    """Return the columns of a file. Raises MeasurementError and OSError."""
    path = numbers_of(path)
    with open_regular(path) as file:
        start = file.read(1024)
    if not start:
        raise MeasurementError("it is empty: no row of numbers")
    for what, mark, ends, cure in _NOT_READ:
        if re.search(mark, start) or path.name.lower().endswith(ends):
            raise MeasurementError(f"{what} cannot be read; {cure}")
    reader = next((reader for mark, reader in _BY_START if start.startswith(mark)), None)
    reader = reader or _BY_SUFFIX.get(path.suffix.lower())
    if reader is None and _WAVEFORM in start[:64]:
        reader = instruments.read_waveform
    if reader is not None:
        return reader(path)
    try:
        table = read_text_table(path, decimal)
    except UNPACKING as error:
        raise MeasurementError(f"it cannot be unpacked: {error}") from None
    if table is None:
        raise MeasurementError(f"it is neither text nor a known format; {_KNOWN}")
    return table


#: Rows below which nothing can be said.
_FEWEST = 16
#: Times from here on (s) count from the first one: they are dates.
_DATES = 1e8
#: Steps of the time are this many times as large as the last digit that a number holds.
_GRAINS = 8.0
#: No actuator deflects by more (m), and none of a stick-slip drive: its unit is another one.
_WIDEST_LOOP, _WIDEST_STROKE = 0.01, 1e-3
#: Strokes from which on a column goes back and forth.
_SURE_STROKES = 6
#: Share of times that are like the one before them where times are rounded.
_MANY_TIES = 0.05
#: Part of a fringe from which on a step from one sample to the next may be a jump or motion.
_UNCLEAR = 0.25
#: Even times fit rounded ones if none is further off than this share of the coarsest step seen.
_ROUNDED = 0.75


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
    x, u = values["x"], values.get("u", np.zeros(1))
    stroke = float(np.ptp(u))
    if stroke > np.ptp(x) > 0.0 and _is_runner(values["t"], u, x):
        raise MeasurementError(
            "the position goes back and forth in every cycle while the actuator moves on by "
            f"{stroke:g} m, as if both columns were swapped; name them: --columns x=NAME,u=NAME"
        )
    if stroke > _WIDEST_STROKE:
        raise MeasurementError(
            f"the actuator's deflection goes over {stroke:g} m, which no stick-slip drive does; "
            "say in which unit it is: --units u=nm, or in which column: --columns u=NAME"
        )
    if how.wavelength is not None:
        x, note = without_fringe_jumps(x, 0.5 * how.wavelength)
        notes = (*notes, note)
    x = x / math.cos(how.angle) if how.angle else x
    return Motion(source, values["t"], x, values.get("v"), values.get("u"), notes)


def _is_runner(t: Array, actuator: Array, position: Array) -> bool:
    """Return whether a deflection (m) moves on while the position (m) does what actuators do."""
    strokes, other = (
        len(find_strokes(t, (one - one.min()) / np.ptp(one))) for one in (position, actuator)
    )
    return strokes >= _SURE_STROKES and strokes > 2 * other


def without_fringe_jumps(x: Array, fringe: float) -> tuple[Array, str]:
    """Return positions (m), (samples,), without jumps by whole fringes (m), and what was done.

    An interferometer that loses count is off by whole fringes, half the wavelength each, from one
    sample to the next. In between the runner has to move by less than half a fringe.
    """
    steps = np.diff(x)
    fringes = np.rint(steps / fringe)
    jumps, size = int(np.count_nonzero(fringes)), format_si(fringe, "m")
    note = f"{jumps} jump{'s' * (jumps != 1)} by whole fringes of {size} taken out"
    unclear = int(np.sum(np.abs(steps - fringe * fringes) > _UNCLEAR * fringe))
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
        raise MeasurementError(
            f"the deflection goes over {span:g} m, which no actuator does; say in which unit "
            "it is: --units deflection=um, or in which column: --columns deflection=NAME"
        )
    return ActuatorLoop(values["voltage"], values["deflection"], values.get("t"), notes)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Turn every error into a MeasurementError that begins with the name of the file."""
    try:
        yield
    except OSError as error:
        raise MeasurementError(f"cannot read {path}: {error.strerror or error}") from None
    except ReadError as error:  # it names the file
        raise MeasurementError(str(error)) from None
    except MemoryError:
        raise MeasurementError(f"{path}: it does not fit into memory; cut it") from None
    except MeasurementError as error:
        raise MeasurementError(f"{path}: {error}") from None


def _read(
    table: Table, quantities: Sequence[Quantity], how: Reading
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Return the quantities in SI units, row by row, and notes. Raises MeasurementError."""
    known = {quantity.key: quantity for quantity in quantities}
    for key in (*how.columns, *how.units, *how.scale):
        if key not in known:
            listed = ", ".join(f"{q.key} ({q.what})" for q in quantities)
            raise MeasurementError(f"there is no quantity {key!r}; known: {listed}")
    chosen = choose(table, quantities, how)
    if how.rate and TIME not in quantities:
        chosen.pop("t", None)
    clock = _clock(table, chosen, how)
    loaded = table.load(list(chosen.values()))
    values = dict(zip(chosen, loaded.values, strict=True))
    notes = [*table.notes, *loaded.notes, *contradictions(chosen, how)]
    if clock is not None and "t" not in values and not how.rate:
        values, clock = _on_one_clock(values, chosen, clock, notes)
    lengths = {len(one) for one in values.values()}
    if len(lengths) > 1:
        raise MeasurementError(
            "the columns are not of one length: "
            + ", ".join(f"{chosen[key]} has {len(v)}" for key, v in values.items())
            + "; name others with --columns"
        )
    places = np.arange(lengths.pop())
    if clock is not None:
        numbers = values["t"] if "t" in values else _numbers(clock, loaded, len(places), how)
        values["t"] = clock.start + clock.step * numbers
    if how.rows is not None:
        kept = slice(how.rows[0] - 1, how.rows[1])
        values, places = {key: v[kept] for key, v in values.items()}, places[kept]
    # Comparisons are false for nan.
    good = {key: (v < LARGEST) & (v > -LARGEST) for key, v in values.items()}
    for key in [key for key in values if not (known[key].required or good[key].all())]:
        notes.append(f"the {known[key].what} has gaps and is left out")
        del values[key], good[key]
    whole = np.logical_and.reduce(list(good.values()))
    if left := int(len(whole) - whole.sum()):
        notes.append(f"{left} of {len(whole)} rows have a gap and are left out")
        values, places = {key: v[whole] for key, v in values.items()}, places[whole]
    if len(places) < (_FEWEST if TIME in quantities else 1):
        raise MeasurementError(
            f"{len(places)} row{'s' * (len(places) != 1)} of numbers; {_FEWEST} or more are needed"
            if TIME in quantities
            else "it holds no numbers"
        )
    if "t" in values:
        t = values["t"]
        steps = float(t[-1] - t[0]) / max(len(t) - 1, 1)
        if t[0] > _DATES and 0.0 <= steps < _GRAINS * float(np.spacing(t[0])):
            raise MeasurementError(
                f"times such as {t[0]:.17g} have more digits than a number holds; take the first "
                "one from all of them, or give the samples per second with --rate"
            )
        values["t"] = _in_order(t, places, loaded, chosen, notes)
    for key in values.keys() & chosen.keys():
        if chosen[key].factor != 1.0:
            values[key] = chosen[key].factor * values[key]
    stamped = "t" in chosen and chosen["t"].stamped
    if "t" in values and (stamped or abs(values["t"][0]) > _DATES):
        notes.append(f"times count from the first row, {values['t'][0]:.17g} s")
        values["t"] = values["t"] - values["t"][0]
    return values, tuple(notes)


def _clock(table: Table, chosen: dict[str, Column], how: Reading) -> Clock | None:
    """Return the clock that replaces a column of time, None if there is one.

    A column that numbers the samples is chosen in place of it.
    """
    if "t" in chosen:
        return None
    position = chosen.get("x") or chosen["deflection"]
    if not how.rate and position.clock is None:
        return None
    counter = next((c for c in table.columns if c.counts and c.length == position.length), None)
    if counter is not None:
        chosen["t"] = counter
    return Clock(0.0, 1.0 / how.rate) if how.rate else position.clock


def _on_one_clock(
    values: dict[str, Array], chosen: Mapping[str, Column], clock: Clock, notes: list[str]
) -> tuple[dict[str, Array], Clock]:
    """Return columns that have clocks of their own at the times of the slowest, and its clock.

    Values in between are interpolated. Where all have one clock and length, nothing changes.
    Raises MeasurementError if they have no time in common.
    """
    clocks = {key: chosen[key].clock for key in values}
    own = {key: one for key, one in clocks.items() if one is not None}
    alike = {(one.start, one.step, len(values[key])) for key, one in own.items()}
    if len(alike) == 1 or len(own) < len(values):
        return values, clock
    base = max(own, key=lambda key: (own[key].step, own[key] == clock))
    clock, other = own[base], "the others"
    times = {key: own[key].start + own[key].step * np.arange(len(v)) for key, v in values.items()}
    begin, end = max(t[0] for t in times.values()), min(t[-1] for t in times.values())
    near = 1e-6 * clock.step  # starts are rounded
    kept = (times[base] >= begin - near) & (times[base] <= end + near)
    if not kept.any():
        raise MeasurementError(
            "its columns were recorded one after the other: "
            + ", ".join(f"{chosen[key]} from {t[0]:g} s to {t[-1]:g} s" for key, t in times.items())
        )
    if len(times) == 2:
        other = next(str(chosen[key]) for key in times if key != base)
    notes.append(
        f"the columns have times of their own: {other} is taken at those of {chosen[base]}, every "
        f"{clock.step:g} s from {begin:g} s to {end:g} s"
    )
    at = times[base][kept]
    values = {key: np.interp(at, times[key], value) for key, value in values.items()}
    return values, Clock(float(at[0]), clock.step)


def _numbers(clock: Clock, loaded: Loaded, count: int, how: Reading) -> Array:
    """Return the numbers of the samples, from 0, (count,).

    Raises MeasurementError if lines among the rows are left out: their duration is unknown.
    """
    first, last = how.rows or (1, count)
    for row in loaded.breaks:
        if first - (row == 0) <= row < min(last, count):
            parts = [f"--rows 1:{row}"] if row else []
            parts.append(f"--rows {row + 1}:")
            raise MeasurementError(
                f"before {loaded.place(row)} there is a line that is not a row of numbers, and "
                f"there is no column of time; read one part: {' or '.join(parts)}"
            )
    if clock.count not in (None, count) and how.rows is None and how.rate is None:
        raise MeasurementError(
            f"the file states {clock.count} samples and has {count}, so it is unclear which are "
            f"missing; if they are at the end, add --rows 1:{count}"
        )
    return np.arange(count, dtype=np.float64)


def _in_order(
    t: Array,
    places: NDArray[np.int64],
    loaded: Loaded,
    chosen: Mapping[str, Column],
    notes: list[str],
) -> Array:
    """Return times that increase; MeasurementError if they cannot be had without guessing."""
    steps = np.diff(t)
    if (steps > 0.0).all():
        return t
    if (steps >= 0.0).all() and (even := _unrounded(t)) is not None:
        notes.append("the times are rounded so that some are alike; evenly spaced ones are taken")
        return even
    row = int(np.argmin(steps > 0.0)) + 1
    place = f"{loaded.place(int(places[row]))}, column {chosen.get('t', 'of time')}"
    cure = "sort the rows by time and keep each time once"
    parts = [f"--rows 1:{int(places[row])}"] if row >= _FEWEST else []
    parts += [f"--rows {int(places[row]) + 1}:"] if len(t) - row >= _FEWEST else []
    if t[row] < t[row - 1] and parts:
        cure += f"; if another measurement begins there, read one part: {' or '.join(parts)}"
    raise MeasurementError(
        f"{place}: the time {float(t[row])!r} does not come after {float(t[row - 1])!r}; {cure}, "
        "or give the samples per second with --rate"
    )


def _unrounded(t: Array) -> Array | None:
    """Return even times that the given ones may be rounded from, None if there are none.

    Rounded even times change by one step of the rounding or by none; both ends are known to that
    step, and no time is further than it from its even one.
    """
    rises = np.diff(t)
    ties = int((rises == 0.0).sum())
    rises = rises[rises > 0.0]
    if len(rises) < _FEWEST // 2 or ties < _MANY_TIES * len(t):
        return None  # a line that stands there twice is another matter
    grain = float(rises.min())
    number = np.arange(len(t), dtype=np.float64)
    even = t[0] + np.polyval(np.polyfit(number, t - t[0], 1), number)
    near = float(np.abs(t - even).max()) <= _ROUNDED * grain
    return even if near and float(rises.max()) < 1.5 * max(grain, even[1] - even[0]) else None
