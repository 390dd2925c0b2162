# SPDX-License-Identifier: Apache-2.0
"""The sticking axis as a linear system, for the design of controllers."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.axis.sensor import has_bandwidth
from stickslip_ros.model import Plant
from stickslip_ros.parameters import Parameters, ParameterSource
from stickslip_ros.reporting import html_table


class StateSpace(NamedTuple):
    """``x' = A x + B u``, ``y = C x + D u``, in the form of python-control and SciPy.

    Inputs: the voltage of the actuator (V) and an external force on the runner (N). Outputs: the
    position of the runner (m) and the deflection of the contact (m), both from rest. States: the
    position of the runner (m), and its velocity minus the part that follows the actuator at once
    through the damping (m/s), so that no derivative of the voltage is needed.

    With a lag of the amplifier or a resonance of the actuator their states come first, the voltage
    (V) or the deflection (m) and its rate (m/s). With a bandwidth of the sensor those of its
    low-pass come last, and what it gives is a third output, the reading (m).

    >>> import control
    >>> import stickslip_ros as ss
    >>> axis = control.ss(*ss.linearise("table1_typical"))
    >>> axis.ninputs, axis.noutputs, axis.nstates
    (2, 2, 2)
    """

    A: Array  #: shape (states, states)
    B: Array  #: shape (states, 2): states by inputs
    C: Array  #: shape (outputs, states): outputs by states
    D: Array  #: shape (outputs, 2): outputs by inputs

    @property
    def inputs(self) -> tuple[str, str]:
        """Names of the inputs, for `control.ss(*axis, inputs=axis.inputs)`."""
        return "voltage", "force"

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs, likewise."""
        return ("position", "deflection", "reading")[: len(self.C)]

    def _repr_html_(self) -> str:
        rows = [
            (f"{name}, row {k + 1}", *(f"{value:.6g}" for value in row))
            for name, matrix in zip("ABCD", self, strict=True)
            for k, row in enumerate(matrix)
        ]
        about = f"inputs {', '.join(self.inputs)}; outputs {', '.join(self.outputs)}"
        return html_table(f"the sticking axis as a linear system: {about}", rows)


def linearise(parameters: ParameterSource = None, /, **values: Any) -> StateSpace:
    """Return the axis while its contact sticks: an oscillator on the asperities (Eq. 1, 5, 10).

    With alpha = 0 in Eq. 3 the contact is elastic, and

        m x'' = -sigma_0 (x - u) - (sigma_1 + sigma_2) (x' - u') - k x + F

    with u = gain times the voltage, behind the lag of the amplifier and the resonance of the
    actuator where there are any. It holds while the deflection ``x - u`` stays below the breakaway
    distance z_ba. Hysteresis and creep of the actuator, the slew limit of the amplifier and the
    latency of the sensor are left out.

    Parameters
    ----------
    parameters : Parameters, mapping, path or None
        As in `simulate`.
    **values
        Parameters by name, laid over the others.

    Returns
    -------
    StateSpace
        A, B, C and D.

    Raises
    ------
    ParameterError
        A value is out of range, or unknown.

    Examples
    --------
    >>> import numpy as np
    >>> import stickslip_ros as ss
    >>> A, B, C, D = ss.linearise("table1_typical")
    >>> poles = np.linalg.eigvals(A)
    >>> print(f"rings at {abs(poles[0].imag) / (2 * np.pi):.0f} Hz")
    rings at 7549 Hz
    """
    p = Parameters.of(parameters, **values)
    plant = Plant.of(p)
    mass, stiffness = plant.mass, plant.contact.sigma_0
    damping = plant.contact.sigma_1 + plant.contact.sigma_2
    gain = p.actuator.gain_in_force
    passed = damping / mass  # velocity that a change of u passes on at once, per m
    axis = StateSpace(
        A=np.array([[0.0, 1.0], [-(stiffness + plant.spring) / mass, -passed]]),
        B=np.array([[gain * passed, 0.0], [gain * (stiffness / mass - passed**2), 1.0 / mass]]),
        C=np.array([[1.0, 0.0], [1.0, 0.0]]),
        D=np.array([[0.0, 0.0], [-gain, 0.0]]),
    )
    if p.actuator.actuator_resonance:
        low_pass = _low_pass(p.actuator.actuator_resonance, p.actuator.actuator_damping)
        axis = _with_input_filter(low_pass, axis)
    if p.actuator.amplifier_bandwidth:
        axis = _with_input_filter(_low_pass(p.actuator.amplifier_bandwidth, None), axis)
    if has_bandwidth(p.sensor):
        zeta = p.sensor.sensor_damping if p.sensor.sensor_order == 2 else None
        axis = _with_reading(axis, _low_pass(p.sensor.sensor_bandwidth or 0.0, zeta))
    return axis


LowPass = tuple[Array, Array]  #: A and B; the output is the first state


def _low_pass(bandwidth: float, zeta: float | None) -> LowPass:
    """Return a low-pass of a corner (Hz), of second order if it has a damping zeta."""
    omega = 2.0 * math.pi * bandwidth
    if zeta is None:
        return np.array([[-omega]]), np.array([[omega]])
    square = omega * omega
    return np.array([[0.0, 1.0], [-square, -2.0 * zeta * omega]]), np.array([[0.0], [square]])


def _with_input_filter(low_pass: LowPass, axis: StateSpace) -> StateSpace:
    """Return the axis with its voltage behind a low-pass."""
    A, B = low_pass
    none = np.zeros((len(A), 1))
    take = np.eye(1, len(A))
    return StateSpace(
        A=np.block([[A, np.zeros((len(A), len(axis.A)))], [axis.B[:, :1] @ take, axis.A]]),
        B=np.block([[B, none], [np.zeros((len(axis.A), 1)), axis.B[:, 1:]]]),
        C=np.block([axis.D[:, :1] @ take, axis.C]),
        D=np.block([np.zeros((len(axis.C), 1)), axis.D[:, 1:]]),
    )


def _with_reading(axis: StateSpace, low_pass: LowPass) -> StateSpace:
    """Return the axis with its position behind a low-pass as a further output."""
    A, B = low_pass
    states, more = len(axis.A), len(A)
    return StateSpace(
        A=np.block([[axis.A, np.zeros((states, more))], [B @ axis.C[:1], A]]),
        B=np.block([[axis.B], [B @ axis.D[:1]]]),
        C=np.block(
            [
                [axis.C, np.zeros((len(axis.C), more))],
                [np.zeros((1, states)), np.eye(1, more)],
            ]
        ),
        D=np.block([[axis.D], [np.zeros((1, 2))]]),
    )
