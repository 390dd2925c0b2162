# SPDX-License-Identifier: Apache-2.0
"""20 000 commands at random to each emulated controller, from two clients at once, over TCP.

The names are those of the tables of each protocol, the numbers hostile, every third line is
mutated, some come as bytes of anything, far too long, or in halves. Nothing of it may end in a
traceback, grow the memory, or keep a third client waiting for longer than 10 s.

``STICKSLIP_FUZZ_COMMANDS`` sets how many, ``STICKSLIP_FUZZ_SEED`` the seed.
"""

import contextlib
import os
import random
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from stickslip_ros.emulator import CONTROLLERS, commands_of

from .fuzzing import SEED, megabytes

COMMANDS = int(os.environ.get("STICKSLIP_FUZZ_COMMANDS", "20000"))
pytestmark = [pytest.mark.long, pytest.mark.timeout(600 + COMMANDS // 20)]
PATIENCE = 10.0  # s for an answer
MOST_GROWTH = 8.0  # MB over the last three quarters
ROUND = 200  # commands between two questions of the third client
NUMBERS = (
    "0", "1", "-1", "3", "7", "4095", "65535", "2147483647", "-2147483648", "9" * 12, "1e3", "0.5",
    "1e999", "nan", "inf", "-0", "0x1", "9" * 400, "", "on", "off", "stp", "c", "cap", "U", "true",
)  # fmt: skip
LETTERS = "PHFASDTZ"


def scu(chance: random.Random, name: str, values: list[str]) -> str:
    return f":{name}0" + "".join(chance.choice(LETTERS) + one for one in values)


def mcs2(chance: random.Random, name: str, values: list[str]) -> str:
    forms = (f":CHAN0:{name}", f":{name}0", f":{name}", f":CHAN{'9' * 9}:{name}", f":CHAN1:{name};")
    return chance.choice(forms) + " " + ",".join(values)


def amc(chance: random.Random, name: str, values: list[str]) -> str:
    room = chance.choice(("com.attocube.", "com.attocube.amc."))
    given = ",".join(one or '""' for one in ["0", *values])
    return f'{{"method":"{room}{name}","params":[{given}],"id":1}}'


#: How a command is written, what stops all axes, a question
DIALECTS: dict[str, tuple[Callable[[random.Random, str, list[str]], str], bytes, bytes]] = {
    "anc300": (lambda _, name, v: " ".join([name, "1", *v]), b"stop 1", b"getm 1"),
    "scu": (scu, b":S0", b":I"),
    "mcs": (lambda _, name, v: f":{name}" + ",".join(["0", *v]), b":S0", b":GNC"),
    "mcs2": (mcs2, b":STOP0", b":DEV:NOCH?"),
    "amc": (
        amc,
        b'{"method":"com.attocube.amc.move.setControlContinuousFwd","params":[0,false]}',
        b'{"method":"getLockStatus"}',
    ),
    "e871": (lambda _, name, v: " ".join([name, "1", *v]), b"STP", b"*IDN?"),
}
BEGIN = {"anc300": b"123456\r\n"}


def lines(chance: random.Random, name: str) -> Iterator[bytes]:
    """Yield commands for ever, with their ends; some are halves, that go on with the next."""
    write, known = DIALECTS[name][0], list(commands_of(name))
    while True:
        count = 256 if chance.random() < 0.01 else chance.randrange(5)
        values = [chance.choice((*NUMBERS, str(chance.randrange(-100, 100)))) for _ in range(count)]
        line = bytearray(write(chance, chance.choice(known), values).encode())
        kind = chance.random()
        if kind < 0.33:
            for _ in range(chance.randrange(1, 4)):
                at = chance.randrange(len(line) + 1)
                line[at : at + chance.randrange(3)] = chance.randbytes(chance.randrange(3))
        elif kind < 0.40:
            line = bytearray(chance.randbytes(chance.randrange(80)))
        elif kind < 0.41:
            line *= 5000 // len(line) + 1
        elif kind < 0.45:
            yield bytes(line[: len(line) // 2])
            continue
        yield bytes(line) + chance.choice((b"\r\n", b"\n", b"\r"))


def exchange(clients: list[socket.socket], source: Iterator[bytes], chance: random.Random) -> int:
    """Send a round of commands, reading all that comes; return how many were taken in time."""
    sent, end = 0, time.monotonic() + 1.0
    while clients and sent < ROUND and time.monotonic() < end:
        readable, writable, _ = select.select(clients, clients, [], 0.1)
        clients = [one for one in clients if one not in readable or one.recv(65536)]
        if taking := [one for one in writable if one in clients]:
            sent += 1
            chance.choice(taking).send(next(source))
    return sent


def rest_of(client: socket.socket) -> bytes:
    """Say that nothing follows; return what comes until all is done and the other hangs up."""
    with contextlib.suppress(OSError):  # it was too much for the other side
        client.shutdown(socket.SHUT_WR)
        return b"".join(iter(lambda: client.recv(65536), b""))
    return b""


@pytest.mark.parametrize("name", CONTROLLERS)
def test_commands_at_random(name: str, tmp_path: Path) -> None:
    chance = random.Random(f"{name} {SEED}")
    _, stop, question = DIALECTS[name]
    command = (sys.executable, "-m", "stickslip_ros.cli.main", "emulate", name, "--port", "0")
    options = ("--axes", "x", "--set", "gain=5e-9")
    with (tmp_path / "err").open("wb") as err:
        controller = subprocess.Popen(
            [*command, *options], stdout=subprocess.PIPE, stderr=err, text=True
        )
    try:
        assert controller.stdout
        port = int(controller.stdout.readline().partition(" port ")[2].partition(",")[0])

        def connect(stack: ExitStack) -> socket.socket:
            client = socket.create_connection(("127.0.0.1", port), PATIENCE)
            stack.callback(client.close)
            client.sendall(BEGIN.get(name, b""))
            return client

        source, used, sent, worst = lines(chance, name), [], 0, 0.0
        while sent < COMMANDS:
            with ExitStack() as stack:
                clients = [connect(stack), connect(stack)]
                sent += exchange(clients, source, chance)
                began, asking = time.monotonic(), connect(stack)
                asking.sendall(stop + b"\r\n" + question + b"\r\n")
                assert rest_of(asking), (name, SEED, sent)
                worst = max(worst, time.monotonic() - began)
                for client in clients:
                    rest_of(client)
            used.append(megabytes(controller.pid))
        grown = used[-1] - used[len(used) // 4]
        print(f"{name}: {sent} commands, {worst:.2f} s at worst, {grown:+.1f} MB")
        assert worst < PATIENCE
        assert grown < MOST_GROWTH, used
        controller.send_signal(signal.SIGINT)
        assert controller.wait(PATIENCE) in (0, 130)
    finally:
        controller.kill()
        controller.communicate()
    said = (tmp_path / "err").read_text()
    assert "Traceback" not in said
    assert not [line for line in said.splitlines() if "is not emulated" not in line], said
