# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C at random moments of every command: how soon it ends, with which code, what it leaves.

Each command runs once to its end, and then MOMENTS times to a SIGINT at a random moment of that
time: it loads, compiles, reads, computes or writes by then. It has to end within 0.2 s with exit
code 130 (or as if it had ended by itself), and may leave files only as a whole. The time is that
in which its main thread waited for nothing but the processor taken off, so a busy machine counts
as an idle one.
"""

from __future__ import annotations

import os
import random
import re
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from validation.campaigns.processes import Program, ended

ROOT = Path(__file__).resolve().parents[2]
SAMPLES, BAGS = ROOT / "examples" / "samples", ROOT / "test" / "golden" / "bags"
CONFIG = ROOT / "config" / "table1_typical.yaml"
STEPS = SAMPLES / "steps_100hz.csv"
PATIENCE = 100.0  #: s, for a command on a busy machine
#: Ends of a process that Ctrl-C met: of the command; of Python itself, before or after it
INTERRUPTED = {130, -signal.SIGINT}
#: s for which commands are looked at that have no end of their own, or a far one
SERVES_FOR = 6.0


@dataclass(frozen=True)
class Command:
    """A command line of ``stickslip``, in a folder of its own."""

    text: str
    serves: bool = False  #: until Ctrl-C, which is its usual end: exit code 0
    compiles: bool = False  #: begins with an empty cache
    within: float = 0.2  #: s at most from the signal to the end


COMMANDS = {
    "simulate": Command("simulate --steps 60 --trace trace.csv --plot plot.svg"),
    "compiling": Command("simulate --steps 30", compiles=True),
    "warm-up": Command("warm-up", compiles=True),
    "effects": Command("simulate --steps 40 --config edeler_2011_everything --trace t.csv"),
    "sweep": Command("sweep --vary preload=0.1:6:20 --out sweep.csv --plot sweep.svg"),
    "predict": Command("predict --json"),
    "analyse": Command(f"analyse {STEPS} --report analyse.html"),
    "compare": Command(f"compare {CONFIG} {STEPS} --report compare.html"),
    # It writes what it has found so far.
    "identify": Command(f"identify --run {CONFIG} {STEPS} --out fit.yaml", within=1.0),
    "identify-actuator": Command(f"identify-actuator {SAMPLES / 'actuator_loop.csv'} --out a.yaml"),
    "shape": Command("shape"),
    "elongate": Command("elongate --set frequency=10kHz"),
    "explore": Command("explore --no-browser", serves=True),
    "emulate": Command("emulate anc300 --port 0", serves=True),
    "bag info": Command(f"bag info {BAGS / 'plain'}"),
    "bag export": Command(f"bag export {BAGS / 'everything'} --out exported"),
    "bag recover": Command(f"bag recover {BAGS / 'everything'} --out recovered"),
    "bag resimulate": Command(f"bag resimulate {BAGS / 'everything'}"),
    "bag record": Command("bag record --out bag", serves=True),
    "send": Command("send stop --timeout 3"),
    "watch": Command("watch --timeout 3"),
    # It ends two nodes first.
    "demo": Command("demo --out demo", within=1.0),
}


@dataclass(frozen=True)
class End:
    """How a command ended."""

    code: int
    took: float  #: s since the signal, without the time in which the machine did something else
    said: str  #: on stderr
    left: frozenset[str]  #: files and folders in its own


def run(command: Command, after: float | None, cache: Path) -> End:
    """Run a command, to its end or to a signal after so many seconds."""
    domain = {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
    }
    if command.compiles:
        domain["NUMBA_CACHE_DIR"] = str(cache)
    with tempfile.TemporaryDirectory() as name:
        words, took = command.text.split(), 0.0
        child = Program(Path(name), *words, module="stickslip_ros.cli.main", **domain)
        if after is None:
            ended(child.pid, PATIENCE)
        elif not ended(child.pid, after):
            took = child.signalled(signal.SIGINT, PATIENCE, group=True)
        code, left = child.closed()
        return End(code, took, child.said, frozenset([*os.listdir(name), *left]) - {"log"})


def faults(command: Command, whole: frozenset[str], end: End) -> Iterator[str]:
    """Yield what is wrong with an end; ``whole`` is what the command leaves at its own end."""
    if end.took > command.within:
        yield f"took {end.took:.2f} s to end"
    usual = {0} if command.serves else {0, 1, 2}
    # Before that line, Python ends as it likes.
    ours = re.search(r"cli/main\.py.*, in (main|_run)", end.said)
    if end.code not in INTERRUPTED | usual and (ours or end.code != 1):
        yield f"exit code {end.code}"
    if ours and "Traceback" in end.said:
        yield f"a traceback: {end.said.strip().splitlines()[-1]}"
    if partial := end.left - whole:
        yield f"left {', '.join(sorted(partial))}"


def study(name: str, moments: int, seed: int) -> int:
    """Interrupt a command so many times; print how it ended; return the number of bad ends."""
    command, lot = COMMANDS[name], random.Random(f"{name} {seed}")
    with _cache(command) as cache:
        begin = time.monotonic()
        first = run(command, SERVES_FOR if command.serves or command.compiles else None, cache)
        duration = time.monotonic() - begin
    bad, worst, ends = 0, 0.0, list[int]()
    with _cache(command) as cache:
        for _ in range(moments):
            after = lot.uniform(0.0, duration)
            end = run(command, after, cache)
            worst = max(worst, end.took)
            ends.append(end.code)
            for fault in faults(command, first.left, end):
                bad += 1
                print(f"  {name} after {after:.3f} s: {fault}", flush=True)
    codes = ", ".join(f"{code}: {ends.count(code)}" for code in sorted(set(ends)))
    print(
        f"{name}: {duration:.1f} s alone (code {first.code}); {moments} interrupted: at most "
        f"{worst:.3f} s to the end, codes {codes}; {bad} bad",
        flush=True,
    )
    return bad


@contextmanager
def _cache(command: Command) -> Iterator[Path]:
    """Give an empty cache; end what still compiles into it afterwards."""
    path = Path(tempfile.mkdtemp(prefix="stickslip-cache-"))
    try:
        yield path
    finally:
        if command.compiles:
            for process in Path("/proc").glob("[0-9]*"):
                try:
                    if str(path).encode() in (process / "cmdline").read_bytes():
                        os.kill(int(process.name), signal.SIGKILL)
                except OSError:
                    continue
        shutil.rmtree(path, ignore_errors=True)


def interrupts(moments: int, seed: int, only: str = "") -> int:
    """Interrupt all commands, or one; return the number of bad ends."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background ignores it
    return sum(study(name, moments, seed) for name in ([only] if only else COMMANDS))
