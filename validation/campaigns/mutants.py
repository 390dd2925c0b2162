# SPDX-License-Identifier: Apache-2.0
"""Mutation testing: changes one operator, number or condition at a time and runs the tests.

    python validation/campaigns/mutants.py CONTEXTS --rooms axis traces --count 50 --seed 1

CONTEXTS is a file of coverage.py that knows which test runs which line, as
``pytest --cov=stickslip_ros --cov-branch --cov-context=test test/axis`` writes it: only those tests
are run that reach the mutated line. Works on a copy; prints what survives, as a difference.

The solver is compiled, so its lines are seen, and its mutants run, as plain Python only: set
NUMBA_DISABLE_JIT=1 for both commands, and give the first one tests that take a second or two then.
``--leave-out`` names files that somebody else is changing.
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
from collections.abc import Iterator
from pathlib import Path

import pytest

from validation.campaigns.arguments import arguments

ROOT = Path(__file__).resolve().parents[2]
ROUNDS = (10, 150)  # tests, of those that reach a line: most mutants need few
TIMEOUT = 600.0  # s; a mutant that runs for ever is killed
_MOST = "STICKSLIP_MUTANTS_MOST"
OPERATORS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult, ast.Pow: ast.Mult, ast.LShift: ast.RShift,
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn,
    ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And, ast.USub: ast.UAdd,
    ast.Break: ast.Continue, ast.Continue: ast.Break,
}  # fmt: skip


def places(tree: ast.AST) -> Iterator[tuple[int, int]]:
    """Yield what can be changed: the number of a node in the order of `ast.walk`, and its line."""
    for number, node in enumerate(ast.walk(tree)):
        if mutated(copy.copy(node)) is not None:
            yield number, node.lineno  # type: ignore[attr-defined]


def mutated(node: ast.AST) -> ast.AST | None:
    """Return the node changed, None if nothing can be changed in it alone."""
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
    elif isinstance(node, ast.If | ast.IfExp | ast.While):
        node.test = ast.UnaryOp(ast.Not(), node.test)
    elif isinstance(node, ast.Break | ast.Continue):
        return OPERATORS[type(node)]()
    else:
        return None
    return node


class _Change(ast.NodeTransformer):
    def __init__(self, wanted: ast.AST) -> None:
        self._wanted = wanted

    def visit(self, node: ast.AST) -> ast.AST:
        if node is self._wanted:
            return ast.copy_location(mutated(node) or node, node)
        return self.generic_visit(node)


def mutant(source: str, number: int) -> str:
    """Return a source with one node changed."""
    tree = ast.parse(source)
    wanted = next(node for k, node in enumerate(ast.walk(tree)) if k == number)
    return ast.unparse(ast.fix_missing_locations(_Change(wanted).visit(tree)))


def tests_of(contexts: list[str]) -> list[str]:
    """Return the tests that reach a line, from the contexts of coverage.py."""
    return sorted({one.partition("|")[0] for one in contexts if one})


def main() -> int:
    """Try a sample of mutants; return 0."""
    args = arguments(
        __doc__,
        places={"contexts": []},
        rooms=("axis", "recordings", "traces"),
        count=50,
        seed=1,
        most=60.0,
        leave_out=(),
    )
    os.environ[_MOST] = str(args.most)
    from coverage import CoverageData

    found = []
    for contexts in args.contexts:
        data = CoverageData(str(contexts))
        data.read()
        for room in args.rooms:
            for file in sorted((ROOT / "stickslip_ros" / room).rglob("*.py")):
                if file.name in args.leave_out:
                    continue
                reached = data.contexts_by_lineno(str(file))
                for number, line in places(ast.parse(file.read_text(encoding="utf-8"))):
                    if tests := tests_of(reached.get(line, [])):
                        found.append((file, number, line, tests))
    dice = random.Random(args.seed)
    sample = dice.sample(found, min(args.count, len(found)))
    print(f"{len(found)} mutants can be made; {len(sample)} are tried", flush=True)
    outcomes: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        copied = Path(folder) / "repository"
        ignored = shutil.ignore_patterns(".git", ".venv", "*.egg-info", ".*_cache")
        shutil.copytree(ROOT, copied, symlinks=True, ignore=ignored)
        for file, number, line, tests in sample:
            dice.shuffle(tests)
            outcome = tried(copied, file, number, sorted(tests[: ROUNDS[0]]))
            if outcome == "survived" and (others := tests[ROUNDS[0] : ROUNDS[1]]):
                outcome = tried(copied, file, number, sorted(others))
            outcomes[outcome] += 1
            print(f"{outcome:<9} {file.relative_to(ROOT)}:{line} ({len(tests)} tests)", flush=True)
            if outcome == "survived":
                show(file, number)
    killed = outcomes["killed"] + outcomes["hung"]
    print(f"{dict(outcomes)}: {100 * killed / max(1, sum(outcomes.values())):.0f} % killed")
    return 0


def tried(copied: Path, file: Path, number: int, tests: list[str]) -> str:
    """Run tests on a mutant in the copy; return killed, hung or survived."""
    target = copied / file.relative_to(ROOT)
    source = file.read_text(encoding="utf-8")
    target.write_text(mutant(source, number), encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider"]
    command += ["-p", "no:rerunfailures", "-p", "mutants", "-W", "ignore", *tests]
    path = f"{copied}{os.pathsep}{copied / 'validation' / 'campaigns'}"
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            command, cwd=copied, env=environment, capture_output=True, timeout=TIMEOUT
        )
    except subprocess.TimeoutExpired:
        return "hung"
    finally:
        target.write_text(source, encoding="utf-8")
    return "survived" if done.returncode == 0 else "killed"


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_call() -> Iterator[None]:
    """End a test that computes for too long, in the process that tries a mutant."""

    def end(*_: object) -> None:
        raise TimeoutError("computed for too long")

    signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, float(os.environ[_MOST]))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def show(file: Path, number: int) -> None:
    """Print the change of a mutant."""
    source = ast.unparse(ast.parse(file.read_text(encoding="utf-8")))
    changed = mutant(file.read_text(encoding="utf-8"), number)
    lines = difflib.unified_diff(source.splitlines(), changed.splitlines(), lineterm="", n=2)
    print("\n".join(f"    {line}" for line in list(lines)[2:]), flush=True)


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError):
        sys.exit(main())
