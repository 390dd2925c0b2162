# SPDX-License-Identifier: Apache-2.0
"""Identified parameters with their uncertainty: many random sets, and the band that they make.

A fitted file of ``stickslip identify`` holds, in a comment, the values, the ends of their 95 %
intervals and the correlations of their logarithms.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.errors import StickslipError
from stickslip_ros.library.operating_points import batch_of
from stickslip_ros.parameters import ParameterError, Parameters, parameter
from stickslip_ros.parameters.bounded_files import read_small_text
from stickslip_ros.reporting import CONFIDENCE, format_si
from stickslip_ros.reporting.terminal import format_rows
from stickslip_ros.traces.steps import settled_mean

#: Percentiles at the ends of a band
BAND = (2.5, 97.5)
_LINE = re.compile(r"^# ensemble: (\{.*\})$", re.MULTILINE)


class EnsembleError(StickslipError, ValueError):
    """The file has no ensemble, or no set can be drawn from it; the message names the cure."""


@dataclass(frozen=True)
class Ensemble:
    """Parameters as an identification found them, SI units, one entry a parameter."""

    names: tuple[str, ...]
    values: tuple[float, ...]
    low: tuple[float, ...]  #: of the 95 % interval
    high: tuple[float, ...]
    correlations: tuple[tuple[float, ...], ...]  #: of the logarithms

    def draw(self, count: int, seed: int = 1) -> dict[str, Array]:
        """Draw values of each parameter, (count,): logarithms normal, a width for each side."""
        matrix = np.array(self.correlations)
        sizes, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
        normal = np.random.default_rng(seed).standard_normal((count, len(self.names)))
        # Rounding may leave an eigenvalue below 0.
        drawn = normal * np.sqrt(np.maximum(sizes, 0.0)) @ vectors.T
        found = {}
        for k, name in enumerate(self.names):
            middle = math.log(self.values[k])
            below = (middle - math.log(self.low[k])) / CONFIDENCE
            above = (math.log(self.high[k]) - middle) / CONFIDENCE
            wide = np.where(drawn[:, k] < 0.0, below, above) * drawn[:, k]
            row = parameter(name)
            found[name] = np.clip(np.exp(middle + wide), row.low, row.high)
        return found

    def comment(self) -> str:
        """Return the line that `read_ensemble` finds."""
        return f"ensemble: {json.dumps(asdict(self))}"


def read_ensemble(path: Path) -> Ensemble:
    """Return the ensemble in a fitted file. Raises EnsembleError."""
    try:
        found = _LINE.search(read_small_text(path))
    except ValueError as error:
        raise EnsembleError(f"{path}: {error}") from None
    if not found:
        raise EnsembleError(
            f"{path} holds no ensemble; write it with stickslip identify --out, uninterrupted"
        )
    return _parse(found[1], path)


def find_ensemble(path: Path) -> Ensemble | None:
    """Return the ensemble in a parameter file, None if it holds none; EnsembleError if damaged."""
    try:
        found = _LINE.search(read_small_text(path))
    except ValueError:  # a file of the package is known by its name alone
        return None
    return _parse(found[1], path) if found else None


def _parse(text: str, path: Path) -> Ensemble:
    try:
        given = json.loads(text)
        rows = tuple(tuple(float(one) for one in row) for row in given["correlations"])
        names = tuple(parameter(str(name)).name for name in given["names"])
        values, low, high = (
            tuple(float(one) for one in given[key]) for key in ("values", "low", "high")
        )
        ensemble = Ensemble(names, values, low, high, rows)
    except (ValueError, KeyError, TypeError, ParameterError) as error:
        raise EnsembleError(f"{path}: the ensemble is damaged ({error}); identify again") from None
    shapes = {len(one) for one in (names, values, low, high, rows, *rows)}
    numbers = np.array([*values, *low, *high])
    if len(shapes) != 1 or not (
        len(names) and (np.isfinite(numbers) & (numbers > 0.0)).all() and np.isfinite(rows).all()
    ):
        raise EnsembleError(f"{path}: the ensemble is damaged; identify again")
    return ensemble


@dataclass(frozen=True)
class Band:
    """Runs of an ensemble: where 95 % of them lie; arrays have shape (steps,)."""

    draws: int  #: that can run
    impossible: int  #: draws that the law has no contact for
    step_size: tuple[float, float]  #: m
    backstep: tuple[float, float]  #: m
    low: Array  #: position after each cycle, m
    high: Array

    @classmethod
    def of(cls, p: Parameters, ensemble: Ensemble, steps: int, draws: int, seed: int = 1) -> Band:
        """Simulate steps from rest (sign: direction) with all sets. EnsembleError."""
        columns = p.replace(**ensemble.draw(draws, seed))
        batch, possible = batch_of(columns, draws, 1 if steps >= 0 else -1)
        if not possible.any():
            raise EnsembleError("not one draw of the ensemble makes a contact; identify again")
        position, backstep = batch.run(abs(steps), possible)
        position, backstep = position[possible], backstep[possible]
        sizes = settled_mean(np.diff(position, prepend=0.0, axis=-1))
        low, high = np.percentile(position, BAND, axis=0)
        return cls(
            int(possible.sum()), int((~possible).sum()), ends(sizes), ends(settled_mean(backstep)),
            low, high,
        )  # fmt: skip

    @property
    def spans(self) -> dict[str, tuple[float, float]]:
        """Between which values 95 % of the draws lie, m: step size, backstep, last position."""
        last = float(self.low[-1]), float(self.high[-1])
        return {"step size": self.step_size, "backstep": self.backstep, "position": last}

    def report(self) -> str:
        """Return one line for each span."""
        rows = [("95 % of", f"{self.draws} draws of the ensemble lie within:")]
        for name, (low, high) in self.spans.items():
            rows.append((name, f"{format_si(low, 'm', 6)} to {format_si(high, 'm', 6)}"))
        return format_rows(rows)

    def as_json(self) -> dict[str, Any]:
        """Return the spans for JSON, SI units; the position after each cycle."""
        spans = {**self.spans, "position": (self.low, self.high)}
        named = {name.replace(" ", "_"): dict(zip(("low", "high"), pair, strict=True))
                 for name, pair in spans.items()}  # fmt: skip
        return {"draws": self.draws, "impossible": self.impossible, **named}


def ends(values: Array) -> tuple[float, float]:
    """Return between which values 95 % lie; nan without any."""
    known = values[np.isfinite(values)]
    if not len(known):
        return math.nan, math.nan
    low, high = np.percentile(known, BAND)
    return float(low), float(high)
