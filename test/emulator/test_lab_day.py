# SPDX-License-Identifier: Apache-2.0
"""A lab program's whole day on each controller, in the words of that controller's drivers.

It connects, steps, references, moves, stops in the middle, runs into a limit, disconnects in a move
and reconnects. All of it is recorded, and the recording comes out again bit for bit.
"""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import pytest
from live import wait_until
from table_1 import table_1

from stickslip_ros.motion.steps import run_steps
from stickslip_ros.recordings import open_bag, resimulate

#: The travel is limited to 20 um, in the axis and by those who can limit it themselves.
DRIVE = {"gain": 5e-9, "frequency": 1000.0, "sensor_noise": 0.0, "soft_high": 20e-6}
LIMIT, BEYOND = 20000, 30000  # nm


class Lab:
    """A program with its connection; positions in nm."""

    volts: ClassVar[float] = 100.0
    closed_loop: ClassVar[bool] = True

    def __init__(self, client: Any) -> None:
        self.client = client

    def steps(self, count: int) -> None:
        """Begin steps at the amplitude and 1 kHz; 0: without end."""
        raise NotImplementedError

    def at_rest(self) -> bool:
        """Return whether the device says that the last motion has ended."""
        raise NotImplementedError

    def reference(self) -> None:
        """Begin to find the reference, or what comes nearest to it."""
        raise NotImplementedError

    def known(self) -> bool:
        """Return whether it has been found."""
        raise NotImplementedError

    def go(self, nm: int) -> None:
        """Begin to go to a position."""
        raise NotImplementedError

    def position(self) -> float:
        """Return the position."""
        raise NotImplementedError

    def stop(self) -> None:
        """Stop."""
        raise NotImplementedError

    def beyond(self) -> None:
        """Go beyond the limit, and see that the device says so as its manual does."""
        raise NotImplementedError

    def rest(self) -> None:
        wait_until(self.at_rest, "rest")


class Anc300(Lab):
    """An open loop without a sensor: the capacitance is what is known after a while."""

    closed_loop = False

    def __init__(self, client: Any) -> None:
        super().__init__(client)
        client.until(b": ")
        client.send(b"123456\r\necho off\r\n")
        client.until(b"OK\r\n")

    def ask(self, line: str) -> str:
        answer: str = self.client.ask(line, b"OK\r\n")
        return answer

    def steps(self, count: int) -> None:
        for line in ("setm 1 stp", f"setv 1 {self.volts}", "setf 1 1000"):
            assert self.ask(line) == ""
        self.ask(f"step{'d' if count < 0 else 'u'} 1 {abs(count) or 'c'}")

    def at_rest(self) -> bool:
        return self.ask("stepw 1") == ""  # answered when it is

    def reference(self) -> None:
        self.ask("setm 1 cap")
        self.ask("capw 1")

    def known(self) -> bool:
        return self.ask("getc 1") == "capacitance = 1000.000000 nF\r\n"

    def stop(self) -> None:
        self.ask("stop 1")

    def beyond(self) -> None:
        self.steps(0)
        self.rest()  # although nobody stopped it


class Amc(Lab):
    volts = 45.0

    def result(self, method: str, *values: object) -> list[Any]:
        asked = {"jsonrpc": "2.0", "method": f"com.attocube.amc.{method}", "api": 2, "id": 1}
        self.client.send(json.dumps({**asked, "params": list(values)}).encode())
        answer: list[Any] = json.loads(self.client.until(b"\r\n"))["result"]
        return answer

    def ask(self, method: str, *values: object) -> Any:
        error, *found = self.result(method, 0, *values)
        assert error == 0, method
        return found[0] if found else None

    def steps(self, count: int) -> None:
        self.ask("control.setControlOutput", True)
        self.ask("control.setControlAmplitude", 1000 * self.volts)
        self.ask("control.setControlFrequency", 1000000)
        if count:
            self.ask("move.setNSteps", count < 0, abs(count))
        else:
            self.ask("move.setControlContinuousFwd", True)

    def at_rest(self) -> bool:
        held = self.ask("control.getControlMove") and self.ask("status.getStatusTargetRange")
        return bool(held) or self.ask("status.getStatusMoving") == 0

    def reference(self) -> None:
        assert self.result("move.moveReference", 0) == [3]  # it has to be searched first
        self.ask("control.setControlAutoReset", True)
        self.ask("control.searchReferencePosition")

    def known(self) -> bool:
        return bool(self.ask("status.getStatusReference"))

    def go(self, nm: int) -> None:
        self.ask("move.setControlTargetPosition", nm)
        self.ask("control.setControlMove", True)

    def position(self) -> float:
        return float(self.ask("move.getPosition"))

    def stop(self) -> None:
        self.ask("move.setControlContinuousFwd", False)

    def beyond(self) -> None:
        before = self.ask("move.getControlTargetPosition")
        assert self.result("move.setControlTargetPosition", 0, BEYOND) == [7]
        assert self.ask("move.getControlTargetPosition") == before


class Scu(Lab):
    def steps(self, count: int) -> None:
        if count:
            letter = "D" if count < 0 else "U"
            self.client.send(f":{letter}0F1000A{10 * self.volts:.0f}S{abs(count)}\n".encode())
        else:
            self.client.send(b":MES0DU\n")

    def at_rest(self) -> bool:
        return self.client.ask(":M0") in (":M0S", ":M0H")

    def reference(self) -> None:
        assert self.client.ask(":GPPK0") == ":PPK0P0"
        self.client.send(b":MTR0H0Z1\n")
        assert self.client.ask(":M0") == ":M0R"

    def known(self) -> bool:
        return bool(self.client.ask(":GPPK0") == ":PPK0P1")

    def go(self, nm: int) -> None:
        self.client.send(f":MPA0P{1e-3 * nm:.3f}H60000\n".encode())

    def position(self) -> float:
        return 1e3 * float(self.client.ask(":GP0").removeprefix(":P0P"))

    def stop(self) -> None:
        self.client.send(b":S0\n")

    def beyond(self) -> None:
        self.go(BEYOND)
        self.rest()
        assert self.position() == pytest.approx(LIMIT, abs=100)
        wait_until(lambda: self.client.ask(":M0") == ":M0S", "no hold at a limit")


class Mcs(Lab):
    def ask(self, command: str) -> str:
        found = re.fullmatch(r":[A-Z]+(-?\d+),(-?\d+)", self.client.ask(command))
        assert found, command
        return found[2]

    def tell(self, command: str) -> None:
        assert self.client.ask(command) == ":E0,0"

    def steps(self, count: int) -> None:
        self.tell(f":MST0,{count or 30000},4095,1000")

    def at_rest(self) -> bool:
        return self.ask(":GS0") in "03"

    def reference(self) -> None:
        assert self.client.ask(":SPL0,-1000,5000") == ":E0,148"  # only where the position is known
        self.tell(":FRM0,2,0,1")
        assert self.ask(":GS0") == "7"

    def known(self) -> bool:
        return self.ask(":GPPK0") == "1"

    def go(self, nm: int) -> None:
        self.tell(f":MPA0,{nm},60000")

    def position(self) -> float:
        return float(self.ask(":GP0"))

    def stop(self) -> None:
        self.tell(":S0")

    def beyond(self) -> None:
        self.tell(f":SPL0,-{BEYOND},{LIMIT}")
        assert self.client.ask(":GPL0") == f":PL0,-{BEYOND},{LIMIT}"
        self.go(BEYOND)
        wait_until(lambda: self.ask(":GS0") == "0", "a stop at the limit")
        assert self.position() == pytest.approx(LIMIT, abs=100)
        self.go(0)
        self.rest()
        self.client.send(f":SCM1\n:MPA0,{BEYOND},60000\n".encode())
        assert self.client.until(b"\n") == b":E0,147\n"  # only in asynchronous mode
        assert self.client.ask(":SCM0") == ":E-1,0"
        self.tell(":SPL0,0,0")  # removes it
        assert self.client.ask(":GPL0") == ":E0,148"


class Mcs2(Lab):
    def tell(self, *commands: str) -> None:
        for command in commands:
            self.client.send(f"{command}\r\n".encode())
            assert self.ask(":SYST:ERR?") == '0,"No error"', command

    def ask(self, question: str) -> str:
        answer: str = self.client.ask(question, b"\r\n")
        return answer

    def state(self, bits: int) -> int:
        return int(self.ask(":CHAN0:STAT?")) & bits

    def steps(self, count: int) -> None:
        self.tell(":CHAN0:MMOD 4", ":CHAN0:STEP:AMPL 65535", f":MOVE0 {count or 100000}")

    def at_rest(self) -> bool:
        return not self.state(0x1)

    def reference(self) -> None:
        self.tell(":CHAN0:REF:OPT 4", ":CHAN0:HOLD 0", ":REF0")
        assert self.state(0x88) == 0x8

    def known(self) -> bool:
        return self.state(0x88) == 0x80

    def go(self, nm: int) -> None:
        self.tell(":CHAN0:MMOD 0", ":CHAN0:HOLD -1", f":MOVE0 {nm}000.000000")

    def position(self) -> float:
        return 1e-3 * float(self.ask(":CHAN0:POS?"))

    def stop(self) -> None:
        self.tell(":STOP0")

    def beyond(self) -> None:
        self.tell(f":CHAN0:RLIM:MAX {LIMIT}000")
        self.go(BEYOND)
        wait_until(lambda: self.state(0x201) == 0x200, "a stop at the limit")
        assert self.ask(":CHAN0:ERR?") == "514"
        assert self.position() == pytest.approx(LIMIT, abs=100)


class Gcs(Lab):
    def tell(self, command: str, error: str = "0") -> None:
        self.client.send(f"{command}\n".encode())
        assert self.client.ask("ERR?") == error, command

    def steps(self, count: int) -> None:
        self.tell("SVO 1 0")
        self.tell("OVL 1 1000")
        self.tell(f"OSM 1 {count or 1000000}")

    def at_rest(self) -> bool:
        self.client.send(b"\x05")
        return bool(self.client.until(b"\n") == b"0\n")

    def reference(self) -> None:
        self.tell("SVO 1 1")
        self.tell("MOV 1 0.001", "5")  # not without a reference
        self.tell("FRF")

    def known(self) -> bool:
        return bool(self.client.ask("FRF?") == "1=1")

    def go(self, nm: int) -> None:
        self.tell("SVO 1 1")
        self.tell(f"MOV 1 {1e-6 * nm:.6f}")

    def position(self) -> float:
        return 1e6 * float(self.client.ask("POS? 1").removeprefix("1="))

    def stop(self) -> None:
        self.tell("HLT 1", "10")

    def beyond(self) -> None:
        self.tell("SVO 1 1")
        before = self.client.ask("MOV? 1")
        self.tell(f"MOV 1 {1e-6 * BEYOND:.6f}", "7")
        assert self.client.ask("MOV? 1") == before


LABS = {"anc300": Anc300, "amc": Amc, "scu": Scu, "mcs": Mcs, "mcs2": Mcs2, "e871": Gcs}


@pytest.mark.parametrize("name", LABS)
def test_a_lab_programs_whole_day(emulate: Callable[..., Any], name: str, tmp_path: Path) -> None:
    kind: type[Lab] = LABS[name]
    emulated = emulate(name, {**DRIVE, "amplitude": kind.volts}, record=tmp_path / "bag")
    (axis,) = emulated.axes

    def status() -> Any:
        return emulated.look(lambda: axis.status)

    with emulated.client() as client:
        lab = kind(client)

        lab.steps(20)  # as `simulate` does
        lab.rest()
        assert status().step_count == 20
        simulated = run_steps(table_1(**{**DRIVE, "amplitude": kind.volts}), 20).position[-1]
        assert 20 * status().mean_step == pytest.approx(simulated, abs=1e-11)

        lab.reference()
        wait_until(lab.known, "the reference")

        if lab.closed_loop:
            lab.go(2000)
            lab.rest()
            assert lab.position() == pytest.approx(2000, abs=101)
            assert 1e9 * status().position == pytest.approx(2000, abs=101)

        lab.steps(-1000)
        wait_until(lambda: status().step_count < 15, "a few steps")
        lab.stop()
        lab.rest()
        assert -980 < status().step_count < 15

        lab.beyond()

        begun = status().step_count
        lab.steps(-100)
    wait_until(lambda: status().step_count == begun - 100, "steps of a program that has gone")

    with emulated.client() as client:
        lab = kind(client)
        lab.rest()
        if lab.closed_loop:
            assert lab.known()
            assert lab.position() == pytest.approx(1e9 * status().position, abs=50)  # it rings
            lab.go(1000)
            lab.rest()
            assert lab.position() == pytest.approx(1000, abs=101)

    emulated.close()
    bag = open_bag(tmp_path / "bag")
    (again,) = resimulate(bag)
    assert again.bit_for_bit
    assert again.states > 10
    assert bag.counts[f"/{name}/commands"] > 10
