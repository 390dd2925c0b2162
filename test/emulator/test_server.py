# SPDX-License-Identifier: Apache-2.0
"""Lines are cut the same however they come in; many, slow and rude clients are served."""

import asyncio
import csv
import io
import re
import signal
import socket
import struct
import subprocess
import sys
import tracemalloc
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from child import REPOSITORY, python
from emulated import Client
from hypothesis import example, given
from hypothesis import strategies as st
from live import wait_until

from stickslip_ros import Axis, ParameterError
from stickslip_ros.cli.emulate import _rows
from stickslip_ros.cli.main import main
from stickslip_ros.emulator import (
    CONTROLLERS,
    OwnAxes,
    ServerThread,
    commands_of,
    controller_of,
)
from stickslip_ros.emulator.controller import Lines
from stickslip_ros.emulator.server import MOST_CLIENTS
from stickslip_ros.recordings import open_bag, resimulate

#: A command that a device has and the emulator has not, and its answer
LACKING = {
    "anc300": (b"setfil 1 16", b"Wrong axis type\r\nERROR\r\n"),
    "scu": (b":GA0", b":E0C143\n"),
    "mcs": (b":GTP0", b":E0,2\n"),
    "mcs2": (b":CHAN0:SCAN:VEL?", b'32765,"Feature not supported"\r\n'),
    "amc": (
        b'{"method": "com.attocube.amc.rtin.apply", "id": 1}',
        b'{"jsonrpc": "2.0", "result": [10], "id": 1}\r\n',
    ),
    "e871": (b"MAC BEG x", b""),
}
STREAMS = st.lists(st.sampled_from([b"a", b"bc", b"\r", b"\n", b"\r\n", b"\xff"]), max_size=40)


@example(parts=[b"a", b"\r\n"], cuts=[2, 2])
@given(STREAMS, st.lists(st.integers(0, 60), max_size=8))
def test_lines_are_those_of_python_however_they_are_cut(
    parts: list[bytes], cuts: list[int]
) -> None:
    stream = b"".join(parts)
    lines = Lines(1000)
    ends = [0, *sorted(cuts), len(stream)]
    found = [line for a, b in pairwise(ends) for line in lines.take(stream[a:b])]
    read = io.TextIOWrapper(io.BytesIO(stream + b"."), encoding="latin-1", newline=None).read()
    assert found == [line.encode("latin-1") for line in read.split("\n")[:-1]]


def test_a_long_line_is_told_once_and_takes_no_memory() -> None:
    lines = Lines(10)
    assert lines.take(b"0123456789\n") == [b"0123456789"]
    tracemalloc.start()
    for _ in range(1000):
        assert lines.take(b"x" * 1000) == []
    assert tracemalloc.get_traced_memory()[0] < 10_000
    tracemalloc.stop()
    assert lines.take(b"\nshort\n" + b"y" * 11 + b"\n") == [None, b"short", None]


COMMAND = (sys.executable, "-m", "stickslip_ros.cli.main", "emulate")


@pytest.fixture
def start() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Give a function that runs ``stickslip emulate``; what still runs at the end is killed."""
    started: list[subprocess.Popen[str]] = []

    def run(*arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [*COMMAND, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        started.append(process)
        return process

    yield run
    for process in started:
        process.kill()
        process.communicate()


def test_more_clients_than_it_takes_are_hung_up_on(emulate: Callable[..., Any]) -> None:
    emulated = emulate("mcs")
    with ExitStack() as stack:
        clients = [stack.enter_context(emulated.client()) for _ in range(MOST_CLIENTS)]
        assert clients[-1].ask(":GNC") == ":N1"
        with emulated.client() as late:
            assert late.until(b"\n") == b""
        assert clients[0].ask(":GNC") == ":N1"


def test_a_client_that_reads_nothing_is_not_read_from(emulate: Callable[..., Any]) -> None:
    emulated = emulate("mcs")
    with emulated.client() as deaf, emulated.client() as other:
        deaf.socket.settimeout(0.5)
        with pytest.raises(TimeoutError):
            for _ in range(1000):
                deaf.send(b":GP0\n" * 10000)
        assert other.ask(":GNC") == ":N1"


def test_what_a_program_said_is_a_table(
    emulate: Callable[..., Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each line with its answer, escaped, as bags hold text. The steps go on when it has gone."""
    bag = tmp_path / "bag"
    emulated = emulate("mcs", {}, record=bag)
    with emulated.client() as client:
        assert client.ask(":MST0,300,4095,1000") == ":E0,0"
        client.send(b"\x00\xff\n")
        assert client.ask(":GS1") == ":E-1,1"
    (axis,) = emulated.axes
    wait_until(lambda: emulated.look(lambda: axis.status.step_count) == 300, "all steps")
    emulated.close()
    (again,) = resimulate(open_bag(bag))
    assert again.bit_for_bit and again.states > 10
    assert main(["bag", "export", f"{bag}", "--out", f"{tmp_path / 'tables'}"]) == 0
    lines = list(csv.DictReader((tmp_path / "tables" / "mcs.commands.csv").open()))
    said = [(line["line"], line["answer"]) for line in lines if line["client"] == "1"]
    assert said[:3] == [
        ("(connects)", ""),
        (":MST0,300,4095,1000", ":E0,0\\n"),
        ("\\x00\\xff", ":E-1,1\\n"),
    ]
    assert said[-1] == ("(disconnects)", "")
    capsys.readouterr()
    assert main(["emulate", "mcs", "--port", "0", "--record", f"{bag}"]) == 2
    assert "exists already; name another one" in capsys.readouterr().err


@pytest.mark.long
def test_the_axes_are_shown_on_a_page(
    start: Callable[..., subprocess.Popen[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    """And the port is that of one server."""
    process = start("scu", "--port", "0", "--axes", "a", "--page", "--set", "gain=5e-9")
    assert process.stdout
    *_, address = process.stdout.readline().split()
    line = process.stdout.readline()
    port = int(line.partition(" port ")[2].partition(",")[0])
    what = (
        "axes a: Table 1 of the paper, ceim, preload 0.4 N, mass 4 g, "
        "amplitude 100 V (the most of an scu, not 300 V)"
    )
    assert line.endswith(f", {what}\n")
    with urllib.request.urlopen(address, timeout=20.0) as answer:
        text = answer.read().decode()
        assert f"<p>{what}</p>" in text
        assert "<td>a</td><td>stopped</td><td>0 nm</td><td>0</td>" in text
    assert main(["emulate", "mcs2", "--port", str(port)]) == 2
    assert str(port) in capsys.readouterr().err
    process.send_signal(signal.SIGINT)
    assert process.wait(20.0) == 0


def test_a_client_that_has_gone_is_not_written_to(
    emulate: Callable[..., Any], caplog: pytest.LogCaptureFixture
) -> None:
    """asyncio logs such writes one by one: there were 843 lines of them on stderr."""
    emulated = emulate("mcs2")
    with ExitStack() as stack:
        for _ in range(5):
            client = stack.enter_context(socket.create_connection(("127.0.0.1", emulated.port)))
            client.sendall(b"*IDN?\r\n" * 500)
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            client.close()  # with a reset, not read to the end
    with emulated.client() as client:
        assert client.ask("*IDN?").startswith("SmarAct")
    assert "socket.send() raised" not in caplog.text


def test_time_begins_with_the_first_command() -> None:
    axis = Axis({"frequency": 1000.0})
    with ServerThread(controller_of("mcs", [axis]), OwnAxes([axis]).run) as server:
        with Client(server.port) as client:
            client.socket.settimeout(None)  # it may compile
            assert client.ask(":MST0,20,4095,1000") == ":E0,0"
            while client.ask(":GS0") != ":S0,0":
                pass
        assert server.call(lambda: axis.status.step_count) == 20


def test_time_that_is_dropped_is_told(caplog: pytest.LogCaptureFixture) -> None:
    """10.4 s of wall were 0.25 s in the bag, in silence."""
    axis, ticks = Axis({"frequency": 20_000.0}), iter(range(0, 10**12, 3 * 10**9))
    own = OwnAxes([axis], lambda: next(ticks))
    own.begin()
    axis.command("jog", 20_000.0)
    for _ in range(3):
        asyncio.run(own.run(lambda: None))
    assert re.match(r"real-time factor \S+ of 1: .* by 20000 cycles a second", own.late)
    (said,) = (record.message for record in caplog.records)
    assert said.startswith("time is dropped, real-time factor ")
    (row,) = _rows(["x"], own)
    assert row[1] == f"jogging, time is dropped, {own.late}"


def test_names_are_no_axes() -> None:
    with pytest.raises(ParameterError, match=r"'x' is no axis; make one with stickslip_ros.Axis"):
        controller_of("anc300", ["x", "y"])  # type: ignore[list-item]


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_command_that_is_not_emulated_is_told_once(
    name: str, caplog: pytest.LogCaptureFixture
) -> None:
    """Each answers as the device does with what it does not have."""
    said, answer = LACKING[name]
    controller = controller_of(name, [Axis({"frequency": 1000.0})])
    dialogue = controller.connect()
    if name == "anc300":
        dialogue.answer(b"123456")
        dialogue.answer(b"echo off")
    for _ in range(2):
        assert dialogue.answer(said) == answer
    assert len(caplog.messages) == 1
    (lacking,) = [one for one, emulated in commands_of(name).items() if f" {one} " in caplog.text]
    assert not commands_of(name)[lacking]


@pytest.mark.long
def test_the_example_of_the_page_passes(tmp_path: Path) -> None:
    pytest.importorskip("pymeasure.instruments.attocube")
    pytest.importorskip("pyvisa_py")
    page = (REPOSITORY / "docs" / "testing.md").read_text(encoding="utf-8")
    _, example = re.findall(r"^```python\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    (tmp_path / "test_driver.py").write_text(example)
    found = python("-m", "pytest", "-q", "-p", "no:cacheprovider", cwd=tmp_path)
    assert "1 passed" in found.stdout, found.stdout
