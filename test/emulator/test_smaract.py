# SPDX-License-Identifier: Apache-2.0
"""SmarAct's controllers: what their public drivers send, and what these can parse.

The regular expressions are the patterns by which motorSmarAct's `parseReply` and ALBA's `send_cmd`
take answers apart. The drivers themselves need EPICS, or are not on PyPI.
"""

import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

MCS = {"gain": 5e-9, "frequency": 1000.0, "sensor_noise": 0.0}


class McsDriver:
    """As the EPICS driver and ALBA's talk to an MCS."""

    def __init__(self, client: Any) -> None:
        self._client = client

    def send(self, command: str) -> str:
        """Return the answer without the colon; a code of an error but 0 raises ValueError."""
        answer: str = self._client.ask(f":{command}")
        assert answer.startswith(":")
        error = re.fullmatch(r":E(-?\d+),(\d+)", answer)
        if error and int(error[2]):
            raise ValueError(int(error[2]))
        return answer[1:]

    def value(self, command: str) -> int:
        """Return the second number of an answer, as sscanf(":%10[A-Z]%i,%i") does."""
        found = re.fullmatch(r"[A-Z]{1,10}(-?\d+),(-?\d+)", self.send(command))
        assert found, command
        assert found[1] == command[-1]
        return int(found[2])

    def wait(self, *states: int) -> None:
        """Wait until the status of channel 0 is one of those."""
        for _ in range(2000):
            if self.value("GS0") in states:
                return
        pytest.fail(f"status is {self.value('GS0')}, not {states}")


PAGE = (Path(__file__).parents[2] / "docs" / "emulator.md").read_text(encoding="utf-8")
SESSIONS = re.findall(
    r"^stickslip emulate (\w+) +# lines end with (\S+)\n((?:.+\n)+?)(?=\n|```)", PAGE, re.M
)


@pytest.mark.parametrize(("name", "end", "session"), SESSIONS)
def test_a_session_of_the_page(
    emulate: Callable[..., Any], name: str, end: str, session: str
) -> None:
    """What is sent stands on the left, the answer on the right; each waits for the axis to rest."""
    emulated, question = emulate(name), {"scu": ":I", "mcs": ":GNC", "mcs2": "*OPC?"}[name]
    line_end = end.encode().decode("unicode_escape")
    with emulated.client() as client:
        for line in session.splitlines():
            sent, wanted = line[:30].strip(), line[30:]
            client.send(f"{sent}{line_end}".encode())
            if wanted:
                answer = client.until(line_end.encode()).decode().removesuffix(line_end)
                pattern = re.escape(wanted).replace(re.escape("..."), r"\d+")
                assert re.fullmatch(pattern, answer), (sent, answer)
            client.ask(question)  # what has no answer has been carried out now
            while emulated.look(lambda: emulated.axes[0].moving):
                time.sleep(0.01)
            time.sleep(0.05)  # it rings down


def test_the_page_has_a_session_of_each() -> None:
    assert [name for name, _, _ in SESSIONS] == ["scu", "mcs", "mcs2"]


def test_mcs_closed_loop_holds_as_long_as_it_is_told(emulate: Callable[..., Any]) -> None:
    emulated = emulate("mcs", {**MCS, "hold_time": 0.01})
    with emulated.client() as client:
        mcs = McsDriver(client)
        mcs.send("SCLS0,1000000")
        assert mcs.value("GCLS0") == 1000000
        mcs.send("MPA0,3000,60000")
        mcs.wait(3)
        assert mcs.value("GP0") == pytest.approx(3000, abs=10)
        mcs.send("MPR0,-1000,0")
        mcs.wait(0)
        assert mcs.value("GP0") == pytest.approx(2000, abs=10)
        mcs.send("SP0,0")
        assert mcs.value("GP0") == pytest.approx(0, abs=5)
        mcs.send("MPA0,500,0")
        mcs.wait(0)
        assert 1e9 * emulated.look(lambda: emulated.axes[0].state.x) == pytest.approx(2500, abs=15)
        mcs.send("MSCA0,2048,1000")
        mcs.wait(0)
        assert mcs.value("GVL0") == 2048


@pytest.mark.parametrize(
    ("controller", "position", "zero", "refused"),
    [("mcs", ":GP0", ":SP0,0", ":E0,7"), ("scu", ":GP0", ":SZ0", ":E0C7")],
)
def test_without_readings_there_is_an_error_and_no_zero(
    emulate: Callable[..., Any], controller: str, position: str, zero: str, refused: str
) -> None:
    emulated = emulate(controller, {**MCS, "allow_faults": True})
    axis = emulated.axes[0]
    with emulated.client() as client:
        known = client.ask(position)
        emulated.look(lambda: axis.command("parameters", {"fault": "sensor_dropout"}))
        assert client.ask(position) == refused
        assert client.ask(zero) == refused
        emulated.look(lambda: axis.command("parameters", {"fault": ""}))
        assert client.ask(position) == known


def test_a_drive_that_is_refused_leaves_the_running_one(emulate: Callable[..., Any]) -> None:
    emulated = emulate("mcs", {**MCS, "slewrate": 1.0})
    with emulated.client() as client:
        client.ask(":MST0,30000,1638,1000")
        assert client.ask(":MST0,10,4095,18000") == ":E0,7"
        volts = emulated.look(lambda: emulated.axes[0].status.amplitude)
        assert volts == pytest.approx(40.0)


def test_mcs_answers_with_a_code_what_cannot_be(emulate: Callable[..., Any]) -> None:
    with emulate("mcs", MCS).client() as client:
        for line, answer in [
            ("MST0,1,1,1", ":E-1,1"),
            (":mst0,1,1,1", ":E-1,1"),
            (":MST0,1.5,1,1", ":E-1,1"),
            (":XYZ0", ":E-1,2"),
            (":MST", ":E-1,5"),
            (":MST0,1", ":E0,5"),
            (":MST0,1,1,1,1", ":E0,6"),
            (":GNC0", ":E-1,6"),
            (":MST0,30001,1,1", ":E0,7"),
            (":MST0,1,4096,1", ":E0,7"),
            (":MST0,1,1,18501", ":E0,7"),
            (":MST0,1,1,0", ":E0,7"),
            (":SCLS0,-1", ":E0,7"),
            (":SCLA0,10000001", ":E0,7"),
            (":SCLF0,49", ":E0,7"),
            (":SSC0,-5,2", ":E0,7"),
            (":SSC0,-5,1", ":E0,0"),
            (":GP1", ":E1,7"),
            (":FRM0,8,0,1", ":E0,7"),
            (":FRM0,0,0,2", ":E0,7"),
            (":SPL0,-1000,1000", ":E0,148"),
            (":GPL0", ":E0,148"),
            ("what stands before:GNC", ":N1"),
            (":\n:GNC", ":N1"),
            (":SHE3", ":E-1,7"),
            (":SHE", ":E-1,5"),
            (":SHE2", ":E-1,0"),
            (":MAA0,90,0,0", ":E0,143"),
            (":GGO0", ":E0,145"),
            (":GTP0", ":E0,2"),
            (":" + "9" * 5000, ":E-1,1"),
        ]:
            assert client.ask(line) == answer
            assert client.ask(":GP0") == ":P0,0"


def test_mcs_finds_its_reference_and_limits_the_travel(emulate: Callable[..., Any]) -> None:
    with emulate("mcs", MCS).client() as client:
        mcs = McsDriver(client)
        mcs.send("FRM0,2,0,1")
        assert (mcs.value("GS0"), mcs.value("GPPK0")) == (7, 0)
        mcs.wait(0)
        assert mcs.value("GPPK0") == 1
        mcs.send("SPL0,-30000,20000")
        assert client.ask(":GPL0") == ":PL0,-30000,20000"
        mcs.send("MPA0,30000,60000")
        mcs.wait(0)  # no hold at a limit
        assert mcs.value("GP0") == pytest.approx(20000, abs=100)
        mcs.send("MPA0,0,60000")
        mcs.wait(3)
        client.send(b":SCM1\n:MPA0,30000,60000\n")
        assert client.until(b"\n") == b":E0,147\n"  # only in asynchronous mode
        assert client.ask(":SCM0") == ":E-1,0"
        mcs.send("SPL0,0,0")  # removes it
        assert client.ask(":GPL0") == ":E0,148"


def test_mcs_without_acknowledgement(emulate: Callable[..., Any]) -> None:
    with emulate("mcs", MCS).client() as client:
        client.send(b":SCM1\n:MST0,1,4095,1000\n:GNC\n:MST0\n")
        assert [client.until(b"\n") for _ in range(2)] == [b":N1\n", b":E0,5\n"]


def test_a_fault_locks_mcs_until_its_reset(emulate: Callable[..., Any]) -> None:
    with emulate("mcs", {**MCS, "max_velocity": 1e-7}).client() as client:
        mcs = McsDriver(client)
        mcs.send("MST0,1000,4095,1000")
        mcs.wait(9)
        with pytest.raises(ValueError, match="146"):
            mcs.send("MST0,1,4095,1000")
        mcs.send("R")
        mcs.wait(0)


class Mcs2Driver:
    """As the EPICS driver and the Tango server talk to an MCS2."""

    def __init__(self, client: Any) -> None:
        self._client = client

    def write(self, command: str) -> None:
        """Send a command that is not answered, and see that it left no error."""
        self._client.send(f"{command}\r\n".encode())
        assert self.ask(":SYST:ERR:COUN?") == "0", f"{command}: {self.ask(':SYST:ERR?')}"

    def ask(self, command: str) -> str:
        """Return the answer to a question."""
        answer: str = self._client.ask(command, b"\r\n")
        return answer

    def wait(self, bits: int, wanted: int) -> None:
        """Wait until these bits of the state of channel 0 are as wanted."""
        for _ in range(2000):
            if int(self.ask(":CHAN0:STAT?")) & bits == wanted:
                return
        pytest.fail(f"state is {self.ask(':CHAN0:STAT?')}")


def test_mcs2_takes_long_and_short_names_in_any_case(emulate: Callable[..., Any]) -> None:
    with emulate("mcs2", MCS, MCS).client() as client:
        mcs2 = Mcs2Driver(client)
        mcs2.write(":CHANnel1:STEP:FREQuency 1500")
        mcs2.write(":chan1:mmode 4")
        for names in (":CHANnel1:STEP:FREQuency?", ":chan1:step:freq?", ":CHAN1:Step:Frequency?"):
            assert mcs2.ask(names) == "1500"
        assert mcs2.ask(":CHANNEL1:MMODE?") == "4"
        assert mcs2.ask(":CHAN0:POS:CURR?") == mcs2.ask(":channel0:position?")
        assert mcs2.ask("*OPC?") == "1"
        assert (mcs2.ask(":DEV:NOBM?"), mcs2.ask(":DEVice:STATe?")) == ("1", "0")
        mcs2.write(":CHAN0:STEP:FREQ 1200;AMPL 30000")  # the second goes on where the first ended
        assert mcs2.ask(":CHAN0:STEP:FREQ?;AMPL?;*OPC?;:CHAN1:STEP:FREQ?") == "1200;30000;1;1500"
        assert mcs2.ask(":SYSTem:ERRor?") == '0,"No error"'


#: What the EPICS driver and the Tango server send beyond the sessions here, by what answers.
TOLD = (
    ":CAL0", ":CALIBRATE0", ":CHAN0:AMPL:ENAB 1", ":CHAN0:REF:OPT 0", ":CHAN0:CAL:OPT 1",
    ":CHAN0:ACT:MODE 0", ":CHAN0:MCLF 100", ":CHAN0:MCLF:CURR 5000", ":CHAN0:PTYP 300",
    ":CHAN0:RLIM:MAX 1000000000", ":CHAN0:RLIM:MIN -1000000000", ":CHAN0:SENS:MODE 1",
    ":CHAN0:HOLD 4294967295", ":CHAN0:VEL 1.5", ":CHAN0:ACC 1.5", ":STOP0",
)  # fmt: skip
ASKED = (
    "PTYP", "STAT", "VEL", "ACC", "MCLF", "FERR", "ERR", "TEMP", "POS", "POS:TARG", "AMPL",
    "MMOD", "STEP:AMPL", "STEP:FREQ", "HOLD", "TUN:MTYP", "RLIM:MAX", "RLIM:MIN", "CAL:OPT",
    "SENS:MODE", "ACT:MODE", "REF:OPT", "INP:THR", "INP:DEL", "TUN:THR:TRE", "DIAG:CLF:MAX",
    "TUN:RTYP", "TUN:BASE:RES", "TUN:BASE:UNIT",
)  # fmt: skip


def test_mcs2_answers_everything_that_public_drivers_send(emulate: Callable[..., Any]) -> None:
    """Two drivers waited for module states, tuning and actuator modes until they gave up."""
    with emulate("mcs2", MCS, MCS).client() as client:
        mcs2 = Mcs2Driver(client)
        for command in TOLD:
            mcs2.write(command)
        for name in (*(f":CHAN1:{one}?" for one in ASKED), ":MOD0:STAT?", ":MOD0:TEMP?"):
            int(mcs2.ask(name))
        assert mcs2.ask(":CHAN0:PTYP:NAME?").startswith('"')
        assert mcs2.ask(":MOD1:STAT?") == '34,"Invalid channel index"'
        assert mcs2.ask(":SYST:ERR:COUN?") == "1"


def test_mcs2_moves_in_every_mode(emulate: Callable[..., Any]) -> None:
    emulated = emulate("mcs2", MCS, MCS)
    with emulated.client() as client:
        mcs2 = Mcs2Driver(client)
        assert len(mcs2.ask("*IDN?").split(",")) == 4
        assert mcs2.ask(":DEV:NOCH?") == "2"
        mcs2.write(":CHAN0:HOLD -1")
        # A closed loop move
        mcs2.write(":CHAN0:MMOD 0")
        mcs2.write(":CHAN0:ACC 1000000.000000")
        mcs2.write(":CHAN0:VEL 1000000.000000")
        assert int(mcs2.ask(":MOVE0 3000000.000000;:CHAN0:STAT?")) & 0x3 == 0x3
        mcs2.wait(0x3, 0x2)
        assert int(mcs2.ask(":CHAN0:POS?")) == pytest.approx(3e6, abs=1e4)
        assert mcs2.ask(":CHAN0:POS:TARG?") == "3000000"
        mcs2.write(":CHAN0:HOLD 0")
        mcs2.write(":CHAN0:MMOD 1")
        mcs2.write(":MOVE0 -1000000")
        mcs2.wait(0x3, 0)
        assert int(mcs2.ask(":CHAN0:POS?")) == pytest.approx(2e6, abs=1e4)
        mcs2.write(":CHAN0:POS 0")
        assert int(mcs2.ask(":CHAN0:POS?")) == pytest.approx(0, abs=5e3)
        mcs2.write(":CHAN0:MMOD 2")
        mcs2.write(":MOVE0 32768")
        mcs2.wait(0x1, 0)
        assert mcs2.ask(":CHAN0:SCAN:POS?") == "32768"
        mcs2.write(":STOP0")
        assert mcs2.ask(":CHAN1:STAT?;:CHAN0:MMOD?") == "96;2"
        assert emulated.look(lambda: emulated.axes[1].status.step_count) == 0


def test_mcs2_finds_its_reference_and_limits_the_travel(emulate: Callable[..., Any]) -> None:
    emulated = emulate("mcs2", MCS)
    with emulated.client() as client:
        mcs2 = Mcs2Driver(client)
        for command in (":CHAN0:MMOD 4", ":CHAN0:STEP:AMPL 65535", ":MOVE0 -20"):
            mcs2.write(command)
        mcs2.wait(0x1, 0)
        assert emulated.look(lambda: emulated.axes[0].status.step_count) == -20
        for command in (":CHAN0:REF:OPT 4", ":CHAN0:HOLD 0", ":REF0"):
            mcs2.write(command)
        mcs2.wait(0x88, 0x8)  # on its way
        mcs2.wait(0x88, 0x80)
        mcs2.write(":CHAN0:RLIM:MAX 20000000")
        for command in (":CHAN0:MMOD 0", ":CHAN0:HOLD -1", ":MOVE0 30000000"):
            mcs2.write(command)
        mcs2.wait(0x201, 0x200)
        assert mcs2.ask(":CHAN0:ERR?") == "514"
        assert int(mcs2.ask(":CHAN0:POS?")) == pytest.approx(2e7, abs=1e5)


def test_mcs2_closed_loop_steps_with_the_drive_set_last(emulate: Callable[..., Any]) -> None:
    emulated = emulate("mcs2", MCS)
    with emulated.client() as client:
        mcs2 = Mcs2Driver(client)
        mcs2.write(":CHAN0:STEP:AMPL 32768")
        mcs2.write(":CHAN0:STEP:FREQ 10")
        mcs2.write(":MOVE0 5000000")
        status = emulated.look(lambda: emulated.axes[0].status)
        assert (status.amplitude, status.frequency) == (pytest.approx(50.0, abs=1e-3), 10.0)
        time.sleep(0.5)
        assert int(mcs2.ask(":CHAN0:STAT?")) & 0x3 == 0x3
        assert emulated.look(lambda: emulated.axes[0].status.step_count) <= 10


def test_mcs2_keeps_errors_until_they_are_asked_for(emulate: Callable[..., Any]) -> None:
    with emulate("mcs2", {**MCS, "soft_low": -1e-3, "soft_high": 1e-3}).client() as client:
        for line, error in [
            ("MOVE0", -109),
            (":MOVE0 far", -104),
            (":MOVE7 1", 34),
            (":CHAN7:POS?", 34),
            (":CHAN0:FLY?", -113),
            (":CHAN0:FLY 1", -113),
            (":CHAN0:STAT 1", -113),
            (":FLY", -113),
            ("!!", -101),
            (":STOP0 1", -108),
            (":CHAN0:MMOD 5", -222),
            (":CHAN0:STEP:FREQ 0", -222),
            (":CHAN0:STEP:AMPL 65536", -222),
            (":CHAN0:MMOD 4;:MOVE0 100001", -222),
            (":CHAN0:MMOD 4;:MOVE0 20.5", -222),
            (":MOVE0 1e99", -222),
            (":CHAN0:LSC:OFFS 5", 32765),
            ("9" * 5000, -363),
        ]:
            if line.endswith("?"):
                assert client.ask(line, b"\r\n").startswith(f'{error},"'), line
            else:
                client.send(line.encode() + b"\r\n")
            assert client.ask(":SYST:ERR:COUN?", b"\r\n") == "1", line
            assert client.ask(":SYST:ERR?", b"\r\n").startswith(f'{error},"'), line
            assert client.ask(":SYST:ERR?", b"\r\n") == '0,"No error"'
        for _ in range(100):
            client.send(b":FLY\r\n")
        assert client.ask(":SYST:ERR:COUN?", b"\r\n") == "20"


def test_switching_the_amplifier_leaves_a_fault(emulate: Callable[..., Any]) -> None:
    with emulate("mcs2", {**MCS, "max_velocity": 1e-7}).client() as client:
        mcs2 = Mcs2Driver(client)
        mcs2.write(":CHAN0:MMOD 4")
        mcs2.write(":MOVE0 1000")
        mcs2.wait(0x800, 0x800)
        client.send(b":MOVE0 1\r\n")
        assert mcs2.ask(":SYST:ERR?") == '262,"Movement locked"'
        mcs2.write(":CHAN0:AMPL 1")
        mcs2.wait(0x800, 0)
