# SPDX-License-Identifier: Apache-2.0
"""Exports in two files: one describes the samples in the other.

Rohde & Schwarz RTO and RTP: ``X.csv`` describes the numbers in ``X.Wfm.csv``, which have no header.
With one column more than channels were exported, the first is the time; otherwise the description
gives the time of the first sample and the step. ``X.bin`` describes ``X.Wfm.bin`` in XML.

Yokogawa: ``X.hdr`` describes ``X.wvf``. The layout is that of Yokogawa's manual IM 707713-61E,
which RigolWFM reads. Its `Wfm` keeps four traces of the first group; here all are read, with units,
and samples beyond the range are gaps.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from stickslip_ros.measurement.reading.instruments import asking, library
from stickslip_ros.measurement.reading.layout import Layout
from stickslip_ros.measurement.reading.preamble import Preamble
from stickslip_ros.measurement.reading.table import Clock, MeasurementError, Named, Table
from stickslip_ros.opening import ReadError, open_regular

_SUFFIX, _BINARY = ".wfm.csv", ".wfm.bin"
#: Bytes of a description at most: each channel has a few hundred.
_LARGEST = 1_000_000
#: Start of the names of its units.
_UNIT = "eRS_UNIT_"
#: How files begin that have the scope's own settings before and behind the samples.
_OWN = b"%WDF"


def numbers_of(path: Path) -> Path:
    """Return the file with the numbers: path itself, or the file that it describes."""
    if path.suffix.lower() == ".csv" and not path.name.lower().endswith(_SUFFIX):
        partner = path.with_name(f"{path.name[:-4]}.Wfm.csv")
        if partner.is_file():
            return partner
    return path


def add_description(path: Path, layout: Layout, preamble: Preamble) -> None:
    """Add the information of the description beside the numbers, if there is one."""
    if not path.name.lower().endswith(_SUFFIX) or any(preamble.names):
        return
    partner = path.with_name(f"{path.name[: -len(_SUFFIX)]}.csv")
    try:
        with open_regular(partner, _LARGEST) as file:
            text = file.read().decode("utf-8", "replace")
    except (OSError, ReadError):
        return
    facts = {}
    for line in text.splitlines():
        key, _, value = line.partition(":")
        facts[key] = value.rstrip(":").split(":")
    if "XStart" not in facts or "SignalResolution" not in facts:
        return
    channels, units = _channels(facts)
    width = len(layout.kinds)
    if width == len(channels) + 1:
        preamble.names, preamble.units = ["time", *channels], ["s", *units]
    elif width == len(channels):
        preamble.names, preamble.units = list(channels), list(units)
        # Of several acquisitions one after the other, nothing says when they were.
        if facts.get("NumberOfAcquisitions", ["1"])[0] == "1":
            start, step = float(facts["XStart"][0]), float(facts["SignalResolution"][0])
            count = int(facts.get("SignalRecordLength", ["0"])[0]) or None
            preamble.clock = Clock(start, step, count) if step > 0.0 else None


def _channels(facts: dict[str, list[str]]) -> tuple[list[str], list[str | None]]:
    """Return names and units of the channels that were exported."""
    if facts.get("MultiChannelExport", ["Off"])[0] != "On":
        name = facts.get("Source", [""])[0]
        return [name], [facts.get("BaseUnit", [""])[0] or None]
    states = facts.get("MultiChannelExportState", [])[1:]
    names = facts.get("MultiChannelSource", [])[1:]
    units = facts.get("MultiChannelViewUnit", [])[1:]
    chosen = [k for k, state in enumerate(states) if state == "On" and k < len(names)]
    return [names[k] for k in chosen], [units[k] if k < len(units) else None for k in chosen]


def description_of(path: Path) -> Path:
    """Return the file that describes binary samples, any other path itself. MeasurementError."""
    if not path.name.lower().endswith(_BINARY):
        return path
    partner = path.with_name(f"{path.name[: -len(_BINARY)]}.bin")
    if not partner.is_file():
        raise MeasurementError(f"its {partner.name}, which describes it, is not beside it")
    return partner


def sample_unit(path: Path) -> str:
    """Return the unit of the samples that a binary export describes. Raises MeasurementError."""
    facts = {one.get("Name"): one.attrib for one in ElementTree.parse(path).iter("Prop")}
    names = {facts.get("BaseUnit", {}).get("Value", "")}
    if facts.get("MultiChannelExport", {}).get("Value", "").endswith("_ON"):
        states, units = facts["MultiChannelExportState"], facts["MultiChannelViewUnit"]
        chosen = [key for key, state in states.items() if state.endswith("_ON")]
        names = {units.get(key, "") for key in chosen}
    if len(names) != 1:
        raise MeasurementError("its channels have different units; export one channel")
    return names.pop().removeprefix(_UNIT).removeprefix("LEVEL_")


def read_wvf(path: Path) -> Table:
    """Return the traces of a pair, given either of its files. MeasurementError and OSError."""
    layouts = library("RigolWFM.yokogawa_hdr", "waveforms of oscilloscopes", "RigolWFM")
    described, samples = _beside(path, ".hdr"), _beside(path, ".wvf")
    found: list[Named] = []
    with asking("Yokogawa waveform"):
        header = layouts.parse_hdr(str(described))
        content = samples.read_bytes()
        _check(header, samples.name, content)
        for g, group in enumerate(header.groups):
            for k, trace in enumerate(group.traces):
                kind = trace.v_data_type
                if kind.is_logic or trace.h_unit != "s" or trace.block_size < 2:
                    continue
                form = f"{header.byte_order}{kind.numpy_dtype}"
                place = layouts.wvf_byte_offset(header, g, k, 0)
                raw = np.frombuffer(content, form, trace.block_size, place)
                clock = Clock(trace.h_offset, trace.h_resolution)
                found.append((trace.name, trace.v_unit, _values(raw, trace), clock))
    return Table.of(found)


def _beside(path: Path, suffix: str) -> Path:
    """Return the file of that suffix, of the same name. Raises MeasurementError."""
    if path.suffix.lower() == suffix:
        return path
    for one in (suffix, suffix.upper()):
        if path.with_suffix(one).is_file():
            return path.with_suffix(one)
    raise MeasurementError(f"its {path.stem}{suffix} is not beside it; copy both")


def _check(header: Any, name: str, content: bytes) -> None:
    """Raise MeasurementError if the content lacks samples of a trace in the header."""
    expected = header.data_offset
    for group in header.groups:
        if group.block_number != 1:
            raise MeasurementError(
                f"its waveform has {group.block_number} blocks with gaps between them; export one "
                "as text"
            )
        for trace in group.traces:
            if trace.v_data_type is None:
                raise MeasurementError(f"the form of the samples of {trace.name} is not known")
            expected += trace.block_size * trace.v_data_type.byte_num
    size = len(content)
    if size < expected or (size > expected and not content.startswith(_OWN)):
        raise MeasurementError(
            f"its waveform takes {expected} bytes, but {name} has {size}: it is damaged"
        )


def _values(raw: Any, trace: Any) -> Any:
    """Return samples in the unit of the trace; nan where it states that there is none."""
    values = trace.v_resolution * raw.astype(np.float64) + trace.v_offset
    for code in (trace.v_illegal, trace.v_plus_over, trace.v_minus_over):
        if code is not None:
            # A header may state the code of 16 bits without its sign.
            values[(raw == code) | (raw == code - (1 << 8 * raw.itemsize))] = np.nan
    return values
