# SPDX-License-Identifier: Apache-2.0
"""Processor time of the blocks of 10 ms in which a node advances its axes; beside another tree.

A block advances each axis and makes the report of its joints, as the loop of the node does before
it publishes. Trees take turns in processes of their own, so that a busy machine slows both.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

from stickslip_ros.axis import Axis
from stickslip_ros.axis.joints import JointReport
from stickslip_ros.base.errors import StickslipError

#: What is measured: axes, and whether they jog at 1 kHz
KINDS = {"1 axis at rest": (1, False), "1 axis jogging": (1, True), "25 axes jogging": (25, True)}
_NS = 10_000_000  # of a block
_WARM = 200  # blocks before
_BLOCKS, _REPEATS = 1500, 5  # of an axis in one measurement; the least of which counts
#: How often `compare` measures, and reports progress
ROUNDS = 5


def measured(axes: int, jogs: bool) -> float:
    """Return the processor time (s) of a block of that many axes, the least of some repeats."""
    group = [(Axis({"frequency": 1000.0}), JointReport()) for _ in range(axes)]
    if jogs:
        for axis, _ in group:
            getattr(axis, "command_jog")(1000.0)  # noqa: B009  by a name that older trees have, too
    blocks, done, best = max(_BLOCKS // axes, 60), 0, float("inf")
    for repeat in range(_REPEATS + 1):
        count = blocks if repeat else _WARM // axes + 1
        began = time.process_time()
        for number in range(done + 1, done + 1 + count):
            t = number * _NS * 1e-9
            for axis, report in group:
                axis.advance(t)
                report.take(axis)
        done += count
        if repeat:
            best = min(best, (time.process_time() - began) / count)
    return best


def compare(beside: Path | None, progress: Callable[[], object]) -> dict[str, dict[str, float]]:
    """Return for each kind the time (s) here, and with another tree its time and the ratio.

    Medians over rounds in which both were measured. Raises StickslipError for a folder without
    the package.
    """
    here = Path(__file__).parents[2]
    trees = {"here": here} | ({"beside": beside.resolve()} if beside else {})
    for tree in trees.values():
        if not (tree / "stickslip_ros" / "axis").is_dir():
            raise StickslipError(
                f"{tree} has no stickslip_ros/axis: give a checkout of the project, as "
                "`git worktree add FOLDER COMMIT` makes one"
            )
    rounds: list[dict[str, dict[str, float]]] = []
    for _ in range(ROUNDS):
        rounds.append({name: _child(tree) for name, tree in trees.items()})
        progress()
    found: dict[str, dict[str, float]] = {}
    for kind in KINDS:
        found[kind] = {name: median(r[name][kind] for r in rounds) for name in trees}
        if beside:
            ratios = [r["here"][kind] / r["beside"][kind] for r in rounds]
            found[kind]["ratio"] = median(ratios)
    return found


def table(found: dict[str, dict[str, float]]) -> str:
    """Return the result of `compare` as a table."""
    lines = [f"a block of {_NS / 1e6:g} ms, us of processor"]
    for kind, values in found.items():
        line = f"  {kind:16} {1e6 * values['here']:7.1f}"
        if "ratio" in values:
            line += f", beside it {1e6 * values['beside']:7.1f}, ratio {values['ratio']:.2f}"
        lines.append(line)
    return "\n".join(lines)


def _child(tree: Path) -> dict[str, float]:
    """Measure with the package of a tree, in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    done = subprocess.run(
        [sys.executable, __file__], env=environment, cwd=tree, capture_output=True, text=True
    )
    if done.returncode:
        raise StickslipError(f"{tree} cannot be measured: {done.stderr.strip()[-300:]}")
    values: dict[str, float] = json.loads(done.stdout)
    return values


if __name__ == "__main__":
    print(json.dumps({kind: measured(*how) for kind, how in KINDS.items()}))
