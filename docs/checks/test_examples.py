# SPDX-License-Identifier: Apache-2.0
"""Public names are documented, and the examples of docstrings and pages print what they show."""

import doctest
import importlib
import inspect
import re
from pathlib import Path

import pytest

import stickslip_ros as ss

ROOT = Path(__file__).parents[2]
#: Names that are data.
DATA = {"CONTROLLERS", "LAWS", "PARAMETERS", "WAVEFORMS"}
#: Names that need ROS; the client has its own tests.
ROS = {"AxisClient", "AxisFault"}
PLAIN = [name for name in ss.__all__ if name not in ROS]

#: Where their examples stand.
MODULES = sorted(
    {""} | {getattr(ss, name).__module__.removeprefix("stickslip_ros.") for name in PLAIN
            if name not in DATA}
)  # fmt: skip


def test_every_name_is_there_once_and_documented() -> None:
    assert len(set(ss.__all__)) == len(ss.__all__)
    assert set(ss.__all__) <= set(dir(ss))
    for name in PLAIN:
        text = inspect.getdoc(getattr(ss, name)) or ""
        assert name in DATA or re.match(r"[A-Z`].*", text), name
        generated = text.startswith(f"{name}(")  # what dataclass and NamedTuple write by themselves
        assert not generated, f"{name} has no docstring of its own"


def test_every_function_of_the_library_has_an_example() -> None:
    found = filter(inspect.isroutine, (getattr(ss, name) for name in PLAIN))
    for function in found:
        if function.__module__.startswith("stickslip_ros.simulation"):
            assert ">>> " in (function.__doc__ or ""), function


@pytest.mark.parametrize("module", MODULES)
def test_the_examples_print_what_they_show(module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    found = importlib.import_module(f"stickslip_ros.{module}".rstrip("."))
    results = doctest.testmod(found, optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    assert results.failed == 0


@pytest.mark.parametrize("page", ["README.md", "docs/library.md"])
def test_the_examples_of_a_page_print_what_they_show(page: str) -> None:
    flags = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
    results = doctest.testfile(str(ROOT / page), module_relative=False, optionflags=flags)
    assert (results.failed, results.attempted > 0) == (0, True)
