# SPDX-License-Identifier: Apache-2.0
"""The free parameters with their bounds and priors, and what is unknown beside them.

All parameters are positive and known to a factor at best, so the fit works with their logarithms.
Where a motion was measured, the bounds of the contact's constants follow from its ringing and from
the stroke of the actuator, alike for all friction laws.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.identification.experiment import Experiment, IdentificationError
from stickslip_ros.physics.laws import LAWS
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.model.friction import constants_in_force
from stickslip_ros.physics.parameters import ParameterError, Parameters, parameter

#: The lag of the amplifier (s), and the width (s) of the time over which the instrument averages.
LAG, WIDTH = "amplifier_lag", "sensor_width"
#: Free parameters by default of a law that names none.
_OF_ANY_LAW = ("sigma_0", "sigma_1")
#: Parameters of the axis, besides those of the friction, that can be free.
_OTHERS = ("mass", "payload", "spring", "gain", "slewrate")
#: Factor about its starting value within which a parameter is looked for, where no motion tells.
BOUNDS_FACTOR = 10.0
#: Bounds of the stiffness about that of the ringing, as a factor, and where none is seen; of the
#: damping, as parts of sqrt(stiffness mass).
_ABOUT_RINGING, _WITHOUT_RINGING, _DAMPING = 3.0, 10.0, (1e-3, 3.0)
#: Least deflection (m) of the contact, and the largest in terms of the longest stroke.
_SHORTEST, _LONGEST = 1e-9, 3.0
#: Largest coefficient of friction.
_ROUGHEST = 30.0


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
        return {name: math.exp(at) for name, at in zip(self.names, theta, strict=False)}

    def applied(self, base: Parameters, theta: Array) -> Parameters:
        """Return base with the values of theta. ParameterError if the law cannot use them.

        Where mu_k is free, its ratio to mu_s stays.
        """
        values = self.values(theta)
        if "mu_k" in values and "mu_s" not in values:
            values["mu_s"] = values["mu_k"] * base.friction.mu_s / base.friction.mu_k
        return base.replace(**values)

    def applied_or_none(self, base: Parameters, theta: Array) -> Parameters | None:
        """Return `applied`, None if the law cannot use the values."""
        try:
            return self.applied(base, theta)
        except ParameterError:
            return None

    def prior_residuals(self, theta: Array) -> Array:
        """Return the differences of the values from their priors, in standard deviations."""
        values = self.values(theta)
        return np.array([(values[name] - p.mean) / p.deviation for name, p in self.priors.items()])

    def prior_jacobian(self, theta: Array) -> Array:
        """Return the derivatives of `prior_residuals` by theta."""
        jacobian = np.zeros((len(self.priors), len(self.names)))
        for row, (name, one) in enumerate(self.priors.items()):
            k = self.names.index(name)
            jacobian[row, k] = math.exp(theta[k]) / one.deviation
        return jacobian


@dataclass(frozen=True)
class Nuisance:
    """An unknown beside the parameters, with a prior about 0 in its own unit."""

    name: str
    unit: float  #: of the unknown, SI
    deviation: float  #: of the prior, in that unit
    low: float  #: bounds, in that unit
    high: float
    #: Parameters with a value of it, in that unit; None: it is of the instrument.
    change: Callable[[Parameters, float], Parameters] | None = None


def lag_of_amplifier() -> Nuisance:
    """Return the lag of an amplifier: 2 us is ordinary, so its root mean square is 1.15 us."""

    def lagging(p: Parameters, lag: float) -> Parameters:
        seconds = 1e-6 * lag
        if seconds < _NO_LAG:
            return p
        return p.replace(amplifier_bandwidth=1.0 / (2.0 * math.pi * seconds))

    return Nuisance(LAG, 1e-6, 1.15, 0.0, 20.0, lagging)


#: Lag (s) that moves nothing.
_NO_LAG = 1e-9
#: Bandwidth (Hz) of a slow sensor, whose time constant is the root mean square of widths.
_SLOW_SENSOR = 2e4


def width_of_sensor(spacing: float) -> Nuisance:
    """Return the squared width of the time (us) over which an instrument averages.

    Means over the spacing of the samples (s) have a twelfth of its square, a sensor of first order
    the square of its time constant.
    """
    usual = 1e12 * ((2.0 * math.pi * _SLOW_SENSOR) ** -2 + spacing**2 / 12.0)
    return Nuisance(WIDTH, 1e-12, usual, 0.0, 30.0 * usual)


def uncertain_input(name: str, part: float) -> Nuisance:
    """Return the error of an input that is known to a part of it, alike in all runs."""

    def changed(p: Parameters, deviations: float) -> Parameters:
        return p.replace(**{name: p.value(name) * math.exp(part * deviations)})

    return Nuisance(name, part, 1.0, -6.0, 6.0, changed)


def unit_of(name: str) -> str:
    """Return the unit of a free parameter."""
    return "s" if name in (LAG, WIDTH) else parameter(name).unit


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
    experiments: Sequence[Experiment] = (),
) -> FreeParameters:
    """Return the free parameters of sets, one set an experiment.

    Bounds that are not given follow from measured experiments. Raises IdentificationError and
    ParameterError.
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
    measured = _bounds_of(experiments) if experiments else {}
    low, start, high = (np.empty(len(chosen)) for _ in range(3))
    for k, name in enumerate(chosen):
        row = parameter(name)
        value = starting_value(sets[0], name)
        usual = measured.get(name, (value / BOUNDS_FACTOR, value * BOUNDS_FACTOR))
        least, most = bounds.get(name, usual)
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
            f"of {BOUNDS_FACTOR:g}"
        )
    return float(value)


def stiffness_of(experiments: Sequence[Experiment]) -> tuple[float, bool]:
    """Return the stiffness of the contact (N/m), and whether ringing shows it.

    Without ringing it is that of Eq. 14 with the constants of the paper.
    """
    for one in experiments:
        if one.ringing is not None:
            mass, ringing = Plant.of(one.parameters).mass, one.ringing
            square = (2.0 * math.pi * ringing.frequency) ** 2 + ringing.decay**2
            found = mass * square - (one.parameters.runner.spring or 0.0)
            if found > 0.0:
                return found, True
    return 5e6 * experiments[0].parameters.friction.preload + 7e6, False


def _bounds_of(experiments: Sequence[Experiment]) -> dict[str, tuple[float, float]]:
    """Return the bounds of constants of the contact that measured motions leave."""
    first = experiments[0].parameters
    stiff, rings = stiffness_of(experiments)
    mass, preload = Plant.of(first).mass, first.friction.preload * first.friction.preload_ratio
    longest = _LONGEST * max(
        one.parameters.drive.amplitude * one.parameters.actuator.gain_in_force
        for one in experiments
    )
    factor = _ABOUT_RINGING if rings else _WITHOUT_RINGING
    damping = math.sqrt(stiff * mass)
    mu = 1.0 if first.friction.model == "ceim_without_mu" else first.friction.mu
    return {
        "sigma_0": (stiff / factor, stiff * factor),
        "sigma_1": (_DAMPING[0] * damping, _DAMPING[1] * damping),
        "z_ba": (_SHORTEST, longest),
        "z_ss": (_SHORTEST, longest),
        "sigma_0ss": (preload * mu / longest, preload * mu / _SHORTEST),
        "mu_k": (
            max(1e-3, _SHORTEST * stiff / preload),
            min(_ROUGHEST, longest * stiff / preload),
        ),
    }
