# SPDX-License-Identifier: Apache-2.0
"""PI's E-871: PI's own driver, unmodified, and what the EPICS driver motorPIGCS2 sends."""

from collections.abc import Callable
from typing import Any

import pytest
from live import wait_until
from table_1 import table_1

from stickslip_ros.motion.steps import run_steps

PI = {"gain": 5e-9, "frequency": 1000.0, "sensor_noise": 0.0, "amplitude": 100.0}


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # it closes twice
def test_pipython_references_moves_steps_and_stops(emulate: Callable[..., Any]) -> None:
    pipython = pytest.importorskip("pipython")
    pitools = pytest.importorskip("pipython.pitools")
    interface = pytest.importorskip("pipython.pidevice.interfaces.pisocket")
    emulated = emulate("e871", PI)
    axis = emulated.axes[0]
    with pipython.GCSDevice(gateway=interface.PISocket("127.0.0.1", emulated.port)) as device:
        assert (device.devname, device.axes) == ("E-871.1A1", ["1"])
        with pytest.raises(pipython.GCSError, match="5"):
            device.MOV("1", 0.001)
        device.OVL("1", 2000)
        device.OSM("1", 20)
        pitools.waitonwalk(device, "1", polldelay=0.01)
        drive = table_1(**{**PI, "frequency": 2000.0})
        status = emulated.look(lambda: axis.status)
        assert status.mean_step * 20 == pytest.approx(run_steps(drive, 20).position[-1], abs=1e-11)
        pitools.startup(device, refmodes="FRF")
        assert device.qFRF()["1"]
        assert device.qPOS("1")["1"] == pytest.approx(0.0, abs=1e-4)
        device.MOV("1", 0.003)
        pitools.waitontarget(device, "1", polldelay=0.01)
        device.MVR("1", -0.001)
        pitools.waitontarget(device, polldelay=0.01)
        assert device.qPOS("1")["1"] == pytest.approx(0.002, abs=1e-4)
        with pytest.raises(pipython.GCSError, match="limits"):
            device.MOV("1", device.qTMX()["1"] + 1.0)
        device.StopAll(noraise=True)
        with pytest.raises(pipython.GCSError, match="10"):
            device.HLT()
        assert not device.IsMoving("1")["1"]
        assert device.qSPA(["1"], [0x14]) == {"1": {0x14: 1}}
        assert device.qSRG("1", 1)["1"][1] & 0x9000  # on target, with its servo
        assert (device.qCCL(), device.qTVI().strip()) == (0, "1")
        pitools.startup(device, refmodes="POS")
        assert device.qPOS("1")["1"] == pytest.approx(0.0, abs=1e-4)
        device.MOV("1", 0.001)
        pitools.waitontarget(device, "1", polldelay=0.01)
        device.DFH("1")
        assert device.qPOS("1")["1"] == pytest.approx(0.0, abs=1e-4)
        assert device.qDFH("1")["1"] == pytest.approx(0.001, abs=1e-4)
        device.RBT()
        assert (device.qSVO()["1"], device.qFRF()["1"], device.qCCL()) == (False, False, 0)


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
