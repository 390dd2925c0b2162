# SPDX-License-Identifier: Apache-2.0
"""Mutation testing: changes one operator, number or condition, and runs the tests that reach it.

    python -m validation.campaigns.mutants draw             once: writes 40 patches, seed 1
    python -m validation.campaigns.mutants reach CONTEXTS   writes into each the tests that reach it
    python -m validation.campaigns.mutants run [--marked "not long"] [--only 7 23] [--tree FOLDER]

CONTEXTS are files of coverage.py that know which test runs which line, as
``pytest --cov=stickslip_ros --cov-context=test`` writes them. Coverage does not see compiled code:
mutants in it get all tests of the kernel. ``run`` works on a copy and prints, for each mutant,
whether its tests fail. A patch that no longer applies is gone: the text that it changes has left.
"""

from __future__ import annotations

import ast
import contextlib
import copy
import difflib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from validation.campaigns.arguments import arguments

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "stickslip_ros"
PATCHES = Path(__file__).parent / "mutants"
FIVE_EACH = ("measurement", "ros", "solver", "recordings")
OTHERS = 20  # over the other rooms, by their lines
MOST = 60  # tests of a mutant, those of its room first: most mutants need few
TIMEOUT = 900.0  # s; a mutant that runs for ever is killed
_SECONDS = "STICKSLIP_MUTANTS_SECONDS"
KERNEL = ("test/physics", "test/golden", "test/axis/test_axis.py")
OPERATORS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult, ast.Pow: ast.Mult, ast.LShift: ast.RShift,
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn,
    ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And, ast.USub: ast.UAdd,
    ast.Break: ast.Continue, ast.Continue: ast.Break,
}  # fmt: skip


def mutated(node: ast.AST) -> ast.AST | None:
    """Return a node changed, None if nothing can be changed in it alone."""
    node = copy.copy(node)
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        node.op = OPERATORS[type(node.op)]()  # type: ignore[assignment]
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in OPERATORS:
        node.ops = [OPERATORS[type(node.ops[0])](), *node.ops[1:]]  # type: ignore[list-item]
    elif isinstance(node, ast.BoolOp):
        node.op = OPERATORS[type(node.op)]()  # type: ignore[assignment]
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        node.op = ast.UAdd()
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        return node.operand
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        node.value = not node.value
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        node.value = node.value + 1 if abs(node.value) >= 1 or not node.value else 2 * node.value
    elif isinstance(node, ast.Break | ast.Continue):
        return OPERATORS[type(node)]()
    else:
        return None
    return node


def changes(source: str) -> Iterator[tuple[int, str]]:
    """Yield the mutants of a source: the line that changes, and the whole text."""
    lines = source.encode().splitlines(keepends=True)
    starts = [sum(map(len, lines[:row])) for row in range(len(lines) + 1)]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.If | ast.IfExp | ast.While):
            place, text = node.test, f"not ({ast.get_source_segment(source, node.test)})"
        elif (other := mutated(node)) is not None:
            place, text = node, ast.unparse(other)  # type: ignore[assignment]
        else:
            continue
        first = starts[place.lineno - 1] + place.col_offset
        last = starts[(place.end_lineno or 0) - 1] + (place.end_col_offset or 0)
        changed = (source.encode()[:first] + text.encode() + source.encode()[last:]).decode()
        with contextlib.suppress(SyntaxError):  # a place inside a text is not where it seems to be
            if ast.dump(ast.parse(changed)) != ast.dump(ast.parse(source)):
                yield place.lineno, changed


def draw(seed: int) -> None:
    """Write the patches."""
    dice = random.Random(seed)
    rooms = {p.name: sorted(p.rglob("*.py")) for p in (ROOT / PACKAGE).iterdir() if p.is_dir()}
    lines = {room: sum(_length(file) for file in files) for room, files in rooms.items()}
    others = sorted(set(rooms) - set(FIVE_EACH) - {"__pycache__"})
    chosen = [room for room in FIVE_EACH for _ in range(5)]
    chosen += dice.choices(others, [lines[room] for room in others], k=OTHERS)
    PATCHES.mkdir(exist_ok=True)
    for number, room in enumerate(chosen, 1):
        file = dice.choices(rooms[room], [_length(file) for file in rooms[room]])[0]
        source = file.read_text(encoding="utf-8")
        while not (every := list(changes(source))):
            file = dice.choice(rooms[room])
            source = file.read_text(encoding="utf-8")
        name = file.relative_to(ROOT).as_posix()
        _, changed = dice.choice(every)
        old, new = source.splitlines(keepends=True), changed.splitlines(keepends=True)
        patch = "".join(difflib.unified_diff(old, new, f"a/{name}", f"b/{name}"))
        (PATCHES / f"{number:02}.patch").write_text(patch, encoding="utf-8")


def _length(file: Path) -> int:
    return len(file.read_text(encoding="utf-8").splitlines())


def reach(tree: Path, contexts: Iterable[str]) -> None:
    """Write into each patch the tests of a tree that reach its line."""
    from coverage import CoverageData

    known = []
    for name in contexts:
        known.append(CoverageData(name))
        known[-1].read()
    for path in sorted(PATCHES.glob("*.patch")):
        patch = path.read_text(encoding="utf-8").partition("--- ")
        name, line, text = _place(patch[2])
        source = (tree / name).read_text(encoding="utf-8") if (tree / name).exists() else ""
        same = [k for k, one in enumerate(source.splitlines(), 1) if one == text]
        if not same:
            continue
        line = min(same, key=lambda k: abs(k - line))  # it may have moved
        compiled, outside = _surroundings(source, line)
        found: set[str] = set()
        for data in known:
            by_line = data.contexts_by_lineno(str(tree / name))
            rows = by_line if outside else [line]
            found |= {_test(one) for row in rows for one in by_line.get(row, []) if "::" in one}
        folder, dice = f"test/{Path(name).parts[1]}/", random.Random(name)
        tests = sorted(sorted(found), key=lambda test: (not test.startswith(folder), dice.random()))
        tests = list(KERNEL) if compiled else tests[:MOST]
        head = f"reached by {'the tests of the kernel' if compiled else len(found)}\n"
        path.write_text(head + "".join(f"test: {one}\n" for one in tests) + "--- " + patch[2])


def _place(patch: str) -> tuple[str, int, str]:
    """Return the file that a patch changes, the first line that it changes, and its text."""
    lines = patch.splitlines()
    first = int(lines[2].split()[1].lstrip("-").partition(",")[0])
    after = [one[:1] for one in lines[3:]].index("-")
    return lines[0].removeprefix("a/"), first + after, lines[3 + after][1:]


def _surroundings(source: str, line: int) -> tuple[bool, bool]:
    """Return whether a line is in a compiled function, and whether it is in no function."""
    inside = [
        node
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.FunctionDef) and node.lineno <= line <= (node.end_lineno or 0)
    ]
    names = [ast.unparse(one) for node in inside for one in node.decorator_list]
    return any("compiled" in name for name in names), not inside


def _test(context: str) -> str:
    """Return the test function that a context names."""
    (name, *_) = (part for part in context.split("|") if "::" in part)
    return name.partition(" (")[0].partition("[")[0]


def run(tree: Path, marked: str, only: Iterable[int]) -> None:
    """Try the mutants on a copy of a tree."""
    outcomes: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        copied = Path(folder) / "repository"
        ignored = shutil.ignore_patterns(".git", ".venv", "*.egg-info", ".*_cache", "demo")
        shutil.copytree(tree, copied, symlinks=True, ignore=ignored)
        for path in sorted(PATCHES.glob("*.patch")):
            if only and int(path.stem) not in only:
                continue
            text = path.read_text(encoding="utf-8")
            place = ":".join(map(str, _place(text.partition("--- ")[2])[:2]))
            tests = [one.removeprefix("test: ") for one in text.splitlines() if one[:6] == "test: "]
            there = [one for one in tests if (copied / one.partition("::")[0]).exists()]
            apply = ["git", "apply", "--unsafe-paths", "-p1", f"--directory={copied}", str(path)]
            if subprocess.run(apply, cwd=folder, capture_output=True).returncode:
                outcome = "gone"
            else:
                outcome = tried(copied, there, marked) if there else "not reached"
                subprocess.run([*apply, "-R"], cwd=folder, check=True)
            outcomes[outcome] += 1
            print(f"{path.stem} {outcome:<11} {place} ({len(there)} tests)", flush=True)
    print(", ".join(f"{count} {outcome}" for outcome, count in sorted(outcomes.items())))


def tried(copied: Path, tests: list[str], marked: str) -> str:
    """Run tests on a mutant in the copy; return caught, hung or survived."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider"]
    command += ["-p", "no:rerunfailures", "-p", "validation.campaigns.mutants", "-W", "ignore"]
    environment = {**os.environ, "PYTHONPATH": str(copied), "PYTHONDONTWRITEBYTECODE": "1"}
    with tempfile.TemporaryFile("w+") as output:
        program = subprocess.Popen(
            [*command, "-m", marked, *tests], cwd=copied, env=environment, stdout=output,
            stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        try:
            code = program.wait(TIMEOUT)
        except subprocess.TimeoutExpired:
            return "hung"
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(program.pid, signal.SIGKILL)
            program.wait()
        output.seek(0)
        failed = [line for line in output if line.startswith(("FAILED", "ERROR"))]
    if code == 5:
        return "not reached"  # no test of this kind
    if code == 4:
        # A test that has left is named: run what is there.
        gone = {
            line.rpartition("/repository/")[2].strip() for line in failed if "not found" in line
        }
        there = [one for one in tests if one not in gone]
        return tried(copied, there, marked) if there and gone else "not reached"
    return f"caught by {failed[0].split()[1]}" if failed else "survived" if not code else "caught"


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_call() -> Iterator[None]:
    """End a test that computes for too long, in the process that tries a mutant."""

    def end(*_: object) -> None:
        raise TimeoutError("computed for too long")

    signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, float(os.environ.get(_SECONDS, "200")))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def main() -> None:
    """Run what the command line says."""
    args = arguments(
        __doc__, places={"what": {"draw", "reach", "run"}, "contexts": []},
        seed=1, marked="", only=(0,), tree=ROOT,
    )  # fmt: skip
    if args.what == "draw":
        draw(args.seed)
    elif args.what == "reach":
        reach(args.tree, args.contexts)
    else:
        run(args.tree, args.marked, [int(one) for one in args.only if int(one)])


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError):
        main()
