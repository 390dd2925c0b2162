# SPDX-License-Identifier: Apache-2.0
"""One axis behind amplifier and actuator: the deflection follows the commanded one in time.

The chain of `model.actuator_chain` turns each cycle of the command into parabolas. A window is one
such cycle; the kernel runs it like any drive cycle. After the last cycle the command rests, and
windows of growing length follow until the actuator is still. If a cycle begins as the last one did,
its window is used for all remaining cycles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.physics.model import DriveCycle, Plant
from stickslip_ros.physics.model.actuator_chain import (
    CAPACITY,
    COMMAND,
    DEFLECTION,
    PLAYS,
    STILL,
    Chain,
    adapt_state,
    distance,
    has_chain,
    motion_left,
    same_chain,
    static_deflection,
)
from stickslip_ros.physics.model.actuator_stages import follow, lay_pieces
from stickslip_ros.physics.model.plant import scale_distances
from stickslip_ros.physics.model.surface import CycleStart, Surface
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver.advance import ENDLESS, PER_CYCLE, SolverError
from stickslip_ros.physics.solver.plants import begin_window, vary_contacts
from stickslip_ros.physics.solver.simulation import NO_ROWS, Samples, Simulation, check_closed

#: First window after the last cycle, s: some periods of a ringing. Each later one is twice as long.
_FIRST_REST = 1e-3
#: Above a speed of the runner, `mean_only_rate`, only the mean of a line of the actuator counts.
#: That speed is raised as soon as the runner gets to this fraction of it, before a cycle exceeds
#: it.
_NEARLY_AS_FAST = 0.7
_STANDING = np.array([[1.0], [0.0]])
#: What the kernel knows of a cycle that has ended
_OF_LAST_CYCLE = ("cycle_x", "last_step", "last_friction_work")
#: Begin and end of the slip of a drive cycle that has none, s
_NO_SLIP = (math.inf, math.inf)


def simulation_of(
    p: Parameters,
    plant: Plant,
    replay: bool = True,
    budget: int = PER_CYCLE,
    settled: bool = False,
) -> Simulation:
    """Return the simulation of an axis; start it with cycles from `model.waveforms.command_of`.

    settled: the hysteresis of the actuator begins each move on the loop that the cycles settle to,
    as an axis does that has run them before; otherwise an actuator that never moved begins.
    """
    surface = Surface.of(p.friction)
    if has_chain(p.actuator) or surface:
        chain = Chain.of(p)
        return DrivenSimulation(plant, p.solver.tolerance, chain, surface, replay, budget, settled)
    return Simulation(plant, p.solver.tolerance, replay, budget)


class DrivenSimulation(Simulation):
    """Advances one axis whose commanded deflection goes through a chain.

    Drive cycles, and all properties of cycles, are those of the command.
    """

    def __init__(
        self,
        plant: Plant,
        tolerance: float,
        chain: Chain,
        surface: Surface | None = None,
        replay: bool = True,
        budget: int = PER_CYCLE,
        settled: bool = False,
    ) -> None:
        """Start as a `Simulation` does, with an actuator that never moved.

        On a surface, each cycle has its own contact. settled is as in `simulation_of`.
        """
        self._settled = settled
        self._chain = self._given = chain  # the lines are laid with the first, see `_check_speed`
        self._surface = surface
        self._moment = CycleStart(0.0, 0)  # start of the cycle: time and position, for its contact
        self._factor = 1.0  # of the distances at which its contact gives way
        self._slips, self._slip_rate = _NO_SLIP, 0.0  # of the drive cycle
        self._command, self._period = _STANDING, 1.0  # durations (s), rates (m/s); s
        self._slip_times = (0.0, math.inf, math.inf)  # last end, next begin and end of a slip, s
        self._nodes, self._spare = np.empty((3, CAPACITY)), np.empty((3, CAPACITY))
        self._before = self._after = chain.rest()  # the chain where the window begins and ends
        self._origin, self._until = 0.0, math.inf  # of the window, s
        self._segments = _STANDING  # command of the window: durations (s) and rates (m/s)
        #: Of the window: its shift (m), its slip's first and last piece
        self._slip: Sequence[Any] = (0.0, -1, -1)
        self._cycles = 0  # cycles in the window, 0 if the command rests
        self._rest_span = _FIRST_REST
        self._offset = 0.0  # deflection less that of the chain, m
        self._begun, self._count, self._done = 0.0, 0, 0  # of the move, up to the window
        self._last_cycle: dict[str, float] = {}  # results of the last cycle of the command
        super().__init__(plant, tolerance, replay, budget)

    # -- the command

    @property
    def commanded(self) -> float:
        """The commanded deflection, m."""
        # Not of the state that the chain has now: a chain of too many lines has none.
        value = float(self._before[COMMAND])
        for duration, rate in zip(*self._split_command(self._t)[0], strict=True):
            value += float(duration * rate)
        return value

    def set_chain(self, chain: Chain) -> None:
        """Change the constants from the present time on, without a jump of the deflection."""
        if same_chain(chain, self._given):
            return
        self._anchor()
        old, state = self._chain, self._state_at(self._t)
        taken = adapt_state(old, chain, state)
        before, self._offset = self._offset, self._offset + static_deflection(old, state)
        self._offset -= static_deflection(chain, taken)
        taken[DEFLECTION] += before - self._offset
        remainder = self._split_command(self._t)[1]
        self._chain = self._given = chain
        self._done = self.cycles_done
        self._after, self._until = taken, self._t
        self._open_window(remainder, 1 if self._cycles else 0)

    def start(self, drive_cycle: DriveCycle, count: int) -> None:
        """Begin ``count`` cycles of a command at the present time, then rest; 0: at once.

        ValueError for more than one drive cycle that does not close.
        """
        check_closed(drive_cycle, count)
        self._after, self._until = self._state_at(self._t), self._t
        if self._settled:
            self._settle(drive_cycle)
        self.drive_cycle, self._period = drive_cycle, drive_cycle.period
        self._command = np.stack([drive_cycle.durations, drive_cycle.rates])
        self._slip_times = self._rests_since(self._t), math.inf, math.inf
        self._slips, self._slip_rate = _NO_SLIP, 0.0
        if drive_cycle.slip >= 0:
            ends = [0.0, *np.cumsum(drive_cycle.durations).tolist()]
            self._slips = ends[drive_cycle.slip], ends[drive_cycle.slip_end]
            self._slip_rate = drive_cycle.slip_rate
        self._begin(drive_cycle, 0)
        self._begun, self._count, self._done, self._cycles = self._t, count, 0, 0
        self._last_cycle = {name: self._s[name] for name in _OF_LAST_CYCLE}
        self._rest_span = _FIRST_REST
        self._next()

    def _settle(self, command: DriveCycle) -> None:
        """Put the plays where slow cycles of a command leave them, without a jump of the output."""
        chain, state = self._chain, self._after
        plays = state[PLAYS : PLAYS + len(chain.thresholds)]
        before = static_deflection(chain, state)
        for level in (state[COMMAND] + np.cumsum(command.strokes)).tolist():
            np.clip(plays, level - chain.thresholds, level + chain.thresholds, out=plays)
        jump = static_deflection(chain, state) - before
        state[PLAYS + len(plays) :] += jump  # creep follows the plays, which have long been there
        jump *= 1.0 + chain.creep_weight * len(chain.creep_times)
        state[DEFLECTION] += jump
        self._offset -= jump

    @property
    def plant(self) -> Plant:
        """The plant in force, with the contact of the cycle."""
        return scale_distances(self._unvaried, self._factor) if self._surface else self._unvaried

    @plant.setter
    def plant(self, plant: Plant) -> None:
        self._unvaried = plant

    def _use_plant(self, plant: Plant, tolerance: float) -> None:
        """Set a plant, whose contact varies."""
        super()._use_plant(plant, tolerance)
        if self._surface:
            each = None if self._each is None else self._each.copy()
            self._nominal = self._plant.copy(), tolerance, each
            self._vary(self._surface)
            self._set_clear_range()

    def _vary(self, surface: Surface) -> None:
        """Take the contact of the moment."""
        self._factor = surface.factor(self._moment)
        nominal, tolerance, each = self._nominal
        vary_contacts(nominal, self._plant, tolerance, self._factor, each, self._each)

    def _rests_since(self, t: float) -> float:
        """Return when (s) the last slip before a time t (s) ended; t within a slip."""
        before, begins, ends = self._slip_times
        if t >= ends:  # asked for first: a slip may take less time than a clock can tell
            return ends
        return before if t <= begins else t

    def _begin_next(self, surface: Surface) -> None:
        """Take the contact of the cycle that begins."""
        rests_since, now = self._rests_since(self._until), self._until
        self._slip_times = rests_since, now + self._slips[0], now + self._slips[1]
        self._moment = CycleStart(
            x=self._s["x"],
            cycle=self._moment.cycle + 1,
            dwell=self._slip_times[1] - rests_since if self._slip_rate else 0.0,
            rate=self._slip_rate,
            slid=self._s["slid"],
        )
        self._vary(surface)

    # -- properties of the cycles

    @property
    def cycles_done(self) -> int:
        """Cycles of the command that have ended."""
        return self._done + (self._s["done"] if self._cycles else 0)

    @property
    def cycles_left(self) -> int:
        """Cycles of the command that have not ended, the running one included."""
        return self._count - self.cycles_done

    def _end_of(self, cycles: int) -> float:
        return self._begun + cycles * self._period

    # -- time

    def sample(self, times: Array) -> Samples:
        """Advance to each of the times (s), which must not fall; return what happens there."""
        parts, first = [], 0
        while True:
            last = int(np.searchsorted(times, self._until))
            parts.append(super().sample(times[first:last]))
            if last == len(times):
                break
            first = last
            self._run_through(NO_ROWS)
        if len(parts) == 1:
            return parts[0]
        columns = zip(*(vars(part).values() for part in parts), strict=True)
        return Samples(*(np.concatenate(column, axis=-1) for column in columns))

    def _run(self, t: float, stop_cycle: int, rows: Array) -> None:
        """Advance to t (s), if it is infinite to the end of cycle ``stop_cycle`` of the command."""
        while True:
            wanted = stop_cycle - self._done
            if t == math.inf and self._cycles and wanted <= self._cycles:
                super()._run(t, wanted, rows)
                if wanted == self._cycles:
                    self._next()
                return
            if t == math.inf and wanted <= 0:
                return
            if t < self._until:
                super()._run(t, ENDLESS, NO_ROWS)
                return
            rows = self._run_through(rows)

    def _run_through(self, rows: Array) -> Array:
        """Run the window to its end and open the next one; return the rows that are left."""
        cycles = self._cycles
        super()._run(math.inf, max(cycles, 1), rows[:cycles])
        self._next()
        return rows[cycles:]

    # -- windows

    def _next(self) -> None:
        """Open the window that follows the present one."""
        self._check_speed()
        self._done += self._cycles
        if not self._cycles:  # a rest is no cycle
            for name, value in self._last_cycle.items():
                self._s[name] = value
        elif self._done == self._count:
            self._last_cycle = {name: self._s[name] for name in _OF_LAST_CYCLE}
        if self._done < self._count:
            if self._surface:
                self._begin_next(self._surface)
            self._open_window(self._command, 1)
        elif motion_left(self._chain, self._after) > STILL:
            self._open_window(np.array([[self._rest_span], [0.0]]), 0)
            self._rest_span *= 2.0
        else:  # an endless window, in which the actuator rests
            self._before = self._after
            self._origin, self._until = self._until, math.inf
            self._segments, self._cycles = _STANDING, 0
            self._s["start"], self._s["open_tau"] = self._origin, 0.0
            self._s["count"] = self._s["done"] = 0

    def _check_speed(self) -> None:
        """Lay finer lines from now on if the runner got nearly as fast as it was taken to get.

        Its speed is estimated ahead from the commanded stroke, and an actuator driven in its
        resonance goes farther. Speed builds up from cycle to cycle, so that this comes in time.
        """
        fastest, self._s["v_most"] = self._s["v_most"], 0.0
        if fastest > _NEARLY_AS_FAST * self._chain.mean_only_rate:
            self._chain = self._chain._replace(mean_only_rate=fastest / _NEARLY_AS_FAST**2)
            self._segments = _STANDING  # the lines of no cycle serve any more

    def _open_window(self, segments: Array, cycles: int) -> None:
        """Open a window of a command, for all remaining cycles if it begins as the last one did."""
        again = (
            cycles > 0
            and self._cycles > 0
            and (segments is self._segments or np.array_equal(segments, self._segments))
        )
        # Pieces that begin where those of an earlier move ended lead to the curve once, not again.
        again = again and abs(self._slip[0]) <= STILL
        if again and distance(self._after, self._before, self._chain.omega) <= STILL:
            cycles = 1 if self._surface else self._count - self._done
        else:
            self._before, self._segments = self._after, segments
            self._after = self._before.copy()
            offsets = self._offset, self._s["level"]  # the end of the previous pieces
            pieces, *self._slip = lay_pieces(
                self._chain, self._after, segments, offsets,
                self._slips if cycles else _NO_SLIP, (self._nodes, self._spare),
            )  # fmt: skip
            if pieces < 0:
                raise SolverError(
                    f"a cycle takes more than {CAPACITY} pieces behind amplifier and actuator: "
                    "raise actuator_damping or the frequency of the drive"
                )
            self._drive = self._spare[:, :pieces].copy()
        self._origin, self._cycles = self._until, cycles
        self._until = (
            self._end_of(self._done + cycles) if cycles else self._origin + segments[0].sum()
        )
        begin_window(self._axis, self._origin, max(cycles, 1), *self._slip)
        self._set_clear_range()

    def _split_command(self, t: float) -> tuple[Array, Array]:
        """Return durations (s) and rates (m/s) of the window's command before and after t (s)."""
        durations, rates = self._segments
        if math.isinf(self._until):
            return self._segments[:, :0], self._segments  # the actuator rests, however long it has
        since, ends = t - self._origin, np.cumsum(durations)
        if self._cycles:
            since -= self._s["done"] * self._period
        used = np.minimum(durations, since - (ends - durations))
        left = np.minimum(durations, ends - since)
        # In the order of C: for any other, `follow` would compile anew while the axis runs.
        before, after = (
            np.ascontiguousarray(np.stack([part, rates])[:, part > 0.0]) for part in (used, left)
        )
        return before, after

    def _state_at(self, t: float) -> Array:
        """Return the chain at a time (s) within the window."""
        state = self._before.copy()
        durations, rates = self._split_command(t)[0]
        if len(durations):
            follow(self._chain, state, durations, rates, self._nodes, self._spare)
        return state
