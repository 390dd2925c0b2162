# SPDX-License-Identifier: Apache-2.0
"""Faults on demand: what can be injected into an axis, what of it acts, how far it may travel.

The parameter ``fault`` names them, as "sensor_freeze" or "sensor_spike 200nm, axis_stall 50". They
are part of the axis: a run with them repeats to the last bit. A new one is one more entry in
`FAULTS`, and a line where it acts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from stickslip_ros.physics.parameters import LimitParameters, ParameterError, Parameters
from stickslip_ros.physics.parameters.row import read_quantity

if TYPE_CHECKING:
    from stickslip_ros.physics.solver import Simulation

_SPIKE_EVERY = 100  # readings

#: Where the faults act, other than in `Faults` itself
SENSOR_DROPOUT, STUCK, STALL, DIRT = "sensor_dropout", "axis_stuck", "axis_stall", "dirt"
PRELOAD_LOSS, REFUSE, LATE, VANISH = "preload_loss", "refuse", "late", "vanish"
#: Those that act on the motion; it goes on to the last bit beside the others
MOVING = STUCK, STALL, PRELOAD_LOSS, DIRT


@dataclass(frozen=True)
class Fault:
    """One fault that can be injected; one without a value has the unit None."""

    meaning: str
    unit: str | None = None
    default: float = 0.0
    low: float = 0.0
    high: float = 0.0


FAULTS = {
    "sensor_freeze": Fault("every reading of the sensor is the one at which this began"),
    SENSOR_DROPOUT: Fault(
        "the sensor gives no reading; joint_states stays away, a closed loop faults"
    ),
    "sensor_spike": Fault(f"every {_SPIKE_EVERY}th reading is off by this", "m", 1e-6, -1e-2, 1e-2),
    "sensor_drift": Fault("readings drift from here on", "m/s", 1e-7, -1e-3, 1e-3),
    "sensor_zero": Fault("readings count from elsewhere, by this", "m", 1e-5, -1.0, 1.0),
    STUCK: Fault("commands are accepted, the actuator runs, the runner does not move"),
    STALL: Fault("the same after so many more steps", "", 100, 1, 1e9),
    PRELOAD_LOSS: Fault("this share of the preload is lost", "", 0.5, 0.01, 0.99),
    DIRT: Fault("the runner cannot pass this position, as measured", "m", 1e-6, -1.0, 1.0),
    REFUSE: Fault("every command is refused, but for parameters and pause"),
    LATE: Fault("the node takes each command, and answers it, so much later", "s", 0.5, 1e-3, 10.0),
    VANISH: Fault("the node publishes and answers nothing, but for parameters"),
}


@dataclass(frozen=True)
class Moment:
    """The axis when a fault began."""

    t: float = 0.0  #: s
    x: float = 0.0  #: m, where the runner was
    reading: float = 0.0  #: m, of the sensor, without its zero
    cycles: int = 0  #: that have run since the start, in both directions


@dataclass(frozen=True)
class Faults:
    """The faults that act: value and beginning by name."""

    active: Mapping[str, tuple[float, Moment]]

    def __contains__(self, name: str) -> bool:
        return name in self.active

    def value(self, name: str) -> float:
        """Return the value of a fault, nan if it does not act."""
        return self.active[name][0] if name in self.active else math.nan

    def changed(self, p: Parameters, now: Moment) -> Faults:
        """Return the faults of parameters: those that act already go on, others begin now."""
        return Faults(
            {
                name: self.active[name] if self.value(name) == value else (value, now)
                for name, value in faults_of(p).items()
            }
        )

    def seen(self, reading: float, k: int, t: float) -> float:
        """Return what reading number k, at time t (s), gives in place of a reading (m)."""
        for name, (value, began) in self.active.items():
            if name == "sensor_freeze":
                reading = began.reading
            elif name == SENSOR_DROPOUT:
                reading = math.nan
            elif name == "sensor_zero" or (name == "sensor_spike" and k % _SPIKE_EVERY == 0):
                reading += value
            elif name == "sensor_drift":
                reading += value * (t - began.t)
        return reading

    def steps_left(self, cycles: int) -> float:
        """Return the cycles until the runner stalls, inf if it does not; cycles have run."""
        if STUCK in self:
            return 0
        if STALL not in self:
            return math.inf
        count, began = self.active[STALL]
        return max(0, began.cycles + int(count) - cycles)


NONE = Faults({})


def faults_of(p: Parameters) -> dict[str, float]:
    """Return the faults that parameters ask for and their values; ParameterError for bad ones."""
    found = {}
    for part in filter(None, (part.strip() for part in (p.faults.fault or "").split(","))):
        if not p.faults.allow_faults:
            raise ParameterError(
                f"fault is {part!r}, and faults are not allowed: start the axis with allow_faults"
            )
        name, _, text = part.partition(" ")
        if name not in FAULTS:
            raise ParameterError(f"fault is {name!r}; known are {', '.join(FAULTS)}")
        found[name] = _value(name, text.strip())
    return found


def _value(name: str, text: str) -> float:
    fault = FAULTS[name]
    if not text:
        return fault.default
    if fault.unit is None:
        raise ParameterError(f"fault {name} has no value; leave out {text!r}")
    try:
        value = read_quantity(text, fault.unit)
    except ValueError as error:
        raise ParameterError(f"fault {name}: {error}") from None
    if not fault.low <= value <= fault.high:
        limits = f"between {fault.low:g} and {fault.high:g} {fault.unit}".rstrip()
        raise ParameterError(f"fault {name} is {text}; its value has to lie {limits}")
    return value


class Travel:
    """The stops of a simulation: the ends of the travel, or narrower ones that faults set.

    While a fault confines the runner, nothing is held there, and no hits are counted.
    """

    def __init__(self, sim: Simulation, limits: LimitParameters) -> None:
        """Set the stops at the ends of the travel."""
        self._sim = sim
        self._ends = limits.travel_low, limits.travel_high
        self._confined = False
        self._hits = 0  # of the ends of the travel, until the runner was confined
        self._other_hits = 0  # of the narrower ends
        self._stuck_at: float | None = None  # m
        sim.set_stops(*self._ends)

    @property
    def held(self) -> int:
        """The end of the travel that holds the runner: -1 the lower, 1 the upper, 0 none."""
        return 0 if self._confined else self._sim.stopped

    @property
    def hits(self) -> int:
        """How often the runner has hit an end of the travel."""
        return self._hits if self._confined else self._sim.stop_hits - self._other_hits

    def confine(self, faults: Faults, offset: float, cycles: int) -> None:
        """Let the runner travel as far as faults leave it.

        offset (m) is the reading that counts as 0; cycles have run.
        """
        x, hits = self._sim.x, self.hits
        low, high = self._ends
        if DIRT in faults:
            place = faults.value(DIRT) + offset
            low, high = (low, min(place, high)) if x <= place else (max(place, low), high)
        if faults.steps_left(cycles):
            self._stuck_at = None
        else:
            self._stuck_at = x if self._stuck_at is None else self._stuck_at
            # m, what a stuck runner has to either side
            low, high = max(low, self._stuck_at - 1e-12), min(high, self._stuck_at + 1e-12)
        self._confined = (low, high) != self._ends
        self._hits, self._other_hits = hits, self._sim.stop_hits - hits
        self._sim.set_stops(low, high)
