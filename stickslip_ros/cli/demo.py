# SPDX-License-Identifier: Apache-2.0
"""``stickslip demo``: a real axis node and recorder, three moves, a bag, a table and a picture."""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from stickslip_ros.cli.options import UsageError
from stickslip_ros.compiled import telling_when_compiling
from stickslip_ros.files import WriteError
from stickslip_ros.model import drive_of, plant_of
from stickslip_ros.parameters import Parameters, read_yaml
from stickslip_ros.traces import run_steps, trace_steps
from stickslip_ros.traces.response_plot import plot_response

if TYPE_CHECKING:
    from stickslip_ros.ros.demonstration import Recorded

#: V, Hz, steps of each move
_MOVES = ((300.0, 1000.0, 200), (300.0, 1000.0, -200), (300.0, 100.0, 20))
#: Cycles of the picture: three are shown, the end of the last backstep lies in the fourth
_TRACED = 4


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    parser = subparsers.add_parser("demo")
    parser.add_argument(
        "--out", type=Path, default=Path("demo"), metavar="DIR", help="(default: demo)"
    )
    parser.add_argument(
        "--config", type=Path, metavar="FILE.yaml", help="(default: config/table1_typical.yaml)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    try:
        from stickslip_ros.ros.demonstration import DemonstrationError, Move, demonstrate
    except ImportError as error:
        raise UsageError(f"needs ROS 2: source it or use `make demo` ({error})") from None
    config = args.config or _default_config()
    p = read_yaml(config)
    out: Path = args.out
    if (out / "bag").exists() and not (out / "summary.txt").exists():
        raise UsageError(f"{out / 'bag'} is not of an earlier demo; choose another --out")
    with telling_when_compiling():
        run_steps(p, 1)  # so that the nodes find the solver compiled
    new = not out.exists()
    try:
        out.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(dir=out, prefix=".new-"))
    except OSError as error:
        raise WriteError(out, error) from None
    try:
        print("axis and recorder start as two processes; three moves over DDS ...", flush=True)
        moves = [Move(*move) for move in _MOVES]
        recorded = demonstrate(work / "bag", config, moves)
        _draw(work / "response.png", p, recorded)
        table = _table(p, recorded)
        (work / "summary.txt").write_text(table + "\n", encoding="utf-8")
        _replace(work, out)
    except (DemonstrationError, TimeoutError, ValueError) as error:
        raise UsageError(f"the demo did not end well: {error}") from None
    finally:
        shutil.rmtree(work, ignore_errors=True)
        if new and not any(out.iterdir()):
            out.rmdir()
    print(table)
    print(f"bag: {out / 'bag'}   picture: {out / 'response.png'}")
    return 0


def _default_config() -> Path:
    """Return config/table1_typical.yaml, of the checkout or as installed."""
    name = "config/table1_typical.yaml"
    package = Path(str(resources.files("stickslip_ros")))
    candidates = [package.parent / name]
    candidates += [parent / "share" / "stickslip_ros" / name for parent in package.parents]
    for path in candidates:
        if path.is_file():
            return path
    raise UsageError(f"{name} is not installed; name a file with --config")


def _replace(work: Path, out: Path) -> None:
    """Move finished results into place, over those of an earlier run."""
    for new in sorted(work.iterdir()):
        old = out / new.name
        if old.is_dir():
            shutil.rmtree(old)
        new.replace(old)


def _draw(path: Path, p: Parameters, recorded: Recorded) -> None:
    slow = p.replace(frequency=_MOVES[-1][1], amplitude=_MOVES[-1][0])
    axis = f"{p.friction.preload:g} N, {1e3 * p.runner.mass:g} g"
    plot_response(
        path,
        trace_steps(slow, _TRACED),
        drive_of(slow),
        plant_of(slow).contact,
        (recorded.t, recorded.x),
        f"stick-slip axis: {p.friction.model.upper()}, {axis}, "
        f"{slow.drive.amplitude:g} V; points as in Fig. 2 of Edeler et al. 2011",
    )


def _table(p: Parameters, recorded: Recorded) -> str:
    lines = [
        f"{'':<22}{'+200 at 1 kHz':>16}{'-200 at 1 kHz':>16}{'+20 at 100 Hz':>16}{'Table 1':>14}"
    ]

    def row(name: str, values: list[str], paper: str = "") -> None:
        lines.append(f"{name:<22}{''.join(f'{value:>16}' for value in values)}{paper:>14}")

    friction = recorded.friction
    row("step size (nm)", [_nano(f["mean step size (m)"]) for f in friction], "130")
    row("backstep (nm)", [_nano(f["backstep (m)"]) for f in friction])
    shares = [abs(float(f["backstep (m)"]) / float(f["last step size (m)"])) for f in friction]
    row("backstep (% of step)", [f"{100 * share:.0f}" for share in shares], "30")
    row(
        "mean speed (um/s)",
        [
            f"{1e6 * float(f['mean step size (m)']) * frequency:.2f}"
            for f, (_, frequency, _) in zip(friction, _MOVES, strict=True)
        ],
    )
    row("0-amplitude (nm)", [_nano(f["0-amplitude (m)"]) for f in friction])
    row("position (nm)", [_nano(move["position"]) for move in recorded.moves])
    row(
        "ringing (kHz)", [f"{1e-3 * float(f['ringing frequency (Hz)']):.2f}" for f in friction], "4"
    )
    row("solver, x real time", [f"{_solver_speed(p, *move):.0f}" for move in _MOVES])
    last = recorded.timing[-1]
    factors = [float(timing["real-time factor"]) for timing in recorded.timing[1:]]
    lines.append("")
    lines.append(f"{'real-time factor':<22}{sum(factors) / len(factors):>16.4f}")
    lines.append(f"{'deadlines missed':<22}{last['missed deadlines']:>16}")
    lines.append(f"{'messages recorded':<22}{recorded.messages:>16}")
    lines.append("")
    lines.append(
        "Table 1 measures 4 kHz; Eq. 14, fitted to forces, gives 7.5 kHz at this preload and mass."
    )
    lines.append("config/table1_vibration.yaml takes the stiffness from the 4 kHz instead.")
    return "\n".join(lines)


def _nano(text: str) -> str:
    return f"{1e9 * float(text):.2f}"


def _solver_speed(p: Parameters, amplitude: float, frequency: float, steps: int) -> float:
    """Return simulated time by computing time of a move, the best of three."""
    q = p.replace(amplitude=amplitude, frequency=frequency)
    best = float("inf")
    for _ in range(3):
        started = time.perf_counter()
        run_steps(q, steps)
        best = min(best, time.perf_counter() - started)
    return abs(steps) / frequency / best
