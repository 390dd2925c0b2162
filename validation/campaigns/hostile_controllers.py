# SPDX-License-Identifier: Apache-2.0
"""Commands at random to each emulated controller, from two clients at once, over TCP.

The names are those of the tables of each protocol, the numbers hostile, every third line is
mutated, some come as bytes of anything, far too long, or in halves. Nothing of it may end in a
traceback, grow the memory, or keep a third client waiting for longer than 10 s.
"""

import contextlib
import random
import select
import signal
import socket
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

from stickslip_ros.emulator import CONTROLLERS, commands_of
from validation.campaigns.processes import Program, memory_of

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


def controllers(commands: int, seed: int) -> int:
    """Send so many commands to each controller; return how many of them were not up to it."""
    return sum(bool(_controller(name, commands, seed)) for name in CONTROLLERS)


def _controller(name: str, commands: int, seed: int) -> list[str]:
    chance, (_, stop, question) = random.Random(f"{name} {seed}"), DIALECTS[name]
    words = ("emulate", name, "--port", "0", "--axes", "x", "--set", "gain=5e-9")
    source, used, sent, worst = lines(chance, name), [], 0, 0.0
    with tempfile.TemporaryDirectory() as folder:
        controller = Program(Path(folder), *words, module="stickslip_ros.cli.main")
        try:
            controller.wait_for(" port ")
            port = int(controller.said.partition(" port ")[2].partition(",")[0])

            def connect(stack: ExitStack) -> socket.socket:
                client = socket.create_connection(("127.0.0.1", port), PATIENCE)
                stack.callback(client.close)
                client.sendall(BEGIN.get(name, b""))
                return client

            while sent < commands:
                with ExitStack() as stack:
                    clients = [connect(stack), connect(stack)]
                    sent += exchange(clients, source, chance)
                    began, asking = time.monotonic(), connect(stack)
                    asking.sendall(stop + b"\r\n" + question + b"\r\n")
                    if not rest_of(asking):
                        break
                    worst = max(worst, time.monotonic() - began)
                    for client in clients:
                        rest_of(client)
                used.append(memory_of(controller.pid))
            controller.signalled(signal.SIGINT, PATIENCE)
            found = controller.faults(0, 130)
        finally:
            controller.end()
        said = controller.said.splitlines()[1:]
    grown = used[-1] - used[len(used) // 4] if used else 0.0
    found += ["no answer"] * (sent < commands) + ["slow"] * (worst > PATIENCE)
    found += [f"grew: {used}"] * (grown > MOST_GROWTH)
    found += [line for line in said if "is not emulated" not in line and line.startswith("stick")]
    print(f"{name}: {sent} commands, {worst:.2f} s at worst, {grown:+.1f} MB", *found, sep="\n  ")
    return found
