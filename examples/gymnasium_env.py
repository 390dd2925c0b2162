# SPDX-License-Identifier: Apache-2.0
"""A Gymnasium environment of one axis: reach a target by trains of steps and a last scan.

    pip install gymnasium
    python gymnasium_env.py

An action is a number of steps (-1 to 1, of MOST_STEPS) and a level of the actuator (0 to 1, of
max_voltage), at which it then stands. The agent sees the noisy reading of the sensor alone.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box

import stickslip_ros as ss

MOST_STEPS, TRIES, FARTHEST = 50, 20, 5e-6  # the target lies within FARTHEST (m)


class Positioning(gymnasium.Env):
    """Observation: reading less target (um); reward: minus its size; ends within 10 nm."""

    observation_space = Box(-100.0, 100.0, (1,))
    action_space = Box(np.array([-1.0, 0.0], np.float32), np.array([1.0, 1.0], np.float32))

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Put a new axis at rest and draw a target."""
        super().reset(seed=seed)
        number = int(self.np_random.integers(2**31))
        self.axis = ss.Axis({"frequency": 1000.0, "sensor_noise": 1e-9, "sensor_seed": number})
        self.target = float(self.np_random.uniform(-FARTHEST, FARTHEST))
        self.tries = 0
        return self._observation(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Run the steps, then the scan of an action."""
        steps = round(MOST_STEPS * float(np.clip(action[0], -1.0, 1.0)))
        volts = self.axis.parameters.actuator.max_voltage * float(np.clip(action[1], 0.0, 1.0))
        for command, value in (("steps", steps), ("scan", volts)):
            if value or command == "scan":
                self.axis.command(command, value)
            while self.axis.moving:
                self.axis.advance(self.axis.state.t + 1e-3)
        self.tries += 1
        seen = self._observation()
        error = abs(float(seen[0]))
        return seen, -error, error < 0.01, self.tries >= TRIES, {"truth": self.axis.state.x}

    def _observation(self) -> Any:
        return np.array([1e6 * (self.axis.measured - self.target)], np.float32)


if __name__ == "__main__":
    world, done, level = Positioning(), False, 0.5
    (first,), _ = world.reset(seed=1)
    error = float(first)
    while not done:  # a step is about 0.13 um, and the whole voltage 0.16 um
        steps = round(-error / 0.13)
        level = 0.5 if steps else float(np.clip(level - error / 0.16, 0.0, 1.0))
        (after,), reward, reached, late, _ = world.step(np.array([steps / MOST_STEPS, level]))
        error = float(after)
        print(f"{1000.0 * error:8.1f} nm from the target, reward {reward:.3f}")
        done = reached or late
