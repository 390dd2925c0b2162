# SPDX-License-Identifier: Apache-2.0
"""The motion of an axis of ours, simulated again where the samples of its bag do not suffice.

The bag holds the commands, and the same version gives the same motion. Apart from reading, which
needs no solver.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from stickslip_ros.axis.events import NotRepeatable
from stickslip_ros.axis.resimulation import Rerun, model_changes, parameters_of
from stickslip_ros.base.arrays import Array
from stickslip_ros.base.compiled import report_compilation
from stickslip_ros.base.reporting import format_si
from stickslip_ros.base.reporting.terminal import announce_if_slow
from stickslip_ros.measurement.bags.load_motion import LoadedMotion
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.parameters.groups import SLIDER
from stickslip_ros.recordings import open_bag
from stickslip_ros.recordings.runs import RecordedRun, recorded_runs
from stickslip_ros.simulation.motion import Motion

#: Samples of a swing of the ringing that the shape of a slip takes, and those aimed at.
ENOUGH, _AIM = 10.0, 20.0
#: Samples of the ringing that follow a motion.
_RINGS_ON = 60.0 * _AIM
#: Samples while the axis moves, at most: each takes 30 us.
_MOST = 500_000


def finest_motion(path: Path, loaded: LoadedMotion) -> Motion:
    """Return the motion in a file; that of an axis of ours at a rate that shows its slips.

    Where the samples of a bag do not suffice, it holds all commands of the axis from its start on,
    and the model has not changed since, the motion is that of the model, without what the sensor
    adds, at the times of the bag (s) and between them while the axis moves. A line on stderr says
    so.
    """
    with report_compilation(), announce_if_slow("simulating again"):
        finer = _simulated_again(path, loaded)
    return loaded.motion if finer is None else finer


def _simulated_again(path: Path, loaded: LoadedMotion) -> Motion | None:
    motion, origin = loaded.motion, loaded.origin_ns
    if loaded.parameters is None or origin is None:  # no bag, or that of a stranger
        return None
    with open_bag(path) as bag, suppress(NotRepeatable):
        runs = [one for one in recorded_runs(bag) if f"{one.axis_name}{SLIDER}" == loaded.joint]
        swings = max((_ringing_frequency(one) for one in runs), default=0.0)
        if not swings * motion.spacing > 1.0 / ENOUGH:
            return None
        if any(one.missing_events or model_changes(one.events)[1] for one in runs):
            print(
                f"{path.name}: it lacks events, or was recorded with another model, so it is not "
                "simulated again; its samples are taken as they are",
                file=sys.stderr,
            )
            return None
        parts = [
            _states(one, motion.t + 1e-9 * (origin - one.start_ns), 1.0 / (_AIM * swings))
            for one in runs
        ]
        shifts = [1e-9 * (one.start_ns - origin) for one in runs]
        t, x, u = np.concatenate(
            [part + np.array([[shift], [0.0], [0.0]])
             for part, shift in zip(parts, shifts, strict=True)], axis=1,
        )  # fmt: skip
        if len(t) <= len(motion.t):
            return None
        rate = format_si(1.0 / float(np.median(np.diff(t))), "Hz", 3)
        print(
            f"{path.name}: its {format_si(1.0 / motion.spacing, 'Hz', 3)} do not show the slips; "
            f"simulated again from its commands at {rate}, without noise of the sensor",
            file=sys.stderr,
        )
        return replace(motion, t=t, x=x, v=None, u=u)
    return None


def _ringing_frequency(run: RecordedRun) -> float:
    """Return the highest ringing frequency (Hz) of the parameters that a run had."""
    return max(Plant.of(p).ringing_frequency for _, p in parameters_of(run.events))


def _states(run: RecordedRun, recorded: Array, step: float) -> Array:
    """Return time, runner and actuator (s, m) of a run, (3, samples), at the times recorded (s).

    While the axis moves there are samples in between, a step (s) apart or, in a long run, more.
    Raises NotRepeatable.
    """
    end = np.inf if run.end_ns is None else 1e-9 * (run.end_ns - run.start_ns)
    recorded = recorded[(recorded >= 0.0) & (recorded < end)]
    if len(recorded) < 2:
        return np.empty((3, 0))
    rerun = Rerun(run.events)
    states = [(t, *_state(rerun, t)) for t in _times(run, recorded, step).tolist()]
    return np.array(states, dtype=np.float64).reshape(-1, 3).T


def _state(rerun: Rerun, t: float) -> tuple[float, float]:
    state = rerun.advance(t).state
    return state.x, state.u


def _times(run: RecordedRun, recorded: Array, step: float) -> Array:
    """Return the times recorded (s) while the axis rests, and times a step (s) apart beside them.

    A step that goes into no period of the drive meets every part of a slip.
    """
    scout = Rerun(run.events)
    moving = np.array([scout.advance(t).moving for t in recorded.tolist()], dtype=bool)
    moves = moving[:-1] | moving[1:]
    stops = moving | np.append(False, moving[:-1])  # before the next time recorded, and rings on
    last = np.maximum.accumulate(np.where(stops, recorded, -np.inf))
    moves |= recorded[:-1] < last[:-1] + _RINGS_ON * step
    step = max(step, float(np.diff(recorded)[moves].sum()) / _MOST)
    even = step * np.arange(recorded[0] // step + 1.0, recorded[-1] // step + 1.0)
    even = even[moves[np.searchsorted(recorded, even, side="right") - 1]]
    beside = np.ones(len(recorded), dtype=bool)
    beside[:-1] &= ~moves
    beside[1:] &= ~moves
    return np.union1d(recorded[beside], even)
