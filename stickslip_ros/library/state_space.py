# SPDX-License-Identifier: Apache-2.0
"""The sticking axis as a linear system, for the design of controllers."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model import Plant
from stickslip_ros.parameters import Parameters, ParameterSource
from stickslip_ros.reporting import html_table


class StateSpace(NamedTuple):
    """``x' = A x + B u``, ``y = C x + D u``, in the form of python-control and SciPy.

    Inputs: the voltage of the actuator (V) and an external force on the runner (N). Outputs: the
    position of the runner (m) and the deflection of the contact (m), both from rest. States: the
    position of the runner (m), and its velocity minus the part that follows the actuator at once
    through the damping (m/s), so that no derivative of the voltage is needed.

    >>> import control
    >>> import stickslip_ros as ss
    >>> axis = control.ss(*ss.linearise("table1_typical"))
    >>> axis.ninputs, axis.noutputs, axis.nstates
    (2, 2, 2)
    """

    A: NDArray[np.float64]  #: shape (2, 2)
    B: NDArray[np.float64]  #: shape (2, 2): states by inputs
    C: NDArray[np.float64]  #: shape (2, 2): outputs by states
    D: NDArray[np.float64]  #: shape (2, 2): outputs by inputs

    @property
    def inputs(self) -> tuple[str, str]:
        """Names of the inputs, for `control.ss(*axis, inputs=axis.inputs)`."""
        return "voltage", "force"

    @property
    def outputs(self) -> tuple[str, str]:
        """Names of the outputs, likewise."""
        return "position", "deflection"

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

    with u = gain times the voltage. It holds while the deflection ``x - u`` stays below the
    breakaway distance z_ba; hysteresis of the actuator is left out.

    Parameters
    ----------
    parameters : Parameters, mapping, path or None
        As in `simulate`.
    **values
        Parameters by name, laid over the others.

    Returns
    -------
    StateSpace
        A, B, C and D, each of shape (2, 2).

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
    return StateSpace(
        A=np.array([[0.0, 1.0], [-(stiffness + plant.spring) / mass, -passed]]),
        B=np.array([[gain * passed, 0.0], [gain * (stiffness / mass - passed**2), 1.0 / mass]]),
        C=np.array([[1.0, 0.0], [1.0, 0.0]]),
        D=np.array([[0.0, 0.0], [-gain, 0.0]]),
    )
