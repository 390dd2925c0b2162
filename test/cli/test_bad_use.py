# SPDX-License-Identifier: Apache-2.0
"""Bad use of every command: exit code 2, one line with value and cure, nothing else, no file."""

from pathlib import Path

import pytest

from stickslip_ros.base.reporting.terminal import SEARCH
from stickslip_ros.cli.main import main

FINE = {
    "analyse": "steps_100hz.csv",
    "compare": "table1_typical.yaml steps_100hz.csv",
    "identify": "--run table1_typical.yaml steps_100hz.csv",
}
#: Files that stand beside, each with its content
FILES = {
    "misspelt.yaml": "/**:\n  ros__parameters:\n    preloda: 1.0\n",
    "empty.csv": "# nothing\nvolts, metres\n",
    "three.csv": "1,2,3\n" * 9,
}
#: Command, arguments, and what the line has to say
ROWS = [
    ("simulate", "--steps 0", ["--steps is 0", "1 to 10000000"]),
    ("simulate", "--steps 1000000000000", ["--steps is 1000000000000", "1 to 10000000"]),
    ("simulate", "--amplitude nan", ["amplitude is nan", "finite"]),
    ("simulate", "--set max_voltage=300 --amplitude 301", ["amplitude is 301 V", "300 V"]),
    ("simulate", "--frequency 1e9", ["frequency is 1e+09 Hz", "between"]),
    (
        "simulate",
        "--amplitude 300 --frequency 5000 --set slewrate=1",
        ["200 us", "300 us", "3333.33 Hz", "slewrate"],
    ),
    ("simulate", "--set preload", ["NAME=VALUE"]),
    ("simulate", "--stepz 3", ["unrecognized arguments: --stepz 3; see stickslip simulate"]),
    ("simulate", "--preload 1", ["unrecognized", "set by --set preload=1;"]),
    ("simulate", "--set preloda=1", ["no parameter 'preloda'", "preload or preload_ratio?"]),
    # as a paper writes a minus sign
    ("simulate", "--set preload=\u22121", ["preload is -1 N; it has to lie between"]),
    ("simulate", "--config none.yaml", ["cannot read none.yaml", "No such file"]),
    ("simulate", "--config misspelt.yaml", ["misspelt.yaml", "'preloda'", "preload_ratio?"]),
    ("simulate", "--trace run.csv --steps 3000", ["3000 steps", "at most 2000"]),
    ("simulate", "--trace none/run.csv", ["cannot write none/run.csv", "No such file"]),
    ("simulate", "--trace .", ["cannot write ."]),
    ("simulate", "--trace run.xlsx", ["run.xlsx", "it writes text: end its name in .csv"]),
    ("simulate", "--plot run.gif", ["--plot is run.gif", "has to end with .svg, .pdf, .png"]),
    ("simulate", "--report none/run.html", ["cannot write none/run.html"]),
    ("simulate", "--table run.xls", ["--table run.xls: end it in .csv or .tex"]),
    ("simulate", "--sensor", ["--sensor", "give --trace"]),
    ("simulate", "--trace-rate 1MHz", ["--trace-rate is for a --trace"]),
    ("sweep", "--vary preloda=1:2:3", ["did you mean preload"]),
    ("sweep", "--vary preload=1:2:3 --metric x", ["known: step_size"]),
    ("sweep", "--vary preload=1:2:3 --steps 100001", ["at most 100000"]),
    ("sweep", "--vary preload=1:2:3 --jobs 0", ["1 or more"]),
    ("sweep", "--vary preload=1:2:3 --out three.csv", ["is not the table of a sweep: name"]),
    ("sweep", "--vary preload=1:2:3 --out a.png", ["FILE.csv", "--plot writes a picture"]),
    ("sweep", "--vary preload=1:2:3 --cluster tcp://nowhere", ["no cluster answers", "give local"]),
    (
        "sweep",
        "--vary preload=1:2:3 --out /proc/nowhere/a.csv",
        ["cannot write /proc/nowhere/a.csv"],
    ),
    ("sweep", "--vary preload=1:2:3 --table no/t.csv", ["cannot write no/t.csv"]),
    ("sweep", "--vary preload=1:2:3 --set amplitude=400 --out a.csv", ["no point of the sweep"]),
    (
        "sweep",
        "--vary frequency=4e5:1e6:3 --set max_frequency=1e7 --config table1_typical.yaml",
        ["the slip of 300 V"],
    ),
    ("shape", "--set preload=20", ["preload is 20 N and amplitude 300 V: the axis makes no steps"]),
    ("shape", "--out none/own.yaml", ["cannot write none/own.yaml: No such file"]),
    ("elongate", "--out .", ["cannot write ."]),
    ("identify-actuator", "none.csv --out own.yaml", ["cannot read none.csv: No such file"]),
    ("identify-actuator", "empty.csv --out own.yaml", ["empty.csv: no row of numbers"]),
    ("identify-actuator", "three.csv --out own.yaml", ["three.csv: which column is the voltage?"]),
    ("identify-actuator", "actuator_loop.csv --out none/own.yaml", ["cannot write none/own.yaml"]),
    ("identify-actuator", "actuator_loop.csv --out a --operators 0", ["--operators is 0"]),
    ("identify-actuator", "actuator_loop.csv --out a --set max_voltage=0", ["max_voltage is 0 V"]),
    ("identify", "steps_100hz.csv", ["--config FILE.yaml and its MEASUREMENT go together"]),
    ("identify", "--prior sigma_0=3", ["--prior is 'sigma_0=3'; write it as NAME=MEAN:SD"]),
    ("identify", "--prior sigma_0=9N/um:0N/um", ["deviation of 0; it has to be above 0"]),
    ("identify", "--bounds sigma_0=a:b", ["write it as NAME=LOW:HIGH"]),
    ("identify", "--fit nothing", ["there is no parameter 'nothing'"]),
    ("identify", "--run steps_100hz.csv table1_typical.yaml", ["is a parameter file; give it"]),
    ("identify", "--out no/such/folder/fitted.yaml", ["no/such/folder"]),
    ("identify", "--report no/such/folder/fit.html", ["no/such/folder"]),
    ("analyse", "none.csv", ["cannot read"]),
    ("analyse", "empty.csv", ["empty.csv"]),
    ("analyse", "--zero-amplitude nan", ["--zero-amplitude is nan m"]),
    ("analyse", "--frequency 1", ["correct the frequency"]),
    ("analyse", "--table t.doc", ["end it in .csv or .tex"]),
    ("analyse", "--plot bench.gif", ["has to end with .svg, .pdf, .png"]),
    ("compare", "none.csv steps_100hz.csv", ["cannot read none.csv"]),
    ("compare", "table1_typical.yaml none.csv", ["cannot read none.csv"]),
    (
        "compare",
        "steps_100hz.csv steps_100hz.csv --set preload=1",
        ["--set changes a simulated run only"],
    ),
    ("compare", "--columns q", ["'q' is not of the form t=...,x=..."]),
    ("compare", "--columns x=y", ["no column 'y'", "1 time (s), 2 position (nm)"]),
    ("compare", "--units x=yard", ["the unit 'yard' is not known"]),
    ("compare", "--max-rmse -1", ["--max-rmse is -1"]),
    ("compare", "--from 500", ["0 samples lie between --from and --to"]),
    ("compare", "--report none/a.html", ["cannot write none/a.html"]),
    ("compare", "--plot none/a.png", ["cannot write none/a.png"]),
    ("predict", "--frequency 20000", ["lower the frequency"]),
    ("bag info", "gone", ["there is no bag"]),
    ("bag recover", "gone", ["there is no bag"]),
    ("send", "steps", ["steps takes a whole number; given: none"]),
    ("send", "steps 1.5", ["steps takes a whole number; given: 1.5"]),
    ("send", "amplitude x", ["amplitude takes a number in V; given: x"]),
    ("send", "stop now", ["stop takes no value; given: now"]),
    ("send", "enable maybe", ["enable takes on or off; given: maybe"]),
    ("send", "trajectory 1", ["takes points TIME:POSITION, such as 0.5s:1um; given: 1"]),
    ("send", "fault dirt", ["it is a parameter: stickslip send parameters fault=VALUE"]),
    ("send", "joint_command a force 1", ["takes JOINT position|velocity VALUE"]),
    ("send", "parameters", ["parameters takes NAME=VALUE"]),
    ("send", "parameters prelod=1", ["did you mean preload"]),
    ("explore", "--port 70000", ["--port is 70000"]),
    ("emulate", "anc300 --port 70000", ["70000"]),
    ("emulate", "anc300 --axes x,x", ["x,x"]),
    ("emulate", "anc300 --axes a,b,c,d,e,f,g,h", ["8 axes"]),
    ("emulate", "e871 --axes x,y", ["2 axes"]),
    ("emulate", "anc300 --axes x,,y", ["axis_name"]),
    ("emulate", "anc300 --set mass=-1", ["mass"]),
    ("emulate", "anc300 --host 203.0.113.1 --port 0", ["203.0.113.1", "choose another --host"]),
]


@pytest.mark.parametrize(("command", "arguments", "words"), ROWS)
def test_bad_use_is_one_line_with_the_cure_and_leaves_nothing(
    command: str,
    arguments: str,
    words: list[str],
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    usual = FINE.get(command, "") if arguments.startswith("--") else ""
    assert main([*command.split(), *usual.split(), *arguments.split()]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    # A slow machine says before the error that it searches.
    line, *preview = [one for one in output.err.splitlines() if one != f"{SEARCH} ..."]
    assert preview == [] or arguments.split()[0] in FILES  # what a file holds that is no table
    assert line.startswith(f"stickslip {command}: ")
    assert all(word in line for word in words), line
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == FILES
