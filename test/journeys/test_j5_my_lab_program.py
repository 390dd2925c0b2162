# SPDX-License-Identifier: Apache-2.0
"""J5: programs of a lab with public drivers, unmodified, on controllers that are emulated.

What they did is recorded. Where the axes went is said by `rosbags` from the recording, and by a
general integrator of the whole system.
"""

import sys
from pathlib import Path
from typing import Any

import pytest
from child import stickslip
from live import Process, wait_until
from rosbags.highlevel import AnyReader

from stickslip_ros.physics.parameters import Parameters
from validation.whole_system import positions

pytestmark = pytest.mark.flaky(reruns=1)

#: The travel ends at 20 um.
DRIVE = {"gain": 5e-9, "frequency": 1000.0, "sensor_noise": 0.0, "soft_high": 20e-6}


class Controller:
    """`stickslip emulate` in a process of its own, with a recording."""

    def __init__(self, folder: Path, name: str, *words: str) -> None:
        self.folder = folder
        settings = [word for k, v in DRIVE.items() for word in ("--set", f"{k}={v}")]
        command = [sys.executable, "-m", "stickslip_ros", "emulate", name, "--port", "0"]
        command += ["--record", "bag", *settings, *words]
        self.process = Process(command, folder, folder / "emulate.log")
        self.process.wait_for(" port ")
        self.port = int(self.process.output.partition(" port ")[2].partition(",")[0])

    def __enter__(self) -> "Controller":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()

    def end(self, axes: int) -> None:
        """End it in order, and have its recording run again, bit for bit."""
        assert self.process.terminate() == 0
        again = stickslip("bag", "resimulate", "bag", cwd=self.folder)
        assert again.count("bit for bit") == axes

    def recorded(self, topic: str) -> list[Any]:
        """Return the messages of a topic in the recording."""
        with AnyReader([self.folder / "bag"]) as reader:
            found = [one for one in reader.connections if one.topic == topic]
            assert found, topic
            return [reader.deserialize(d, one.msgtype) for one, _, d in reader.messages(found)]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # it closes twice
def test_pipython_references_moves_stops_and_meets_a_limit(tmp_path: Path) -> None:
    """PI's own driver and its tools for programs, on one axis with a sensor."""
    pipython = pytest.importorskip("pipython")
    pitools = pytest.importorskip("pipython.pitools")
    interface = pytest.importorskip("pipython.pidevice.interfaces.pisocket")
    targets, read = (0.003, 0.002, 0.012), []  # mm
    with Controller(tmp_path, "e871", "--set", "amplitude=100") as controller:
        with pipython.GCSDevice(gateway=interface.PISocket("127.0.0.1", controller.port)) as device:
            assert (device.devname, device.axes) == ("E-871.1A1", ["1"])
            with pytest.raises(pipython.GCSError, match="5"):  # not without a reference
                device.MOV("1", targets[0])
            pitools.startup(device, refmodes="FRF")
            assert device.qFRF()["1"]
            for target in targets:
                device.MOV("1", target)
                pitools.waitontarget(device, "1", polldelay=0.01)
                read.append(device.qPOS("1")["1"])
            with pytest.raises(pipython.GCSError, match="limits"):
                device.MOV("1", 0.03)
            assert device.qMOV("1")["1"] == pytest.approx(targets[-1])
            device.SVO("1", False)
            device.OSM("1", -100_000)  # open loop, without end
            wait_until(lambda: device.qPOS("1")["1"] < 0.01, "it moves")
            device.StopAll(noraise=True)
            wait_until(lambda: not device.IsMoving("1")["1"], "it stops")
            with pytest.raises(pipython.GCSError, match="10"):  # stopped
                device.HLT()
            assert device.qSPA(["1"], [0x14]) == {"1": {0x14: 1}}
            assert (device.qCCL(), device.qTVI().strip()) == (0, "1")
            pitools.startup(device, refmodes="POS")
            device.MOV("1", 0.001)
            pitools.waitontarget(device, "1", polldelay=0.01)
            assert device.qSRG("1", 1)["1"][1] & 0x9000  # on target, with its servo
            device.DFH("1")
            assert device.qPOS("1")["1"] == pytest.approx(0.0, abs=1e-4)
            assert device.qDFH("1")["1"] == pytest.approx(0.001, abs=1e-4)
            device.RBT()
            assert (device.qSVO()["1"], device.qFRF()["1"]) == (False, False)
            with pytest.raises(pipython.GCSError, match="15"):  # there is no second axis
                device.send("MVR 2 0.001")
        controller.end(axes=1)
    assert read == pytest.approx(targets, abs=1e-4)
    truth = [1e3 * float(one.position[0]) for one in controller.recorded("/x/truth")]
    for target in targets:
        assert min(abs(x - target) for x in truth) < 1e-4


def test_pymeasure_steps_jogs_and_finds_a_slot_empty(tmp_path: Path) -> None:
    """Two axes without sensors; the third one is not there."""
    attocube = pytest.importorskip("pymeasure.instruments.attocube")
    pytest.importorskip("pyvisa_py")
    with Controller(tmp_path, "anc300", "--axes", "x,y") as controller:
        device = attocube.ANC300Controller(
            f"TCPIP::127.0.0.1::{controller.port}::SOCKET", axisnames=["x", "y", "z"],
            passwd="123456", visa_library="@py",
        )  # fmt: skip
        assert "attocube" in device.version
        with pytest.raises(ValueError, match="Axis in wrong mode"):
            device.x.move_raw(3)
        assert device.x.measure_capacity() == device.x.capacity > 0.0
        assert device.x.pattern_up == list(range(256))
        for axis in (device.x, device.y):
            axis.voltage, axis.frequency = 100, 1000
        device.y.move(-15, gnd=False)
        device.x.move(5, gnd=False)
        device.x.move_raw(float("inf"))
        device.ask("stepw 1")  # answered at the limit, although nobody stops it
        with pytest.raises(ValueError, match="Wrong axis type"):
            device.z.mode = "stp"
        device.adapter.close()
        controller.end(axes=2)
    x, y = (float(controller.recorded(f"/{axis}/truth")[-1].position[0]) for axis in "xy")
    assert x == pytest.approx(20e-6, abs=0.6e-6)  # and it has rung down
    made = positions(Parameters.of({**DRIVE, "amplitude": 100.0}), 15, rest=0.5)[-1]
    assert y == pytest.approx(-made, abs=0.15e-9)
