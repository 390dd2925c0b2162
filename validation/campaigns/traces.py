# SPDX-License-Identifier: Apache-2.0
"""What is said of traces of many kinds, and how much of it is wrong in silence.

    python -m validation.campaigns.traces [--told] [--kinds WORD] COUNT [FIRST_SEED]

makes COUNT traces of each kind and prints those that are not right, and a table by kind. *right*:
runs, steps, directions, frequency and step size are those that were made, the step within three
standard errors or 1 %. *backstep*: the same, but for the backstep. *doubtful*: the steps are said
not to be determined. *none*: no steps are seen, which ends in an error. *WRONG*: neither right nor
said. --told: the frequency of the first drive is given. At the end, how often two standard errors
of those that are determined hold the truth.
"""

from __future__ import annotations

import math
import time
import warnings
from collections import Counter

from stickslip_ros.measurement.steps.analysis import find_steps
from stickslip_ros.measurement.steps.drive import Drive
from stickslip_ros.measurement.steps.record import TraceError
from stickslip_ros.measurement.steps.run import Run
from validation.campaigns.arguments import arguments
from validation.campaigns.lab_traces import AT_RANDOM, KINDS, LabTrace, lab_trace

RIGHT, BACKSTEP, DOUBTFUL, NONE, WRONG = "right", "backstep", "doubtful", "none", "WRONG"
WORDS = (RIGHT, BACKSTEP, DOUBTFUL, NONE, WRONG)
#: Part by which a number may be off whatever its error, and standard errors that hold it.
PART, ERRORS = 0.01, 3.0


class Study:
    """Counts of what was right."""

    def __init__(self, told: bool) -> None:
        self.told = told
        self.verdicts: dict[str, Counter[str]] = {}
        self.knowable: Counter[str] = Counter()
        self.held: dict[str, Counter[bool]] = {}
        self.seconds = 0.0

    def add(self, trace: LabTrace) -> None:
        """Look at a trace."""
        begun = time.process_time()
        try:
            drive = Drive.given(trace.frequency if self.told else None)
            found = find_steps(trace.t, trace.x, drive)
            runs = found.runs
            if self.told and all(abs(one.frequency / trace.frequency - 1.0) > 0.02 for one in runs):
                runs = []
            why = ""
        except TraceError as error:
            runs, why = [], str(error)
        self.seconds += time.process_time() - begun
        word, text = self.judged(trace, runs)
        self.verdicts.setdefault(trace.kind, Counter())[word] += 1
        self.knowable[word] += trace.knowable
        if word != RIGHT and not (word == NONE and not trace.runs):
            made = [(one.steps, one.direction) for one in trace.runs]
            print(
                f"{trace.kind} {trace.seed}: {word}: {made} at {trace.frequency:.5g} Hz {text}{why}"
            )

    def judged(self, trace: LabTrace, runs: list[Run]) -> tuple[str, str]:
        """Return the verdict of a trace, and what it is from."""
        if not runs:
            return (NONE if trace.runs else RIGHT), ""
        text = "; ".join(
            f"{one.steps * one.direction} of {1e9 * one.step_size:.2f} "
            f"+- {1e9 * one.step_size_error:.2f} nm at {one.frequency:.5g} Hz, "
            f"{', '.join(one.doubts)}"
            for one in runs
        )
        if not all(one.determined for one in runs):
            return DOUBTFUL, text
        made = [(one.steps, one.direction) for one in trace.runs]
        if [(one.steps, one.direction) for one in runs] != made:
            return WRONG, text
        word = RIGHT
        for run, true in zip(runs, trace.runs, strict=True):
            self.hold("step", run.step_size, run.step_size_error, true.step_size)
            self.hold("backstep", run.backstep, run.backstep_error, true.backstep)
            ringing, decay = trace.axis.ringing
            if run.ringing is not None and run.ringing.told:
                self.hold("ringing", run.ringing.frequency, run.ringing.frequency_error, ringing)
                self.hold("decay", run.ringing.decay, run.ringing.decay_error, decay)
            if abs(run.frequency / true.frequency - 1.0) > PART and trace.kind != "sweep":
                return WRONG, text
            if _off(run.step_size, run.step_size_error, true.step_size):
                return WRONG, f"step {1e9 * true.step_size:.3f} nm: {text}"
            if _off(run.backstep, run.backstep_error, true.backstep):
                word = BACKSTEP
                text = (
                    f"{1e9 * true.backstep:.2f} nm: {1e9 * run.backstep:.2f} "
                    f"+- {1e9 * run.backstep_error:.2f} nm"
                )
        return word, text

    def hold(self, what: str, value: float, error: float, true: float) -> None:
        """Count whether two standard errors hold the truth."""
        if math.isfinite(value) and math.isfinite(error):
            self.held.setdefault(what, Counter())[abs(value - true) <= 2.0 * error] += 1

    def __str__(self) -> str:
        lines = [f"{'kind':26}" + "".join(f"{word:>10}" for word in WORDS)]
        total: Counter[str] = Counter()
        for kind, counts in self.verdicts.items():
            lines.append(f"{kind:26}" + "".join(f"{counts[word]:10}" for word in WORDS))
            total += counts
        for name, counts in (("that can be known", self.knowable), ("all", total)):
            lines.append(f"{name:26}" + "".join(f"{counts[word]:10}" for word in WORDS))
        lines += [
            f"{what}: two standard errors hold {counts[True]} of {counts.total()}"
            for what, counts in self.held.items()
        ]
        lines.append(f"{self.seconds / max(total.total(), 1):.2f} s of processor time a trace")
        return "\n".join(lines)


def _off(value: float, error: float, true: float) -> bool:
    return math.isfinite(value) and abs(value - true) > max(ERRORS * error, PART * abs(true))


def main() -> None:
    """Run the study."""
    args = arguments(__doc__, None, {"count": int, "first": 1}, told=False, kinds="")
    study = Study(args.told)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for seed in range(args.first, args.first + args.count):
            for kind in (*KINDS, AT_RANDOM):
                if args.kinds in kind:
                    study.add(lab_trace(kind, seed))
    print(study)


if __name__ == "__main__":
    main()
