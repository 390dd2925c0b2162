# SPDX-License-Identifier: Apache-2.0
"""The methods that are compared, by the names used on the command line.

A further one is a file beside these and a line here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from stickslip_ros.benchmark.cyrk import CyRK
from stickslip_ros.benchmark.method import Method
from stickslip_ros.benchmark.ours import Ours
from stickslip_ros.benchmark.scijit_lsoda import SciJIT
from stickslip_ros.benchmark.scipy_ivp import Odeint, SolveIvp
from stickslip_ros.benchmark.sundae import Cvode

OURS, SCIPY_LSODA = "ours", "scipy-lsoda"


@dataclass(frozen=True)
class Entry:
    """A method that may or may not be installed."""

    title: str  #: for people
    load: Callable[[], Method]  #: raises MissingPeer


METHODS: Mapping[str, Entry] = {
    OURS: Entry("stickslip_ros", Ours),
    "cyrk-dop853": Entry("CyRK DOP853", lambda: CyRK("DOP853")),
    "cyrk-vern7": Entry("CyRK Vern7", lambda: CyRK("VERN7")),
    "cyrk-lsoda": Entry("CyRK LSODA", lambda: CyRK("LSODA")),
    "scijit-lsoda": Entry("SciJIT LSODA", SciJIT),
    SCIPY_LSODA: Entry("SciPy LSODA", lambda: SolveIvp("LSODA")),
    "scipy-odeint": Entry("SciPy odeint", Odeint),
    "scipy-dop853": Entry("SciPy DOP853", lambda: SolveIvp("DOP853")),
    "sundae-cvode": Entry("SUNDAE CVODE", Cvode),
}
PEERS = tuple(name for name in METHODS if name != OURS)
