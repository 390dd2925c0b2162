# SPDX-License-Identifier: Apache-2.0
"""Parameters from tables of metrics: numbers of a Runge-Kutta integrator that is not ours."""

import json
from pathlib import Path

import pytest
from bench_traces import Axis, Drive, Sensor, bench_trace
from experiments import holds

from stickslip_ros.cli.main import main
from stickslip_ros.measurement.identification import IdentificationError, identify, read_curve
from stickslip_ros.measurement.reading import MeasurementError
from stickslip_ros.physics.parameters import Parameters, read_yaml, yaml_text
from stickslip_ros.simulation.motion import Motion

CONFIG = Path(__file__).resolve().parents[3] / "config"


#: Step (nm) over preload (N): CEIM, 4 g, 300 V, 100 V/us, 100 Hz, steps 8 to 12 from rest, by an
#: independent Runge-Kutta integrator (0.1 us in stick, 1 ns in slip).
STEPS = """preload (N),step size (nm),step_size_sd (nm)
0.1,144.70,0.1
0.25,139.14,0.1
0.4,133.83,0.1
1,113.20,0.1
2,78.91,0.1
3,45.95,0.1
4,19.29,0.1
5,4.92,0.1
6,0.63,0.1
"""
TRUTH = {"z_ba_slope": 2e-8, "z_ba_offset": 1e-8, "sigma_0ss": 1e7}


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "steps_over_preload.csv"
    path.write_text(STEPS, encoding="utf-8")
    return path


def test_columns_are_read_in_their_units(table: Path) -> None:
    curve = read_curve(table)
    assert list(curve.varied) == ["preload"]
    assert curve.metrics["step_size"][0] == pytest.approx(144.7e-9)
    assert curve.deviations["step_size"] == pytest.approx(1e-10)


@pytest.mark.long
def test_a_curve_gives_breakaway_distance_and_friction(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known = tmp_path / "drive.yaml"
    start = {"z_ba_slope": 3.3e-8, "z_ba_offset": 5e-9, "sigma_0ss": 2e7}
    known.write_text(yaml_text(Parameters.of(start)), encoding="utf-8")
    arguments = ["identify", "--curve", str(known), str(table), "--fit", ",".join(TRUTH), "--json"]
    assert main(arguments) == 0
    told = json.loads(capsys.readouterr().out)
    for name, true in TRUTH.items():
        one = told["parameters"][name]
        assert one["value"] == pytest.approx(true, rel=0.1), name
        assert holds(one["low"], true, one["high"]), name
    assert told["curves"][0]["points"] == 9
    assert told["noise"] is None


def test_the_numbers_of_the_paper_give_the_mass_and_leave_a_ridge() -> None:
    """Table 1 with Fig. 14: 4 kHz need 14.3 g (Eq. 11); damping and friction stay open."""
    curve = read_curve(CONFIG / "paper_numbers.csv")
    known = read_yaml(CONFIG / "table1_typical.yaml").replace(sigma_1=20.0)
    names, bounds = ["mass", "sigma_1", "sigma_0ss"], {"sigma_1": (10.0, 50.0)}
    found = identify([], names, curves=[(known, curve)], bounds=bounds)
    assert found.parameters["mass"].value == pytest.approx(14.3e-3, rel=0.05)
    assert not found.parameters["sigma_1"].determined
    joint = read_yaml(CONFIG / "paper_joint_set.yaml").flat()
    for name, one in found.parameters.items():
        assert holds(one.low, float(joint[name]), one.high), name


@pytest.mark.long
def test_a_curve_and_a_trace_together_tell_more_than_each(table: Path) -> None:
    """The trace is of the same axis at 1 N."""
    axis = Axis(preload=1.0)
    drive, sensor = Drive(8, frequency=800.0, pause=4e-3), Sensor(rate=5e5, noise=2e-9)
    bench = bench_trace(axis, (drive,), sensor, 4e-3, 4)
    known = {"preload": 1.0, "frequency": 800.0, "z_ba_slope": 3e-8, "sigma_0ss": 2e7}
    trace = Parameters.of(known), Motion("trace", bench.t, bench.x)
    curve = Parameters.of({"z_ba_slope": 3e-8, "sigma_0ss": 2e7}), read_curve(table)
    names = ["z_ba_slope", "sigma_0ss"]
    both = identify([trace], names, curves=[curve])
    alone = identify([trace], names)
    for name in names:
        one, other = both.parameters[name], alone.parameters[name]
        assert one.determined and one.low is not None and one.high is not None
        assert one.value == pytest.approx(TRUTH[name], rel=0.05)
        assert other.low is not None and other.high is not None
        assert one.high / one.low < other.high / other.low
    assert len(both.runs) == len(both.curves) == 1


def test_a_wrong_table_is_refused(tmp_path: Path) -> None:
    for text, words in [
        ("preload (N),speed (nm)\n1,2\n2,3\n", "neither a parameter nor a metric"),
        ("preload (N),mass (kg)\n1,2\n2,3\n", "one of a metric"),
        ("preload (N),step_size (V)\n1,2\n2,3\n", "has to be in m"),
        ("preload (N),step_size,step_size_sd\n1,2,0\n2,3,1\n", "have to be above 0"),
    ]:
        path = tmp_path / "bad.csv"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(MeasurementError, match=words):
            read_curve(path)


def test_too_few_numbers_and_a_varied_parameter_are_refused(table: Path, tmp_path: Path) -> None:
    curve = read_curve(table)
    with pytest.raises(IdentificationError, match="varies preload, so it cannot be free"):
        identify([], ["preload", "sigma_0ss"], curves=[(Parameters(), curve)])
    short = tmp_path / "short.csv"
    short.write_text("\n".join(STEPS.splitlines()[:3]) + "\n", encoding="utf-8")
    with pytest.raises(IdentificationError, match="2 values are too few to determine 3 parameters"):
        identify([], list(TRUTH), curves=[(Parameters(), read_curve(short))])
