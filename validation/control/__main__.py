# SPDX-License-Identifier: Apache-2.0
"""Scores every baseline on every task and writes table and picture of docs/control.md.

make control               a minute and a half of processor time
make control ARGS=--quick  four seeds, no search, nothing written
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from pathlib import Path

import matplotlib
import numpy as np

from stickslip_ros.gym import SCORES, TASKS, Task
from validation.control import axis_loop, inverse_hysteresis, learned_feedforward, steps_then_scan
from validation.control.policies import Array, run
from validation.control.steps_then_scan import Settings, policy_of

DOCS = Path(__file__).parent.parent.parent / "docs"
#: Nothing here was tuned on these
SEEDS, QUICK = range(2000, 2032), range(4)
#: The loop of an axis runs axis by axis
SLOW_SEEDS = range(2000, 2008)
_SCALES = {"s": (1e3, "ms"), "m": (1e9, "nm")}


def cell(task: Task, scores: Array) -> str:
    """Return median and quartiles of the scores that count, and how many do not."""
    done = np.isfinite(scores)
    scale, unit = _SCALES[SCORES[task.score][0]]
    missing = f"; {len(scores) - done.sum()} of {len(scores)} not done" * (not done.all())
    if not done.any():
        return "not done"
    low, middle, high = np.percentile(scale * scores[done], (25, 50, 75))
    return f"{middle:.3g} ({low:.3g} to {high:.3g}) {unit}{missing}"


def draw(path: Path) -> None:
    """Draw the way of `steps_then_scan` to the target of one long move, as far as it is off."""
    matplotlib.use("agg")
    from matplotlib import pyplot

    task = TASKS["long_move"]
    figure, axes = pyplot.subplots(figsize=(6.4, 3.2), layout="constrained")
    history = np.stack(run(task, lambda drive: policy_of(drive, task, Settings()), range(6))[1])
    for k in range(history.shape[1]):
        axes.semilogy(1e3 * history[:, k, 3], 1e9 * np.abs(history[:, k, 1] - history[:, k, 4]))
    axes.axhline(1e9 * task.tolerance, color="black", linestyle="--", linewidth=0.8)
    axes.set(xlabel="time (ms)", ylabel="distance from the target (nm)", ylim=(0.1, 1e5))
    figure.savefig(path, dpi=120, metadata={"Software": None})


def main() -> None:
    """Score, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="four seeds, no search, no pages")
    quick = parser.parse_args().quick
    seeds = QUICK if quick else SEEDS
    baselines: dict[str, tuple[Callable[[Task, range], Array], range]] = {
        "the axis' own loop": (axis_loop.scores, QUICK if quick else SLOW_SEEDS),
        "steps, then scan": (steps_then_scan.scores, seeds),
        "inverse of the hysteresis": (inverse_hysteresis.scores, seeds),
        "iterative learning": (learned_feedforward.scores, seeds),
    }
    if not quick:
        from validation.control import small_policy  # needs cma

        baselines["steps, then scan, tuned by CMA-ES"] = (small_policy.scores, seeds)
    lines = ["| task | " + " | ".join(baselines) + " |", "|---" * (len(baselines) + 1) + "|"]
    for name, task in TASKS.items():
        cells = [cell(task, scores(task, some)) for scores, some in baselines.values()]
        lines.append(f"| `{name}` | " + " | ".join(cells) + " |")
        print(lines[-1], flush=True)
    if quick:
        return
    page = DOCS / "control.md"
    text = re.sub(
        r"(<!-- results -->\n).*?(\n<!-- results end -->)",
        lambda match: match[1] + "\n".join(lines) + match[2],
        page.read_text(encoding="utf-8"),
        flags=re.DOTALL,
    )
    page.write_text(text, encoding="utf-8")
    draw(DOCS / "control.png")


if __name__ == "__main__":
    main()
