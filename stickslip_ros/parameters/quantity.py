# SPDX-License-Identifier: Apache-2.0
"""Quantities as people type them: ``1kHz``, ``-5 um``, ``200V``, or a number in the SI unit."""

from __future__ import annotations

import math
import re

#: A number as people and instruments write it, as a regular expression.
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_NUMBER = re.compile(rf"({NUMBER}|[+-]?inf|nan)\s*(.*)")
#: SI prefixes; micro is u here, whichever letter is typed.
PREFIXES = {
    "": 1.0, "f": 1e-15, "p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6, "G": 1e9,
}  # fmt: skip
#: Units that are typed for those of the table, and how much of these one of them is.
_OTHERS = {"kg": {"g": 1e-3}, "rad": {"deg": math.pi / 180.0}, "": {"%": 0.01}}


def read_quantity(text: str, unit: str) -> float:
    """Parse a number, with or without its unit and an SI prefix; return it in the given unit.

    Raises ValueError, with a message that shows how to write the quantity.
    """
    # As papers and our own tables print them.
    plain = text.strip().replace("\u2212", "-").replace("\u00b5", "u").replace("\u03bc", "u")
    found = _NUMBER.fullmatch(plain)
    wanted = f"a number, such as {f'1.5 {unit}'.strip()}"
    if re.match(r"[+-]?\d+,\d", plain):
        raise ValueError(f"{text!r} has a comma; write 1.5 with a point")
    if not found:
        raise ValueError(f"{text!r} is not {wanted}")
    value, typed = float(found[1]), found[2].strip()
    if typed in ("", unit):
        return value
    for name, size in {unit: 1.0, **_OTHERS.get(unit, {})}.items():
        prefix = typed.removesuffix(name)
        if name and typed.endswith(name) and prefix in PREFIXES:
            # Divided, as 5 / 1e6 is the 5e-6 that is meant, and 5 * 1e-6 is not always.
            factor = size * PREFIXES[prefix]
            return value / round(1.0 / factor) if factor in _WHOLE_PARTS else value * factor
    raise ValueError(f"{text!r} is in {typed}; write {wanted}")


_WHOLE_PARTS = (1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 0.01)
