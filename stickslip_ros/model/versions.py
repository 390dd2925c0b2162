# SPDX-License-Identifier: Apache-2.0
"""The version of the model, and the changes of results with each version.

Recordings hold the version of the model that made them. A correction that changes results raises
the version and gets a row in :data:`CHANGES`, or joins that of its kind; resimulation then
reports how far results may differ, for the affected drives only. The plain drive, without effects,
keeps its results to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Set
from dataclasses import dataclass

from stickslip_ros.model.actuator_chain import has_chain
from stickslip_ros.parameters import Parameters


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
    commands : set of str
        It changes runs with one of these commands only; empty: any run.
    """

    version: int
    what: str
    touches: Callable[[Parameters], bool]
    largest: str
    commands: Set[str] = frozenset()


def _has(*names: str) -> Callable[[Parameters], bool]:
    """Return whether parameters have one of some effects, by name."""
    return lambda p: any(p.value(name) for name in names)


def _ages(p: Parameters) -> bool:
    return p.friction.model == "ceim_ageing"


def _is_summed(p: Parameters) -> bool:
    """Return whether weighted sums or exponentials stand between voltage, contact and reading."""
    spread = p.friction.contacts > 1 and bool(p.value("contact_spread"))
    return (
        p.actuator.actuator == "hysteresis"
        or spread
        or _has("creep", "spring", "sensor_bandwidth")(p)
    )


#: The commands of the closed loop, as `axis.commands` has them, which this room does not know
CLOSED_LOOP = frozenset(("position", "trajectory", "joint_command"))
_CHANGES = frozenset(("parameters", "amplitude", "frequency"))

#: In order of their versions. One row stands for all changes of a kind: its version is that of the
#: last of them, and its largest difference that of all together.
CHANGES: tuple[ModelChange, ...] = (
    ModelChange(
        2,
        "an amplifier with a slew limit alone keeps it when its output lags at the end of a cycle",
        lambda p: bool(p.value("amplifier_slew")) and not p.value("amplifier_bandwidth"),
        "64 nm a cycle",
    ),
    ModelChange(
        8, "a slow slide of a contact that ages is as exact as a quick one", _ages, "0.4 nm a cycle"
    ),
    ModelChange(
        8, "a slip too short for the clock ends the dwell, too",
        _has("dwell_growth"), "16 nm a cycle, where a slip takes less than 1e-16 s",
    ),
    ModelChange(
        12,
        "the path behind amplifier, actuator and creep is made of parabolas, as fine as the "
        "contact needs, and adds up no errors",
        lambda p: has_chain(p.actuator) or bool(p.value("creep")),
        "1 nm a cycle, and more after four moves that follow each other at once",
    ),
    ModelChange(
        12,
        "a sensor with a bandwidth takes the runner's velocity between its samples into account",
        _has("sensor_bandwidth"), "0.3 nm of a reading",
    ),
    ModelChange(
        13, "a change in the last cycle of a move counts its steps once",
        lambda p: True, "the count and the mean of these steps", _CHANGES,
    ),
    ModelChange(
        14, "no step is so long that the estimate of its error has a root",
        lambda p: _ages(p) or p.friction.contacts > 1, "0.02 nm a cycle, overdamped",
    ),
    ModelChange(
        15, "a runner with a spring sees the bend of amplifier, creep or actuator, as one without",
        lambda p: bool(p.value("spring")) and has_chain(p.actuator), "0.04 nm a cycle",
    ),
    ModelChange(
        15,
        "the closed loop steps without pauses, scans from readings at rest in whole periods of the "
        "ringing, and judges by its last ten readings alone",
        lambda p: True, "the path to its target, and 25 nm or its tolerance once there",
        CLOSED_LOOP,
    ),
    ModelChange(
        16,
        "sums over plays, creep and contacts and the low-pass of the sensor are rounded alike on "
        "every processor",
        _is_summed,
        "the last digits",
    ),
)  # fmt: skip

#: Recordings that name no version were made with this one.
FIRST_VERSION = 1
MODEL_VERSION = max((change.version for change in CHANGES), default=FIRST_VERSION)


def changes_since(version: int, p: Parameters, commands: Set[str]) -> list[ModelChange]:
    """Return the changes of the model since an earlier version that affect a drive.

    Parameters
    ----------
    version : int
        Of the model that computed the drive before.
    p : Parameters
        Of the drive.
    commands : set of str
        Names of those that it was given.

    Returns
    -------
    list of ModelChange
        In order of their versions; empty if the results are the same to the last bit.
    """
    return [
        change
        for change in CHANGES
        if change.version > version
        and (not change.commands or change.commands & commands)
        and change.touches(p)
    ]
