# SPDX-License-Identifier: Apache-2.0
"""Who judges a crossing: relations that need no second model, and the integrator of the whole.

A judge works in an empty folder. It returns nothing for what is right, "doubted: " with the reason
where the package says one itself, and else what is wrong.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from emulated import Emulated
from rosbags.highlevel import AnyReader

import stickslip_ros as ss
from stickslip_ros.axis import Axis
from stickslip_ros.base.arrays import Array
from stickslip_ros.base.errors import StickslipError
from stickslip_ros.cli.main import main as stickslip
from stickslip_ros.emulator import Recorder
from stickslip_ros.measurement.twin import Twin, TwinCommand
from stickslip_ros.physics.laws import LAWS, Law, register_law
from stickslip_ros.physics.model.waveforms import command_of
from stickslip_ros.physics.parameters import PARAMETERS, Parameters
from stickslip_ros.physics.parameters.parameters import yaml_text
from stickslip_ros.physics.waveforms import Shape, register_waveform
from stickslip_ros.recordings import open_bag, resimulate
from stickslip_ros.recordings.recovery import recover
from validation.campaigns.crossings import LAW, Case
from validation.campaigns.judging import within
from validation.twin_axis import Log, feed
from validation.whole_system import NoAnswerError, WholeSystem, positions

SECONDS = 120.0  #: of the processor, for a case
#: m that two computations of one motion may differ by, and those of the integrator, a cycle
SAME, CYCLE = 1e-12, 1e-11
#: Radians of the fastest pole, and cycles, that the integrator is asked for
RADIANS, CYCLES = 1e6, 4
#: s before a command that comes later; ns of the clock at which recordings begin
LATER, START = 0.0371, 1_700_000_000 * 10**9
#: A cure that names no value
CURES = re.compile(
    r"--\w|can (be|have) |"
    r"\b(choose|give|install|lower|name|raise|record|register|set|simulate|stay|take|use)\b"
)
#: Factors by which a parameter is tried that a cure names without a value, and most trials
FACTORS, TRIALS = (0.5, 2.0, 0.1, 10.0, 0.01, 100.0), 24
#: How a sensor looks at the motion
SIGNS = {"along": 1, "against": -1}
WAVE = "0, 0\n0.6, 0.7\n0.9985, 1\n1, 0\n"
MACHINES: dict[str, dict[str, str]] = {
    "German": {"LC_ALL": "de_DE.UTF-8"}, "Turkish": {"LC_ALL": "tr_TR.UTF-8"},
    "no locale": {"LC_ALL": "C", "PYTHONUTF8": "0"}, "no home": {"HOME": "/proc/nowhere"},
    "time zone": {"TZ": "Pacific/Chatham"},
}  # fmt: skip
#: What a program sends for steps: frequency (Hz), amplitude (V), count, up or down, slot
SENT = {
    "anc300": "123456\r\nsetm {s} stp\r\nsetf {s} {f}\r\nsetv {s} {a}\r\nstep{d} {s} {n}\r\n",
    "scu": ":{D}{s}F{f}A1000S{n}\n",
    "mcs": ":MST{s},{m},4095,{f}\n",
    "mcs2": ":CHAN{s}:MMOD 4\r\n:CHAN{s}:STEP:FREQ {f}\r\n:CHAN{s}:STEP:AMPL 65535\r\n"
    ":MOVE{s} {m}\r\n",
    "e871": "SVO 1 0\nOVL 1 {f}\nOSM 1 {m}\n",
}
AMC = (
    ("control.setControlOutput", "true"), ("control.setControlAmplitude", "{v}"),
    ("control.setControlFrequency", "{h}"), ("move.setNSteps", "{b}, {n}"),
)  # fmt: skip
SENT["amc"] = "\n".join(
    f'{{{{"jsonrpc": "2.0", "method": "com.attocube.amc.{method}", "api": 2, "id": 1, '
    f'"params": [{{s}}, {values}]}}}}'
    for method, values in AMC
)


def _twice(law: Law) -> Law:
    """Return a law with twice the normal force."""
    return law._replace(
        constants=lambda c, f: law.constants(c, 2.0 * f),
        contact=lambda c, f: law.contact(c, 2.0 * f),
    )


def _ramp(drive: Any) -> Shape:
    period, fall = 1.0 / drive.frequency, drive.amplitude / (drive.slewrate * 1e6)
    return Shape((period - fall, fall), (1.0, -1.0), slip=(1, 2), time_for_slip=period)


register_waveform("my_ramp", _ramp)
for _name in LAW:
    if not LAWS[_name].rate:  # that one comes too late, in its case
        register_law(f"my_{_name}", _twice(LAWS[_name]))


# -- a verdict


def verdict(case: Case) -> str:
    """Return one of `crossings.VERDICTS` with its text; anything else is a crash."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        Path("wave.csv").write_text(WAVE)
        return within(SECONDS, lambda: _verdict(case))


def _verdict(case: Case) -> str:
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            own = case.values["model"].removeprefix("my_")
            if case.values["model"] not in LAWS:
                register_law(case.values["model"], _twice(LAWS[own]))  # too late, as its cure says
            said = JUDGES[case.judge](case)
    except StickslipError as error:
        return f"{'refused' if _helps(case, str(error)) else 'unclear'}: {error}"
    ours = [str(one.message) for one in warned if "stickslip_ros" in one.filename]
    if said and not said.startswith("doubted: "):
        return f"WRONG: {said}"
    return f"unclear: warns: {ours[0]}" if ours else said or "works: "


def _helps(case: Case, text: str) -> bool:
    """Return whether the sentence has a cure, and what it names of our parameters is one."""
    named = [one for one in dict.fromkeys(re.findall(r"\w+", text)) if one in case.values]
    named = [one for one in named if isinstance(case.values[one], float)]
    numbers = [float(one) for one in re.findall(r"(?<![\w.])-?\d+\.?\d*(?:e[-+]?\d+)?", text)]
    tries = [(one, number) for one in named for number in numbers]
    tries += [(one, case.values[one] * factor) for one in named for factor in FACTORS]
    if not CURES.search(text):
        return False
    if "drive frequency" in text and "told" not in case.chosen:
        with contextlib.suppress(StickslipError):
            JUDGES[case.judge](case._replace(chosen={**case.chosen, "told": "its frequency"}))
            return True
        return case.chosen["gaps"] == "ends in the run" or abs(case.steps) < 3
    for name, value in tries[:TRIALS]:
        row = PARAMETERS[name]
        if not row.low <= value <= row.high or value == case.values[name]:
            continue
        try:
            JUDGES[case.judge](case._replace(values={**case.values, name: value}))
        except StickslipError as error:
            if re.sub(r"[\d.e+-]", "", str(error)) == re.sub(r"[\d.e+-]", "", text):
                continue
        except Exception:
            return True  # another matter, and judged where it is drawn
        return True
    return not tries or bool(re.search(r"; (or )?(simulate|take|register|choose|use)\b", text))


def apart(found: Any, right: Any, allowed: float, what: str = "the position") -> str:
    """Return by how much numbers differ that may not, by more than is allowed."""
    off = np.abs(np.asarray(found) - np.asarray(right))
    both = np.isnan(np.asarray(found, float)) & np.isnan(np.asarray(right, float))
    most = float(np.max(np.where(both, 0.0, off)))
    return "" if most <= allowed else f"{what} is {most:.3g} off, allowed {allowed:.3g}"


def stable(run: ss.SimulatedRun, said: str) -> str:
    """Return what is wrong, unless the run says itself that it is one of many."""
    return f"doubted: unstable, {said}" if said and run.unstable else said


def told(*words: Any) -> str:
    """Return what a command prints; StickslipError where it refuses."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = stickslip(list(map(str, words)))
        except SystemExit as end:
            code = int(end.code or 0)
    if code == 2:
        raise StickslipError(err.getvalue().strip().splitlines()[-1].partition(": ")[2])
    assert code in (0, 1) and "please report" not in err.getvalue(), err.getvalue()
    return out.getvalue()


def words_of(values: dict[str, Any]) -> list[str]:
    """Return the parameters as options."""
    return [f"--set={name}={value}" for name, value in values.items()]


def period_of(case: Case) -> float:
    """Return the period of the drive, s."""
    return float(command_of(Parameters.of(case.values)).period)


# -- a drive


def moved(values: dict[str, Any], steps: int, period: float, at: float = 0.0) -> Axis:
    """Return an axis after steps that are commanded at a time (s)."""
    axis = Axis(values)
    axis.advance(at)
    axis.command("steps", steps)
    axis.advance(at + abs(steps) * period)
    return axis


def library(case: Case) -> str:
    run = ss.simulate(case.values, steps=case.steps)
    axis = moved(case.values, case.steps, period_of(case))
    return stable(run, apart(axis.state.x, run.position[-1], SAME * abs(case.steps)))


def _integrated(case: Case, seconds: float, judge: Callable[[Parameters, int], str]) -> str:
    """Judge by the integrator, which knows no settled loop, where it has an answer in time."""
    p = Parameters.of(case.values)
    cycles = min(abs(case.steps), CYCLES)
    settled = p.actuator.actuator == "hysteresis" and not p.actuator.actuator_memory
    if not settled and WholeSystem(p).fastest * (cycles * period_of(case) + seconds) < RADIANS:
        with contextlib.suppress(NoAnswerError):
            return stable(ss.simulate(p, steps=cycles), judge(p, cycles))
    return prefix(case)


def integrator(case: Case) -> str:
    def judge(p: Parameters, cycles: int) -> str:
        found = ss.simulate(p, steps=cycles).position
        return apart(found, positions(p, cycles), CYCLE * cycles)

    return _integrated(case, 0.0, judge)


def later(case: Case) -> str:
    def judge(p: Parameters, cycles: int) -> str:
        axis = moved(case.values, cycles, period_of(case), LATER)
        return apart(axis.state.x, positions(p, cycles, before=LATER)[-1], CYCLE * cycles)

    return _integrated(case, LATER, judge)


def two_moves(case: Case) -> str:
    period = period_of(case)

    def judge(p: Parameters, cycles: int) -> str:
        axis = moved(case.values, 2, period)
        axis.advance(2 * period + LATER)
        axis.command("steps", 2)
        axis.advance(4 * period + LATER)
        return apart(axis.state.x, positions(p, 2, rest=LATER, again=2)[-1], 4 * CYCLE)

    return _integrated(case, LATER, judge)


def mirrored(case: Case) -> str:
    values = {name: value for name, value in case.values.items() if name != "surface_spread"}
    loads = {name: -value for name, value in values.items() if name in ("force", "inclination")}
    run = ss.simulate(values, steps=case.steps)
    other = ss.simulate({**values, **loads}, steps=-case.steps)
    return stable(run, apart(other.position, -run.position, SAME * abs(case.steps)))


def prefix(case: Case) -> str:
    run = ss.simulate(case.values, steps=case.steps)
    twice = ss.simulate(case.values, steps=2 * case.steps).position
    return apart(run.position, twice[: abs(case.steps)], 0.0)


def divided(case: Case) -> str:
    """The same commands, one before the end of the other, and time in other pieces."""
    end, draw, found = abs(case.steps) * period_of(case), np.random.default_rng(case.seed), []
    commands = [("amplitude", 0.7 * case.values["amplitude"]), ("steps", -3), ("stop",)]
    for pieces in (0, 40):
        axis = Axis(case.values)
        axis.command("steps", case.steps)
        for k, command in enumerate(commands):
            due = (0.3 + 0.2 * k) * end
            for part in np.sort(draw.random(pieces)):
                axis.advance(max(axis.state.t, part * due))
            axis.advance(due)
            axis.command(*command)
        axis.advance(1.1 * end)
        found.append([axis.state.x, axis.state.v, axis.state.z, axis.state.u])
    return apart(found[1], found[0], 0.0, "the state")


def sensor_fault(case: Case) -> str:
    faults, found = ("sensor_freeze", "sensor_dropout", "sensor_spike", "sensor_drift"), []
    end = abs(case.steps) * period_of(case)
    for fault in ("", faults[case.seed % len(faults)]):
        axis = Axis({**case.values, "allow_faults": True})
        axis.command("steps", case.steps)
        axis.advance(0.4 * end)
        axis.command("parameters", {"fault": fault})
        axis.advance(end)
        found.append(axis.state.x)
    return apart(found[1], found[0], CYCLE * abs(case.steps))


def _in_node(case: Case, others: dict[str, dict[str, Any]], record: bool = False) -> str:
    from rclpy.logging import set_logger_level

    from stickslip_ros.ros.nodes.recorder_node import RecorderNode
    from stickslip_ros.ros.testing.in_process import InProcess
    from stickslip_ros.testing import own_domain
    from validation.campaigns.topics import send_steps

    set_logger_level("", 40)  # errors
    folder, lasts = Path.cwd(), abs(case.steps) * period_of(case) + 0.1
    values = {**case.values, "publish_rate": float(np.clip(20.0 / lasts, 0.1, 1000.0))}
    with own_domain(folder, os.environ.__setitem__):
        world = InProcess(folder, values, others, own_time=True)
        try:
            recorder: Any = None
            if record:
                overrides = ["--ros-args", "-p", f"output:={folder / 'bag'}"]
                recorder = world.add(RecorderNode(context=world.context, cli_args=overrides))
                until = time.monotonic() + 10.0
                while (
                    not recorder.get_subscriptions_info_by_topic(
                        f"{world.nodes[0].get_fully_qualified_name()}/truth"
                    )
                    and time.monotonic() < until
                ):
                    time.sleep(0.05)
            world.run(0.1)
            begun = world.nodes[0].axis.state.t
            send_steps(world, case.steps)
            world.run(lasts)
            axis = world.nodes[0].axis
            found, p, now = axis.state.x, axis.parameters, axis.state.t
            if recorder:
                recorder.close()
        finally:
            world.close()
    alone = Axis(p)
    alone.advance((round(1e9 * begun) + 1) * 1e-9)  # a command comes after the state before it
    alone.command("steps", case.steps)
    alone.advance(now)
    return apart(found, alone.state.x, 0.0) or (_again(folder / "bag") if record else "")


def node(case: Case) -> str:
    return _in_node(case, {})


def others(case: Case) -> str:
    lighter = {"preload": 0.6 * case.values["preload"]}
    return _in_node(case, {"x": {}, "y": lighter, "z": {"model": "lugre"}})


# -- a recording


def recorded(case: Case) -> Path:
    """Record the axes of a case; return the bag."""
    names = {"three axes": ("a", "b", "c"), "another name": ("slider_7",)}.get(
        case.chosen.get("axes", ""), ("a",)
    )
    axes = [Axis({**case.values, "axis_name": one}) for one in names]
    lasts = min(max(abs(case.steps) * period_of(case), 0.3), 30.0)
    every, command = max(10_000_000, int(lasts / 40 * 1e9)), case.chosen.get("command", "steps")
    with Recorder("bag", "anc300", axes, lambda: START) as recorder:
        for k in range(1, 51):
            for number, axis in enumerate(axes):
                axis.advance(k * every * 1e-9)
                if k == 3 + number and command == "target":
                    axis.command("position", math.copysign(3e-7, case.steps))
                elif k == 3 + number:
                    axis.command(command, case.steps)
                elif k == 30:
                    axis.command("stop")
                elif k == 20:
                    axis.command("amplitude", 0.6 * case.values["amplitude"])
            recorder.take()
    return Path("bag")


def _again(bag: Path, out: Path | None = None) -> str:
    with open_bag(bag) as opened:
        runs = resimulate(opened, {}, out)
    differs = {k: v.largest for run in runs for k, v in run.differences.items() if v.largest}
    if not all(run.states for run in runs):
        return "no state is simulated again"
    return "" if all(run.bit_for_bit for run in runs) else f"simulated again it differs: {differs}"


def _messages(bag: Path) -> list[tuple[str, int, bytes]]:
    with AnyReader([bag]) as reader:
        return [(one.topic, ns, bytes(data)) for one, ns, data in reader.messages()]


def resimulated(case: Case) -> str:
    return _again(recorded(case), Path("copy")) or _again(Path("copy"))


def recovered(case: Case) -> str:
    bag = recorded(case)
    whole, (file,) = _messages(bag), bag.glob("*.mcap")
    data = file.read_bytes()
    file.write_bytes(data[: int(len(data) * (0.4 + 0.5 * (case.seed % 100) / 100))])
    (bag / "metadata.yaml").unlink()
    if not recover(bag, "mended").messages:
        return "doubted: 0 messages kept"
    kept = _messages(Path("mended"))
    if kept != whole[: len(kept)]:
        return f"{len(kept)} messages of {len(whole)} are recovered, not the first ones"
    return _again(Path("mended"))


def exported(case: Case) -> str:
    told("bag", "export", recorded(case), "--out", "tables")
    for file in Path("tables").glob("*.truth.csv"):
        name = file.name.partition(".")[0]
        table = np.genfromtxt(file, delimiter=",", names=True, deletechars="")
        with AnyReader([Path("bag")]) as reader:  # which is not ours
            chosen = [one for one in reader.connections if one.topic == f"/{name}/truth"]
            truth: list[Any] = [
                reader.deserialize(data, one.msgtype) for one, _, data in reader.messages(chosen)
            ]
        positions_of = [one.position[0] for one in truth]
        if said := apart(table[f"{name}_slider/position"], positions_of, 0.0):
            return said
    return ""


def recorder(case: Case) -> str:
    return _in_node(case, {}, record=True)


# -- a measured file


def _measured(case: Case) -> tuple[ss.SimulatedRun, Array, Array]:
    """Return a run, and times (s) and positions (m) as its sensor reads them, or some of them."""
    p, draw = Parameters.of(case.values), np.random.default_rng(case.seed)
    lasts = (abs(case.steps) + 2) * period_of(case)
    rate = max(40.0 / period_of(case), 12.0 * ss.simulate(p, steps=1).parameters.sensor.sensor_rate)
    run = ss.simulate(p.replace(sensor_rate=min(rate, 1e5, 6e4 / lasts)), steps=case.steps)
    t, x = run.readings.t, run.readings.x
    kept = np.ones(len(t), dtype=bool)
    if case.chosen["gaps"] == "lines missing":
        for begin in draw.integers(0, len(t), 3):
            kept[begin : begin + len(t) // 200] = False
    elif case.chosen["gaps"] == "ends in the run":
        kept[int(0.6 * len(t)) :] = False
    return run, t[kept], SIGNS[case.chosen["sign"]] * x[kept]


def _write(case: Case, t: Array, x: Array) -> Path:
    """Write the file of a case; return its path."""
    kind, unit, clock = (case.chosen[cross] for cross in ("file", "units", "clock"))
    x = x * {"m": 1.0, "nm": 1e9, "um": 1e6}[unit]
    t, of_time = (1e3 * t, "ms") if clock == "in ms" else (t, "s")
    t = t + 1000.0 if clock == "from 1000 s" else t
    names = f"time_{of_time}", f"position_{unit}"
    if kind == "npz":
        np.savez(path := Path("record.npz"), **{names[0]: t, names[1]: x})  # type: ignore[arg-type]
    elif kind == "mat":
        scipy.io.savemat(path := Path("record.mat"), dict(zip(names, (t, x), strict=True)))
    elif kind == "hdf5":
        import h5py

        with h5py.File(path := Path("record.h5"), "w") as file:
            for column, values, of in (("time", t, of_time), ("position", x, unit)):
                file[f"bench/{column}"] = values
                file[f"bench/{column}"].attrs["units"] = of
    elif kind == "tdms":
        from nptdms import ChannelObject, TdmsWriter

        with TdmsWriter(path := Path("record.tdms")) as file:
            columns = (("time", t, of_time), ("position", x, unit))
            file.write_segment(
                [ChannelObject("g", one, v, properties={"unit_string": of})
                 for one, v, of in columns]
            )  # fmt: skip
    else:
        delimiter = {"csv": ",", "semicolons": ";", "tabs": "\t"}[kind]
        heading = delimiter.join((f"time ({of_time})", f"position ({unit})"))
        text = io.StringIO()
        np.savetxt(text, np.c_[t, x], "%.12g", delimiter, header=heading, comments="")
        path = Path("record.csv")
        comma = kind == "semicolons"
        path.write_text(text.getvalue().replace(".", ",") if comma else text.getvalue())
    return path


def _seen(case: Case, run: ss.SimulatedRun, path: Path, whole: bool) -> str:
    """Return what is wrong with what is found in a file of a run."""
    sensor, size = run.parameters.sensor, SIGNS[case.chosen["sign"]] * run.step_size
    noise = sensor.sensor_noise + (sensor.sensor_resolution or 0.0)
    drift = abs(sensor.sensor_drift) * period_of(case)
    told_it = case.values["frequency"] if "told" in case.chosen else None
    found = ss.find_runs(path, frequency=told_it)
    least = max(noise + 1e-10, 0.02 * (0.0 if math.isnan(run.backstep) else run.backstep))
    if not found and abs(size) < least:
        return "doubted: no steps are seen"  # of a drive that hardly makes any
    if not found:
        ss.analyse(path)  # says why not
        return "there is no run, and one"
    if doubts := [doubt for one in found for doubt in one.doubts]:
        return f"doubted: {doubts[0]}"
    steps, whole = (
        sum(one.steps for one in found),
        whole and case.chosen["gaps"] != "ends in the run",
    )
    even = float(np.ptp(run.steps[-2:] if whole else run.steps))  # those of a part differ
    if whole and steps != abs(case.steps):
        return f"{steps} steps are found, not {case.steps}: {found}"
    for one in found:
        allowed = max(4.0 * one.step_size_error, 0.4e-9, 0.3 * noise, even) + drift
        if said := apart(one.step_size, size, allowed, f"the step of {one}, not {size:.5g},"):
            return said
        allowed = max(4.0 * one.backstep_error, 5e-10 + noise, 0.03 * run.backstep)
        known = not math.isnan(one.backstep + run.backstep) and abs(case.steps) > 2
        known = known and not sensor.sensor_bandwidth  # which shows less of it
        if known and (said := apart(one.backstep, run.backstep, allowed, "the backstep")):
            return f"{said}: {one.backstep:.5g}, not {run.backstep:.5g}"
    return ""


def table(case: Case) -> str:
    run, t, x = _measured(case)
    return _seen(case, run, _write(case, t, x), whole=True)


def cut_in_two(case: Case) -> str:
    run, t, x = _measured(case)
    half = len(t) // 2
    said = [
        _seen(case, run, _write(case, t[part], x[part]), whole=False)
        for part in (slice(half), slice(half, None))
    ]
    return next((one for one in said if not one.startswith("doubted")), said[0])


def _as_moved(case: Case) -> tuple[ss.SimulatedRun, Path]:
    """Return a run and its file, which no sensor that looks the other way has seen."""
    run, t, x = _measured(case)
    return run, _write(case, t, SIGNS[case.chosen["sign"]] * x)


def compared(case: Case) -> str:
    run, path = _as_moved(case)
    found = ss.compare(run.parameters, path)
    return f"{found.differing} differ from the drive's own" if found.differing else ""


def other_drive(case: Case) -> str:
    run, path = _as_moved(case)
    other = run.parameters.replace(preload=1.4 * case.values["preload"])
    change = abs(ss.simulate(other, steps=case.steps).step_size - run.step_size)
    found = ss.compare(other, path)
    sensor = run.parameters.sensor
    clear = 5e-9 + 4.0 * sensor.sensor_noise + 2.0 * (sensor.sensor_resolution or 0.0)
    clear += 3.0 * float(np.ptp(run.steps))  # behind a spring the steps become smaller
    missed = change > clear and not found.differing and abs(case.steps) > 2
    return f"a step that is {change:.3g} off is not told" if missed else ""


def identified(case: Case) -> str:
    run, path = _as_moved(case)
    truth = case.values["sigma_1"]
    start = run.parameters.replace(sigma_1=1.3 * truth)
    Path("drive.yaml").write_text(yaml_text(start))
    out = told("identify", "--run", "drive.yaml", path, "--fit", "sigma_1", "--json")
    fit = json.loads(out)
    one = fit["parameters"]["sigma_1"]
    if fit["misfit"] or not one["determined"]:
        return f"doubted: {fit['misfit'] or 'not determined'}"
    wide = one["high"] - one["low"]
    if one["low"] - 0.5 * wide <= truth <= one["high"] + 0.5 * wide:
        return ""
    again = ss.simulate(run.parameters.replace(sigma_1=one["value"]), steps=case.steps)
    return f"sigma_1 is {truth:.5g}, found {one}, and a step {again.step_size - run.step_size} off"


# -- a design


def sweep(case: Case) -> str:
    steps, preloads = case.steps, [f * case.values["preload"] for f in (0.8, 1.0, 1.25)]
    metrics = ["step_size", "backstep", "mean_speed"]
    found = ss.sweep({**case.values, "preload": 0.4}, preload=preloads, metric=metrics, steps=steps)
    for k, preload in enumerate(preloads):
        run = ss.simulate({**case.values, "preload": preload}, steps=steps)
        swept = [found[name][k] for name in metrics]
        single = [run.step_size, run.backstep, run.mean_speed]
        scale = np.array([1.0, 1.0, 1.0 / run.parameters.drive.frequency])
        said = apart(swept * scale, single * scale, SAME * 10, f"a metric of {metrics}")
        if said := stable(run, said):
            return said
    return ""


def predicted(case: Case) -> str:
    found = ss.predict(case.values)
    run = ss.simulate(case.values, steps=200)
    said = apart(found.step, run.step_size, 1.5 * found.error + 1e-12, "the predicted step")
    return f"doubted: without {found.left_out}, {said}" if said and found.left_out else said


def inverse(case: Case) -> str:
    wanted = 0.5 * Parameters.of(case.values).actuator.gain * case.values["amplitude"]
    found = ss.predict(case.values, step=wanted)
    run = ss.simulate({**case.values, "amplitude": found.amplitude}, steps=200)
    said = apart(run.step_size, wanted, 2.0 * found.error + 1e-12, "the step at that amplitude")
    return f"doubted: without {found.left_out}, {said}" if said and found.left_out else said


def command(case: Case) -> str:
    words = words_of(case.values)
    if case.seed % 2:
        Path("drive.yaml").write_text(yaml_text(Parameters.of(case.values)))
        words = ["--config=drive.yaml"]
    found = told("simulate", f"--steps={case.steps}", "--json", *words)
    run = ss.simulate(case.values, steps=case.steps)
    return apart(json.loads(found)["position"], run.position, 0.0)


def trace(case: Case) -> str:
    case = case._replace(steps=max(-30, min(case.steps, 30)))  # more are hundreds of megabytes
    words = [f"--steps={case.steps}", *words_of(case.values)]
    told("simulate", "--trace", "trace.csv", "--table", "steps.csv", *words)
    t, x, *_ = np.genfromtxt("trace.csv", delimiter=",", skip_header=1).T
    rows = np.genfromtxt("steps.csv", delimiter=",", skip_header=1, ndmin=2)
    ends = period_of(case) * np.arange(1, abs(case.steps) + 1)
    at = np.interp(ends, t, x)
    return apart(at, ss.simulate(case.values, steps=case.steps).position, 2e-11) or apart(
        rows[:, -1], np.diff(at, prepend=0.0), 4e-11, "a step of the table"
    )


def waveform_file(case: Case) -> str:
    search = ("shape", "elongate")[case.seed % 2]
    told(search, "--out", "found.yaml", "--waveform", "found.csv", *words_of(case.values))
    found = ss.simulate("found.yaml", steps=3)
    of_file = {"waveform": "table", "waveform_table": "found.csv", "hold_before": 0.0,
               "hold_after": 0.0}  # fmt: skip
    run = ss.simulate("found.yaml", **of_file, steps=3)
    return stable(run, apart(run.position, found.position, 3 * CYCLE))


def as_ours(case: Case) -> str:
    model = case.values["model"].removeprefix("my_")
    ours = {**case.values, "model": model, "preload_ratio": 2.0}
    if ours.get("waveform") == "my_ramp":
        ours["waveform"] = "sawtooth"
    run = ss.simulate(ours, steps=case.steps)
    mine = ss.simulate(case.values, steps=case.steps).position
    return stable(run, apart(mine, run.position, 0.0))


# -- a lab program


def emulated(case: Case, record: Path | None = None) -> str:
    controller, second = case.chosen["controller"], case.chosen["slot"] == "second"
    slot = int(second and controller != "e871")
    values = {**case.values, "max_voltage": 300.0, "frequency": round(case.values["frequency"])}
    values["amplitude"] = 45.0 if controller == "amc" else 100.0  # what each may have
    names = ("a", "b")[: 1 + slot]
    axes = [Axis({**values, "axis_name": name}) for name in names]
    served, count = Emulated(controller, axes, record), abs(case.steps)
    axis, back = axes[slot], case.steps < 0
    line = SENT[controller].format(
        s=slot + (controller == "anc300"), f=values["frequency"], a=values["amplitude"],
        n=count, m=case.steps, d="d" if back else "u", D="D" if back else "U",
        v=1000 * round(values["amplitude"]), h=1000 * values["frequency"], b=str(back).lower(),
    )  # fmt: skip
    try:
        with served.client() as client:
            client.send(line.encode())
            deadline = time.monotonic() + 30.0
            while not served.look(lambda: axis.status.step_count):
                assert time.monotonic() < deadline, f"no step comes of {line!r}"
                time.sleep(1e-3)
            if stop := case.chosen["end"] == "stopped":
                served.look(lambda: axis.command("stop"))
            while served.look(lambda: axis.moving):
                if time.monotonic() > deadline:  # on a machine too slow for it
                    done = served.look(lambda: axis.status.step_count)
                    return f"doubted: {done} steps are done in 30 s" if done else "no step is done"
                time.sleep(1e-3)
            status = served.look(lambda: axis.status)
    finally:
        served.close()
    drive = {"amplitude": status.amplitude, "frequency": status.frequency}
    asked = {"amplitude": values["amplitude"], "frequency": values["frequency"]}
    if said := apart(list(drive.values()), list(asked.values()), 1e-6, f"the drive {drive}"):
        return said
    if not stop and status.step_count != case.steps:
        return f"{status.step_count} steps are done of {case.steps}"
    run = ss.simulate({**values, **drive}, steps=status.step_count)
    way = status.mean_step * abs(status.step_count)
    # Under a load it moves, and some contacts age, before the command comes.
    if {"force", "inclination", "dwell_growth"} & values.keys() or LAWS[values["model"]].rate:
        return ""
    return stable(run, apart(way, run.position[-1], CYCLE * count))


def emulation_recorded(case: Case) -> str:
    return emulated(case, Path("bag").absolute()) or _again(Path("bag"))


# -- commands elsewhere


def elsewhere(case: Case) -> str:
    model, machine = case.values["model"], case.chosen["machine"]
    words = {
        "simulate": ["simulate", "--steps=5", "--json", f"--set=model={model}", "--set=preload=1"],
        "sweep": ["sweep", "--vary=preload=0.7:1.3:3", "--json", f"--set=model={model}"],
        "trace": ["simulate", "--steps=2", "--trace={}/t.csv", f"--set=model={model}",
                  "--set=preload=1", "--json"],
        "report": ["simulate", "--steps=3", "--report={}/r.html", "--json", "--set=preload=1"],
    }[case.chosen["command"]]  # fmt: skip
    here, there, folder = (Path(one).absolute() for one in ("here", "there", "cwd"))
    for one in (here, there, folder):
        one.mkdir()
    right = told(*(word.format(here) for word in words))
    before = {"nohup": ["nohup"], "no network": ["unshare", "-rn"]}.get(machine, [])
    if machine == "read-only":
        folder.chmod(0o555)
    done = subprocess.run(
        [*before, sys.executable, "-m", "stickslip_ros", *(word.format(there) for word in words)],
        env={**os.environ, **MACHINES.get(machine, {})}, cwd=folder, capture_output=True,
        text=True, encoding="utf-8", timeout=SECONDS, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    if done.returncode not in (0, 1) or "Traceback" in done.stderr:
        return f"exit code {done.returncode}: {done.stderr[-500:]}"
    files = [sorted(path.name for path in one.rglob("*")) for one in (here, there)]
    if done.stdout.replace(str(there), str(here)) != right or files[0] != files[1]:
        return f"it prints {done.stdout[:200]!r}, here {right[:200]!r}; files {files}"
    same = all((there / one.name).read_bytes() == one.read_bytes() for one in here.glob("*.csv"))
    return "" if same else "its trace has other numbers"


# -- a twin


def _log(case: Case) -> tuple[Parameters, Log, float, float]:
    """Return the drive, commands and readings of an axis that changes, its steps before, after."""
    p, draw = Parameters.of(case.values), np.random.default_rng(case.seed)
    change, share = case.chosen["change"], float(draw.uniform(0.2, 0.5))
    other = {
        "nothing": {}, "sensor gain": {},
        "preload": {"preload": case.values["preload"] * (1.0 + share)},
        "payload": {"payload": p.runner.payload + share * p.runner.mass},
        "amplifier": {"gain": p.actuator.gain * (1.0 - 0.3 * share)},
    }[change]  # fmt: skip
    axis, log, gain = Axis(p), Log(), 1.0
    period = period_of(case)
    for k in range(1, 241):
        if k == 10:
            log.append(TwinCommand(axis.state.t, "steps", float(case.steps)))
            axis.command("steps", case.steps)
        elif k == 120:
            axis.command("parameters", other)
            gain = 1.0 - 0.3 * share if change == "sensor gain" else 1.0
        uneven = 0.0 if case.chosen["readings"] == "even" else 0.4 * draw.random()
        axis.advance((k + uneven) * 1.37 * max(period, 5e-3))
        reading = (axis.state.t, gain * axis.state.x + 2e-9 * float(draw.standard_normal()))
        if case.chosen["readings"] != "with a gap" or not 60 <= k < 80:
            log += [reading] * (2 if case.chosen["readings"] == "twice" else 1)
    way = math.copysign(1.0, case.steps)
    before, after = (ss.simulate(p.replace(**one), steps=200).step_size for one in ({}, other))
    return p, log, way * before, way * gain * after


def _beside(p: Parameters, log: Log) -> Twin:
    twin = Twin(p)
    for _ in feed(twin, log):
        pass
    return twin


def of_twin(case: Case) -> str:
    p, log, before, after = _log(case)
    twin, change = _beside(p, log), case.chosen["change"]
    said = f"{twin.level[0]}: {[one.text for one in twin.changes]}"
    if change == "nothing":
        return "" if not twin.changes and twin.level[0] in ("ok", "blind") else f"{said}; none was"
    if not twin.changes:
        seen = abs(after - before) > 3e-9 and twin.level[0] == "ok"
        return f"{said}; the step went from {before:.5g} to {after:.5g}" if seen else ""
    judged = [one.verdict for one in twin.changes if one.verdict]
    if any(one.cause is not None and one.cause != change for one in judged):
        return f"{said}; it was {change}"
    return f"doubted: {said}" if any(change not in one.possible for one in judged) else ""


def of_a_table(case: Case) -> str:
    """What the command says of a file is what the twin said beside the axis."""
    p, log, *_ = _log(case)
    twin = _beside(p, log)
    readings = [one for one in log if not isinstance(one, TwinCommand)]
    commands = [one for one in log if isinstance(one, TwinCommand)]
    rows = "".join(f"{t!r},{x!r}\n" for t, x in readings)
    Path("readings.csv").write_text(f"time (s),position (m)\n{rows}")
    sent = "".join(f"{one.t!r},{one.name},{one.value!r}\n" for one in commands)
    Path("sent.csv").write_text(f"time,command,value\n{sent}")
    Path("drive.yaml").write_text(yaml_text(p))
    words = ("readings.csv", "--drive", "sent.csv", "--config", "drive.yaml", "--json")
    found = json.loads(told("twin", *words))
    texts = [one["text"] for one in found["changes"]], [one.text for one in twin.changes]
    return "" if texts[0] == texts[1] else f"of the file {texts[0]}, beside the axis {texts[1]}"


#: By their names in the table
JUDGES: dict[str, Callable[[Case], str]] = {
    "library": library, "later": later, "mirrored": mirrored, "two moves": two_moves,
    "divided": divided, "sensor fault": sensor_fault, "node": node, "others": others,
    "resimulated": resimulated, "recovered": recovered, "exported": exported, "recorder": recorder,
    "table": table, "cut in two": cut_in_two, "compared": compared,
    "other drive": other_drive, "identified": identified,
    "integrator": integrator, "sweep": sweep, "predicted": predicted, "inverse": inverse,
    "command": command, "prefix": prefix, "trace": trace,
    "waveform file": waveform_file, "as ours": as_ours,
    "emulated": emulated, "emulation recorded": emulation_recorded,
    "elsewhere": elsewhere, "told": of_twin, "of a table": of_a_table,
}  # fmt: skip
