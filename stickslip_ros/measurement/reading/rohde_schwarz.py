# SPDX-License-Identifier: Apache-2.0
"""Exports of Rohde & Schwarz RTO and RTP: ``X.csv`` describes the numbers in ``X.Wfm.csv``.

The numbers have no header. With one column more than channels were exported, the first is the
time; otherwise the description gives the time of the first sample and the step. Binary exports are
pairs, too: ``X.bin`` describes ``X.Wfm.bin`` in XML.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from stickslip_ros.measurement.reading.layout import Layout
from stickslip_ros.measurement.reading.preamble import Preamble
from stickslip_ros.measurement.reading.table import Clock, MeasurementError
from stickslip_ros.opening import ReadError, open_regular

_SUFFIX, _BINARY = ".wfm.csv", ".wfm.bin"
#: Bytes of a description at most: each channel has a few hundred.
_LARGEST = 1_000_000
#: What the names of its units begin with.
_UNIT = "eRS_UNIT_"


def numbers_of(path: Path) -> Path:
    """Return the file with the numbers: path itself, or what it describes."""
    if path.suffix.lower() == ".csv" and not path.name.lower().endswith(_SUFFIX):
        partner = path.with_name(f"{path.name[:-4]}.Wfm.csv")
        if partner.is_file():
            return partner
    return path


def describe(path: Path, layout: Layout, preamble: Preamble) -> None:
    """Fill in what the description beside the numbers says, if there is one."""
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


def unit_of(path: Path) -> str:
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
