# SPDX-License-Identifier: Apache-2.0
"""The whole thing over ROS 2: axis and recorder as processes, three moves, a bag, a picture.

`stickslip demo` and `make demo` run it. It leaves whole results or none. It comes with the package
and uses modules that are private, for the picture and the processes; a program of your own has the
public names.
"""

from __future__ import annotations

import contextlib
import shutil
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from std_srvs.srv import Trigger

from stickslip_ros import Parameters, StickslipError, decoder_for, open_bag, read_yaml
from stickslip_ros.base.child_process import ChildError, child_node, choose_domain
from stickslip_ros.base.compiled import report_compilation
from stickslip_ros.base.files import WriteError, writing
from stickslip_ros.base.reporting import SIMULATED
from stickslip_ros.cli.pages.response import draw_closer, draw_cycles
from stickslip_ros.client import AxisClient
from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.parameters.parameters import yaml_text
from stickslip_ros.simulation.phases import points
from stickslip_ros.simulation.sampling import trace_steps
from stickslip_ros.simulation.steps import StepRun, run_steps

_AXIS, _RECORDER = "/stickslip_axis", "/stickslip_recorder"
_TIMEOUT = 60.0
#: Cycles of the picture: three are shown, the end of the last backstep lies in the fourth
_TRACED = 4


class DemonstrationError(StickslipError):
    """A process of the demo did not do its part; the message holds its last words."""


@dataclass(frozen=True)
class Move:
    """Steps (sign: direction) at an amplitude (V) and a frequency (Hz)."""

    amplitude: float
    frequency: float
    steps: int


@dataclass(frozen=True)
class Recorded:
    """What the bag of a demo holds."""

    t: NDArray[np.float64]  #: times of the joint states since the first, s
    x: NDArray[np.float64]  #: runner position, m
    moves: list[dict[str, str]]  #: values of the events "move finished"
    friction: list[dict[str, str]]  #: values of the status friction, the first after each move
    timing: list[dict[str, str]]  #: values of the status timing
    messages: int  #: in the bag


_MOVES = (Move(300.0, 1000.0, 200), Move(300.0, 1000.0, -200), Move(300.0, 100.0, 20))


def run(out: Path, config: Path) -> None:
    """Run the demo with a file of parameters; put bag, picture and table into the folder out."""
    p = read_yaml(config)
    if (out / "bag").exists() and not (out / "summary.txt").exists():
        raise DemonstrationError(f"{out / 'bag'} is not of an earlier demo; choose another --out")
    with report_compilation():
        run_steps(p, 1)  # so that the nodes find the solver compiled
    new = not out.exists()
    try:
        out.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(dir=out, prefix=".new-"))
    except OSError as error:
        raise WriteError(out, error) from None
    try:
        print("axis and recorder start as two processes; three moves over DDS ...", flush=True)
        of_node = work / "parameters.yaml"  # a file for commands has no sections for nodes
        of_node.write_text(yaml_text(p), encoding="utf-8")
        recorded = demonstrate(work / "bag", of_node, _MOVES)
        of_node.unlink()
        _draw(work / "response.png", p, recorded)
        table = table_of(p, recorded)
        with writing(out):
            (work / "summary.txt").write_text(table + "\n", encoding="utf-8")
            put_in_place(work, out)
    except (DemonstrationError, ChildError, TimeoutError, ValueError) as error:
        raise DemonstrationError(f"the demo did not end well: {error}") from None
    finally:
        shutil.rmtree(work, ignore_errors=True)
        if new and not any(out.iterdir()):
            out.rmdir()
    print(table)
    print(f"bag: {out / 'bag'}   picture: {out / 'response.png'}")


def demonstrate(bag: Path, config: Path, moves: Sequence[Move]) -> Recorded:
    """Run moves on an axis process, recorded by a recorder process; return what the bag holds."""
    choose_domain()
    with (
        child_node("recorder_node", bag.parent, "-p", f"output:={bag}") as recorder,
        child_node("axis_node", bag.parent, "--params-file", str(config)) as axis,
    ):
        recorder.wait_for("recording")
        axis.wait_for("ready")
        # First contact may take seconds, and what is published before it nobody records.
        recorder.wait_for("first message of /joint_states")
        # The recorder is to hear the commands too.
        with AxisClient(_AXIS, listeners=2) as client:
            for move in moves:
                client.send("amplitude", move.amplitude).send("frequency", move.frequency)
                client.send("steps", move.steps).wait(_TIMEOUT)
                moved = f"{move.steps:+d} steps at {move.frequency:g} Hz"
                position = 1e9 * client.position
                print(f"{moved:<22} the runner comes to rest at {position:.0f} nm", flush=True)
                client.report()
            stop_recorder(client)
        recorder.ended()
    recorded = _read(bag)
    if len(recorded.friction) != len(moves):
        raise DemonstrationError(
            f"the bag holds {len(recorded.friction)} reports on {len(moves)} moves"
        )
    return recorded


def stop_recorder(client: AxisClient) -> None:
    """Have the recorder close its bag and end."""
    recorder = client.node.create_client(Trigger, f"{_RECORDER}/stop")
    if not recorder.wait_for_service(_TIMEOUT):
        raise DemonstrationError(f"nobody offers {_RECORDER}/stop: is the recorder gone?")
    answer: Any = recorder.call(Trigger.Request(), _TIMEOUT)
    if not (answer and answer.success):
        raise DemonstrationError(f"the recorder did not close its bag: {answer}")


def _read(bag: Path) -> Recorded:
    t, x = [], []
    moves: list[dict[str, str]] = []
    statuses: dict[str, list[dict[str, str]]] = {"friction": [], "timing": []}
    with open_bag(bag) as opened:
        decoders = {
            name: decoder_for(opened.topics[name]) for name, n in opened.counts.items() if n
        }
        messages = opened.message_count
        for found in opened.messages():
            message = decoders[found.topic](found.data)
            if found.topic == "/joint_states":
                t.append(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)
                x.append(message.position[0])
            for status in getattr(message, "status", ()):
                values = {pair.key: pair.value for pair in status.values}
                kind = status.name.rpartition(": ")[2]
                if status.message == "move finished":
                    moves.append(values)
                    statuses["friction"].append({})
                elif kind in statuses:
                    statuses[kind].append(values)
    friction = _first_after_each_move(statuses["friction"])
    return Recorded(np.array(t) - t[0], np.array(x), moves, friction, statuses["timing"], messages)


def _first_after_each_move(friction: list[dict[str, str]]) -> list[dict[str, str]]:
    """Return the first status after each end of a move, which an empty one marks."""
    return [after for before, after in pairwise(friction) if not before and after]


def put_in_place(work: Path, out: Path) -> None:
    """Move finished results into place; those of an earlier run give way, but not if that fails."""
    names = sorted(new.name for new in work.iterdir())
    earlier = work / "earlier"
    earlier.mkdir()
    moved: list[tuple[Path, Path]] = []

    def move(old: Path, new: Path) -> None:
        old.rename(new)
        moved.append((old, new))

    try:
        for name in names:
            if (out / name).exists():
                move(out / name, earlier / name)
            move(work / name, out / name)
    except OSError:
        for old, new in reversed(moved):
            with contextlib.suppress(OSError):
                new.rename(old)
        raise


def _draw(path: Path, p: Parameters, recorded: Recorded) -> None:
    """Write a PNG: the recorded run, three cycles from rest, three looks closer."""
    slow = p.replace(frequency=_MOVES[-1].frequency, amplitude=_MOVES[-1].amplitude)
    trace, drive_cycle, contact = trace_steps(slow, _TRACED), drive_of(slow), Plant.of(slow).contact
    cycles = [points(trace, drive_cycle, contact, k) for k in range(3)]
    figure = Figure(figsize=(11, 12), layout="constrained")
    grid = figure.add_gridspec(3, 3, height_ratios=(1, 1.7, 1.5))
    axes = figure.add_subplot(grid[0, :])
    t = recorded.t - recorded.t[0]
    axes.plot(t, 1e6 * recorded.x, ".-", color=SIMULATED, markersize=3, linewidth=1)
    axes.set(
        xlabel="time (s)",
        ylabel="runner (µm)",
        title="the run as its sensor reads it (joint_states)",
    )
    axes.grid(alpha=0.3)
    overview = figure.add_subplot(grid[1, :])
    draw_cycles(overview, trace, drive_cycle, cycles)
    slipping = drive_cycle.slip_duration
    looks = (
        ("AB", "A", (-5e-6, 150e-6), "the start: presliding"),
        ("CD", "C", (-0.2 * slipping, slipping), "the slip of the actuator"),
        ("CDEF", "C", (-20e-6, 400e-6), "backstep and ringing"),
    )
    for column, (names, origin, window, what) in enumerate(looks):
        axes = figure.add_subplot(grid[2, column])
        draw_closer(axes, trace, cycles[0], names, cycles[0][origin], window, what)
    handles, labels = overview.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=9)
    axis = f"{p.friction.preload:g} N, {1e3 * p.runner.mass:g} g, {slow.drive.amplitude:g} V"
    law = p.friction.model.upper()
    figure.suptitle(f"stick-slip axis: {law}, {axis}; points as in Fig. 2 of Edeler et al. 2011")
    figure.savefig(path, dpi=110, format="png")


def table_of(p: Parameters, recorded: Recorded) -> str:
    """Return the moves, settled as `stickslip simulate` has them, beside what was recorded."""
    lines = [
        f"{'':<22}{'+200 at 1 kHz':>16}{'-200 at 1 kHz':>16}{'+20 at 100 Hz':>16}{'Table 1':>14}"
    ]

    def row(name: str, values: list[str], paper: str = "") -> None:
        lines.append(f"{name:<22}{''.join(f'{value:>16}' for value in values)}{paper:>14}")

    runs, speeds = zip(*(_simulate(p, move) for move in _MOVES), strict=True)
    friction = recorded.friction
    row("step size (nm)", [_nano(run.step_size) for run in runs], "130")
    row("backstep (nm)", [_nano(run.backstep) for run in runs])
    shares = [run.backstep / abs(run.step_size) for run in runs]
    row("backstep (% of step)", [f"{100 * share:.0f}" for share in shares], "30")
    means = [run.step_size * move.frequency for run, move in zip(runs, _MOVES, strict=True)]
    row("mean speed (um/s)", [f"{1e6 * mean:.2f}" for mean in means])
    row("0-amplitude (nm)", [_nano(f["0-amplitude (m)"]) for f in friction])
    row("end of last step (nm)", [_nano(move["position"]) for move in recorded.moves])
    row(
        "ringing (kHz)", [f"{1e-3 * float(f['ringing frequency (Hz)']):.2f}" for f in friction], "4"
    )
    row("solver, x real time", [f"{speed:.0f}" for speed in speeds])
    last = recorded.timing[-1]
    factors = [float(timing["real-time factor"]) for timing in recorded.timing[1:]]
    lines.append("")
    lines.append(f"{'real-time factor':<22}{sum(factors) / len(factors):>16.4f}")
    lines.append(f"{'deadlines missed':<22}{last['missed deadlines']:>16}")
    lines.append(f"{'messages recorded':<22}{recorded.messages:>16}")
    lines.append("")
    lines.append(
        "Step size, backstep and speed are of settled steps, as `stickslip simulate` has it."
    )
    lines.append("The last step ends before its backstep, after which the runner comes to rest.")
    lines.append(
        "Table 1 measures 4 kHz; Eq. 14, fitted to forces, gives 7.5 kHz at this preload and mass."
    )
    lines.append("config/table1_vibration.yaml takes the stiffness from the 4 kHz instead.")
    return "\n".join(lines)


def _nano(metres: str | float) -> str:
    return f"{1e9 * float(metres):.2f}"


def _simulate(p: Parameters, move: Move) -> tuple[StepRun, float]:
    """Return a move from rest, and simulated time by computing time, the best of three."""
    q = p.replace(amplitude=move.amplitude, frequency=move.frequency)
    best = float("inf")
    for _ in range(3):
        started = time.perf_counter()
        run = run_steps(q, move.steps)
        best = min(best, time.perf_counter() - started)
    return run, abs(move.steps) / move.frequency / best
