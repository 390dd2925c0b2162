# SPDX-License-Identifier: Apache-2.0
"""Sections 2.2, 3, 5.1 and 5.2: influences on LuGre, vibration, velocity, several contacts."""

import math

import numpy as np
from scipy.optimize import brentq

from stickslip_ros.base.arrays import Array
from stickslip_ros.physics.model import Contact, Plant, drive_of, friction_force, z_rate
from stickslip_ros.physics.solver import Simulation
from stickslip_ros.simulation.operating_points import batch_of
from validation.paper.claim import Result
from validation.paper.parameter_sets import EPM_FIX, LUGRE, Set, columns, one_step

#: A large drive such as those that the sentences of section 2.2 are about: 2 um, a slip of 50 us.
LARGE: Set = {**LUGRE, "sigma_0": 1e7, "gain": 2e-6 / 300.0, "slewrate": 6.0}
#: What is changed, and to which value, or to which part of its value.
_CHANGES = {
    "mu_s": 0.45, "mu_k": 0.3, "v_stribeck": 1e-2, "sigma_2": 0.05, "sigma_0": 1.5, "slewrate": 1.5,
    "preload": 0.6,
}  # fmt: skip
_FACTORS = ("sigma_0", "slewrate")
#: Vibration of a vertical axis: amplitudes, m of actuator deflection, and cycles at 500 Hz.
VIBRATIONS, _CYCLES, _VIBRATION_HZ = np.array([2e-9, 5e-9, 10e-9, 20e-9]), 400, 500.0
#: Velocities, m/s; the paper expects less than 0.2 in the slip.
VELOCITY = np.geomspace(1e-4, 0.2, 60)
_TYPICAL = VELOCITY >= 0.01
PRELOAD = (0.4, 1.0, 2.0)
#: Contacts of the guide in the Appendix.
CONTACTS = 6


def _changes(base: Set) -> Array:
    """Return the change of the step (%) by each of `_CHANGES`."""
    full = {"slewrate": 100.0, **base}
    before = one_step(base)
    after = [
        one_step({**base, name: value * full[name] if name in _FACTORS else value})
        for name, value in _CHANGES.items()
    ]
    return np.asarray(100.0 * (np.array(after) / before - 1.0))


def influences() -> Result:
    """Change of the LuGre step by one parameter at a time, at a large and at a small stroke."""
    change, small = _changes(LARGE), _changes(LUGRE)
    by, by_small = (dict(zip(_CHANGES, found.tolist(), strict=True)) for found in (change, small))

    values = {
        "change by mu_s over that by mu_k": abs(by["mu_s"] / by["mu_k"]),
        "change by the Stribeck velocity": abs(by["v_stribeck"]),
        "change by viscous friction": abs(by["sigma_2"]),
        "change by sigma_0 over that by mu_k": abs(by["sigma_0"] / by["mu_k"]),
        "change by slewrate": by["slewrate"],
        "change by preload": by["preload"],
        "change by sigma_0 over that by mu_k, stroke 160 nm, sigma_0 1 N/µm": abs(
            by_small["sigma_0"] / by_small["mu_k"]
        ),
    }
    table = {
        "changed to": np.array(list(_CHANGES.values())),
        "change, stroke 2 um (%)": change,
        "change, stroke 160 nm (%)": small,
    }
    return Result(values, tables={"": table})


def vibration() -> Result:
    """Drift of a runner on a vibrating vertical axis, with LuGre and EPM."""
    drift = {
        name: np.array([_drift(base, float(a)) for a in VIBRATIONS])
        for name, base in (("LuGre", LUGRE), ("EPM_fix", EPM_FIX), ("CEIM", {}))
    }
    values = {
        "LuGre: drift in a cycle, 2 nm of vibration": drift["LuGre"][0],
        **{
            f"{law}: largest drift in a cycle, up to 20 nm": np.max(np.abs(drift[law]))
            for law in ("EPM_fix", "CEIM")
        },
    }
    over = {f"drift in a cycle, {name} (m)": found for name, found in drift.items()}
    return Result(values, tables={"": {"vibration (m)": VIBRATIONS, **over}})


def _drift(base: Set, vibration: float) -> float:
    """Return how far (m) a runner sinks in a cycle of a triangular vibration (m)."""
    p = columns({
        **base, "inclination": 0.5 * math.pi, "waveform": "triangle", "frequency": _VIBRATION_HZ,
        "amplitude": vibration / columns({}).actuator.gain,
    })  # fmt: skip
    batch, possible = batch_of(p, 1, 1)
    position = np.ravel(batch.run(_CYCLES, possible)[0])
    half = _CYCLES // 2
    return float(position[-1] - position[half - 1]) / half


def steady_friction(velocity: float, contact: Contact) -> float:
    """Return the friction force (N) of sliding at a constant velocity (m/s) above zero."""
    far = 2.0 * max(contact.z_ss, contact.z_s, contact.z_k)
    z = brentq(lambda z: z_rate(z, velocity, contact), 0.0, far, xtol=1e-18)
    return friction_force(z, velocity, contact)


def velocity() -> Result:
    """Friction over velocity for LuGre and CEIM, the latter at three preloads."""

    def coefficient(base: Set, preload: float) -> Array:
        contact = Plant.of(columns({**base, "preload": preload})).contact
        return np.array([steady_friction(float(v), contact) / preload for v in VELOCITY])

    lugre = coefficient(LUGRE, 1.0)
    ceim = {preload: coefficient({}, preload) for preload in PRELOAD}
    fine = np.linspace(0.4, 2.0, 161)
    floor = (2e-8 * fine + 1e-8) * (5e6 * fine + 7e6) / fine  # Eq. 13 times Eq. 14 over preload
    values = {
        "spread over velocity, CEIM": max(map(_spread, ceim.values())),
        "spread from 10 to 200 mm/s, LuGre": _spread(lugre[_TYPICAL]),
        "spread over preload 0.4 to 2 N, CEIM": _spread(
            np.array([values[0] for values in ceim.values()])
        ),
        "the least that Eq. 13 times Eq. 14 leaves": _spread(floor),
        "friction over preload, CEIM at 1 N": ceim[1.0][0],
    }
    over = {f"CEIM {preload:g} N F/f": found for preload, found in ceim.items()}
    return Result(values, tables={"": {"velocity (m/s)": VELOCITY, "LuGre F/f": lugre, **over}})


def _spread(values: Array) -> float:
    return 200.0 * float(np.ptp(values) / (np.max(values) + np.min(values)))


def contacts() -> Result:
    """A runner on several contacts, compared with the single contact that represents them."""
    counts = np.array([1, 2, 3, CONTACTS])
    several = np.array([_position(n * 1e6, n * 5.0, contacts=int(n)) for n in counts])
    lumped = np.array([_position(n * 1e6, n * 5.0) for n in counts])
    single = _position(1e6, 5.0)
    values = {
        f"{CONTACTS} contacts over one with {CONTACTS} times sigma_0 and sigma_1": several[-1]
        / lumped[-1],
        "largest difference, 1 to 6 contacts": np.max(np.abs(several - lumped)),
        f"{CONTACTS} contacts over one with sigma_0 itself": several[-1] / single,
        "vibration frequency, over that of one contact": math.sqrt(CONTACTS),
    }
    table = {
        "contacts": counts.astype(np.float64),
        "distance in 2 cycles, contacts one by one (m)": several,
        "distance in 2 cycles, one with n sigma_0 (m)": lumped,
    }
    return Result(values, tables={"": table})


def _position(stiffness: float, damping: float, contacts: int = 1) -> float:
    """Return the position (m) of a runner after two cycles at 1 kHz; sums over equal contacts."""
    own = {"sigma_0": stiffness, "sigma_1": damping, "contacts": contacts}
    p = columns({**LUGRE, "frequency": 1e3, **own})
    simulation = Simulation(Plant.of(p), p.solver.tolerance)
    simulation.start(drive_of(p), 2)
    simulation.advance(2e-3)
    return simulation.state.x
