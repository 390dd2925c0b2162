# SPDX-License-Identifier: Apache-2.0
"""Drivers with one fault each, such as drivers have had."""

import contextlib
from collections.abc import Mapping
from typing import Any

from stickslip_ros.testing.axis_drivers import Offline


class WrongDirection(Offline):
    """Both directions are swapped."""

    def step(self, steps: int) -> None:
        super().step(-steps)


class OneStepMore(Offline):
    """A count that begins at 0."""

    def step(self, steps: int) -> None:
        super().step(steps + (1 if steps > 0 else -1))


class StopIgnored(Offline):
    """The message of a stop gets lost."""

    def stop(self) -> None:
        pass


class JogOneWay(Offline):
    """The sign of a jog is dropped."""

    def jog(self, sign: int) -> None:
        super().jog(1)


class AmplitudeIgnored(Offline):
    """The amplitude is checked, then forgotten."""

    def set_drive(self, amplitude: float, frequency: float) -> None:
        super().set_drive(amplitude, frequency)
        super().set_drive(self.amplitude, frequency)


class FrequencyIgnored(Offline):
    """The frequency is checked, then forgotten."""

    def set_drive(self, amplitude: float, frequency: float) -> None:
        super().set_drive(amplitude, frequency)
        super().set_drive(amplitude, self.frequency)


class NothingRefused(Offline):
    """Errors of the device are swallowed."""

    def set_drive(self, amplitude: float, frequency: float) -> None:
        with contextlib.suppress(ValueError):
            super().set_drive(amplitude, frequency)


class RefusalStops(Offline):
    """A refused command ends what runs."""

    def set_drive(self, amplitude: float, frequency: float) -> None:
        try:
            super().set_drive(amplitude, frequency)
        except ValueError:
            self.stop()
            raise


class Queued(Offline):
    """A new command waits for the end of the one that runs."""

    _waiting = 0

    def step(self, steps: int) -> None:
        if self.axis.moving:
            self._waiting = steps
        else:
            super().step(steps)

    def pass_time(self, seconds: float) -> None:
        super().pass_time(seconds)
        if self._waiting and not self.axis.moving:
            waiting, self._waiting = self._waiting, 0
            super().step(waiting)


class LimitsIgnored(Offline):
    """The limits never reach the device."""

    def set_limits(self, low: float, high: float) -> None:
        pass


class TargetMissed(Offline):
    """A scale that is off by a tenth."""

    def move_to(self, x: float) -> None:
        super().move_to(self.position + 0.9 * (x - self.position))


class ReachedAtOnce(Offline):
    """The target counts as reached when the command is taken."""

    _told = False

    def move_to(self, x: float) -> None:
        super().move_to(x)
        self._told = True

    @property
    def at_target(self) -> bool:
        return self._told


class FaultHidden(Offline):
    """A fault looks like rest."""

    @property
    def fault(self) -> bool:
        return False


class StillAfterReset(Offline):
    """The reset is taken, and nothing else after it."""

    def reset(self) -> None:
        super().reset()
        self.axis.enable(False)


class NeverMoving(Offline):
    """The flag of motion is read from the wrong bit."""

    @property
    def moving(self) -> bool:
        return False


class CountsCommands(Offline):
    """Diagnostics count commands, not steps."""

    _commands = 0

    def step(self, steps: int) -> None:
        super().step(steps)
        self._commands += 1

    def status(self) -> Mapping[str, Any]:
        return {**super().status(), "steps": self._commands}


class RefusalsUncounted(Offline):
    """Diagnostics forget what was refused."""

    def status(self) -> Mapping[str, Any]:
        return {**super().status(), "refused": 0}


class Drifting(Offline):
    """The sensor creeps."""

    @property
    def position(self) -> float:
        return super().position + 1e-6 * self.axis.state.t


class NotADriver:
    """Something else."""


#: Fault -> a test that has to find it
FAULTS = {
    WrongDirection: "test_steps_go_where_their_sign_says",
    OneStepMore: "test_as_many_steps_run_as_were_told",
    StopIgnored: "test_a_jog_goes_on_until_it_is_stopped",
    JogOneWay: "test_a_jog_goes_on_until_it_is_stopped",
    AmplitudeIgnored: "test_a_smaller_amplitude_makes_smaller_steps",
    FrequencyIgnored: "test_steps_take_the_time_that_the_frequency_gives_them",
    NothingRefused: "test_an_impossible_drive_is_refused_and_what_runs_goes_on",
    RefusalStops: "test_an_impossible_drive_is_refused_and_what_runs_goes_on",
    Queued: "test_a_new_command_replaces_what_runs",
    LimitsIgnored: "test_a_limit_is_not_passed",
    TargetMissed: "test_the_closed_loop_goes_to_its_target_and_holds_it",
    ReachedAtOnce: "test_the_closed_loop_goes_to_its_target_and_holds_it",
    FaultHidden: "test_a_fault_stops_it_and_holds_until_the_reset",
    StillAfterReset: "test_a_fault_stops_it_and_holds_until_the_reset",
    NeverMoving: "test_a_jog_goes_on_until_it_is_stopped",
    CountsCommands: "test_diagnostics_count_steps",
    RefusalsUncounted: "test_diagnostics_count_refusals",
    Drifting: "test_it_stands_still_until_it_is_told_to_move",
}
