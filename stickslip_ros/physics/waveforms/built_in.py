# SPDX-License-Identifier: Apache-2.0
"""Waveforms of straight segments: the sawtooth (section 2, Fig. 2), its extensions, a triangle.

A hold of the level before or after the slip recovers the elastic deflection, and the step grows
("step elongation", section 4.2). With the slip in two parts, the second part cancels the ringing of
the first ("input shaping", section 4.2).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from stickslip_ros.physics.parameters import DriveParameters

#: V/us to V/s
PER_MICROSECOND = 1e6


def sawtooth_shape(d: DriveParameters) -> Shape:
    """Return the sawtooth of amplitude (V), frequency (Hz) and slewrate of the slip (V/us)."""
    period, fall = 1.0 / d.frequency, slip_time(d)
    return Shape((period - fall, fall), (1.0, -1.0), slip=(1, 2), time_for_slip=period)


def hold_shape(d: DriveParameters) -> Shape:
    """Return a sawtooth whose level is held for parts of the period before and after the slip."""
    period, fall = 1.0 / d.frequency, slip_time(d)
    before, after = d.hold_before * period, d.hold_after * period
    time = period - before - after
    return Shape(
        (time - fall, before, fall, after), (1.0, 0.0, -1.0, 0.0), slip=(2, 3), time_for_slip=time
    )


def shaped_shape(d: DriveParameters) -> Shape:
    """Return the waveform ``hold`` with its slip in two parts and ``latency`` (s) between them.

    ``split`` is the fraction of the first part in the slip.
    """
    period, fall = 1.0 / d.frequency, slip_time(d)
    split, latency = d.split, d.latency
    before, after = d.hold_before * period, d.hold_after * period
    time = period - before - after - latency
    return Shape(
        (time - fall, before, split * fall, latency, (1.0 - split) * fall, after),
        (1.0, 0.0, -split, 0.0, split - 1.0, 0.0),
        slip=(2, 5),
        time_for_slip=time,
    )


def triangle_shape(d: DriveParameters) -> Shape:
    """Return the symmetric triangle of frequency (Hz); the slewrate plays no part."""
    half = 0.5 / d.frequency
    return Shape((half, half), (1.0, -1.0), slip=(1, 2))


def slip_time(d: DriveParameters) -> Any:
    """Return how long (s) the amplitude takes at the slewrate."""
    return d.amplitude / (d.slewrate * PER_MICROSECOND)


def slip_too_long(d: DriveParameters, shape: Shape) -> str:
    """Return the error message for a cycle without time for the slip, with the cure."""
    period, fall, time = 1.0 / d.frequency, slip_time(d), shape.time_for_slip
    cycle = f"frequency {d.frequency:g} Hz leaves {1e6 * period:g} us a cycle"
    slip = f"the slip of {d.amplitude:g} V at {d.slewrate:g} V/us takes {1e6 * fall:g} us"
    cure = "lower the amplitude or raise the slewrate"
    if math.isinf(time):  # the shape does not say what it leaves
        return f"{cycle}, too little for a segment of the waveform: lower the frequency"
    if time == period:
        return f"{cycle}, but {slip}: stay below {1.0 / fall:g} Hz, or {cure}"
    return (
        f"{cycle}, of which holds and latency take {1e6 * (period - time):g} us, and {slip}: "
        f"lower hold_before, hold_after, latency or the frequency, or {cure}"
    )


Waveform = TypeVar("Waveform", bound=Callable[..., Any])


def with_rows(rows: type) -> Callable[[Waveform], Waveform]:
    """Return a decorator that gives a waveform a dataclass of its own constants."""

    def carry(waveform: Waveform) -> Waveform:
        waveform.rows = rows  # type: ignore[attr-defined]
        return waveform

    return carry


class Shape(NamedTuple):
    """One cycle of the voltage; of many operating points numbers may be arrays (points,).

    A segment that takes no time is left out of the drive cycle. One that takes less than none, or
    that changes the level in no time, makes the shape impossible.
    """

    durations: tuple[Any, ...]  #: of the segments, s
    changes: tuple[Any, ...]  #: of the level within them, fractions of the amplitude
    slip: tuple[int, int]  #: first segment of the slip and the one after its last
    start: float = 0.0  #: level at the start, fraction of the amplitude
    time_for_slip: Any = math.inf  #: time that the rest of the cycle leaves for the slip, s
