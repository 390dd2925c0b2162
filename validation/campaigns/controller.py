# SPDX-License-Identifier: Apache-2.0
"""Random sequences of commands, held against a state machine that knows no physics.

    python -m validation.campaigns.controller [--count 500] [--seed 1]

The machine knows where the axis was told to go, how fast steps can be (their stroke at their
frequency), how long a command holds and what stops it. From that follow the states that the axis
may be in, how far it may have gone since the last look, that it stands still within 20 ms and one
step of a stop, that a velocity is over after its second, and which faults there may be. At the end
the recorded events are run again, and have to lead to the same place to the last bit.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.axis.events import Event
from stickslip_ros.axis.resimulation import Rerun
from validation.campaigns.arguments import arguments

JOINT = "axis_slider"
#: Time (s) within which a stop acts, and how long a velocity lasts; settling of what follows.
SOON, HOLDS, SETTLES = 0.02, 1.0, 0.05
#: Commands of a sequence; time (s) between them at most.
COMMANDS, BETWEEN = 25, 2.0
#: Of what the axis may be in fault, by what was set: a timeout of targets, a limit of velocity.
FAULTS = ("come no closer", "come no nearer", "not stayed so near", "velocity is", "held by the")


@dataclass
class Machine:
    """What an axis was told, and what follows from it."""

    states: set[str] = field(default_factory=lambda: {"stopped"})
    speed: float = 0.0  #: m/s, at most
    still: float = 0.0  #: s, from which on it stands still, if that is known
    #: What a stop leaves: a cycle that ends soon may be finished; and until when, s
    left: tuple[set[str], float] = field(default_factory=lambda: (set(), 0.0))
    faulty: bool = False  #: whether something was done that may end in a fault
    enabled: bool = True

    def told(self, t: float, name: str, value: Any, stroke: float, cycle: float) -> None:
        """Take a command at a time t (s); stroke (m) and cycle (s) are those of its steps."""
        pace, steps = stroke / cycle, abs(value) if name == "steps" else 0
        after = t + max(cycle, SOON) + SETTLES  # a running cycle is finished first
        ways = {
            "steps": ({"stepping", "stopped"}, t + cycle * (steps + 1) + SETTLES),
            "jog": ({"jogging"}, math.inf),
            "position": ({"targeting", "holding"}, math.inf),
            "trajectory": ({"targeting", "holding"}, math.inf),
            "velocity": ({"targeting", "holding"}, t + HOLDS + SETTLES + 30.0 * cycle),
            "scan": ({"scanning", "stopped"}, math.inf),
            "home": ({"homing", "stopped"}, math.inf),
        }
        if name in ("stop", "jog 0", "disable"):
            self.left = self.states, t + SOON
            self.states, self.still = {"stopped"}, t + SOON
            self.enabled = self.enabled and name != "disable"
        elif name == "steps 0":
            self.states, self.still = self.states | {"stopped"}, after
        elif name == "frequency" and t < self.still:  # the rest of the steps takes longer
            self.still = t + (self.still - t) * max(1.0, 1.0 / (value * cycle)) + 1.0 / value
        elif name == "free" and "holding" in self.states:  # by steps that it took for short
            self.still = max(self.still, t + SETTLES + 30.0 * cycle)
        elif name in ways:
            states, still = ways[name]
            self.states = states | (self.states if name != "scan" else set())
            self.still = still
        self.speed = max(self.speed, pace)

    def findings(self, axis: Axis, since: float, before: float, stroke: float) -> list[str]:
        """Return what an axis does that it was not told, since a time (s) at a place (m)."""
        status, x, t = axis.status, axis.state.x, axis.state.t
        found = []
        allowed = self.states | (self.left[0] if t <= self.left[1] else set())
        allowed = allowed | {"fault"} if self.faulty else allowed
        allowed = allowed if self.enabled else {"disabled"}
        if status.state not in allowed:
            found.append(f"{status.state} ({status.fault}), where it may be {sorted(allowed)}")
        if status.fault and not any(one in status.fault for one in FAULTS):
            found.append(f"fault: {status.fault}")
        far = self.speed * (t - since) + 3.0 * stroke
        if abs(x - before) > far:
            found.append(f"went {1e6 * (x - before):.4g} um, {1e6 * far:.4g} um at most")
        if since > self.still and abs(x - before) > 1.5 * stroke:
            found.append(f"went {1e9 * (x - before):.4g} nm after its end at {self.still:.4g} s")
        return found


def _draw(random: np.random.Generator) -> tuple[str, Any]:
    """Return a command and its value."""
    name = str(random.choice([
        "steps", "steps 0", "jog", "jog 0", "scan", "position", "trajectory", "velocity", "home",
        "stop", "reset", "frequency", "amplitude", "enable", "disable", "stuck", "free", "zero",
    ]))  # fmt: skip
    sign = int(random.choice([-1, 1]))
    values = {
        "steps": sign * int(random.integers(1, 400)),
        "jog": sign * float(10.0 ** random.uniform(0.0, 3.5)),
        "scan": float(random.uniform(0.0, 250.0)),
        "position": sign * float(10.0 ** random.uniform(-8.0, -4.7)),
        "trajectory": [(0.2, sign * 1e-6), (0.5, -sign * 2e-6)],
        "velocity": sign * float(10.0 ** random.uniform(-6.0, 0.0)),
        "frequency": float(10.0 ** random.uniform(-4.0, 3.5)),
        "amplitude": float(random.uniform(150.0, 300.0)),
    }
    return name, values.get(name)


def _send(axis: Axis, name: str, value: Any) -> None:
    """Send a command by its name here. Raises CommandRefused."""
    sends: dict[str, Any] = {
        "steps": lambda: axis.command("steps", value),
        "steps 0": lambda: axis.command("steps", 0),
        "jog": lambda: axis.command("jog", value),
        "jog 0": lambda: axis.command("jog", 0.0),
        "scan": lambda: axis.command("scan", value),
        "position": lambda: axis.command("position", value),
        "trajectory": lambda: axis.command("trajectory", [JOINT], value),
        "velocity": lambda: axis.command("joint_command", JOINT, "velocity", value),
        "home": lambda: axis.command("home"),
        "stop": lambda: axis.command("stop"),
        "reset": lambda: axis.command("reset"),
        "zero": lambda: axis.command("zero"),
        "frequency": lambda: axis.command("frequency", value),
        "amplitude": lambda: axis.command("amplitude", value),
        "enable": lambda: axis.command("enable", True),
        "disable": lambda: axis.command("enable", False),
        "stuck": lambda: axis.command("parameters", {"fault": "axis_stuck"}),
        "free": lambda: axis.command("parameters", {"fault": ""}),
    }
    sends[name]()


def sequence(seed: int) -> list[str]:
    """Run one sequence; return what is wrong with it."""
    random = np.random.default_rng(seed)
    axis = Axis({"frequency": 1000.0, "allow_faults": True, "target_timeout": 1.0})
    machine, events, done = Machine(), list[Event](), list[str]()
    for _ in range(COMMANDS):
        name, value = _draw(random)
        t = axis.state.t
        stroke = 160e-9 * axis.parameters.drive.amplitude / 300.0
        hertz = max(axis.status.frequency, abs(value) if name in ("jog", "frequency") else 0.0)
        try:
            _send(axis, name, value)
        except CommandRefused:
            done.append(f"{name} refused")
        else:
            done.append(f"{t:.4g} {name} {value}")
            # Steps after a jog have the frequency that was commanded, and wait for its cycle.
            slowest = min(hertz, axis.parameters.drive.frequency) if name == "steps" else hertz
            machine.told(t, name, value, stroke, 1.0 / slowest)
            machine.faulty |= name in ("stuck", "position", "trajectory", "velocity", "home")
            machine.enabled |= name == "enable"
        machine.speed = max(machine.speed, hertz * stroke, 3e-4)
        until, since, before = t + float(random.uniform(0.0, BETWEEN)), t, axis.state.x
        for at in np.linspace(t, until, 5)[1:]:
            axis.advance(float(at))
            found = machine.findings(axis, since, before, stroke)
            if found:
                return [f"seed {seed} at {at:.4g} s after {'; '.join(done[-6:])}: {found[0]}"]
            since, before = float(at), axis.state.x
        events += axis.take_events()
    again = Rerun(events).advance(axis.state.t)
    if again.state != axis.state:
        off = 1e9 * (again.state.x - axis.state.x)
        return [f"seed {seed}: the recording leads {off:.3g} nm off"]
    return []


def main(argv: Sequence[str] | None = None) -> int:
    """Run the sequences; return the exit code: 1 for a finding."""
    args = arguments(__doc__, argv, count=500, seed=1)
    wrong = 0
    for seed in range(args.seed, args.seed + args.count):
        for text in sequence(seed):
            wrong += 1
            print(text, flush=True)
    print(f"{args.count} sequences, {wrong} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
