# SPDX-License-Identifier: Apache-2.0
"""The settings of a twin, each with its reason."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from stickslip_ros.base.errors import StickslipError


class TwinError(StickslipError, ValueError):
    """What a twin cannot work with; the message names the value, the limit and the cure."""


#: Settings that command and node take: unit and meaning
ASKED = {
    "noise": ("m", "standard deviation of a reading"),
    "latency": ("s", "age of a reading at the time of its stamp"),
    "timing": ("s", "how well times of readings and commands are known to each other"),
    "false_alarm_interval": ("s", "of stepping, with one false alarm at most"),
}

#: Noise of a sensor that shows no single step, m
_LOUDEST = 1e-6


@dataclass(frozen=True)
class TwinSettings:
    """What a twin assumes of the axis beside it, SI units."""

    #: m, standard deviation of a reading; s, its age at the time of its stamp
    noise: float = 2e-9
    latency: float = 0.0
    #: s of stepping in which one false alarm is expected at most: a day
    false_alarm_interval: float = 86_400.0
    #: standard deviations of the logarithms of preload and gain where no fit says them: a good
    #: spring, and the data sheet of an actuator
    preload_deviation: float = 0.05
    gain_deviation: float = 0.01
    #: change of these logarithms in an hour, and in a metre that the runner goes, that is no alarm:
    #: random walks of this standard deviation
    drift_hour: float = 0.01
    drift_metre: float = 0.01
    #: spread of one step, as a fraction of it: drives repeat to a few parts in a thousand
    step_spread: float = 0.001
    #: m, spread of the first step after a rest, whose contact remembers what was before, and after
    #: steps of another amplitude or frequency
    start_spread: float = 1e-9
    change_spread: float = 3e-8
    #: s, how well the times of readings and commands are known to each other
    timing: float = 2e-5
    #: s without a reading after which the position is taken anew
    longest_gap: float = 1.0
    #: s without a step that was seen after which the twin is blind
    blind_after: float = 10.0
    #: s over which a drift is judged, and its standard errors: one false one in 16 000
    drift_window: float = 600.0
    drift_errors: float = 4.0
    #: probability at which a cause is named, of all that the model has
    certainty: float = 0.95
    #: readings after a change from which its cause is judged
    judged_from: int = 200

    def __post_init__(self) -> None:
        """Check the values. Raises TwinError."""
        for one in fields(self):
            value = getattr(self, one.name)
            if not (math.isfinite(value) and (value > 0.0 or one.name == "latency")):
                raise TwinError(f"{one.name} is {value:g}; it has to be a number above 0")
        if self.noise > _LOUDEST:
            raise TwinError(
                f"noise is {self.noise:g} m, beyond {_LOUDEST:g} m it hides all steps: give it in "
                "metres, or with its unit, such as 0.5nm"
            )
        if not 0.5 <= self.certainty < 1.0:
            raise TwinError(f"certainty is {self.certainty:g}; it has to be from 0.5 to below 1")
