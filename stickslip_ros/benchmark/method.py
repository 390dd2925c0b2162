# SPDX-License-Identifier: Apache-2.0
"""What all methods of the benchmark have in common."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.benchmark.cases import Problem
from stickslip_ros.benchmark.equations import Scaled

#: Runs the cycles it was made for, once, and returns the displacement, m.
Run = Callable[[], float]
#: Takes (w, z, r) and a number of cycles, returns (w, z, r).
Drive = Callable[[NDArray[np.float64], int], NDArray[np.float64]]

#: Settings of a general solver, loosest first: its absolute tolerance in scaled units.
LADDER = tuple(float(f"{10.0 ** (-half / 2):.1e}") for half in range(3, 15))
#: Its relative tolerance is this part of it. What has to be right are absolute lengths; w reaches
#: sixty units in the slip, where a relative tolerance as large as the absolute one would spoil z.
RELATIVE = 0.1
#: Steps that a solver may take over one segment: no limit in practice.
STEPS = 10_000_000


class MissingPeer(Exception):
    """A peer that is not installed or cannot run here; the message says why."""


class Method(Protocol):
    """A way to advance the axis over cycles."""

    @property
    def settings(self) -> Sequence[float]:
        """The tolerances to try, loosest first."""

    def prepare(self, problem: Problem, setting: float, cycle: int, count: int) -> Run:
        """Return a run of count cycles from the start of a measured cycle, ready to be timed."""


class General:
    """A general solver, restarted at every kink: all but ``drive`` of a `Method`."""

    settings: Sequence[float] = LADDER

    def drive(self, scaled: Scaled, setting: float) -> Drive:
        """Return what runs cycles of this plant."""
        raise NotImplementedError

    def prepare(self, problem: Problem, setting: float, cycle: int, count: int) -> Run:
        """Return a run of count cycles from the start of a measured cycle, ready to be timed."""
        scaled = problem.scaled
        start = scaled.start(problem.starts[cycle])
        drive = self.drive(scaled, setting)

        def run() -> float:
            return scaled.displacement(start, drive(start, count))

        return run


def peer(module: str, package: str) -> Any:
    """Import a peer; raise MissingPeer with the way to install it."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise MissingPeer(f"not installed: pip install {package} ({error})") from None
    except (ImportError, OSError) as error:
        reason = str(error).strip().splitlines() or [type(error).__name__]
        raise MissingPeer(f"installed, but does not load: {reason[0]}") from None
