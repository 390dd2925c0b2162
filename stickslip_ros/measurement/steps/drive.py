# SPDX-License-Identifier: Apache-2.0
"""How an axis was driven, as far as whoever recorded it knows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.actuator_cycles import runs_of_signal
from stickslip_ros.measurement.steps.record import TraceError
from stickslip_ros.measurement.steps.settings import SETTINGS
from stickslip_ros.measurement.steps.slips import SlipGrid
from stickslip_ros.simulation.motion import Motion


@dataclass(frozen=True)
class Drive:
    """What is known of the runs of steps in a record, in the order of time.

    Each is a value for every run, or a single one for all of them, or empty where it is unknown.
    """

    frequencies: tuple[float, ...] = ()  #: Hz
    steps: tuple[int, ...] = ()  #: that were sent; the sign is the direction
    begins: tuple[float, ...] = ()  #: when the steps were sent, by the clock of the record, s
    signed: bool = True  #: whether the directions are known

    @classmethod
    def given(cls, frequency: ArrayLike | None, steps: ArrayLike | None = None) -> Drive:
        """Return the drive of frequencies (Hz) and steps, each one or one a run, or unknown.

        Raises TraceError for a frequency that is not above 0, no steps, or numbers that differ.
        """
        try:
            frequencies, sent = (
                () if one is None else tuple(np.atleast_1d(np.asarray(one, np.float64)).tolist())
                for one in (frequency, steps)
            )
        except (TypeError, ValueError):
            raise TraceError(
                f"the drive is {frequency!r} and {steps!r}; give numbers, or one a run: the "
                "frequency (Hz) and the steps that were sent"
            ) from None
        if any(one != round(one) for one in sent):
            raise TraceError(f"the steps are {steps!r}; they have to be whole numbers")
        for hertz in frequencies:
            if not 0.0 < hertz < math.inf:
                raise TraceError(f"the frequency is {hertz:g} Hz; it has to be above 0")
        if 0 in sent:
            raise TraceError("a run has 0 steps; leave it out, or give the steps that were sent")
        if min(len(frequencies), len(sent)) > 1 and len(frequencies) != len(sent):
            raise TraceError(
                f"{len(frequencies)} frequencies and {len(sent)} numbers of steps are given; give "
                "one for all runs, or one a run"
            )
        return cls(frequencies, tuple(int(one) for one in sent))

    @classmethod
    def of_voltage(cls, t: Array, voltage: Array) -> Drive:
        """Return the drive of a voltage (any unit) over times (s), (samples,).

        Its cycles are used alone: which way a deflection goes is left to the position. Raises
        TraceError where it has no whole cycle.
        """
        runs = runs_of_signal(t, voltage)
        if not runs:
            raise TraceError(
                "the voltage makes no whole cycle; record a longer one, or give the drive "
                "(--frequency, --steps) in its place"
            )
        return cls(
            tuple(1.0 / one.period for one in runs), tuple(len(one.slips) for one in runs),
            tuple(float(one.starts[0]) for one in runs), signed=False,
        )  # fmt: skip

    def or_at(self, frequency: float) -> Drive:
        """Return the drive with a frequency (Hz) where none is known."""
        return self if self.frequencies else replace(self, frequencies=(frequency,))

    def or_recorded(self, motion: Motion, recorded: Drive | None) -> Drive:
        """Return the drive, if anything is known of it, else that of a motion or of its bag.

        Raises TraceError where the voltage of the motion has no whole cycle.
        """
        if self != Drive():
            return self
        if motion.voltage is not None:
            return Drive.of_voltage(motion.t, motion.voltage)
        return recorded or self

    def sent_to(self, grids: Sequence[SlipGrid]) -> list[SlipGrid]:
        """Return runs with the steps that were sent for each.

        Raises TraceError where other runs were sent than are seen.
        """
        runs = max(len(self.frequencies), len(self.steps))
        number = list(range(len(grids)))
        if self.begins:
            starts = [[one.first - one.period] for one in grids]
            number = np.argmin(np.abs(np.subtract(starts, self.begins)), axis=-1).tolist()
        elif runs > 1 and grids:
            wrong = runs != len(grids) or (
                len(self.frequencies) > 1
                and any(
                    abs(one.period * hertz - 1.0) > SETTINGS.period_error
                    for one, hertz in zip(grids, self.frequencies, strict=True)
                )
            )
            if wrong:
                seen = ", ".join(
                    f"{one.count * one.direction:+d} at {1.0 / one.period:.6g} Hz" for one in grids
                )
                raise TraceError(
                    f"{runs} runs of steps were sent, {len(grids)} are seen ({seen}): give the "
                    "drive of those in the record, in their order (--frequency, --steps), or cut "
                    "it (--from, --to)"
                )
        if not self.steps:
            return list(grids)
        sent = [self.steps[min(k, len(self.steps) - 1)] for k in number]
        return [
            replace(grid, sent=steps if self.signed else abs(steps) * grid.direction)
            for grid, steps in zip(grids, sent, strict=True)
        ]
