# SPDX-License-Identifier: Apache-2.0
"""The step in closed form, at low frequency and steep slip: step = stroke - a0 (paper, section 6).

All lengths below are in units of z_ba, all times in units of 1/omega, omega = sqrt(sigma_0 / m):

    lambda = z_lim / z_ba    limit of z in sliding (CEIM: z_lim = mu f / sigma_0ss)
    zeta   = sigma_1 / (2 m omega)    damping ratio
    tau    = omega (time of the slip)
    rho    = (rate of the rise of u), small at low frequency

Before the slip the contact is at rest, z = 0. a0 has four parts:

1. *The contact winds up.* Along the path r = x - u, z follows dz/dr = 1 - alpha(z) z / lambda from
   0 to z_e; the rest of the path, A - z_e, is plastic.
2. *The runner is pulled back* while the slip lasts: by tau^2 <<z>> + 2 zeta tau <z>, with the
   single and double mean of z over the slip; it gains the speed -(tau <z> + 2 zeta z_e).
3. *The contact unwinds and overshoots*, a free oscillation with the damping ratio zeta. A swing
   that would reach a > 1 goes a distance p(a) plastically, from the balance of energy
   a^2 - 1 = 2 integral of z dr; it stops at z_m < a. The next swing is z_m exp(-pi zeta').
4. *The rise goes on* meanwhile: rho tau.

    a0 = z_e + tau^2 <<z>> + 2 zeta tau <z> + p_1 - p_2 + ... - rho tau          (in z_ba)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy  # its parts load when they are used, which takes half a second

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.base.reporting import MEASURED, SIMULATED, draw_lines, format_si, html_table
from stickslip_ros.base.reporting.terminal import format_rows
from stickslip_ros.physics.laws.law import ELASTOPLASTIC
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.model.waveforms import drive_of, drives_of
from stickslip_ros.physics.parameters import PARAMETERS, Parameters, ParameterSource
from stickslip_ros.simulation.left_out import EFFECTS, left_out

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Steps along a path; swings that are followed
_STEPS, _SWINGS = 200, 40
#: Amplitudes of a picture
_POINTS = 80
#: Halvings for the steady z, to the last bit; lifetimes after which nothing is missing of it
_HALVINGS, _LIFETIMES = 52, 25.0


class PredictionError(StickslipError, ValueError):
    """An axis that the closed form is not for; the message names the value and the limit."""


class Range(NamedTuple):
    """Where the closed form holds."""

    low: float
    high: float
    what: str  #: for people
    cure: str


RANGES = {
    "lambda": Range(
        0.02, 3.0, "limit of the deflection over breakaway distance", "change mu, sigma_0ss or z_ba"
    ),
    "zeta": Range(0.0, 0.2, "damping ratio of the ringing", "lower sigma_1, or simulate"),
    "tau": Range(0.0, 0.7, "time of the slip, in radians of the ringing", "raise the slewrate"),
    "s": Range(1.1, 4.0, "z_ss over z_ba", "change z_ss"),
    "left": Range(
        0.0,
        0.3,
        "what the contact still rings when the next slip begins, over z_ba",
        "lower the frequency",
    ),
}


@dataclass(frozen=True)
class Prediction:
    """A step as the closed form has it, SI units."""

    step: float  #: m
    error: float  #: that 99 of 100 steps of the solver differ by at most, m
    stroke: float  #: deflection of the actuator, peak to peak, m
    zero_offset: float  #: a0 = stroke - step, m
    amplitude: float  #: V
    #: Effects of the parameters that the form is without; the error does not count them
    left_out: tuple[str, ...] = ()

    def report(self) -> str:
        """Return one line for each of amplitude, stroke, a0 and step."""
        return format_rows(self._rows())

    def _repr_html_(self) -> str:
        return html_table("Predicted step", self._rows())

    def _rows(self) -> list[tuple[str, str]]:
        step = f"{format_si(self.step, 'm', 5)}, within {format_si(self.error, 'm', 2)}"
        return [
            ("amplitude", f"{self.amplitude:.5g} V"),
            ("stroke", format_si(self.stroke, "m", 5)),
            ("a0", format_si(self.zero_offset, "m", 4)),
            ("step", step),
        ]


class Numbers(NamedTuple):
    """An axis without dimensions; numbers or arrays of one shape."""

    stroke: Any  #: over z_ba
    limit: Any  #: lambda
    zeta: Any
    tau: Any
    rho: Any  #: rate of the rise in z_ba omega
    s: Any  #: z_ss / z_ba
    rest: Any  #: time from slip to slip

    @classmethod
    def of(cls, plant: Plant, p: Parameters) -> Numbers:
        """Return the numbers of one plant or of columns."""
        c = plant.contact
        omega = np.sqrt(c.sigma_0 / plant.mass)  # the paper's Eq. 10, undamped
        slip = p.drive.amplitude / p.drive.slewrate * 1e-6
        stroke = p.actuator.gain_in_force * p.drive.amplitude / c.z_ba
        rest = omega * (1.0 / p.drive.frequency - slip)
        zeta = c.sigma_1 / (2.0 * plant.mass * omega)
        return cls(stroke, c.z_k / c.z_ba, zeta, omega * slip, stroke / rest, c.z_ss / c.z_ba, rest)

    def with_range(self, left: Any) -> dict[str, Any]:
        """Return the numbers that `RANGES` limits, by name; left: ringing at the slip, in z_ba."""
        return {
            "lambda": self.limit, "zeta": self.zeta, "tau": self.tau, "s": self.s, "left": left,
        }  # fmt: skip

    def error(self, left: Array) -> Any:
        """Return the error (in z_ba) that 99 of 100 steps of the solver differ by at most."""
        winding = 0.002 + 0.01 * self.tau**4 + 0.001 * self.limit
        return winding + 0.12 * self.zeta * self.limit + 1.3 * left

    def step(self) -> tuple[Array, Array]:
        """Return the step and the ringing left at the next slip, in z_ba; each (points,)."""
        n = Numbers(*np.broadcast_arrays(*self))
        sliding = _steady(n)
        _, single, double = _slide(n.stroke, n, sliding)
        swept = n.tau / n.stroke
        # The runner goes back while the contact winds up, which shortens the path.
        path = n.stroke + n.rho * n.tau - double * swept**2 - 2.0 * n.zeta * single * swept
        end, _, _ = _slide(np.maximum(path, 0.0), n, sliding)
        speed = -(single * swept + 2.0 * n.zeta * end)
        step = path - end
        phi = np.sqrt(1.0 - np.minimum(n.zeta, 0.99) ** 2)
        sine = (speed + n.zeta * end) / phi
        lag, begun = np.arctan2(n.zeta, phi), np.arctan2(-sine, end)
        time = (np.pi - lag - begun) / phi
        reach = np.hypot(end, sine) * np.exp(-n.zeta * time) * np.cos(lag)
        sign = -1.0
        for _ in range(_SWINGS):
            plastic = reach > 1.0
            if not plastic.any():
                break
            stopped, path = _swing(np.maximum(reach, 1.0), n)
            step = step + sign * np.where(plastic, path, 0.0)
            reach = np.where(plastic, stopped, reach) * np.exp(-np.pi * n.zeta / phi)
            time, sign = time + np.pi / phi, -sign
        left = reach * np.exp(-n.zeta * (n.rest - time))
        return step, np.where(n.rest > time + np.pi / phi, left, np.inf)


def predict(
    parameters: ParameterSource = None, /, *, step: float | None = None, **values: Any
) -> Prediction:
    """Return the step of an axis in closed form: stroke less a0, without a simulation.

    The form holds at low frequency and steep slip (docs/prediction.md); its ``error`` is stated.

    Parameters
    ----------
    parameters : Parameters, mapping, path or None
        As in `simulate`.
    step : float, optional
        A wanted step, m: the amplitude that makes it is found; that of the parameters plays no
        part.
    **values
        Parameters by name, laid over the others.

    Returns
    -------
    Prediction
        Step, its error, stroke, 0-offset and amplitude.

    Raises
    ------
    PredictionError
        The closed form does not hold for the axis, or the step is out of reach.
    ParameterError
        A value is out of range, or unknown.

    Examples
    --------
    >>> import stickslip_ros as ss
    >>> found = ss.predict("table1_typical")
    >>> print(f"{1e9 * found.stroke:.0f} nm - {1e9 * found.zero_offset:.1f} nm")
    160 nm - 26.1 nm
    >>> print(f"{ss.predict('table1_typical', step=100e-9).amplitude:.1f} V")
    236.2 V
    """
    p = Parameters.of(parameters, **values)
    if step is not None:
        p = p.replace(amplitude=_amplitude_for(p, step))
    plant = _fitting(p)
    numbers = Numbers.of(plant, p)
    sizes, left = Numbers(*(np.atleast_1d(one) for one in numbers)).step()
    _check(numbers, float(left[0]))
    z_ba = plant.contact.z_ba
    stroke = p.actuator.gain_in_force * p.drive.amplitude
    size = z_ba * float(sizes[0])
    error = z_ba * float(np.ravel(numbers.error(left))[0])
    lacks = left_out(p, EFFECTS)
    return Prediction(size, error, stroke, stroke - size, p.drive.amplitude, lacks)


def steps_over(p: Parameters, volts: Array) -> tuple[Array, Array]:
    """Return steps and their errors (m) over amplitudes (V), nan where the form does not hold.

    All have the shape (points,). PredictionError if the form is not made for the axis.
    """
    plant, varied = _fitting(p), p.replace(amplitude=volts)
    numbers = Numbers.of(plant, varied)
    sizes, left = numbers.step()
    holds = drives_of(varied, len(volts), 1)[1]
    for name, found in numbers.with_range(left).items():
        holds = holds & (found >= RANGES[name].low) & (found <= RANGES[name].high)
    lengths = plant.contact.z_ba * np.stack(
        [sizes, np.broadcast_to(numbers.error(left), holds.shape)]
    )
    step, error = np.where(holds, lengths, np.nan)
    return step, error


def plot_steps(p: Parameters, found: Prediction, axes: Axes | None = None) -> Axes:
    """Draw the steps of all amplitudes that the form holds for, with their error, and the found."""
    volts = np.linspace(0.0, p.actuator.max_voltage, _POINTS + 1)[1:]
    step, error = steps_over(p, volts)
    lines = [
        (volts, step, "-", SIMULATED, "prediction"),
        (np.array([found.amplitude]), np.array([found.step]), "o", MEASURED, "asked for"),
    ]
    axes = draw_lines(axes, lines, "amplitude (V)", "step (m)")
    factor = np.ravel(axes.lines[-1].get_ydata())[0] / found.step  # of the prefix that suits
    low, high = factor * (step - error), factor * (step + error)
    axes.fill_between(volts, low, high, color=SIMULATED, alpha=0.2, linewidth=0)
    return axes


def _amplitude_for(p: Parameters, step: float) -> float:
    """Return the amplitude (V) that makes a step (m). Raises PredictionError."""
    lowest = 1e-6 * p.actuator.max_voltage
    highest = min(p.actuator.max_voltage, 0.999 * p.drive.slewrate / p.drive.frequency * 1e6)
    plant = _fitting(p.replace(amplitude=highest))
    # A slip that takes longer is out of the form's range, and its step may be anything.
    omega = math.sqrt(plant.contact.sigma_0 / plant.mass)
    longest = RANGES["tau"].high * p.drive.slewrate * 1e6 / omega
    cure = "raise max_voltage" if highest < longest else "raise the slewrate"
    highest = min(highest, longest)

    def size(q: Parameters, volts: float) -> float:
        q = q.replace(amplitude=volts)
        plant = Plant.of(q)
        found, _ = Numbers(*(np.atleast_1d(one) for one in Numbers.of(plant, q))).step()
        return float(found[0]) * plant.contact.z_ba

    if not 0.0 < step < math.inf:
        raise PredictionError(f"the step is {step:g} m; it has to be above 0")
    most = size(p, highest)
    if most < step:
        lower = p.friction.preload * RANGES["lambda"].low * plant.contact.z_ba / plant.contact.z_k
        if step <= size(p.replace(preload=max(lower, PARAMETERS["preload"].low)), highest):
            cure += ", or lower the preload"
        raise PredictionError(
            f"a step of {format_si(step, 'm')} is out of reach: {highest:g} V make "
            f"{format_si(max(most, 0.0), 'm')}, of a stroke of "
            f"{format_si(p.actuator.gain_in_force * highest, 'm')}; {cure}"
        )
    # Below its breakaway distance no stroke makes a step.
    low = max(lowest, 0.5 * plant.contact.z_ba / p.actuator.gain_in_force)
    return float(
        scipy.optimize.brentq(
            lambda volts: size(p, volts) - step,
            min(low, 0.5 * highest), highest, xtol=1e-9 * highest,
        )
    )  # fmt: skip


def _fitting(p: Parameters) -> Plant:
    """Return the plant of an axis that the closed form is made for. PredictionError if not."""
    plant, d = Plant.of(p), p.drive
    drive_of(p)
    c = plant.contact
    if c.kind != ELASTOPLASTIC or c.z_k != c.z_s:
        raise PredictionError(
            f"model {p.friction.model} has no closed form: its limit of z depends on the speed, or "
            "it has no breakaway distance; take ceim, or simulate"
        )
    if d.waveform != "sawtooth" or p.actuator.actuator != "linear":
        raise PredictionError(
            f"the closed form is for a sawtooth on a linear actuator, not for {d.waveform} on a "
            f"{p.actuator.actuator} one; simulate"
        )
    loads = {"external force": plant.force, "spring": plant.spring, "sigma_2": c.sigma_2}
    for name, value in loads.items():
        if value != 0.0:
            raise PredictionError(f"the closed form is without {name}, here {value:g}; simulate")
    return plant


def _check(numbers: Numbers, left: float) -> None:
    for name, found in numbers.with_range(left).items():
        value, allowed = float(found), RANGES[name]
        if not allowed.low <= value <= allowed.high:
            size = f"{value:.3g}" if math.isfinite(value) else "above 1"
            raise PredictionError(
                f"the closed form is not for this axis: {allowed.what}, is {size}; it has to "
                f"lie between {allowed.low:g} and {allowed.high:g}: {allowed.cure}"
            )


def _alpha(z: Array, s: Array) -> Array:
    part = np.clip((z - 1.0) / (s - 1.0), 0.0, 1.0)
    return 0.5 - 0.5 * np.cos(np.pi * part)


def _slope(z: Array, n: Numbers) -> Array:
    return 1.0 - _alpha(z, n.s) * z / n.limit


def _steady(n: Numbers) -> tuple[Array, Array]:
    """Return the z at which the contact slides steadily, and the path over which it gets there."""
    low, high = np.ones_like(n.limit), np.maximum(n.s, n.limit)
    for _ in range(_HALVINGS):
        z = 0.5 * (low + high)
        slides = _slope(z, n) < 0.0
        low, high = np.where(slides, low, z), np.where(slides, z, high)
    z = np.maximum(0.5 * (low + high), 1.0)
    # Linear equation about z: the distance to the limit shrinks with exp(-rate r).
    part = np.clip((z - 1.0) / (n.s - 1.0), 0.0, 1.0)
    growth = 0.5 * np.pi * np.sin(np.pi * part) / (n.s - 1.0)
    rate = (_alpha(z, n.s) + growth * z) / n.limit
    return z, z - 1.0 + _LIFETIMES / rate


def _slide(path: Array, n: Numbers, sliding: tuple[Array, Array]) -> tuple[Array, Array, Array]:
    """Return z after a path from 0, its integral and its double integral over it.

    From z = 1 on by Runge-Kutta steps of fourth order, until the contact slides steadily; sliding
    is the result of `_steady`.
    """
    steady, reached = sliding
    rest = np.maximum(path - 1.0, 0.0)
    h = np.minimum(rest, reached) / _STEPS
    z = np.minimum(path, 1.0)
    single, double = 0.5 * z * z, z**3 / 6.0
    for _ in range(_STEPS):
        k1 = _slope(z, n)
        k2 = _slope(z + 0.5 * h * k1, n)
        k3 = _slope(z + 0.5 * h * k2, n)
        new = z + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + _slope(z + h * k3, n))
        double = double + h * single + h * h * (2.0 * z + new) / 6.0
        single, z = single + 0.5 * h * (z + new), new
    rest = np.maximum(rest - reached, 0.0)
    z = np.where(rest > 0.0, steady, z)
    return z, single + rest * z, double + rest * single + 0.5 * rest * rest * z


def _swing(reach: Array, n: Numbers) -> tuple[Array, Array]:
    """Return where a swing stops that would reach so far elastically, and its plastic path.

    Marches in the energy e = a^2 - z^2, de = -2 z dr.
    """
    h = (reach * reach - 1.0) / _STEPS
    z, path = np.ones_like(reach), np.zeros_like(reach)

    def slope(z: Array) -> Array:
        return 0.5 * _slope(z, n) / z

    for _ in range(_STEPS):
        k1 = slope(z)
        k2 = slope(z + 0.5 * h * k1)
        k3 = slope(z + 0.5 * h * k2)
        new = z + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(z + h * k3))
        path, z = path + 0.25 * h * (1.0 / z + 1.0 / new), new
    return z, path - (z - 1.0)
