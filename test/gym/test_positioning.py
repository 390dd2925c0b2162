# SPDX-License-Identifier: Apache-2.0
"""The environments of Gymnasium: the same bits alone, in a vector and after a copy; refusals."""

import copy
import math
import pickle
from dataclasses import replace
from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import stickslip_ros as ss
from stickslip_ros.gym import TASKS, DriveRanges, Task, Weights, action_of
from stickslip_ros.gym.axis_batch import AxisBatch
from stickslip_ros.gym.periods import normal
from stickslip_ros.gym.positioning import Positioning
from stickslip_ros.library.ensemble import Ensemble
from stickslip_ros.model import Plant
from stickslip_ros.model.drive_cycle import DriveCycle
from stickslip_ros.parameters import ParameterError, Parameters
from stickslip_ros.solver import Simulation
from stickslip_ros.solver.driven import simulation_of

ID = "stickslip_ros/Position-v0"
#: A task without anything hidden, and a sensor that shows the position
PLAIN = Task(
    "plain", "", "arrival", target=(1e-6, 2e-6), tolerance=5e-9, limit=0.05,
    parameters={"sensor_noise": 0.0, "sensor_resolution": 0.0, "sensor_rate": 2e4},
)  # fmt: skip
#: One frequency and one slewrate
FIXED = DriveRanges(frequency=(1e3, 1e3), slewrate=(100.0, 100.0))


def same(one: tuple[Any, ...], other: tuple[Any, ...]) -> None:
    """Fail unless observations, rewards, ends and infos have the same bits."""
    for a, b in zip(one[:-1], other[:-1], strict=True):
        assert np.array_equal(a, b)
    assert set(one[-1]) == set(other[-1])
    assert all(np.array_equal(one[-1][name], other[-1][name]) for name in one[-1])


@pytest.mark.filterwarnings("error")
def test_gymnasium_finds_nothing_wrong() -> None:
    check_env(gymnasium.make(ID).unwrapped)
    voltage = DriveRanges(sample=1e-4)
    check_env(gymnasium.make(ID, task="hold", ranges=voltage).unwrapped)


@pytest.mark.slow
def test_a_vector_has_the_bits_of_its_axes_alone() -> None:
    """Episodes end and begin anew on the way; changes of parameters act."""
    for task in TASKS.values():
        short = replace(task, limit=0.02)
        both = [
            gymnasium.make_vec(ID, 3, vectorization_mode=mode, task=short)
            for mode in ("vector_entry_point", "sync")
        ]
        same(*(one.reset(seed=7) for one in both))
        both[0].action_space.seed(1)
        ends = 0
        for _ in range(40):
            action = both[0].action_space.sample()
            found, alone = (one.step(action) for one in both)
            same(found, alone)
            ends += int((found[2] | found[3]).sum())
        assert ends > 0, task.name


def test_a_copy_and_a_saved_state_go_on_to_the_same_bits() -> None:
    env: Any = gymnasium.make(ID, task="vertical").unwrapped
    env.reset(seed=3)
    env.action_space.seed(2)
    actions = [env.action_space.sample() for _ in range(12)]
    for action in actions[:6]:
        env.step(action)
    saved, twins = env.save(), [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    ways = [[one.step(action) for action in actions[6:]] + [one.reset()] for one in (env, *twins)]
    env.restore(saved)
    ways.append([env.step(action) for action in actions[6:]] + [env.reset()])
    for other in ways[1:]:
        for a, b in zip(ways[0], other, strict=True):
            same(a, b)


def test_cycles_at_full_amplitude_step_as_simulate_does() -> None:
    env: Any = gymnasium.make(ID, task=PLAIN, ranges=FIXED).unwrapped
    env.reset(seed=1)
    drive = env.core.axes.drive
    forward = action_of(drive, 300.0, 0.0, 1e3, 100.0)
    found = np.array([env.step(forward)[-1]["position"] for _ in range(20)])
    expected = ss.simulate(steps=20, frequency=1e3, sensor_rate=2e4).position
    assert np.abs(found - expected).max() < 1e-11
    backward = action_of(drive, -300.0, 300.0, 1e3, 100.0)
    back = [env.step(backward)[-1]["position"] for _ in range(20)]
    assert np.diff(back[8:]).mean() == pytest.approx(-np.diff(found[8:]).mean(), rel=1e-3)


def test_a_scan_moves_the_runner_with_the_actuator() -> None:
    """By an action of a cycle without amplitude, and by voltages of samples."""
    cycles: Any = gymnasium.make(ID, task=PLAIN, ranges=FIXED).unwrapped
    samples: Any = gymnasium.make(ID, task=PLAIN, ranges=DriveRanges(sample=1e-3)).unwrapped
    scan = action_of(cycles.core.axes.drive, 0.0, 60.0, 1e3, 100.0)
    for env, action, within in ((cycles, scan, 1e-10), (samples, np.array([-0.6]), 2e-8)):
        env.reset(seed=1)
        for _ in range(5):
            observation, *_, info = env.step(action)
        assert observation[2] == pytest.approx(60.0)
        assert info["position"] == pytest.approx(60.0 * 160e-9 / 300.0, abs=within)


ALL_EFFECTS = {
    "amplifier_bandwidth": 2e5, "actuator_resonance": 820e3, "actuator_damping": 0.5, "creep": 0.01,
    "actuator": "hysteresis", "actuator_memory": True,
}  # fmt: skip


@pytest.mark.parametrize(
    "effects",
    [
        ALL_EFFECTS, {"creep": 0.02}, {"amplifier_slew": 20.0}, {"contacts": 2, "creep": 0.02},
        {"model": "ceim_ageing", "contacts": 3, "inclination": 0.5},
    ],
)  # fmt: skip
def test_contacts_and_an_actuator_with_effects_move_as_on_an_axis(effects: dict[str, Any]) -> None:
    """Cycles and scans, whose direction and length change from period to period."""
    task = replace(PLAIN, parameters={**PLAIN.parameters, **effects})
    env: Any = gymnasium.make(ID, task=task).unwrapped
    env.reset(seed=1)
    drive = env.core.axes.drive
    p = Parameters.of(None, **task.parameters)
    axis, t, level = simulation_of(p, Plant.of(p), replay=False), 0.0, 0.0
    for amplitude, end, hertz in [(300.0, 0.0, 1e3), (-200.0, 250.0, 3e3), (0.0, 60.0, 5e2)] * 3:
        found = env.step(action_of(drive, amplitude, end, hertz, 100.0))[-1]["position"]
        fall = max(abs(amplitude) / 100e6, 1e-9)
        slow, volts = 1.0 / hertz - fall, end + amplitude
        rates = drive.gain * np.array([(volts - level) / slow, (end - volts) / fall])
        axis.start(DriveCycle(np.array([slow, fall]), rates, 1 if amplitude else -1, 1, 1), 1)
        t, level = t + 1.0 / hertz, end
        axis.advance(t)
        assert found == pytest.approx(axis.x, abs=1e-11)


def test_a_reading_is_the_position_at_its_time() -> None:
    p = {"sensor_latency": 2.5e-4, **PLAIN.parameters}
    env: Any = gymnasium.make(ID, task=PLAIN, parameters=p, ranges=FIXED).unwrapped
    env.reset(seed=1)
    simulation = Simulation(ss.Axis({}).plant, 1e-11, replay=False)
    action = action_of(env.core.axes.drive, 300.0, 0.0, 1e3, 100.0)
    simulation.start(ss.Axis({"frequency": 1e3}).config.drive_cycle(1, 300.0, 1e3), 9)
    for k in range(1, 9):
        reading = env.step(action)[0][0]
        simulation.advance(k * 1e-3 - 2.5e-4)
        assert reading == pytest.approx(simulation.x, abs=1e-11)


def test_noise_is_normal_and_a_function_of_seed_and_number() -> None:
    drawn = np.array([[normal(seed, k) for k in range(800)] for seed in (1, 2)])
    assert np.abs(drawn.mean(axis=1)).max() < 0.15
    assert np.abs(drawn.std(axis=1) - 1.0).max() < 0.15
    assert np.abs(np.corrcoef([*drawn, drawn[0][::-1]])[0, 1:]).max() < 0.15
    assert abs(float(np.corrcoef(drawn[0, :-1], drawn[0, 1:])[0, 1])) < 0.15


def test_hidden_parameters_come_from_ranges_or_a_fitted_file() -> None:
    found = Ensemble(("sigma_1", "mu"), (70.0, 0.2), (60.0, 0.19), (80.0, 0.21), ((1, 0), (0, 1)))
    vector: Any = gymnasium.make_vec(ID, 40, task=PLAIN, randomise=found)
    vector.reset(seed=1)
    hidden = vector.unwrapped.core.hidden
    assert np.median(hidden["mu"]) == pytest.approx(0.2, rel=0.05)
    assert 0.001 < np.std(hidden["mu"]) < 0.01
    drawn: Any = gymnasium.make_vec(ID, 40, task=PLAIN, randomise={"mu": (0.1, 0.3)})
    first, again = (drawn.reset(seed=seed)[1]["position"] for seed in (1, 1))
    assert np.array_equal(first, again)
    mu = drawn.unwrapped.core.hidden["mu"]
    assert 0.1 <= mu.min() < 0.15 < 0.25 < mu.max() <= 0.3


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("gain", (4e-10, 6e-10)),
        ("waveform", (0.0, 1.0)),
        ("contacts", (1, 3)),
        ("sensor_rate", (100.0, 200.0)),
        ("travel_high", (1e-6, 2e-6)),
        ("surface_spread", (0.1, 0.2)),
        ("mu", (-1.0, 0.2)),
    ],
)
def test_what_would_change_nothing_is_not_drawn(name: str, values: tuple[float, float]) -> None:
    with pytest.raises(ParameterError, match=f"{name}|contacts that vary"):
        Positioning(1, randomise={name: values})


def test_parameters_change_until_the_limit() -> None:
    task = replace(PLAIN, draws={"mu": (0.2, 0.2)}, changes={"mu": (0.5, 0.5)}, limit=0.01)
    env: Any = gymnasium.make(ID, task=task, ranges=FIXED).unwrapped
    env.reset(seed=1)
    still = action_of(env.core.axes.drive, 300.0, 0.0, 1e3, 100.0)
    ways = [env.step(still)[-1]["position"] for _ in range(11)]
    steps = np.array([b - a for a, b in pairwise(ways)])
    weaker = ss.simulate(steps=10, frequency=1e3, mu=0.1).step_size
    assert abs(steps[-1] - weaker) < 1e-9 < abs(steps[0] - weaker)


def test_the_reward_is_what_its_weights_say() -> None:
    only = Weights(time=0.0, approach=0.0, error=0.0)
    for name, field, scale in (("energy", "energy", 1.0), ("wear", "wear", 1.0)):
        env: Any = gymnasium.make(ID, task=PLAIN, weights=replace(only, **{name: 3.0})).unwrapped
        env.reset(seed=1)
        _, reward, _, _, info = env.step(np.array([1.0, 0.0, 0.0, 0.0]))
        assert reward == pytest.approx(-3.0 * scale * info[field])
        assert info[field] > 0.0


def test_an_episode_ends_when_the_runner_stays_at_the_target() -> None:
    task = replace(PLAIN, target=(32e-9, 32e-9), hold=2e-3)
    env: Any = gymnasium.make(ID, task=task, ranges=FIXED).unwrapped
    env.reset(seed=2)  # the target lies forward
    assert env.core.goal[0] > 0.0
    scan = action_of(env.core.axes.drive, 0.0, 60.0, 1e3, 100.0)
    ends = [env.step(scan) for _ in range(4)]
    assert [bool(end[2]) for end in ends] == [False, False, True, True]
    assert ends[2][-1]["score"] == pytest.approx(1e-3)


def test_bad_settings_are_refused() -> None:
    cases: list[tuple[dict[str, Any], str]] = [
        ({"task": "dance"}, "known: long_move"),
        ({"task": PLAIN, "parameters": {"actuator": "hysteresis"}}, "without actuator_memory"),
        ({"task": PLAIN, "parameters": {"surface_spread": 0.1}}, "vary along the surface"),
        ({"task": PLAIN, "ranges": DriveRanges(frequency=(1e3, 1e5))}, "lower the frequency"),
        ({"task": PLAIN, "ranges": DriveRanges(frequency=(1e3, 1e2))}, "the lower end first"),
        ({"task": replace(PLAIN, changes={"mu": (1.0, 1.0)})}, "give its range"),
    ]
    for settings, text in cases:
        with pytest.raises(ss.ParameterError, match=text):
            gymnasium.make(ID, **settings)
    env = gymnasium.make(ID).unwrapped
    env.reset(seed=1)
    with pytest.raises(ValueError, match=r"^the action has a value of nan; give finite ones"):
        env.step(np.array([math.nan, 0.0, 0.0, 0.0]))
    with pytest.raises(ValueError, match=r"^the action has the shape \(2,\); give \(4,\)"):
        env.step(np.zeros(2))
    with pytest.raises(ss.ParameterError, match="lies beyond"):
        action_of(AxisBatch(Parameters.of(), 1, FIXED).drive, 400.0, 0.0, 1e3, 100.0)
