# SPDX-License-Identifier: Apache-2.0
"""Units as instruments write them, names with units, and the scale of a sensor.

A unit is a prefix and a name, such as ``nm``, ``µs``, ``mV``, ``Volt``, ``seconds`` or
``nanometers``. Letters count as the SI has them, apart from spellings that can mean one thing only
(``S`` or ``SEC`` for seconds, ``MM`` for mm). What is not known here is asked for, never guessed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from stickslip_ros.measurement.reading.table import MeasurementError

_PREFIXES = {
    "f": 1e-15, "p": 1e-12, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3,
    "k": 1e3, "M": 1e6, "G": 1e9,
}  # fmt: skip
_LONG_PREFIXES = {
    "femto": 1e-15, "pico": 1e-12, "nano": 1e-9, "micro": 1e-6, "milli": 1e-3,
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
    "µsec": ("time", 1e-6), "msec": ("time", 1e-3), "nsec": ("time", 1e-9),
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
             "MV": None, "v": "V", "mv": "mV", "uv": "uV", "kv": "kV"}  # fmt: skip
#: What numbers samples and measures nothing.
INDEX_UNITS = {"sequence", "index", "sample", "samples", "point", "points", "no.", "#"}
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
        plain = text.strip().strip("()[]{}").strip().replace("Âµ", "µ").replace("Î¼", "μ")
        plain = plain.replace("²", "^2").replace("s2", "s^2").replace("**", "^")
        plain = _CAPITALS.get(plain, plain) or plain
        if plain in _OTHERS:
            return cls(*_OTHERS[plain])
        if plain in _SYMBOLS:
            return cls(_SYMBOLS[plain], 1.0)
        if plain[:1] in _PREFIXES and plain[1:] in _SYMBOLS:
            return cls(_SYMBOLS[plain[1:]], _PREFIXES[plain[0]])
        return _word(plain.lower())


@dataclass(frozen=True)
class Scale:
    """What one of a column stands for: ``50nm/V`` is 50e-9 of length a volt."""

    factor: float
    unit: str | None  #: dimension of the result; None: the column's own
    per: Unit | None  #: what the column measures, where the scale says so

    @classmethod
    def of(cls, text: str, dimension: str) -> Scale:
        """Return a scale as typed, such as ``50nm/V``, ``-0.5um/V``, ``2nm`` or ``-1``.

        dimension is that of the result. Raises MeasurementError.
        """
        found = _SCALE.fullmatch(text.strip())
        unit = Unit.of(found["unit"]) if found and found["unit"] else None
        wrong = MeasurementError(
            f"the scale {text!r} is not understood; write it as 50nm/V, -0.5um/V or -1"
        )
        if not found or not (found["number"] or unit) or (found["unit"] and not unit):
            raise wrong
        number = found["number"] or "1"
        factor = float(number + "1" if number in "+-" else number)
        if not 0.0 < abs(factor) < 1e30:
            raise MeasurementError(f"the scale {text!r} has to be a number other than 0")
        if unit is None:
            if found["per"]:
                raise wrong
            return cls(factor, None, None)
        if unit.dimension != dimension:
            raise MeasurementError(
                f"the scale {text!r} gives a {unit.dimension}; it has to give a {dimension}"
            )
        factor *= unit.factor / float(found["count"] or 1.0)
        if not found["per"] or found["per"].lower() in _COUNTS:
            return cls(factor, dimension, None)
        per = Unit.of(found["per"])
        if per is None:
            raise MeasurementError(f"the scale {text!r}: {found['per']!r} is not a known unit")
        return cls(factor, dimension, per)


def _word(text: str) -> Unit | None:
    if text in _OTHERS:
        return Unit(*_OTHERS[text])
    for prefix, factor in {"": 1.0, **_LONG_PREFIXES}.items():
        rest = text.removeprefix(prefix) if text.startswith(prefix) else ""
        for word in (rest, rest.removesuffix("s")):
            if word in _WORDS:
                return Unit(_WORDS[word], factor)
    return None


def is_index(text: str | None) -> bool:
    """Return whether a unit says that a column numbers its samples."""
    return text is not None and text.strip().strip("()[]").lower() in INDEX_UNITS


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


_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_SCALE = re.compile(rf"(?P<number>{_NUMBER}|[+-])?\s*(?P<unit>[^\d\s/*][^\s/]*)?"
                    r"\s*(?:/\s*(?P<count>\d+\.?\d*)?\s*(?P<per>\S+))?")  # fmt: skip
_COUNTS = {"count", "counts", "digit", "digits", "lsb", "step", "steps", "sample", "samples", "1"}
