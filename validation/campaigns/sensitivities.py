# SPDX-License-Identifier: Apache-2.0
"""Exact derivatives at random points: held against differences that have converged.

    python -m validation.campaigns.sensitivities [--count 500] [--seed 1]

Drives of all laws are drawn over what real ones span. Of each, the derivatives of position,
backstep and ringing of the last step by some parameters are compared with differences of the same
equations, extrapolated from ever smaller ones (C. J. F. Ridders, Adv. Eng. Softw. 4 (1982) 75).
Where these do not converge, an event is nearly another one, or hardly happens, and on one side of
the differences it is missing or in another place: cycle and event are named. Or the derivative
drowns in the errors of the values. Neither is a finding.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.errors import StickslipError
from stickslip_ros.laws import LAWS
from stickslip_ros.library.derivatives import sensitivities
from stickslip_ros.parameters import ParameterError, Parameters
from validation.draws import REAL, differing, even, loads, shape, waveform

#: What is drawn beside the spans of real drives
SPANS = {
    **{name: REAL[name] for name in ("preload", "mass", "mu", "sigma_1", "mu_s", "mu_k")},
    **{"v_stribeck": (1e-4, 1.0), "frequency": (50.0, 2e4), "slewrate": (10.0, 1000.0)},
    **{"amplitude": REAL["amplitude"]},
}
#: Parameters by which derivatives are taken, where they play a part
BY = ("amplitude", "frequency", "slewrate", "preload", "mass", "sigma_1", "gain", "inclination")
OF_LAW = {
    "ceim": ("mu", "z_ba_slope", "sigma_0_slope"),
    "ceim_without_mu": ("z_ba_slope", "z_ba_offset"),
    "ceim_ageing": ("mu", "beta", "d_c"),
    "lugre": ("mu_k", "mu_s", "v_stribeck"),
    "epm_fix": ("mu_k", "mu_s", "v_stribeck"),
    "epm_calc": ("mu_k", "mu_s", "v_stribeck"),
}
#: Steps; parameters of each drive; error (relative) that is a finding
STEPS, CHOSEN, RIGHT = 3, 3, 1e-6
#: First difference, as a share of the value, and how much smaller each of the following is
LARGEST, SMALLER, TRIES = 1e-3, 0.5, 12
#: Error of a difference by those of the values, relative to these; slopes are left out where it is
#: more than they may be off
ROUNDING = 1e-10


def drawn(seed: int, first: int = 0) -> Iterator[tuple[int, Parameters, list[str]]]:
    """Yield number, parameters and the names of some of them, for ever."""
    for number in range(first, 10**9):
        draw = np.random.default_rng((seed, number))
        values: dict[str, Any] = {name: even(draw, *span) for name, span in SPANS.items()}
        values |= {"model": str(draw.choice(list(LAWS))), "waveform": waveform(draw)}
        if values["model"] == "ceim_ageing":
            values |= {"beta": even(draw, 1e-3, 0.1), "d_c": even(draw, 1e-8, 1e-5)}
        if draw.random() < 0.2:
            values["spring"] = even(draw, *REAL["spring"])
        if draw.random() < 0.2:
            values |= {"contacts": int(draw.integers(2, 5)), "contact_spread": 0.1}
        values |= loads(draw, values["preload"], values["mu"])
        names = draw.choice([*BY, *OF_LAW[values["model"]]], CHOSEN, replace=False)
        try:
            yield number, Parameters.of(values | shape(draw, values)), [str(one) for one in names]
        except ParameterError:
            continue


def converged(f: Callable[[float], NDArray[np.float64]], h: float) -> tuple[Any, Any]:
    """Return the derivatives of f at 0 and their errors, from differences of h and smaller ones."""
    table: list[list[NDArray[np.float64]]] = []
    best = np.full(len(f(0.0)), math.nan)
    error = np.full_like(best, math.inf)
    for _ in range(TRIES):
        row = [(f(h) - f(-h)) / (2.0 * h)]
        for k, above in enumerate(table[-1] if table else []):
            row.append(row[k] + (row[k] - above) / (SMALLER ** (-2.0 * (k + 1)) - 1.0))
            moved = np.maximum(np.abs(row[-1] - row[k]), np.abs(row[-1] - above))
            better = moved < error
            best, error = np.where(better, row[-1], best), np.where(better, moved, error)
        table.append(row)
        h *= SMALLER
    return best, error


def differs(one: Sequence[Any], other: Sequence[Any]) -> str:
    """Return the first event that only one of two runs has there, "" if they have the same."""
    for a, b in zip_longest(one, other):
        if a != b:
            cycle, event = a or b
            return f"cycle {cycle}: {event}" + (f", or {b[1]}" if a and b else "")
    return ""


def judged(p: Parameters, names: Sequence[str]) -> Iterator[tuple[str, float]]:
    """Yield what was compared and the error, nan where the differences do not converge.

    With these comes the event that differs nearest to the value.
    """
    found = sensitivities(p, by=names, steps=STEPS)
    for name in names:
        value, grazes = p.value(name), dict[float, str]()

        def last(
            move: float,
            name: str = name,
            value: float = value,
            grazes: dict[float, str] = grazes,
        ) -> NDArray[np.float64]:
            moved = sensitivities(p.replace(**{name: value + move}), by=(), steps=STEPS)
            grazes[abs(move)] = grazes.get(abs(move)) or differs(found.events, moved.events)
            return np.array([one[-1] for one in moved.values])

        size = abs(value) or 1.0
        try:
            wanted, error = converged(last, LARGEST * size)
        except ParameterError:  # at the end of its range
            continue
        for output, exact, true, doubt in zip(
            found.values._fields, found.by[name], wanted, error, strict=True
        ):
            if not math.isfinite(true + exact[-1]):  # the runner never turns back
                continue
            least = ROUNDING * abs(float(getattr(found.values, output)[-1])) / size
            converges = max(doubt, least) < 0.3 * RIGHT * abs(exact[-1])
            off = abs(exact[-1] - true) / abs(exact[-1]) if converges else math.nan
            nearest = next((grazes[h] for h in sorted(grazes) if grazes[h]), "no event")
            if converges or doubt > least:
                yield f"{output} by {name}" + ("" if converges else f": {nearest}"), off


def main(argv: Sequence[str] | None = None) -> int:
    """Print the findings; return 1 for one."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--count", type=int, default=500, help="drives (%(default)s)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    args = parser.parse_args(argv)
    ends: Counter[str] = Counter()
    errors: list[float] = []
    drives = 0
    for number, p, names in drawn(args.seed, args.first):
        try:
            for what, error in judged(p, names):
                if math.isnan(error):
                    graze = not what.endswith("no event")
                    ends["grazing" if graze else "not converged"] += 1
                    print(f"{number}: differences do not converge: {what}", flush=True)
                elif error > RIGHT:
                    ends["findings"] += 1
                    print(f"{number}: {what}: {error:.1e} off: {differing(p)}", flush=True)
                else:
                    ends["right"] += 1
                if error == error:
                    errors.append(error)
        except StickslipError as refused:
            ends[str(refused)[:60]] += 1
            continue
        drives += 1
        if drives >= args.count:
            break
    said = ", ".join(f"{count} {kind}" for kind, count in ends.most_common())
    print(
        f"{drives} drives: {said}; error {np.median(errors):.1e} in the median, "
        f"{np.quantile(errors, 0.99):.1e} in 99 %, {max(errors):.1e} at most"
    )
    return int(ends["findings"] > 0)


if __name__ == "__main__":
    sys.exit(main())
