# SPDX-License-Identifier: Apache-2.0
"""The tutorials, run from top to bottom as a reader does: commands, Python, files; output compared.

In a block ``console``, a line after ``$`` is run and the lines below it have to be what it prints;
``...`` stands for anything, as in doctests. A block ``python`` without prompts is a file of tests.
"""

import ast
import doctest
import json
import os
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from stickslip_ros.cli.main import main

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
NOTEBOOK = ROOT / "examples" / "from_a_trace_to_a_model.ipynb"
_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_FILE = re.compile(r"`(test_\w+\.py)`")
_FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
#: Needs a running axis; its commands are run by the tests of the demo and of the bags.
WITHOUT_BLOCKS = {"foxglove.md"}


def commands(block: str) -> Iterator[tuple[list[str], str]]:
    """Yield the words of each command of a console block, and what it prints."""
    for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
        line, _, shown = part.partition("\n")
        yield shlex.split(line), shown


def printed(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command; return what it prints."""
    if words[0] == "stickslip":
        capsys.readouterr()
        tells = words[-3:] == ["||", "echo", "exit code $?"]
        code = main(words[1:-3] if tells else words[1:])
        assert bool(code) == tells, words
        return capsys.readouterr().out + (f"exit code {code}\n" if tells else "")
    assert words[0] == "pytest"
    options = ["-p", "stickslip_ros.testing", "-p", "no:cacheprovider"]
    found = subprocess.run(
        [sys.executable, "-m", *words, *options], capture_output=True, text=True, timeout=300
    )
    assert found.returncode == 0, found.stdout + found.stderr
    return found.stdout


PICTURED = {page.stem for page in PAGES} - {"foxglove"}


def test_the_pictures_are_what_their_program_draws(tmp_path: Path) -> None:
    runpy.run_path(str(PAGES[0].parent / "pictures.py"))["main"](tmp_path)
    assert {picture.stem for picture in tmp_path.glob("*.png")} == PICTURED


def test_the_notebook_runs() -> None:
    """Its cells in their order; what the last line of each returns shows itself."""
    matplotlib = pytest.importorskip("matplotlib")
    pytest.importorskip("pandas")
    matplotlib.use("agg")
    notebook = json.loads((NOTEBOOK).read_text())
    names: dict[str, Any] = {}
    shown = []
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            tree = ast.parse("".join(cell["source"]))
            last = tree.body.pop()
            assert isinstance(last, ast.Expr)
            exec(compile(tree, NOTEBOOK.name, "exec"), names)
            result = eval(compile(ast.Expression(last.value), NOTEBOOK.name, "eval"), names)
            shown.append(type(result).__name__)
            assert hasattr(result, "_repr_html_") or shown[-1] == "Axes"
    assert shown == ["Motion", "Axes", "Run", "DataFrame", "Comparison", "DataFrame", "Fit",
                     "Axes", "Axes"]  # fmt: skip


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_tutorial_does_what_it_shows(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    monkeypatch.setenv("PYTHONPATH", path)
    text = page.read_text(encoding="utf-8")
    names: dict[str, object] = {}
    runner = doctest.DocTestRunner(optionflags=_FLAGS)
    checker, done = doctest.OutputChecker(), 0
    for kind, block in _BLOCK.findall(text):
        if kind == "console":
            for words, shown in commands(block):
                got = printed(words, capsys)
                assert checker.check_output(shown, got, _FLAGS), f"{words}:\n{got}"
                done += 1
        elif block.startswith(">>> "):
            example = doctest.DocTestParser().get_doctest(block, names, page.name, page.name, 0)
            runner.run(example, clear_globs=False)
            names.update(example.globs)
            done += 1
        elif kind == "python":
            (name,) = _FILE.findall(text[: text.index(block)])
            (tmp_path / name).write_text(block, encoding="utf-8")
    assert runner.failures == 0
    assert (done > 0) == (page.name not in WITHOUT_BLOCKS)
