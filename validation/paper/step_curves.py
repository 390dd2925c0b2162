# SPDX-License-Identifier: Apache-2.0
"""Fig. 3, 4, 5, 7 and 14, Table 2, sections 3, 4.3 and 5.3: steps over amplitude and preload."""

import math

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.physics.model import Plant
from stickslip_ros.simulation.operating_points import (
    blocking_preloads,
    intersections,
    zero_amplitudes,
)
from stickslip_ros.simulation.settled import MEASURABLE, TRIAL_STEPS
from validation.paper.claim import ClaimVerdict, Result, Values, paired
from validation.paper.parameter_sets import (
    EPM_CALC,
    EPM_FIX,
    JOINT,
    LUGRE,
    TABLE_1,
    Set,
    columns,
    mesh,
    one_step,
    power,
    steps,
    volts,
)

#: Amplitudes as actuator deflection, m; LuGre is convex over the lower part.
DEFLECTION = np.linspace(5e-9, 160e-9, 63)
_SMALL = DEFLECTION <= 80e-9
#: There must be no step up to this share of z_ba.
_SURELY_DEAD = 0.9
RATIOS, _Z_SS = (0.9, 0.5, 0.05), 100e-9
#: Steps from rest until the cycles of the maps have settled; the axes of the maps follow.
_SETTLED = 40
FREQUENCY = np.linspace(500.0, 6000.0, 111)
_MAP_PRELOAD = np.linspace(0.2, 6.0, 59)
_COARSE = np.linspace(10e-9, 160e-9, 40)
SLEWRATE = np.geomspace(50.0, 1000.0, 14)
_METHODS = (("direct", zero_amplitudes), ("intersection", intersections))
#: A minimum that a bench would see, m.
_SEEN = 1e-9
#: z_ss in parts of z_ba: the paper's 2, and 1 / 0.7 as in Dupont et al.
_PAPER_RATIO, _DUPONT_RATIO = 2.0, 1.0 / 0.7
Z_SS = np.array([1.1, 1.25, _DUPONT_RATIO, 1.7, _PAPER_RATIO, 2.5, 3.0, 4.0])


def dead_zone() -> Result:
    """Steps over amplitude for LuGre, EPM with fixed z_ss, and CEIM."""
    lugre, epm, ceim = (
        steps(base, amplitude=volts(DEFLECTION)) for base in (LUGRE, EPM_FIX, {"preload": 1.0})
    )
    values = {
        "smallest LuGre step, at 5 nm": lugre[0],
        "amplitudes at which LuGre does not step": np.sum(lugre <= 0.0),
        "power of the amplitude with which LuGre grows, up to 80 nm": power(
            DEFLECTION[_SMALL], lugre[_SMALL]
        ),
        **{
            f"largest {law} step up to {1e9 * _SURELY_DEAD * z_ba:.0f} nm": np.max(
                np.abs(step[_SURELY_DEAD * z_ba >= DEFLECTION])
            )
            for law, step, z_ba in (("EPM", epm, 50e-9), ("CEIM", ceim, 30e-9))
        },
        "largest step over the ideal one": np.max(np.stack([lugre, epm, ceim]) / DEFLECTION),
    }
    table = {
        "deflection (m)": DEFLECTION, "step LuGre (m)": lugre, "step EPM_fix (m)": epm,
        "step CEIM 1 N (m)": ceim,
    }  # fmt: skip
    return Result(values, tables={"": table})


def _epm(ratio: float, form: str = "dupont") -> Set:
    return {**EPM_FIX, "z_ba": ratio * _Z_SS, "z_ss": _Z_SS, "alpha_form": form}


def ratios() -> Result:
    """Steps over amplitude, and 0-amplitude, for three ratios."""
    curves = {ratio: steps(_epm(ratio), amplitude=volts(DEFLECTION)) for ratio in RATIOS}
    z_ba = _Z_SS * np.array(RATIOS)
    zero = zero_amplitudes(columns(EPM_FIX, z_ba=z_ba), len(RATIOS), TRIAL_STEPS)
    values = {
        "0-amplitude at 90 % over that at 50 %": zero[0] / zero[1],
        **{f"0-amplitude at {100 * r:g} %": z for r, z in zip(RATIOS, zero, strict=True)},
    }
    over = {f"step at {100 * ratio:g} % (m)": curve for ratio, curve in curves.items()}
    table = {"deflection (m)": DEFLECTION, **over}
    zeros = {"z_ba / z_ss": np.array(RATIOS), "0-amplitude (m)": zero}
    return Result(values, tables={"": table, "_zero": zeros})


def negative_steps() -> Result:
    """Steps at 5 % with alpha as printed; maps of both elastoplastic laws near their ringing."""
    printed = steps(_epm(0.05, "printed"), amplitude=volts(DEFLECTION))
    symmetric = steps(_epm(0.05), amplitude=volts(DEFLECTION))
    frequency, deflection = mesh(FREQUENCY, _COARSE)
    epm = steps(_epm(0.05), _SETTLED, frequency=frequency, amplitude=volts(deflection))
    over, preload = mesh(FREQUENCY, _MAP_PRELOAD)
    z_ss = 4e-8 * preload + 2e-8
    ceim, late = (
        steps({}, _SETTLED, frequency=over, preload=preload, z_ba=ratio * z_ss, z_ss=z_ss)
        for ratio in (0.5, 0.9)
    )

    values = {
        "smallest step at 5 %, alpha as printed": np.min(printed),
        "smallest step over the largest, alpha as printed": abs(np.min(printed)) / np.max(printed),
        "smallest step at 5 %, alpha with |z|": np.min(symmetric),
        "lowest step at 5 %, |z|, 0.5 to 6 kHz": np.min(epm),
        **_lowest("CEIM, 50 %", ceim, over, preload),
        **_lowest("CEIM, 90 %", late, over, preload),
    }
    low = {
        "deflection (m)": DEFLECTION,
        "step at 5 %, alpha as printed (m)": printed,
        "step at 5 %, |z| (m)": symmetric,
    }
    epm_map = {"frequency (Hz)": frequency, "deflection (m)": deflection, "step at 5 % (m)": epm}
    ceim_map = {
        "frequency (Hz)": over, "preload (N)": preload, "step CEIM at 50 % (m)": ceim,
        "step CEIM at 90 % (m)": late,
    }  # fmt: skip
    return Result(values, tables={"_100Hz": low, "_epm": epm_map, "_ceim": ceim_map})


def _lowest(what: str, found: Array, frequency: Array, preload: Array) -> Values:
    k = int(np.argmin(found))
    return {
        f"points with negative steps, {what}": 100.0 * np.mean(found < -MEASURABLE),
        f"lowest step, {what}": found[k],
        f"frequency of it, {what}": frequency[k],
        f"preload of it, {what}": preload[k],
    }


def slewrate() -> Result:
    """Both methods, forward and backward, over the slewrates of Table 1."""
    p = columns({"preload": 1.0}, slewrate=SLEWRATE)
    found = {
        (method, direction): search(p, len(SLEWRATE), sign * TRIAL_STEPS)
        for method, search in _METHODS
        for direction, sign in (("forward", 1), ("backward", -1))
    }
    direct, crossing = found["direct", "forward"], found["intersection", "forward"]
    decades = np.log(SLEWRATE / np.sqrt(SLEWRATE[0] * SLEWRATE[-1]))
    bent = 1.0 + _SEEN / np.mean(direct) * (decades / decades[-1]) ** 2
    rated = zero_amplitudes(p.replace(z_ba=3e-8 * bent), len(SLEWRATE), TRIAL_STEPS)
    resonant = p.replace(actuator_resonance=8.2e5, actuator_damping=0.5)  # Fig. 11
    rung = intersections(resonant, len(SLEWRATE), TRIAL_STEPS)

    change = {
        f"{method} {direction} (%)": 100.0 * (values / np.mean(values) - 1.0)
        for (method, direction), values in found.items()
    }
    values = {
        "least surplus of intersection over direct": np.min(crossing - direct),
        **{
            f"depth of a minimum between the ends, {method}": _dip(values)
            for method, values in (("direct", direct), ("intersection", crossing))
        },
        "spread over slewrate, direct": _spread(direct),
        "spread over slewrate, intersection": _spread(crossing),
        "forward against backward": max(
            np.max(np.abs(found[m, "forward"] - found[m, "backward"])) for m, _ in _METHODS
        ),
        "what it would take: z_ba at both ends above that in the middle": 100.0
        * (min(bent[0], bent[-1]) - 1.0),
        "depth of the minimum with such a z_ba": _dip(rated),
        "depth of a minimum, intersection, actuator of 820 kHz (Fig. 11), damping 0.5": _dip(rung),
        "slewrate of this minimum": SLEWRATE[int(np.argmin(rung))],
    }
    table = {
        "slewrate (V/us)": SLEWRATE,
        **{f"0-amplitude {m} {d} (m)": zero for (m, d), zero in found.items()},
        "0-amplitude direct, z_ba of slewrate (m)": rated,
        "0-amplitude intersection, actuator of 820 kHz (m)": rung,
    }
    drawn = {"change": {"slewrate (V/us)": SLEWRATE, **change}}
    return Result(values, tables={"": table}, drawn=drawn)


def _dip(values: Array) -> float:
    """Return how far the lower end of both ends lies above the minimum in between, m."""
    return float(min(values[0], values[-1]) - np.min(values))


def _spread(values: Array) -> float:
    return 100.0 * float(np.ptp(values) / np.mean(values))


def steady_state_distance() -> Result:
    """Steps over z_ss with z_ba as it is, at 0.4 N."""
    z_ba = 2e-8 * 0.4 + 1e-8
    dupont = {"z_ss": _DUPONT_RATIO * z_ba}
    shorter = {"z_ba": z_ba / 2.0, "z_ss": z_ba}

    def change(base: Set, **to: float) -> float:
        before = one_step({**base, "z_ba": z_ba, "z_ss": _PAPER_RATIO * z_ba})
        after = one_step({**base, "z_ba": z_ba, "z_ss": _PAPER_RATIO * z_ba, **to})
        return 100.0 * abs(after / before - 1.0)

    curves = {
        name: (base, steps({**base, "z_ba": z_ba}, z_ss=Z_SS * z_ba))
        for name, base in (("Table 1", TABLE_1), ("joint set", JOINT))
    }

    def numbers(name: str) -> Values:
        base, step = curves[name]
        changed = change(base, **dupont)
        return {
            "change of the step from 50 % to the 70 % of Dupont et al.": changed,
            "change by z_ss alone over that by halving z_ba with it": changed
            / change(base, **shorter),
            **{f"step with z_ss = {Z_SS[k]:g} z_ba": step[k] for k in (0, 4, 7)},
            "the first change, with sigma_0ss = 1e9 N/m": change(
                {**base, "sigma_0ss": 1e9}, **dupont
            ),
        }

    over = {f"step, {name} (m)": step for name, (_, step) in curves.items()}
    return Result(paired(numbers, *curves), tables={"": {"z_ss / z_ba": Z_SS, **over}})


# -- over the preload

PRELOAD = np.linspace(0.25, 10.0, 79)
#: Range of the straight fall of Fig. 14, N.
_MIDDLE = (0.5, 3.5)
#: A carried runner: a vertical axis with the heaviest runner of Table 1; few steps, for it falls.
CARRIED: Set = {"inclination": 0.5 * math.pi, "mass": 15e-3}
LOW_PRELOAD, _CYCLES = np.array([0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0]), 3


def earlier_laws() -> Result:
    """Steps over preload for the three attempts of Fig. 5."""
    lugre, fix, calc = (steps(base, preload=PRELOAD) for base in (LUGRE, EPM_FIX, EPM_CALC))
    symmetric = steps({**EPM_CALC, "alpha_form": "dupont"}, preload=PRELOAD)
    above = 1.0 + PRELOAD[1] - PRELOAD[0] < PRELOAD  # the next point after the crossing
    near = np.linspace(0.9, 1.2, 31)
    turn = near[int(np.argmax(steps(EPM_CALC, preload=near) < 0.0))]
    low, high = int(np.searchsorted(PRELOAD, 0.5)), -1
    values = {
        **{
            f"smallest {law} step up to 10 N": np.min(step)
            for law, step in (("LuGre", lugre), ("EPM_fix", fix))
        },
        **{
            f"{law} step at 0.5 N over that at 10 N": step[low] / step[high]
            for law, step in (("LuGre", lugre), ("EPM_fix", fix))
        },
        "correlation of EPM_fix with LuGre over preload": np.corrcoef(lugre, fix)[0, 1],
        "largest EPM_calc step from 1.2 N on": np.max(calc[above]),
        "EPM_calc at 10 N over its lowest step": calc[high] / np.nanmin(calc),
        "preload from which EPM_calc is negative": turn,
        "smallest EPM_calc step, alpha with |z|": np.nanmin(symmetric),
    }
    table = {
        "preload (N)": PRELOAD, "step LuGre (m)": lugre, "step EPM_fix (m)": fix,
        "step EPM_calc, alpha as printed (m)": calc, "step EPM_calc, alpha with |z| (m)": symmetric,
    }  # fmt: skip
    return Result(
        values,
        tables={"": table},
        remark=(
            "EPM_fix keeps g(v) below the fraction of Eq. 7; the fixed z_ss stands in alpha alone. "
            "EPM_calc is computed with alpha as printed, where the sine has z instead of |z|: only "
            "so its steps turn negative above 1 N, as the figure says. With |z| it approaches zero "
            "from above (dotted). With Table 2 it is defined above 0.5 N, where z_ss stays above "
            "z_ba = 100 nm."
        ),
    )


def _straight_part(step: Array) -> tuple[float, float]:
    """Return where a straight line through `_MIDDLE` crosses zero (N), and its R2."""
    middle = (_MIDDLE[0] <= PRELOAD) & (_MIDDLE[1] >= PRELOAD)
    slope, level = np.polyfit(PRELOAD[middle], step[middle], 1)
    left = step[middle] - np.polyval((slope, level), PRELOAD[middle])
    return -level / slope, 1.0 - float(np.var(left) / np.var(step[middle]))


def zero_preload(base: Set) -> float:
    """Return the preload (N) at which the straight fall of the steps reaches zero."""
    return _straight_part(steps(base, preload=PRELOAD))[0]


def ceim() -> Result:
    """Steps over preload for the CEIM, and a straight line through the middle, for both sets."""
    table_1, joint = (steps(base, preload=PRELOAD) for base in (TABLE_1, JOINT))

    def numbers(of: tuple[Set, Array]) -> Values:
        base, step = of
        crossing, r2 = _straight_part(step)
        return {
            "smallest step up to 1 N": np.min(step[PRELOAD <= 1.0]),
            "R2 of a line through 0.5 to 3.5 N": r2,
            "preload at which this line reaches zero": crossing,
            "step at 5.5 N": np.interp(5.5, PRELOAD, step),
            "preload that blocks the drive": blocking_preloads(columns(base), 1, TRIAL_STEPS)[0],
            "largest step at 7 N and above": np.max(np.abs(step[PRELOAD >= 7.0])),
        }

    crossing, _ = _straight_part(joint)
    start = joint[0] + joint[0] / (crossing / 0.25 - 1.0)
    straight = np.interp(PRELOAD, (0.0, crossing), (start, 0.0))
    table = {"preload (N)": PRELOAD, "step CEIM (m)": table_1, "step CEIM, joint set (m)": joint}
    return Result(
        paired(numbers, (TABLE_1, table_1), (JOINT, joint)),
        tables={"": table},
        drawn={"straight": {"preload (N)": PRELOAD, "straight (m)": straight}},
    )


def parameter_sets() -> Result:
    """Table 2: the sets as they are built, and the range of a calculated z_ss."""
    contact = {
        name: Plant.of(columns({**base, "preload": 1.0})).contact
        for name, base in (("LuGre", LUGRE), ("EPM_calc", EPM_CALC), ("EPM_fix", EPM_FIX))
    }
    rest = np.array([0.6, 1.0, 1.5, 2.0, 5.0, 10.0])
    sets = [columns({**EPM_CALC, "preload": float(f)}) for f in rest]
    z_ss = np.array([Plant.of(one).contact.z_s for one in sets])
    table = {"preload (N)": rest, "z_ss of EPM_calc at rest (m)": z_ss}
    values = {
        **{f"sigma_0, {n}": c.sigma_0 for n, c in contact.items()},
        **{f"sigma_1, {n}": c.sigma_1 for n, c in contact.items()},
        "mu_s of LuGre": contact["LuGre"].z_s * 1e6, "mu_k of LuGre": contact["LuGre"].z_k * 1e6,
        "z_ba, EPM_calc": contact["EPM_calc"].z_ba, "z_ba, EPM_fix": contact["EPM_fix"].z_ba,
        "z_ss, EPM_fix": contact["EPM_fix"].z_ss, "z_ss of EPM_calc at 1.5 N, at rest": z_ss[2],
        "z_ss of EPM_calc at 2 N, at rest": z_ss[3], "z_ss of EPM_calc at 0.6 N": z_ss[0],
        "z_ss of EPM_calc at 10 N": z_ss[-1],
    }  # fmt: skip
    return Result(values, tables={"": table}, settled=ClaimVerdict.DATA)


def too_low() -> Result:
    """Steps of a runner that the axis carries, from too low a preload on."""
    ceim = steps(CARRIED, _CYCLES, preload=LOW_PRELOAD)
    light = one_step({"inclination": 0.5 * math.pi, "preload": 0.01})
    what = "motion in a cycle"
    values = {
        f"{what} at 0.1 N": ceim[0],
        f"{what} at 1 N": ceim[6],
        f"{what} at 4 N, over that at 1 N": ceim[-1] / ceim[6],
        f"{what} at 0.01 N with the 4 g of Table 1": light,
        "friction that Eq. 13 times Eq. 14 leaves without any preload": 1e-8 * 7e6,
    }
    return Result(values, tables={"": {"preload (N)": LOW_PRELOAD, f"{what} (m)": ceim}})
