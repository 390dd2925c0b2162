# SPDX-License-Identifier: Apache-2.0
"""Everything compiled ahead, so that later runs begin at once."""

from __future__ import annotations

from collections.abc import Mapping

from stickslip_ros.axis import Axis
from stickslip_ros.base.compiled import report_compilation
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.simulation.phases import regime_now
from stickslip_ros.simulation.sampling import trace_steps
from stickslip_ros.simulation.steps import run_steps
from stickslip_ros.simulation.sweep_metrics import METRICS
from stickslip_ros.simulation.sweep_plan import Sweep, SweepAxis

#: Drives that use different parts of the solver, by name.
_DRIVES: tuple[Mapping[str, object], ...] = (
    {},
    {"model": "lugre"},
    {"model": "epm_calc", "preload": 1.0},
    {"frequency": 10e3},
    {"spring": 1e6, "inclination": 0.1},
    {"sigma_1": 2000.0},
    {"creep": 0.01, "dwell_growth": 0.02, "surface_spread": 0.1},
    {"actuator_resonance": 8e5},
)
_SEVERAL = {"contacts": 2, "contact_spread": 0.1}


def warm_up() -> None:
    """Compile all that runs, axes, nodes and sweeps use, unless that was done; report the progress.

    The result is kept on disk for every later process. Put it into the recipe of an image, or into
    the job that fills a cache of CI.

    Examples
    --------
    >>> import stickslip_ros as ss
    >>> ss.warm_up()
    """
    with report_compilation():
        axis = Axis({})  # first, for those wait for it
        axis.compile_ahead()
        regime_now(axis.simulation)
        stopped = Axis({"travel_high": 1e-7})
        stopped.command("steps", 3)
        stopped.advance(0.05)
        trace_steps({}, 2)
        for values in _DRIVES:
            run_steps(values, 3)
            run_steps(values, -3)
        for metric in METRICS:
            Sweep(Parameters(), (SweepAxis.of("preload", 0.4),), (metric,), 12).evaluate(0, 1)
        regime_now(Axis({"model": "ceim_ageing"}).simulation)
        trace_steps(_SEVERAL, 2)  # last, for few have several contacts
        for chain in ({}, {"creep": 0.01, "actuator_resonance": 8e5, "surface_spread": 0.1}):
            axis = Axis({**_SEVERAL, **chain})
            axis.compile_ahead()
            regime_now(axis.simulation)
