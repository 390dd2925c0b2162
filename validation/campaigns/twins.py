# SPDX-License-Identifier: Apache-2.0
"""The twin beside an axis that somebody else integrates: alarms, intervals, predictions, causes.

    python -m validation.campaigns.twins WHAT COUNT [FIRST_SEED]

WHAT is alarms (runs without a change), told (changes of the preload by 20 and 5 %), intervals
(random axes from what the twin holds for likely, and a prediction of 500 steps of each), moves
(open loop, in COUNT parts, while the preload falls by 30 %) or causes (a change of each at random,
in moves at random with one drive or two). The motion of alarms and told is integrated once; noise
is another one in every run.
"""

from __future__ import annotations

import copy
import math
import time
from collections import Counter
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from stickslip_ros.measurement.twin import Twin, TwinCommand, TwinSettings
from stickslip_ros.measurement.twin.changes import CAUSES
from stickslip_ros.measurement.twin.timeline import OperatingPoint
from stickslip_ros.measurement.twin.tracker import THETA
from stickslip_ros.physics.parameters import Parameters
from validation.campaigns.arguments import arguments
from validation.twin_axis import Hidden, Log, RealAxis, feed

Array = NDArray[np.float64]
P = Parameters.of(frequency=100.0)
NOISE = 2e-9  # m
CHANGE = 2.0  # s


def _noisy(log: Log, seed: int) -> Log:
    random = np.random.default_rng(seed)
    return [
        one if isinstance(one, TwinCommand) else (one[0], one[1] + NOISE * random.standard_normal())
        for one in log
    ]


def alarms(count: int, first: int) -> None:
    """Count false alarms in runs that last as long as the interval that is set."""
    axis = RealAxis(P, lambda *_: Hidden(), noise=0.0)
    axis.step(400)
    told = 0
    for seed in range(first, first + count):
        twin = Twin(P, TwinSettings(false_alarm_interval=4.0))
        told += sum(one.changed for one in feed(twin, _noisy(axis.log, seed)) if one)
    upper = 0.5 * chi2.ppf(0.95, 2 * (told + 1))
    print(f"{told} alarms in {count} runs of one interval; 95 % bound {upper:.0f}, limit {count}")


def told(count: int, first: int) -> None:
    """Print the cycles until a change is told, of 20 and 5 % of the preload."""
    for factor, bar in ((0.8, 50), (0.95, 500)):

        def story(t: float, _: float, factor: float = factor) -> Hidden:
            return Hidden(preload=factor if t >= CHANGE - 1e-9 else 1.0)

        axis = RealAxis(P, story, noise=0.0)
        axis.step(200 + bar)
        cycles, early = [], 0
        for seed in range(first, first + count):
            twin = Twin(P)
            for one in feed(twin, _noisy(axis.log, seed)):
                if one and one.changed:
                    early += one.t < CHANGE
                    cycles.append((one.t - CHANGE) * 100.0)
                    break
        print(
            f"preload {factor:g}: {len(cycles)} of {count} told within {bar} cycles, {early} early"
        )
        print(f"  cycles: median {np.median(cycles):.0f}, most {max(cycles):.0f}")


def intervals(count: int, first: int) -> None:
    """Count intervals that hold the truth, of axes that creep from values at random."""
    held: Counter[str] = Counter()
    widths = []
    for seed in range(first, first + count):
        random = np.random.default_rng(seed)
        start, gain = np.exp(random.normal(0.0, [0.05, 0.01]))
        creep = TwinSettings().drift_hour * math.sqrt(0.01 / 3600.0)  # of a logarithm in a cycle
        walks = np.exp(np.cumsum(random.normal(0.0, creep, (2, 800)), axis=1))
        truth = P.replace(preload=0.4 * start, gain=gain * P.actuator.gain)

        def story(t: float, _: float, walks: Array = walks) -> Hidden:
            return Hidden(preload=walks[0, round(100.0 * t)], amplifier=walks[1, round(100.0 * t)])

        axis = RealAxis(truth, story, seed=seed)
        axis.step(200)
        axis.rest(0.05)
        twin = Twin(P)
        for _ in feed(twin, axis.log):
            pass
        preload, gain = walks[:, 199]
        now = {"preload": preload * truth.friction.preload, "gain": gain * truth.actuator.gain}
        for one in twin.estimates():
            if one.name in now:
                held[one.name] += int(one.low <= now[one.name] <= one.high)
        found = twin.predict_steps(500)
        oracle = _oracle(twin, now).predict_steps(500)
        axis.step(500)
        axis.rest(0.05)
        held["prediction of 500 steps"] += found.low <= axis.x <= found.high
        held["that of the oracle"] += oracle.low <= axis.x <= oracle.high
        widths.append((found.high - found.low, oracle.high - oracle.low))
        off = [f"{1e9 * (one.position - axis.x):.1f} of {5e8 * (one.high - one.low):.1f} nm"
               for one in (found, oracle)]  # fmt: skip
        print(seed, "twin off by", off[0], "oracle by", off[1], dict(held), flush=True)
    print({name: f"{number} of {count}" for name, number in held.items()})
    width, ideal = 1e9 * np.array(widths).T
    print(f"width of the predictions: median {np.median(width):.0f} nm, most {max(width):.0f} nm")
    times = width / ideal
    print(f"times that of the oracle: median {np.median(times):.2f}, most {max(times):.2f}")


def _oracle(twin: Twin, truth: Mapping[str, float]) -> Twin:
    """Return a twin that knows the parameters as they are now; of what comes it knows no more."""
    oracle = copy.deepcopy(twin)
    tracker, file = oracle.tracker, [float(P.value(name)) for name in twin.tracker.names]
    tracker.state[THETA] = np.log([truth[name] for name in tracker.names]) - np.log(file)
    tracker.covariance[THETA] = tracker.covariance[:, THETA] = 0.0
    tracker.renew(-1.0)
    return oracle


def moves(count: int, first: int) -> None:
    """Print how far open-loop moves end from 2 um, with the step of the twin and the first one."""
    p, whole, drive = P.replace(amplitude=80.0), 2e-6, OperatingPoint(80.0, 100.0, 1, 1)

    def story(t: float, _: float) -> Hidden:
        return Hidden(preload=1.0 - 0.3 * min(t / (count * 0.01 * steps), 1.0))

    twin = Twin(p)
    at_first = twin.tracker.step_size(drive)[0]
    steps = round(whole / at_first)
    axis = RealAxis(p, story, seed=first)
    log = 0
    for number in range(count):
        known = twin.tracker.step_size(drive)[0]
        before, asked = axis.x, round(whole / known)
        if number:
            asked = twin.predict_position(axis.x + whole).steps
        axis.step(asked)
        axis.rest(0.05)
        for one in axis.log[log:]:  # it goes on, so the last change is not settled
            twin.command(one) if isinstance(one, TwinCommand) else twin.measure(*one)
        log, made = len(axis.log), (axis.x - before) / asked
        off, without = (100.0 * (made / one - 1.0) for one in (known, at_first))
        ends = 100.0 * (made * asked / whole - 1.0)
        print(
            f"move {number + 1}: ends {ends:+.2f} % off; with the step alone {off:+.2f} %, "
            f"with the first step {without:+.2f} %; {twin.level[0]}"
        )


_DRIVE = ("amplitude", "frequency")


def _drawn_cause(name: str, random: np.random.Generator) -> Hidden:
    """Return a change of a size that a laboratory would want to be told."""
    sign, share = float(random.choice([-1.0, 1.0])), float(random.uniform(0.0, 1.0))
    return {
        "preload": Hidden(preload=1.0 + sign * (0.05 + 0.15 * share)),
        "payload": Hidden(payload=5e-4 + 2.5e-3 * share),
        "amplifier": Hidden(amplifier=1.0 + sign * (0.01 + 0.04 * share)),
        "sensor gain": Hidden(sensor=1.0 + sign * (0.01 + 0.04 * share)),
        "breakaway distance": Hidden(breakaway=1.0 + sign * (0.1 + 0.2 * share)),
        "force": Hidden(force=sign * (2e-3 + 8e-3 * share)),
        "temperature": Hidden(warmer=sign * (5.0 + 15.0 * share)),
        "place": Hidden(preload=1.0 + sign * (0.05 + 0.15 * share)),
        "nothing": Hidden(),
    }[name]


def _changed(hidden: Hidden) -> dict[str, float]:
    return {key: one for key, one in vars(hidden).items() if one != getattr(Hidden(), key)}


def _outcome(twin: Twin, name: str) -> str:
    """Return what the first verdict of a twin is worth if this is the true cause."""
    if name == "nothing":
        return "alarmed" if twin.changes else "right"
    verdict = next((one.verdict for one in twin.changes if one.verdict), None)
    if verdict is None:
        return "told, not judged" if twin.changes else "not told"
    if not verdict.explained:
        return "unlike the model"
    if verdict.cause:
        return "right" if verdict.cause == name else "wrong"
    return "open" if name in verdict.possible else "open without the true one"


def causes(count: int, first: int) -> None:
    """Print which cause is named, of drives, sizes and moves at random; one drive or two."""
    totals: dict[str, Counter[str]] = {}
    for seed in range(first, first + count):
        for name in (*CAUSES, "nothing"):
            random = np.random.default_rng([seed, 60])
            drives = [
                (float(random.integers(180, 301)), float(random.integers(80, 401)))
                for _ in range(1 + seed % 2)
            ]
            amplitude, frequency = drives[0]
            p = Parameters.of(
                preload=float(random.uniform(0.3, 0.6)), amplitude=amplitude, frequency=frequency,
                friction_temperature=2e-3, gain_temperature=1e-3,
            )  # fmt: skip
            hidden, begun = _drawn_cause(name, random), [(math.inf, 0.0)]

            def story(
                t: float,
                x: float,
                hidden: Hidden = hidden,
                begun: list[tuple[float, float]] = begun,
                name: str = name,
            ) -> Hidden:
                (when, where) = begun[0]
                return hidden if t >= when and (name != "place" or x > where) else Hidden()

            axis = RealAxis(p, story, rate=200.0, seed=seed)
            for move in range(16):
                if move == 8:
                    begun[0] = axis.t, axis.x
                for what, value in zip(_DRIVE, drives[move % len(drives)], strict=True):
                    if axis.p.value(what) != value:
                        axis.command(what, value)
                axis.step(int(random.choice([-1, 1]) * random.integers(30, 100)))
                axis.rest(float(random.uniform(0.1, 0.4)))
            twin = Twin(p)
            for _ in feed(twin, axis.log):
                pass
            outcome = _outcome(twin, name)
            totals.setdefault(name, Counter())[outcome] += 1
            texts = [one.text for one in twin.changes]
            print(name, seed, outcome, _changed(hidden), texts, flush=True)
    for name, found in totals.items():
        print(name, dict(found))


if __name__ == "__main__":
    begin = time.process_time()
    studies = {
        "alarms": alarms, "told": told, "intervals": intervals, "moves": moves, "causes": causes,
    }  # fmt: skip
    given = arguments(__doc__, None, {"study": {*studies}, "count": int, "first": 1})
    studies[given.study](given.count, given.first)
    print(f"{time.process_time() - begin:.0f} s of processor time")
