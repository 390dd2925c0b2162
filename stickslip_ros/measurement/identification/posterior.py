# SPDX-License-Identifier: Apache-2.0
"""What a fit knows of its parameters, kept in a comment of the fitted file for those who read it.

The line holds the values, the ends of their 95 % intervals and the correlations of their
logarithms. It begins with "ensemble", as since 0.2.0.
"""

from __future__ import annotations

import json
import re
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from stickslip_ros.base.errors import StickslipError
from stickslip_ros.physics.parameters import ParameterError, parameter
from stickslip_ros.physics.parameters.bounded_files import read_small_text

_LINE = re.compile(r"^# ensemble: (\{.*\})$", re.MULTILINE)


class PosteriorError(StickslipError, ValueError):
    """The file's line is damaged; the message names the cure."""


@dataclass(frozen=True)
class Posterior:
    """Parameters as an identification found them, SI units, one entry a parameter."""

    names: tuple[str, ...]
    values: tuple[float, ...]
    low: tuple[float, ...]  #: of the 95 % interval
    high: tuple[float, ...]
    correlations: tuple[tuple[float, ...], ...]  #: of the logarithms

    def comment(self) -> str:
        """Return the line that `find_posterior` finds."""
        return f"ensemble: {json.dumps(asdict(self))}"


def find_posterior(path: Path) -> Posterior | None:
    """Return what a parameter file says of its fit, None if nothing; PosteriorError if damaged."""
    try:
        found = _LINE.search(read_small_text(path))
    except ValueError:  # a file of the package is known by its name alone
        return None
    return _parse(found[1], path) if found else None


def _parse(text: str, path: Path) -> Posterior:
    try:
        given = json.loads(text)
        rows = tuple(tuple(float(one) for one in row) for row in given["correlations"])
        names = tuple(parameter(str(name)).name for name in given["names"])
        values, low, high = (
            tuple(float(one) for one in given[key]) for key in ("values", "low", "high")
        )
        posterior = Posterior(names, values, low, high, rows)
    except (ValueError, KeyError, TypeError, ParameterError) as error:
        raise PosteriorError(
            f"{path}: the line '# ensemble' is damaged ({error}); identify again"
        ) from None
    shapes = {len(one) for one in (names, values, low, high, rows, *rows)}
    numbers = np.array([*values, *low, *high])
    if len(shapes) != 1 or not (
        len(names) and (np.isfinite(numbers) & (numbers > 0.0)).all() and np.isfinite(rows).all()
    ):
        raise PosteriorError(f"{path}: the line '# ensemble' is damaged; identify again")
    return posterior
