# SPDX-License-Identifier: Apache-2.0
"""What is told of a twin over time, of one that has run here or that is heard elsewhere."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from stickslip_ros.measurement.twin import TrackedParameter, Twin, Update

#: Readings and estimates that a live page keeps
_READINGS, _ESTIMATES = 20_000, 4000


@dataclass
class TwinStory:
    """What a page shows of a twin that has run, or of one that runs elsewhere. Times in s."""

    source: str
    level: str = "blind"
    reason: str = "nothing was heard of the twin yet"
    stepping: float = 0.0
    #: time, measured, expected, standard deviation (m)
    readings: deque[tuple[float, ...]] = field(default_factory=lambda: deque(maxlen=_READINGS))
    history: deque[tuple[float, list[TrackedParameter]]] = field(
        default_factory=lambda: deque(maxlen=_ESTIMATES)
    )
    #: onset, when it was told, text
    changes: list[tuple[float, float, str]] = field(default_factory=list)
    troubles: dict[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, twin: Twin, updates: Sequence[Update], source: str) -> TwinStory:
        """Return that of a twin that has taken the readings of a source."""
        told = [(one.onset, one.told, one.text) for one in twin.changes]
        readings = deque[tuple[float, ...]](one[:4] for one in updates)
        history = deque((t, estimates) for t, estimates, _ in twin.history)
        history.append((twin.t, twin.estimates()))
        troubles = dict(twin.troubles)
        return cls(source, *twin.level, twin.driven, readings, history, told, troubles)
