# SPDX-License-Identifier: Apache-2.0
"""First results without waiting for the compiler: the same numbers, told, and nowhere else."""

import json
import os
import signal
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np
import pytest
from child import python
from live import wait_until

from stickslip_ros.background_compile import as_plain_python
from stickslip_ros.solver import advance, plants
from stickslip_ros.traces import run_steps

REPOSITORY = Path(__file__).resolve().parent.parent
#: Drives that take different ways through the solver.
DRIVES: list[dict[str, Any]] = [
    {},
    {"preload": 1.0, "mass": 0.003},
    {"frequency": 18.5e3},
    {"model": "lugre"},
    {"model": "epm_fix", "frequency": 1e3},
    {"model": "epm_calc", "preload": 1.0},
    {"spring": 1e6, "inclination": 0.1},
    {"force": 0.02, "frequency": 2e3},
]
#: Compiling in the background, but without an end, so that a test is quick.
RUNS = "import sys\nbackground_compile.COMMAND = (sys.executable, '-c', {!r})\n"
ENDLESS = RUNS.format("import time; time.sleep(120)")
ENDED = RUNS.format("raise SystemExit(1)")
#: Ends the process that compiles, if one was started; by whichever thread.
END = """
import os
children = [
    int(pid)
    for task in os.listdir("/proc/self/task")
    for pid in open(f"/proc/self/task/{task}/children").read().split()
]
for child in children:
    os.kill(child, 9)
"""
#: The same, and its number.
PID = END.partition("for child in")[0] + "print(*children)\n"
TWICE = """
from stickslip_ros import background_compile, compiled
@compiled.compiled
def half(x):
    return 0.5 * x
@compiled.compiled
def quarter(x):
    return half(half(x))
"""

pytestmark = pytest.mark.slow


def run(program: str, cache: Path, **environment: str) -> tuple[str, str]:
    """Run a program with a cache of its own; return stdout and stderr."""
    file = cache.parent / "program.py"
    file.write_text(program, encoding="utf-8")
    given = {"NUMBA_CACHE_DIR": str(cache), "STICKSLIP_COMPILE": "", **environment}
    found = python(str(file), **given)
    assert found.returncode == 0, found.stderr
    return found.stdout, found.stderr


def test_plain_python_and_compiled_code_agree(tmp_path: Path) -> None:
    """To a tenth of a millionth of a millionth of a nanometre; on most machines to the last bit."""
    program = (
        "import json\nfrom stickslip_ros.traces import run_steps\n"
        f"found = [run_steps(d, 12).position.tolist() for d in {DRIVES!r}]\n"
        "print(json.dumps(found))\n"
    )
    out, _ = run(program, tmp_path / "cache", NUMBA_DISABLE_JIT="1", PYTHONWARNINGS="ignore")
    for drive, position in zip(DRIVES, json.loads(out), strict=True):
        apart = np.abs(np.array(position) - run_steps(drive, 12).position).max()
        print(f"{drive}: {1e9 * apart:.1e} nm apart")
        assert apart <= 1e-22, drive


def reachable(function: Any, seen: set[int]) -> list[Any]:
    """Return the compiled functions that a plain one could call."""
    if id(function) in seen:
        return []
    seen.add(id(function))
    if hasattr(function, "py_func"):
        return [function]
    if not isinstance(function, FunctionType):
        return []
    names = [function.__globals__.get(name) for name in function.__code__.co_names]
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    return [found for one in [*names, *cells] for found in reachable(one, seen)]


@pytest.mark.parametrize("function", [advance.advance, advance.sample, plants.derive_constants])
def test_a_plain_function_calls_plain_functions_only(function: Any) -> None:
    assert hasattr(function, "py_func")
    seen: set[int] = set()
    assert reachable(as_plain_python(function), seen) == []
    assert len(seen) > 10
    assert as_plain_python(function) is as_plain_python(function)


def test_the_first_results_do_not_wait(tmp_path: Path) -> None:
    """A run and a sweep of a few points, in whatever thread; nothing at all is compiled.

    The package's own bar: 3 s for the run; here of the processor, for the machine may be busy.
    """
    program = (
        "import stickslip_ros as ss\nfrom stickslip_ros import background_compile\n" + ENDLESS
        + "import time\n"
        "print(ss.simulate(preload=0.5, steps=30).position[-1].hex(), time.process_time())\n"
        "found = ss.sweep(preload=[0.1, 1.0, 6.0])['step_size']\n"
        "from stickslip_ros.solver import advance\n"
        "print((1e9 * found).round(2).tolist(), len(advance.advance.signatures))\n" + END
    )  # fmt: skip
    out, err = run(program, tmp_path / "cache")
    first, second = out.splitlines()
    position, seconds = first.split()
    found = run_steps({"preload": 0.5}, 30).position[-1]
    assert float.fromhex(position) == pytest.approx(found, abs=1e-22)
    assert second == "[144.7, 113.2, 0.63] 0"
    assert err.startswith("the solver runs as plain Python until it is compiled")
    assert err.count("\n") == 1
    print(f"{seconds} s")
    assert float(seconds) < 3.0


def test_within_the_block_it_runs_plain_and_elsewhere_compiled(tmp_path: Path) -> None:
    program = (
        TWICE + ENDLESS + "with compiled.plain_until_compiled():\n"
        "    print(quarter(4.0), len(quarter.signatures))\n"
        + END  # or it would be waited for
        + "print(quarter(4.0), len(quarter.signatures), not children)\n"
        "with compiled.plain_until_compiled():\n"
        "    print(quarter(4.0), len(quarter.signatures))\n"
    )
    out, _ = run(program, tmp_path / "cache")
    assert out.splitlines() == ["1.0 0", "1.0 1 False", "1.0 1"]
    # What lies in the cache is used at once, and nothing is started or told.
    out, err = run(program, tmp_path / "cache")
    assert out.splitlines() == ["1.0 1", "1.0 1 True", "1.0 1"]
    assert err == ""


@pytest.mark.parametrize(
    ("fault", "environment"),
    [
        (ENDED, {}),
        ("", {"STICKSLIP_COMPILE": "wait"}),
        ("background_compile.COMMAND = ('/no',)\n", {}),
    ],
)
def test_it_compiles_by_itself_where_nobody_else_does(
    tmp_path: Path, fault: str, environment: dict[str, str]
) -> None:
    program = TWICE + fault + (
        "import time\n"
        "with compiled.plain_until_compiled():\n"
        "    for _ in range(600):\n"
        "        value = quarter(4.0)\n"
        "        if quarter.signatures: break\n"
        "        time.sleep(0.05)\n"
        "print(value, len(quarter.signatures))\n"
    )  # fmt: skip
    out, err = run(program, tmp_path / "cache", **environment)
    assert out == "1.0 1\n"
    assert "compiling the solver" in err


def test_a_second_program_starts_no_second_compiler(tmp_path: Path) -> None:
    program = TWICE + ENDLESS + (
        "with compiled.plain_until_compiled():\n"
        "    quarter(4.0)\n" + PID
    )  # fmt: skip
    first, err = run(program, tmp_path / "cache")
    assert "about twenty seconds" in err
    second, err = run(program, tmp_path / "cache")
    assert (second, "about twenty seconds" in err) == ("\n", True)
    os.kill(int(first), signal.SIGKILL)
    third, _ = run(program + END, tmp_path / "cache")
    assert int(third) != int(first)


def test_what_another_program_has_begun_to_compile_is_waited_for(tmp_path: Path) -> None:
    """Saying how far that is, until it has ended; then it is compiled here."""
    said = "import sys, time; print('so far: 35 %', file=sys.stderr, flush=True); time.sleep(120)"
    program = (
        TWICE
        + RUNS.format(said)
        + ("with compiled.plain_until_compiled():\n    quarter(4.0)\n" + PID)
    )
    pid, _ = run(program, tmp_path / "cache")
    (note,) = (tmp_path / "cache").rglob("compiling")
    wait_until(lambda: "35 %" in note.read_text(encoding="utf-8"), "how far it is")
    waiting = TWICE + (
        "import os, sys\n"
        "class Heard:\n"
        "    def write(self, text):\n"
        "        sys.__stderr__.write(text)\n"
        f"        os.kill({int(pid)}, 9)\n"
        "    flush, isatty = sys.__stderr__.flush, sys.__stderr__.isatty\n"
        "sys.stderr = Heard()\n"
        "print(quarter(4.0), len(quarter.signatures))\n"
    )
    out, err = run(waiting, tmp_path / "cache")
    assert out == "1.0 1\n"
    assert err == "waiting for the solver to be compiled in the background: 35 %\n"


@pytest.mark.long
def test_the_process_in_the_background_compiles_what_comes_next(tmp_path: Path) -> None:
    """All anew, in a cache of its own: a trace after a first result waits and gets it."""
    program = (
        "import stickslip_ros as ss\n"
        "run = ss.simulate(steps=3)\n"
        "print(len(run.trace.t) > 1000)\n"
        "import os\ntry: os.wait()\nexcept ChildProcessError: pass\n"
    )
    out, err = run(program, tmp_path / "cache")
    assert out == "True\n"
    assert [line.split()[0] for line in err.splitlines()][:2] == ["the", "waiting"]
    assert run(program.partition("import os")[0], tmp_path / "cache") == ("True\n", "")
