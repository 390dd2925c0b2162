# SPDX-License-Identifier: Apache-2.0
"""The environments of Gymnasium: one axis, or many of them at once. Needs the extra ``gym``."""

from __future__ import annotations

import copy
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from stickslip_ros.arrays import Array
from stickslip_ros.gym.positioning import Positioning

#: Positions that an observation can show, of the travel: noise and drift lead beyond its ends
_BEYOND = 2.0


def spaces_of(core: Positioning) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.Box]:
    """Return the spaces of observations and of actions of one axis."""
    drive, limits = core.axes.drive, core.axes.parameters.limits
    low, high = _BEYOND * limits.travel_low, _BEYOND * limits.travel_high
    longest = core.task.limit + (drive.sample or 1.0 / drive.frequency[0])
    observations = gymnasium.spaces.Box(
        np.array([low, low, drive.low, 0.0]),
        np.array([high, high, drive.high, longest]),
        dtype=np.float64,
    )
    numbers = 1 if drive.sample else 4
    return observations, gymnasium.spaces.Box(-1.0, 1.0, (numbers,), np.float64)


def checked(actions: Any, space: gymnasium.spaces.Box) -> Array:
    """Return actions as an array of the space's shape; ValueError for others."""
    array = np.ascontiguousarray(actions, dtype=np.float64)
    if array.shape != space.shape:
        raise ValueError(
            f"the action has the shape {array.shape}; give {space.shape}, each within -1 and 1"
        )
    if not np.isfinite(array).all():
        found = array[~np.isfinite(array)][0]
        raise ValueError(f"the action has a value of {found}; give finite ones, within -1 and 1")
    return array


class PositionEnv(gymnasium.Env[Array, Array]):
    """One axis that does a task; see docs/control.md for its arguments.

    An observation is the reading of the sensor that arrived last (m), the target (m), the voltage
    (V) and the time (s). An action, numbers within -1 and 1, is one drive cycle: amplitude with the
    direction as its sign, place of the level in the room that it leaves, frequency, slewrate; or,
    with ``ranges`` of a sample, one voltage.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(self, **settings: Any) -> None:
        """Set up the axis; settings are those of `Positioning`."""
        self.core = Positioning(1, **settings)
        self.observation_space, self.action_space = spaces_of(self.core)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode; return its first observation and what a policy does not see."""
        super().reset(seed=seed)
        self.core.start(np.array([0]), [self.np_random])
        return self.core.observation[0], self._info()

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Run a period."""
        done = self.core.run(checked(action, self.action_space)[None])
        observation, reward = self.core.observation[0], float(done.reward[0])
        return observation, reward, bool(done.terminated[0]), bool(done.truncated[0]), self._info()

    def _info(self) -> dict[str, Any]:
        return {name: float(values[0]) for name, values in self.core.info().items()}

    def save(self) -> Any:
        """Return the state, for `restore`: the run goes on to the same bits."""
        return copy.deepcopy((self.core, self.np_random))

    def restore(self, state: Any) -> None:
        """Go back to a state that `save` has returned."""
        self.core, self.np_random = copy.deepcopy(state)


class PositionVectorEnv(VectorEnv[Array, Array, NDArray[Any]]):
    """Many axes that do a task, advanced together; axis k is `PositionEnv` with seed + k."""

    metadata: ClassVar[dict[str, Any]] = {
        "render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP,
    }  # fmt: skip

    def __init__(self, num_envs: int = 1, **settings: Any) -> None:
        """Set up the axes; settings are those of `Positioning`."""
        self.num_envs = num_envs
        self.core = Positioning(num_envs, **settings)
        self.single_observation_space, self.single_action_space = spaces_of(self.core)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators = [seeding.np_random(None)[0] for _ in range(num_envs)]
        self._done = np.zeros(num_envs, np.bool_)

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode of every axis; seeds are seed, seed + 1, and so on, or a list."""
        seeds = [seed + k for k in range(self.num_envs)] if isinstance(seed, int) else seed
        for k, one in enumerate(seeds or ()):
            if one is not None:
                self._generators[k] = seeding.np_random(one)[0]
        self._done[:] = False
        self.core.start(np.arange(self.num_envs), self._generators)
        return self.core.observation, self._infos()

    def step(
        self, actions: Array
    ) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Run a period; an axis whose episode has ended begins the next one instead."""
        done = self.core.run(checked(actions, self.action_space))
        again = np.flatnonzero(self._done)
        if len(again):
            self.core.start(again, [self._generators[k] for k in again.tolist()])
            for values in done:
                values[again] = 0
        self._done = done.terminated | done.truncated
        return self.core.observation, *done, self._infos()

    def _infos(self) -> dict[str, Any]:
        infos: dict[str, Any] = {}
        for name, values in self.core.info().items():
            infos[name], infos[f"_{name}"] = values, np.ones(self.num_envs, np.bool_)
        return infos
