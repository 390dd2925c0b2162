# SPDX-License-Identifier: Apache-2.0
"""The version of the model, and the changes of results with each version since 1.0.0.

Recordings hold the version of the model that made them. A correction that changes results raises
the version and gets a row in :data:`CHANGES`, or joins that of its kind; resimulation then
reports how far results may differ, for the affected drives only. The plain drive, without effects,
keeps its results to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.parameters.groups import SolverParameters


@dataclass(frozen=True)
class ModelChange:
    """A correction that changes results.

    Attributes
    ----------
    version : int
        First version of the model that has it.
    what : str
        The change, as text to follow "since model 2, ...".
    touches : callable
        Parameters -> True if the results of their drive change.
    largest : str
        The largest measured difference, with its unit.
    """

    version: int
    what: str
    touches: Callable[[Parameters], bool]
    largest: str


def _is_summed(p: Parameters) -> bool:
    """Return whether weighted sums or exponentials stand between voltage, contact and reading."""
    added = any(p.value(name) for name in ("creep", "spring", "sensor_bandwidth"))
    spread = p.friction.contacts > 1 and bool(p.value("contact_spread"))
    return p.actuator.actuator == "hysteresis" or added or spread


def _takes_rate_of_loop(p: Parameters) -> bool:
    """Return whether a contact that changes with the rate of the slip is driven by a loop."""
    return p.actuator.actuator == "hysteresis" and bool(p.friction.rate_growth)


def _is_finer(p: Parameters) -> bool:
    """Return whether the deflection behind effects follows the command more closely than usual."""
    stages = ("amplifier_bandwidth", "amplifier_slew", "actuator_resonance")
    follows = any(p.value(name) for name in ("actuator_memory", "creep", *stages))
    return follows and p.solver.tolerance < SolverParameters.tolerance


#: The version that 1.0.0 began with; what changed before it is not listed.
FIRST_VERSION = 15
#: The version from which on an axis breaks off cycles.
COMMANDS_CHANGED = 18
#: In order of their versions. One row stands for all changes of a kind: its version is that of the
#: last of them, and its largest difference that of all together.
CHANGES: tuple[ModelChange, ...] = (
    ModelChange(
        16,
        "sums over plays, creep and contacts and the low-pass of the sensor are rounded alike on "
        "every processor",
        _is_summed,
        "the last digits",
    ),
    ModelChange(
        17,
        "rate_growth takes the rate of the command behind a loop of hysteresis too",
        _takes_rate_of_loop,
        "0.17 nm a step",
    ),
    ModelChange(
        17,
        "a smaller tolerance holds behind amplifier, memory, creep and resonance too",
        _is_finer,
        "0.001 nm a step",
    ),
    # Runs of before repeat by the rules of before, see `Device.finishes_cycles`.
    ModelChange(
        COMMANDS_CHANGED,
        "stops break off slow cycles, velocities end by time, and a reset forgets",
        lambda p: False,
        "none",
    ),
)
MODEL_VERSION = max((change.version for change in CHANGES), default=FIRST_VERSION)


def changes_since(version: int, p: Parameters) -> list[ModelChange]:
    """Return the changes of the model since an earlier version that affect a drive.

    Parameters
    ----------
    version : int
        Of the model that computed the drive before.
    p : Parameters
        Of the drive.

    Returns
    -------
    list of ModelChange
        In order of their versions; empty if the results are the same to the last bit, from
        `FIRST_VERSION` on.
    """
    return [change for change in CHANGES if change.version > version and change.touches(p)]
