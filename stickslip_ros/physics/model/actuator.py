# SPDX-License-Identifier: Apache-2.0
"""The deflection of the actuator for a voltage, linear or with hysteresis.

Hysteresis is a sum of play operators, the Prandtl-Ishlinskii operator. A play operator follows the
voltage with a backlash r to either side: it moves only while the voltage pushes one end of its gap.
Their weighted sum with the voltage itself is the deflection (M. A. Krasnosel'skii, A. V.
Pokrovskii, Systems with Hysteresis, Springer 1989; for piezo actuators K. Kuhnen, European Journal
of Control 9 (2003) 407). Between the moments in which one begins to move, the deflection is as
straight as the voltage, so a solver for straight pieces runs it exactly.

A new actuator is a function from parameters to an `Actuator` and a line in ACTUATORS. Over the
full loop from 0 to ``max_voltage`` every one of them deflects by ``gain * max_voltage``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from stickslip_ros.base.arrays import Array, weighted_sum
from stickslip_ros.physics.parameters import ActuatorParameters, ParameterError, Parameters
from stickslip_ros.physics.parameters.bounded_files import FileVersion, load_values, read_small_text

#: Play operators of a loop that is given by its width alone.
OPERATORS = 8
#: Pieces of a segment shorter than this fraction of it are taken for its ends.
_SHORTEST = 1e-9


def _no_thresholds() -> Array:
    return np.empty(0)


@dataclass(frozen=True)
class Actuator:
    """Deflection = elastic * voltage + sum of weights * plays, m; linear without plays."""

    elastic: float  #: m/V
    thresholds: Array = field(default_factory=_no_thresholds)  #: r (V), (operators,)
    weights: Array = field(default_factory=_no_thresholds)  #: m/V, (operators,)

    @classmethod
    def of(cls, p: ActuatorParameters) -> Actuator:
        """Return the actuator that the parameters name; ParameterError if there is none."""
        try:
            kind = ACTUATORS[p.actuator]
        except KeyError:
            raise ParameterError(
                f"actuator is {p.actuator!r}; known: {', '.join(ACTUATORS)}"
            ) from None
        return kind(p)

    @property
    def is_linear(self) -> bool:
        """True if the deflection at a voltage is always the same."""
        return not self.weights.any()

    def rest(self) -> Memory:
        """Return the memory at 0 V without a past: every play in the middle."""
        return Memory(0.0, np.zeros(len(self.thresholds)))

    def deflection(self, memory: Memory) -> float:
        """Return the deflection (m)."""
        return self.elastic * memory.volts + weighted_sum(self.weights, memory.plays)

    def stroke(self, volts: float) -> float:
        """Return the stroke (m) of the closed loop between 0 and volts (V)."""
        moved = np.maximum(volts - 2.0 * self.thresholds, 0.0)
        return float(self.elastic * volts) + weighted_sum(self.weights, moved)

    def volts_for(self, stroke: float) -> float:
        """Return the voltage (V) of the closed loop from 0 that has a stroke (m)."""
        if self.is_linear:
            return stroke / self.elastic
        kinks = [0.0, *np.sort(2.0 * self.thresholds).tolist()]
        start = [volts for volts in kinks if self.stroke(volts) <= stroke][-1]
        slope = self.elastic + float(self.weights[2.0 * self.thresholds <= start].sum())
        return start + (stroke - self.stroke(start)) / slope

    def path(
        self, memory: Memory, duration: float, volt_rate: float
    ) -> tuple[list[tuple[float, float]], Memory]:
        """Return duration (s) and rate (m/s) of each straight piece of one voltage segment."""
        rise = duration * volt_rate
        after = memory.moved(memory.volts + rise, self.thresholds)
        if self.is_linear or rise == 0.0:
            return [(duration, self.elastic * volt_rate)], after
        direction = 1.0 if rise > 0.0 else -1.0
        # Each play is pushed from where the voltage has gone this fraction of its rise.
        gap = memory.plays + direction * self.thresholds - memory.volts
        shares = np.clip(gap / rise, 0.0, 1.0)
        kinks = [0.0]
        for share in np.sort(shares).tolist():
            if share > kinks[-1] + _SHORTEST and share < 1.0 - _SHORTEST:
                kinks.append(share)
        kinks.append(1.0)
        pieces = []
        here = memory
        for start, end in pairwise(kinks):
            there = (
                after if end == 1.0 else memory.moved(memory.volts + end * rise, self.thresholds)
            )
            span = (end - start) * duration
            change = self.deflection(there) - self.deflection(here)
            pieces.append((span, change / span))
            here = there
        return pieces, after

    def follow(
        self,
        memory: Memory,
        durations: Array,
        volt_rates: Array,
    ) -> tuple[Array, Array, Memory]:
        """Return durations (s) and rates (m/s) of the deflection, and the memory after it.

        durations (s) and volt_rates (V/s) of the voltage have shape (segments,). A segment in which
        plays begin to move becomes several; none takes no time.
        """
        spans: list[float] = []
        rates: list[float] = []
        for duration, volt_rate in zip(durations.tolist(), volt_rates.tolist(), strict=True):
            pieces, memory = self.path(memory, duration, volt_rate)
            spans += [span for span, _ in pieces]
            rates += [rate for _, rate in pieces]
        return np.array(spans), np.array(rates), memory


@dataclass(frozen=True)
class Memory:
    """Memory of an actuator: the voltage and the states of its plays, V."""

    volts: float
    plays: Array  #: (operators,)

    def moved(self, volts: float, thresholds: Array) -> Memory:
        """Return the memory after the voltage went straight to volts."""
        plays = np.maximum(volts - thresholds, np.minimum(volts + thresholds, self.plays))
        return Memory(volts, plays)


def _hysteretic(p: ActuatorParameters) -> Actuator:
    """Return the actuator of ``hysteresis_file``, or one whose loop is ``hysteresis`` wide.

    Weights are scaled so that the full loop, 0 to ``max_voltage`` and back, has a stroke of
    ``gain * max_voltage``. Raises ParameterError.
    """
    full = p.max_voltage
    if p.hysteresis_file:
        elastic, thresholds, weights = read_hysteresis(Path(p.hysteresis_file))
    else:
        elastic, thresholds, weights = _even(p.hysteresis, full)
    scale = p.gain_in_force * full / Actuator(elastic, thresholds, weights).stroke(full)
    return Actuator(elastic * scale, thresholds, weights * scale)


def _even(width: float, full: float) -> tuple[float, Array, Array]:
    """Return the linear weight, thresholds (V) and weights of a loop of that width.

    Equal weights at equal spacing up to half of the full voltage: what an even density of plays
    comes to. Both branches of the loop are parabolas then, as in Rayleigh's law. width is that of
    the full loop at half its voltage, a fraction of its stroke.
    """
    share = (np.arange(OPERATORS) + 0.5) / OPERATORS  # of the full voltage that a gap takes
    weight = width / float(np.minimum(share, 1.0 - share).sum())
    weights = np.full(OPERATORS, weight)
    return 1.0 - weighted_sum(weights, 1.0 - share), 0.5 * full * share, weights


def read_hysteresis(path: Path) -> tuple[float, Array, Array]:
    """Return linear weight (m/V), thresholds (V) and weights (m/V) of a file; ParameterError."""
    return _read(FileVersion.of(path))


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
def _read(file: FileVersion) -> tuple[float, Array, Array]:
    path = file.path
    try:
        content = load_values(read_small_text(path))
    except ParameterError:
        raise
    except ValueError:  # without what stands there, for somebody else may have named the file
        raise ParameterError(f"{path} is not a YAML file, or has a key twice") from None
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


def _numbers(path: Path, name: str, values: Any) -> Array:
    """Return a list of finite numbers from 0 on; ParameterError for anything else."""
    given = values if isinstance(values, list) else [values]
    for number, value in enumerate(given, 1):
        if type(value) not in (int, float) or not 0.0 <= value < np.inf:
            raise ParameterError(f"{path}: value {number} of {name} is not a number of 0 or more")
    return np.array(given, float)


def _linear(p: ActuatorParameters) -> Actuator:
    """Return an actuator that deflects by ``gain`` (m/V) at every voltage."""
    return Actuator(p.gain_in_force)


ACTUATORS: Mapping[str, Callable[[ActuatorParameters], Actuator]] = {
    "linear": _linear,
    "hysteresis": _hysteretic,
}


def strokes(p: Parameters, volts: Any) -> Any:
    """Return the stroke (m) of loops between 0 and volts (V): numbers, or columns (points,)."""
    if p.actuator.actuator == "linear":
        return volts * p.actuator.gain_in_force
    if np.ndim(volts) == 0:
        return Actuator.of(p.actuator).stroke(volts)
    actuators = (Actuator.of(p.point(k).actuator) for k in range(len(volts)))
    return np.array([one.stroke(float(v)) for one, v in zip(actuators, volts, strict=True)])


def check_voltage(p: ActuatorParameters, volts: float) -> None:
    """Refuse a level (V) that the amplifier does not give or the ceramics do not bear.

    Below ``min_voltage`` the ceramics lose their polarisation. Raises ParameterError.
    """
    if not volts <= p.max_voltage:
        raise ParameterError(
            f"{volts:g} V is more than max_voltage, {p.max_voltage:g} V: stay below it"
        )
    if not volts >= p.min_voltage:
        raise ParameterError(
            f"{volts:g} V is below min_voltage, {p.min_voltage:g} V, below which the actuator "
            "depolarises: stay above it"
        )
