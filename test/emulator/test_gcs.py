# SPDX-License-Identifier: Apache-2.0
"""PI's E-871: what the EPICS driver motorPIGCS2 sends; PI's own driver is that of journey 5."""

from collections.abc import Callable
from typing import Any

from live import wait_until

PI = {"gain": 5e-9, "frequency": 1000.0, "sensor_noise": 0.0, "amplitude": 100.0}


def test_the_dialogue_of_the_epics_driver(emulate: Callable[..., Any]) -> None:
    emulated = emulate("e871", PI)
    with emulated.client() as client:
        for line, answer in (
            ("CSV?", "2.0"),
            ("SAI?", "1"),
            ("LIM? 1", "1=0"),
            ("TRS? 1", "1=1"),
            ("CST? 1", "1=SIM-axis"),
            ("SPA? 1 14", "1 14=1000000"),
            ("SPA? 1 15", "1 15=1"),
            ("VEL? 1", "1=1.000000"),
            ("TMX? 1", "1=10.0000000"),
        ):
            assert client.ask(line) == answer
        client.send(b"SVO 1 1\nRON 1 0\nPOS 1 2.000000\nRON 1 1\n")
        assert client.ask("ERR?") == "0"
        assert client.ask("POS? 1") == "1=2.0000000"
        client.send(b"VEL 1 0.5\nMOV 1 9.000000\n\x07")
        assert client.until(b"\n") == b"\xb1\n"
        client.send(b"\x05\x04")  # without an end
        assert client.until(b"\n") == b"1\n"
        assert client.until(b"\n") == b"0x3000\n"
        client.send(b"\x18")
        assert (client.ask("ERR?"), client.ask("ERR?")) == ("10", "0")
        wait_until(lambda: emulated.look(lambda: emulated.axes[0].mode) == "stopped", "a stop")


def test_what_cannot_be_sets_the_error(emulate: Callable[..., Any]) -> None:
    with emulate("e871", PI).client() as client:
        for line, code in [
            ("FLY 1", 2),
            ("FLY?", 2),
            ("MOV", 24),
            ("MOV 1", 24),
            ("MOV 1 0.1 1", 24),
            ("MOV 2 0.1", 15),
            ("MOV 1 much", 1),
            ("MOV 1 nan", 1),
            ("MOV 1 0.1", 5),
            ("FNL 1", 32),
            ("SVO 1 2", 17),
            ("OSM 1 1.5", 17),
            ("OVL 1 1e9", 17),
            ("POS 1 0", 5),
            ("VEL 1 -1", 8),
            ("VEL 1 5.1", 8),
            ("ACC 1 1001", 17),
            ("SRG? 1 2", 17),
            ("SPA? 1 0x999", 54),
            ("SPA 1 0x14 0", 64),
            ("\x06", 2),
            ("x" * 5000, 3),
            ("\xff", 2),
        ]:
            client.send(line.encode() + b"\n")
            assert (client.ask("ERR?"), client.ask("ERR?")) == (str(code), "0"), line
            assert client.ask("POS?") == "1=0.0000000"


def test_help_names_every_command(emulate: Callable[..., Any]) -> None:
    with emulate("e871", PI).client() as client:
        lines = client.ask("HLP?", b"end of help\n").split(" \n")
    assert {"MOV", "OSM?", "ERR?", "#24", "SAI?"} <= set(lines)
