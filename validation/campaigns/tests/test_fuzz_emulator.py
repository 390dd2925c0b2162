# SPDX-License-Identifier: Apache-2.0
"""Lines in the dialects of the emulated controllers, with hostile numbers and bytes, over TCP.

The names of the commands are those of the tables of each dialect, so new ones are in it.
"""

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator

import pytest
from cpu_time import cpu_seconds
from hypothesis import strategies as some
from hypothesis.strategies import SearchStrategy

from stickslip_ros.emulator import amc, anc300, gcs, mcs2, smaract

from .fuzzing import MOST_GROWTH, TIME, megabytes, search

pytestmark = [pytest.mark.long, TIME]
PATIENCE = 30.0  # s for an answer, on a machine that is busy with other things
LONGEST = 2.0  # s of computing for one dialogue
NUMBERS = (
    "0", "1", "-1", "3", "7", "4095", "65535", "2147483647", "-2147483648", "9" * 12, "1e3",
    "1e999", "nan", "inf", "-0", "0x1", "9" * 400, "", "on", "off", "stp", "c", "cap",
)  # fmt: skip


def _words(names: list[str], begin: str, between: str, after: str) -> SearchStrategy[bytes]:
    """Give lines of a name and some numbers."""
    number = some.sampled_from(NUMBERS) | some.integers().map(str)
    return some.builds(
        lambda name, numbers: f"{begin}{name}{after}{between.join(numbers)}".encode(),
        some.sampled_from(names),
        some.lists(number, max_size=4) | number.map(lambda one: [one] * 256),
    )


def _scpi(header: str) -> list[str]:
    return [header, f"CHAN0:{header}", f"CHAN1:{header}", f"{header}0", f"CHAN{'9' * 9}:{header}"]


DIALECTS = {
    "anc300": (_words([*anc300.OF_MODULE, "echo", "help"], "", " ", " "), b"getm 1"),
    "mcs": (_words([*smaract.MCS_CHANNEL, "GNC", "X"], ":", ",", ""), b":GNC"),
    "scu": (_words([f"{name}0" for name in smaract.SCU_CHANNEL], ":", "F", "P"), b":I"),
    "mcs2": (
        _words([one for name in mcs2.OF_CHANNEL for one in _scpi(name)], ":", ",", " "),
        b":DEV:NUMCHAN?",
    ),
    "amc": (
        _words([*amc.OF_AXIS], '{"method":"com.attocube.amc.', ",", '","params":[0,').map(
            lambda line: line + b"]}"
        ),
        b'{"method":"getLockStatus"}',
    ),
    "e871": (_words([*gcs.OF_AXIS, "SAI?", "STP"], "", " ", " 1 "), b"*IDN?"),
}
ANYTHING = some.binary(max_size=60).map(lambda line: line.replace(b"\n", b"").replace(b"\r", b""))


@pytest.fixture(params=DIALECTS)
def dialect(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def controller(dialect: str) -> Iterator[subprocess.Popen[str]]:
    """A controller with two axes, if it takes as many, in a process of its own."""
    command = (sys.executable, "-m", "stickslip_ros.cli.main", "emulate", dialect)
    options = ("--port", "0", "--axes", "x" if dialect == "e871" else "x,y")
    process = subprocess.Popen([*command, *options], stdout=subprocess.PIPE, text=True)
    yield process
    process.kill()
    process.communicate()


def test_lines(controller: subprocess.Popen[str], dialect: str) -> None:
    assert controller.stdout
    port = int(controller.stdout.readline().partition(" port ")[2].partition(",")[0])
    lines, question = DIALECTS[dialect]
    begin = b"123456\r\n" if dialect == "anc300" else b""

    def asked() -> bytes:
        """Ask on a connection of its own; return the answer."""
        with socket.create_connection(("127.0.0.1", port), PATIENCE) as asking:
            asking.sendall(begin + question + b"\r\n")
            asking.shutdown(socket.SHUT_WR)
            return b"".join(iter(lambda: asking.recv(4096), b""))

    def check(example: list[bytes]) -> None:
        computed = cpu_seconds(controller.pid)
        with socket.create_connection(("127.0.0.1", port), PATIENCE) as peer:
            peer.sendall(begin + b"".join(line + b"\r\n" for line in example))
            assert asked()
        assert cpu_seconds(controller.pid) - computed < LONGEST

    memory = megabytes(controller.pid)
    count = search(some.lists(lines | ANYTHING, min_size=1, max_size=8), check)
    print(f"{count} dialogues, {megabytes(controller.pid) - memory:+.1f} MB")
    assert megabytes(controller.pid) - memory < MOST_GROWTH
    controller.send_signal(signal.SIGINT)
    assert controller.wait(PATIENCE) in (0, 130)
