# SPDX-License-Identifier: Apache-2.0
"""Units as instruments write them, and names of columns with units.

A unit is a prefix and a name, such as ``nm``, ``µs``, ``mV``, ``Volt``, ``seconds`` or
``nanometers``. Letters count as the SI has them, apart from spellings that can mean one thing only
(``S`` or ``SEC`` for seconds, ``MM`` for mm). What is not known here is asked for, never guessed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from stickslip_ros.physics.parameters.row import PREFIXES

_LONG_PREFIXES = {
    "": 1.0, "femto": 1e-15, "pico": 1e-12, "nano": 1e-9, "micro": 1e-6, "milli": 1e-3,
    "centi": 1e-2, "kilo": 1e3, "mega": 1e6, "giga": 1e9,
}  # fmt: skip
#: Of each quantity: symbols that take a prefix; words, each with or without a long prefix and a
#: plural s; units with a size of their own.
_KNOWN: dict[str, tuple[str, str, dict[str, float]]] = {
    "time": ("s", "second sec sekunde", {
        "min": 60.0, "minute": 60.0, "minutes": 60.0, "h": 3600.0, "hr": 3600.0, "hour": 3600.0,
        "hours": 3600.0, "secs": 1.0, "usec": 1e-6, "msec": 1e-3, "nsec": 1e-9}),
    "length": ("m", "meter metre", {
        "cm": 1e-2, "dm": 1e-1, "micron": 1e-6, "microns": 1e-6, "Å": 1e-10, "angstrom": 1e-10,
        "inch": 25.4e-3}),
    "voltage": ("V", "volt", {"Vpp": 1.0, "mVolt": 1e-3, "mVolts": 1e-3}),
    "angle": ("rad", "radian", dict.fromkeys(("deg", "°", "degree"), 0.017453292519943295)),
    "temperature": ("K", "", {"°C": 1.0, "degC": 1.0}),
    "current": ("A", "ampere amp", {}), "frequency": ("Hz", "hertz", {}),
    "force": ("N", "newton", {}), "acceleration": ("g m/s^2", "", {}), "mass": ("", "gram", {}),
    "pressure": ("Pa", "pascal", {}), "power": ("W", "watt", {}), "resistance": ("Ω", "ohm", {}),
    "charge": ("C", "", {}), "data": ("B", "", {}), "field": ("T", "", {}),
    "velocity": ("m/s", "", {}), "share": ("", "", {"%": 0.01}), "level": ("", "", dict.fromkeys(
        ("dB", "dBm"), 1.0)),
}  # fmt: skip
#: Capitals that cannot mean anything else.
_CAPITALS = {"S": "s", "MS": "ms", "US": "us", "NS": "ns", "SEC": "sec", "MM": "mm", "UM": "um",
             "v": "V", "mv": "mV", "uv": "uV", "kv": "kV"}  # fmt: skip
#: Other spellings of a part of a unit; two are UTF-8 that was read as Latin-1.
_SPELLINGS = (("Âµ", "u"), ("Î¼", "u"), ("µ", "u"), ("μ", "u"), ("²", "^2"), ("s2", "s^2"),
              ("**", "^"))  # fmt: skip
#: Units of columns that number the samples.
_INDEX_UNITS = {"sequence", "index", "sample", "samples", "point", "points", "no.", "#"}
#: Texts in a line of units that are not units.
_NO_UNITS = {"", "-", "--", "a.u.", "au", "n/a", "none", "1", "count", "counts", "lsb", "digits"}


@dataclass(frozen=True)
class Unit:
    """The quantity of a number, and the factor to its SI unit."""

    dimension: str
    factor: float

    @classmethod
    def of(cls, text: str | None) -> Unit | None:
        """Return the unit that a text means, None if it means none that is known."""
        if text is None:
            return None
        plain = text.strip(" ()[]{}")
        for spelling, letter in _SPELLINGS:
            plain = plain.replace(spelling, letter)
        plain = _CAPITALS.get(plain, plain)
        return _UNITS.get(plain) or _WORD_UNITS.get(plain.lower())


_UNITS: dict[str, Unit] = {}
_WORD_UNITS: dict[str, Unit] = {}  # they mean the same in capitals and small letters
for _dimension, (_symbols, _words, _sized) in _KNOWN.items():
    _own = {name: Unit(_dimension, factor) for name, factor in _sized.items()}
    _UNITS |= {prefix + symbol: Unit(_dimension, factor) for symbol in _symbols.split()
               for prefix, factor in PREFIXES.items()} | _own  # fmt: skip
    _WORD_UNITS |= {prefix + word + plural: Unit(_dimension, factor) for word in _words.split()
                    for prefix, factor in _LONG_PREFIXES.items()
                    for plural in ("", "s")} | _own  # fmt: skip


def is_index(text: str | None) -> bool:
    """Return whether a unit says that a column numbers its samples."""
    return text is not None and text.strip(" ()[]").lower() in _INDEX_UNITS


def is_unit_cell(text: str) -> bool:
    """Return whether a text can be a cell in a line of units."""
    plain = text.strip(" ()[]")
    return plain.lower() in _NO_UNITS or Unit.of(plain) is not None or is_index(plain)


#: A number in brackets is an index, as in ``position[0]``.
_BRACKETS = re.compile(r"(?P<name>.*?)[\s_]*[(\[{](?!\d+[)\]}])(?P<unit>[^()\[\]{}]*)[)\]}]\s*\.?")
#: Other ways in which a unit that is known stands behind a name.
_BEHIND = re.compile(
    r"(?P<name>.*?)(?P<mark>(?:^|\s+)in\s+|\s*/\s*|[_\s:,]\s*)(?P<unit>[A-Za-zµμÅ^0-9°%]+(/s[\^2]*)?)"
)
#: A channel with its unit.
_CHANNEL = re.compile(r"((?:CHAN|CH|C|MATH)\d*)\s*(V|mV|A)")
#: Tails of a name that are one letter may be a word of it: only these end in their unit.
_WITH_LETTER = {
    "s": "t time timestamp elapsed elapsed_time zeit seconds",
    "m": "x position pos runner slider displacement distance weg path deflection elongation stroke "
         "actuator piezo u",
    "V": "voltage volt drive piezo command u",
}  # fmt: skip


def name_and_unit(text: str) -> tuple[str, str | None]:
    """Return a column's name and its unit as the header has them.

    Understood are ``x (nm)``, ``x [nm]``, ``x / nm``, ``x in nm``, ``x_nm``, ``CH1V``.
    """
    text = " ".join(text.split())
    if found := _BRACKETS.fullmatch(text):
        return found["name"].strip(), found["unit"].strip() or None
    if found := _CHANNEL.fullmatch(text):
        return found[1], found[2]
    found = _BEHIND.fullmatch(text)
    if found and Unit.of(unit := found["unit"]):
        name = found["name"].strip()
        last = re.split(r"[./_ ]", name.lower())[-1]
        if found["mark"].strip() in ("in", "/"):
            sure = not text.startswith("/")  # a topic of ROS
        else:
            sure = len(unit) > 1 or last in _WITH_LETTER.get(unit, "").split()
        if sure:
            return name, unit
    return text, None
