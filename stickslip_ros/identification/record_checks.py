# SPDX-License-Identifier: Apache-2.0
"""What a record and its drive file disagree in, and what a record cannot show, told before a fit.

Each finding is one line with the numbers and the cure. A fit goes on all the same, but where no
record shows the ringing, nothing is claimed of how far its values may be off.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stickslip_ros.identification.experiment import Experiment
from stickslip_ros.identification.settings import RECORD
from stickslip_ros.model import Plant
from stickslip_ros.parameters import PARAMETERS, Parameters
from stickslip_ros.reporting import shown
from stickslip_ros.traces.even_samples import noise_of


def check_record(experiment: Experiment) -> Iterator[str]:
    """Yield what is to be said of a record before it is fitted, a line each."""
    p, motion = experiment.parameters, experiment.motion
    ringing = experiment.ringing.frequency if experiment.ringing else Plant.of(p).ringing_frequency
    rate = 1.0 / motion.spacing
    if rate < RECORD.samples_a_swing * ringing:
        yield (
            f"{motion.source}: {rate / ringing:.2g} samples in a swing of the ringing at "
            f"{ringing:.4g} Hz; sample at {RECORD.samples_a_swing * ringing:.2g} Hz or more, or "
            "the contact cannot be told from another one"
        )
    for run in experiment.runs:
        if run.frequency != p.drive.frequency:
            yield (
                f"{motion.source}: the steps at {run.start:.4g} s come at {run.frequency:.5g} Hz, "
                f"the parameters say {p.drive.frequency:.5g} Hz; correct frequency there"
            )
        if abs(run.steps) < RECORD.few_steps:
            yield (
                f"{motion.source}: the run at {run.start:.4g} s has {abs(run.steps)} steps; "
                f"measure {RECORD.few_steps} or more"
            )
    yield from _sizes(experiment)
    noise, stated = noise_of(motion.x), p.sensor.sensor_noise
    given = stated > 0.0 and stated != PARAMETERS["sensor_noise"].default
    if given and not 1.0 / RECORD.noise_factor < noise / stated < RECORD.noise_factor:
        yield (
            f"{motion.source}: the noise is {shown(noise, 'm', 2)} a sample, the parameters say "
            f"{shown(stated, 'm', 2)}; is the unit of the position right?"
        )


def _sizes(experiment: Experiment) -> Iterator[str]:
    """Yield whether steps are longer than the actuator goes, or hardly there."""
    p, motion = experiment.parameters, experiment.motion
    stroke = p.drive.amplitude * p.actuator.gain
    for run in experiment.runs:
        ends = run.start + np.array([0.0, abs(run.steps)]) / run.frequency
        begin, end = np.interp(ends, motion.t, motion.x)
        step = abs(float(end - begin)) / abs(run.steps)
        if not RECORD.shortest_step < step / stroke < RECORD.longest_step:
            yield (
                f"{motion.source}: steps of {shown(step, 'm', 3)}, where the actuator goes "
                f"{shown(stroke, 'm', 3)}; check the units of the record, amplitude and gain"
            )


def is_too_coarse(experiment: Experiment, found: Parameters) -> bool:
    """Return True if a record has too few samples for the ringing that was found, or seen."""
    seen = experiment.ringing.frequency if experiment.ringing else 0.0
    fastest = max(seen, Plant.of(found).ringing_frequency)
    return 1.0 / experiment.motion.spacing < RECORD.samples_a_swing * fastest
