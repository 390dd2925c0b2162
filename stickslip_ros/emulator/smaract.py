# SPDX-License-Identifier: Apache-2.0
"""Channels and codes of SmarAct's controllers, common to all protocols."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import ClassVar

from stickslip_ros.emulator import channel
from stickslip_ros.emulator.dialogue import Controller, Refused

FULL_SCALE_V = 100.0  #: voltage of the highest level of amplitudes and scans
LEAST_HERTZ = 1
#: Of the two ASCII interfaces: the highest frequency, and the hold time that has no end (ms)
MOST_HERTZ, FOR_EVER_MS = 18500, 60000


class Code(IntEnum):
    """The errors of the two ASCII interfaces."""

    SYNTAX, UNKNOWN, TOO_FEW, TOO_MANY, INVALID = 1, 2, 5, 6, 7
    NO_REFERENCE_MARK, LOCKED = 144, 146


class Channel(channel.Channel):
    """One channel of a SmarAct."""

    most_volts: ClassVar = FULL_SCALE_V

    def go_to_for(self, x: float, hold_ms: float) -> None:
        """Go to a position (m) and hold it for a time (ms), as the ASCII interfaces count it."""
        check(0 <= hold_ms <= FOR_EVER_MS)
        self.go_to(x, math.inf if hold_ms == FOR_EVER_MS else 1e-3 * hold_ms)


# -- of the two ASCII interfaces


def check(condition: bool) -> None:
    """Refuse a command whose values are none."""
    if not condition:
        raise Refused(Code.INVALID)


def refuse_reference(*_: object, **__: object) -> None:
    """Refuse to look for a reference mark: the simulated sensor has none."""
    raise Refused(Code.NO_REFERENCE_MARK)


def reset(controller: Controller) -> None:
    """Stop all channels and take them out of a fault."""
    for one in controller.channels:
        one.axis.stop()
        one.axis.reset()
