# SPDX-License-Identifier: Apache-2.0
"""The effects of parameters that a computation leaves out; docs/effects.md explains each."""

from __future__ import annotations

from collections.abc import Sequence

from stickslip_ros.physics.parameters import PARAMETERS, Parameters

#: Effects that a steady cycle does not show: creep, a past, chance, wear
PASSING = ("creep", "actuator_memory", "surface_spread", "slip_spread", "wear_rate")
#: Those and the ageing, which changes the contact with the drive
OF_ONE_CONTACT = (*PASSING, "dwell_growth", "rate_growth")
#: All that change a cycle of a rigid actuator, whatever the contacts
OF_A_CYCLE = (*OF_ONE_CONTACT, "amplifier_bandwidth", "amplifier_slew", "actuator_resonance")
#: All that differ from a rigid actuator on one contact
EFFECTS = (*OF_A_CYCLE, "contacts")
#: What a fit of several runs leaves out, which computes them with actuator and memory
OF_A_FIT = ("surface_spread", "slip_spread")


def left_out(p: Parameters, effects: Sequence[str] = PASSING) -> tuple[str, ...]:
    """Return the names of the effects that the parameters switch on."""
    values = p.flat()
    return tuple(name for name in effects if values[name] != PARAMETERS[name].default)
