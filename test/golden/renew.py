# SPDX-License-Identifier: Apache-2.0
"""Write the golden files anew: recordings of real nodes, and results of the commands.

    python test/golden/renew.py            results.json only
    python test/golden/renew.py --bags     the recordings, too

Renew only what a change means to change, and say in its commit what moved and by how much.
"""

import argparse
import contextlib
import io
import json
import math
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

# As the tests have it: threads of linear algebra would add up in another order.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from stickslip_ros.axis.sensor import Sensor
from stickslip_ros.cli.main import main
from stickslip_ros.physics.model.arithmetic import arithmetic
from stickslip_ros.physics.model.low_pass import LowPass
from stickslip_ros.physics.parameters import Parameters

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
RESULTS = HERE / "results.json"
BAGS = HERE / "bags"
#: Every parameter of the results, which follow no default
POINT = HERE / "point.yaml"
PRESET = ROOT / "config" / "edeler_2011_everything.yaml"
STEPS = "examples/samples/steps_100hz.csv"
BOTH_WAYS = "examples/samples/there_and_back.csv"

#: Axes that are recorded: name, file of parameters, values set over it
AXES: dict[str, tuple[Path, dict[str, Any]]] = {
    "plain": (ROOT / "config" / "table1_typical.yaml", {"travel_high": 3e-6}),
    "contacts": (
        ROOT / "config" / "table1_typical.yaml",
        {"contacts": 3, "contact_spread": 0.1, "spring": 1e5},
    ),
    # At a pace and with a sensor that a busy machine keeps up with
    "everything": (
        PRESET,
        {
            "real_time_factor": 0.1,
            "contacts": 2,
            "contact_shares": "equal",
            "sensor_rate": 1e3,
            "sensor_bandwidth": 0.0,
        },
    ),
}

_TABLE_1 = "preload=0.4 mass=4e-3 amplitude=300 slewrate=100"
_VIBRATION = "model=epm_fix mass=3e-3 sigma_0=1e6 sigma_1=5 v_stribeck=1e-3 preload=1"
#: Runs of ``simulate``: name, options
SIMULATED = {
    "table 1": f"--steps 12 --set {_TABLE_1}",
    "backward": f"--steps -12 --set {_TABLE_1}",
    "fast": f"--steps 200 --frequency 18500 --set {_TABLE_1}",
    "1 kHz, 1 N": "--steps 50 --frequency 1000 --set preload=1 mass=3e-3",
    "high preload": "--steps 12 --set preload=5",
    "low amplitude": "--steps 12 --amplitude 60 --set preload=1",
    "lugre": "--steps 12 --set model=lugre preload=1",
    "epm_calc": "--steps 12 --set model=epm_calc preload=1",
    "epm_calc printed": "--steps 12 --set model=epm_calc preload=1.5 alpha_form=printed",
    "epm_fix": f"--steps 12 --set {_VIBRATION}",
    "ceim_without_mu": "--steps 12 --set model=ceim_without_mu",
    "spring and slope": "--steps 12 --set spring=1e6 inclination=0.1",
    "force": "--steps 12 --set force=0.05",
    "payload": "--steps 12 --frequency 10e3 --set payload=0.01",
    "triangle": "--steps 12 --set waveform=triangle",
    "elongated": "--steps 12 --frequency 10e3 --set waveform=hold hold_before=0.35",
    "shaped": "--steps 12 --set waveform=shaped split=0.855 latency=6e-5",
    "weak damping": "--steps 12 --set sigma_1=0.1",
    "strong damping": "--steps 12 --set sigma_1=2000",
}
#: The same with effects: a mend of an effect may change them, and raises the model version
WITH_EFFECTS = {
    "hysteresis": "--steps 12 --set actuator=hysteresis",
    "memory": "--steps 12 --set actuator=hysteresis actuator_memory=true",
    "lag": "--steps 12 --set amplifier_bandwidth=1e6",
    "resonance": "--steps 12 --set actuator_resonance=8.2e5 actuator_damping=0.3",
    "creep": "--steps 12 --set creep=0.015",
    "dwell and rate": "--steps 12 --set dwell_growth=0.03 rate_growth=0.05",
    "surface": "--steps 12 --set surface_spread=0.1 slip_spread=0.02",
    "three contacts": "--steps 12 --set contacts=3 contact_spread=0.1",
    "six contacts of a guide": "--steps 6 --set contacts=6 contact_shares=guide",
    "everything": f"--steps 12 --config {PRESET.relative_to(ROOT)}",
}
#: Sensors whose readings of a made-up motion are kept: name, parameters
SENSORS: dict[str, dict[str, Any]] = {
    "noise and drift": {"sensor_noise": 1e-9, "sensor_noise_corner": 10.0, "sensor_drift": 1e-9},
    "first order": {"sensor_bandwidth": 5e3},
    "second order": {"sensor_bandwidth": 5e3, "sensor_order": 2, "sensor_damping": 0.3},
    "overdamped": {"sensor_bandwidth": 5.0, "sensor_order": 2, "sensor_damping": 2.0},
}
#: What reads measurements and searches: name, arguments, the part of its JSON that is kept
STUDIED = {
    "analyse steps": (f"analyse {STEPS}", ("step_size", "backstep", "ringing_frequency", "steps")),
    "analyse steps, told": (
        f"analyse {STEPS} --frequency 100",
        ("step_size", "backstep", "ringing_frequency", "steps"),
    ),
    "analyse both ways": (f"analyse {BOTH_WAYS}", ("runs",)),
    "compare steps": (
        f"compare config/table1_typical.yaml {STEPS}",
        ("rmse", "noise", "offset", "metrics"),
    ),
    "identify steps": (f"identify --run config/table1_typical.yaml {STEPS}", ("parameters",)),
    "predict": (f"predict --config {POINT.relative_to(ROOT)}", ()),
}


def command_line(text: str) -> list[str]:
    """Return the arguments of a text in which --set takes several assignments."""
    words, options = text.partition("--set ")[0].split(), text.partition("--set ")[2].split()
    return [*words, *(part for option in options for part in ("--set", option))]


def output_of(arguments: list[str]) -> Any:
    """Return the JSON that a command prints."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.chdir(ROOT):
        code = main([*arguments, "--json"])
    assert code in (0, 1), (arguments, code)
    return json.loads(said.getvalue())


def simulated(options: str) -> dict[str, Any]:
    """Return positions after each cycle and backstep, as texts that hold every bit."""
    given = command_line(options)
    point = [] if "--config" in given else ["--config", str(POINT)]
    found = output_of(["simulate", *point, *given])
    return {
        "position": [float(x).hex() for x in found["position"]],
        "backstep": float(found["backstep"] or math.nan).hex(),
    }


def sensed(values: dict[str, Any]) -> list[str]:
    """Return readings of a motion that is made of whole numbers, as texts that hold every bit."""
    p = Parameters.of({"sensor_resolution": 0.0, **values}).sensor
    k = np.arange(2000)
    x = np.cumsum((k * 7919) % 101 - 50).astype(float) * 1e-11
    v = ((k * 104729) % 97 - 48).astype(float) * 1e-6
    y = LowPass(p, 4e-6, 0.0).filter(x, v) if p.sensor_bandwidth else x
    sensor = Sensor(p)
    return [sensor.reading(float(y[at]), at).hex() for at in range(0, len(k), 100)]


def results() -> dict[str, Any]:
    """Return what repeats to the last bit where the arithmetic is the same, and its digest."""
    return {
        "arithmetic": arithmetic(),
        "plain": {name: simulated(options) for name, options in SIMULATED.items()},
        "effects": {name: simulated(options) for name, options in WITH_EFFECTS.items()},
        "sensors": {name: sensed(values) for name, values in SENSORS.items()},
    }


def studied(name: str) -> Any:
    """Return what a study finds."""
    command, kept = STUDIED[name]
    found = output_of(command.split())
    for metric in found.get("metrics", {}).values():  # of each the values and the verdict
        del metric["difference"], metric["tolerance"]
    return {key: found[key] for key in kept} if kept else found


def record(name: str, folder: Path) -> None:
    """Record an axis node with the recorder node while it is driven over topics."""
    from std_srvs.srv import Trigger

    from stickslip_ros.base.child_process import child_node, choose_domain
    from stickslip_ros.client import AxisClient

    choose_domain()
    file, values = AXES[name]
    given = [part for key, value in values.items() for part in ("-p", f"{key}:={value}")]
    bag = folder / name
    output = ("-p", f"output:={bag}", "-p", "compression:=zstd")
    rate = ("-p", "publish_rate:=50.0")
    with (
        child_node("recorder_node", folder, *output) as recorder,
        child_node("axis_node", folder, "--params-file", str(file), *given, *rate) as axis,
    ):
        recorder.wait_for("recording")
        axis.wait_for("ready")
        recorder.wait_for("first message of /joint_states")
        with AxisClient("/stickslip_axis", timeout=120.0, listeners=2) as client:
            _drive(client)
            stop = client.node.create_client(Trigger, "/stickslip_recorder/stop")
            assert stop.wait_for_service(60.0)
            answer: Any = stop.call(Trigger.Request(), 60.0)
            assert answer.success, answer
        recorder.ended()


def _drive(client: Any) -> None:
    """Let an axis do a little of all that it can."""
    client.send("steps", 12).wait()
    client.send("amplitude", 200.0).send("frequency", 1000.0).send("steps", -40).wait()
    client.set_parameters(preload=1.0)
    client.send("jog", 2000.0)
    client.send("jog", 0.0).wait()
    client.send("scan", 100.0).wait()
    client.send("load", 0.01)
    client.send("position", 1.2e-6).wait()
    client.send("trajectory", [(0.05, 1.0e-6), (0.1, 1.4e-6)]).wait()
    client.send("load", 0.0).set_parameters(preload=0.4).send("frequency", 10e3).send(
        "steps", 60
    ).wait()
    client.send("frequency", 50.0).send("steps", -6).wait()
    client.send("stop")


def main_of_this(arguments: list[str] | None = None) -> None:
    """Renew the files."""
    parser = argparse.ArgumentParser(description="Write the golden files anew.")
    parser.add_argument("--bags", nargs="*", metavar="AXIS", help="record these or all axes anew")
    axes = parser.parse_args(arguments).bags
    if axes is not None:
        with tempfile.TemporaryDirectory() as place:
            for name in axes or AXES:
                record(name, Path(place))
                shutil.rmtree(BAGS / name, ignore_errors=True)
                shutil.copytree(Path(place) / name, BAGS / name)
                print(f"recorded {name}", flush=True)
    found = {**results(), "studies": {name: studied(name) for name in STUDIED}}
    RESULTS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main_of_this()
