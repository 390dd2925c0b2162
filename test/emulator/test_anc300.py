# SPDX-License-Identifier: Apache-2.0
"""The console of the ANC300: drivers of others, unmodified, and the dialogue byte by byte.

PyMeasure's is that of journey 5.
"""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from live import wait_until

from stickslip_ros.emulator.anc300 import TelnetLines


@pytest.mark.parametrize("command", ["setv 1 0", "stop 1"])
def test_no_voltage_ends_a_motion_as_a_stop_does(emulate: Callable[..., Any], command: str) -> None:
    emulated = emulate("anc300", {})
    with logged_in(emulated) as client:
        for line in ("setm 1 stp", "stepu 1 c"):
            client.ask(line, b"OK\r\n")
        assert emulated.look(lambda: emulated.axes[0].moving)
        client.ask(command, b"OK\r\n")
        wait_until(lambda: not emulated.look(lambda: emulated.axes[0].moving), "a stop")


def test_the_capacitance_is_known_after_a_while(emulate: Callable[..., Any]) -> None:
    with logged_in(emulate("anc300")) as client:
        client.ask("setm 1 cap", b"OK\r\n")
        assert client.ask("capw 1", b"OK\r\n") == client.ask("getc 1", b"OK\r\n") != ""
        wait_until(lambda: client.ask("getm 1", b"OK\r\n") == "mode = gnd\r\n", "the ground")


@pytest.mark.long  # its import takes seconds
def test_pylablib_drives_it_too(emulate: Callable[..., Any]) -> None:
    attocube = pytest.importorskip("pylablib.devices.Attocube")
    emulated = emulate("anc300", {}, {})
    device = attocube.ANC300(("127.0.0.1", emulated.port))
    try:
        assert device.get_all_axes() == [1, 2]
        device.set_mode(1, "stp")
        assert device.set_voltage(1, 100.0) == 100.0
        assert device.set_frequency(1, 500) == 500.0
        device.move_by(1, 20)
        device.wait_move(1)
        assert emulated.look(lambda: emulated.axes[0].status.step_count) == 20
        device.jog(1, "+")
        assert emulated.look(lambda: emulated.axes[0].mode) == "jogging"
        device.stop(1)
        device.wait_move(1)
        assert device.get_capacitance(1) == pytest.approx(1e-6)
        assert device.get_mode() == {1: "stp", 2: "gnd"}
        with pytest.raises(attocube.AttocubeError, match="Axis in wrong mode"):
            device.move_by(2, 10)
        assert device.get_full_status()["voltage_outputs"][2] == 0.0
    finally:
        device.close()


def logged_in(emulated: Any) -> Any:
    """Return a client behind the password, without echo."""
    client = emulated.client()
    client.until(b": ")
    client.send(b"123456\r\necho off\r\n")
    client.until(b"OK\r\n")
    return client


def test_the_dialogue_from_the_first_byte_on(emulate: Callable[..., Any]) -> None:
    with emulate("anc300").client() as client:
        assert client.until(b": ").startswith(b"\xff\xfb")  # Telnet negotiation
        client.send(b"\xff\xfd\x01wrong\r\n")
        assert client.until(b": ") == b"*****\r\nAuthorization failed\r\nAuthorization code: "
        client.send(b"123456\r\n")
        assert client.until(b"> ") == b"******\r\nAuthorization success\r\n> "
        client.send(b"getm 1\r")
        assert client.until(b"> ") == b"getm 1\r\nmode = gnd\r\nOK\r\n> "
        client.send(b"\r\n")
        assert client.until(b"> ") == b"\r\n> "
        client.send(b"echo off\r\ngetf 1\n")
        assert client.until(b"OK\r\n") == b"echo off\r\nOK\r\n"
        assert client.until(b"OK\r\n") == b"frequency = 100 Hz\r\nOK\r\n"
        client.send(b" \x0b\x00\r\ngetm 1\n")  # a blank is no command
        assert client.until(b"OK\r\n") == b"mode = gnd\r\nOK\r\n"


def test_help_names_the_arguments(emulate: Callable[..., Any]) -> None:
    with logged_in(emulate("anc300")) as client:
        lines = client.ask("help", b"OK\r\n").split("\r\n")
        assert {"setv <axis> <value>", "stepu <axis> [<value>]", "ver", "echo on|off"} <= set(lines)
        assert client.ask("help SETPU", b"OK\r\n") == "setpu <axis> <value> ...\r\n"
        assert client.ask("help fly", b"ERROR\r\n") == "Unknown command\r\n"


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_what_is_of_telnet_is_no_command(size: int) -> None:
    """In the middle of a command, with line ends inside, in pieces, and without an end."""
    windows = b"\xff\xfa\x1f\x00\x0d\x00\x0a\xff\xf0"
    unended = b"step\xff\xfa\x18u 1 c\r\n" + b"\xff\xfa" + b"x" * 600 + b"\nver\n"
    stream = b"\xff\xfd\x03step" + windows + b"u 1 \xff\xf1c\r\n" + unended
    lines = TelnetLines()
    found = [one for k in range(0, len(stream), size) for one in lines.take(stream[k : k + size])]
    assert found[:2] == [b"stepu 1 c", b"step?"]
    assert (found[2] or b"").endswith(b"xx")
    assert found[3:] == [b"ver"]


def test_three_wrong_passwords_end_it(emulate: Callable[..., Any]) -> None:
    with emulate("anc300").client() as client:
        client.send(b"a\nb\nc\nver\n")
        assert client.until(b"never").count(b"Authorization failed") == 3


def test_what_cannot_be_is_answered_with_error(emulate: Callable[..., Any]) -> None:
    with logged_in(emulate("anc300", {"frequency": 1000.0, "slewrate": 1.0})) as client:
        for line, complaint in [
            ("fly 1", "Unknown command"),
            ("getm", "Axis number missing"),
            ("getm 2", "Wrong axis type"),  # an empty slot
            ("stepu 7 c", "Wrong axis type"),
            ("getm 8", "Wrong axis number"),
            ("getm 0", "Wrong axis number"),
            ("getfil 1", "Wrong axis type"),
            ("getm ²", "Wrong axis number"),
            ("getm 1 2", "Wrong number of arguments"),
            ("setv 1", "Wrong number of arguments"),
            ("setv 1 much", "Number expected"),
            ("setv 1 nan", "Number expected"),
            ("setv 1 151", "Value out of range"),
            ("setv 1 -1", "Value out of range"),
            ("setf 1 0.5", "Value out of range"),
            ("setf 1 10001", "Value out of range"),
            ("setf 1 10000", "Value out of range: "),  # the slip of this drive takes too long
            ("setm 1 fly", "Wrong mode"),
            ("seta 1 30\r\nsetm 1 stp-", "OK\r\nValue out of range: scan level: -30 V"),
            ("stepu 1 5", "Axis in wrong mode"),
            ("stepu 1 1.5", "Whole number expected"),
            ("stepu 1 1e99", "Value out of range"),
            ("seta 1 200", "Value out of range"),
            ("settu 1 9", "Value out of range"),
            ("setpu 1 " + "0 " * 256, "Only the linear pattern"),
            ("x" * 5000, "Line too long"),
            ("\x00\x01\xff", "Unknown command"),
        ]:
            client.send(line.encode() + b"\r\n")
            answer = client.until(b"ERROR\r\n").decode()
            assert answer.startswith(complaint), line
            assert "Traceback" not in answer
            client.send(b"getm 1\r\n")
            assert client.until(b"OK\r\n") == b"mode = gnd\r\nOK\r\n", line


def test_settings_are_those_of_the_device_for_all_clients(emulate: Callable[..., Any]) -> None:
    emulated = emulate("anc300")
    with logged_in(emulated) as one, logged_in(emulated) as other:
        assert one.ask("setv 1 42.5", b"OK\r\n") == ""
        assert other.ask("getv 1", b"OK\r\n") == "voltage = 42.500000 V\r\n"
        for line in ("setm 1 stp", "setv 1 0", "stepu 1 5", "stepw 1"):
            assert one.ask(line, b"OK\r\n") == "", line
        assert other.ask("getv 1", b"OK\r\n") == "voltage = 0.000000 V\r\n"
        assert emulated.look(lambda: emulated.axes[0].status.step_count) == 0
        one.ask("setv 1 100", b"OK\r\n")
        one.ask("stepu 1 c", b"OK\r\n")
        one.send(b"stepw 1\r\n")  # waits as long as it jogs
        other.ask("setm 1 gnd", b"OK\r\n")
        assert one.until(b"OK\r\n") == b"OK\r\n"
        assert not emulated.look(lambda: emulated.axes[0].moving)


def test_the_offset_is_a_level_of_the_actuator(emulate: Callable[..., Any]) -> None:
    emulated = emulate("anc300", {"scan_rate": 10000.0})
    axis = emulated.axes[0]
    with logged_in(emulated) as client:
        client.ask("seta 1 30", b"OK\r\n")
        assert emulated.look(lambda: axis.status.scan_level) == 0.0
        client.ask("setm 1 off", b"OK\r\n")
        client.ask("stepw 1", b"OK\r\n")
        assert client.ask("geto 1", b"OK\r\n") == "voltage = 30.000000 V\r\n"
        client.ask("setm 1 gnd", b"OK\r\n")
        client.ask("stepw 1", b"OK\r\n")
        assert emulated.look(lambda: axis.status.scan_level) == 0.0


def test_the_offset_is_added_or_taken_away_between_steps(emulate: Callable[..., Any]) -> None:
    emulated = emulate("anc300", {"frequency": 1000.0, "min_voltage": -60.0})
    axis = emulated.axes[0]
    with logged_in(emulated) as client:
        client.ask("setm 1 ext", b"OK\r\n")
        client.ask("seta 1 30", b"OK\r\n")
        for mode, level in (("stp+", 30.0), ("stp-", -30.0)):
            client.ask(f"setm 1 {mode}", b"OK\r\n")
            assert mode in client.ask("getm 1", b"OK\r\n")
            steps = emulated.look(lambda: axis.status.step_count)
            client.ask("stepu 1 5", b"OK\r\n")
            client.ask("stepw 1", b"OK\r\n")
            assert emulated.look(lambda: axis.status.step_count) == steps + 5
            wait_until(partial(emulated.look, lambda: axis.status.scan_level))
            client.ask("stepw 1", b"OK\r\n")
            assert emulated.look(lambda: axis.status.scan_level) == pytest.approx(level)


def test_a_fault_is_left_by_choosing_a_mode(emulate: Callable[..., Any]) -> None:
    emulated = emulate("anc300", {"max_velocity": 1e-7, "frequency": 1000.0})
    axis = emulated.axes[0]
    with logged_in(emulated) as client:
        client.ask("setm 1 stp", b"OK\r\n")
        client.ask("stepu 1 c", b"OK\r\n")
        deadline = time.monotonic() + 20.0
        while emulated.look(lambda: axis.mode) != "fault" and time.monotonic() < deadline:
            time.sleep(0.01)
        assert "fault" in client.ask("stepu 1 1", b"ERROR\r\n")
        client.ask("setm 1 gnd", b"OK\r\n")
        assert emulated.look(lambda: axis.mode) == "stopped"
