# SPDX-License-Identifier: Apache-2.0
"""A small fixed part of the campaign for accuracy."""

from __future__ import annotations

import itertools
import json

import pytest

from stickslip_ros.benchmark.accuracy import campaign
from stickslip_ros.benchmark.random_sets import random_sets
from stickslip_ros.cli.main import main
from stickslip_ros.model import LAWS


def test_sets_at_random_keep_the_promise() -> None:
    found = campaign(40, seed=7)
    assert found.findings == []
    assert found.over_budget == []
    assert len(found.errors) == 40
    assert found.judged


def test_processes_find_what_one_finds() -> None:
    done: list[int] = []
    alone = campaign(45, seed=9, judged=False)
    assert campaign(45, seed=9, jobs=2, judged=False, done=done.append) == alone
    assert done == [20, 20, 5]
    assert len(alone.errors) == 45


def test_corners_of_all_ranges_end_well() -> None:
    found = campaign(30, seed=3, corners=True)
    assert found.findings == []


def test_every_law_and_load_is_drawn() -> None:
    sets = list(itertools.islice(random_sets(1), 200))
    assert {p.friction.model for p in sets} == set(LAWS)
    assert {p.drive.waveform for p in sets} == {"sawtooth", "hold", "shaped", "triangle"}
    assert any(p.runner.force for p in sets)
    assert any(p.runner.inclination for p in sets)
    assert any(p.runner.spring for p in sets)
    assert min(p.friction.v_stribeck for p in sets) < 1e-5
    assert [p.flat() for p in itertools.islice(random_sets(1), 5)] == [p.flat() for p in sets[:5]]
    assert next(random_sets(1, first=150)).flat() == sets[150].flat()


def test_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--accuracy", "3", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["sets"] == 3
    assert told["error"]["worst"] < told["bar"]
