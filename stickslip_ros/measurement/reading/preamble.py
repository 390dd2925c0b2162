# SPDX-License-Identifier: Apache-2.0
"""The information in the lines above the numbers: names, units, start and step of the time.

Oscilloscopes that list no times state a start and a step, each maker in words of its own; the
words below come from files and manuals of Rigol, Tektronix, Keysight, LeCroy, Rohde & Schwarz,
Siglent, Yokogawa, GW Instek, PicoScope and LabVIEW. ROS writes seconds and nanoseconds.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from stickslip_ros.measurement.reading.cells import UTC, has_offset, is_stamp
from stickslip_ros.measurement.reading.layout import Layout
from stickslip_ros.measurement.reading.table import Clock, Column
from stickslip_ros.measurement.reading.units import Unit, is_index, is_unit_cell, name_and_unit
from stickslip_ros.physics.parameters.bounded_files import unwrap_numbers
from stickslip_ros.physics.parameters.row import NUMBER

#: What a line says that begins with a word: times are in s, rates in Hz where no unit is stated.
_KEYS = {key: what for what, keys in {
    "step": "increment tinc xinc xincrement deltax sampleinterval samplinginterval samplingperiod "
            "hresolution tinterval timeincrement sampleperiod signalresolution sampletime "
            "horizontalinterval timeinterval",
    "rate": "samplerate samplingrate samplingfrequency samplefrequency fs",
    "start": "start t0 xorg xorigin x0 xstart hoffset starttime xzero tstart horizontaloffset "
             "firsttime",
    "count": "recordlength samples points blocksize memorylength nrofsamples",
    "dimension": "xdimension",
    "unit of time": "hunit horizontalunits xunits xunit horizontalunit",
    "units": "vunit verticalunits yunitlabel yunits yunit verticalunit",
}.items() for key in keys.split()}  # fmt: skip
#: Names of columns of time.
_TIMES = ("time", "t", "times", "x_value")
#: Makers whose column ``Time`` is in seconds by the definition of their files.
_IN_SECONDS = ("lecroy",)
_ASSIGNED = re.compile(r"\s*(t0|tInc)\s*=\s*([-+.\deE]+)\s*s?\s*")
_QUANTITY = re.compile(rf"({NUMBER})\s*([^\d\s]\S*)?")
#: A setting with its value, such as ``voltbase=500000(uV)``: never a name with a unit.
_SETTING = re.compile(r"[#%;!/\s]*\w[^=]*=\s*[-+]?\.?\d.*")
#: Rates as makers write them.
_SAMPLES_A_SECOND = re.compile(r"(?i)(sa|s|samples|sps|pts)/s(ec|econd)?|sps|hz")
#: A whole number that a float may round.
_MANY_DIGITS = re.compile(r"[+-]?\d{16,19}")
#: Names of the parts of a stamp of ROS.
_PART_OF_STAMP = re.compile(r"(.*\W)?(n|nano)?secs?|")


def columns_above(lines: Sequence[str], layout: Layout) -> list[Column]:
    """Return the columns that hold numbers or times, by the lines above and words beside them."""
    above = [row for line in lines[: layout.first] if any(row := _cells(line, layout))]
    beside = [_cells(line, layout) for line in lines[layout.first : layout.first + 100]]
    settings = _header_clock(above)
    for row in [*above, *(row for row in beside if row and not _QUANTITY.fullmatch(row[0]))]:
        if row and any(row[1:]) and (what := _KEYS.get(_key(row[0]))):
            settings.setdefault(what, row)
    said = {what: next(filter(None, row[1:])) for what, row in settings.items()}
    names, units = _names(above, layout)
    clock = _clock(said)
    for k, kind in enumerate(layout.kinds):  # units behind a key, one for each column or for all
        if not units[k] and kind == "n" and names[k].lower() not in _TIMES:
            stated = settings.get("units", [])
            if 0 < k < len(stated) and Unit.of(stated[k]):
                units[k] = stated[k]
            elif sum(map(bool, stated[1:])) == 1 and Unit.of(said["units"]) and (k or clock):
                units[k] = said["units"]
    if not any(names) and (timed := _runs_with(clock, beside, layout)) is not None:
        names[timed], units[timed] = "time", "s"
    own = {}  # LabVIEW puts channels of several rates beside each other
    if clock is not None and _key(settings.get("step", [""])[0]) == "deltax":
        starts = [_si(cell, "time") or 0.0 for cell in settings.get("start", [])]
        for k, step in enumerate(_si(cell, "time") or 0.0 for cell in settings["step"]):
            if k and step != clock.step and 0.0 < step < 1e6:
                own[k] = Clock(starts[k] if k < len(starts) else 0.0, step)
    in_seconds = "".join(above[0]).lower().startswith(_IN_SECONDS) if above else False
    in_seconds |= Unit.of(said.get("unit of time")) == Unit("time", 1.0)
    in_seconds |= "unit of time" not in said and said.get("dimension", "").lower() == "time"
    columns = []
    for k, (name, kind) in enumerate(zip(names, layout.kinds, strict=True)):
        cells = [row[k] for row in beside if k < len(row)]
        own_unit = units[k]
        if names[1:] and names[1].startswith("field.") and (k == 0 or name.endswith(".stamp")):
            own_unit = own_unit or "ns"  # rostopic echo -p
        elif name == "__time" or (in_seconds and name.lower() in _TIMES):
            own_unit = own_unit or "s"
        elif kind == "s" and has_offset(next(filter(is_stamp, cells), "")):
            own_unit = UTC
        if kind in "ns":
            origin = int(next(filter(_MANY_DIGITS.fullmatch, cells), 0)) if kind == "n" else 0
            columns.append(Column(name, own_unit, own.get(k, clock), number=k + 1, origin=origin,
                                  stamped=kind == "s", alone=k in own))  # fmt: skip
    stamps = [row[:2] for row in beside if len(row) == len(layout.kinds)]
    if len(names) > 2 and all(map(_PART_OF_STAMP.fullmatch, names[:2])) and _are_stamps(stamps):
        origin = 10**9 * int(stamps[0][0])
        columns[:2] = [replace(columns[0], name="stamp", unit="ns", joined=True, origin=origin)]
    return columns


def _are_stamps(rows: list[list[str]]) -> bool:
    """Return whether pairs of cells are the seconds and nanoseconds of increasing times."""
    if len(rows) < 2 or not all(one.isdecimal() and len(one) < 11 for row in rows for one in row):
        return False
    seconds, nanoseconds = np.array(rows, np.int64).T
    steady = 2 * np.count_nonzero(np.diff(seconds)) <= len(rows) - 1
    return bool(
        steady
        and 10**5 <= nanoseconds.max() < 10**9
        and (np.diff(10**9 * seconds + nanoseconds) >= 0).all()
    )


def _cells(line: str, layout: Layout) -> list[str]:
    """Return the cells of a line above the numbers, which may have separators of its own."""
    mark, width = layout.delimiter, len(layout.kinds)
    text = unwrap_numbers(line).strip(" \r\n" if mark == "\t" else None)
    if text.startswith(tuple("#%!/" if mark == ";" else "#%!/;")):
        text = text.lstrip("#%!/; \t")
    if mark and mark in text:
        cells = layout.split(text)
    elif mark or width == 1:
        cells = re.split(r"\s*[:=,\t]\s*", text, maxsplit=1)
    else:
        cells = re.split(r"\t|\s{2,}|[,;]", text)
        found = re.findall(r'"[^"]*"|[^\s(\[]+(?:\s*[(\[][^)\]]*[)\]])?', text)
        cells = found if len(cells) != width == len(found) else cells
    return [cell.strip(' "') for cell in cells]


def _key(text: str) -> str:
    return re.sub(r"[^a-z0-9]", "", text.lower())


def _runs_with(clock: Clock | None, rows: list[list[str]], layout: Layout) -> int | None:
    """Return the first of several columns of numbers if it runs with a clock, else None."""
    numbers = [k for k, kind in enumerate(layout.kinds) if kind == "n"]
    if clock is None or len(numbers) < 2:
        return None
    cells = [row[numbers[0]] for row in rows if len(row) > numbers[0]]
    times = np.array([cell for cell in cells if re.fullmatch(NUMBER, cell)], np.float64)
    off = times - times[:1] - clock.step * np.arange(len(times))
    return numbers[0] if len(off) > 9 and np.abs(off).max() <= 0.5 * clock.step else None


def _header_clock(above: list[list[str]]) -> dict[str, list[str]]:
    """Take start and step out of header lines that have them as columns; return their settings."""
    found = {}
    for row, below in zip([*above], [*above[1:], list[str]()], strict=False):
        for cell in list(row):
            if assigned := _ASSIGNED.fullmatch(cell):
                found["start" if assigned[1] == "t0" else "step"] = list(assigned.groups())
                row.remove(cell)
        keys = [_key(cell) for cell in row]
        if "increment" in keys and len(keys) > 2 and len(below) >= len(row) - 1:
            places = [keys.index(key) for key in ("start", "increment") if key in keys]
            at = [place for place in places if place < len(below)]
            found |= {_KEYS[keys[place]]: [keys[place], below[place]] for place in at}
            del row[min(places) :], below[min(places) :]
    return {what: row for what, row in found.items() if row[1]}


def _names(above: list[list[str]], layout: Layout) -> tuple[list[str], list[str | None]]:
    """Return names and units from the last lines that have a cell for each column."""
    width, least = len(layout.kinds), len(layout.kinds.rstrip("e"))
    names, units = [""] * width, list[str | None]([None] * width)
    for row in reversed(above):
        cells = row[: max(k for k, cell in enumerate(row, 1) if cell)] if any(row) else []
        if len(cells) > width and cells[-1].lower() == "comment":
            cells = cells[:-1]  # LabVIEW: beside some rows only
        what = _KEYS.get(_key(cells[0])) if cells else None
        if not least <= len(cells) <= width or what in ("unit of time", "units"):
            continue
        filled = [cell for cell in cells if cell]
        if all(map(_SETTING.fullmatch, filled)) or _QUANTITY.fullmatch(cells[0]):
            continue
        titled = any(units) or (row is above[-1] and _key(cells[0]) in ("time", "t", "times"))
        if cells[0] and width > 1 and not titled and all(
            _QUANTITY.fullmatch(cell) or is_stamp(cell) or re.fullmatch(r"[\d./-]+", cell)
            for cell in filled[1:]
        ):  # fmt: skip
            continue  # a key with its values
        in_units = any(Unit.of(cell) or is_index(cell) for cell in filled)
        if in_units and all(map(is_unit_cell, cells)) and not any(units):
            units[: len(cells)] = [cell.strip("()[] ") or None for cell in cells]
            continue
        if len(filled) > (width > 2):
            for k, cell in enumerate(cells):
                setting = _SETTING.fullmatch(cell) is not None
                names[k], unit = (cell, None) if setting else name_and_unit(cell)
                units[k] = units[k] or unit
            break
    return names, units


def _clock(said: Mapping[str, str]) -> Clock | None:
    """Return the clock that the settings state, None if there is none or it cannot be read."""
    over_time = said.get("dimension", "time").lower() == "time"
    step = _si(said.get("step"), "time") if over_time else None
    if step is None and (rate := _si(said.get("rate"), "frequency")):
        step = 1.0 / rate
    start = _si(said.get("start", "0"), "time")
    unit = Unit.of(said.get("unit of time")) or Unit("time", 1.0)
    if step is None or start is None or unit.dimension != "time":  # such as a spectrum
        return None
    if not 0.0 < step < 1e6 or not abs(start) < 1e12:
        return None
    count = _QUANTITY.fullmatch(said.get("count", "").split(":")[-1])
    number = float(count[1]) if count and not count[2] else 0.0
    # LabVIEW states one sample for a file that is still being written.
    stated = int(number) if 1.0 < number < 1e12 else None
    return Clock(start * unit.factor, step * unit.factor, stated)


def _si(text: str | None, dimension: str) -> float | None:
    """Return a number in the SI unit, None if it is of something else."""
    found = _QUANTITY.fullmatch((text or "").split(":")[-1].replace(",", ".").strip())
    if not found:
        return None
    stated = _SAMPLES_A_SECOND.sub("Hz", found[2]) if found[2] else None
    unit = Unit.of(stated) if stated else Unit(dimension, 1.0)
    return float(found[1]) * unit.factor if unit and unit.dimension == dimension else None
