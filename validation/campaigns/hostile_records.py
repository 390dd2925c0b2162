# SPDX-License-Identifier: Apache-2.0
"""Records of any shape, through the commands that read them: each gives a result or a sentence.

A record is a motion (steps, one move, a pulse, a ramp, a constant, noise, ...) of 2 to 4000
samples, at times that may repeat, run back, leave gaps or be no numbers, with values that may be
NaN, infinite or far out. A command that reads it has to end with exit code 0, 1 or 2 within its
time; with 2 it says one line of error, besides what it has noted on the way, and below that, of a
table that it cannot read, how that begins. A traceback and a warning of Python are faults, and so
is an end that asks for a report.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.cli.main import main as stickslip
from validation.campaigns.judging import study, within

GOOD = ("result", "finding", "refused")  #: outcomes, of exit codes 0, 1 and 2
SECONDS = 60.0  #: of the processor, for a case
SIZES = (2, 15, 16, 31, 32, 33, 64, 100, 100, 400, 400, 1000, 1000, 1000, 4000, 4000)
_POINT = "preload: 0.4\namplitude: 300.0\nfrequency: 100.0\n"


class Case(NamedTuple):
    """A record and what is asked of it."""

    shape: str  #: for people
    columns: dict[str, Array]  #: of its table, by heading
    command: tuple[str, ...]  #: RECORD, POINT, RUN and OUT stand for files


# -- motions over a phase s of 0 to 1, m; draw is for what is left open


def _steps(draw: np.random.Generator, s: Array) -> Array:
    cycles = s * draw.integers(1, 40)
    part, number = np.modf(cycles)
    ringing = np.exp(-20.0 * part) * np.cos(2.0 * np.pi * draw.uniform(3.0, 12.0) * part)
    return 1e-7 * (number + 1.4 * part - draw.choice([0.0, 0.3]) * ringing * (cycles >= 1.0))


def _stretch_of_steps(draw: np.random.Generator, s: Array) -> Array:
    begin, end = np.sort(draw.random(2))
    return _steps(draw, np.clip((s - begin) / max(end - begin, 1e-3), 0.0, 1.0))


def _pulse(draw: np.random.Generator, s: Array) -> Array:
    begin = draw.random()
    return 1e-7 * ((s >= begin) & (s < begin + draw.choice([0.001, 0.01, 0.3])))


MOTIONS: dict[str, Callable[[np.random.Generator, Array], Any]] = {
    "steps": _steps,
    "a stretch of steps": _stretch_of_steps,
    "a pulse": _pulse,
    "a constant": lambda draw, s: np.full_like(s, draw.choice([0.0, 3e-7, 1.0])),
    "a ramp": lambda draw, s: 1e-6 * s,
    "a curve": lambda draw, s: 1e-6 * np.exp(-5.0 * s),
    "a sine": lambda draw, s: 1e-7 * np.sin(2.0 * np.pi * draw.uniform(0.3, 60.0) * s),
    "a square wave": lambda draw, s: 1e-7 * (np.modf(s * draw.uniform(1.0, 60.0))[0] > 0.5),
    "a staircase": lambda draw, s: 1e-7 * np.floor(s * draw.integers(2, 60)),
    "one move": lambda draw, s: 8e-8 * (s > draw.random()),
    "one move near the start": lambda draw, s: 8e-8 * (s > draw.uniform(0.0, 0.05)),
    "one move near the end": lambda draw, s: 8e-8 * (s > draw.uniform(0.95, 1.0)),
    "two values": lambda draw, s: 1e-7 * draw.integers(0, 2, len(s)),
    "noise": lambda draw, s: 1e-8 * draw.standard_normal(len(s)),
    "a walk": lambda draw, s: 1e-9 * np.cumsum(draw.standard_normal(len(s))),
}


def _moved(draw: np.random.Generator, x: Array) -> tuple[Array, str]:
    """Return values with something that measurements have, or that nobody can measure."""
    kind = str(
        draw.choice(
            ["", "", "", "noise", "noise", "digits", "offset", "tiny", "huge", "one sample"]
        )
    )
    x = x + 0.0
    if kind == "noise":
        x += draw.choice([1e-10, 2e-9, 3e-8]) * draw.standard_normal(len(x))
    elif kind == "digits":
        x = np.round(x / 1e-8) * 1e-8
    elif kind == "offset":
        x += draw.choice([-1.0, 1e-3, 1e3])
    elif kind in ("tiny", "huge"):
        x *= 1e-300 if draw.random() < 0.2 and kind == "tiny" else 1e-9 if kind == "tiny" else 1e9
    elif kind == "one sample":
        x[draw.integers(len(x))] += draw.choice([-5e-8, 5e-8, 1e-3, 1.0])
    return x, kind


def _spoilt(draw: np.random.Generator, x: Array) -> tuple[Array, str]:
    """Return values some of which may be no numbers."""
    kind = str(draw.choice(["", "", "", "", "", "NaN", "infinite"]))
    if kind:
        share = draw.choice([0.0, 0.05, 0.5, 1.0])
        where = draw.random(len(x)) < share
        where[draw.integers(len(x))] = True
        bad = np.nan if kind == "NaN" else draw.choice([-np.inf, np.inf])
        x = np.where(where, bad, x)
    return x, kind


def _times(draw: np.random.Generator, count: int) -> tuple[Array, str]:
    kinds = ("one stamp twice", "all twice", "a decrease", "backwards", "one time", "a gap")
    more = ("shaken", "not in order", "since 1970", "in halves of seconds")
    kind = str(draw.choice(["", "", "", "", "", "", "", "", *kinds, *more]))
    t = np.arange(count) * float(10.0 ** draw.uniform(-5.0, -2.5))
    k = int(draw.integers(1, count))
    if kind == "one stamp twice":
        t[k] = t[k - 1]
    elif kind == "all twice":
        t = np.resize(t[: (count + 1) // 2], count)
    elif kind == "a decrease":
        t[k:] -= 2.0 * (t[k] - t[k - 1]) + draw.choice([0.0, t[k - 1]])
    elif kind == "backwards":
        t = t[::-1].copy()
    elif kind == "one time":
        t[:] = t[k]
    elif kind == "a gap":
        t[k:] += draw.choice([1.0, 1e3, 1e6]) * (t[1] - t[0])
    elif kind == "shaken":
        t += 0.3 * (t[1] - t[0]) * draw.random(count)
    elif kind == "not in order":
        draw.shuffle(t)
    elif kind == "since 1970":
        t += 1.77e9
    elif kind == "in halves of seconds":
        t = np.round(2.0 * t / t[1] * 0.01) / 2.0
    return np.asarray(t, dtype=np.float64), kind


def _command(draw: np.random.Generator, t: Array, actuator: bool) -> tuple[str, ...]:
    """Return what is asked of a record."""
    asked = draw.random()
    if actuator and asked < 0.5:
        return ("identify-actuator", "RECORD", "--out", "OUT")
    if asked < 0.01:  # which takes a minute where there are steps
        return ("identify", "--run", "POINT", "RECORD")
    part: tuple[str, ...] = ()
    if draw.random() < 0.3:
        flag = str(draw.choice(["--to", "--from"]))
        part = (f"{flag}={t[0] + draw.uniform(0.0, 1.0) * (t[-1] - t[0]):.9g}",)
    if draw.random() < 0.15:
        part += (str(draw.choice(["--fit-position-drift", "--remove-hum", "--wavelength=633nm"])),)
    if asked < 0.3:
        part += ("--steps=3",) if draw.random() < 0.3 else ()
        return ("compare", str(draw.choice(["POINT", "RUN"])), "RECORD", *part)
    if draw.random() < 0.3:
        part += ("--runner-only",)
    if draw.random() < 0.3:
        count = draw.integers(1, 50) if draw.random() < 0.7 else draw.choice([0.1, len(t), 1e6])
        frequency = count / (
            (abs(float(t[-1] - t[0])) or 1.0) if np.isfinite(t[-1] - t[0]) else 1.0
        )
        part += (f"--frequency={frequency:.6g}",)
        if draw.random() < 0.3:
            part += (f"--start={t[0] + draw.uniform(-0.1, 1.1) * (t[-1] - t[0]):.9g}",)
    if draw.random() < 0.1:
        part += ("--json",)
    return ("analyse", "RECORD", *part)


def drawn(seed: int, number: int) -> Case:
    """Return the case of a number: it follows from that and the seed alone."""
    draw = np.random.default_rng((seed, number))
    count = int(draw.choice(SIZES))
    s = np.arange(count) / max(count - 1, 1)
    t, of_time = _times(draw, count)

    def values() -> tuple[Array, list[str]]:
        name = str(draw.choice(list(MOTIONS) if draw.random() < 0.75 else list(MOTIONS)[:2]))
        x, moved = _moved(draw, np.asarray(MOTIONS[name](draw, s), dtype=np.float64))
        x, spoilt = _spoilt(draw, x)
        return x, [name, moved, spoilt]

    x, said = values()
    columns = {"time (s)": t, "position (m)": x}
    words = [f"{count} samples", *said]
    command = _command(draw, t, bool(actuator := draw.random() < 0.3))
    if actuator:
        u, more = values()
        if command[0] == "identify-actuator":
            columns = {"time (s)": t, "voltage (V)": 1e9 * x, "deflection (m)": u}
        else:
            columns["actuator (m)"] = u
        words += ["with", *more]
    if draw.random() < 0.05:
        columns["time (s)"], spoilt = _spoilt(draw, t)
        of_time += f" {spoilt}"
    words.append(f"times: {of_time or 'even'}")
    return Case(", ".join(word for word in words if word), columns, command)


# -- judging


def _said(command: Sequence[str]) -> str:
    """Return the outcome of a command: "result", "finding", "refused", or a fault."""
    out, err = io.StringIO(), io.StringIO()
    try:
        with (
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("always")
            code = stickslip(command)
    except SystemExit as end:  # of argparse, for options
        code = end.code if isinstance(end.code, int) else 2
    lines = err.getvalue().splitlines()
    if code not in (0, 1, 2):
        return f"exit code {code}"
    if any("Warning: " in line for line in lines):
        return f"warns: {next(line for line in lines if 'Warning: ' in line)}"
    if "please report" in err.getvalue():
        return f"did not foresee it: {lines[-1]}"
    errors = [line for line in lines if line.startswith("stickslip")]
    if code == 2 and len(errors) != 1:
        return f"says {len(errors)} errors: {' / '.join(lines)}"
    return GOOD[code]


def outcome(case: Case) -> str:
    """Return what comes of a case; an exception is a fault, as is too long a time."""
    with tempfile.TemporaryDirectory() as folder:
        files = {name: str(Path(folder, file)) for name, file in (
            ("RECORD", "record.csv"), ("POINT", "point.yaml"), ("OUT", "out.yaml"),
            ("RUN", "run.csv"),
        )}  # fmt: skip
        Path(files["POINT"]).write_text(_POINT, "utf-8")
        np.savetxt(
            files["RECORD"], np.column_stack(list(case.columns.values())), delimiter=",",
            header=",".join(case.columns), comments="", fmt="%.12g",
        )  # fmt: skip
        if "RUN" in case.command:
            _said(["simulate", "--steps=5", "--config", files["POINT"], "--trace", files["RUN"]])
        command = [files.get(word, word) for word in case.command]
        return within(SECONDS, lambda: _said(command))


def records(count: int, seed: int) -> int:
    """Judge cases, print the faults and how many of each outcome there were; 1 for a fault."""
    return study(
        outcome,
        partial(drawn, seed),
        range(count),
        GOOD,
        1200.0,  # also where others work
        lambda case: f"{case.shape}: {' '.join(case.command)}",
        lambda case: case.command[0],
    )
