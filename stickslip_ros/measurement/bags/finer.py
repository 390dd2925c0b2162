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
from numpy.typing import NDArray

from stickslip_ros.axis.events import NotRepeatable
from stickslip_ros.axis.resimulation import Rerun, model_changes, parameters_of
from stickslip_ros.base.arrays import Array
from stickslip_ros.base.compiled import report_compilation
from stickslip_ros.base.reporting import format_si
from stickslip_ros.base.reporting.terminal import announce_if_slow
from stickslip_ros.measurement.bags.load_motion import LoadedMotion
from stickslip_ros.physics.model import Plant
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
    if loaded.parameters is None or loaded.origin_ns is None:  # no bag, or that of a stranger
        return loaded.motion
    with report_compilation(), announce_if_slow("simulating again"), suppress(NotRepeatable):
        return _simulated_again(path, loaded.motion, loaded.origin_ns, loaded.node)
    return loaded.motion


def _simulated_again(path: Path, motion: Motion, origin_ns: int, node: str | None) -> Motion:
    """Return the motion of the axis of a node at a finer rate; itself where that is of no use.

    Its times count from an origin (ns). Raises NotRepeatable.
    """
    with open_bag(path) as bag:
        runs = [one for one in recorded_runs(bag) if one.node == node]
    swings = [Plant.of(p).ringing_frequency for one in runs for _, p in parameters_of(one.events)]
    if not max(swings, default=0.0) * motion.spacing > 1.0 / ENOUGH:
        return motion
    if any(one.missing_events or model_changes(one.events)[1] for one in runs):
        print(
            f"{path.name}: it lacks events, or was recorded with another model, so it is not "
            "simulated again; its samples are taken as they are",
            file=sys.stderr,
        )
        return motion
    finer = []
    for one in runs:
        start = 1e-9 * (one.start_ns - origin_ns)
        t, *states = _states(one, motion.t - start, 1.0 / (_AIM * max(swings)))
        finer.append(np.stack([t + start, *states]))
    t, x, u = np.concatenate(finer, axis=1)
    if len(t) <= len(motion.t):
        return motion
    rate = format_si(1.0 / float(np.median(np.diff(t))), "Hz", 3)
    print(
        f"{path.name}: its {format_si(1.0 / motion.spacing, 'Hz', 3)} do not show the slips; "
        f"simulated again from its commands at {rate}, without noise of the sensor",
        file=sys.stderr,
    )
    return replace(motion, t=t, x=x, v=None, u=u)


def _states(run: RecordedRun, recorded: Array, step: float) -> Array:
    """Return time, runner and actuator (s, m) of a run, (3, samples), at the times recorded (s).

    While the axis moves there are samples in between, a step (s) apart or, in a long run, more.
    Raises NotRepeatable.
    """
    end = np.inf if run.end_ns is None else 1e-9 * (run.end_ns - run.start_ns)
    recorded = recorded[(recorded >= 0.0) & (recorded < end)]
    if len(recorded) < 2:
        return np.empty((3, 0))
    scout, rerun = Rerun(run.events), Rerun(run.events)
    moving = np.array([scout.advance(t).moving for t in recorded.tolist()], dtype=bool)
    t = _times(recorded, moving, step)
    states = ((state.x, state.u) for at in t.tolist() for state in (rerun.advance(at).state,))
    return np.vstack([t, np.array(list(states)).T])


def _times(recorded: Array, moving: NDArray[np.bool_], step: float) -> Array:
    """Return the times recorded (s) while the axis rests, and times a step (s) apart beside them.

    moving says of each recorded time whether the axis moves then. The ringing after a motion is
    part of it. A step that goes into no period of the drive meets every part of a slip.
    """
    stops = moving | np.append(False, moving[:-1])  # before the next time recorded, and rings on
    last = np.maximum.accumulate(np.where(stops, recorded, -np.inf))
    moves = moving[:-1] | moving[1:] | (recorded[:-1] < last[:-1] + _RINGS_ON * step)
    step = max(step, float(np.diff(recorded)[moves].sum()) / _MOST)
    even = step * np.arange(recorded[0] // step + 1.0, recorded[-1] // step + 1.0)
    even = even[moves[np.searchsorted(recorded, even, side="right") - 1]]
    rests = ~(np.append(moves, False) | np.append(False, moves))
    return np.union1d(recorded[rests], even)
