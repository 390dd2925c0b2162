# SPDX-License-Identifier: Apache-2.0
"""A waveform from a file, such as the points that a real controller plays."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

from stickslip_ros.physics.parameters import DriveParameters, ParameterError
from stickslip_ros.physics.parameters.bounded_files import FileVersion, read_rows, read_small_text
from stickslip_ros.physics.waveforms.built_in import Shape

_FORM = "one column of levels, or two of time share and level"
#: First line of a file with times and voltages
OF_GENERATOR = "# time (s), voltage (V)"
#: Part of the height by which a level that is held may change: rounding
_LEVEL = 1e-12


def table_shape(d: DriveParameters) -> Shape:
    """Return the waveform in the file ``waveform_table``, stretched over the period.

    The file holds levels from 0 to 1 of the amplitude at equal spacing, or time shares from 0 to 1
    with levels, or below `OF_GENERATOR` times (s) and voltages (V), which are stretched likewise.
    The last level is the first one. Raises ParameterError.
    """
    if d.waveform_table is None:
        raise ParameterError(
            f"waveform is table, but waveform_table names no file: set it to a CSV of {_FORM}"
        )
    shares, levels = _read(FileVersion.of(Path(d.waveform_table)))
    period = 1.0 / d.frequency
    changes, spans = _differences(levels), _differences(shares)
    return Shape(
        durations=tuple(span * period for span in spans),
        changes=tuple(changes),
        slip=_slip_of(changes, spans),
        start=levels[0],
    )


def _differences(values: Sequence[float]) -> list[float]:
    return [after - before for before, after in pairwise(values)]


@lru_cache(maxsize=8)
def _read(file: FileVersion) -> tuple[list[float], list[float]]:
    """Return time shares and levels of the points."""
    path = file.path
    lines, rows = read_rows(path, (1, 2), _FORM)
    if len(rows) < 3:
        raise ParameterError(f"{path} holds {len(rows)} points; a waveform has 3 or more")
    if read_small_text(path).startswith(OF_GENERATOR) and len(rows[0]) == 2:
        last, highest = rows[-1][0], max(row[1] for row in rows)
        if last > 0.0 and highest > 0.0:  # or it is refused below
            rows = [[time / last, volts / highest] for time, volts in rows]
    levels = [row[-1] for row in rows]
    for line, level in zip(lines, levels, strict=True):
        if not 0.0 <= level <= 1.0:
            raise ParameterError(
                f"{path}, line {line}: level {level:g} has to lie between 0 and 1 of the amplitude"
            )
    if levels[-1] != levels[0]:
        raise ParameterError(
            f"{path}, line {lines[-1]}: the waveform ends at level {levels[-1]:g}, but begins at "
            f"{levels[0]:g}; it has to close: add a last point with the first level"
        )
    if min(levels) == max(levels):
        raise ParameterError(f"{path}: all levels are {levels[0]:g}; a waveform has to move")
    if len(rows[0]) == 1:
        spacing = 1.0 / (len(levels) - 1)
        return [*(k * spacing for k in range(len(levels) - 1)), 1.0], levels
    shares = [row[0] for row in rows]
    for line, (before, share) in zip(lines[1:], pairwise(shares), strict=True):
        if not share > before:
            raise ParameterError(
                f"{path}, line {line}: time share {share:g} follows {before:g}; "
                "each has to be larger than the one before"
            )
    for share, wanted, line in ((shares[0], 0, lines[0]), (shares[-1], 1, lines[-1])):
        if share != wanted:
            raise ParameterError(
                f"{path}, line {line}: time share {share:g} has to be {wanted}; "
                "the points cover the period from 0 to 1"
            )
    return shares, levels


def _slip_of(changes: Sequence[float], spans: Sequence[float]) -> tuple[int, int]:
    """Return the segments of the slip: the way down, holds within it included, around the steepest.

    It begins where the level leaves its height and ends before the level rises again.
    """
    slopes = [change / span for change, span in zip(changes, spans, strict=True)]
    first = last = slopes.index(min(slopes))
    for k in range(first - 1, -1, -1):
        if changes[k] > _LEVEL:
            break
        if changes[k] < -_LEVEL:
            first = k
    for k in range(last + 1, len(changes)):
        if changes[k] > _LEVEL:
            break
        if changes[k] < -_LEVEL:
            last = k
    return first, last + 1


def generator_rows(
    d: DriveParameters, shape: Shape, rate: float | None
) -> list[tuple[float, float]]:
    """Return times (s) and voltages (V) of a cycle, the first point again at its end.

    At the corners of the shape, or at even times, rate (Hz) of them a second, as many as the period
    has room for. Raises ParameterError for fewer than three.
    """
    times, volts = [0.0], [shape.start * d.amplitude]
    for duration, change in zip(shape.durations, shape.changes, strict=True):
        times.append(times[-1] + duration)
        volts.append(volts[-1] + change * d.amplitude)
    volts = [min(max(one, 0.0), d.amplitude) for one in volts]  # rounding
    volts[-1] = volts[0]
    corners = dict(zip(times, volts, strict=True))  # a segment may take no time
    if rate is None:
        return list(corners.items())
    wanted = rate / d.frequency
    if not 3.0 <= wanted <= MOST_POINTS:
        raise ParameterError(
            f"{rate:g} Hz makes {wanted:g} points of a cycle of {d.frequency:g} Hz; a waveform has "
            f"3 to {MOST_POINTS}: {'lower' if wanted > MOST_POINTS else 'raise'} the rate"
        )
    count = round(wanted)
    even = [k / rate for k in range(count)]
    return [*((t, _level(t, times, volts)) for t in even), (count / rate, volts[0])]


#: Points of a generator
MOST_POINTS = 1_000_000


def _level(t: float, times: Sequence[float], volts: Sequence[float]) -> float:
    """Return the voltage (V) at a time (s) between corners."""
    k = min(bisect_right(times, t), len(times) - 1)
    span = times[k] - times[k - 1]
    share = (t - times[k - 1]) / span if span > 0.0 else 1.0
    return volts[k - 1] + min(share, 1.0) * (volts[k] - volts[k - 1])
