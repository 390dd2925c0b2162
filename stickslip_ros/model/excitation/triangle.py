# SPDX-License-Identifier: Apache-2.0
"""Up and down alike: a runner in contact follows it and makes no steps of its own."""

from __future__ import annotations

from stickslip_ros.model.excitation.shape import Shape
from stickslip_ros.parameters import DriveParameters


def triangle_shape(d: DriveParameters) -> Shape:
    """Return the symmetric triangle of frequency (Hz); the slewrate plays no part."""
    half = 0.5 / d.frequency
    return Shape((half, half), (1.0, -1.0), slip=(1, 2))
