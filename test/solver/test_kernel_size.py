# SPDX-License-Identifier: Apache-2.0
"""Compiled functions stay short, with few arguments: they can be read."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import stickslip_ros

MOST_LINES, MOST_ARGUMENTS = 60, 6
_COMPILERS = ("compiled", "compiled_anew", "compiled_inline")
_ROOMS = [Path(stickslip_ros.__file__).parent / room for room in ("model", "solver")]
_SOURCES = [source for room in _ROOMS for source in sorted(room.rglob("*.py"))]


def compiled_functions(text: str) -> Iterator[ast.FunctionDef]:
    """Yield the functions of a source that are compiled, by decorator or by a call."""
    tree = ast.parse(text)
    anew = {
        node.args[0].id
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id in _COMPILERS
        and isinstance(node.args[0], ast.Name)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            by_name = any(
                isinstance(d, ast.Name) and d.id in _COMPILERS for d in node.decorator_list
            )
            if by_name or node.name in anew:
                yield node


def test_lines_and_arguments() -> None:
    for function in (
        f for source in _SOURCES for f in compiled_functions(source.read_text("utf-8"))
    ):
        lines = (function.end_lineno or 0) - function.lineno + 1
        assert lines <= MOST_LINES, f"{function.name} has {lines} lines"
        assert len(function.args.args) <= MOST_ARGUMENTS, function.name


@pytest.mark.slow
def test_the_kernel_is_found() -> None:
    names = {f.name for source in _SOURCES for f in compiled_functions(source.read_text("utf-8"))}
    assert {"advance", "next_arc", "expand", "z_rate", "root", "end"} <= names
    assert len(names) > 100
