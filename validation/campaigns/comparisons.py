# SPDX-License-Identifier: Apache-2.0
"""How often `compare` gives the right verdict: random traces, from the independent integrator.

    python -m validation.campaigns.comparisons COUNT [FIRST_SEED]

Each trace has a random contact and drive, a run forward and one backward with rests, noise of 0.5
to 3 nm, in half of the traces hum, in half drift, and a clock of its own. It is compared with the
true parameters, where nothing may differ, and with a preload 20 % too large or too small, where
something has to differ in each run; whether the step size does is counted, too.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from bench_traces import Drive, Sensor, bench_trace, random_axis

from stickslip_ros import compare
from stickslip_ros.simulation.motion import Motion
from validation.campaigns.arguments import arguments


def verdict(seed: int) -> tuple[list[str], list[str], bool]:
    """Return what differs from the true run, the verdicts on a wrong one, and whether steps do."""
    random = np.random.default_rng(seed)
    axis = random_axis(random)
    frequency = float(np.exp(random.uniform(np.log(60.0), np.log(2000.0))))
    forward = Drive(
        int(random.integers(10, 25)), frequency, float(random.uniform(150.0, 300.0)), 1,
        max(2.0 / frequency, 4e-3),
    )  # fmt: skip
    sensor = Sensor(
        rate=max(2e5, 50.0 * frequency),
        noise=float(random.uniform(0.5e-9, 3e-9)),
        hum=float(random.choice([0.0, random.uniform(1e-9, 8e-9)])),
        drift=float(random.choice([0.0, random.uniform(-2e-7, 2e-7)])),
        offset=float(random.uniform(-0.5, 0.5)),
    )
    bench = bench_trace(axis, (forward, replace(forward, direction=-1)), sensor, 8e-3, seed)
    measured = Motion("bench", bench.t, bench.x)
    known = {**axis.parameters, "frequency": frequency, "amplitude": forward.amplitude}
    true = compare(known, measured)
    part = float(random.choice([0.8, 1.2]))
    wrong = compare({**known, "preload": part * axis.preload}, measured)
    told = [pair.verdict for pair in wrong.pairs]
    return true.differing, told, "step size" in wrong.differing


def main(count: int, first: int) -> None:
    """Compare traces and print what is wrong of their verdicts."""
    right = np.zeros(3, dtype=int)
    for seed in range(first, first + count):
        begun = time.process_time()
        differing, told, steps = verdict(seed)
        found = len(told) == 2 and all("differs" in one for one in told)
        right += [not differing, found, steps]
        words = f"true: {', '.join(differing) or 'agrees'}; wrong preload: {'; '.join(told)}"
        print(f"{seed}: {words}, {time.process_time() - begun:.1f} s", flush=True)
    print(f"of {count}: right with true parameters {right[0]}, with a wrong preload {right[1]}, of "
          f"which the step size differs in {right[2]}")  # fmt: skip


if __name__ == "__main__":
    given = arguments(__doc__, None, {"count": int, "first": 1000})
    main(given.count, given.first)
