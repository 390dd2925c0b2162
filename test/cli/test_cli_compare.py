# SPDX-License-Identifier: Apache-2.0
"""``stickslip compare`` as a user meets it: inputs, outputs, exit codes, the page in a browser."""

import csv
import json
import random
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bags import EVENTS, JOINTS, event, foreign, header, serialized
from scipy.signal import cont2discrete, lfilter
from table_1 import table_1

from stickslip_ros.axis import Axis
from stickslip_ros.cli.main import main
from stickslip_ros.emulator import Recorder
from stickslip_ros.measurement.bags.load_motion import load_motion
from stickslip_ros.recordings import BagWriter, open_bag
from stickslip_ros.simulation.motion import Motion
from stickslip_ros.simulation.sampling import trace_steps
from stickslip_ros.simulation.trace import save_csv
from stickslip_ros.version import __version__

CONFIG = Path(__file__).resolve().parent.parent.parent / "config" / "table1_typical.yaml"
STEPS = 10
#: Whom Chromium asks by itself: for the time, for updates and for accounts. No page of ours would.
OF_THE_BROWSER = (".google.com", ".googleapis.com")
BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a trace of ours and a measurement of an axis with more damping."""
    path = tmp_path_factory.mktemp("compare")
    save_csv(trace_steps(table_1(), STEPS), path / "run.csv")
    axis = Motion.of_trace(trace_steps(table_1(sigma_1=10.0), STEPS), "axis")
    t = np.arange(0.0, axis.t[-1], 1e-5)
    x = axis.position_at(t) + np.random.default_rng(5).normal(0.0, 1e-9, len(t))
    np.savetxt(
        path / "axis.csv",
        np.column_stack([1e3 * (t + 37e-6), 1e9 * x]),
        fmt="%.6f",
        delimiter=";",
        header="time [ms];x (nm)",
    )
    return path


@pytest.mark.long
def test_the_model_is_compared_with_a_measurement(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As many steps are simulated as are measured; the trace of the same run says the same."""
    results = []
    for run, limit in ((CONFIG, "5e-9"), (folder / "run.csv", "1e-6")):
        limits = ["--max-rmse", limit, "--max-step-rmse", "1e-9"]
        assert main(["compare", str(run), str(folder / "axis.csv"), "--json", *limits]) == 0
        results.append(json.loads(capsys.readouterr().out, parse_constant=pytest.fail))
    simulated, traced = results
    assert simulated["offset"] == pytest.approx(37e-6, abs=1e-6)
    assert "damping ratio" in simulated["differing"]
    assert simulated["parameters"]["preload"] == 0.4
    assert simulated["version"] == __version__
    assert (traced["parameters"], traced["version"]) == (None, None)
    assert traced["rmse"] == pytest.approx(simulated["rmse"], rel=1e-6)
    assert STEPS - 1 <= simulated["steps"] <= STEPS  # the record ends at the last slip


def test_the_file_of_the_drive_is_named_as_everywhere(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By --config; by position still works."""
    for more in ([], ["--set", "frequency=200"]):  # the drive that is searched for is that, too
        results = []
        for words in ([str(CONFIG), str(folder / "axis.csv")],
                      ["--config", str(CONFIG), str(folder / "axis.csv")]):  # fmt: skip
            code = main(["compare", *words, *more, "--json"])
            results.append((code, *capsys.readouterr()))
        assert results[0] == results[1]
        assert more or results[0][0] == 0
    for words, complaint in (
        (["--config", str(CONFIG), "a.csv", "b.csv"], "is the run already: leave out a.csv"),
        (["a.csv"], "a.csv with what? give RUN and MEASUREMENT, or --config"),
    ):
        assert main(["compare", *words]) == 2
        assert complaint in capsys.readouterr().err


def test_the_metrics_go_into_a_table(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["compare", str(folder / "run.csv"), str(folder / "axis.csv"), "--json", "--table"]
    assert main([*arguments, str(folder / "metrics.csv")]) == 0
    found = json.loads(capsys.readouterr().out)["metrics"]
    with (folder / "metrics.csv").open(newline="", encoding="utf-8") as stream:
        rows = {row["metric"]: row for row in csv.DictReader(stream)}
    assert set(rows) == set(found)
    for name, metric in found.items():
        for key in ("run", "measured", "tolerance"):
            assert rows[name][key] == ("" if metric[key] is None else repr(metric[key]))
    assert rows["damping ratio"]["verdict"] == "differs"
    assert main([*arguments, str(folder / "metrics.doc")]) == 2
    assert "end it in .csv or .tex" in capsys.readouterr().err


def test_limits_decide_the_exit_code(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["compare", str(folder / "run.csv"), str(folder / "axis.csv")]
    limits = ["--max-rmse", "1e-10", "--max-step-rmse", "1e-9", "--max-step-error", "1e-6"]
    assert main([*arguments, *limits]) == 1
    output = capsys.readouterr()
    assert "EXCEEDED: root mean square difference" in output.out
    assert "kept: " in output.out
    doubt, exceeded, unknown = output.err.splitlines()
    assert doubt.endswith("no rest beside the run, so step and drift cannot be told apart")
    assert exceeded.startswith("stickslip compare: root mean square difference is ")
    assert "step size cannot be determined (run at" in unknown
    assert "no rest beside the run" in unknown


def write_bag(
    path: Path, names: list[str], samples: Motion, start_ns: int, *events: dict[str, str]
) -> None:
    """A recording of joint states and of what axes start with, without anything of rosbag2."""
    written = []
    for one in events:
        texts = {"time (s)": "0.0", "event": "start", "outcome": "applied", **one}
        topic = replace(EVENTS, name=f"/{one['axis_name']}/events")
        written.append((topic, start_ns, event(start_ns, **texts)))
    none = np.zeros(0)
    for t, x in zip(samples.t, samples.x, strict=True):
        ns = start_ns + round(1e9 * t)
        values = {"position": np.append(x, np.zeros(len(names) - 1)), "velocity": none}
        state = serialized(JOINTS.type, header=header(ns), name=names, effort=none, **values)
        written.append((JOINTS, ns, state))
    foreign(path, written)


def test_bags_are_runs_and_measurements(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Stamps of both count from the first of the run, so the offset between the clocks is told."""
    axis = Motion.of_trace(trace_steps(table_1(), STEPS), "axis")
    t = np.arange(0.0, axis.t[-1], 5e-5)
    samples = Motion("axis", t, axis.position_at(t))
    first, second = tmp_path / "run.mcap", tmp_path / "measured.mcap"
    start = 1_700_000_000_000_000_000
    other = {"axis_name": "other", "preload": "0.1", "version": "0.0.1"}
    ours = {"axis_name": "axis", "preload": "0.30000000000000004", "version": "0.0.2"}
    write_bag(first, ["axis_slider", "axis_piezo"], samples, start, other, ours)
    write_bag(second, ["axis_slider", "axis_piezo"], samples, start + 37_000)
    page = tmp_path / "page.html"
    assert main(["compare", str(first), str(second), "--json", "--report", str(page)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["offset"] == pytest.approx(37e-6, abs=1e-7)
    assert found["rmse"] < 1e-11
    assert found["parameters"] == {"axis_name": "axis", "preload": 0.1 + 0.2}
    assert found["version"] == "0.0.2"
    assert re.search(r"<dt>preload</dt><dd>0.3 N</dd>.*0\.0\.2", page.read_text(), re.DOTALL)
    assert main(["compare", str(first), str(second), "--joint", "knee"]) == 2
    assert "there are: axis_piezo, axis_slider" in capsys.readouterr().err


def test_a_topic_that_nothing_came_on_is_passed_over(tmp_path: Path) -> None:
    """A recorder keeps it, without a definition: there is no message to take it from."""
    samples = Motion("axis", np.linspace(0.0, 1.0, 20), np.linspace(0.0, 1e-6, 20))
    write_bag(tmp_path / "part.mcap", ["axis_slider"], samples, 10**18)
    with open_bag(tmp_path / "part.mcap") as part, BagWriter(tmp_path / "whole") as whole:
        whole.add_topic(part.topics["/joint_states"])
        whole.add_topic(replace(JOINTS, name="/silent"))
        for message in part.messages():
            _, log_ns, publish_ns, _, data = message
            whole.write("/joint_states", data, log_ns=log_ns, publish_ns=publish_ns)
    found = load_motion(tmp_path / "whole")
    assert found.motion.x == pytest.approx(samples.x, abs=0.0)


def test_page_and_picture_are_whole(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, png = tmp_path / "a.html", tmp_path / "a.png"
    arguments = ["compare", str(CONFIG), str(folder / "axis.csv"), "--max-rmse", "5e-9"]
    assert main([*arguments, "--report", str(page), "--plot", str(png)]) == 0
    text = page.read_text(encoding="utf-8")
    assert page.stat().st_size < 5_000_000
    assert not re.findall(r"@[A-Z]+@", text)
    for what in ("damping ratio", "sigma_0_slope", "all 1 limits kept", "NumPy", "axis.csv"):
        assert what in text
    assert not re.findall(r"(?:src|href)=\"(?!data:)", text)
    # Tables are as wide as they need to be inside a box that scrolls, so the page fits any window.
    assert ".scroll { overflow-x: auto; }" in text
    tables = re.findall(r"(<div class=\"scroll\" tabindex=\"0\">)?<table", text)
    assert len(tables) >= 2
    assert all(tables)
    data = json.loads(text.split('id="data">')[1].split("</script>")[0])
    assert set(data) == {"overview", "step", "slip"}
    assert png.read_bytes().startswith(b"\x89PNG")
    assert sorted(tmp_path.iterdir()) == [page, png]


@pytest.mark.long
@pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome is installed")
@pytest.mark.parametrize("width", [1280, 500])  # 500 is the narrowest window of headless Chromium
def test_the_page_draws_in_a_browser_without_a_network(
    width: int, folder: Path, tmp_path: Path
) -> None:
    """Every plot is drawn, nothing is complained about, nothing is asked of anybody."""
    page, log = tmp_path / "a.html", tmp_path / "net.json"
    run = str(folder / "run.csv")
    assert main(["compare", run, str(folder / "axis.csv"), "--report", str(page)]) == 0
    child = subprocess.run(
        [
            str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
            "--disable-background-networking", "--disable-component-update", "--disable-sync",
            "--disable-default-apps", "--disable-extensions", "--enable-logging=stderr",
            f"--user-data-dir={tmp_path / 'profile'}", f"--log-net-log={log}",
            "--host-resolver-rules=MAP * ~NOTFOUND", f"--window-size={width},900",
            "--virtual-time-budget=20000", "--dump-dom", page.as_uri(),
        ],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    assert 'data-drawn="yes"' in child.stdout
    assert child.stdout.count('class="main-svg"') >= 4
    assert "CONSOLE" not in child.stderr, child.stderr
    asked = re.findall(r'"url":"(?:https?|wss?)://([^/:"?]*)', log.read_text(errors="replace"))
    assert [host for host in asked if not host.endswith(OF_THE_BROWSER)] == []


@pytest.mark.long
def test_a_run_is_seen_through_the_bandwidth_of_its_sensor(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A measurement with 2 kHz, filtered by SciPy, differs from the model until it has 2 kHz."""
    trace = Motion.of_trace(trace_steps(table_1(), STEPS), "axis")
    t = np.arange(0.0, trace.t[-1], 2e-6)
    (b,), a, _ = cont2discrete(([1.0], [1.0 / (2.0 * np.pi * 2e3), 1.0]), 2e-6, "bilinear")
    x = lfilter(b, a, trace.position_at(t)) + np.random.default_rng(5).normal(0.0, 1e-9, len(t))
    np.savetxt(
        tmp_path / "slow.csv", np.column_stack([t, x])[::5], delimiter=",", header="t (s),x (m)"
    )
    rmse = []
    for more in ([], ["--set", "sensor_bandwidth=2000"]):
        assert main(["compare", str(CONFIG), str(tmp_path / "slow.csv"), "--json", *more]) == 0
        rmse.append(json.loads(capsys.readouterr().out)["rmse"])
    assert rmse[0] > 3e-9
    assert rmse[1] == pytest.approx(1e-9, rel=0.05)


@pytest.mark.long
def test_a_bag_of_many_moves_does_not_differ_from_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The runs of one side had been cut out of its cycles, those of the other were whole."""
    draw, due = random.Random(1), 0.05
    axis = Axis({"axis_name": "a"})
    with Recorder(tmp_path / "bag", "anc300", [axis], lambda: 1_700_000_000_000_000_000) as bag:
        for k in range(1, 201):
            axis.advance(0.01 * k)
            if 0.01 * k >= due:
                name = draw.choice(["frequency", "amplitude", "steps", "steps", "steps"])
                if name == "frequency":
                    axis.command(name, draw.uniform(50.0, 900.0))
                elif name == "amplitude":
                    axis.command(name, draw.uniform(60.0, 200.0))
                else:
                    axis.command(name, draw.choice([-1, 1]) * draw.randint(1, 60))
                due = 0.01 * k + draw.uniform(0.01, 0.25)
            bag.take()
    main(["compare", str(tmp_path / "bag"), str(tmp_path / "bag"), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert found["rmse"] < 1e-12
    assert found["differing"] == []
