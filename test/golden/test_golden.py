# SPDX-License-Identifier: Apache-2.0
"""What comes out stays what it was: recordings and results against the golden files.

`python test/golden/renew.py` writes them anew. All but studies of measurements repeats to the last
bit wherever the arithmetic is that of the machine that wrote the files, whatever the processor can
do beside; elsewhere within a bound that lies far below what is claimed.
"""

import json
import math
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from renew import AXES, BAGS, RESULTS, STUDIED, results, studied
from variants import HAS_UNFUSED, LEAST, SAME_LIBRARY, UNFUSED, Variant

from stickslip_ros.cli.main import main
from stickslip_ros.physics.model.arithmetic import arithmetic
from stickslip_ros.recordings import BagReader, open_bag, resimulate, statuses

GOLDEN: dict[str, Any] = json.loads(RESULTS.read_text(encoding="utf-8"))
#: Largest difference of a position (m) where rounding differs
ROUNDING = 1e-13
#: Largest difference of a position (m) of a recording that the model computes otherwise today
CORRECTED = 2e-9
#: Largest relative difference of what is found in measurements: threads of linear algebra add up in
#: another order
FOUND = 1e-4
#: The same of the ends of intervals: descents along a profile end within a five-hundredth of its
#: rise (`PROFILE.settled`), which moves a wide interval's end by half of that
ENDS = 1e-3


@cache
def found_here() -> dict[str, Any]:
    """Return the results of this machine."""
    found: dict[str, Any] = json.loads(json.dumps(results()))
    return found


@pytest.mark.parametrize("name", AXES)
def test_axes_recorded_by_version_1_resimulate(name: str, tmp_path: Path) -> None:
    with open_bag(BAGS / name) as bag:
        (again,) = resimulate(bag, {}, tmp_path / "again")
        with open_bag(tmp_path / "again") as copy:
            # What was noted after the last state does not come out again.
            assert _levels(copy).items() <= _levels(bag).items()
    assert again.states > 100 and again.commands > 10 and again.left_out == []
    positions = [d for key, d in again.differences.items() if key.endswith("position")]
    assert positions and max(d.largest for d in positions) < CORRECTED
    if [change.version for change in again.model_changes] in ([], [16]):  # rounding alone
        assert again.same_up_to_rounding, again.differences


def _levels(bag: BagReader) -> dict[str, int]:
    """Return the level of each kind of event."""
    return {one.message: one.level for one in statuses(bag, "/stickslip_axis/events")}


def test_results_are_what_they_were() -> None:
    assert_same_bits(found_here(), {key: GOLDEN[key] for key in found_here()})


def assert_same_bits(found: dict[str, Any], golden: dict[str, Any]) -> None:
    """Hold results against others: bits, or positions where the arithmetic differs."""
    if found["arithmetic"] == golden["arithmetic"]:
        assert found == golden
        return
    for kind in ("plain", "effects"):
        for name, run in golden[kind].items():
            near = pytest.approx(positions_of(run), abs=ROUNDING)
            assert positions_of(found[kind][name]) == near, name


@pytest.mark.long
@pytest.mark.parametrize(
    "variant",
    [
        pytest.param(one, id=one.name, marks=() if one is LEAST else pytest.mark.long)
        for one in SAME_LIBRARY
    ],
)
def test_another_processor_gives_the_same_bits(variant: Variant, tmp_path: Path) -> None:
    there = variant.results(tmp_path)
    assert there["arithmetic"] == found_here()["arithmetic"]
    assert_same_bits(there, found_here())


@pytest.mark.long
@pytest.mark.skipif(not HAS_UNFUSED, reason="this library has one version of its functions")
def test_a_run_of_another_library_is_the_same_up_to_rounding_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Computed with the functions for processors without fused operations."""
    assert_same_bits(UNFUSED.results(tmp_path), found_here())
    UNFUSED.record_again(BAGS / "everything", tmp_path / "there")
    assert main(["bag", "resimulate", str(tmp_path / "there"), "--json"]) == 0
    (run,) = json.loads(capsys.readouterr().out)["runs"]
    assert run["same_up_to_rounding"]
    if arithmetic() == run["arithmetic"]:  # a processor without fused operations
        assert run["bit_for_bit"]
        return
    assert not run["bit_for_bit"] and run["this_arithmetic"] == arithmetic()


def positions_of(run: dict[str, Any]) -> list[float]:
    """Return the positions (m) of a run."""
    return [float.fromhex(text) for text in run["position"]]


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(one, marks=pytest.mark.long if one.startswith("identify") else ())
        for one in STUDIED
    ],
)
def test_studies_find_what_they_found(name: str) -> None:
    assert_close(json.loads(json.dumps(studied(name))), GOLDEN["studies"][name], name)


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
