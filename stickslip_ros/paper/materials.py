# SPDX-License-Identifier: Apache-2.0
"""Fig. 6, 8, 9, 12 and Table 3: runners of different materials.

No equation of the paper holds a material constant. Two readings are simulated: z_ba in proportion
to the tangential compliance of the contact after Mindlin, with the moduli of Table 3 (Fig. 6 and
9), and a slope of Eq. 14 that grows with the stiffness (Fig. 12); Fig. 8 raises the damping.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.signal import find_peaks
from scipy.stats import spearmanr

from stickslip_ros.arrays import Array
from stickslip_ros.model import Plant
from stickslip_ros.model.derivations import MATERIALS, Elastic, sigma_0_of_mindlin
from stickslip_ros.model.surface import CycleStart, Surface
from stickslip_ros.motion.settled import TRIAL_STEPS
from stickslip_ros.paper.claim import ClaimVerdict, Result, Table, Values, paired
from stickslip_ros.paper.parameter_sets import (
    EIGENFREQUENCY,
    JOINT,
    JOINT_SENSOR,
    TABLE_1,
    Set,
    columns,
    forces,
    mesh,
    power,
    steps_and_backsteps,
)
from stickslip_ros.parameters import Parameters
from stickslip_ros.simulation.operating_points import blocking_preloads, zero_amplitudes

#: The other body is a ball of ruby: modulus (Pa), radius (m) and Poisson's numbers are chosen here.
RUBY, RADIUS, POISSON = Elastic(400e9, 0.3), 0.5e-3, 0.3
#: Young's moduli of Table 3, each once, and that of the steel that Eq. 13 is taken to hold for, Pa.
MODULI, _STEEL = np.unique([material.youngs_modulus for material in MATERIALS]), 200e9
#: Slopes of Eq. 14 from soft to stiff material, 1/m; the paper's is the second.
SLOPES = (2.5e6, 5e6, 10e6)
_PRELOAD = np.linspace(0.2, 6.0, 117)
#: A maximum stands out from its surroundings by this part of the largest value.
PROMINENCE = 0.03
#: A drive with what the paper leaves out, as in config/edeler_2011_everything.yaml but for creep.
REAL_DRIVE: Set = {
    "actuator": "hysteresis", "hysteresis": 0.15, "actuator_resonance": EIGENFREQUENCY,
    "actuator_damping": 0.5, "amplifier_bandwidth": 2e6, "amplifier_slew": 1200.0,
    "dwell_growth": 0.03, "dwell_start": 1e-3, "rate_growth": 0.05, "rate_start": 1e-2,
}  # fmt: skip
#: The spread of its contact; number and distance (m) of the places where it is measured.
SPREAD, _PLACES, _APART = {"surface_spread": 0.1, "slip_spread": 0.02, "surface_seed": 1}, 12, 2e-5
#: sigma_0,ss of Table 1, N/m.
_SIGMA_0SS = 1e7
#: Damping that counts as very high, as a share of the critical one.
_DAMPED = 0.5


def compliance(modulus: Array) -> Array:
    """Return the compliance of the contact, relative to steel, for moduli (Pa), (materials,)."""
    soft, steel = (
        np.array([sigma_0_of_mindlin(1.0, RADIUS, Elastic(float(e), POISSON), RUBY) for e in many])
        for many in (np.atleast_1d(modulus), [_STEEL])
    )
    return np.asarray(steel / soft)


def _of_material(base: Set) -> Parameters:
    part = compliance(MODULI)
    return columns({**base, "preload": 1.0}, z_ba_slope=2e-8 * part, z_ba_offset=1e-8 * part)


def scattered() -> tuple[Array, Array]:
    """Return mean and standard deviation of the 0-amplitude (m) with all effects, (materials,).

    The contact of a place gives way at distances a factor longer: z_ba, z_ss and the limit of z.
    """
    surface = Surface.of(Parameters.of(SPREAD).friction)
    assert surface is not None
    factor = np.array([surface.factor(CycleStart(_APART * k, k)) for k in range(_PLACES)])
    of_material, of_place = mesh(compliance(MODULI), factor)
    drives = columns({**REAL_DRIVE, "preload": 1.0}).replace(
        z_ba_slope=TABLE_1["z_ba_slope"] * of_material * of_place,
        z_ba_offset=TABLE_1["z_ba_offset"] * of_material * of_place,
        sigma_0ss=_SIGMA_0SS / of_place,
    )
    found = zero_amplitudes(drives, len(of_place), TRIAL_STEPS).reshape(-1, _PLACES)
    return found.mean(axis=1), found.std(axis=1, ddof=1)


def maximum(preload: Array, force: Array) -> tuple[float, float]:
    """Return preload (N) and force (N) of the maximum, by a parabola through its neighbours."""
    k = int(np.argmax(force))
    near = slice(max(k - 3, 0), k + 4)
    a, b, c = np.polyfit(preload[near], force[near], 2)
    return float(-b / (2.0 * a)), float(c - b * b / (4.0 * a))


def peaks(values: Array) -> int:
    """Return how many maxima stand out by `PROMINENCE` of the largest value, ends included."""
    padded = np.concatenate(([0.0], values, [0.0]))
    return len(find_peaks(padded, prominence=PROMINENCE * float(np.max(values)))[0])


def _ranked(values: Array) -> float:
    """Return the rank correlation of values with the moduli."""
    return float(spearmanr(MODULI, values).statistic)


def _over_modulus(name: str, table_1: Array, joint: Array) -> dict[str, Array]:
    return {
        "modulus (N/m2)": MODULI,
        name: table_1,
        f"joint set: {name}": joint,
        "z_ba / Eq. 13": compliance(MODULI),
    }


def zero_amplitude_of_materials() -> Result:
    """0-amplitude over Young's modulus, z_ba by Mindlin's compliance."""
    sets = [
        zero_amplitudes(_of_material(base), len(MODULI), TRIAL_STEPS) for base in (TABLE_1, JOINT)
    ]
    mean, spread = scattered()

    def numbers(zero: Array) -> Values:
        return {
            "rank correlation of 0-amplitude and modulus": _ranked(zero),
            "0-amplitude of the stiffest over that of the softest": zero[-1] / zero[0],
            **_ends("0-amplitude", zero),
        }

    values = {
        **paired(numbers, *sets),
        "with all effects: rank correlation": _ranked(mean),
        "with all effects: stiffest over softest": mean[-1] / mean[0],
        "with all effects: largest standard deviation": np.max(spread),
    }
    table = {
        **_over_modulus("0-amplitude (m)", *sets),
        "all effects: 0-amplitude (m)": mean,
        "its standard deviation (m)": spread,
    }
    return Result(values, tables={"": table})


def blocking() -> Result:
    """Blocking preload over Young's modulus, z_ba by Mindlin's compliance."""
    sets = [
        blocking_preloads(_of_material(base), len(MODULI), TRIAL_STEPS) for base in (TABLE_1, JOINT)
    ]

    def numbers(preload: Array) -> Values:
        return {
            "rank correlation of blocking preload and modulus": _ranked(preload),
            "power of the modulus with which it grows": power(MODULI, preload),
            **_ends("blocking preload", preload),
        }

    table = _over_modulus("blocking preload (N)", *sets)
    return Result(paired(numbers, *sets), tables={"": table})


def _ends(what: str, values: Array) -> Values:
    return {f"{what} at {1e-9 * MODULI[k]:g} GPa": values[k] for k in (0, -1)}


def damping() -> Result:
    """Step, backstep and ringing over sigma_1, at 1 N."""
    parts = np.array([0.002, 0.011, 0.03, 0.06, 0.12, 0.25, _DAMPED])
    sets = [_damped({**base, "preload": 1.0}, parts) for base in (TABLE_1, JOINT)]

    def numbers(found: Table) -> Values:
        sigma_1, step, backstep, ringing = found.values()
        return {
            "ringing, very high over usual damping": ringing[-1] / ringing[1],
            "backstep, very high over usual damping": backstep[-1] / backstep[1],
            "change of the step size": 100.0 * abs(step[-1] / step[1] - 1.0),
            "sigma_1 that counts as very high": sigma_1[-1],
            "smallest backstep possible: stroke less step": 160e-9 - step[-1],
        }

    return Result(
        paired(numbers, *sets),
        tables=dict(zip(("", "_joint"), sets, strict=True)),
        drawn={"parts": {"part of the critical": parts, **sets[0]}},
    )


def _damped(base: Set, parts: Array) -> Table:
    """Return step, backstep and ringing (m) for parts of the critical damping, (points,)."""
    plant = Plant.of(columns(base))
    sigma_1 = 2.0 * math.sqrt(plant.mass * plant.contact.sigma_0) * parts
    step, backstep = steps_and_backsteps(base, sigma_1=sigma_1)
    return {
        "sigma_1 (N s/m)": sigma_1,
        "step size (m)": step,
        "backstep (m)": backstep,
        "ringing (m)": backstep - (160e-9 - step),
    }


def table() -> Result:
    """Table 3: data that Fig. 6, 9 and 10 are computed from."""
    return Result(
        {"materials": len(MATERIALS)},
        tables={"": {"Young's modulus (N/m2)": np.array([m.youngs_modulus for m in MATERIALS])}},
        remark="; ".join(f"{m.name}: {m.printed_modulus:g} kN/mm²" for m in MATERIALS)
        + ". Fig. 6, 9 and 10 are computed from these moduli.",
        settled=ClaimVerdict.DATA,
    )


def tops(highest: Sequence[tuple[float, float]]) -> Table:
    """Return the maxima (preload, force) of curves as a table."""
    preload, force = np.transpose(highest)
    return {"preload (N)": preload, "maximum (N)": force}


def slopes_of_force() -> Result:
    """Generated force over preload for three slopes of Eq. 14."""
    sets = {
        ending: [forces({**base, "sigma_0_slope": slope}, _PRELOAD) for slope in SLOPES]
        for ending, base in (("", TABLE_1), ("_joint", {**JOINT, "spring": JOINT_SENSOR}))
    }
    found = {
        ending: tops([maximum(_PRELOAD, force) for force in curves])
        for ending, curves in sets.items()
    }

    def numbers(ending: str) -> Values:
        where, highest = found[ending].values()
        return {
            "curves with one clear maximum": sum(peaks(force) == 1 for force in sets[ending]),
            "least gain in force by doubling the slope": np.min(highest[1:] / highest[:-1]),
            "least shift of the maximum by doubling the slope": np.min(np.diff(where)),
            **{
                f"maximum at {1e-6 * slope:g} N/µm per N": at
                for slope, at in zip(SLOPES, where, strict=True)
            },
        }

    names = ["preload (N)", *(f"force at {slope:g} 1/m (N)" for slope in SLOPES)]
    return Result(
        paired(numbers, "", "_joint"),
        tables={
            ending: dict(zip(names, [_PRELOAD, *curves], strict=True))
            for ending, curves in sets.items()
        },
        drawn={f"tops{ending}": table for ending, table in found.items()},
    )
