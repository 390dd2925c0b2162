# SPDX-License-Identifier: Apache-2.0
"""The free parameters with their bounds and priors.

All are positive and known to a factor at best, so the search works with their logarithms.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.identification.experiment import IdentificationError
from stickslip_ros.identification.settings import SEARCH
from stickslip_ros.laws import LAWS
from stickslip_ros.model.friction import constants_in_force
from stickslip_ros.parameters import Parameters, parameter

#: The lag of the amplifier (s), which is free as a time constant.
LAG = "amplifier_lag"
#: Free parameters by default of a law that names none.
_OF_ANY_LAW = ("sigma_0", "sigma_1")
#: Parameters of the axis, besides those of the friction, that can be free.
_OTHERS = ("mass", "payload", "spring", "gain", "slewrate")


@dataclass(frozen=True)
class Prior:
    """Prior of a parameter: mean and standard deviation, in its unit."""

    mean: float
    deviation: float


@dataclass(frozen=True)
class FreeParameters:
    """The free parameters; arrays have shape (parameters,)."""

    names: tuple[str, ...]
    start: Array  #: logarithms of the starting values
    low: Array  #: logarithms of the lower bounds
    high: Array  #: logarithms of the upper bounds
    priors: Mapping[str, Prior]

    def values(self, theta: Array) -> dict[str, float]:
        """Return the values of the logarithms theta by name."""
        return {name: value_at(name, at) for name, at in zip(self.names, theta, strict=True)}

    def applied(self, base: Parameters, theta: Array) -> Parameters:
        """Return base with the values of theta. ParameterError if the law cannot use them."""
        values = self.values(theta)
        lag = values.pop(LAG, None)
        if lag is not None:
            values["amplifier_bandwidth"] = 1.0 / (2.0 * math.pi * lag)
        return base.replace(**values)

    def with_lag(self, start: float = SEARCH.lag_start) -> FreeParameters:
        """Return these parameters and, as the last, the lag of the amplifier."""
        begin, low, high = np.log(
            np.array([start, SEARCH.lag_low, SEARCH.lag_high]) + SEARCH.lag_knee
        )
        return FreeParameters(
            (*self.names, LAG), np.append(self.start, begin), np.append(self.low, low),
            np.append(self.high, high), {**self.priors, LAG: Prior(0.0, SEARCH.lag_deviation)},
        )  # fmt: skip

    def without_lag(self) -> FreeParameters:
        """Return these parameters without the lag of the amplifier."""
        if LAG not in self.names:
            return self
        priors = {name: one for name, one in self.priors.items() if name != LAG}
        return FreeParameters(
            self.names[:-1], self.start[:-1], self.low[:-1], self.high[:-1], priors
        )

    def prior_residuals(self, theta: Array) -> Array:
        """Return the differences of the values from their priors, in standard deviations."""
        values = self.values(theta)
        return np.array(
            [(values[name] - one.mean) / one.deviation for name, one in self.priors.items()]
        )

    def prior_jacobian(self, theta: Array) -> Array:
        """Return the derivatives of `prior_residuals` by theta."""
        jacobian = np.zeros((len(self.priors), len(self.names)))
        for row, (name, one) in enumerate(self.priors.items()):
            k = self.names.index(name)
            jacobian[row, k] = math.exp(theta[k]) / one.deviation
        return jacobian


def value_at(name: str, theta: float) -> float:
    """Return the value of a free parameter, given the number that the search uses for it."""
    value = math.exp(theta)
    return max(value - SEARCH.lag_knee, 0.0) if name == LAG else value


def unit_of(name: str) -> str:
    """Return the unit of a free parameter."""
    return "s" if name == LAG else parameter(name).unit


def default_names(sets: Sequence[Parameters]) -> tuple[str, ...]:
    """Return the free parameters by default: those of the law."""
    law = LAWS[sets[0].friction.model]
    one = law.free or _OF_ANY_LAW
    # Eq. 13 and 14 follow the normal force in the law.
    forces = {p.friction.preload * p.friction.preload_ratio for p in sets}
    return law.several_free or one if len(forces) > 1 else one


def free_parameters(
    sets: Sequence[Parameters],
    names: Sequence[str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Mapping[str, Prior] | None = None,
) -> FreeParameters:
    """Return the free parameters of sets, one set an experiment.

    Raises IdentificationError and ParameterError.
    """
    bounds, priors = bounds or {}, priors or {}
    chosen = tuple(names) if names else default_names(sets)
    for name in chosen:
        row = parameter(name)
        if row.kind is not float or not (row.group == "friction" or name in _OTHERS):
            raise IdentificationError(
                f"{name} cannot be free: it is no constant of the friction law and none of "
                f"{', '.join(_OTHERS)}"
            )
        hidden, _, form = name.rpartition("_")  # as in sigma_0_slope
        if form in ("slope", "offset") and any(
            getattr(p.friction, hidden, None) is not None for p in sets
        ):
            raise IdentificationError(
                f"{name} has no effect where {hidden} is set; take {hidden} out of the parameters"
            )
    if len(set(chosen)) < len(chosen):
        raise IdentificationError(f"a parameter is named twice: {', '.join(chosen)}")
    for what, given in (("bounds", bounds), ("a prior", priors)):
        for name in given:
            if name not in chosen:
                raise IdentificationError(
                    f"{name} has {what} but is not free; free are {', '.join(chosen)}"
                )
    low, start, high = (np.empty(len(chosen)) for _ in range(3))
    for k, name in enumerate(chosen):
        row = parameter(name)
        value = starting_value(sets[0], name)
        least, most = bounds.get(name, (value / SEARCH.bounds_factor, value * SEARCH.bounds_factor))
        if not (0.0 < least < most < math.inf):
            raise IdentificationError(
                f"the bounds of {name} are {least:g} and {most:g} {row.unit}; "
                "they have to be above 0, the lower one first"
            )
        least, most = max(least, row.low, row.least), min(most, row.high)
        low[k], high[k] = math.log(least), math.log(most)
        start[k] = math.log(min(max(value, least), most))
    return FreeParameters(chosen, start, low, high, priors)


def starting_value(p: Parameters, name: str) -> float:
    """Return the value of a parameter, that of the law where it is not set.

    Raises IdentificationError where there is none above 0.
    """
    value = p.value(name)
    if value is None:
        value = getattr(constants_in_force(p.friction), name, None)
    if value is None or not value > 0.0:
        raise IdentificationError(
            f"{name} has no starting value above 0; set one in the parameters, to within a factor "
            f"of {SEARCH.bounds_factor:g}"
        )
    return float(value)
