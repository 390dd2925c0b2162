# SPDX-License-Identifier: Apache-2.0
"""Targets of the closed loop at random: each is reached, or ended by a fault that says why.

    python -m validation.campaigns.targets [--count 1000] [--seed 1] [--all]

Runners, contacts, drives, sensors, loads and effects are drawn over what real drives span, the
target evenly in the logarithm of its distance. Most such drives cannot step, for their stroke is
less than the contact's deflection, or run off with their load; so only those take part whose steps
lead towards the target, and others back, each by a hundredth of the stroke at least and by two
strokes at most. The others are counted, and with --all take part.

A target counts as reached only where the runner then is as near to it as tolerance and noise allow.
One that is neither reached nor given up when its time is over is a finding, unless the loop still
comes nearer: such ones are counted apart.

Times of those that are reached, without that of the hold and of the readings that are averaged,
are told over the ideal: the distance at the speed of steps that run on, one cycle, the settling of
the ringing to a nanometre and the latency. Scans are as fast as a driver allows, and `settle_time`
is that of the ringing, as docs/states.md says.
"""

from __future__ import annotations

import math
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from stickslip_ros.axis import Axis
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.physics.laws import LAWS
from stickslip_ros.physics.parameters import Parameters
from validation.campaigns.arguments import arguments
from validation.campaigns.drives import EFFECTS
from validation.draws import REAL, anywhere, differing, even, loads, shape, waveform

#: Distance of the targets (m), and what is drawn beside the spans of real drives
FARTHEST = (1e-8, 1e-4)
SPANS = {
    **{name: REAL[name] for name in ("preload", "mass", "mu", "sigma_1", "mu_s", "mu_k")},
    **{"v_stribeck": REAL["v_stribeck"], "frequency": (50.0, 2e4), "slewrate": (10.0, 1000.0)},
    **{"amplitude": (30.0, 300.0), "sensor_rate": (1e2, 1e4), "sensor_noise": (1e-11, 3e-9)},
    **{"target_tolerance": (2e-9, 2e-8), "target_timeout": (0.2, 1.0), "scan_rate": (1e5, 1e6)},
}
#: Odds of each effect, and of a spring
ODDS = 0.15
#: Simulated seconds, seconds of the processor that a target may take
LONGEST, PATIENCE = 60.0, 10.0
#: s, between two looks at the axis; looks by which a runner is judged that was said to be there
LOOK, JUDGED = 0.005, 4
#: Looks between two at the clock of the processor, which takes a millisecond where it is emulated
CLOCK = 20
#: Readings of which the loop takes the mean, docs/states.md
AVERAGED = 10
#: Timeouts of the loop after which a target without an end is a finding, and not only slow
WAITED = 4.0
#: Share of the time over which one that is not there yet has to have come nearer
LATELY = 0.2
#: Standard deviations of a reading by which a runner may be off that was said to be there
SIGMAS = 5.0
#: Steps by which the speed is measured, at least and at most
STEPS, MOST_STEPS = 40, 5000
#: Step of a drive that can step, in strokes, at least and at most: of all, and of the second half
#: alone, for the first few wind the contact up
MOVING, CARRIED = 0.01, 2.0
#: m, that a runner may ring by; s, most that the ideal waits for that
STILL, LONGEST_RINGING = 1e-9, 10.0
#: How an outcome that is no finding begins; what faults are counted by
FINE = ("reached", "nearer", "slow", "fault")
REASONS = ("come no closer", "not stayed", "take it farther", "held by", "solver")


class Outcome(NamedTuple):
    """How a target ended."""

    said: str  #: "reached", the fault, or what is wrong
    late: float = math.nan  #: time over the ideal
    off: float = math.nan  #: mean distance from the target, m
    rings: float = math.nan  #: amplitude about that mean, m


def drawn(seed: int, first: int = 0) -> Iterator[tuple[int, Axis, float, float]]:
    """Yield number, axis, target (m), ideal time (s) for ever, where the parameters make an axis.

    The ideal time is nan where steps do not lead to the target.
    """
    for number in range(first, 10**9):
        draw = np.random.default_rng((seed, number))
        values: dict[str, Any] = {name: even(draw, *span) for name, span in SPANS.items()}
        values |= {"model": str(draw.choice(list(LAWS))), "waveform": waveform(draw)}
        chosen = [effect for effect in EFFECTS if draw.random() < ODDS]
        for name in (name for effect in chosen for name in EFFECTS[effect]):
            values[name] = anywhere(draw, name, REAL.get(name))
        if "memory" in chosen:
            values |= {"actuator": "hysteresis", "actuator_memory": True}
        if "contacts" in chosen:
            values["contacts"] = int(draw.integers(2, 9))
        if draw.random() < ODDS:
            values["spring"] = even(draw, *REAL["spring"])
        values["sensor_latency"] = float(draw.uniform(0.0, 5e-3))
        values |= loads(draw, values["preload"], values["mu"])
        target = even(draw, *FARTHEST) * (1.0 if draw.random() < 0.5 else -1.0)
        try:
            axis = Axis(values | shape(draw, values))
            settling = min(max(ringing(axis, axis.status.stroke), 1e-4), LONGEST_RINGING)
            p = axis.parameters.replace(settle_time=settling)
            shortest = ideal(p, target) + 0.0 * ideal(p, -target)  # nan if they do not lead back
            yield number, Axis(p), target, shortest
        except StickslipError:
            continue


def ringing(axis: Axis, amplitude: float) -> float:
    """Return the time (s) in which the ringing of a runner falls from an amplitude (m) to STILL."""
    decay = max(axis.simulation.plant.contact.sigma_1, 1e-9) / (2.0 * axis.simulation.plant.mass)
    return math.log(max(amplitude / STILL, 1.0)) / decay


def ideal(p: Parameters, target: float) -> float:
    """Return the ideal time (s) to a target (m), nan where steps do not lead there."""
    axis, steps, begun = Axis(p), STEPS, time.process_time()
    axis.command("steps", MOST_STEPS if target > 0.0 else -MOST_STEPS)
    stroke, way, t = axis.status.stroke, math.copysign(1.0, target), 1.0 / p.drive.frequency
    axis.advance((STEPS // 2 + 0.5) * t)
    while True:
        half, done = way * axis.status.mean_step, abs(axis.status.step_count)
        axis.advance((steps + 0.5) * t)
        step, count = way * axis.status.mean_step, abs(axis.status.step_count)
        settled = (step * count - half * done) / max(count - done, 1)
        if not MOVING * stroke < min(settled, step) <= max(settled, step) < CARRIED * stroke:
            return math.nan
        # As far as the target: the first steps under a load are often longer than later ones.
        dear = time.process_time() - begun > 0.2 * PATIENCE
        if steps * step >= abs(target) or steps == MOST_STEPS or dear:
            break
        steps = min(2 * steps, MOST_STEPS)
    late = axis.config.sensor.delay / p.sensor.sensor_rate
    return (
        (abs(target) / step + 1.0) * t + min(ringing(axis, stroke - step), LONGEST_RINGING) + late
    )


def outcome(axis: Axis, target: float, shortest: float) -> Outcome:
    """Return how a target (m) of an axis ends; shortest: the ideal time (s)."""
    p: Parameters = axis.parameters
    begun, away, base = time.process_time(), [-target], [0.0]
    axis.command("position", target)
    while not axis.status.target_reached:
        if axis.fault:
            return Outcome(f"fault: {axis.fault}")
        dear = len(away) % CLOCK == 0 and time.process_time() - begun > PATIENCE
        if dear or axis.state.t > LONGEST:
            before, now = abs(away[int((1.0 - LATELY) * len(away))]), abs(away[-1])
            if now < before - p.closed_loop.target_tolerance:
                return Outcome("nearer")
            loop = p.closed_loop
            if axis.state.t < WAITED * ((loop.target_timeout or LONGEST) + loop.settle_time):
                return Outcome("slow")
            return Outcome(
                f"without end: {now:g} m away after {axis.state.t:.3g} s, {before:g} m before"
            )
        axis.advance(axis.state.t + LOOK)
        away.append(axis.state.x - target)
        base.append(axis.state.x - axis.status.scan_level * axis.config.gain)
    allowed = p.closed_loop.target_tolerance + SIGMAS * p.sensor.sensor_noise
    allowed += p.sensor.sensor_resolution or 0.0
    # The loop sees a runner that creeps under its load as it was when the readings were taken.
    lag = (axis.config.sensor.delay + 0.5 * AVERAGED) / p.sensor.sensor_rate
    creeps = abs(base[-1] - base[-1 - JUDGED]) / (JUDGED * LOOK)
    allowed += creeps * lag
    # As the loop, which averages: a heavy runner rings on long after it has come to rest.
    (told,) = [one.time for one in axis.take_events() if one.outcome == "finished"]
    x = axis.simulation.sample(axis.state.t + np.linspace(0.0, JUDGED * LOOK, 100)).x
    off = abs(float(np.mean(x)) - target)
    rings = 0.5 * float(np.ptp(x))
    told -= max(p.closed_loop.hold_time, AVERAGED / p.sensor.sensor_rate)
    late = told / shortest
    said = "reached" if off <= allowed else f"said to be reached, {off:g} m off"
    return Outcome(said, late, off, rings)


def main(argv: Sequence[str] | None = None) -> int:
    """Print the findings and how many targets ended in which way; return 1 for a finding."""
    args = arguments(__doc__, argv, count=1000, seed=1, first=0, all=False)
    ends: Counter[str] = Counter()
    fine: list[Outcome] = []
    slowest, blocked = 0.0, 0
    for number, axis, target, shortest in drawn(args.seed, args.first):
        if math.isnan(shortest) and not args.all:
            blocked += 1
            continue
        begun = time.process_time()
        try:
            one = outcome(axis, target, shortest)
        except Exception as error:
            one = Outcome(f"{type(error).__name__}: {error}")
        found = one.said
        slowest = max(slowest, time.process_time() - begun)
        if found.startswith(FINE):
            ends[next((reason for reason in REASONS if reason in found), found)] += 1
            fine.append(one)
        else:
            ends["findings"] += 1
            print(
                f"{number}: target {target:g} m: {found}: {differing(axis.parameters)}", flush=True
            )
        if ends.total() >= args.count:
            break
    said = ", ".join(f"{count} {kind}" for kind, count in ends.most_common())
    print(f"{ends.total()} targets: {said}; the slowest took {slowest:.1f} s of the processor")
    print(f"{blocked} drives cannot step to theirs")
    if timed := [one[1:] for one in fine if math.isfinite(one.late)]:
        late, off, rings = np.array(timed).T
        print(
            f"time over the ideal of {len(timed)}: {np.median(late):.2f} in the median, "
            f"{np.quantile(late, 0.95):.2f} in 95 %, {late.max():.2f} at most; off "
            f"{1e9 * np.median(off):.2f} nm, {1e9 * off.max():.2f} nm at most; "
            f"{(rings > STILL).sum()} ring by more than {1e9 * STILL:g} nm"
        )
    return int(ends["findings"] > 0)


if __name__ == "__main__":
    sys.exit(main())
