# SPDX-License-Identifier: Apache-2.0
"""What a program asks: runs, traces, sweeps, predictions, waveforms; the package has these names.

Each is loaded when it is first used.
"""

from typing import TYPE_CHECKING

from stickslip_ros.base.lazy_names import lazy_names

_PLACES = {
    "compile_ahead": "warm_up",
    "motion": "Motion",
    "prediction": "Prediction PredictionError predict",
    "run": "SimulatedRun simulate",
    "sweep_plan": "SweepError",
    "sweep_result": "SweepResult sweep",
    "trace": "Trace",
    "waveform_search": "ElongatedStep ShapedSlip elongate_step shape_slip",
}

if TYPE_CHECKING:
    from stickslip_ros.simulation.compile_ahead import warm_up
    from stickslip_ros.simulation.motion import Motion
    from stickslip_ros.simulation.prediction import Prediction, PredictionError, predict
    from stickslip_ros.simulation.run import SimulatedRun, simulate
    from stickslip_ros.simulation.sweep_plan import SweepError
    from stickslip_ros.simulation.sweep_result import SweepResult, sweep
    from stickslip_ros.simulation.trace import Trace
    from stickslip_ros.simulation.waveform_search import (
        ElongatedStep,
        ShapedSlip,
        elongate_step,
        shape_slip,
    )
else:
    __getattr__ = lazy_names(__name__, _PLACES)

__all__ = [
    "ElongatedStep", "Motion", "Prediction", "PredictionError", "ShapedSlip", "SimulatedRun",
    "SweepError", "SweepResult", "Trace", "elongate_step", "predict", "shape_slip", "simulate",
    "sweep", "warm_up",
]  # fmt: skip
