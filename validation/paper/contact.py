# SPDX-License-Identifier: Apache-2.0
"""Fig. 6, 8 to 12 and 15, Tables 1, 3, 4 and 5: material, stiffness and force of the contact.

No equation of the paper holds a material constant. Two readings are simulated: z_ba in proportion
to the tangential compliance of the contact after Mindlin, with the moduli of Table 3 (Fig. 6 and
9), and a slope of Eq. 14 that grows with the stiffness (Fig. 12); Fig. 8 raises the damping.
"""

import math
from collections.abc import Sequence
from dataclasses import astuple
from typing import NamedTuple

import numpy as np
from scipy.signal import find_peaks
from scipy.stats import spearmanr

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.ringing import fit_ringing
from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.model.contacts import Geometry, forces_by_preload, preload_ratio
from stickslip_ros.physics.model.derivations import (
    MATERIALS,
    Elastic,
    sigma_0_of_asperities,
    sigma_0_of_mindlin,
    sigma_0_of_ringing,
)
from stickslip_ros.physics.model.surface import CycleStart, Surface
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.simulation.operating_points import blocking_preloads, zero_amplitudes
from stickslip_ros.simulation.sampling import trace_steps
from stickslip_ros.simulation.settled import TRIAL_STEPS
from validation.paper.claim import ClaimVerdict, Result, Table, Values, paired
from validation.paper.parameter_sets import (
    EIGENFREQUENCY,
    JOINT,
    JOINT_CONSTANT,
    JOINT_SENSOR,
    STIFFNESS_OF_VIBRATION,
    TABLE_1,
    TABLE_1_VIBRATION,
    VIBRATION,
    Set,
    columns,
    forces,
    mesh,
    power,
    steps_and_backsteps,
)
from validation.paper.step_curves import zero_preload

#: The other body is a ball of ruby: modulus (Pa), radius (m) and Poisson's numbers are chosen here.
RUBY, RADIUS, POISSON = Elastic(400e9, 0.3), 0.5e-3, 0.3
#: Young's moduli of Table 3, each once, and that of the steel that Eq. 13 is taken to hold for, Pa.
MODULI, _STEEL = np.unique([material.youngs_modulus for material in MATERIALS]), 200e9
#: Slopes of Eq. 14 from soft to stiff material, 1/m; the paper's is the second.
SLOPES = (2.5e6, 5e6, 10e6)
#: Preloads of Fig. 12 and 15, N.
PRELOAD = np.linspace(0.2, 6.0, 117)
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
        "modulus (N/m2)": MODULI, name: table_1, f"joint set: {name}": joint,
        "z_ba / Eq. 13": compliance(MODULI),
    }  # fmt: skip


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
        "sigma_1 (N s/m)": sigma_1, "step size (m)": step, "backstep (m)": backstep,
        "ringing (m)": backstep - (160e-9 - step),
    }  # fmt: skip


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
        ending: [forces({**base, "sigma_0_slope": slope}, PRELOAD) for slope in SLOPES]
        for ending, base in (("", TABLE_1), ("_joint", {**JOINT, "spring": JOINT_SENSOR}))
    }
    found = {
        ending: tops([maximum(PRELOAD, force) for force in curves])
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
            ending: dict(zip(names, [PRELOAD, *curves], strict=True))
            for ending, curves in sets.items()
        },
        drawn={f"tops{ending}": table for ending, table in found.items()},
    )


# -- Fig. 10, 11 and 15: sigma_0 and the force with it

#: Preloads, N; at each a step is traced and its ringing measured.
_RINGING = (0.1, 0.4, 1.0, 2.0)
#: The range of Table 3, N/m^2.
MODULUS = np.linspace(70e9, 600e9, 40)
#: Radius of the contact of one asperity, m: assumed, only its product with their number counts.
ASPERITY = 1e-6
#: Constant stiffness with Table 1, N/m: p of Eq. 14, for the paper gives none.
CONSTANT = 7e6
#: Preload (N) from which Eq. 14 stays constant.
BOUND = 2.0


def mindlin(modulus: float, preload: float) -> float:
    """Return the stiffness (N/m) of the ball on a flat of a modulus (N/m^2), preload in N."""
    return sigma_0_of_mindlin(preload, RADIUS, Elastic(modulus, POISSON), RUBY)


def stiffness() -> Result:
    """Compare the stiffness recovered from simulated ringing with both theories."""
    recovered, given = [], []
    for preload in _RINGING:
        p = columns({"preload": preload})
        trace, period = trace_steps(p, 2), drive_of(p).period
        after = (trace.t >= period) & (trace.t < 1.9 * period)
        ringing = fit_ringing(trace.t[after] - period, trace.x[after], 0.9 * period)
        frequency = ringing.frequency if ringing else math.nan
        recovered.append(sigma_0_of_ringing(frequency, p.runner.mass))
        given.append(Plant.of(p).contact.sigma_0)
    smooth = {
        preload: np.array([mindlin(modulus, preload) for modulus in MODULUS.tolist()])
        for preload in (0.1, 1.0)
    }
    steel = mindlin(200e9, 1.0)
    one = np.array([sigma_0_of_asperities(1, ASPERITY, Elastic(e, POISSON)) for e in MODULUS])
    count = 1000.0 * steel / float(np.interp(200e9, MODULUS, one))
    rough = count * one
    error = float(np.max(np.abs(np.array(recovered) / np.array(given) - 1.0)))

    shown = np.linspace(0.0, 2.2, 20)
    values = {
        "largest error of sigma_0 from the ringing": 100.0 * error,
        "smooth contact at 1 N over Eq. 11 with 4 kHz": steel / STIFFNESS_OF_VIBRATION,
        "smooth contact, 600 over 70 kN/mm²": smooth[1.0][-1] / smooth[1.0][0],
        "smooth contact, 1 N over 0.1 N": smooth[1.0][0] / smooth[0.1][0],
        "asperities, 600 over 70 kN/mm²": rough[-1] / rough[0],
        "sigma_0 of the vibration between both theories": 0.5 * smooth[0.1][0]
        < STIFFNESS_OF_VIBRATION
        < rough[0],
        "asperities of 1 µm that put theory three decades higher": count,
        "Eq. 14 at 0.4 N over Eq. 11 with 4 kHz": 9e6 / STIFFNESS_OF_VIBRATION,
        "sigma_0 of Eq. 11 with 4 kHz": STIFFNESS_OF_VIBRATION,
    }
    table = {
        "preload (N)": np.array(_RINGING),
        "sigma_0 set (N/m)": np.array(given),
        "sigma_0 from ringing (N/m)": np.array(recovered),
    }
    theory = {
        "modulus (N/m2)": MODULUS, "Mindlin 0.1 N (N/m)": smooth[0.1],
        "Mindlin 1 N (N/m)": smooth[1.0], "asperities (N/m)": rough,
    }  # fmt: skip
    drawn = {"eq14": {"preload (N)": shown, "sigma_0 (N/m)": 5e6 * shown + 7e6}}
    return Result(values, tables={"": table, "_theory": theory}, drawn=drawn)


def eigenfrequency() -> Result:
    """How far the actuator's first eigenfrequency lies above the ringing."""
    force, vibration, joint = (
        Plant.of(columns(base)).ringing_frequency for base in (TABLE_1, TABLE_1_VIBRATION, JOINT)
    )
    values = {
        "eigenfrequency over Table 1's vibration, both measured": EIGENFREQUENCY / VIBRATION,
        "eigenfrequency over the simulated ringing": (
            EIGENFREQUENCY / force,
            EIGENFREQUENCY / joint,
        ),
        "the same with sigma_0 from the vibration (Eq. 11)": EIGENFREQUENCY / vibration,
    }
    return Result(values)


class Curves(NamedTuple):
    """Generated force (N) over `PRELOAD`."""

    constant: Array
    linear: Array
    capped: Array

    @property
    def highest(self) -> list[tuple[float, float]]:
        """Preload (N) and force (N) of the maximum of each."""
        return [maximum(PRELOAD, curve) for curve in self]

    @property
    def gain(self) -> float:
        """The largest force with linear over that with constant stiffness."""
        (_, constant), (_, linear), _ = self.highest
        return linear / constant


def stiffness_curves(base: Set, constant: float) -> Curves:
    """Return the three curves of a set with a constant stiffness (N/m)."""
    return Curves(
        forces({**base, "sigma_0": constant}, PRELOAD),
        forces(base, PRELOAD),
        forces({**base, "sigma_0_cap": BOUND}, PRELOAD),
    )


def curves_of_both_sets() -> tuple[Curves, Curves]:
    """Return the curves with Table 1 and with the joint set."""
    return stiffness_curves(TABLE_1, CONSTANT), stiffness_curves(
        {**JOINT, "spring": JOINT_SENSOR}, JOINT_CONSTANT
    )


def _numbers(found: Curves) -> Values:
    (at_constant, force), (at_linear, high), (at_capped, _) = found.highest
    constant, linear, capped = (curve[PRELOAD > BOUND] for curve in found)
    return {
        "maxima, constant": peaks(found.constant), "maximum, constant, at": at_constant,
        "maximum, linear, at": at_linear,
        "maximum, linear, right of constant by": at_linear - at_constant,
        "level, linear over constant": found.gain,
        "linear less capped above 2 N, at least": np.min(linear - capped),
        "capped less constant above 2 N, at least": np.min(capped - constant),
        "maximum, capped, at": at_capped, "largest force, constant": force,
        "largest force, linear": high,
    }  # fmt: skip


def bounds_of_force() -> Result:
    """The curves of both sets."""
    sets = dict(zip(("", "_joint"), curves_of_both_sets(), strict=True))
    return Result(
        paired(_numbers, *sets.values()),
        tables={
            ending: {
                "preload (N)": PRELOAD,
                **{f"force {name} (N)": curve for name, curve in found._asdict().items()},
            }
            for ending, found in sets.items()
        },
        drawn={f"tops{ending}": tops(found.highest) for ending, found in sets.items()},
    )


# -- the printed numbers of Table 1, the joint set, and Table 5

#: Mass (kg), inclination (rad) and preload (N) that Table 5 leads back to: Table 4 is missing from
#: our copy.
_GUIDE_MASS, _ALPHA, _GUIDE_PRELOAD = 3e-3, 0.5 * math.pi, 0.2
#: The printed values of the seven numbers of the joint set: m, %, Hz, N, N, N, and a ratio.
_SEVEN = (130e-9, 30.0, 4e3, 5.0, 1.7, 2.8, 2.0)
#: The printed forces A to F of Table 5, mN.
_PRINTED = (74.3, 67.1, 74.3, 67.1, 155.1, 127.8)


def _step_and_ringing(base: Set) -> tuple[float, float, float]:
    """Return step (m), backstep (% of the step) and ringing (Hz) of a set."""
    step, backstep = (float(values[0]) for values in steps_and_backsteps(base))
    return step, 100.0 * backstep / step, Plant.of(columns(base)).ringing_frequency


def table_1() -> Result:
    """Step size, backstep and vibration of Table 1 from all sets."""
    sets = [_step_and_ringing(base) for base in (TABLE_1, TABLE_1_VIBRATION, JOINT)]
    (step, share, ringing), (step_v, share_v, ringing_v), (step_j, share_j, ringing_j) = sets
    names = ("step size (m)", "backstep (% of step)", "ringing frequency (Hz)")
    values = {
        "step size": (step, step_j), "backstep": (share, share_j),
        "vibration": (ringing, ringing_j), "step size, sigma_0 from the vibration (Eq. 11)": step_v,
        "backstep, the same": share_v, "vibration, the same": ringing_v,
    }  # fmt: skip
    return Result(values, tables={"": dict(zip(names, np.array(sets).T, strict=True))})


def joint_set() -> Result:
    """Seven numbers of four figures and a table from one set."""
    step, share, ringing = _step_and_ringing(JOINT)
    old, new = curves_of_both_sets()
    (constant, _), (linear, _), _ = new.highest
    (old_constant, _), (old_linear, _), _ = old.highest
    was = _step_and_ringing(TABLE_1)
    values = {
        "step size": step, "backstep": share, "vibration": ringing,
        "preload at which the straight fall of the steps ends": zero_preload(JOINT),
        "preload at the maximum of Fig. 15, constant sigma_0 (CEIM)": constant,
        "preload at the maximum of Fig. 15, linear sigma_0 (CEIM)": linear,
        "largest force of Fig. 15, linear over constant sigma_0": new.gain,
    }  # fmt: skip
    printed, ours = np.array(_SEVEN), np.array(list(values.values()))
    before = np.array([*was, zero_preload(TABLE_1), old_constant, old_linear, old.gain])
    values |= {
        f"largest deviation, {name}": 100.0 * float(np.max(np.abs(found / printed - 1.0)))
        for name, found in (("joint set", ours), ("Table 1", before))
    }
    return Result(values, tables={"": {"paper": printed, "joint set": ours, "Table 1": before}})


def guide() -> Result:
    """The six forces from geometry, mass, inclination and preload."""
    geometry = Geometry()
    forces = forces_by_preload(geometry, _GUIDE_MASS, _ALPHA, _GUIDE_PRELOAD)
    ours = 1e3 * np.array(astuple(forces))

    values = {
        **dict(zip("ABCDEF", ours, strict=True)),
        "sum of the normal forces": forces.total,
        "sum over preload": preload_ratio(forces, _GUIDE_PRELOAD),
        "(a - b) / (2 e)": geometry.lever,
    }
    table = {"ours (mN)": ours, "printed (mN)": np.array(_PRINTED)}
    return Result(values, tables={"": table})
