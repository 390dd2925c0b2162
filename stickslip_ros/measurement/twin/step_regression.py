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
from stickslip_ros.measurement.twin.tracker import THETA, ProcessedReading, ReadingFilter, ShownStep

#: Steps (m) that may be, as a standard deviation
_ANY = 1e-6
#: Part of a step by which the begin and the end of a run differ from those of the model; cycles
#: that it takes to settle
_EDGE, _SETTLING = 0.3, 4.0
#: Deviation of a step, as a fraction of it, from which on the readings show it
_SHOWN = 0.01
#: Square of a deviation in motion, where a cycle has another shape after a change
_ROUGH = 4.0
#: Deviations within which steps agree
_AGREE = 3.0
#: Part of a step by which it differs from run to run
_AGAIN = 0.03

#: Standard deviations of a sum of squares beyond which readings are not those of the model
MISFIT = 6.0

_Key = tuple[float, float, int, bool]  # amplitude, frequency, direction, whether beyond the place


class StepRegression:
    """Steps by amplitude, frequency and direction, from readings in the order of time.

    Those on either side of a place are told apart.
    """

    def __init__(self, model: Model, settings: TwinSettings, place: float, way: float) -> None:
        """Begin without a reading; the model gives the shape of cycles and their ringing.

        What lies from a place (m) on in the direction of a way (m) is beyond it.
        """
        self._model, self._settings = model, settings
        self._place, self._way = place, way
        self._present: _Key | None = None  # of the drive that ran last
        self._last: ProcessedReading | None = None
        self.forget()

    def take(self, one: ProcessedReading) -> None:
        """Take a reading with the pieces of cycles before it."""
        last, self._last = self._last, one
        driven = [part for part in one.parts if part[0].drive]
        # The piece before goes on to matter while it rests, but makes no steps then.
        ran = (piece for piece, begin, end in driven
               if piece.cycles_at(end) > piece.cycles_at(begin))  # fmt: skip
        beyond = (one.reading - self._place) * self._way >= 0.0
        drives = {(*piece.drive[:3], beyond) for piece in ran if piece.drive}
        opened = False
        if one.motion.direction and last is not None:
            key = drives.pop() if len(drives) == 1 else None
            # A run may have begun in readings of two drives.
            if key and key != self._present:
                present = self._filters.pop(key, None) or self._new()
                present.anchor(last.reading, last.motion.blur)
                self._filters[key], opened = present, True
            self._present = key
        if self._present is None or last is None:
            return
        present = self._filters[self._present]
        cycles = shape = scatter = 0.0
        blur = one.motion.blur
        for piece, begin, end in driven:
            assert piece.drive
            curve, at = self._model.curve(piece.drive), parts_of_cycles(piece, begin, end)
            done, step = float(at[0][1] - at[0][0]), curve.step
            cycles += done
            shape += float(np.diff(curve.at(*at))[0]) - done * step
            scatter += done * (self._settings.step_spread * step) ** 2
            begins = begin == piece.start
            ends = piece.rests and begin < piece.end <= end
            settling = min(at[0][1], _SETTLING) - min(at[0][0], _SETTLING)
            scatter += (ends + settling / _SETTLING) * (_EDGE * step) ** 2
            if begins or (opened and done > 0.0):
                self._ended[self._present] = self._best(self._present)
                present.covariance[THETA, THETA] += (_AGAIN * step) ** 2
            blur = curve.blur(piece, end, self._settings.timing)
        present.move(shape, np.array([cycles]), scatter)
        *_, z = present.read(one.reading, blur)
        still = one.motion.direction == 0 and blur.ringing < self._settings.noise
        self._excess += z**2 / (1.0 if still else _ROUGH) - 1.0
        self._taken += 1

    @property
    def fits(self) -> bool:
        """Whether readings scatter as their noise says."""
        return self._excess <= MISFIT * math.sqrt(2.0 * self._taken)

    def forget(self) -> None:
        """Begin anew, without a reading."""
        self._filters: dict[_Key, ReadingFilter] = {}  # the last drive at last
        self._ended: dict[_Key, ShownStep] = {}  # as known best when a run began
        self._excess, self._taken = 0.0, 0  # of squares of deviations, and their number
        self.interrupt()

    def interrupt(self) -> None:
        """Take the next reading without those before: nobody knows where the axis has gone."""
        self._present = self._last = None

    def steps(self) -> list[ShownStep]:
        """Return the steps that are known well, each as it was known best."""
        best = [self._best(key) for key in self._filters]
        return [one for one in best if one.deviation < _SHOWN * abs(one.step)]

    def step(self, drive: OperatingPoint) -> tuple[float, float] | None:
        """Return the step of a drive in its last run and its standard deviation, m, if known.

        Steps of runs before, and on the other side of the place, count if they agree with it.
        """
        keys = [key for key in reversed(self._filters) if key[:3] == drive[:3]]
        known = [self._now(key) for key in keys]
        known += [self._ended[key] for key in keys if key in self._ended]
        if not known:
            return None
        _, _, step, deviation = known[0]
        for *_, other, error in known[1:]:
            if abs(step - other) < _AGREE * math.hypot(deviation, error) < math.inf:
                total = math.hypot(deviation, error)
                step += (other - step) * (deviation / total) ** 2
                deviation *= error / total
        return (step, deviation) if deviation < _SHOWN * abs(step) else None

    def _best(self, key: _Key) -> ShownStep:
        now = self._now(key)
        return min(now, self._ended.get(key, now), key=lambda one: one.deviation)

    def _now(self, key: _Key) -> ShownStep:
        present, drive = self._filters[key], OperatingPoint(*key[:3], key[2])
        deviation = math.sqrt(float(present.covariance[1, 1]))
        return ShownStep(drive, key[3], float(present.state[1]), deviation)

    def _new(self) -> ReadingFilter:
        new = ReadingFilter(1, self._settings.noise)
        new.covariance[THETA, THETA] = _ANY**2
        return new
