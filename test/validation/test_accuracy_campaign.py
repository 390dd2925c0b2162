# SPDX-License-Identifier: Apache-2.0
"""A small fixed part of the campaign for accuracy."""

import itertools
import json
from typing import Any

import pytest

from stickslip_ros.model import LAWS
from stickslip_ros.parameters import Parameters
from stickslip_ros.solver import SolverError
from validation.benchmark import accuracy
from validation.benchmark.__main__ import main
from validation.benchmark.accuracy import BAR, CYCLES, campaign
from validation.benchmark.random_sets import random_sets
from validation.benchmark.unstable import Growth, growth_of


@pytest.mark.slow
@pytest.mark.parametrize("count", [15, pytest.param(40, marks=pytest.mark.long)])
def test_sets_at_random_keep_the_promise(count: int) -> None:
    found = campaign(count, seed=7)
    assert found.findings == []
    assert found.over_budget == []
    assert len(found.errors) == count
    assert found.judged


@pytest.mark.slow
def test_processes_find_what_one_finds() -> None:
    done: list[int] = []
    alone = campaign(25, seed=9, judged=False)
    assert campaign(25, seed=9, jobs=2, judged=False, done=done.append) == alone
    assert done == [20, 5]
    assert len(alone.errors) == 25


def test_corners_of_all_ranges_end_well() -> None:
    found = campaign(12, seed=3, corners=True)
    assert found.findings == []


def _growth(bar: float = BAR, **values: Any) -> Growth:
    return growth_of(Parameters.of(values), CYCLES, bar, 200_000)


def test_what_an_unstable_motion_makes_of_an_error_is_no_error() -> None:
    """A ringing under a narrow Stribeck curve, at the default tolerance 0.02 nm a cycle off."""
    ringing: dict[str, Any] = {
        **{"model": "lugre", "preload": 0.875, "mu_s": 10.0, "mu_k": 0.626, "mass": 2.52e-3},
        **{"v_stribeck": 2.05e-5, "sigma_1": 0.0, "waveform": "triangle", "frequency": 61.3},
        **{"slewrate": 188.5, "amplitude": 272.8},
    }
    growth = _growth(**ringing)
    assert growth.committed < BAR
    assert growth.explained > 3.0 * BAR
    steady = _growth(preload=0.4, mass=4e-3, frequency=100.0)
    assert steady.committed < 1e-2 * BAR
    assert steady.explained < 3.0 * BAR


def test_a_solver_that_is_off_is_not_excused() -> None:
    """However much the motion makes of it: a cycle by itself has to keep the bar."""
    values: dict[str, Any] = {"model": "lugre", "preload": 1.0, "v_stribeck": 1e-3}
    values |= {"mu_s": 0.3, "mu_k": 0.2}
    committed = _growth(**values).committed
    assert 0.0 < committed < 1e-2 * BAR
    assert _growth(0.5 * committed, **values).explained == 0.0
    assert _growth(2.0 * committed, **values).explained > 2.0 * committed


def test_only_the_budget_is_no_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise SolverError("the solver failed after 0 s")

    monkeypatch.setattr(accuracy, "_cycles", fail)
    found = campaign(2, judged=False)
    assert len(found.findings) == 2
    assert found.over_budget == []
    monkeypatch.undo()
    monkeypatch.setattr(accuracy, "_BUDGET", 1)
    monkeypatch.setattr("stickslip_ros.solver.budget.SLICE", 1)
    found = campaign(2, judged=False)
    assert len(found.over_budget) == 2
    assert found.findings == []


def test_every_law_and_load_is_drawn() -> None:
    sets = list(itertools.islice(random_sets(1), 200))
    assert {p.friction.model for p in sets} == {name for name, law in LAWS.items() if not law.rate}
    assert {p.drive.waveform for p in sets} == {"sawtooth", "hold", "shaped", "triangle"}
    assert any(p.runner.force for p in sets)
    assert any(p.runner.inclination for p in sets)
    assert any(p.runner.spring for p in sets)
    assert min(p.friction.v_stribeck for p in sets) < 1e-5
    assert [p.flat() for p in itertools.islice(random_sets(1), 5)] == [p.flat() for p in sets[:5]]
    assert next(random_sets(1, first=150)).flat() == sets[150].flat()


def test_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--accuracy", "3", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["sets"] == 3
    assert told["error"]["worst"] < told["bar"]
