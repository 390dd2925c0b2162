# SPDX-License-Identifier: Apache-2.0
"""A stick-slip axis as its controller shows it: steps, amplitude, frequency.

A move of N steps is N cycles of the sawtooth. A new command replaces what is left of the running
move; whatever changes, changes between cycles. Time is an argument: the axis never reads a clock,
and the same commands at the same times give the same motion to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from stickslip_ros.model import Pattern, Plant, drive_of, plant_of
from stickslip_ros.parameters import ParameterError, Values, check, parameter
from stickslip_ros.solver import Simulation, State


class CommandRefused(ValueError):
    """A command that the axis does not carry out; the message names the value and the limit."""


@dataclass(frozen=True)
class Event:
    """Something a later run has to know to repeat this one, or a user to understand it."""

    time: float  #: s since the start of the simulation
    name: str  #: what it is about, such as "steps"
    outcome: str  #: "applied", "refused" or "finished"
    details: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Status:
    """What the axis says of itself."""

    state: str  #: "stopped" or "stepping"
    steps_done: int  #: of the present or last move, with sign
    steps_left: int  #: of the present move, with sign
    amplitude: float  #: commanded, V
    frequency: float  #: commanded, Hz
    refused: int  #: commands refused since the start
    last_error: str  #: reason of the last refusal
    last_step: float  #: displacement over the last cycle, m; nan before the first
    mean_step: float  #: mean over the present or last move, m; nan before its first step
    backstep: float  #: of the last slip, m; nan before the first
    lost: float  #: energy lost in the contact over the last cycle, J; nan before the first


class Axis:
    """One axis. All times are seconds of simulation, all positions metres."""

    def __init__(self, parameters: Mapping[str, Any]) -> None:
        """Set up an axis at rest at 0; ParameterError if the parameters do not make one."""
        self.parameters: Values = check(parameters)
        self._sim = Simulation(plant_of(self.parameters), self.parameters["tolerance"])
        drive_of(self.parameters)
        self._amplitude: float = self.parameters["amplitude"]
        self._frequency: float = self.parameters["frequency"]
        self._moving = False
        self._x_move = 0.0  # where the present move began
        self._done_before = 0  # steps of the present move before its pattern last changed
        self._sign = 1
        self._x_end = 0.0  # where the last move ended, before the runner rang down
        self._next_steps: int | None = None  # waits for the end of the cycle
        # The cycle after which commands that wait take effect, and when it ends (s). Kept, because
        # the solver may round a time just before that end to it and be in the next cycle already.
        self._change: tuple[int, float] | None = None
        self._refused = 0
        self._last_error = ""
        self._events: list[Event] = []

    # -- what the axis is

    @property
    def state(self) -> State:
        """Runner, actuator and contact at the present time."""
        return self._sim.state

    @property
    def plant(self) -> Plant:
        """Contact, mass and loads in force."""
        return self._sim.plant

    @property
    def simulation(self) -> Simulation:
        """The solver below, to be read only."""
        return self._sim

    @property
    def moving(self) -> bool:
        """True from the start of a move to the end of its last cycle."""
        return self._moving

    @property
    def status(self) -> Status:
        """A snapshot of what the axis says of itself."""
        done = self._steps_done()
        mean = float("nan")
        if done:
            x = self._sim.position_of_cycle if self._moving else self._x_end
            mean = (x - self._x_move) / done
        left = self._sim.cycles_left * self._sign if self._moving else 0
        if self._next_steps is not None:
            left = self._next_steps
        return Status(
            state="stepping" if self._moving else "stopped",
            steps_done=done * self._sign,
            steps_left=left,
            amplitude=self._amplitude,
            frequency=self._frequency,
            refused=self._refused,
            last_error=self._last_error,
            last_step=self._sim.last_step,
            mean_step=mean,
            backstep=self._sim.backstep,
            lost=self._sim.last_lost,
        )

    def take_events(self) -> list[Event]:
        """Return the events since the last call, oldest first, and forget them."""
        events, self._events = self._events, []
        return events

    # -- what it is told

    def command_steps(self, steps: int) -> None:
        """Run that many steps, the sign is the direction; 0 finishes the cycle and stops."""
        self._note("steps", "applied", value=steps)
        if self._moving:
            self._next_steps = steps
            self._change_later()
        elif steps:
            self._begin_move(steps)

    def command_amplitude(self, volts: float) -> None:
        """Set the amplitude (V peak to peak) from the next cycle on; CommandRefused if bad."""
        self._check_drive("amplitude", volts)
        self._amplitude = volts

    def command_frequency(self, hertz: float) -> None:
        """Set the frequency (Hz) from the next cycle on; CommandRefused if bad."""
        self._check_drive("frequency", hertz)
        self._frequency = hertz

    def set_parameters(self, changes: Mapping[str, Any]) -> None:
        """Change parameters from the next cycle on; CommandRefused, and nothing changed, if bad."""
        try:
            new = self.checked(changes)
        except ParameterError as error:
            raise self._refusal("parameters", str(error), **changes) from None
        self._note("parameters", "applied", **changes)
        self.parameters = new
        if self._moving:
            self._change_later()
        else:
            self._go_on(0)
            self._apply_parameters()

    def checked(self, changes: Mapping[str, Any]) -> Values:
        """Return the parameters as they would be with changes; ParameterError if they can't be."""
        for name in changes:
            if not parameter(name).mutable:
                raise ParameterError(f"{name} can be set at the start only")
        new = check({**self.parameters, **changes})
        plant_of(new)
        drive_of({**self._with_drive(), **changes})
        return new

    def refuse(self, name: str, value: object, reason: str) -> CommandRefused:
        """Count a command that never got as far as the axis; return the error to raise."""
        return self._refusal(name, reason, value=value)

    # -- time

    def advance(self, t: float) -> None:
        """Advance to time t (s), not before the present one."""
        while self._moving:
            cycle, ends = self._change or self._last_cycle()
            if ends > t:
                break
            self._sim.run_cycles(cycle - self._sim.cycles_done)
            if self._change:
                self._between_cycles()
            else:
                self._finish()
        self._sim.advance(t)

    # -- inside

    def _steps_done(self) -> int:
        return self._done_before + self._sim.cycles_done

    def _last_cycle(self) -> tuple[int, float]:
        """Return the number of the last cycle of the move and the time (s) of its end."""
        return self._sim.cycles_done + self._sim.cycles_left, self._sim.end_of_move

    def _change_later(self) -> None:
        """Let what was commanded take effect when the running cycle ends."""
        if self._change:
            return
        done = self._sim.cycles_done
        self._change = (
            (done + 1, self._sim.end_of_cycle) if self._sim.cycles_left else self._last_cycle()
        )

    def _begin_move(self, steps: int) -> None:
        self._moving = True
        self._sign = 1 if steps > 0 else -1
        self._x_move = self._sim.state.x
        self._sim.start(self._pattern(), abs(steps))
        self._done_before = 0

    def _go_on(self, steps: int) -> None:
        """Start the pattern in force for what is left of the move, or rest if nothing is."""
        self._done_before += self._sim.cycles_done
        self._sim.start(self._pattern(), steps)

    def _between_cycles(self) -> None:
        left = self._sim.cycles_left
        self._change = None
        self._apply_parameters()
        steps, self._next_steps = self._next_steps, None
        if steps:
            self._begin_move(steps)
            return
        self._go_on(left if steps is None else 0)
        if self._sim.cycles_left == 0:
            self._finish()

    def _finish(self) -> None:
        self._moving = False
        self._x_end = self._sim.position_of_cycle
        self._note("move", "finished", steps=self._steps_done() * self._sign, position=self.state.x)

    def _apply_parameters(self) -> None:
        self._sim.set_plant(plant_of(self.parameters), self.parameters["tolerance"])

    def _pattern(self) -> Pattern:
        return drive_of(self._with_drive(), self._sign)

    def _with_drive(self, **changes: Any) -> Values:
        """Return the parameters with amplitude and frequency as commanded, then changes."""
        drive = {"amplitude": self._amplitude, "frequency": self._frequency}
        return {**self.parameters, **drive, **changes}

    def _check_drive(self, name: str, value: float) -> None:
        try:
            drive_of(self._with_drive(**{name: value}))
        except ParameterError as error:
            raise self._refusal(name, str(error), value=value) from None
        self._note(name, "applied", value=value)
        if self._moving:
            self._change_later()

    def _refusal(self, name: str, reason: str, **details: Any) -> CommandRefused:
        self._refused += 1
        self._last_error = reason
        self._note(name, "refused", reason=reason, **details)
        return CommandRefused(reason)

    def _note(self, name: str, outcome: str, **details: Any) -> None:
        self._events.append(Event(self._sim.state.t, name, outcome, details))
