# SPDX-License-Identifier: Apache-2.0
"""The axis for other programs: python-control, co-simulation (FMI 3), MuJoCo.

In all of them a voltage is held over a sample, as a digital controller gives it out: the voltage
goes there at the slewrate, then stays. Within the sample the solver runs from event to event.
"""

from __future__ import annotations

import copy
import tempfile
from collections import OrderedDict
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_ros.arrays import Array
from stickslip_ros.compiled import report_compilation
from stickslip_ros.laws.law import ALWAYS_PLASTIC
from stickslip_ros.model import Plant
from stickslip_ros.model.actuator import Actuator
from stickslip_ros.model.actuator_chain import has_chain
from stickslip_ros.model.drive_cycle import DriveCycle
from stickslip_ros.parameters import ParameterError, Parameters, ParameterSource
from stickslip_ros.parameters.parameters import yaml_text
from stickslip_ros.solver.driven import simulation_of
from stickslip_ros.waveforms.built_in import PER_MICROSECOND

if TYPE_CHECKING:
    import control

#: Samples of which a system of python-control keeps the state, to be asked again
_KEPT = 1000
#: Mass (kg) of the carriage in MuJoCo, which whoever moves it puts where it has to be
_CARRIAGE = 1.0


class SampledAxis:
    """An axis at rest at 0 that a voltage drives, sample by sample.

    >>> from stickslip_ros.library.exchange import SampledAxis
    >>> axis = SampledAxis(slewrate=100.0)
    >>> axis.hold(10.0, 1e-3)
    >>> print(f"{1e9 * axis.position:.2f} nm")
    8.05 nm
    """

    def __init__(self, parameters: ParameterSource = None, /, **values: Any) -> None:
        """Take parameters as `simulate` does; ParameterError."""
        p = self.parameters = Parameters.of(parameters, **values)
        if not (Actuator.of(p.actuator).is_linear or has_chain(p.actuator)):
            raise ParameterError(
                "actuator has a hysteresis and actuator_memory is off, so that only its settled "
                "cycles are known: set actuator_memory"
            )
        self._simulation = simulation_of(p, Plant.of(p))
        self.voltage = 0.0  #: V, at the end of the last sample

    def hold(self, voltage: float, duration: float) -> None:
        """Go to a voltage (V) and hold it until a sample of duration (s) is over; ParameterError.

        The voltage is clipped to the range of the actuator.
        """
        p, simulation = self.parameters, self._simulation
        voltage = min(max(voltage, p.actuator.min_voltage), p.actuator.max_voltage)
        change = voltage - self.voltage
        rise = abs(change) / (p.drive.slewrate * PER_MICROSECOND)
        if not rise < duration:
            raise ParameterError(
                f"{abs(change):g} V take {rise:g} s at the slewrate, and a sample {duration:g} s: "
                "raise the slewrate, or take longer samples"
            )
        with report_compilation():
            if change:
                durations = np.array([rise, duration - rise])
                rates = np.array([p.actuator.gain_in_force * change / rise, 0.0])
                simulation.start(DriveCycle(durations, rates, -1, 1, 0), 1)
            simulation.advance(simulation.t + duration)
        self.voltage = voltage

    @property
    def position(self) -> float:
        """Position of the runner, m."""
        return self._simulation.x

    @property
    def state(self) -> Array:
        """Position (m), velocity (m/s), mean deflection of the contacts (m), voltage (V)."""
        now = self._simulation.state
        return np.array([now.x, now.v, now.z, self.voltage])


def control_system(
    parameters: ParameterSource = None, /, *, period: float = 1e-3, **values: Any
) -> control.NonlinearIOSystem:
    """Return the axis as a discrete system of python-control, sampled each period (s).

    Input is the voltage (V), output the position (m). The system goes on from the states that it
    has been in, beginning at rest (0, 0, 0, 0): effects with a past need more than the four numbers
    that python-control sees. So it can be simulated and put into loops, not linearised; that does
    `linearise`.

    Parameters
    ----------
    parameters : Parameters, mapping, path or None
        As in `simulate`.
    period : float
        Duration of a sample, s.
    **values
        Parameters by name, laid over the others.

    Returns
    -------
    control.NonlinearIOSystem
        Input ``voltage``, output ``position``, with the states of `SampledAxis.state`.

    Raises
    ------
    ParameterError
        A value is out of range; later, if a voltage is not reached within a sample.

    Examples
    --------
    >>> import control
    >>> import numpy as np
    >>> import stickslip_ros as ss
    >>> axis = ss.control_system(preload=0.4, period=1e-3)
    >>> t = np.arange(5) * 1e-3
    >>> run = control.input_output_response(axis, t, np.full(5, 10.0), np.zeros(4))
    >>> print((1e9 * run.outputs).round(2))
    [0.   8.05 4.09 5.82 5.19]
    """
    import control

    first = SampledAxis(parameters, **values)
    reached: OrderedDict[bytes, SampledAxis] = OrderedDict({np.zeros(4).tobytes(): first})

    def update(_: float, state: Any, inputs: Any, __: Any) -> Array:
        try:
            axis = copy.deepcopy(reached[(np.asarray(state, float) + 0.0).tobytes()])
        except KeyError:
            raise ValueError(
                "the axis never was in this state: begin at rest, with zeros"
            ) from None
        axis.hold(float(np.ravel(inputs)[0]), period)
        reached[(axis.state + 0.0).tobytes()] = axis
        if len(reached) > _KEPT:
            reached.popitem(last=False)
            reached.setdefault(np.zeros(4).tobytes(), first)
        return axis.state

    return control.NonlinearIOSystem(
        update, lambda _, state, __, ___: state[:1], dt=period, name="axis",
        inputs=["voltage"], outputs=["position"],
        states=["runner_position", "velocity", "deflection", "held_voltage"],
    )  # fmt: skip


#: The script in an FMU: its class name is the name of the model
_SLAVE = """\
from pathlib import Path

from pythonfmu3 import Fmi3Causality, Fmi3Slave, Fmi3Variability, Float64
from stickslip_ros.library.exchange import SampledAxis


class StickslipAxis(Fmi3Slave):
    description = "a piezo stick-slip axis; the voltage is held over each step"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time = self.voltage = self.position = self.velocity = self.deflection = 0.0
        clock = {"causality": Fmi3Causality.independent}
        self.register_variable(
            Float64("time", variability=Fmi3Variability.continuous, **clock))
        self.register_variable(Float64("voltage", causality=Fmi3Causality.input))
        for name in ("position", "velocity", "deflection"):
            self.register_variable(Float64(name, causality=Fmi3Causality.output))
        self.axis = SampledAxis(str(Path(self.resources) / "axis.yaml"))

    def do_step(self, current_time, step_size):
        self.axis.hold(self.voltage, step_size)
        self.position, self.velocity, self.deflection, _ = map(float, self.axis.state)
        return True
"""


def write_fmu(
    path: str | PathLike[str], parameters: ParameterSource = None, /, **values: Any
) -> Path:
    """Write the axis as a unit for co-simulation (FMI 3.0), and return its path.

    Input is the voltage (V), held over each step; outputs are position (m), velocity (m/s) and
    deflection (m). The unit is made by pythonfmu3 (extra ``fmu``) and needs Python with this
    package where it runs.

    Parameters
    ----------
    path : str or path
        Where to write ``StickslipAxis.fmu``: a folder.
    parameters : Parameters, mapping, path or None
        As in `simulate`.
    **values
        Parameters by name, laid over the others.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ParameterError
        A value is out of range.

    Examples
    --------
    >>> import stickslip_ros as ss
    >>> ss.write_fmu("models", preload=0.4)  # doctest: +SKIP
    PosixPath('models/StickslipAxis.fmu')
    """
    from pythonfmu3.builder import FmuBuilder

    p = SampledAxis(parameters, **values).parameters
    with tempfile.TemporaryDirectory() as folder:
        script, table = Path(folder, "stickslipaxis.py"), Path(folder, "axis.yaml")
        script.write_text(_SLAVE, encoding="utf-8")
        table.write_text(yaml_text(p), encoding="utf-8")
        return Path(FmuBuilder.build_FMU(script, dest=path, project_files=[table]))


def mujoco_model(
    parameters: ParameterSource = None, /, *, timestep: float = 1e-7, **values: Any
) -> str:
    """Return a runner on a LuGre contact as a model (MJCF) for MuJoCo 3.8 or later.

    The contact is a ``dcmotor`` without a motor, which has nothing but LuGre friction, between the
    joints ``actuator`` and ``runner``. MuJoCo has no joint that follows a course: before each step
    set position and velocity of ``actuator`` to those of the piezo.

    Parameters
    ----------
    parameters : Parameters, mapping, path or None
        As in `simulate`, with one contact and ``model=lugre``.
    timestep : float
        Step of MuJoCo, s; the contact of Table 1 needs a tenth of a microsecond.
    **values
        Parameters by name, laid over the others.

    Returns
    -------
    str
        The text of the XML file.

    Raises
    ------
    ParameterError
        Another law, for MuJoCo has LuGre alone.

    Examples
    --------
    >>> import stickslip_ros as ss
    >>> text = ss.mujoco_model(model="lugre", preload=0.4)
    >>> "lugre=" in text
    True
    """
    p = Parameters.of(parameters, **values)
    plant = Plant.of(p)
    c = plant.contact
    if c.kind != ALWAYS_PLASTIC or plant.contacts:
        raise ParameterError(
            f"model is {p.friction.model} with {p.friction.contacts} contacts; MuJoCo knows LuGre "
            "friction alone: set model to lugre and contacts to 1"
        )
    lugre = f"{c.sigma_0!r} {c.sigma_1!r} {c.sigma_0 * c.z_k!r} {c.sigma_0 * c.z_s!r} {c.v_s!r}"
    return f"""<mujoco model="stick-slip axis">
  <option timestep="{timestep!r}" gravity="{plant.force / plant.mass!r} 0 0" integrator="Euler"/>
  <worldbody>
    <body name="actuator">
      <joint name="actuator" type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="{_CARRIAGE!r}" diaginertia="1 1 1"/>
    </body>
    <body name="runner">
      <joint name="runner" type="slide" axis="1 0 0" stiffness="{plant.spring!r}"/>
      <inertial pos="0 0 0" mass="{plant.mass!r}" diaginertia="1 1 1"/>
    </body>
  </worldbody>
  <tendon>
    <fixed name="slide">
      <joint joint="runner" coef="1"/>
      <joint joint="actuator" coef="-1"/>
    </fixed>
  </tendon>
  <actuator>
    <dcmotor name="contact" tendon="slide" input="none" motorconst="0 0" resistance="1"
      lugre="{lugre}" damping="{c.sigma_2!r}"/>
  </actuator>
</mujoco>
"""
