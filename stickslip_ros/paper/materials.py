# SPDX-License-Identifier: Apache-2.0
"""Fig. 6, 8, 9, 12 and Table 3: runners of different materials.

No equation of the paper holds a material constant. Two readings are simulated: z_ba in proportion
to the tangential compliance of the contact after Mindlin, with the moduli of Table 3 (Fig. 6 and
9), and a slope of Eq. 14 that grows with the stiffness (Fig. 12); Fig. 8 raises the damping.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import find_peaks
from scipy.stats import spearmanr

from stickslip_ros.library.operating_points import blocking_preloads
from stickslip_ros.library.zero_amplitude import zero_amplitudes
from stickslip_ros.model import Plant
from stickslip_ros.model.derivations import MATERIALS, Elastic, sigma_0_of_mindlin
from stickslip_ros.model.surface import Moment, Surface
from stickslip_ros.paper import style
from stickslip_ros.paper.claim import Result, Values, Verdict
from stickslip_ros.paper.parameter_sets import (
    EIGENFREQUENCY,
    JOINT,
    JOINT_SENSOR,
    TABLE_1,
    Array,
    Set,
    columns,
    forces,
    mesh,
    power,
    steps_and_backsteps,
)
from stickslip_ros.paper.style import NANO, legend, lines, panel
from stickslip_ros.parameters import Parameters
from stickslip_ros.traces.steps import TRIAL_STEPS

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
    factor = np.array([surface.factor(Moment(_APART * k, k)) for k in range(_PLACES)])
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


def _over_modulus(table_1: Array, joint: Array, label: str, scale: float) -> dict[str, Any]:
    """Return table and drawing of a quantity over the modulus, for both sets."""
    name = label.replace("(nm)", "(m)")
    shown = lines(
        ("modulus (N/m2)", MODULI),
        ((name, table_1, "CEIM, Table 1", style.CEIM, "o-"),
         (f"joint set: {name}", joint, "CEIM, joint set", style.LUGRE, "o-")),
        ("Young's modulus of the runner (GPa)", label),
        scales=(1e-9, scale),
        ylim=(0.0, 1.15 * scale * float(max(table_1.max(), joint.max()))),
    )  # fmt: skip
    shown["tables"][""]["z_ba / Eq. 13"] = compliance(MODULI)
    return shown


def zero_amplitude() -> Result:
    """0-amplitude over Young's modulus, z_ba by Mindlin's compliance."""
    table_1, joint = (
        zero_amplitudes(_of_material(base), len(MODULI), TRIAL_STEPS) for base in (TABLE_1, JOINT)
    )
    mean, spread = scattered()
    shown = _over_modulus(table_1, joint, "0-amplitude (nm)", NANO)
    columns_of = {**shown["tables"][""], "all effects: 0-amplitude (m)": mean,
                  "its standard deviation (m)": spread}  # fmt: skip

    def draw(figure: Figure) -> None:
        shown["draw"](figure)
        axes = figure.axes[0]
        axes.errorbar(1e-9 * MODULI, NANO * mean, NANO * spread, fmt="s-", color=style.EPM,
                      label="CEIM, Table 1, all effects", markersize=4, capsize=3)  # fmt: skip
        legend(axes, "best")

    values = {
        "rank correlation of 0-amplitude and modulus": (_ranked(table_1), _ranked(joint)),
        "0-amplitude of the stiffest over that of the softest": (
            table_1[-1] / table_1[0],
            joint[-1] / joint[0],
        ),
        "with all effects: rank correlation": _ranked(mean),
        "with all effects: stiffest over softest": mean[-1] / mean[0],
        "with all effects: largest standard deviation": np.max(spread),
        **_ends("0-amplitude", table_1, joint),
    }
    return Result(
        values,
        tables={"": columns_of},
        draw=draw,
    )  # fmt: skip


def blocking() -> Result:
    """Blocking preload over Young's modulus, z_ba by Mindlin's compliance."""
    table_1, joint = (
        blocking_preloads(_of_material(base), len(MODULI), TRIAL_STEPS) for base in (TABLE_1, JOINT)
    )
    values = {
        "rank correlation of blocking preload and modulus": (_ranked(table_1), _ranked(joint)),
        "power of the modulus with which it grows": (power(MODULI, table_1), power(MODULI, joint)),
        **_ends("blocking preload", table_1, joint),
    }
    return Result(
        values,
        **_over_modulus(table_1, joint, "blocking preload (N)", 1.0),
    )  # fmt: skip


def _ends(what: str, table_1: Array, joint: Array) -> Values:
    return {f"{what} at {1e-9 * MODULI[k]:g} GPa": (table_1[k], joint[k]) for k in (0, -1)}


def damping() -> Result:
    """Step, backstep and ringing over sigma_1, at 1 N."""
    parts = np.array([0.002, 0.011, 0.03, 0.06, 0.12, 0.25, _DAMPED])
    curves = {}
    for name, base in (("Table 1", TABLE_1), ("joint set", JOINT)):
        plant = Plant.of(columns({**base, "preload": 1.0}))
        critical = 2.0 * math.sqrt(plant.mass * plant.contact.sigma_0)
        step, backstep = steps_and_backsteps({**base, "preload": 1.0}, sigma_1=critical * parts)
        curves[name] = critical * parts, step, backstep, backstep - (160e-9 - step)
    (_, step, backstep, ringing), (_, joint_step, joint_back, joint_ringing) = curves.values()

    def ratio(values: Array) -> float:
        return float(values[-1] / values[1])

    def draw(figure: Figure) -> None:
        axes = panel(figure, "damping, part of the critical", "length (nm)", "CEIM, Table 1, 1 N")
        for values, label, colour in (
            (step, "step size", style.CEIM),
            (backstep, "backstep", style.LUGRE),
            (ringing, "part of the backstep that rings", style.EPM),
        ):
            axes.plot(parts, NANO * values, "o-", color=colour, label=label, markersize=4)
        axes.set(xscale="log", ylim=(0.0, 160.0))
        legend(axes, "upper right")

    values = {
        "ringing, very high over usual damping": (ratio(ringing), ratio(joint_ringing)),
        "backstep, very high over usual damping": (ratio(backstep), ratio(joint_back)),
        "change of the step size": (
            100.0 * abs(ratio(step) - 1.0),
            100.0 * abs(ratio(joint_step) - 1.0),
        ),
        "sigma_1 that counts as very high": (curves["Table 1"][0][-1], curves["joint set"][0][-1]),
        "smallest backstep possible: stroke less step": (
            160e-9 - step[-1],
            160e-9 - joint_step[-1],
        ),
    }
    return Result(
        values,
        tables={
            ending: {"sigma_1 (N s/m)": sigma_1, "step size (m)": one, "backstep (m)": back,
                     "ringing (m)": rings}
            for ending, (sigma_1, one, back, rings) in zip(("", "_joint"), curves.values(),
                                                           strict=True)
        },
        draw=draw,
    )  # fmt: skip


def table() -> Result:
    """Table 3: data that Fig. 6, 9 and 10 are computed from."""
    values = {
        "materials": len(MATERIALS),
    }
    return Result(
        values,
        tables={"": {"Young's modulus (N/m2)": np.array([m.youngs_modulus for m in MATERIALS])}},
        remark="; ".join(f"{m.name}: {m.printed_modulus:g} kN/mm²" for m in MATERIALS)
        + ". Fig. 6, 9 and 10 are computed from these moduli.",
        settled=Verdict.DATA,
    )


def generated_force() -> Result:
    """Generated force over preload for three slopes of Eq. 14."""
    curves = {
        name: [forces({**base, "sigma_0_slope": slope}, _PRELOAD) for slope in SLOPES]
        for name, base in (("Table 1", TABLE_1), ("joint set", {**JOINT, "spring": JOINT_SENSOR}))
    }
    found = {
        name: np.array([maximum(_PRELOAD, force) for force in forces_of])
        for name, forces_of in curves.items()
    }
    (where, highest), (joint_where, joint_highest) = (top.T for top in found.values())

    def draw(figure: Figure) -> None:
        for at, (name, forces_of) in enumerate(curves.items()):
            axes = panel(figure, "preload (N)", "generated force (N)", name, (2, 1, at + 1))
            for slope, force, colour in zip(SLOPES, forces_of, style.ORDERED[1:], strict=True):
                axes.plot(_PRELOAD, force, color=colour, label=f"{1e-6 * slope:g} N/µm per N")
            axes.plot(*found[name].T, "v", color=style.LUGRE, label="maximum")
            axes.set(xlim=(0.0, 6.0), ylim=(0.0, 1.25 * np.max(forces_of)))
            legend(axes, "upper right", "slope of Eq. 14")

    values = {
        "curves with one clear maximum": (
            sum(peaks(force) == 1 for force in curves["Table 1"]),
            sum(peaks(force) == 1 for force in curves["joint set"]),
        ),
        "least gain in force by doubling the slope": (
            np.min(highest[1:] / highest[:-1]),
            np.min(joint_highest[1:] / joint_highest[:-1]),
        ),
        "least shift of the maximum by doubling the slope": (
            np.min(np.diff(where)),
            np.min(np.diff(joint_where)),
        ),
        **{
            f"maximum at {1e-6 * slope:g} N/µm per N": (a, b)
            for slope, a, b in zip(SLOPES, where, joint_where, strict=True)
        },
    }
    return Result(
        values,
        tables={
            ending: {"preload (N)": _PRELOAD,
                     **{f"force at {slope:g} 1/m (N)": force
                        for slope, force in zip(SLOPES, forces_of, strict=True)}}
            for ending, forces_of in zip(("", "_joint"), curves.values(), strict=True)
        },
        draw=draw,
        size=(6.2, 7.4),
    )  # fmt: skip
