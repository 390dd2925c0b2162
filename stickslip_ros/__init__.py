# SPDX-License-Identifier: Apache-2.0
"""Simulator of piezo stick-slip micro-drives with an elastoplastic contact, for ROS 2.

The names below are the library; each is loaded when it is first used, so that the import alone
costs nothing:

>>> import stickslip_ros as ss
>>> run = ss.simulate(preload=0.5, steps=30)
>>> run.steps.shape
(30,)
>>> print(f"{1e9 * run.step_size:.2f} nm")
130.35 nm

docs/library.md shows them at work and says what stays the same between versions.
"""

from typing import TYPE_CHECKING

from stickslip_ros.late_names import late_names
from stickslip_ros.version import __version__ as __version__

if TYPE_CHECKING:
    from stickslip_ros.axis import Axis, AxisStatus, CommandRefused, Event
    from stickslip_ros.client import AxisClient, AxisFault
    from stickslip_ros.errors import StickslipError
    from stickslip_ros.identification import Experiment, Fit, IdentificationError, Prior

    # Not from the room: its module of the same name would be found first.
    from stickslip_ros.identification.identify import identify
    from stickslip_ros.library.compile_ahead import warm_up
    from stickslip_ros.library.grid import SweepError
    from stickslip_ros.library.measurements import (
        analyse,
        compare,
        find_runs,
        identify_actuator,
        read_measurement,
    )
    from stickslip_ros.library.prediction import Prediction, PredictionError, predict
    from stickslip_ros.library.run import SimulatedRun, simulate
    from stickslip_ros.library.state_space import StateSpace, linearise
    from stickslip_ros.library.sweep_result import SweepResult, sweep
    from stickslip_ros.library.waveform_search import (
        ElongatedStep,
        ShapedSlip,
        elongate_step,
        shape_slip,
    )
    from stickslip_ros.measurement import Comparison, ComparisonError, ComparisonMetric
    from stickslip_ros.measurement.actuator_identification import IdentifiedActuator
    from stickslip_ros.measurement.reading import MeasurementError
    from stickslip_ros.parameters import PARAMETERS, ParameterError, Parameters, read_yaml
    from stickslip_ros.recordings import BagError, open_bag, recorded_runs, resimulate
    from stickslip_ros.traces import StepAnalysis, Trace, TraceError
    from stickslip_ros.traces.motion import Motion
    from stickslip_ros.traces.runs import Run

#: The public names, by the module that each is loaded from.
_NAMES = {
    "axis": ("Axis", "AxisStatus", "CommandRefused", "Event"),
    "client": ("AxisClient", "AxisFault"),
    "errors": ("StickslipError",),
    "identification": ("Experiment", "Fit", "IdentificationError", "Prior", "identify"),
    "library.measurements": (
        "analyse", "compare", "find_runs", "identify_actuator", "read_measurement",
    ),
    "library.prediction": ("Prediction", "PredictionError", "predict"),
    "library.run": ("SimulatedRun", "simulate"),
    "library.state_space": ("StateSpace", "linearise"),
    "library.grid": ("SweepError",),
    "library.sweep_result": ("SweepResult", "sweep"),
    "library.compile_ahead": ("warm_up",),
    "library.waveform_search": ("ElongatedStep", "ShapedSlip", "elongate_step", "shape_slip"),
    "measurement": ("Comparison", "ComparisonError", "ComparisonMetric"),
    "measurement.actuator_identification": ("IdentifiedActuator",),
    "measurement.reading": ("MeasurementError",),
    "parameters": ("PARAMETERS", "ParameterError", "Parameters", "read_yaml"),
    "recordings": ("BagError", "open_bag", "recorded_runs", "resimulate"),
    "traces": ("StepAnalysis", "Trace", "TraceError"),
    "traces.motion": ("Motion",),
    "traces.runs": ("Run",),
}  # fmt: skip

__all__ = [
    "PARAMETERS", "Axis", "AxisClient", "AxisFault", "AxisStatus", "BagError", "CommandRefused",
    "Comparison", "ComparisonError", "ComparisonMetric", "ElongatedStep", "Event", "Experiment",
    "Fit", "IdentificationError", "IdentifiedActuator", "MeasurementError", "Motion",
    "ParameterError", "Parameters", "Prediction", "PredictionError", "Prior", "Run", "ShapedSlip",
    "SimulatedRun", "StateSpace", "StepAnalysis", "StickslipError", "SweepError", "SweepResult",
    "Trace", "TraceError", "analyse", "compare", "elongate_step", "find_runs", "identify",
    "identify_actuator", "linearise", "open_bag", "predict", "read_measurement", "read_yaml",
    "recorded_runs", "resimulate", "shape_slip", "simulate", "sweep", "warm_up",
]  # fmt: skip

# Type checkers must not see it: to them, any name would then be one of ours.
if not TYPE_CHECKING:
    __getattr__ = late_names(__name__, _NAMES, renamed={"Metric": "ComparisonMetric"})


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
