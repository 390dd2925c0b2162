# SPDX-License-Identifier: Apache-2.0
"""The rows of the one table that describe contact, runner and loads.

The order of the groups in `Parameters` and of the fields in a group is that of every list of
parameters that users see. An optional parameter (``float | None``) is None while it is not set.
Each number has physical limits and the reason for them. The groups check nothing themselves;
`Parameters.of` and `Parameters.replace` do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from stickslip_ros.parameters.row import Extended, growth_per_kelvin, number, text

# One row of the table in two or three lines each:
# fmt: off


@dataclass(frozen=True)
class FrictionParameters(Extended):
    """The friction law and its constants."""

    model: str = text("ceim", "friction law: see stickslip simulate --list-parameters")
    preload: float = number(
        0.4, "N", 1e-3, 1e3, "preload f: the normal force that a load cell reads",
        reason="a tenth of a gram to the weight of 100 kg")
    mu: float = number(
        0.2, "", 1e-3, 10.0, "friction coefficient of the CEIM, Eq. 16",
        reason="polymers on ice to rubber, with room for a fit")
    preload_ratio: float = number(
        1.0, "", 1e-3, 1e3,
        "normal force in the law over preload (section 5.2): 1 as in the paper, 2.83 as in Table 5",
        reason="a guide multiplies the preload by 1 to 10")
    mu_s: float = number(
        0.3, "", 1e-3, 10.0, "static friction coefficient, Eq. 4",
        reason="polymers on ice to rubber, with room for a fit")
    mu_k: float = number(
        0.2, "", 1e-3, 10.0, "kinetic friction coefficient, Eq. 4",
        reason="polymers on ice to rubber, with room for a fit")
    v_stribeck: float = number(
        1e-3, "m/s", 1e-6, 1e3, "Stribeck velocity, Eq. 4",
        reason="measured ones lie between 1e-5 and 0.1 m/s")
    sigma_0: float | None = number(
        None, "N/m", 0.0, 1e12, "asperity stiffness; 0 takes the law's own value", least=1.0,
        reason="softer than a rubber band, or stiffer than any contact")
    sigma_0_slope: float = number(
        5e6, "1/m", 0.0, 1e12, "o of Eq. 14, stiffness per preload",
        reason="a preload of 1 N adds at most what a block of steel has")
    sigma_0_offset: float = number(
        7e6, "N/m", 0.0, 1e12, "p of Eq. 14, stiffness without preload",
        reason="blocks of steel are softer")
    sigma_0_cap: float | None = number(
        None, "N", 0.0, 1e3, "normal force above which Eq. 14 stays constant; 0: no cap",
        least=1e-3, reason="the limits of preload")
    sigma_0ss: float | None = number(
        None, "N/m", 0.0, 1e12, "sigma_0,ss of Eq. 16; 0 takes the law's own value", least=1.0,
        reason="the paper's is 1e7 N/m; softer ones give way by a metre per newton")
    sigma_1: float = number(
        5.0, "N s/m", 0.0, 1e6, "asperity damping, Eq. 1",
        reason="a runner of a kilogram would take hours to ring once")
    sigma_2: float = number(
        0.0, "N s/m", 0.0, 1e6, "viscous friction, Eq. 1",
        reason="a newton would move the runner by a micrometre a second")
    z_ba: float | None = number(
        None, "m", 0.0, 1e-3, "breakaway distance; 0 takes the law's own value", least=1e-15,
        reason="far below an atom, and far beyond any asperity")
    z_ba_slope: float = number(
        2e-8, "m/N", 0.0, 1e-3, "a of Eq. 13, breakaway distance per preload",
        reason="1 mm per newton is far beyond any asperity")
    z_ba_offset: float = number(
        1e-8, "m", 0.0, 1e-3, "b of Eq. 13, breakaway distance without preload",
        reason="far beyond any asperity")
    z_ss: float | None = number(
        None, "m", 0.0, 1e-3, "steady-state deflection; 0 takes the law's own value", least=1e-15,
        reason="far below an atom, and far beyond any asperity")
    alpha_form: str = text(
        "dupont", "dupont: alpha uses the sine of |z|; printed: the sine of z, as in the paper",
        pattern="dupont|printed")
    contacts: int = number(
        1, "", 1, 16,
        "number of contacts that the runner rests on, each with a deflection of its own "
        "(Appendix: 6)", mutable=False,
        reason="prismatic guides have six, ball guides up to a dozen")
    contact_shares: str = text(
        "equal",
        "shares of the contacts in the preload: equal; guide: as in the Appendix, of 6 contacts",
        mutable=False, pattern="equal|guide")
    contact_spread: float = number(
        0.0, "", 0.0, 1.0,
        "spread of the breakaway from contact to contact, a share, typically 0.05 to 0.3; 0: none",
        mutable=False,
        reason="at 1 a contact in three gives way at a third of its distance, or thrice")
    surface_spread: float = number(
        0.0, "", 0.0, 1.0,
        "spread of the breakaway along the way, a share, typically 0.02 to 0.2; 0: none",
        mutable=False,
        reason="at 1 the friction changes threefold along the way")
    surface_length: float = number(
        1e-6, "m", 1e-9, 1e-2, "correlation length of this spread, typically 1e-7 to 1e-5",
        mutable=False,
        reason="below a nanometre there are no asperities, beyond 1 cm no travel")
    slip_spread: float = number(
        0.0, "", 0.0, 1.0,
        "spread of the breakaway from cycle to cycle, a share, typically 0.01 to 0.1; 0: none",
        mutable=False,
        reason="at 1 the friction changes threefold from cycle to cycle")
    surface_seed: int = number(
        1, "", 0, 2**31 - 1, "seed of the spreads", mutable=False,
        reason="31 bits seed the generator")
    dwell_growth: float = number(
        0.0, "", 0.0, 0.5,
        "growth of the breakaway in a decade of the time at rest, a share, typically 0.02 to "
        "0.1; 0: none (Dieterich 1972)", mutable=False,
        reason="measured ones lie between 0.005 and 0.1")
    dwell_start: float = number(
        1e-3, "s", 1e-9, 1e6, "time at rest from which on the breakaway grows", mutable=False,
        reason="faster than any atom jumps, or longer than any test")
    rate_growth: float = number(
        0.0, "", -0.05, 0.5,
        "growth of the breakaway in a decade of the rate of the slip, a share, typically -0.05 "
        "to 0.05; 0: none (Ruina 1983)", mutable=False,
        reason="measured ones lie between -0.05 and 0.05; below, friction would vanish")
    rate_start: float = number(
        1e-6, "m/s", 1e-12, 1e3, "rate of the slip from which on the breakaway changes",
        mutable=False,
        reason="an atom in a minute, up to a bullet")
    wear_rate: float = number(
        0.0, "1/m", -1e4, 1e4,
        "share by which the breakaway falls in a metre that the contact slides, typically 1e-4 to "
        "0.1, below 0 while it runs in; 0: none (Archard 1953)", mutable=False, least=1e-9,
        reason="worn out after a few hundred steps, or not after the way to the moon")
    friction_temperature: float = growth_per_kelvin(
        "growth of the breakaway in a kelvin, as a share of that at 293.15 K; 0: none")


@dataclass(frozen=True)
class RunnerParameters:
    """The runner and its loads."""

    mass: float = number(
        4e-3, "kg", 1e-6, 1e3, "mass of the runner",
        reason="a grain of dust to a machine tool")
    payload: float = number(
        0.0, "kg", 0.0, 1e3, "mass carried by the runner",
        reason="as of the mass")
    force: float = number(
        0.0, "N", -1e3, 1e3, "constant external force on the runner",
        reason="the weight of 100 kg")
    spring: float | None = number(
        None, "N/m", 0.0, 1e9,
        "spring (force sensor) that the runner compresses, relaxed at 0; below 1e-3: none",
        least=0.0, reason="blocks of steel have 1e8 N/m; below 1e-3 none is felt")
    inclination: float = number(
        0.0, "rad", -math.pi, math.pi, "angle of +x above the horizontal",
        reason="a full turn")
