# SPDX-License-Identifier: Apache-2.0
"""SmarAct's SCU: PyMeasure's driver as it is, and what the EPICS driver sends and can parse."""

import re
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from live import wait_until

SCU = {"gain": 5e-9, "frequency": 1000.0, "sensor_noise": 0.0}
#: What sscanf takes apart: integers, numbers, and the letter of a status
PATTERNS = {
    "GCLF": r":[A-Z]{1,10}\d[A-Z]{1,10}-?\d+",
    "GST": r":[A-Z]{1,10}\d[A-Z]{1,10}-?\d+",
    "GPPK": r":[A-Z]{1,10}\d[A-Z]{1,10}-?\d+",
    "GP": r":[A-Z]{1,10}\d[A-Z]{1,10}-?\d+\.\d+",
    "M": r":[A-Z]{1,10}\d[SAMTHCR]",
}


def wait(client: Any, *letters: str) -> None:
    """Wait until the status of channel 0 is one of those."""
    for _ in range(2000):
        if client.ask(":M0")[-1] in letters:
            return
    pytest.fail(f"status is {client.ask(':M0')}, not {letters}")


def test_the_epics_driver_can_read_the_answers(emulate: Callable[..., Any]) -> None:
    with emulate("scu", SCU).client() as client:
        for command, pattern in PATTERNS.items():
            answer = client.ask(f":{command}0")
            assert re.fullmatch(pattern, answer), answer


def test_the_closed_loop_of_the_epics_driver(emulate: Callable[..., Any]) -> None:
    """A move and the question for the position stand in one line."""
    emulated = emulate("scu", {**SCU, "hold_time": 0.01})
    with emulated.client() as client:
        assert client.ask(":MPA0P3.000H60000:GP0").startswith(":P0P")
        wait(client, "H")
        assert float(client.ask(":GP0")[4:]) == pytest.approx(3.0, abs=0.01)
        assert client.ask(":MPR0P-1.000H0:GP0").startswith(":P0P")
        wait(client, "S")
        assert float(client.ask(":GP0")[4:]) == pytest.approx(2.0, abs=0.01)
        client.send(b":SZ0\n")
        assert abs(float(client.ask(":GP0")[4:])) < 0.01
        assert client.ask(":S0:GP0").startswith(":P0P")


def test_steps_the_reference_and_the_limit(emulate: Callable[..., Any]) -> None:
    emulated = emulate("scu", {**SCU, "soft_high": 20e-6})
    status = partial(emulated.look, lambda: emulated.axes[0].status)
    with emulated.client() as client:
        for command, count in (("U0F1000A1000S20", 20), ("D0F1000A1000S5", 15)):
            client.send(f":{command}\n".encode())
            wait(client, "S")
            assert status().step_count == count
        assert client.ask(":GPPK0") == ":PPK0P0"
        client.send(b":MTR0H0Z1\n")
        assert client.ask(":M0") == ":M0R"
        wait(client, "S")
        assert client.ask(":GPPK0") == ":PPK0P1"
        client.send(b":MPA0P30.000H60000\n")
        wait(client, "S")  # no hold at a limit
        assert float(client.ask(":GP0")[4:]) == pytest.approx(20.0, abs=0.1)
        begun = status().step_count
        client.send(b":MES0DD\n")
        wait_until(lambda: status().step_count < begun - 5, "steps without end")
        client.send(b":S0\n")
        wait(client, "S")


def test_what_cannot_be_is_answered(emulate: Callable[..., Any]) -> None:
    with emulate("scu", SCU).client() as client:
        for line, answer in [
            ("U0F1A400S1", ":E-1C1"),
            (":u0", ":E-1C1"),
            (":XYZ0", ":E0C2"),
            (":U0F1000", ":E0C5"),
            (":GP", ":E-1C5"),
            (":GP1", ":E1C7"),
            (":CB9600:GP0", ":P0P0.0000"),  # the rate of the line, which has no answer
            (":U0F18501A400S1", ":E0C7"),
            (":U0F1000A149S1", ":E0C7"),
            (":U0F1000A400S0", ":E0C7"),
            (":U0F1000A400S1Q1", ":E0C7"),
            (":U0FUA400S1", ":E0C7"),
            (":U0F1000F100A400S1", ":E0C7"),
            (":U0F1000A400S5.9", ":E0C7"),
            (":MTR0H0Z2", ":E0C7"),
            (":GA0", ":E0C143"),
            (":" + "9" * 5000, ":E-1C1"),
        ]:
            assert client.ask(line) == answer
            assert client.ask(":GP0") == ":P0P0.0000"


@pytest.mark.filterwarnings("ignore:read string doesn't end with termination")
def test_pymeasure_moves_and_reads(emulate: Callable[..., Any]) -> None:
    """Its driver came after release 0.16.0."""
    scu = pytest.importorskip("pymeasure.instruments.smaract.scu_ascii")
    pytest.importorskip("pyvisa_py")
    emulated = emulate("scu", {**SCU, "hold_time": 0.01}, SCU)
    address = f"TCPIP::127.0.0.1::{emulated.port}::SOCKET"
    device = scu.SmarActSCULinear(address, visa_library="@py")
    try:
        channel = device.channel0
        assert (device.serial_nb, device.model) == ("1", "SmarAct CU-2D")
        assert channel.check_sensor_present()
        assert channel.positioner_type == ":ST0T1"
        channel.frequency_max = 5000
        channel.safe_direction_up_enabled = True
        assert channel.frequency_max.magnitude == 5000
        assert channel.safe_direction_up_enabled is True
        channel.move_steps_up(30, 1000, 1000)
        channel.move_steps_down(10)
        assert channel.position.check("[length]")
        channel.set_zero_position()
        channel.move_abs("2 um")
        end = time.monotonic() + 30.0
        while abs(channel.position.magnitude - 2.0) > 0.01:
            assert time.monotonic() < end
        channel.move_up_to_end()
        channel.stop()
        device.reset()
        assert not channel.calibrate_sensor()
    finally:
        device.close()
