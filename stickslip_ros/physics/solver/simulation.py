# SPDX-License-Identifier: Apache-2.0
"""One simulated axis: a plant, its drive cycle, and a state that is advanced to given times."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from stickslip_ros.base.arrays import Array, add_up
from stickslip_ros.physics.model import DriveCycle, Plant, alpha_of, alpha_of_law
from stickslip_ros.physics.solver.advance import (
    ENDLESS,
    PER_CYCLE,
    SAMPLE_SIZE,
    KernelBuffers,
    SolverError,
    anchor,
    friction,
    run,
    run_events,
    run_samples,
)
from stickslip_ros.physics.solver.layout import ROW_SIZE, Fields
from stickslip_ros.physics.solver.plants import (
    axes_at_rest,
    begin_cycles,
    contact_buffer,
    contact_records,
    pack_plant,
    set_clear_range,
    set_contacts,
)

NO_ROWS = np.empty((0, ROW_SIZE))
_REST = DriveCycle(np.array([1.0]), np.array([0.0]), slip=-1, sign=1)


def rest_after(period: float, ringing: float) -> float:
    """Return how long (s) the backstep of the last cycle may take; ringing in Hz, 0 for none."""
    return max(period, 1.0 / ringing if ringing > 0.0 else 0.0)


def backstep_into_rest(simulation: Simulation) -> float:
    """Return the backstep (m) of the last cycle, after a rest in which it ends."""
    period, ringing = simulation.drive_cycle.period, simulation.plant.ringing_frequency
    simulation.advance(simulation.end_of_move + rest_after(period, ringing))
    return simulation.backstep


@dataclass(frozen=True)
class State:
    """State of the axis at one time."""

    t: float  #: s
    x: float  #: runner position, m
    v: float  #: runner velocity, m/s
    z: float  #: asperity deflection, m; of several contacts the mean by stiffness
    u: float  #: actuator deflection, m, from its level at the very start
    rate: float  #: u', m/s
    force: float  #: friction force F of Eq. 1, N; the runner feels -F

    @property
    def w(self) -> float:
        """Differential velocity v - u' (m/s), Eq. 6."""
        return self.v - self.rate


@dataclass(frozen=True)
class Samples:
    """States of the axis at many times, of shape (times,) except for the last; see `State`."""

    x: Array  #: m
    v: Array  #: m/s
    z: Array  #: m
    rate: Array  #: m/s
    u: Array  #: m
    force: Array  #: N
    each: Array  #: deflection of each contact, m, of shape (contacts, times)


@dataclass(frozen=True)
class CycleResults:
    """Results of cycles, each of shape (cycles,)."""

    position: Array  #: at the end of each cycle, m
    backstep: Array  #: of the last complete slip, m; nan before the first
    z_max: Array  #: largest asperity deflection, m
    z_min: Array  #: smallest asperity deflection, m
    lost: Array  #: friction work: energy lost in the contact, J


def check_closed(drive_cycle: DriveCycle, count: int) -> None:
    """Raise ValueError for a drive cycle that cannot be repeated, with count above 1."""
    if drive_cycle.shift != 0.0 and count > 1:
        raise ValueError(
            f"{count} times a drive cycle that ends {drive_cycle.shift:g} m from where it began: "
            "run it once, or close it"
        )


class Simulation:
    """Advances one axis under piecewise-linear drive. Time (s) is passed in and only grows."""

    def __init__(
        self, plant: Plant, tolerance: float, replay: bool = True, budget: int = PER_CYCLE
    ) -> None:
        """Start at rest at x = 0; tolerance is the error in position (m) allowed per cycle.

        With replay, a cycle that begins as the last one did is not solved again. budget is the
        largest number of arcs of a cycle.
        """
        self._budget = budget
        self._events: list[Array] | None = None  # s, while they are recorded
        (self._axis,) = axes_at_rest(1)
        self._each = contact_buffer(plant)
        self._s = Fields(self._axis)
        self._s["replay"] = replay
        self.stands = False  #: True if runner and actuator stay where they are until something acts
        self._place = (math.nan,) * 3  # m, as `_stood` saw it last
        self._force = 0.0  # N, where it stands
        self._t = 0.0
        self._set_drive_cycle(_REST)
        self._use_plant(plant, tolerance)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for copies and pickles: everything except the view of the buffer."""
        return {name: value for name, value in self.__dict__.items() if name != "_s"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state, with a view of the copied buffer."""
        self.__dict__.update(state)
        self._s = Fields(self._axis)

    def set_plant(self, plant: Plant, tolerance: float) -> None:
        """Change the plant at the present state and time, also within a cycle."""
        self._anchor()
        self._use_plant(plant, tolerance)

    def push(self, z: float) -> None:
        """Deflect each contact by z (m) more at the present time, as a start nearly the same."""
        self._s["now_z"] += z
        if self._each is not None:
            contact_records(self._each)["now_z"] += z
        self._anchor()

    def set_stops(self, low: float = -math.inf, high: float = math.inf) -> None:
        """Limit the travel of the runner to low .. high (m) from the present time on.

        The runner hits a stop inelastically and is held while pressed against it. ValueError if the
        runner is outside now.
        """
        x = self._s["now_x"]
        if not (low < high and low <= x <= high):
            raise ValueError(
                f"the runner is at {x:g} m, the stops at {low:g} m and {high:g} m: "
                "set them on either side of it"
            )
        self._anchor()
        self._s["low"], self._s["high"] = low, high
        if x not in (low, high):
            self._s["stopped"] = 0
        self._set_clear_range()

    @property
    def stopped(self) -> int:
        """The stop that holds the runner: -1 the lower, 1 the upper, 0 none."""
        return self._s["stopped"]

    @property
    def stop_hits(self) -> int:
        """How often the runner has hit a stop."""
        return self._s["hits"]

    def _anchor(self) -> None:
        s = self._s
        self.stands = False
        now = s["now_x"], s["now_v"], s["now_z"]
        s["cut"] = 1
        try:
            self._run(self._t, s["done"] + 2, NO_ROWS)
        finally:
            s["cut"] = 0
        anchor(self._plant, self._axis, *now)

    def _set_clear_range(self) -> None:
        s, (durations, rates, bends) = self._s, self._drive
        s["near_low"], s["near_high"] = ends = s["low"], s["high"]
        if not (math.isinf(ends[0]) and math.isinf(ends[1])):
            longest = float((durations * (np.abs(rates) + np.abs(bends) * durations)).max())
            set_clear_range(s, self._plant, self._each, longest)

    def _use_plant(self, plant: Plant, tolerance: float) -> None:
        self.plant = plant
        self._plant = pack_plant(plant, tolerance)
        set_contacts(self._each, plant)
        self._set_clear_range()

    def start(self, drive_cycle: DriveCycle, count: int) -> None:
        """Begin ``count`` cycles of ``drive_cycle`` at the present time, then rest; 0: at once.

        The running cycle ends at once, and u continues from its present level. ValueError for more
        than one drive cycle that does not close.
        """
        check_closed(drive_cycle, count)
        self._set_drive_cycle(drive_cycle)
        self._begin(drive_cycle, count)
        self._set_clear_range()

    def _begin(self, cycle: DriveCycle, count: int) -> None:
        self.stands = False
        numbers = cycle.shift, cycle.slip, cycle.slip_end, cycle.sign
        begin_cycles(self._axis, self._each, self._t, count, numbers)

    def _set_drive_cycle(self, drive_cycle: DriveCycle) -> None:
        self.drive_cycle = drive_cycle
        self._drive = np.zeros((3, len(drive_cycle.durations)))
        self._drive[0], self._drive[1] = drive_cycle.durations, drive_cycle.rates
        if drive_cycle.bends is not None:
            self._drive[2] = drive_cycle.bends

    @property
    def commanded(self) -> float:
        """The commanded deflection, m: that of the actuator."""
        return self._s["now_u"]

    @property
    def cycles_done(self) -> int:
        """Number of drive cycles that have ended."""
        return self._s["done"]

    @property
    def cycles_left(self) -> int:
        """Number of drive cycles that have not ended, including the running one."""
        return self._s["count"] - self._s["done"]

    @property
    def backstep(self) -> float:
        """Backstep (m) of the last slip whose backstep is complete; nan before the first."""
        return self._s["backstep"]

    @property
    def last_step(self) -> float:
        """Displacement (m) over the last whole cycle; nan before the first."""
        return self._s["last_step"]

    @property
    def last_lost(self) -> float:
        """Energy (J) lost in the contact over the last whole cycle; nan before the first."""
        return self._s["last_friction_work"]

    @property
    def slipping(self) -> bool:
        """True during the slip of the drive cycle."""
        s = self._s
        return self.cycles_left > 0 and bool(s["slip"] <= s["now_segment"] < s["slip_end"])

    @property
    def stepping_back(self) -> bool:
        """True from the start of a slip to the end of its backstep."""
        return bool(self._s["now_tracking"])

    @property
    def end_of_cycle(self) -> float:
        """Time (s) at which the running cycle ends."""
        return self._end_of(self.cycles_done + 1)

    @property
    def end_of_move(self) -> float:
        """Time (s) at which the last cycle ends."""
        return self._end_of(self.cycles_done + self.cycles_left)

    @property
    def position_of_cycle(self) -> float:
        """Position (m) at the start of the running cycle, or at the end of the last one."""
        return self._s["cycle_x"]

    def _end_of(self, cycles: int) -> float:
        return self._s["start"] + cycles * self.drive_cycle.period

    def advance(self, t: float) -> None:
        """Advance to time t (s)."""
        if not t >= self._t:
            raise ValueError(f"time cannot run back from {self._t} s to {t} s")
        if not self.stands:
            self._run(t, ENDLESS, NO_ROWS)
            self.stands = self._stood()
        self._t = t

    def event_times(self, t: float) -> Array:
        """Advance to t (s); return the times (s) of kinks and of turns of position or deflection.

        For a simulation without replay only: replayed cycles have no events.
        """
        self._events = []
        try:
            self.advance(t)
            return np.concatenate([np.empty(0), *self._events])
        finally:
            self._events = None

    def sample(self, times: Array) -> Samples:
        """Advance to each of the times (s), which must not fall; return the states.

        Like `advance` and `state` for each time, but a hundred times faster.
        """
        times = np.ascontiguousarray(times, dtype=np.float64)
        if len(times) and not (times[0] >= self._t and (np.diff(times) >= 0.0).all()):
            raise ValueError(f"times to sample at must not fall, from {self._t} s on")
        # Not those of `plant`, which a contact that varies makes anew for each question.
        contacts = 0 if self._each is None else len(contact_records(self._each))
        samples = np.empty((len(times), SAMPLE_SIZE + contacts))
        if len(times):
            run_samples(self._buffers(), self._s, times, samples)
            self._t = float(times[-1])
            self._check()
        x, v, z, rate, u, force = np.ascontiguousarray(samples.T[:SAMPLE_SIZE])
        each = np.ascontiguousarray(samples.T[SAMPLE_SIZE:]) if contacts else z[None]
        return Samples(x, v, z, rate, u, force, each)

    def run_cycles(self, count: int) -> CycleResults:
        """Advance to the end of ``count`` further drive cycles."""
        rows = np.empty((count, ROW_SIZE))
        stop = self.cycles_done + count
        if stop > self.cycles_done + self.cycles_left:
            raise ValueError(f"{count} cycles asked for, {self.cycles_left} are left")
        self._run(math.inf, stop, rows)
        self._t = self._end_of(stop)
        return CycleResults(*np.ascontiguousarray(rows.T))

    def _run(self, t: float, stop_cycle: int, rows: Array) -> None:
        if self._events is None:
            run(self._buffers(), self._s, (t, stop_cycle), rows, self._budget)
        else:
            self._events += run_events(self._buffers(), self._s, (t, stop_cycle))
        self._check()

    def _buffers(self) -> KernelBuffers:
        return KernelBuffers(self._plant, self._axis, self._each, self._drive)

    def _stood(self) -> bool:
        """Return whether nothing has changed or moved since the last call, nor will."""
        s = self._s
        if s["now_v"] or s["now_rate"] or self._each is not None or self.cycles_left:
            return False
        before, self._place = self._place, (s["now_x"], s["now_z"], s["now_u"])
        self._force = friction(self._plant, self._axis, self._each)
        return self._place == before

    def _check(self) -> None:
        if not math.isfinite(self._s["now_x"]):
            raise SolverError(
                f"the solver failed after {self._t:g} s; please report the parameters and commands"
            )

    @property
    def t(self) -> float:
        """The time advanced to, s."""
        return self._t

    @property
    def x(self) -> float:
        """The position of the runner at that time, m."""
        return self._s["now_x"]

    @property
    def force(self) -> float:
        """Friction force F of Eq. 1 at the time advanced to, N."""
        return self._force if self.stands else friction(self._plant, self._axis, self._each)

    @property
    def state(self) -> State:
        """The state at the time advanced to."""
        s = self._s
        x, v, z = s["now_x"], s["now_v"], s["now_z"]
        return State(self._t, x, v, z, s["now_u"], s["now_rate"], self.force)

    @property
    def deflections(self) -> Array:
        """The deflection of each contact at the time advanced to, m, (contacts,)."""
        if self._each is not None:
            return contact_records(self._each)["now_z"].copy()
        return np.array([self._s["now_z"]])

    @property
    def alpha(self) -> float:
        """Plastic fraction of the contact: 0 elastic .. 1 plastic; of several the mean."""
        s = self._s
        w = s["now_v"] - s["now_rate"]
        if self._each is None:
            return float(alpha_of(s["now_z"], w, self.plant.contact))
        each = zip(self.plant.contacts, contact_records(self._each).view(np.recarray), strict=True)
        found = [(c.sigma_0, alpha_of_law(c, own, w)) for c, own in each]
        return float(add_up(k * alpha for k, alpha in found) / add_up(k for k, _ in found))
