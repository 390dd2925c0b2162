# SPDX-License-Identifier: Apache-2.0
"""How an axis was driven, as far as whoever recorded it knows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from stickslip_ros.measurement.steps.record import TraceError


@dataclass(frozen=True)
class Drive:
    """What is known of the runs of steps in a record, in the order of time.

    Each is a value for every run, or a single one for all of them, or empty where it is unknown.
    """

    frequencies: tuple[float, ...] = ()  #: Hz
    steps: tuple[int, ...] = ()  #: that were sent; the sign is the direction
    begins: tuple[float, ...] = ()  #: when the steps were sent, by the clock of the record, s

    @classmethod
    def given(
        cls, frequency: float | Sequence[float] | None, steps: int | Sequence[int] | None = None
    ) -> Drive:
        """Return the drive of frequencies (Hz) and steps, each one or one a run, or unknown.

        Raises TraceError for a frequency that is not above 0, no steps, or numbers that differ.
        """
        frequencies, sent = (
            () if one is None else tuple(one) if isinstance(one, Sequence) else (one,)
            for one in (frequency, steps)
        )
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
