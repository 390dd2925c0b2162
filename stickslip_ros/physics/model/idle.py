# SPDX-License-Identifier: Apache-2.0
"""Settings that were given and have no effect beside the others, in one sentence."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import fields
from typing import Any

from stickslip_ros.physics.laws import LAWS, LEFT_TO_LAW
from stickslip_ros.physics.model.friction import constants_in_force
from stickslip_ros.physics.parameters import PARAMETERS, Parameters
from stickslip_ros.physics.waveforms import WAVEFORMS, of_others

#: Parts of all names from which on they are a snapshot, which holds what is not in use, too
_SNAPSHOT = 0.5
#: Settings of some of the built-in waveforms alone
_OF_WAVEFORMS = {
    "hold_before": ("hold", "shaped"),
    "hold_after": ("hold", "shaped"),
    "split": ("shaped",),
    "latency": ("shaped",),
    "waveform_table": ("table",),
}


def idle_settings(p: Parameters, given: Collection[str]) -> str:
    """Return a sentence about settings that have no effect with the others; "" if all have.

    given are the names that somebody set; those at their defaults ask for nothing. Raises
    ParameterError for a law that is not known.
    """
    if len(given) > _SNAPSHOT * len(PARAMETERS):
        return ""
    found = {
        name: why
        for name, why in (*_of_actuator(p), *_of_law(p), *_of_waveform(p))
        if name in given and p.value(name) != PARAMETERS[name].default
    }
    reasons: dict[str, list[str]] = {}
    for name, why in found.items():
        reasons.setdefault(why, []).append(name)
    parts = [f"{', '.join(names)}: {why}" for why, names in reasons.items()]
    return f"without effect: {'; '.join(parts)}" if parts else ""


def _of_actuator(p: Parameters) -> Iterator[tuple[str, str]]:
    if p.actuator.actuator != "hysteresis":
        for name in ("hysteresis", "hysteresis_file", "actuator_memory"):
            yield name, f"set actuator to hysteresis, it is {p.actuator.actuator}"
    elif p.actuator.hysteresis_file is not None:
        yield "hysteresis", "hysteresis_file replaces it"


def _of_law(p: Parameters) -> Iterator[tuple[str, str]]:
    friction, used = p.friction, constants_in_force(p.friction)
    own = LAWS[friction.model]
    for name in LEFT_TO_LAW:
        if getattr(used, name) is None:
            yield name, f"the law {friction.model} does not use it"
        elif getattr(friction, name) is not None:
            for form in ("slope", "offset"):
                if f"{name}_{form}" in PARAMETERS:
                    yield f"{name}_{form}", f"{name} is set, which replaces it"
    for law in LAWS.values():
        if law.rows and law.rows is not own.rows:
            yield from _rows(law.rows, f"the law {friction.model} does not use it")


def _of_waveform(p: Parameters) -> Iterator[tuple[str, str]]:
    chosen = p.drive.waveform
    for name, used_by in _OF_WAVEFORMS.items():
        if chosen not in used_by and chosen not in of_others():
            yield name, f"the waveform {chosen} does not use it"
    own = getattr(WAVEFORMS.get(chosen), "rows", None)
    for waveform in WAVEFORMS.values():
        rows = getattr(waveform, "rows", None)
        if rows and rows is not own:
            yield from _rows(rows, f"the waveform {chosen} does not use it")


def _rows(rows: Any, why: str) -> Iterator[tuple[str, str]]:
    for one in fields(rows):
        yield one.name, why
