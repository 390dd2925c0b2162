# SPDX-License-Identifier: Apache-2.0
"""The version of the model, and the changes of results with each version.

Recordings hold the version of the model that made them. A correction that changes results gets a
row in :data:`CHANGES`; resimulation then reports how far results may differ, for the affected
drives only. The plain drive, without effects, keeps its results to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Set
from dataclasses import dataclass

from stickslip_ros.model.actuator_chain import fineness_of, has_chain
from stickslip_ros.model.plant import Plant
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


_LAGS = _has("amplifier_bandwidth", "actuator_resonance")
_BENT = _has("amplifier_bandwidth", "actuator_resonance", "creep")
_STAGED = _has("amplifier_bandwidth", "amplifier_slew", "actuator_resonance")


def _ages(p: Parameters) -> bool:
    return p.friction.model == "ceim_ageing"


def _slew_alone(p: Parameters) -> bool:
    return bool(p.value("amplifier_slew")) and not p.value("amplifier_bandwidth")


def _rate_counts(p: Parameters) -> bool:
    curved = p.friction.model in ("lugre", "epm_fix", "epm_calc")
    return curved and p.friction.mu_s != p.friction.mu_k and _STAGED(p)


_LOOP = frozenset(("position", "trajectory", "joint_command"))
_CHANGES = frozenset(("parameters", "amplitude", "frequency"))

#: In order of their versions; a row is added, never changed.
CHANGES: tuple[ModelChange, ...] = (
    ModelChange(
        2,
        "an amplifier with a slew limit alone keeps it when its output lags at the end of a cycle",
        _slew_alone, "64 nm a cycle",
    ),
    ModelChange(3, "creep does not drift off over many cycles", _has("creep"), "0.05 nm a cycle"),
    ModelChange(
        3, "the actuator's rate counts in the slip of a contact with a Stribeck curve",
        _rate_counts, "0.15 nm a step",
    ),
    ModelChange(
        4, "lines behind a slow amplifier or a ringing actuator do not turn the contact",
        _LAGS, "0.9 nm a step",
    ),
    ModelChange(
        5,
        "bends of a slow amplifier or a ringing actuator have no spikes of picoseconds, and are "
        "finer",
        _LAGS, "0.13 nm a step",
    ),
    ModelChange(
        5, "a slow slide of a contact that ages is as exact as a quick one", _ages, "0.4 nm a cycle"
    ),
    ModelChange(
        5, "lines are finer where a resonance builds up and the runner gets nearly as fast",
        _LAGS, "0.6 nm a step",
    ),
    ModelChange(
        6, "a sensor with a bandwidth sees a runner that stands still at its readings only",
        _has("sensor_bandwidth"), "0.06 nm of a reading",
    ),
    ModelChange(
        7, "the closed loop steps without pauses and plans its last steps",
        lambda p: True, "the way to its target, and 4 nm once there", _LOOP,
    ),
    ModelChange(
        7, "moves that follow each other at once behind amplifier and actuator add up no errors",
        lambda p: has_chain(p.actuator),
        "0.01 nm in the second such move of a thousand cycles, without bound from the fourth on",
    ),
    ModelChange(
        8, "no step of a law with its own rate is longer than its estimate of the error holds",
        _ages, "0.02 nm a cycle",
    ),
    ModelChange(
        8,
        "lines behind amplifier and actuator are finer for a contact that slides from less than "
        "0.5 nm of deflection on",
        lambda p: has_chain(p.actuator) and fineness_of(Plant.column(p)) < 1.0, "0.02 nm a cycle",
    ),
    ModelChange(
        8, "a slip too short for the clock ends the dwell, too",
        _has("dwell_growth"), "16 nm a cycle, where a slip takes less than 1e-16 s",
    ),
    ModelChange(
        8, "a closed loop that steps on within its tolerance ends with a fault",
        lambda p: True, "the time of the end", _LOOP,
    ),
    ModelChange(
        8, "a slip of a picosecond moves no slow actuator",
        lambda p: bool(p.value("amplifier_bandwidth") and p.value("actuator_resonance")),
        "0.08 nm a cycle",
    ),
    ModelChange(
        9, "lines as long as the ringing of the runner do not set it off", _LAGS, "0.03 nm a cycle"
    ),
    ModelChange(
        10, "parabolas stand for the way behind amplifier and actuator, in place of straight lines",
        _BENT, "0.01 nm a cycle",
    ),
    ModelChange(
        11, "lines of a runner with a spring are finer for a contact that slides all the time",
        lambda p: bool(p.value("spring")) and has_chain(p.actuator), "0.03 nm a cycle",
    ),
    ModelChange(
        12,
        "a sensor with a bandwidth takes the runner's velocity between its samples into account",
        _has("sensor_bandwidth"), "0.3 nm of a reading",
    ),
    ModelChange(
        12,
        "pieces of an amplifier or actuator that are far shorter than the runner's ringing lose no "
        "digits",
        _BENT, "1 nm a cycle, where one is a million times quicker than the runner",
    ),
    ModelChange(
        13,
        "the closed loop says reached by what was read, waits where a scan makes the runner ring, "
        "and steps without a cap on its trains",
        lambda p: True, "the way to its target, and 25 nm once there", _LOOP,
    ),
    ModelChange(
        13, "a change in the last cycle of a move counts its steps once",
        lambda p: True, "the count and the mean of these steps", _CHANGES,
    ),
    ModelChange(
        14,
        "the closed loop waits for what it has set ringing, scans so slowly that nothing rings, "
        "and judges by its last ten readings alone",
        lambda p: True, "the way to its target, and its tolerance once there", _LOOP,
    ),
    ModelChange(
        14, "no step is so long that the estimate of its error has a root",
        lambda p: _ages(p) or p.friction.contacts > 1, "0.02 nm a cycle, overdamped",
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
