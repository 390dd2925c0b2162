# SPDX-License-Identifier: Apache-2.0
"""Constants of the model found by running it: z_ba from a measured 0-amplitude (section 4.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.friction import ALWAYS_PLASTIC, ELASTOPLASTIC, contacts_of, is_defined
from stickslip_ros.model.plant import plant_of
from stickslip_ros.parameters import PARAMETERS, ParameterError, Parameters
from stickslip_ros.studies.bisection import bisect
from stickslip_ros.studies.zero_amplitude import zero_amplitudes
from stickslip_ros.traces.steps import TRIAL_STEPS

#: Accuracy of z_ba, m, and of the 0-amplitude that it has to give back, as part of it.
_RESOLUTION, _GIVES_BACK = 1e-12, 0.01
#: Breakaway distances looked at, as parts of the measured 0-amplitude, and the room left to z_ss.
_LOW, _HIGH, _ROOM = 0.01, 2.0, 0.999


def z_ba_from_zero_amplitude(p: Parameters, measured: float) -> float:
    """Return the breakaway distance (m) with which an axis has a measured 0-amplitude (m, direct).

    Everything but z_ba is taken from p; z_ss follows z_ba where the law makes it so. Raises
    ParameterError if there is none: for LuGre, for a 0-amplitude out of reach, and where ringing
    that lasts into the next slip makes the 0-amplitude jump.
    """
    if not 0.0 < measured < np.inf:
        raise ParameterError(f"the 0-amplitude is {measured:g} m; it has to be above 0")
    contact = plant_of(p.replace(z_ba=_LOW * measured)).contact
    if contact.kind == ALWAYS_PLASTIC:
        raise ParameterError(
            f"model {p.friction.model} has no breakaway distance; take an elastoplastic"
        )
    high = min(_HIGH * measured, PARAMETERS["z_ba"].high)
    if not is_defined(contacts_of(p.replace(z_ba=high).friction)):  # z_ss does not follow z_ba
        limit = contact.z_ss if contact.kind == ELASTOPLASTIC else min(contact.z_k, contact.z_s)
        high = _ROOM * limit

    def zero_of(z_ba: NDArray[np.float64]) -> NDArray[np.float64]:
        found = zero_amplitudes(p.replace(z_ba=z_ba), 1, TRIAL_STEPS)
        return np.where(np.isfinite(found), found, np.inf)  # no steps up to the largest amplitude

    def is_enough(z_ba: NDArray[np.float64], _: NDArray[np.bool_]) -> NDArray[np.bool_]:
        return zero_of(z_ba) >= measured

    everywhere = np.ones(1, dtype=bool)
    low = np.array([_LOW * measured])
    found = bisect(is_enough, low, np.array([high]), everywhere, _RESOLUTION)
    gives = float(zero_of(found)[0])
    if not abs(gives - measured) <= _GIVES_BACK * measured:
        raise ParameterError(
            f"no z_ba gives a 0-amplitude of {measured:g} m here; the nearest, {found[0]:g} m, "
            f"gives {gives:g} m: check z_ss, preload and frequency"
        )
    return float(found[0])
