# SPDX-License-Identifier: Apache-2.0
"""The door for files: what is no file is refused at once, and unpacking has an end."""

import os
import socket
from pathlib import Path

import pytest

from stickslip_ros.opening import ALWAYS_ALLOWED, UNPACK_FACTOR, Allowance, ReadError, open_regular


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
