# SPDX-License-Identifier: Apache-2.0
"""Advances axes in simulated time, within a fraction of the processor.

Simulated time follows a steady clock as far as the processor allows. Simulation that does not fit
into the budget of a callback is counted and dropped from the pace, not queued. So the caller
receives the next command soon, however much the parameters cost. With an external clock nothing is
dropped: the axes reach its time, later. The motion of an axis does not depend, to the last bit, on
how its time is divided: only the stamps of a recording show the pace.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from stickslip_ros.axis.axis import Axis
from stickslip_ros.axis.sensor import has_bandwidth


@dataclass(frozen=True)
class PaceSettings:
    """Limits of the processor time for the simulation; all times are seconds."""

    share: float = 0.75  #: of one processor; the rest is for messages and commands
    at_once: float = 8e-3  #: processor time in one call: others are heard after that
    debt: float = 0.1  #: processor time at most that a piece which cost too much is made up for
    piece: float = 2e-3  #: processor time of one piece of motion: `at_once` is passed by that much
    #: Longest real time of one piece, at rest and in motion: a slip may cost a thousand times as
    #: much as the rise before it.
    longest: float = 0.025
    longest_moving: float = 0.005
    #: Processor time per simulated second to expect of a command whose cost is not known. Slips of
    #: several contacts behind a spring take 80: then the first piece takes 40 ms.
    new_cost: float = 4.0
    growth: float = 4.0  #: of one piece over the one before, as motion costs more in a slip
    #: Part of the time asked for whose loss is called overload: single blocks are late at times.
    tolerated: float = 0.02


@dataclass(frozen=True)
class PaceReport:
    """How time went since the last report."""

    factor: float  #: simulated over real time
    cost: float  #: processor time of a second of motion, s
    overload: float  #: s for which the axes have been overloaded without a break; 0: they are not
    behind: float = 0.0  #: s behind the clock that they follow; 0 without one


class Pace:
    """Simulated time of axes, from 0 on. Readings of clocks and stamps are nanoseconds too.

    A stamp is that of the start plus the time simulated, so stamps rise with it whatever is done
    to the clock of the machine meanwhile.
    """

    def __init__(
        self,
        axes: Sequence[Axis],
        factor: float,
        steady: int,
        stamp: int,
        processor: Callable[[], float],
        followed: Callable[[], int] | None = None,
    ) -> None:
        """Start where the steady clock shows ``steady`` and the clock of the machine ``stamp``.

        factor is simulated by real time; with 0 only `leap` moves the time. processor returns the
        time (s) that this thread has spent on a processor, followed the reading of a clock that
        leads the time in place of the steady one and never runs back.
        """
        self.ns = 0  #: the present time of the simulation
        self.dropped = 0  #: time taken off the pace, ns
        self.factor = factor
        self._axes = axes
        self._settings = PaceSettings()
        self._followed = followed
        self._last = self._reported = steady
        #: Reading of the leading clock from which the pace holds, and the time (ns) due there
        self._since = (self._reading(steady), 0)
        self._start_stamp = stamp
        self._processor = processor
        self._together = 0  # ns that all axes have reached; one may be ahead after a command
        self._goal = 0  # ns of the present leap
        self._acted = -1  # ns at which the last command acted
        self._late = False  # the last block did not reach its end
        self._budget = self._settings.at_once  # s of processor left
        self._cost = self._settings.new_cost  # s of processor for a second of motion, as expected
        self._window = (0, 0, 0.0)  # together, dropped (ns) and processor time (s) as reported
        self._spent = 0.0  # s of processor
        self._overload = 0.0

    @property
    def seconds(self) -> float:
        """The present time of the simulation, s."""
        return self.ns * 1e-9

    @property
    def stamp(self) -> int:
        """The stamp of the present time."""
        return self._start_stamp + self.ns

    def change(self, steady: int, factor: float) -> None:
        """Go on at another pace from now on; 0 lets the time stand still but for leaps."""
        self._since = self._reading(steady), max(self._due(steady), self.ns) + self.dropped
        self.factor = factor
        self._goal = 0

    # -- advancing

    def catch_up(self, steady: int, only: Axis | None = None) -> bool:
        """Advance to a reading of the steady clock, or as far as the budget goes.

        only: the axis that is wanted at once, the others follow with the next block. Returns
        whether there is a new state to be shown; it is later than the last command.
        """
        before = self._together
        wanted = max(self._due(steady), self.ns, self._acted + 1)
        reached = self._advance_to(wanted, steady, only)
        return reached == self.ns and (reached > before or reached == wanted)

    def act(self, steady: int, axis: Axis) -> None:
        """Advance one axis to the present, at which a command acts: later than the one before.

        While the processor is overloaded, the command acts a nanosecond after the last one.
        """
        later = round(1e9 * axis.actuation.t) + 1
        if self._late:
            axis.advance(later * 1e-9)
            self.ns = max(self.ns, later)
        else:
            self._advance_to(max(self._due(steady), self.ns, later), steady, axis)
        self._acted = self.ns

    def leap(self, ns: int, budget: float) -> bool:
        """Advance by a time, or by the rest of the last leap; return True when it is done.

        budget: processor time (s) to be spent at most.
        """
        if self._goal <= self._together:
            self._goal = max(self._together, self.ns) + ns
        self._budget = budget
        self._together = self._advance(self._axes, self._goal)
        self.ns = max(self.ns, self._together)
        return self._together == self._goal

    def expect_change(self) -> None:
        """Expect motion of another cost, because of a command or of new parameters."""
        self._cost = max(self._cost, self._settings.new_cost)

    # -- how it went

    def report(self, steady: int) -> PaceReport:
        """Return how time went since the last call."""
        together, dropped, spent = self._window
        self._window = (self._together, self.dropped, self._spent)
        real, self._reported = 1e-9 * max(steady - self._reported, 1), steady
        moved, lost = 1e-9 * (self._together - together), 1e-9 * (self.dropped - dropped)
        behind = 1e-9 * max(0, self._due(steady) - self.ns) if self._followed else 0.0
        late = lost > self._settings.tolerated * (moved + lost)
        if self._followed:  # that goes as it goes: only what they cannot reach is too much
            late = self._late and behind > self._settings.tolerated * (moved + behind)
        self._overload = self._overload + real if late else 0.0
        cost = (self._spent - spent) / moved if moved else 0.0
        return PaceReport(moved / real, cost, self._overload, behind)

    # -- inside

    def _reading(self, steady: int) -> int:
        return self._followed() if self._followed else steady

    def _due(self, steady: int) -> int:
        """Return the time (ns) at which the axes should be at a reading of the steady clock."""
        reading, due = self._since
        elapsed = self._reading(steady) - reading
        # Whole numbers as long as they do: a float counts single nanoseconds for 104 days only.
        return due + (elapsed if self.factor == 1.0 else int(elapsed * self.factor)) - self.dropped

    def _advance_to(self, wanted: int, steady: int, only: Axis | None) -> int:
        """Advance all axes or one to a time (ns), within the budget; return the time reached."""
        if only and self._late:
            return self._together
        more = self._settings.share * max(0, steady - self._last) * 1e-9
        self._budget = min(self._settings.at_once, self._budget + more)
        self._last = steady
        reached = self._advance((only,) if only else self._axes, wanted)
        if not only:
            self._together, self._late = reached, reached < wanted
        self.ns = max(self.ns, reached)
        if not self._followed:
            self.dropped += max(0, self._due(steady) - self.ns)
        return reached

    def _advance(self, axes: Sequence[Axis], wanted: int) -> int:
        """Advance axes piece by piece to a time (ns) or to the end of the budget; return where."""
        reached = self._together
        while reached < wanted and self._budget > 0.0:
            piece = min(wanted - reached, max(1, round(1e9 * self._settings.piece / self._cost)))
            reached += piece
            t, began = reached * 1e-9, self._processor()
            for axis in axes:
                if axis.actuation.t < t:
                    axis.advance(t)
            spent = self._processor() - began
            self._budget = max(self._budget - spent, -self._settings.debt)
            self._spent += spent
            if axes is self._axes:
                self._learn(spent, piece)
        return reached

    def _learn(self, spent: float, piece: int) -> None:
        """Learn the cost (s) of a piece of motion (ns)."""
        settings = self._settings
        moving = any(axis.moving for axis in self._axes)
        longest = settings.longest_moving if moving else settings.longest
        least = settings.piece / (longest * max(1.0, self.factor))
        self._cost = max(1e9 * spent / piece, self._cost / settings.growth, least)


def overload(axis: Axis, report: PaceReport) -> str:
    """Return a warning for an axis that does not keep its pace; else an empty text."""
    if not report.overload:
        return ""
    p = axis.parameters
    how = f"real-time factor {report.factor:.3g} of {p.node.real_time_factor:g}"
    if report.behind:
        how = f"{report.behind:.2g} s behind /clock"
    costly = []
    if has_bandwidth(p.sensor):
        costly.append(f"sensor_bandwidth {p.sensor.sensor_bandwidth:g} Hz")
    if p.friction.contacts > 1:
        costly.append(f"contacts {p.friction.contacts}")
    if axis.moving:
        costly.append(f"{axis.actuation.hertz or p.drive.frequency:g} cycles a second")
    why = ", ".join(costly) or "the load of the machine"
    return f"{how}: a second of motion takes {report.cost:.2g} s of processor, by {why}"
