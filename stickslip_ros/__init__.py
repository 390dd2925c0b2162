# SPDX-License-Identifier: Apache-2.0
"""Simulator of piezo stick-slip micro-drives with an elastoplastic contact, for ROS 2.

The names below are the library; each is loaded when it is first used, so that the import alone
costs nothing:

>>> import stickslip_ros as ss
>>> run = ss.simulate("table1_typical", preload=0.5, steps=30)
>>> run.steps.shape
(30,)
>>> print(f"{1e9 * run.step_size:.2f} nm")
130.35 nm

docs/library.md shows them at work and says what stays the same between versions.
"""

from typing import TYPE_CHECKING

from stickslip_ros.base.lazy_names import lazy_names
from stickslip_ros.version import __version__ as __version__

if TYPE_CHECKING:
    from stickslip_ros.axis import Axis, AxisStatus, CommandRefused, Event
    from stickslip_ros.axis.resimulation import Rerun
    from stickslip_ros.base.errors import StickslipError
    from stickslip_ros.client import AxisClient, AxisFault
    from stickslip_ros.emulator import CONTROLLERS, OwnAxes, ServerThread, controller_of
    from stickslip_ros.measurement.actuator_identification import IdentifiedActuator
    from stickslip_ros.measurement.comparison import Comparison
    from stickslip_ros.measurement.identification import Experiment, Fit, IdentificationError, Prior

    # Not from the room: its module of the same name would be found first.
    from stickslip_ros.measurement.identification.identify import identify
    from stickslip_ros.measurement.measurements import (
        analyse,
        compare,
        find_runs,
        identify_actuator,
        read_measurement,
    )
    from stickslip_ros.measurement.metric import ComparisonMetric
    from stickslip_ros.measurement.motion_pair import ComparisonError
    from stickslip_ros.measurement.reading import MeasurementError
    from stickslip_ros.measurement.steps.record import TraceError
    from stickslip_ros.measurement.steps.run import Run
    from stickslip_ros.measurement.twin import Twin, TwinCommand, TwinSettings
    from stickslip_ros.physics.laws import LAWS, Contact, Law, register_law
    from stickslip_ros.physics.parameters import (
        PARAMETERS,
        ParameterError,
        Parameters,
        number,
        read_yaml,
    )
    from stickslip_ros.physics.parameters.extensions import RegistrationError
    from stickslip_ros.physics.waveforms import WAVEFORMS, Shape, register_waveform, with_rows
    from stickslip_ros.recordings import (
        BagError,
        BagWriter,
        TopicDescription,
        decoder_for,
        open_bag,
        recorded_runs,
        recover,
        resimulate,
    )
    from stickslip_ros.simulation import (
        ElongatedStep,
        Motion,
        Prediction,
        PredictionError,
        ShapedSlip,
        SimulatedRun,
        SweepError,
        SweepResult,
        Trace,
        elongate_step,
        predict,
        shape_slip,
        simulate,
        sweep,
        warm_up,
    )

_PLACES = {
    "axis": "Axis AxisStatus CommandRefused Event",
    "axis.resimulation": "Rerun",
    "base.errors": "StickslipError",
    "client": "AxisClient AxisFault",
    "emulator": "CONTROLLERS OwnAxes ServerThread controller_of",
    "measurement.actuator_identification": "IdentifiedActuator",
    "measurement.comparison": "Comparison",
    "measurement.identification": "Experiment Fit IdentificationError Prior",
    "measurement.identification.identify": "identify",
    "measurement.measurements": "analyse compare find_runs identify_actuator read_measurement",
    "measurement.metric": "ComparisonMetric",
    "measurement.motion_pair": "ComparisonError",
    "measurement.reading": "MeasurementError",
    "measurement.steps.record": "TraceError",
    "measurement.steps.run": "Run",
    "measurement.twin": "Twin TwinCommand TwinSettings",
    "physics.laws": "LAWS Contact Law register_law",
    "physics.parameters": "PARAMETERS ParameterError Parameters number read_yaml",
    "physics.parameters.extensions": "RegistrationError",
    "physics.waveforms": "WAVEFORMS Shape register_waveform with_rows",
    "recordings.messages": "decoder_for",
    "recordings.errors": "BagError",
    "recordings.metadata": "TopicDescription",
    "recordings.reader": "open_bag",
    "recordings.recovery": "recover",
    "recordings.resimulation": "resimulate",
    "recordings.runs": "recorded_runs",
    "recordings.writer": "BagWriter",
    "simulation": "ElongatedStep Motion Prediction PredictionError ShapedSlip SimulatedRun "
    "SweepError SweepResult Trace elongate_step predict shape_slip simulate sweep warm_up",
}
__all__ = [
    "CONTROLLERS", "LAWS", "PARAMETERS", "WAVEFORMS", "Axis", "AxisClient", "AxisFault",
    "AxisStatus", "BagError", "BagWriter", "CommandRefused", "Comparison", "ComparisonError",
    "ComparisonMetric", "Contact", "ElongatedStep", "Event", "Experiment", "Fit",
    "IdentificationError", "IdentifiedActuator", "Law", "MeasurementError", "Motion", "OwnAxes",
    "ParameterError", "Parameters", "Prediction", "PredictionError", "Prior", "RegistrationError",
    "Rerun", "Run", "ServerThread", "Shape", "ShapedSlip", "SimulatedRun", "StickslipError",
    "SweepError", "SweepResult", "TopicDescription", "Trace", "TraceError", "Twin", "TwinCommand",
    "TwinSettings", "analyse", "compare", "controller_of", "decoder_for", "elongate_step",
    "find_runs", "identify", "identify_actuator", "number", "open_bag", "predict",
    "read_measurement", "read_yaml", "recorded_runs", "recover", "register_law",
    "register_waveform", "resimulate", "shape_slip", "simulate", "sweep", "warm_up", "with_rows",
]  # fmt: skip

# Type checkers must not see it: to them, any name would then be one of ours.
if not TYPE_CHECKING:
    __getattr__ = lazy_names(__name__, _PLACES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
