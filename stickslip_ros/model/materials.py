# SPDX-License-Identifier: Apache-2.0
"""Runner materials of Table 3. All of them ran against ruby.

What the paper measured with them (Fig. 6, 9, 10) is in its figures only: data, not a rule
for parameters. See docs/derivations.md.
"""

from __future__ import annotations

from typing import NamedTuple

#: kN/mm^2 to Pa
_KILONEWTON_PER_SQUARE_MILLIMETRE = 1e9


class Material(NamedTuple):
    """One row of Table 3."""

    name: str
    printed_modulus: float  #: Young's modulus as printed, kN/mm^2
    comment: str

    @property
    def youngs_modulus(self) -> float:
        """Young's modulus, Pa."""
        return self.printed_modulus * _KILONEWTON_PER_SQUARE_MILLIMETRE


MATERIALS = (
    Material("Glass", 70.0, "microscope slide; of all these the largest 0-amplitude"),
    Material("AlMgSi0.5", 70.0, "aluminium alloy 6060"),
    Material("CuZn39Pb3", 97.0, "brass"),
    Material("Steel 1.4301", 200.0, "stainless, one of two that may leave the trends"),
    Material("Steel 1.4112", 215.0, "hardened to 55 on the Rockwell scale"),
    Material("Steel pin", 220.0, "dowel pin after DIN 6325"),
    Material("Al2O3", 350.0, "white ceramic"),
    Material("Tungsten", 400.0, "from an electrode for welding"),
    Material("Tungsten carbide", 600.0, "from a tool made to wear little"),
)
