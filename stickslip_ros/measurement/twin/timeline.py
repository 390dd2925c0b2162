# SPDX-License-Identifier: Apache-2.0
"""The commands of an axis as pieces of drive cycles over time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

#: s after which an axis is at rest: a ringing has decayed
RESTED = 0.02
#: A cycle that lacks less than this fraction of itself has ended: rounding of times
_ROUNDING = 1e-6


@dataclass(frozen=True)
class TwinCommand:
    """A command at a time: steps, jog (Hz), amplitude (V), frequency (Hz), stop, start, or others.

    During any other command (a closed loop, a scan) the twin does not know the cycles. "start" says
    that the axis begins anew.
    """

    t: float  #: s
    name: str
    value: float = 0.0


class OperatingPoint(NamedTuple):
    """An operating point, and what was before it; tables of the model are made for each."""

    amplitude: float  #: V
    frequency: float  #: Hz
    direction: int  #: +1 or -1
    before: int  #: direction of the steps before, 0 if there were none


@dataclass(frozen=True)
class Piece:
    """Drive cycles of one drive."""

    start: float  #: s
    drive: OperatingPoint | None  #: None: unknown ones
    cycles: float  #: inf: until something ends them; unknown ones count as if of 1 Hz
    rests: bool = True  #: whether the axis rests afterwards
    alike: bool = False  #: whether those before had this amplitude and frequency, and then a rest

    @property
    def end(self) -> float:
        """Time (s) at which the last cycle ends."""
        return self.start + self.cycles / (self.drive.frequency if self.drive else 1.0)

    def cycles_at(self, t: float) -> float:
        """Return the cycles (with their part) done at a time (s)."""
        done = (t - self.start) * (self.drive.frequency if self.drive else 1.0)
        return min(max(done, 0.0), self.cycles)

    def cut(self, t: float) -> Piece:
        """Return the piece as it ends at a time (s), after the cycle that runs if it is known."""
        done = self.cycles_at(t)
        whole = float(math.ceil(done - _ROUNDING)) if self.drive else done
        return replace(self, cycles=min(whole, self.cycles))


class Timeline:
    """Pieces of drive cycles in the order of time, from commands in the order of time."""

    def __init__(self, amplitude: float, frequency: float) -> None:
        """Begin at rest with an amplitude (V) and a frequency (Hz)."""
        self.amplitude, self.frequency = amplitude, frequency
        self.pieces: list[Piece] = []
        self._direction = 0
        self._before = 0.0, 0.0  # amplitude and frequency of the steps before

    def add(self, command: TwinCommand) -> None:
        """Add a command; those of the drive count from the next cycle on, as on the axis."""
        name, value, t = command.name, command.value, command.t
        if name in ("amplitude", "frequency"):
            setattr(self, name, value)
            last = self.pieces[-1] if self.pieces else None
            left = last.cycles - last.cut(t).cycles if last else 0.0
            if last and last.drive and left > 0.0:  # a new frequency ends that of a jog
                frequency = last.drive.frequency if name == "amplitude" else 0.0
                self._begin(t, last.drive.direction, left, frequency)
        elif name == "start":
            self.clear()
        elif name in ("steps", "jog") and value:
            cycles = abs(value) if name == "steps" else math.inf
            self._begin(t, int(math.copysign(1, value)), cycles, abs(value) if name == "jog" else 0)
        elif name in ("steps", "jog", "stop"):
            self._end(t)
        else:
            self._end(t)
            self.pieces.append(Piece(t, None, math.inf))

    def clear(self) -> None:
        """Forget all that was before."""
        self.pieces.clear()
        self._direction = 0

    def piece(self, start: float, direction: int, cycles: float, frequency: float = 0.0) -> Piece:
        """Return the piece of cycles that would be commanded now; frequency (Hz) of a jog."""
        drive = self.amplitude, frequency or self.frequency
        rested = not self.pieces or start - self.pieces[-1].end > RESTED
        point = OperatingPoint(*drive, direction, self._direction)
        return Piece(start, point, cycles, alike=rested and drive == self._before)

    def _end(self, t: float) -> float:
        """End what runs after its cycle; return the time (s) from which on something new runs."""
        if not self.pieces:
            return t
        last = self.pieces[-1] = self.pieces[-1].cut(t)
        return max(t, last.end)

    def _begin(self, t: float, direction: int, cycles: float, frequency: float) -> None:
        start = self._end(t)
        if self.pieces and start == self.pieces[-1].end > t:
            self.pieces[-1] = replace(self.pieces[-1], rests=False)
        self.pieces.append(self.piece(start, direction, cycles, frequency))
        self._direction = direction
        self._before = self.amplitude, frequency or self.frequency

    def between(self, t0: float, t1: float) -> Iterator[tuple[Piece, float, float]]:
        """Yield the pieces that matter from t0 to t1 (s), each with its part of that time.

        A piece goes on to matter while it rests, until the next one begins.
        """
        for number, piece in enumerate(self.pieces):
            following = self.pieces[number + 1].start if number + 1 < len(self.pieces) else math.inf
            begin, end = max(t0, piece.start), min(t1, following)
            if begin < end:
                yield piece, begin, end

    def forget(self, t: float) -> None:
        """Forget the pieces that nothing after a time (s) asks for."""
        while len(self.pieces) > 1 and self.pieces[1].start <= t:
            self.pieces.pop(0)

    def blind_between(self, t0: float, t1: float) -> bool:
        """Return whether unknown cycles may have run between two times (s)."""
        return any(one.drive is None and t < one.end for one, t, _ in self.between(t0, t1))
