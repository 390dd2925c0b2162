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

from stickslip_ros import simulation
from stickslip_ros.lazy_names import lazy_names
from stickslip_ros.version import __version__ as __version__

if TYPE_CHECKING:
    from stickslip_ros.axis import Axis, AxisStatus, CommandRefused, Event
    from stickslip_ros.client import AxisClient, AxisFault
    from stickslip_ros.errors import StickslipError
    from stickslip_ros.identification import Experiment, Fit, IdentificationError, Prior

    # Not from the room: its module of the same name would be found first.
    from stickslip_ros.identification.identify import identify
    from stickslip_ros.laws import register_law
    from stickslip_ros.measurement import Comparison, ComparisonError, ComparisonMetric
    from stickslip_ros.measurement.actuator_identification import IdentifiedActuator
    from stickslip_ros.measurement.reading import MeasurementError
    from stickslip_ros.measurement.steps.record import TraceError
    from stickslip_ros.measurement.steps.run import Run
    from stickslip_ros.motion.motion import Motion
    from stickslip_ros.motion.trace import Trace
    from stickslip_ros.parameters import PARAMETERS, ParameterError, Parameters, read_yaml
    from stickslip_ros.recordings import BagError, open_bag, recorded_runs, resimulate
    from stickslip_ros.simulation import *  # noqa: F403
    from stickslip_ros.waveforms import register_waveform

__all__ = [
    "PARAMETERS", "Axis", "AxisClient", "AxisFault", "AxisStatus", "BagError", "CommandRefused",
    "Comparison", "ComparisonError", "ComparisonMetric", "Event", "Experiment", "Fit",
    "IdentificationError", "IdentifiedActuator", "MeasurementError", "Motion", "ParameterError",
    "Parameters", "Prior", "Run", "StickslipError", "Trace", "TraceError",
    "identify", "open_bag", "read_yaml", "recorded_runs", "register_law", "register_waveform",
    "resimulate",
]  # fmt: skip
__all__ += simulation.__all__

_PLACES = {
    "axis": "Axis AxisStatus CommandRefused Event",
    "client": "AxisClient AxisFault",
    "errors": "StickslipError",
    "identification": "Experiment Fit IdentificationError Prior",
    "identification.identify": "identify",
    "simulation": " ".join(simulation.__all__),
    "laws": "register_law",
    "measurement": "Comparison ComparisonError ComparisonMetric",
    "measurement.actuator_identification": "IdentifiedActuator",
    "measurement.reading": "MeasurementError",
    "measurement.steps.record": "TraceError",
    "measurement.steps.run": "Run",
    "parameters": "PARAMETERS ParameterError Parameters read_yaml",
    "recordings.errors": "BagError",
    "recordings.reader": "open_bag",
    "recordings.resimulation": "resimulate",
    "recordings.runs": "recorded_runs",
    "motion.motion": "Motion",
    "motion.trace": "Trace",
    "waveforms": "register_waveform",
}

# Type checkers must not see it: to them, any name would then be one of ours.
if not TYPE_CHECKING:
    __getattr__ = lazy_names(__name__, _PLACES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
