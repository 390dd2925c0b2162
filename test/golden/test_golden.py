# SPDX-License-Identifier: Apache-2.0
"""What comes out stays what it was: recordings and results against the golden files.

`python test/golden/renew.py` writes them anew. The drive without effects repeats to the last bit
wherever the arithmetic is that of the machine that wrote the files; elsewhere, and with effects,
within a bound that lies far below what is claimed.
"""

import json
import math
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from renew import (
    AXES,
    BAGS,
    RESULTS,
    SIMULATED,
    STUDIED,
    WITH_EFFECTS,
    arithmetic,
    simulated,
    studied,
)

from stickslip_ros.recordings import BagReader, open_bag, resimulate, statuses

GOLDEN: dict[str, Any] = json.loads(RESULTS.read_text(encoding="utf-8"))
#: Largest difference of a position (m), where rounding differs and with effects
ROUNDING = 1e-13
#: Largest difference of a position (m) of a recording that the model computes otherwise today
MENDED = 2e-9
#: Largest relative difference of what is found in measurements: threads of linear algebra add up in
#: another order
FOUND = 1e-4
#: The same of the ends of intervals: descents along a profile end within a five-hundredth of its
#: rise (`PROFILE.settled`), which moves a wide interval's end by half of that
ENDS = 1e-3


def same_arithmetic() -> bool:
    """Return whether this machine rounds as the one that wrote the files."""
    return arithmetic() == GOLDEN["arithmetic"]


@pytest.mark.slow
@pytest.mark.parametrize("name", AXES)
def test_recorded_axes_resimulate(name: str, tmp_path: Path) -> None:
    with open_bag(BAGS / name) as bag:
        (again,) = resimulate(bag, {}, tmp_path / "again")
        with open_bag(tmp_path / "again") as copy:
            # What was noted after the last state does not come out again.
            assert _levels(copy).items() <= _levels(bag).items()
    assert again.states > 100 and again.commands > 10 and again.left_out == []
    positions = [d for key, d in again.differences.items() if key.endswith("position")]
    if again.model_changes:
        assert max(d.largest for d in positions) < MENDED
    elif same_arithmetic():
        assert again.bit_for_bit, again.differences
    else:
        assert positions and max(d.largest for d in positions) < ROUNDING


def _levels(bag: BagReader) -> dict[str, int]:
    """Return the level of each kind of event."""
    return {one.message: one.level for one in statuses(bag, "/stickslip_axis/events")}


@pytest.mark.slow
def test_runs_of_the_plain_drive_are_what_they_were() -> None:
    for name, options in SIMULATED.items():
        found, golden = simulated(options), GOLDEN["plain"][name]
        if same_arithmetic():
            assert found == golden, name
        else:
            assert positions_of(found) == pytest.approx(positions_of(golden), abs=ROUNDING), name


@pytest.mark.slow
def test_runs_with_effects_are_what_they_were() -> None:
    for name, options in WITH_EFFECTS.items():
        found, golden = simulated(options), GOLDEN["effects"][name]
        assert positions_of(found) == pytest.approx(positions_of(golden), abs=ROUNDING), name


@pytest.mark.long
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="not that processor")
def test_code_for_an_old_processor_gives_the_same_bits(tmp_path: Path) -> None:
    """All of it compiled anew, without what newer processors can do, such as fused operations."""
    test = f"{__file__}::{test_runs_of_the_plain_drive_are_what_they_were.__name__}"
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", test],
        env={**os.environ, "NUMBA_CPU_NAME": "generic", "NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert "1 passed" in run.stdout, run.stdout
    assert list(tmp_path.rglob("*.nbc"))


def positions_of(run: dict[str, Any]) -> list[float]:
    """Return the positions (m) of a run."""
    return [float.fromhex(text) for text in run["position"]]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(one, marks=pytest.mark.long if one.startswith("identify") else ())
        for one in STUDIED
    ],
)
def test_studies_find_what_they_found(name: str) -> None:
    assert_close(json.loads(json.dumps(studied(name))), GOLDEN["studies"][name], name)


def test_a_frequency_that_is_told_changes_no_step() -> None:
    """It was 92.5 nm with it, where the record begins and ends within a cycle."""
    seen, told = (GOLDEN["studies"][name] for name in ("analyse steps", "analyse steps, told"))
    for name in ("step_size", "backstep"):
        assert told[name] == pytest.approx(seen[name], abs=1e-11)
    assert told["step_size"] == pytest.approx(133.8e-9, abs=0.3e-9)


def assert_close(found: Any, golden: Any, place: str) -> None:
    """Hold a result against the golden one, number by number."""
    if isinstance(golden, dict):
        assert golden.keys() <= found.keys(), place
        for key, value in golden.items():
            assert_close(found[key], value, f"{place}: {key}")
    elif isinstance(golden, list):
        assert len(found) == len(golden), place
        for k, value in enumerate(golden):
            assert_close(found[k], value, f"{place}: {k}")
    elif isinstance(golden, float):
        accuracy = ENDS if place.endswith((": low", ": high")) else FOUND
        assert math.isclose(found, golden, rel_tol=accuracy), (place, found, golden)
    else:
        assert found == golden, place
