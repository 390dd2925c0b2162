# SPDX-License-Identifier: Apache-2.0
"""The step of each drive as the readings show it, whatever the parameters of the model are.

Positions over the cycles that were driven, less the shape that one model gives a cycle: a straight
line, whose slope is the step. So a change that is explained wrongly leaves the step right.
"""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.measurement.twin.response import Model, parts_of_cycles
from stickslip_ros.measurement.twin.settings import TwinSettings
from stickslip_ros.measurement.twin.timeline import OperatingPoint
from stickslip_ros.measurement.twin.tracker import THETA, ProcessedReading, ReadingFilter

#: Steps (m) that may be, as a standard deviation
_ANY = 1e-6
#: Part of a step by which the begin and the end of a run differ from those of the model
_EDGE = 0.1
#: Part of a step by which it differs from run to run
_AGAIN = 0.03


class StepRegression:
    """Steps by amplitude, frequency and direction, from readings in the order of time."""

    def __init__(self, model: Model, settings: TwinSettings) -> None:
        """Begin without a reading; the model gives the shape of cycles and their ringing."""
        self._model, self._settings = model, settings
        self._filters: dict[tuple[float, float, int], ReadingFilter] = {}
        self._present: ReadingFilter | None = None  # of the drive that ran last
        self._last: ProcessedReading | None = None

    def take(self, one: ProcessedReading) -> None:
        """Take a reading with the pieces of cycles before it."""
        last, self._last = self._last, one
        driven = [part for part in one.parts if part[0].drive]
        # The piece before goes on to matter while it rests, but makes no steps then.
        ran = (piece for piece, begin, end in driven
               if piece.cycles_at(end) > piece.cycles_at(begin))  # fmt: skip
        drives = {piece.drive[:3] for piece in ran if piece.drive}
        opened = False
        if one.motion.direction and last is not None:
            known = len(drives) == 1
            present = self._filters.setdefault(drives.pop(), self._new()) if known else None
            if (
                present is not None and present is not self._present
            ):  # a run may have begun in readings of two drives
                present.anchor(last.reading, last.motion.blur)
                opened = True
            self._present = present
        if self._present is None or last is None:
            return
        cycles = shape = scatter = 0.0
        blur = one.motion.blur
        for piece, begin, end in driven:
            assert piece.drive
            curve, at = self._model.curve(piece.drive), parts_of_cycles(piece, begin, end)
            done, step = float(at[0][1] - at[0][0]), float(curve.step)
            cycles += done
            shape += float(np.diff(curve.at(*at))[0]) - done * step
            scatter += done * (self._settings.step_spread * step) ** 2
            begins = begin == piece.start
            edges = begins + (piece.rests and begin < piece.end <= end)
            scatter += edges * (_EDGE * step) ** 2
            opens = begins or (opened and done > 0.0)
            self._present.covariance[THETA, THETA] += opens * (_AGAIN * step) ** 2
            blur = curve.blur(piece, end, self._settings.timing)
        self._present.move(shape, np.array([cycles]), scatter)
        self._present.read(one.reading, blur)

    def step(self, drive: OperatingPoint) -> tuple[float, float]:
        """Return the step of a drive and its standard deviation, m; infinite where unknown."""
        found = self._filters.get(drive[:3])
        if found is None:
            return math.nan, math.inf
        return float(found.state[1]), math.sqrt(float(found.covariance[1, 1]))

    def _new(self) -> ReadingFilter:
        new = ReadingFilter(1, self._settings.noise)
        new.covariance[THETA, THETA] = _ANY**2
        return new
