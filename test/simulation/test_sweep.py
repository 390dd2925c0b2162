# SPDX-License-Identifier: Apache-2.0
"""Grids, metrics, the way of a sweep through an executor, and its table."""

import math
import os
import signal
import threading
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from table_1 import table_1

import stickslip_ros as ss
from stickslip_ros.base.reporting.picture import save_picture
from stickslip_ros.physics.model import LAWS, Plant, drive_of
from stickslip_ros.physics.model.waveforms import drives_of
from stickslip_ros.physics.parameters import ParameterError, Parameters
from stickslip_ros.simulation import operating_points
from stickslip_ros.simulation.operating_points import (
    batch_of,
    crossings,
    largest_amplitude,
    steps_of,
    zero_amplitude,
)
from stickslip_ros.simulation.parallel import in_order, threads
from stickslip_ros.simulation.settled import MEASURABLE
from stickslip_ros.simulation.steps import run_steps
from stickslip_ros.simulation.sweep_metrics import METRICS
from stickslip_ros.simulation.sweep_plan import Sweep, SweepAxis, SweepError
from stickslip_ros.simulation.sweep_result import SweepResult, compute


def sweep_of(*ranges: str, metrics: tuple[str, ...] = ("step_size",), **values: Any) -> Sweep:
    base = table_1(**{"frequency": 1000.0, **values})
    return Sweep(base, tuple(SweepAxis.parse(text) for text in ranges), metrics, 12)


def value_of(metric: str, **values: Any) -> float:
    """One metric at one operating point."""
    mass = values.pop("mass", 4e-3)
    sweep = sweep_of(f"mass={mass}:{mass}:1", metrics=(metric,), **values)
    return float(sweep.evaluate(0, 1)[0, 0])


# -- columns of parameters


@pytest.mark.parametrize("model", LAWS)
@pytest.mark.parametrize("own", [True, False], ids=["the law's own values", "given values"])
def test_a_column_of_plants_is_as_one_by_one(model: str, own: bool) -> None:
    draw = np.random.default_rng(3)
    p = table_1(model=model)
    p = p.replace(preload=draw.uniform(0.6, 5.0, 30))
    p = p.replace(payload=draw.uniform(0.0, 0.01, 30), inclination=draw.uniform(-3.0, 3.0, 30))
    p = p.replace(sigma_0_cap=draw.choice([0.0, 1.0, 3.0], 30))
    if not own:
        p = p.replace(sigma_0=draw.choice([0.0, 2e6], 30), sigma_0ss=draw.choice([0.0, 3e7], 30))
        p = p.replace(z_ba=draw.choice([0.0, 1e-8], 30), z_ss=draw.choice([0.0, 9e-8], 30))
    many, possible = batch_of(p.replace(amplitude=np.full(30, 100.0)), 30, 1)
    for k in range(30):
        try:
            plant = Plant.of(p.point(k))
        except ParameterError:
            assert not possible[k]
            continue
        assert possible[k]
        assert many.plants.points(30)[k] == plant


def test_a_column_of_drives_is_as_one_by_one() -> None:
    draw = np.random.default_rng(4)
    p = table_1(max_frequency=1e6, max_voltage=250.0)
    p = p.replace(amplitude=draw.uniform(10, 300, 200), frequency=10.0 ** draw.uniform(1, 6.2, 200))
    p = p.replace(slewrate=draw.uniform(50, 1000, 200), gain=draw.uniform(4e-10, 6e-10, 200))
    drive_cycle, possible = drives_of(p, 200, -1)
    assert 0 < possible.sum() < 200
    for k in range(200):
        try:
            wanted = drive_of(p.point(k), -1)
        except ParameterError:
            assert not possible[k]
            continue
        assert possible[k]
        assert (drive_cycle.slip[k], drive_cycle.sign) == (wanted.slip, wanted.sign)
        np.testing.assert_array_equal(drive_cycle.durations[k], wanted.durations)
        np.testing.assert_array_equal(drive_cycle.rates[k], wanted.rates)


@pytest.mark.parametrize("steps", [1, 12, -30])
def test_steps_of_columns_are_those_of_run_steps(steps: int) -> None:
    p = table_1(frequency=1000.0)
    p = p.replace(preload=np.linspace(0.2, 5.0, 15))
    step_size, backstep = steps_of(p, 15, steps)
    for k in range(15):
        run = run_steps(p.point(k), steps)
        np.testing.assert_array_equal([step_size[k], backstep[k]], [run.step_size, run.backstep])


def test_steps_of_waveforms_with_different_segments() -> None:
    """Points with and without holds in one batch, each as if it were alone."""
    p = table_1(frequency=1000.0, waveform="shaped", latency=6e-5)
    p = p.replace(hold_before=np.tile([0.0, 0.2], 6))
    p = p.replace(split=np.repeat([0.0, 0.5, 1.0], 4))
    for steps in (1, -12):
        step_size, backstep = steps_of(p, 12, steps)
        for k in range(12):
            run = run_steps(p.point(k), steps)
            np.testing.assert_array_equal(
                [step_size[k], backstep[k]], [run.step_size, run.backstep]
            )


def test_the_zero_amplitude_knows_what_holds_leave_to_the_slip() -> None:
    """With most of the period held, only amplitudes whose slip is short enough are tried."""
    p = table_1(frequency=2e4, waveform="hold", hold_before=0.95, slewrate=50.0)
    assert float(largest_amplitude(p)) == pytest.approx(0.999 * 2.5e-6 * 50e6)
    with pytest.raises(ParameterError, match="lower hold_before"):
        zero_amplitude(p.replace(hold_after=0.5))


# -- grids


def test_values_of_an_axis() -> None:
    linear, log = SweepAxis.parse("preload=0.1:6:60"), SweepAxis.parse("frequency=100:1e4:5:log")
    np.testing.assert_array_equal(linear.values, np.linspace(0.1, 6.0, 60))
    np.testing.assert_allclose(log.values, np.geomspace(100.0, 1e4, 5), rtol=1e-14)
    assert linear.values[59] == 6.0
    assert SweepAxis.parse("amplitude=300:30:10").values[[0, 9]].tolist() == [300.0, 30.0]
    for axis in (linear, log):
        assert SweepAxis.parse(str(axis)) == axis


def test_a_wrong_range_is_refused() -> None:
    for text, complaint in (
        ("preloda=1:2:3", "did you mean preload"),
        ("model=1:2:3", "model has no range; list its values"),
        ("preload=1:2", "NAME=START:STOP:COUNT"),
        ("preload=1:2:3:lin", "NAME=START:STOP:COUNT"),
        ("preload=1:2:x", "NAME=START:STOP:COUNT"),
        ("preload=1:2:0", "empty range"),
        ("preload=1:2:1", "empty range"),
        ("preload=1:1:2", "empty range"),
        ("preload=0:2:3", "between 0.001 and 1000"),
        ("preload=1:nan:3", "finite"),
        ("spring=0:1e6:3:log", "above 0"),
    ):
        with pytest.raises((SweepError, ParameterError), match=complaint):
            SweepAxis.parse(text)


def test_a_sweep_of_nothing_sensible_is_refused() -> None:
    with pytest.raises(SweepError, match="different parameters"):
        sweep_of("preload=1:2:3", "preload=1:2:3")
    with pytest.raises(SweepError, match="no metric 'speed'"):
        sweep_of("preload=1:2:3", metrics=("speed",))
    with pytest.raises(SweepError, match="different metrics"):
        sweep_of("preload=1:2:3", metrics=("step_size", "step_size"))


def test_points_are_numbered_along_the_last_axis_first() -> None:
    sweep = sweep_of("preload=1:2:2", "amplitude=100:300:3")
    slow, fast = sweep.coordinates(0, 6)
    assert slow.tolist() == [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]
    assert fast.tolist() == [100.0, 200.0, 300.0] * 2
    assert [c.tolist() for c in sweep.coordinates(4, 6)] == [[2.0, 2.0], [200.0, 300.0]]


def test_points_of_a_large_sweep_are_made_when_they_are_needed() -> None:
    sweep = sweep_of("preload=0.1:6:3000", "amplitude=30:300:3000")
    last = sweep.coordinates(sweep.points - 1, sweep.points)
    assert [float(c[0]) for c in last] == [6.0, 300.0]
    assert np.isfinite(sweep.evaluate(10**6, 10**6 + 3)).all()


# -- metrics


def test_backward_steps_are_mirrored() -> None:
    metrics = ("step_size", "backstep", "zero_amplitude", "mean_speed")
    base = sweep_of("preload=0.4:2:3", metrics=metrics)
    back = Sweep(base.base, base.axes, base.metrics, -12)
    forward, backward = base.evaluate(0, 3), back.evaluate(0, 3)
    np.testing.assert_array_equal(backward * [-1.0, 1.0, 1.0, -1.0], forward)
    np.testing.assert_array_equal(forward[:, 3], 1000.0 * forward[:, 0])


def test_zero_amplitude_is_that_of_a_single_axis() -> None:
    sweep = replace(sweep_of("preload=0.4:2:4", metrics=("zero_amplitude",)), steps=None)
    wanted = [zero_amplitude(sweep.point(k)) for k in range(4)]
    np.testing.assert_array_equal(sweep.evaluate(0, 4)[:, 0], np.array(wanted, dtype=float))


HEAVY = {"mass": 0.012, "preload": 0.8}


@pytest.mark.parametrize(
    "values",
    [{"frequency": 1000.0}, *({**HEAVY, "frequency": f} for f in (500.0, 1100.0, 3500.0, 5100.0))],
)
def test_zero_amplitude_lies_where_settled_steps_become_measurable(
    values: dict[str, float],
) -> None:
    """Also where ringing outlasts twelve cycles and moves a purely elastic contact meanwhile."""
    p = table_1(**values)
    found = zero_amplitude(p)
    assert found is not None
    for deflection, steps in ((found - 2e-11, False), (found, True)):
        position = run_steps(p.replace(amplitude=deflection / p.actuator.gain), 800).position
        assert bool(abs(position[-1] - position[399]) / 400 >= MEASURABLE) is steps


def test_points_run_until_they_have_settled() -> None:
    """As many steps as ringing lasts; where it dies within a cycle, twelve and the same bits."""
    p = table_1().replace(
        preload=np.array([4.447, 3.97, 2.27]),
        frequency=np.array([2508.0, 6833.0, 4874.0]),
        amplitude=np.array([300.0, 34.0, 85.0]),
        mass=np.array([0.004, 0.0022, 0.0278]),
    )
    step_size, _ = steps_of(p, 3, None)
    batch, possible = batch_of(p, 3, 1)
    position, _ = batch.run(2000, possible)
    wanted = (position[:, -1] - position[:, 999]) / 1000
    np.testing.assert_allclose(step_size, wanted, rtol=0.0, atol=1e-11)
    assert (np.abs(steps_of(p, 3, 12)[0] - wanted) > 1e-10).all()
    p = table_1(frequency=100.0).replace(preload=np.linspace(0.1, 6.0, 15))
    np.testing.assert_array_equal(steps_of(p, 15, None), steps_of(p, 15, 12))


def test_the_zero_amplitude_is_a_seventh_above_z_ba() -> None:
    """Where ringing dies between slips and z_ss = 2 z_ba: 1.14 z_ba within 3 %, for the CEIM."""
    sweep = sweep_of("preload=0.1:3:5", metrics=("zero_amplitude",), frequency=100.0)
    z_ba = [Plant.of(sweep.point(k)).contact.z_ba for k in range(5)]
    np.testing.assert_allclose(sweep.evaluate(0, 5)[:, 0] / z_ba, 1.14, rtol=0.03)


def test_zero_amplitude_of_an_impossible_axis_says_why() -> None:
    with pytest.raises(ParameterError, match="z_ss has to be larger"):
        zero_amplitude(table_1(model="epm_calc", preload=0.2))
    assert zero_amplitude(table_1(preload=50.0)) is None


def test_where_the_load_moves_the_runner_there_is_no_zero_amplitude() -> None:
    sweep = sweep_of("force=-0.3:0.3:5", metrics=("zero_amplitude",))
    values = sweep.evaluate(0, 5)[:, 0]
    np.testing.assert_array_equal(np.isnan(values), [True, False, False, False, True])
    assert sweep.why_empty(0).endswith(": the load moves the runner without the drive")
    for k in (0, 4):
        assert zero_amplitude(sweep.point(k)) is None
    blocked = sweep_of("preload=50:60:2", metrics=("zero_amplitude",), frequency=100.0)
    assert blocked.why_empty(0).endswith("does not step even at the largest amplitude")


def test_intersection_is_larger_than_direct_and_on_the_line_through_clear_steps() -> None:
    direct = value_of("zero_amplitude", frequency=100.0)
    crossing = value_of("zero_amplitude_intersection", frequency=100.0)
    assert direct < crossing
    # Steps at 80 and 160 nm in the specification: 54.10 and 133.83 nm.
    assert 1e9 * crossing == pytest.approx(80.0 - 54.10 * 80.0 / (133.83 - 54.10), abs=0.1)


def test_intersection_needs_clear_steps() -> None:
    assert math.isnan(value_of("zero_amplitude_intersection", preload=5.5, frequency=100.0))


def test_generated_force_is_what_the_spring_holds_in_the_end() -> None:
    force = value_of("generated_force", preload=2.0)
    assert force == value_of("generated_force", preload=2.0, spring=1e6)
    run = run_steps(table_1(preload=2.0, frequency=1000.0).replace(spring=1e6), 600)
    assert force == pytest.approx(1e6 * run.position[-100:].mean(), rel=1e-3)


def test_generated_force_has_its_maximum_at_a_moderate_preload() -> None:
    sweep = sweep_of("preload=0.5:5.5:6", metrics=("generated_force",), frequency=100.0)
    forces = sweep.evaluate(0, 6)[:, 0]
    best = int(np.argmax(forces))
    assert 0 < best < 5
    assert (np.diff(forces[: best + 1]) > 0.0).all()


def test_blocking_preload_lies_where_steps_can_no_longer_be_measured() -> None:
    limit = value_of("blocking_preload", frequency=100.0)
    p = table_1(frequency=100.0)
    assert 5.0 < limit < 8.0
    assert run_steps(p.replace(preload=limit), 12).step_size < MEASURABLE
    assert run_steps(p.replace(preload=limit - 2e-4), 12).step_size >= MEASURABLE


def test_blocking_preload_starts_where_the_law_is_defined() -> None:
    limit = value_of("blocking_preload", model="epm_calc", amplitude=60.0)
    assert math.isnan(limit) or limit > 0.5


def test_one_impossible_point_is_empty_and_says_why() -> None:
    sweep = sweep_of("frequency=1e4:1e6:3", max_frequency=1e7, metrics=tuple(METRICS)[:3])
    values = sweep.evaluate(0, 3)
    assert np.isfinite(values[0]).all()
    assert np.isnan(values[1:]).all()
    assert "frequency 505000 Hz" in sweep.why_empty(1)
    assert "the slip of 300 V" in sweep.why_empty(1)
    sweep.refuse_if_impossible()


def test_a_sweep_without_a_possible_point_is_refused() -> None:
    sweep = sweep_of("preload=0.1:0.4:3", model="epm_calc")
    with pytest.raises(SweepError, match=r"no point .* z_ss has to be larger"):
        sweep.refuse_if_impossible()


# -- executors


class Direct(Executor):
    """Runs a part when it is submitted and counts the parts."""

    def __init__(self) -> None:
        self.parts: list[range] = []

    def submit(self, function: Any, /, *args: Any, **_: Any) -> Future[Any]:
        self.parts += args
        future: Future[Any] = Future()
        future.set_result(function(*args))
        return future


def test_parts_come_in_order_and_cover_the_sweep() -> None:
    sweep = sweep_of("preload=0.1:6:7", "amplitude=100:300:9")
    executor = Direct()
    found = compute(sweep, executor)
    assert len(executor.parts) > 1
    assert [k for part in executor.parts for k in part] == [*range(sweep.points)]
    whole = sweep.evaluate(0, sweep.points)[:, 0].reshape(sweep.shape)
    np.testing.assert_array_equal(found["step_size"], whole)


def test_result_does_not_depend_on_the_number_of_threads() -> None:
    sweep = sweep_of("preload=0.1:6:50", metrics=("step_size", "zero_amplitude"))
    wanted = sweep.evaluate(0, 50)
    for workers in (1, 2, 3):
        with ThreadPoolExecutor(workers) as threads:
            found = compute(sweep, threads)
        np.testing.assert_array_equal(np.stack(list(found.metrics.values()), axis=1), wanted)


def test_few_parts_wait_however_long_the_sweep_is() -> None:
    executor = Direct()
    parts = in_order(executor, lambda k: k, iter(range(1_000_000)))
    assert [next(parts) for _ in range(3)] == [0, 1, 2]
    assert len(executor.parts) <= 3 + 3 * (os.cpu_count() or 1)


def test_ctrl_c_leaves_the_points_that_are_done() -> None:
    sweep, told = sweep_of("preload=0.1:6:40"), iter(range(3))

    def interrupt(points: int) -> None:
        if next(told) == 2:
            raise KeyboardInterrupt

    found = compute(sweep, Direct(), interrupt)
    assert 0 < found.done < 40
    assert np.isfinite(found["step_size"][: found.done]).all()
    assert np.isnan(found["step_size"][found.done :]).all()
    assert len(found.csv().splitlines()) == 1 + found.done


def test_a_sweep_that_fits_no_memory_is_refused() -> None:
    with pytest.raises(SweepError, match="at most 10000000 values: lower COUNT"):
        sweep_of("preload=0.1:6:10000", "amplitude=100:300:10000")


@pytest.mark.long
def test_a_cluster_gives_the_same_numbers_and_a_worker_that_dies_loses_nothing() -> None:
    """Real scheduler, two processes; one is killed while the sweep runs."""
    distributed = pytest.importorskip("distributed")
    sweep = sweep_of("preload=0.1:6:40", "amplitude=100:300:100")
    with threads(2) as pool:
        wanted = compute(sweep, pool)
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None
        ) as workers,
        distributed.Client(workers) as client,
    ):
        killed: list[int] = []

        def kill_one(points: int) -> None:
            if not killed:
                killed.append(workers.workers[0].pid)
                os.kill(killed[0], signal.SIGKILL)

        found = compute(sweep, client.get_executor(), kill_one)
    assert killed and found.done == sweep.points
    np.testing.assert_array_equal(found["step_size"], wanted["step_size"])


# -- the table


def test_table_holds_coordinates_and_metrics_with_units() -> None:
    sweep = sweep_of("preload=1:2:2", "amplitude=100:300:2", metrics=("step_size", "mean_speed"))
    lines = compute(sweep, Direct()).csv_file().splitlines()
    names = next(line for line in lines if not line.startswith("#"))
    assert names == "preload (N),amplitude (V),step_size (m),mean_speed (m/s)"
    numbers = np.loadtxt(lines[lines.index(names) + 1 :], delimiter=",")
    np.testing.assert_array_equal(numbers[:, :2], np.stack(sweep.coordinates(0, 4), axis=1))
    np.testing.assert_array_equal(numbers[:, 2:], sweep.evaluate(0, 4))


# -- the picture


def test_lines_and_maps_are_drawn(tmp_path: Path) -> None:
    for ranges in (
        ("preload=0.1:6:5",),
        ("preload=1:1:1",),
        ("frequency=100:1e4:4:log", "preload=0.1:6:5"),
        ("frequency=100:1e4:4", "preload=1:1:1"),
    ):
        found = compute(sweep_of(*ranges, metrics=("step_size", "mean_speed")), Direct())
        found["step_size"].flat[0] = math.nan
        save_picture(tmp_path / "sweep.png", found.picture())
        assert (tmp_path / "sweep.png").read_bytes().startswith(b"\x89PNG")


def test_parts_run_at_the_same_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two threads are inside the runs of their parts together: neither waits for the other."""
    both = threading.Barrier(2, timeout=20.0)

    def meet(
        p: Parameters, points: int, steps: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        both.wait()
        return steps_of(p, points, steps)

    monkeypatch.setattr(operating_points, "steps_of", meet)
    sweep = Sweep(table_1(), (SweepAxis.parse("preload=0.5:1:4"),), ("step_size",), 3)
    with ThreadPoolExecutor(2) as executor:
        parts = [executor.submit(sweep.evaluate, first, first + 2) for first in (0, 2)]
        assert all(np.isfinite(part.result()).all() for part in parts)


def test_an_empty_point_does_not_hide_the_extremes_of_the_others() -> None:
    values = np.array([math.nan, 2.0, math.nan, 5.0, math.nan])
    found = SweepResult(sweep_of("preload=1:5:5"), {"step_size": values}, 5)
    assert "2.000 m to 5.000 m" in " ".join(found.report().split())
    assert found.empty.tolist() == [0, 2, 4]


def test_a_line_takes_three_clear_steps() -> None:
    """Two make a line without any evidence that the steps lie on one."""
    deflection = np.array([[50e-9], [100e-9], [150e-9]])
    step = deflection - 20e-9
    every = np.ones((3, 1), dtype=bool)
    assert crossings(deflection, step, every)[0] == pytest.approx(20e-9)
    for left_out in range(3):
        clear = every.copy()
        clear[left_out] = False
        assert math.isnan(crossings(deflection, step, clear)[0])


@pytest.mark.parametrize(
    "effects",
    [
        {"amplifier_bandwidth": 5e3},
        {"amplifier_slew": 20.0},
        {"actuator_resonance": 2e4},
        {"actuator": "hysteresis", "actuator_memory": True},
        {"creep": 0.02, "slip_spread": 0.05},
        {"contacts": 3, "contact_spread": 0.2},
    ],
)
def test_so_many_steps_of_a_sweep_are_those_of_simulate(effects: dict[str, Any]) -> None:
    """Behind the actuator's effects a sweep began with the settled actuator: 0.82 for -1.28 nm."""
    p = ss.Parameters.of("table1_typical", frequency=1000.0, **effects)
    found = ss.sweep(p, amplitude=[200.0, 300.0], steps=8)
    alone = [ss.simulate(p, amplitude=volts, steps=8) for volts in (200.0, 300.0)]
    assert found["step_size"] == pytest.approx([one.step_size for one in alone], abs=1e-15)
    assert found.left_out == ()


def test_texts_and_whole_numbers_vary_as_single_values_would() -> None:
    """A bare ValueError of NumPy, and the advice "use --set" in Python."""
    laws = ss.sweep(model=["ceim", "lugre"], preload=[0.3, 0.4])
    for k, model in enumerate(("ceim", "lugre")):
        alone = ss.sweep(model=model, preload=[0.3, 0.4])["step_size"]
        np.testing.assert_array_equal(laws["step_size"][k], alone)
    assert laws.csv().splitlines()[3].startswith("lugre,0.3,")
    assert laws.as_json()["vary"]["model"] == ["ceim", "lugre"]
    assert "2 values, ceim, lugre" in laws.report()
    assert [text.get_text() for text in laws.plot().get_yticklabels()] == ["ceim", "lugre"]
    contacts = ss.sweep(contacts=[1, 2])["step_size"]
    assert contacts[1] == ss.sweep(contacts=2, preload=[0.4])["step_size"][0]
    with pytest.raises(ParameterError, match="waveform_table names no file"):
        ss.sweep(waveform=["sawtooth", "table"])
