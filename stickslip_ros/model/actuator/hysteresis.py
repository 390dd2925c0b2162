# SPDX-License-Identifier: Apache-2.0
"""Where thresholds and weights come from: one number, or a file with identified ones."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from stickslip_ros.model.actuator.play import Actuator
from stickslip_ros.model.number_file import FileVersion, read_text, version_of
from stickslip_ros.parameters import ActuatorParameters, ParameterError
from stickslip_ros.parameters.bounded_yaml import load_values

#: Play operators of a loop that is given by its width alone.
OPERATORS = 8


def hysteretic(p: ActuatorParameters) -> Actuator:
    """Return the actuator of ``hysteresis_file``, or one whose loop is ``hysteresis`` wide.

    Weights are scaled so that the full loop, 0 to ``max_voltage`` and back, has a stroke of
    ``gain * max_voltage``. Raises ParameterError.
    """
    full = p.max_voltage
    if p.hysteresis_file:
        elastic, thresholds, weights = read_hysteresis(Path(p.hysteresis_file))
    else:
        elastic, thresholds, weights = _even(p.hysteresis, full)
    scale = p.gain * full / Actuator(elastic, thresholds, weights).stroke(full)
    return Actuator(elastic * scale, thresholds, weights * scale)


def _even(width: float, full: float) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return the linear weight, thresholds (V) and weights of a loop of that width.

    Equal weights at equal spacing up to half of the full voltage: what an even density of plays
    comes to. Both branches of the loop are parabolas then, as in Rayleigh's law. width is that of
    the full loop at half its voltage, a share of its stroke.
    """
    share = (np.arange(OPERATORS) + 0.5) / OPERATORS  # of the full voltage that a gap takes
    weight = width / float(np.minimum(share, 1.0 - share).sum())
    weights = np.full(OPERATORS, weight)
    return 1.0 - float(weights @ (1.0 - share)), 0.5 * full * share, weights


def read_hysteresis(path: Path) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return linear weight (m/V), thresholds (V) and weights (m/V) of a file; ParameterError."""
    return _read(version_of(path))


def hysteresis_text(actuator: Actuator, remark: str) -> str:
    """Return the text of a file that `read_hysteresis` reads; remark goes into comment lines."""
    content = {
        "elastic": actuator.elastic,
        "thresholds": actuator.thresholds.tolist(),
        "weights": actuator.weights.tolist(),
    }
    lines = "".join(f"# {line}\n" for line in remark.splitlines())
    return f"{lines}{yaml.safe_dump(content, sort_keys=False)}"


@lru_cache(maxsize=8)
def _read(file: FileVersion) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    path = file.path
    try:
        content = load_values(read_text(path))
    except ParameterError:
        raise
    except ValueError:  # without what stands there, for somebody else may have named the file
        raise ParameterError(f"{path} is not a YAML file, or a key stands there twice") from None
    if not isinstance(content, dict) or set(content) != {"elastic", "thresholds", "weights"}:
        raise ParameterError(
            f"{path} has to hold elastic, thresholds and weights, as stickslip identify-actuator "
            "writes them"
        )
    elastic = _numbers(path, "elastic", [content["elastic"]])
    thresholds = _numbers(path, "thresholds", content["thresholds"])
    weights = _numbers(path, "weights", content["weights"])
    if len(thresholds) != len(weights):
        raise ParameterError(
            f"{path}: {len(thresholds)} thresholds, but {len(weights)} weights; each play operator "
            "has one of both"
        )
    if not elastic[0] > 0.0:
        raise ParameterError(f"{path}: elastic is 0; it has to be above 0")
    return float(elastic[0]), thresholds, weights


def _numbers(path: Path, name: str, values: Any) -> NDArray[np.float64]:
    """Return a list of finite numbers from 0 on; ParameterError for anything else."""
    given = values if isinstance(values, list) else [values]
    for number, value in enumerate(given, 1):
        if type(value) not in (int, float) or not 0.0 <= value < np.inf:
            raise ParameterError(
                f"{path}: number {number} of {name} is none; all have to be numbers of 0 or more"
            )
    return np.array(given, float)
