# SPDX-License-Identifier: Apache-2.0
"""Units as instruments write them, and names of columns with units.

A unit is a prefix and a name, such as ``nm``, ``µs``, ``mV``, ``Volt``, ``seconds`` or
``nanometers``. Letters count as the SI has them, apart from spellings that can mean one thing only
(``S`` or ``SEC`` for seconds, ``MM`` for mm). What is not known here is asked for, never guessed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from stickslip_ros.parameters.quantity import PREFIXES

_LONG_PREFIXES = {
    "": 1.0, "femto": 1e-15, "pico": 1e-12, "nano": 1e-9, "micro": 1e-6, "milli": 1e-3,
    "centi": 1e-2, "kilo": 1e3, "mega": 1e6, "giga": 1e9,
}  # fmt: skip
#: Symbols that take a prefix, by what they measure.
_SYMBOLS = {
    "s": "time", "m": "length", "V": "voltage", "A": "current", "Hz": "frequency",
    "N": "force", "g": "acceleration", "Pa": "pressure", "W": "power", "Ω": "resistance",
    "rad": "angle", "C": "charge", "B": "data", "T": "field", "K": "temperature",
    "m/s": "velocity", "m/s^2": "acceleration",
}  # fmt: skip
#: Words, each with or without a long prefix and a plural s.
_WORDS = {
    "second": "time", "sec": "time", "sekunde": "time", "meter": "length", "metre": "length",
    "volt": "voltage", "ampere": "current", "amp": "current", "hertz": "frequency",
    "newton": "force", "gram": "mass", "pascal": "pressure", "watt": "power", "ohm": "resistance",
    "radian": "angle",
}  # fmt: skip
#: Whatever has a size of its own.
_OTHERS = {
    "min": ("time", 60.0), "minute": ("time", 60.0), "minutes": ("time", 60.0),
    "h": ("time", 3600.0), "hr": ("time", 3600.0), "hour": ("time", 3600.0),
    "hours": ("time", 3600.0), "secs": ("time", 1.0), "usec": ("time", 1e-6),
    "msec": ("time", 1e-3), "nsec": ("time", 1e-9),
    "cm": ("length", 1e-2), "dm": ("length", 1e-1), "micron": ("length", 1e-6),
    "microns": ("length", 1e-6), "Å": ("length", 1e-10), "angstrom": ("length", 1e-10),
    "inch": ("length", 25.4e-3), "deg": ("angle", 0.017453292519943295),
    "°": ("angle", 0.017453292519943295), "degree": ("angle", 0.017453292519943295),
    "°C": ("temperature", 1.0), "degC": ("temperature", 1.0), "Vpp": ("voltage", 1.0),
    "mVolt": ("voltage", 1e-3), "mVolts": ("voltage", 1e-3), "%": ("share", 0.01),
    "dB": ("level", 1.0), "dBm": ("level", 1.0),
}  # fmt: skip
#: Capitals that cannot mean anything else.
_CAPITALS = {"S": "s", "MS": "ms", "US": "us", "NS": "ns", "SEC": "sec", "MM": "mm", "UM": "um",
             "v": "V", "mv": "mV", "uv": "uV", "kv": "kV"}  # fmt: skip
#: What numbers samples and measures nothing.
_INDEX_UNITS = {"sequence", "index", "sample", "samples", "point", "points", "no.", "#"}
#: What stands in a line of units without being one.
_NO_UNITS = {"", "-", "--", "a.u.", "au", "n/a", "none", "1", "count", "counts", "lsb", "digits"}


@dataclass(frozen=True)
class Unit:
    """What a number measures, and how much of the SI unit one of it is."""

    dimension: str
    factor: float

    @classmethod
    def of(cls, text: str | None) -> Unit | None:
        """Return the unit that a text means, None if it means none that is known."""
        if text is None:
            return None
        plain = text.strip().strip("()[]{}").strip()
        for spelling, letter in _SPELLINGS:
            plain = plain.replace(spelling, letter)
        plain = _CAPITALS.get(plain, plain)
        return _UNITS.get(plain) or _WORD_UNITS.get(plain.lower())


#: Other spellings of a part of a unit; two are UTF-8 that was read as Latin-1.
_SPELLINGS = (("Âµ", "u"), ("Î¼", "u"), ("µ", "u"), ("μ", "u"), ("²", "^2"), ("s2", "s^2"),
              ("**", "^"))  # fmt: skip
_UNITS = {
    **{prefix + symbol: Unit(dimension, factor) for symbol, dimension in _SYMBOLS.items()
       for prefix, factor in PREFIXES.items()},
    **{name: Unit(*what) for name, what in _OTHERS.items()},
}  # fmt: skip
#: Words mean the same in capitals and small letters.
_WORD_UNITS = {
    **{prefix + word + plural: Unit(dimension, factor) for word, dimension in _WORDS.items()
       for prefix, factor in _LONG_PREFIXES.items() for plural in ("", "s")},
    **{name: Unit(*what) for name, what in _OTHERS.items()},
}  # fmt: skip


def is_index(text: str | None) -> bool:
    """Return whether a unit says that a column numbers its samples."""
    return text is not None and text.strip().strip("()[]").lower() in _INDEX_UNITS


def is_unit_cell(text: str) -> bool:
    """Return whether a text can stand in a line of units."""
    plain = text.strip().strip("()[]").strip()
    return plain.lower() in _NO_UNITS or Unit.of(plain) is not None or is_index(plain)


_BRACKETS = re.compile(r"(?P<name>.*?)[\s_]*(?:\((?P<a>[^()]*)\)|\[(?P<b>[^\[\]]*)\]|"
                       r"\{(?P<c>[^{}]*)\})\s*\.?")  # fmt: skip
_IN = re.compile(
    r"(?P<name>.*?)\s*(?:\bin|/)\s+(?P<unit>\S+)|(?P<slashed>[^/]*?)\s*/(?P<after>\w+)"
)
_TAIL = re.compile(r"(?P<name>.+?)(?:[_\s:,]\s*)(?P<unit>[A-Za-zµμÅ/^0-9°%]+)")
_CHANNEL_WITH_UNIT = re.compile(r"(?P<name>(?:CH|CHAN|C|MATH)\d*)\s*(?P<unit>V|mV|A)")
#: Tails of a name that are one letter may be a word of it: only times end so.
_TIMES = {"t", "time", "timestamp", "elapsed", "elapsed_time", "zeit"}


def name_and_unit(text: str) -> tuple[str, str | None]:
    """Return a column's name and its unit as the header has them.

    Understood are ``x (nm)``, ``x [nm]``, ``x / nm``, ``x in nm``, ``x_nm``, ``CH1V``.
    """
    text = " ".join(text.split())
    if found := _BRACKETS.fullmatch(text):
        return found["name"].strip(), (found["a"] or found["b"] or found["c"] or "").strip() or None
    if found := _IN.fullmatch(text):
        name, unit = found["name"] or found["slashed"] or "", found["unit"] or found["after"]
        if Unit.of(unit) and not text.startswith("/"):
            return name.strip(), unit
    if found := _CHANNEL_WITH_UNIT.fullmatch(text):
        return found["name"], found["unit"]
    if (found := _TAIL.fullmatch(text)) and Unit.of(found["unit"]):
        name, unit = found["name"].strip(), found["unit"]
        if len(unit) > 1 and unit[:1] != "/":
            return name, unit
        if unit == "s" and re.split(r"[./]", name.lower())[-1] in _TIMES:
            return name, unit
    return text, None
