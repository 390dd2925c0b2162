# SPDX-License-Identifier: Apache-2.0
"""The information in the lines above the numbers: names, units, start and step of the time.

Oscilloscopes that list no times state a start and a step, each maker in words of its own; the
words below come from files and manuals of Rigol, Tektronix, Keysight, LeCroy, Rohde & Schwarz,
Siglent, Yokogawa, GW Instek, PicoScope and LabVIEW.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import pairwise

from stickslip_ros.measurement.reading.layout import Layout, is_stamp
from stickslip_ros.measurement.reading.table import (
    Clock,
    Column,
    Unit,
    is_index,
    is_unit_cell,
    name_and_unit,
)
from stickslip_ros.physics.parameters.bounded_files import unwrap_numbers
from stickslip_ros.physics.parameters.row import NUMBER

#: Words for the time (s) between samples, for their rate (Hz) and for the time (s) of the first.
_STEPS = ("increment", "tinc", "xinc", "xincrement", "deltax", "sampleinterval", "samplinginterval",
          "samplingperiod", "hresolution", "tinterval", "timeincrement", "sampleperiod",
          "signalresolution", "sampletime", "horizontalinterval", "timeinterval")  # fmt: skip
_RATES = ("samplerate", "samplingrate", "samplingfrequency", "samplefrequency", "fs")
_STARTS = ("start", "t0", "xorg", "xorigin", "x0", "xstart", "hoffset", "starttime", "xzero",
           "tstart", "horizontaloffset", "firsttime")  # fmt: skip
#: For the number of samples.
_COUNTS = ("recordlength", "samples", "points", "blocksize", "memorylength", "nrofsamples")
_TIME_UNITS = {"hunit", "horizontalunits", "xunits", "xunit", "horizontalunit"}
_VALUE_UNITS = {"vunit", "verticalunits", "yunitlabel", "yunits", "yunit", "verticalunit"}
_NAMES = {"tracename", "channelname", "channelnames", "labels"}
#: Makers whose column ``Time`` is in seconds by the definition of their files.
_IN_SECONDS = ("lecroy",)
_ASSIGNED = re.compile(r"\s*(t0|tInc)\s*=\s*([-+.\deE]+)\s*s?\s*")
_QUANTITY = re.compile(rf"({NUMBER})\s*([^\d\s]\S*)?")
#: A setting with its value, such as ``voltbase=500000(uV)``: never a name with a unit.
_SETTING = re.compile(r"[#%;!/\s]*\w[^=]*=\s*[-+]?\.?\d.*")
_LEADING = re.compile(r"^[#%;!/\s]+")
#: Rates as makers write them.
_SAMPLES_A_SECOND = re.compile(r"(?i)(sa|s|samples|sps|pts)/s(ec|econd)?|sps|hz")


def columns_above(lines: Sequence[str], layout: Layout) -> list[Column]:
    """Return the columns that hold numbers or times, by the lines above and words beside them."""
    above = [_cells(line, layout) for line in lines[: layout.first]]
    above = [row for row in above if any(row)]
    beside = [_cells(line, layout) for line in lines[layout.first : layout.first + 100]]
    of_header = _header_clock(above)
    facts = _facts([*above, *(row for row in beside if row and not _numeric(row[0]))])
    names, units = _name(above, layout)
    if len(names) > 1 and names[1].startswith("field."):
        units[0] = units[0] or "ns"  # rostopic echo -p
    clock = _clock({**facts, **of_header})
    own = _other_clocks(above, clock)
    _fill_key_units(above, layout, names, units, clock is not None)
    timed = _runs_with(clock, beside, layout) if not any(names) else None
    if timed is not None:
        names[timed], units[timed] = "time", "s"
    horizontal = next((facts[key] for key in _TIME_UNITS if key in facts), None)
    unit = Unit.of(horizontal)
    if unit is not None and unit.dimension != "time":
        clock = None  # a spectrum
    elif unit is not None and clock:
        clock = Clock(clock.start * unit.factor, clock.step * unit.factor, clock.count)
    of_time = horizontal is None and facts.get("xdimension", "").lower() == "time"
    first = "".join(above[0]).lower() if above else ""
    if first.startswith(_IN_SECONDS) or unit == Unit("time", 1.0) or of_time:
        timely = [name.lower() in ("time", "t", "times", "x_value") for name in names]
        units = [one or ("s" if time else None) for one, time in zip(units, timely, strict=True)]
    return [
        Column(name, unit or ("s" if name == "__time" else None), own.get(k, clock),
               number=k + 1, stamped=kind == "s", alone=k in own)
        for k, (name, unit, kind) in enumerate(zip(names, units, layout.kinds, strict=True))
        if kind in "ns"
    ]  # fmt: skip


def _cells(line: str, layout: Layout) -> list[str]:
    """Return the cells of a line above the numbers, which may have separators of its own."""
    text = unwrap_numbers(line).strip()
    leading = _LEADING.match(text)
    if leading and not (layout.delimiter == ";" and leading[0].strip() == ";"):
        text = text[leading.end() :]
    elif layout.delimiter == "\t":
        text = unwrap_numbers(line).strip(" \r\n")
    if layout.delimiter is None and len(layout.kinds) == 1:
        cells = re.split(r"\s*[:=,\t]\s*", text, maxsplit=1)
    elif layout.delimiter is None:
        cells = re.split(r"\t|\s{2,}|[,;]", text)
        if len(cells) != len(layout.kinds):
            found = re.findall(r'"[^"]*"|[^\s(\[]+(?:\s*[(\[][^)\]]*[)\]])?', text)
            cells = found if len(found) == len(layout.kinds) else cells
    else:
        cells = layout.split(text)
        if len(cells) == 1 and layout.delimiter not in text:
            cells = re.split(r"\s*[:=]\s*", text, maxsplit=1)
    return [cell.strip().strip('"').strip() for cell in cells]


def _key(text: str) -> str:
    return re.sub(r"[^a-z0-9]", "", text.lower())


def _numeric(text: str) -> bool:
    return _QUANTITY.fullmatch(text) is not None


def _runs_with(clock: Clock | None, rows: list[list[str]], layout: Layout) -> int | None:
    """Return the first of several columns of numbers if it runs with a clock, else None."""
    numbers = [k for k, kind in enumerate(layout.kinds) if kind == "n"]
    if clock is None or len(numbers) < 2:
        return None
    cells = [row[numbers[0]] for row in rows if len(row) > numbers[0]]
    times = [float(cell) for cell in cells if re.fullmatch(NUMBER, cell)]
    steps, step = [after - before for before, after in pairwise(times)], clock.step
    even = len(steps) > 8 and all(abs(one - step) <= 0.5 * step for one in steps)
    runs = even and abs(times[-1] - times[0] - len(steps) * step) <= 0.5 * step
    return numbers[0] if runs else None


def _header_clock(above: list[list[str]]) -> dict[str, str]:
    """Take start and increment out of header lines that have them as columns of their own."""
    facts = {}
    for index, row in enumerate(above):
        for cell in list(row):
            if assigned := _ASSIGNED.fullmatch(cell):
                facts["start" if assigned[1] == "t0" else "increment"] = assigned[2]
                row.remove(cell)
        keys = [_key(cell) for cell in row]
        below = above[index + 1] if index + 1 < len(above) else []
        if "increment" not in keys or len(keys) < 3 or len(below) < len(row) - 1:
            continue
        places = [keys.index(key) for key in ("start", "increment") if key in keys]
        facts.update({keys[place]: below[place] for place in places if place < len(below)})
        del row[min(places) :], below[min(places) :]
    return facts


def _facts(rows: Iterable[list[str]]) -> dict[str, str]:
    """Return the first value behind each key."""
    facts: dict[str, str] = {}
    for row in rows:
        values = [cell for cell in row[1:] if cell]
        if values and row[0]:
            facts.setdefault(_key(row[0]), values[0])
    return facts


def _name(above: list[list[str]], layout: Layout) -> tuple[list[str], list[str | None]]:
    """Return names and units from the last lines that have a cell for each column."""
    width, least = len(layout.kinds), len(layout.kinds.rstrip("e"))
    names, units = [""] * width, list[str | None]([None] * width)
    named = under_units = False
    for row in reversed(above):
        filled = [k for k, cell in enumerate(row, 1) if cell]
        cells = row[: max(filled, default=0)]
        if cells and cells[-1].lower() == "comment" and len(cells) > width:
            cells = cells[:-1]  # LabVIEW: beside some rows only
        if not least <= len(cells) <= width or _key(cells[0]) in _TIME_UNITS | _VALUE_UNITS:
            continue
        if _key(cells[0]) in _NAMES and not any(names):
            names[1 : len(cells)] = cells[1:]
            named = True
            continue
        numbered = row is above[-1] and _key(cells[0]) in ("time", "t", "times")
        values = all(
            _numeric(cell) or is_stamp(cell) or re.fullmatch(r"[\d./-]+", cell)
            for cell in cells[1:]
            if cell
        )
        if all(_SETTING.fullmatch(cell) for cell in cells if cell) or _numeric(cells[0]):
            continue
        if cells[0] and width > 1 and values and not (numbered or under_units):
            continue  # a key with its values
        in_units = any(Unit.of(cell) or is_index(cell) for cell in cells if cell)
        if in_units and all(is_unit_cell(cell) for cell in cells) and not any(units):
            units[: len(cells)] = [cell.strip("()[] ") or None for cell in cells]
            under_units = True
            continue
        if named:
            break
        if len([cell for cell in cells if cell]) > (width > 2):
            for k, cell in enumerate(cells):
                setting = _SETTING.fullmatch(cell) is not None
                names[k], unit = (cell, None) if setting else name_and_unit(cell)
                units[k] = units[k] or unit
            break
    return names, units


def _fill_key_units(
    above: list[list[str]],
    layout: Layout,
    names: list[str],
    units: list[str | None],
    has_clock: bool,
) -> None:
    """Fill the units that stand behind a key, one for each column or one for all."""
    for row in above:
        if not row or _key(row[0]) not in _VALUE_UNITS:
            continue
        stated = [cell for cell in row[1:] if cell]
        for k, kind in enumerate(layout.kinds):
            if units[k] or kind != "n" or names[k].lower() in ("time", "t", "x_value"):
                continue
            beside = row[k] if 0 < k < len(row) else ""
            if beside and Unit.of(beside):
                units[k] = beside
            elif len(stated) == 1 and Unit.of(stated[0]) and (k > 0 or has_clock):
                units[k] = stated[0]


def _clock(facts: dict[str, str]) -> Clock | None:
    """Return the clock that the facts state, None if there is none or it cannot be read."""
    step = None
    if "increment" in facts or facts.get("xdimension", "time").lower() == "time":
        step = _stated(facts, _STEPS, "time")
    if step is None and "xstart" in facts:
        step = _stated(facts, ("resolution",), "time")
    if step is None:
        rate = _stated(facts, _RATES, "frequency")
        step = 1.0 / rate if rate and rate > 0.0 else None
    start = _stated(facts, _STARTS, "time") if set(_STARTS) & set(facts) else 0.0
    if step is None or start is None or not 0.0 < step < 1e6 or not abs(start) < 1e12:
        return None
    counts = (_QUANTITY.fullmatch(facts[key].split(":")[-1]) for key in _COUNTS if key in facts)
    count = next((float(found[1]) for found in counts if found and not found[2]), 0.0)
    # LabVIEW states one sample for a file that is still being written.
    return Clock(start, step, int(count) if 1.0 < count < 1e12 else None)


def _other_clocks(above: list[list[str]], clock: Clock | None) -> dict[int, Clock]:
    """Return the clocks of columns whose steps are not those of the first channel.

    LabVIEW puts channels of several rates side by side; its column of times is the first one's.
    """

    def numbers(key: str) -> dict[int, float]:
        row = next((row for row in above if row and _key(row[0]) == key), [])
        values = {k: _si(cell, "time") for k, cell in enumerate(row) if k and cell}
        return {k: value for k, value in values.items() if value is not None}

    if clock is None:
        return {}
    starts = numbers("x0")
    return {
        k: Clock(starts.get(k, 0.0), step)
        for k, step in numbers("deltax").items()
        if step != clock.step and 0.0 < step < 1e6
    }


def _stated(facts: dict[str, str], keys: Iterable[str], dimension: str) -> float | None:
    """Return the number of the first key that there is, in the SI unit."""
    text = next((facts[key] for key in keys if key in facts), None)
    return None if text is None else _si(text, dimension)


def _si(text: str, dimension: str) -> float | None:
    """Return a number in the SI unit, None if it is of something else."""
    found = _QUANTITY.fullmatch(text.split(":")[-1].replace(",", ".").strip())
    if not found:
        return None
    stated = _SAMPLES_A_SECOND.sub("Hz", found[2]) if found[2] else None
    unit = Unit.of(stated) if stated else Unit(dimension, 1.0)
    return float(found[1]) * unit.factor if unit and unit.dimension == dimension else None
