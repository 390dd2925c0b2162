# SPDX-License-Identifier: Apache-2.0
"""The functions for programs and notebooks; results display themselves as tables.

``from stickslip_ros.library import simulate``; the package itself has all these names, too. Each is
loaded when it is first used.
"""

from typing import TYPE_CHECKING

from stickslip_ros.lazy_names import lazy_names

if TYPE_CHECKING:
    from stickslip_ros.library.compile_ahead import warm_up
    from stickslip_ros.library.derivatives import Sensitivities, StepLengths, sensitivities
    from stickslip_ros.library.exchange import control_system, mujoco_model, write_fmu
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
    from stickslip_ros.library.sweep_plan import SweepError
    from stickslip_ros.library.sweep_result import SweepResult, sweep
    from stickslip_ros.library.waveform_search import (
        ElongatedStep,
        ShapedSlip,
        elongate_step,
        shape_slip,
    )
else:
    __getattr__ = lazy_names(__name__)

__all__ = [
    "ElongatedStep", "Prediction", "PredictionError", "Sensitivities", "ShapedSlip", "SimulatedRun",
    "StateSpace", "StepLengths", "SweepError", "SweepResult", "analyse", "compare",
    "control_system", "elongate_step", "find_runs", "identify_actuator", "linearise",
    "mujoco_model", "predict", "read_measurement", "sensitivities", "shape_slip", "simulate",
    "sweep", "warm_up", "write_fmu",
]  # fmt: skip
