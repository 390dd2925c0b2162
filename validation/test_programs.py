# SPDX-License-Identifier: Apache-2.0
"""Each program of `validation/`, run once and short. What they find is theirs to judge."""

import importlib.util
import json
import re
import runpy
import subprocess
import sys
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
import setuptools
from child import complaints

pytest.importorskip("rclpy")

from stickslip_ros.axis.commands import COMMANDS
from stickslip_ros.simulation.steps import run_steps
from validation import benchmark
from validation.benchmark import LIMIT, Effort
from validation.benchmark.__main__ import main as bench
from validation.campaigns import (
    crossing_judges,
    crossings,
    drives,
    hostile,
    parameter_sets,
    targets,
)
from validation.campaigns.__main__ import CAMPAIGNS
from validation.campaigns.__main__ import main as campaigns
from validation.campaigns.identification import intervals, misfit, summary

ROOT = Path(__file__).resolve().parents[1]


def test_bench_compares_with_peers_and_names_those_that_are_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two solvers that share no code agree with its reference, so all three are right."""
    monkeypatch.setattr(benchmark, "QUICK", Effort(cycles=2, repeats=2, quoted=1e-4, plotted=1e-4))
    monkeypatch.setitem(sys.modules, "CyRK", None)
    picture = tmp_path / "speed.png"
    case = ["--quick", "--cases", "0.4N-18500Hz", "--methods", "scipy-odeint", "cyrk-dop853"]
    assert bench([*case, "--json", "--plot", str(picture)]) == 0
    (found,) = json.loads(capsys.readouterr().out)["cases"]
    methods = {one["name"]: one for one in found["methods"]}
    assert set(methods) == {"ours", "scipy-odeint", "cyrk-dop853"}
    for name in ("ours", "scipy-odeint"):
        assert methods[name]["quoted"]["error"] <= LIMIT
    assert "pip install cyrk" in methods["cyrk-dop853"]["missing"]
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_make_installs_the_peers_of_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    handed: dict[str, Any] = {}
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(setuptools, "setup", handed.update)
    runpy.run_path("setup.py")
    listed = re.search(r"^PEERS := (.*)$", Path("Makefile").read_text("utf-8"), re.MULTILINE)
    assert listed
    assert listed[1].split() == handed["extras_require"]["bench"]


@pytest.mark.parametrize(
    "judged",
    [
        ["--judge", "kernel", "--count", "2", "--seed", "7", "--radians", "1e8", "--corners"],
        pytest.param(
            [
                *("--judge", "topics", "--count", "1", "--seed", "3"),
                *("--real", "--radians", "1e5", "--effects", "plain,lag"),
            ],
            marks=pytest.mark.long,
        ),
    ],
    ids=["kernel", "topics"],
)
def test_the_solver_keeps_its_promise_on_drives_by_lot(
    judged: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """Those that an integrator judges are in the tests of the solver."""
    assert drives.main(judged) == 0, capsys.readouterr().out


def test_every_campaign_is_a_module_or_tests_that_read_its_variables(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name, campaign in CAMPAIGNS.items():
        module, *arguments = campaign.command
        assert importlib.util.find_spec(module), name
        for variable in campaign.environment:
            tests = Path(arguments[-1])
            assert any(variable in one.read_text("utf-8") for one in tests.parent.glob("*.py")), (
                name
            )
    assert campaigns(["fizz", "--count", "3"]) == 2
    assert "there is no campaign 'fizz'; known: accuracy, " in capsys.readouterr().err


@pytest.mark.usefixtures("ros_domain")
@pytest.mark.timeout(1200)
@pytest.mark.parametrize(
    "name",
    [
        name
        if name in ("records", "kills", "commands")
        else pytest.param(name, marks=pytest.mark.long)
        for name in hostile.CASES
        if name not in ("floods", "clock", "interrupts", "twin")  # for hours, on an idle machine
    ],
)
def test_hostile_treatment_does_no_harm(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert hostile.CASES[name].run(hostile.CASES[name].short, seed=7) == 0, capsys.readouterr().out


@pytest.mark.parametrize("name", ["predict", pytest.param("emulate", marks=pytest.mark.long)])
def test_ctrl_c_ends_a_command_soon_and_leaves_nothing_half(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert hostile.CASES["interrupts"].run(2, 7, name) == 0, capsys.readouterr().out


def test_sets_over_all_ranges_give_a_result_or_a_word() -> None:
    """The last one was never done: its slew limit lies far below what the drive asks for."""
    run_steps({"creep": 0.01, "dwell_growth": 0.02, "surface_spread": 0.1}, 3)  # compiled by that
    for number in (*range(6), 1489):
        values = parameter_sets.drawn(number)
        assert parameter_sets.judged(values) in ("result", "refused", "budget"), values


def test_every_pair_of_crosses_is_among_the_first_crossings() -> None:
    """By counting them, which the array's maker does not do."""
    found = {
        (case.journey, *pair)
        for case in (crossings.drawn(5, k) for k in range(len(crossings.covering(5))))
        for pair in combinations(sorted([*case.chosen.items(), ("judge", case.judge)]), 2)
    }
    wanted = set()
    for name, journey in crossings.JOURNEYS.items():
        crosses = {**journey.crosses, "judge": {judge: {} for judge in journey.judges}}
        for one, other in combinations(sorted(crosses), 2):
            wanted |= {(name, (one, a), (other, b)) for a in crosses[one] for b in crosses[other]}
    assert found >= wanted
    assert str(crossings.drawn(5, 900)) == str(crossings.drawn(5, 900))  # alone, as among others


def test_crossings_are_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    """What works, what is refused with a cure that helps, and what is wrong in silence."""
    plain = dict.fromkeys(crossings.JOURNEYS["J4 design"].crosses, "plain")
    values = {"model": "ceim", "preload": 0.5, "frequency": 100.0, "amplitude": 200.0}
    case = crossings.Case(0, "J4 design", plain, "integrator", values, 3, 1)
    for judge in ("integrator", "sweep", "predicted", "command", "trace"):
        assert crossing_judges.verdict(case._replace(judge=judge)) == "works: ", judge
    blocked = case._replace(values={**values, "model": "epm_calc", "preload": 0.4})
    assert crossing_judges.verdict(blocked).startswith("refused: z_ss is")
    monkeypatch.setattr(crossing_judges, "CYCLE", 0.0)
    assert crossing_judges.verdict(case).startswith("WRONG: the position is")


def test_targets_are_reached_or_given_up(capsys: pytest.CaptureFixture[str]) -> None:
    """Of them a load carries two away for ever, and one is reached where no scan corrects it."""
    for seed, number in (("1", "16"), ("1", "27"), ("777001", "61082")):
        one = ["--all", "--count", "1", "--seed", seed, "--first", number]
        assert targets.main(one) == 0, capsys.readouterr().out


@pytest.mark.long
def test_intervals_of_experiments_by_lot_hold_the_truth() -> None:
    """Of eight intervals at 95 %, six or more do, but for one time in 170."""
    found = [intervals(seed) for seed in (202, 206)]
    values = [one for fit in found for one in fit["values"].values()]
    assert sum(one["inside"] for one in values) >= 6
    assert all(one["wider"] < 2.0 for one in values)
    assert "sigma_0: 2 of 2 (" in summary(found)
    told = misfit(3)
    assert told["kind"] == "preload" and not told["silent"]


def test_soak_commands_all_there_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rclpy")
    from validation.soak.__main__ import main as soak
    from validation.soak.run import RandomCommands

    drawn = RandomCommands(3)
    for name, arguments in (drawn.next() for _ in range(300)):
        # the names of the joints are the client's to add
        assert len(arguments) == len(COMMANDS[name].example) - (name == "trajectory"), name
    for hours in ("0", "nan"):
        assert soak(["--hours", hours, "--out", str(tmp_path / "soak")]) == 2
    assert "--hours is" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
@pytest.mark.usefixtures("ros_domain")
def test_a_soak_of_twenty_seconds_finds_nothing(tmp_path: Path) -> None:
    pytest.importorskip("rclpy")
    command = [sys.executable, "-m", "validation.soak", "--hours", str(20 / 3600), "--seed", "5"]
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "soak"), "--json"], capture_output=True, text=True
    )
    assert (done.returncode, complaints(done.stderr)) == (0, "")
    found = json.loads(done.stdout)
    assert (found["findings"], found["lost"], found["gaps"]) == ([], 0, 0)
    assert found["bit_for_bit"] is True
    assert sum(found["commands"].values()) > 20
