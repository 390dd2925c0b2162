# SPDX-License-Identifier: Apache-2.0
"""The door for files: what is no file is refused at once, and unpacking has an end."""

import ast
import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

import stickslip_ros
from stickslip_ros.base.opening import (
    ALWAYS_ALLOWED,
    UNPACK_FACTOR,
    Allowance,
    ReadError,
    open_regular,
)

PACKAGE = Path(stickslip_ros.__file__).parent
#: Who reads without the door, and what: nothing that a user names, or what came in by it before
WITHOUT = {
    "base/compiled.py": "sources of the package",
    "base/numba_internals.py": "sources of the package",
    "measurement/reading/arrays.py": "members of an archive, and the answer of our own program",
    "measurement/reading/instruments.py": "a file again whose kind was found out by its head",
    "base/reporting/page.py": "templates of the package",
    "base/child_process.py": "the log of our own process",
    "ros/nodes/messages.py": "definitions of installed messages",
    "cli/workbench/server.py": "scripts of the package",
}


def test_a_file_is_opened_and_what_is_none_is_refused_at_once(tmp_path: Path) -> None:
    file, link, pipe = (tmp_path / name for name in ("file", "link", "pipe"))
    file.write_bytes(b"12345")
    link.symlink_to(file)
    os.mkfifo(pipe)
    for path in (file, str(link)):
        with open_regular(path, largest=5) as stream:
            assert stream.read() == b"12345"
    with pytest.raises(ReadError, match="file has 5 bytes; at most 4 are read"):
        open_regular(file, largest=4)
    descriptors = len(os.listdir("/proc/self/fd"))
    for path in (pipe, Path("/dev/zero")):
        with pytest.raises(ReadError, match=f"{path} is not a file but a pipe or a device; copy"):
            open_regular(path)
    with pytest.raises(IsADirectoryError):
        open_regular(tmp_path)
    with pytest.raises(FileNotFoundError):
        open_regular(tmp_path / "gone")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "socket"))
        with pytest.raises(OSError, match="No such device"):
            open_regular(tmp_path / "socket")
    assert len(os.listdir("/proc/self/fd")) == descriptors


def _reads(tree: ast.AST) -> Iterator[str]:
    """Yield the calls that open or read a path by themselves."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            function = node.func
            if isinstance(function, ast.Attribute) and function.attr in ("read_text", "read_bytes"):
                yield function.attr
            named = getattr(function, "attr", getattr(function, "id", ""))
            arguments = [*node.args, *(one.value for one in node.keywords if one.arg == "mode")]
            modes = [one.value for one in arguments[:2] if isinstance(one, ast.Constant)]
            writes = any(str(mode)[:1] in ("w", "a", "x") for mode in modes)
            owner = getattr(getattr(function, "value", None), "id", "")
            if named == "open" and not writes and owner not in ("os", "webbrowser", "workbench"):
                yield named


def test_all_who_read_come_in_by_the_door() -> None:
    """Parameter files and tables of sweeps had a way of their own, and waited there."""
    found = {
        str(file.relative_to(PACKAGE))
        for file in PACKAGE.rglob("*.py")
        if any(_reads(ast.parse(file.read_text(encoding="utf-8"))))
    }
    assert found == WITHOUT.keys()


def test_what_a_file_unpacks_to_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    size = 10**6
    allowance = Allowance("packed", size)
    allowance.spend(UNPACK_FACTOR * size)
    with pytest.raises(ReadError, match=r"packed unpacks to more than 300 times .*UNPACK_FACTOR"):
        allowance.spend(1)
    small = Allowance("small", 10)
    small.spend(ALWAYS_ALLOWED)
    with pytest.raises(ReadError):
        small.spend(1)
    monkeypatch.setenv("STICKSLIP_UNPACK_FACTOR", "1000")
    Allowance("packed", size).spend(1000 * size)
    monkeypatch.setenv("STICKSLIP_UNPACK_FACTOR", "many")
    with pytest.raises(ReadError, match="is 'many'; it has to be a number"):
        Allowance("packed", size)
