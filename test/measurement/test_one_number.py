# SPDX-License-Identifier: Apache-2.0
"""Step size and backstep of a file are the same numbers, whatever shows them, and true ones."""

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_traces import SLEWRATE, Axis, Drive, Sensor, bench_trace
from table_1 import table_1

import stickslip_ros as ss
from stickslip_ros.cli.main import main
from stickslip_ros.motion.sampling import trace_steps
from stickslip_ros.motion.steps import run_steps
from stickslip_ros.motion.trace import save_csv
from stickslip_ros.reporting import to_json


def _true(axis: Axis, drive: Drive) -> tuple[float, float]:
    """Return step (m) and backstep (m) of the settled cycles, without noise and densely sampled."""
    bench = bench_trace(axis, (drive,), Sensor(rate=2e6), rest=0.02)
    (run,) = bench.runs
    slips = run.start + np.arange(1, run.steps + 1) / drive.frequency - drive.amplitude / SLEWRATE
    first = 7 if run.steps > 8 else (run.steps - 1) // 2
    found = []
    for slip in slips[first:-1]:
        part = slice(*np.searchsorted(bench.t, [slip, slip + 0.45 / drive.frequency]))
        fallen = np.interp(slip, bench.t, drive.direction * bench.x)
        found.append(fallen - (drive.direction * bench.x[part]).min())
    return run.step_size, float(np.mean(found))


def _forward(_: Path) -> tuple[str, list[tuple[float, float]]]:
    return "steps_100hz.csv", [_true(Axis(), Drive(10, pause=0.02))]


def _there_and_back(_: Path) -> tuple[str, list[tuple[float, float]]]:
    drives = (Drive(8, pause=0.01), Drive(8, pause=0.02, direction=-1))
    return "there_and_back.csv", [_true(Axis(preload=1.0), drive) for drive in drives]


def _fast(folder: Path) -> tuple[str, list[tuple[float, float]]]:
    drive = Drive(20, 400.0, pause=0.01)
    bench = bench_trace(Axis(), (drive,), Sensor(rate=200e3, noise=1e-9), rest=0.02, seed=4)
    table = np.column_stack([bench.t, bench.x])
    np.savetxt(folder / "fast.csv", table, delimiter=",", header="t (s),x (m)", comments="")
    return str(folder / "fast.csv"), [_true(Axis(), drive)]


def _with_actuator(folder: Path) -> tuple[str, list[tuple[float, float]]]:
    save_csv(trace_steps(table_1(), 12), folder / "trace.csv")
    run = run_steps(table_1(), 12)
    return str(folder / "trace.csv"), [(run.step_size, run.backstep)]


@pytest.mark.long
@pytest.mark.parametrize(
    "make",
    [_forward, _there_and_back, _with_actuator, pytest.param(_fast, marks=pytest.mark.long)],
)
def test_analyse_and_compare_show_the_same_numbers_and_true_ones(
    make: Callable[[Path], tuple[str, list[tuple[float, float]]]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """By JSON of both commands, text, table and library: 48.6 and 47.9 nm were shown of one file.

    There and back had no backstep at all. Each is within three standard errors of the truth.
    """
    file, true = make(tmp_path)
    frequency = f"{400.0 if make is _fast else 100.0:g}"

    def output(*arguments: str) -> Any:
        main([*arguments])
        return capsys.readouterr().out

    table = tmp_path / "runs.csv"
    arguments = (file, "--frequency", frequency, "--table", str(table), "--json")
    analysed = json.loads(output("analyse", *arguments))
    options = ("--set", f"frequency={frequency}", "--json")
    compared = json.loads(output("compare", "table1_typical.yaml", file, *options))
    runs = analysed["runs"]
    assert compared["runs"] == runs
    for run, both, (step, backstep) in zip(runs, compared["by_run"], true, strict=True):
        assert both["metrics"]["step size"]["measured"] == run["step_size"]
        assert both["metrics"]["backstep"]["measured"] == run["backstep"]
        assert run["mean_speed"] == run["step_size"] * run["frequency"]
        accurate = 1e-14 + 3.0 * run["step_size_error"]
        assert run["step_size"] == pytest.approx(step, abs=accurate)
        if run["backstep"] is None:  # not determined
            continue
        assert run["backstep"] == pytest.approx(backstep, abs=1e-11 + 3.0 * run["backstep_error"])
    main_one = max(runs, key=lambda one: one["steps"])
    found = ss.analyse(file, frequency=float(frequency))
    text = output("analyse", file, "--frequency", frequency)
    for name in ("step_size", "backstep", "mean_speed"):
        assert analysed[name] == to_json(getattr(found, name)) == main_one[name]
    shown = re.findall(r"(\d+\.(\d+)) nm", text)  # with its decimals
    for name in ("step_size", "backstep"):
        if analysed[name] is None:
            assert "not determined" in text
            continue
        assert any(f"{1e9 * analysed[name]:.{len(one)}f}" == number for number, one in shown)
    assert analysed["balance"]["step"] == main_one["direction"] * main_one["step_size"]
    assert analysed["balance"]["backstep"] == analysed["backstep"]
    rows = np.genfromtxt(table, delimiter=",", names=True)
    assert np.atleast_1d(rows["step_size_m"]) == pytest.approx([one["step_size"] for one in runs])
    assert np.atleast_1d(rows["steps"]).tolist() == [one["steps"] for one in runs]
    backsteps = [math.nan if one["backstep"] is None else one["backstep"] for one in runs]
    assert np.atleast_1d(rows["backstep_m"]) == pytest.approx(backsteps, nan_ok=True)
