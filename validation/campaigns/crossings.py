# SPDX-License-Identifier: Apache-2.0
"""Journeys of users, each with what it crosses: what works, is refused, is unclear, is wrong.

    make campaigns ARGS="crossings --count 500 --seed 7"

One table says what a journey crosses, and by whom that is judged (`crossing_judges`). First come
all pairs of crosses of each journey, in a covering array; at random are then one to four crosses of
one journey at a time, the others plain. A case follows from the seed and its number alone; --only
runs one. Verdicts:

works      right, or doubted with the reason
refused    in a sentence whose cure helps, where it names a value
unclear    refused without a cure that helps, or with a warning that says nothing
WRONG      in silence
CRASH      a traceback, or no end within 120 s of the processor

The last two are a failure. What cannot be drawn for any reason but the table's is no case.
"""

from __future__ import annotations

import contextlib
import itertools
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from allpairspy import AllPairs

from stickslip_ros.physics.laws import LAWS
from validation.campaigns.arguments import arguments
from validation.campaigns.judging import judged
from validation.draws import even

VERDICTS = ("works", "doubted", "refused", "unclear", "WRONG", "CRASH")
#: The most crosses of a draw at random, without who judges
MOST = 4
#: s that a motion lasts at most, at a frequency that is drawn, and steps of one at the default
LONGEST, MOST_STEPS = 100.0, 10_000
#: Seconds of the machine after which a child that hears no alarm is ended
DEAF = 600.0


class Span(NamedTuple):
    """A number that is drawn evenly in its logarithm, of either sign if it is signed."""

    low: float
    high: float
    signed: bool = False

    def drawn(self, draw: np.random.Generator) -> float:
        """Draw it."""
        sign = float(draw.choice([-1.0, 1.0])) if self.signed else 1.0
        return sign * even(draw, self.low, self.high)


#: Parameters by name, and ``steps``, for each value that a cross has; the first is the plain one
Cross = Mapping[str, Mapping[str, Any]]

#: What every drive draws
PLAIN = {
    "preload": Span(0.2, 2.0), "mass": Span(2e-3, 2e-2), "sigma_1": Span(4.0, 40.0),
    "amplitude": Span(80.0, 300.0), "slewrate": Span(30.0, 300.0),
}  # fmt: skip
LAW: Cross = {name: {"model": name} for name in LAWS}
CONTACTS: Cross = {
    "one contact": {},
    "three contacts": {"contacts": 3, "contact_spread": Span(0.03, 0.3)},
    "six contacts": {"contacts": 6, "contact_shares": "guide"},
}
LOAD: Cross = {
    "no load": {},
    "spring": {"spring": Span(1e2, 1e5)},
    "force": {"force": Span(1e-3, 2e-2, signed=True)},
    "inclination": {"inclination": Span(0.01, 0.3, signed=True)},
    "payload": {"payload": Span(1e-3, 5e-2)},
}
ACTUATOR: Cross = {
    "plain actuator": {},
    "lag": {"amplifier_bandwidth": Span(1e4, 1e6)},
    "slew": {"amplifier_slew": Span(1.0, 100.0)},
    "hysteresis": {"actuator": "hysteresis", "hysteresis": Span(0.03, 0.3)},
    "memory": {"actuator": "hysteresis", "actuator_memory": True},
    "creep": {"creep": Span(2e-3, 3e-2)},
    "resonance": {"actuator_resonance": Span(5e4, 1e6), "actuator_damping": Span(0.02, 0.5)},
}
WAVEFORM: Cross = {
    "sawtooth": {},
    "hold": {"waveform": "hold", "hold_before": Span(0.02, 0.4), "hold_after": Span(0.02, 0.4)},
    "shaped": {"waveform": "shaped", "split": Span(0.3, 0.9), "latency": Span(1e-6, 1e-4)},
    "triangle": {"waveform": "triangle"},
    "table": {"waveform": "table", "waveform_table": "wave.csv"},
}
SCATTER: Cross = {
    "no scatter": {},
    "surface": {"surface_spread": Span(0.02, 0.3), "surface_length": Span(1e-7, 1e-5)},
    "slips": {"slip_spread": Span(0.01, 0.1)},
    "wear": {"wear_rate": Span(1e-1, 1e3, signed=True)},
    "warm": {"temperature": Span(250.0, 350.0), "gain_temperature": Span(1e-4, 3e-3),
             "friction_temperature": Span(1e-4, 2e-3)},
    "ageing": {"dwell_growth": Span(0.01, 0.1), "rate_growth": Span(0.01, 0.1)},
}  # fmt: skip
SENSOR: Cross = {
    "exact sensor": {"sensor_noise": 0.0, "sensor_resolution": 0.0, "sensor_latency": 0.0},
    "usual sensor": {},
    "coarse": {"sensor_noise": Span(1e-10, 3e-9), "sensor_resolution": Span(2e-10, 2e-8)},
    "late": {"sensor_latency": Span(1e-4, 3e-2)},
    "slow sensor": {"sensor_bandwidth": Span(1e3, 3e4)},
    "drifting": {"sensor_drift": Span(1e-10, 1e-8, signed=True)},
}
FREQUENCY: Cross = {
    "100 Hz": {"frequency": Span(70.0, 150.0)},
    "1 Hz": {"frequency": Span(0.7, 1.5)},
    "1 kHz": {"frequency": Span(700.0, 2e3)},
    "20 kHz": {"frequency": Span(15e3, 25e3)},
}
MEASURABLE: Cross = {
    "100 Hz": {"frequency": Span(70.0, 150.0)},
    "10 Hz": {"frequency": Span(7.0, 20.0)},
    "1 kHz": {"frequency": Span(500.0, 1200.0)},
    "4 kHz": {"frequency": Span(2e3, 5e3)},
}
#: Of a record that is written and read
FEWER: Cross = {"30 steps": {"steps": 30}, "1 step": {"steps": 1}, "300 backward": {"steps": -300}}
MOTION: Cross = {
    "30 steps": {"steps": 30},
    "1 step": {"steps": 1},
    "3 steps": {"steps": 3},
    "30 backward": {"steps": -30},
    "1 backward": {"steps": -1},
    "1000 steps": {"steps": 1000},
}
PHYSICS: dict[str, Cross] = {
    "law": LAW, "contacts": CONTACTS, "load": LOAD, "actuator": ACTUATOR, "scatter": SCATTER,
}  # fmt: skip
DRIVE: dict[str, Cross] = {**PHYSICS, "waveform": WAVEFORM}
MINE: Cross = {name: {"model": f"my_{name}"} for name in LAWS}


def _named(*names: str) -> Cross:
    """Return a cross that sets no parameter: its judge reads the name."""
    return {name: {} for name in names}


class Journey(NamedTuple):
    """What a journey crosses, and who judges it: names of `crossing_judges.JUDGES`."""

    crosses: Mapping[str, Cross]
    judges: tuple[str, ...]


JOURNEYS: dict[str, Journey] = {
    "J1 robot": Journey(
        {**DRIVE, "sensor": SENSOR, "frequency": FREQUENCY, "motion": MOTION},
        ("library", "later", "mirrored", "two moves", "divided", "sensor fault", "node", "others"),
    ),
    "J2 recording": Journey(
        {**PHYSICS, "sensor": SENSOR, "frequency": FREQUENCY, "motion": MOTION,
         "axes": _named("one axis", "three axes", "another name"),
         "command": _named("steps", "jog", "target")},
        ("resimulated", "recovered", "exported", "recorder"),
    ),
    "J3 file": Journey(
        {"law": LAW, "load": LOAD, "actuator": ACTUATOR, "sensor": SENSOR,
         "frequency": MEASURABLE, "motion": FEWER,
         "file": _named("csv", "semicolons", "tabs", "npz", "mat", "hdf5", "tdms"),
         "units": _named("m", "nm", "um"), "clock": _named("from 0", "from 1000 s", "in ms"),
         "gaps": _named("whole", "lines missing", "ends in the run"),
         "sign": _named("along", "against")},
        ("table", "cut in two", "compared", "other drive", "identified"),
    ),
    "J4 design": Journey(
        {**DRIVE, "frequency": FREQUENCY, "motion": MOTION},
        ("integrator", "sweep", "predicted", "inverse", "command", "prefix", "trace",
         "waveform file"),
    ),
    "J5 lab program": Journey(
        {**PHYSICS, "sensor": SENSOR, "frequency": {"1 kHz": {"frequency": Span(700.0, 2e3)},
                                                    "300 Hz": {"frequency": Span(200.0, 500.0)}},
         "motion": {name: MOTION[name] for name in list(MOTION)[:5]},
         "controller": _named("anc300", "scu", "mcs", "mcs2", "amc", "e871"),
         "slot": _named("first", "second"), "end": _named("all steps", "stopped")},
        ("emulated", "emulation recorded"),
    ),
    "J6 elsewhere": Journey(
        {"law": LAW, "command": _named("simulate", "sweep", "trace", "report"),
         "machine": _named("plain", "German", "Turkish", "no locale", "no home", "read-only",
                           "nohup", "no network", "time zone")},
        ("elsewhere",),
    ),
    "J7 own physics": Journey(
        {"law": MINE, "contacts": CONTACTS, "load": LOAD, "actuator": ACTUATOR, "scatter": SCATTER,
         "waveform": {"mine": {"waveform": "my_ramp"}, **WAVEFORM}, "frequency": FREQUENCY,
         "motion": MOTION},
        ("library", "sweep", "command", "prefix", "as ours", "resimulated", "divided"),
    ),
    "J8 twin": Journey(
        {"law": LAW, "load": {name: LOAD[name] for name in ("no load", "payload", "inclination")},
         "actuator": {"plain actuator": {}, "lag": ACTUATOR["lag"], "creep": ACTUATOR["creep"]},
         "frequency": {"100 Hz": MEASURABLE["100 Hz"], "1 kHz": MEASURABLE["1 kHz"]},
         "direction": {"forward": {"steps": 100_000}, "backward": {"steps": -100_000}},
         "change": _named("nothing", "preload", "payload", "sensor gain", "amplifier"),
         "readings": _named("uneven", "even", "with a gap", "twice")},
        ("told", "of a table"),
    ),
}  # fmt: skip


class Case(NamedTuple):
    """A crossing."""

    number: int
    journey: str
    chosen: Mapping[str, str]  #: the value of each cross by its name
    judge: str
    values: dict[str, Any]  #: parameters by name
    steps: int
    seed: int  #: of whatever the judge draws

    def __str__(self) -> str:
        """Name what is not plain, and who judges it."""
        crosses = JOURNEYS[self.journey].crosses
        told = [one for name, one in self.chosen.items() if one != next(iter(crosses[name]))]
        return f"{self.number} {self.journey}, judged by {self.judge!r}: {', '.join(told)}"


@cache
def covering(seed: int) -> list[tuple[str, list[str]]]:
    """Return journeys with the values of their crosses, and the judge: all pairs of each."""
    draw = np.random.default_rng((seed, 0))
    arrays = []
    for name, journey in JOURNEYS.items():
        names = [list(map(str, draw.permutation(list(one)))) for one in journey.crosses.values()]
        judges = list(map(str, draw.permutation(journey.judges)))
        pairs = AllPairs([judges, *names]) if len(judges) > 1 else AllPairs(names)
        arrays.append([(name, list(row) if len(judges) > 1 else [*judges, *row]) for row in pairs])
    return [row for rows in itertools.zip_longest(*arrays) for row in rows if row]


def drawn(seed: int, number: int) -> Case:
    """Return the case of a number: it follows from that and the seed alone."""
    draw, known = np.random.default_rng((seed, 1, number)), covering(seed)
    if number < len(known):
        name, (judge, *row) = known[number]
    else:
        name = str(draw.choice(list(JOURNEYS)))
        judge = str(draw.choice(JOURNEYS[name].judges))
        crosses = list(JOURNEYS[name].crosses.values())
        crossed = draw.permutation(len(crosses))[: draw.integers(1, MOST + 1)]
        row = [
            str(draw.choice(list(one)[1:])) if k in crossed and len(one) > 1 else next(iter(one))
            for k, one in enumerate(crosses)
        ]
    chosen = dict(zip(JOURNEYS[name].crosses, row, strict=True))
    given: dict[str, Any] = dict(PLAIN)
    for cross, value in chosen.items():
        given |= JOURNEYS[name].crosses[cross][value]
    values = {key: one.drawn(draw) if isinstance(one, Span) else one for key, one in given.items()}
    most = max(1, int(LONGEST * values["frequency"])) if "frequency" in values else MOST_STEPS
    steps = int(np.clip(values.pop("steps", 30), -most, most))
    return Case(number, name, chosen, judge, values, steps, int(draw.integers(2**31)))


def main(
    argv: Sequence[str] | None = None, say: Callable[[str], object] = lambda text: print(text)
) -> int:
    """Judge crossings, print each that is unclear or fails, and the table; 1 for a failure."""
    from validation.campaigns.crossing_judges import verdict  # which loads all of the package

    args = arguments(__doc__, argv, count=500, seed=7, first=0, only=-1, progress=25)
    numbers = range(args.first, args.first + args.count) if args.only < 0 else [args.only]
    say(f"{len(covering(args.seed))} cases hold all pairs of crosses of seed {args.seed}")
    counts, begun = Counter[tuple[str, str]](), time.monotonic()
    cases = judged(verdict, (drawn(args.seed, number) for number in numbers), DEAF)
    with contextlib.suppress(KeyboardInterrupt):  # of what was judged until then
        for done, (case, said) in enumerate(cases, 1):
            kind, _, text = said.partition(": ")
            if kind not in VERDICTS:
                kind, text = "CRASH", said
            counts[case.journey, kind] += 1
            if kind in VERDICTS[3:] or args.only >= 0:
                say(f"{kind} {case}\n    {text}\n    {case.steps} steps of {case.values}")
                say(f'    make campaigns ARGS="crossings --seed {args.seed} --only {case.number}"')
            if done % args.progress == 0:
                found = ", ".join(f"{n} {one}" for one in VERDICTS if (n := _all(counts, one)))
                say(f"{done} of {len(numbers)} in {time.monotonic() - begun:.0f} s: {found}")
    width = max(map(len, JOURNEYS))
    say(f"{'':{width}} " + " ".join(f"{one:>8}" for one in VERDICTS))
    for name in JOURNEYS:
        row = " ".join(f"{counts[name, one]:8}" for one in VERDICTS)
        say(f"{name:{width}} {row}")
    row = " ".join(f"{_all(counts, one):8}" for one in VERDICTS)
    say(f"{'all':{width}} {row}, seed {args.seed}")
    return int(_all(counts, "WRONG") + _all(counts, "CRASH") > 0)


def _all(counts: Counter[tuple[str, str]], kind: str) -> int:
    return sum(count for (_, one), count in counts.items() if one == kind)


if __name__ == "__main__":
    sys.exit(main())
