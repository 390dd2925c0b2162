# SPDX-License-Identifier: Apache-2.0
"""How often runs and steps are found in traces by lot, from the independent integrator.

    python -m validation.campaigns.searches [--easy] [--known] [--search] COUNT [FIRST_SEED]

prints the traces in which runs or numbers of steps are not found as they were made, and steps that
are further off than three standard errors; at the end the rates, and the processor time of a trace.
--easy: one run of 10 to 30 cycles, no disturbance but noise of 1 to 3 nm. --known: the period of
the first drive is given. --search: only runs and numbers of steps, not their sizes.
"""

from __future__ import annotations

import argparse
import time
import warnings

import numpy as np
from bench_traces import Bench, random_bench

from stickslip_ros.traces.analysis import find_runs
from stickslip_ros.traces.even_samples import resample_evenly
from stickslip_ros.traces.run_search import search_runs

#: Samples in which runs are looked for.
MOST = 2**21


class Study:
    """Counts of what was right."""

    def __init__(self, known: bool, search: bool) -> None:
        self.known, self.search = known, search
        self.traces = self.right = self.within = 0
        self.errors: list[float] = []  #: standard errors of the steps, m
        self.exact: list[
            float
        ] = []  #: the same with noise of 1 nm at most and 10 cycles or more, m
        self.seconds = 0.0

    def add(self, seed: int, bench: Bench) -> None:
        """Look for the runs of a trace."""
        period = 1.0 / bench.drives[0].frequency if self.known else None
        begun = time.process_time()
        if self.search:
            courses = search_runs(resample_evenly(bench.t, bench.x, MOST), period)
            found = [(one.count, one.direction) for one in courses]
        else:
            runs = find_runs(bench.t, bench.x, period)
            found = [(one.steps, one.direction) for one in runs]
        self.seconds += time.process_time() - begun
        self.traces += 1
        expected = [(one.steps, one.direction) for one in bench.runs]
        if found != expected:
            print(f"{seed}: {expected} found as {found}", flush=True)
            return
        self.right += 1
        if self.search:
            return
        for run, true in zip(runs, bench.runs, strict=True):
            off = run.step_size - true.step_size
            self.errors.append(run.step_size_error)
            if bench.sensor.noise < 1.1e-9 and true.steps >= 10:
                self.exact.append(run.step_size_error)
            if abs(off) < 3.0 * run.step_size_error:
                self.within += 1
            else:
                print(
                    f"{seed}: step of {1e9 * true.step_size:.3f} nm is {1e9 * off:.3f} nm off, "
                    f"standard error {1e9 * run.step_size_error:.3f} nm",
                    flush=True,
                )

    def __str__(self) -> str:
        lines = [
            f"runs and steps right in {self.right} of {self.traces}; "
            f"{self.seconds / max(self.traces, 1):.2f} s of processor time a trace"
        ]
        if self.errors:
            error = 1e9 * float(np.median(self.errors))
            lines.append(
                f"steps within three standard errors: {self.within} of {len(self.errors)}; "
                f"standard error {error:.3f} nm (median)"
            )
        if self.exact:
            lines.append(
                f"at 1 nm of noise and 10 cycles or more: {1e9 * max(self.exact):.3f} nm at most, "
                f"{len(self.exact)} runs"
            )
        return "\n".join(lines)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int)
    parser.add_argument("first", type=int, nargs="?", default=9000)
    for option in ("--easy", "--known", "--search"):
        parser.add_argument(option, action="store_true")
    args = parser.parse_args()
    study = Study(args.known, args.search)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for seed in range(args.first, args.first + args.count):
            study.add(seed, random_bench(seed, hard=not args.easy))
    print(study)


if __name__ == "__main__":
    main()
