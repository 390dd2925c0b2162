# SPDX-License-Identifier: Apache-2.0
"""A run sampled over time, and the CSV file that holds it."""

from __future__ import annotations

import csv
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.files import whole_file
from stickslip_ros.base.reporting import format_si


@dataclass(frozen=True)
class Trace:
    """Samples of a run, each of shape (samples,); w and F at a kink are those just after it."""

    t: NDArray[np.float64]  #: time, s
    x: NDArray[np.float64]  #: runner position, m
    v: NDArray[np.float64]  #: runner velocity, m/s
    u: NDArray[np.float64]  #: actuator deflection, m
    z: NDArray[np.float64]  #: asperity deflection, m
    w: NDArray[np.float64]  #: differential velocity v - u', m/s
    force: NDArray[np.float64]  #: friction force F, N
    #: work of F on the contact since the start, the integral of F w, J: heat, and what each contact
    #: holds, sigma_0 z^2 / 2; empty where it is not known
    work: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    #: deflection of each of several contacts, m, shape (contacts, samples); of one it is ``z``
    each: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 0)))

    def __repr__(self) -> str:
        """Say the trace in one line."""
        last = format_si(float(self.t[-1]), "s") if len(self.t) else "0 s"
        return f"Trace({len(self.t)} samples up to {last})"


#: Names of the samples with units, in their order; those of several contacts follow.
HEADER = ("time (s)", "runner (m)", "runner velocity (m/s)", "actuator (m)",
           "deflection (m)", "differential velocity (m/s)", "friction force (N)",
           "friction work (J)")  # fmt: skip
_OF_CONTACT = "deflection {} (m)"


def trace_of_rows(rows: NDArray[np.float64]) -> Trace:
    """Return the trace of rows in the order of `HEADER`, then those of several contacts."""
    count = len(HEADER)
    trace = Trace(*rows[:count])
    return replace(trace, each=rows[count:]) if len(rows) > count else trace


def write_csv(trace: Trace, file: TextIO) -> None:
    """Write one line for each sample, below a line of names with units."""
    writer, columns = csv.writer(file), [getattr(trace, f.name) for f in fields(trace)[:-1]]
    writer.writerow([*HEADER, *(_OF_CONTACT.format(k + 1) for k in range(len(trace.each)))])
    writer.writerows(np.column_stack([*columns, *trace.each]).tolist())


def save_csv(trace: Trace, path: Path) -> None:
    """Write the trace to path, all of it or nothing; WriteError if that cannot be."""
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        write_csv(trace, file)
