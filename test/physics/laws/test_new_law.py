# SPDX-License-Identifier: Apache-2.0
"""A law, or a waveform, with a constant of its own is one file and one line; all else sees it."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PACKAGE = Path(__file__).resolve().parents[3] / "stickslip_ros"

#: Dahl (1968), with constants of its own: a number, a whole number, one that may not be set
LAW = '''
"""Dahl's friction: z' = w (1 - z sgn(w) / z_c)^n."""
from __future__ import annotations
import math
from dataclasses import dataclass
from stickslip_ros.physics.laws.law import Law
from stickslip_ros.physics.laws.lugre import LUGRE
from stickslip_ros.physics.parameters.row import number

@dataclass(frozen=True)
class Dahl:
    """The constants of Dahl's law."""
    dahl_share: float = number(
        1.0, "", 0.1, 10.0, "limit of the deflection over that of LuGre", reason="a fit needs room")
    dahl_power: int = number(1, "", 1, 4, "exponent", reason="rocks have 1 to 4")
    dahl_cap: float | None = number(None, "", 0.0, 1.0, "largest share; 0: none", reason="a share")

def _contact(c, f):
    contact = LUGRE.contact(c, f)
    limit = contact.z_k * c.own(Dahl).dahl_share
    return contact._replace(z_k=limit, z_s=limit)

def _rate(z, _, w, c, alpha):
    share = z * math.copysign(1.0, w) / c.z_k
    if share > c.dahl_cap:
        share = c.dahl_cap
    return w * (1.0 - share) ** c.dahl_power, 0.0

DAHL = Law(LUGRE.constants, _contact, _rate, rows=Dahl, free=("sigma_0", "dahl_share"))
'''
WAVEFORM = '''
"""A triangle that does not rise and fall alike."""
from __future__ import annotations
from dataclasses import dataclass
from stickslip_ros.physics.parameters.row import number
from stickslip_ros.physics.waveforms.built_in import Shape, with_rows

@dataclass(frozen=True)
class Saw:
    """The constant of the waveform."""
    rise: float = number(0.7, "", 0.1, 0.9, "share of the rise", reason="both need time")

@with_rows(Saw)
def saw_shape(d):
    period, rise = 1.0 / d.frequency, d.own(Saw).rise
    return Shape((rise * period, (1.0 - rise) * period), (1.0, -1.0), slip=(1, 2))
'''
HEAD = """
import json, sys
from stickslip_ros.physics.parameters import (
    PARAMETERS, Parameters, parse_assignment, read_yaml, yaml_text
)
row = PARAMETERS[sys.argv[1]]
assert not {"numba", "numpy"} & set(sys.modules)
name, value = parse_assignment(f"{row.name}={sys.argv[2]}")
p = Parameters.of({name: value})
assert p != Parameters() and p.replace(**{name: row.default}) == Parameters()
with open("own.yaml", "w") as file:
    file.write(yaml_text(p))
assert read_yaml("own.yaml") == p and p.flat()[name] == value
"""
IN_MOTION = (
    HEAD
    + """
from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.solver import Simulation
found = []
for model in ("lugre", "dahl"):
    p = Parameters.of(
        model=model, mu_s=0.2, mu_k=0.2 if model == "lugre" else 0.1, dahl_share=2.0,
        frequency=2e4, spring=1e4)
    s = Simulation(Plant.of(p), p.solver.tolerance)
    s.start(drive_of(p), 2)
    found.append(s.run_cycles(2).position.tolist())
    s.advance(s.state.t + 3.3e-5)
    found[-1] += [s.state.x, 1e-4 * s.state.v, s.state.z]
print(json.dumps(found))
"""
)
IN_KERNEL = (
    HEAD
    + """
import math
from stickslip_ros.measurement.identification.free import default_names
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.model.friction import rates_of_law
from stickslip_ros.physics.solver.layout import CONTACT_RECORD
from stickslip_ros.physics.solver.plants import contact_buffer, set_contacts
rates = []
for more in ({}, {"dahl_cap": 0.25}):
    p = Parameters.of(model="dahl", mu_s=0.2, mu_k=0.2, dahl_power=2, **more)
    plant = Plant.of(p)
    buffer = contact_buffer(plant)
    set_contacts(buffer, plant)
    contact = buffer[:len(buffer) // 2].view(CONTACT_RECORD)[0]
    rates.append(rates_of_law(0.5 * contact.z_k, 0.0, 2.0, contact)[0])
print(json.dumps([rates, default_names([p])]))
"""
)
IN_RECORDS = (
    HEAD
    + """
from stickslip_ros.axis import Axis
from stickslip_ros.physics.model import drive_of
axis = Axis(Parameters.of(p, waveform="saw"))
start = axis.take_events()[0].details
print(json.dumps([drive_of(axis.parameters).durations.tolist(), float(start[name])]))
"""
)
IN_ROS = (
    HEAD
    + """
from stickslip_ros.ros.nodes.node_parameters import descriptor
message = descriptor(row)
bounds = message.floating_point_range[0]
print(json.dumps([message.name, message.description, bounds.from_value, bounds.to_value]))
"""
)


def _with(tmp_path: Path, room: str, name: str, text: str, constant: str) -> Path:
    """Return a folder with a copy of the package, to which one file and one line are added."""
    package = tmp_path / "stickslip_ros"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    (package / "physics" / room / f"{name}.py").write_text(text, encoding="utf-8")
    registry = package / "physics" / room / "__init__.py"
    before, sign, after = registry.read_text(encoding="utf-8").partition("] = {\n")
    assert sign
    module = f"{PACKAGE.name}.physics.{room}.{name}"
    line = f'    "{name}": __import__("{module}", fromlist=["x"]).{constant},\n'
    registry.write_text(before + sign + line + after, encoding="utf-8")
    return tmp_path


def _start(folder: Path, program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", program, *arguments],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(folder)},
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


def _run(folder: Path, program: str, *arguments: str) -> Any:
    done = _start(folder, program, *arguments)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_law_reaches_kernel_and_identification(tmp_path: Path) -> None:
    """All its constants: whole numbers, and those that are not set, as nan."""
    folder = _with(tmp_path, "laws", "dahl", LAW, "DAHL")
    found = _run(folder, IN_KERNEL, "dahl_share", "2.0")
    assert found == [[0.5, 2.0 * 0.75**2], ["sigma_0", "dahl_share"]]


@pytest.mark.parametrize(
    ("name", "reason"), [("second", "field of the solver"), ("mass", "which Dahl has")]
)
def test_a_constant_that_is_called_like_another_is_refused(
    tmp_path: Path, name: str, reason: str
) -> None:
    """It was a riddle of numpy."""
    folder = _with(tmp_path, "laws", "dahl", LAW.replace("dahl_cap", name), "DAHL")
    uses = 'from stickslip_ros.physics import parameters, solver; parameters.PARAMETERS["mass"]'
    done = _start(folder, uses)
    assert name in done.stderr.splitlines()[-1] and reason in done.stderr.splitlines()[-1]


@pytest.mark.long
def test_a_law_with_a_constant_of_its_own(tmp_path: Path) -> None:
    """With mu_s = mu_k LuGre is Dahl's law too, and goes another way: series and tables."""
    folder = _with(tmp_path, "laws", "dahl", LAW, "DAHL")
    series, general = np.array(_run(folder, IN_MOTION, "dahl_share", "2.0"))
    assert abs(series[1]) > 1e-8
    np.testing.assert_allclose(general, series, rtol=0.0, atol=2e-12)
    found = _run(folder, IN_ROS, "dahl_share", "2.0")
    assert found == ["dahl_share", "limit of the deflection over that of LuGre", 0.1, 10.0]


@pytest.mark.long
def test_a_waveform_with_a_constant_of_its_own(tmp_path: Path) -> None:
    folder = _with(tmp_path, "waveforms", "saw", WAVEFORM, "saw_shape")
    durations, recorded = _run(folder, IN_RECORDS, "rise", "0.6")
    np.testing.assert_allclose(durations, [0.6e-2, 0.4e-2], rtol=1e-12)
    assert recorded == 0.6


def test_a_package_brings_its_law_whatever_is_imported_first(tmp_path: Path) -> None:
    """One with a rate had come too late where the model was loaded before the table was read."""
    (tmp_path / "mine.py").write_text(
        "from stickslip_ros.physics.laws import LAWS\nLAW = LAWS['ceim_ageing']\n"
    )
    told = tmp_path / "mine-1.0.dist-info"
    told.mkdir()
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    (told / "entry_points.txt").write_text("[stickslip_ros.laws]\nolder = mine:LAW\n")
    program = (
        "import stickslip_ros.physics.model.idle, stickslip_ros.physics.laws as l; "
        "print('older' in l.LAWS)"
    )
    path = f"{tmp_path}:{Path(__file__).parents[3]}"
    done = subprocess.run(
        [sys.executable, "-c", program], env={**os.environ, "PYTHONPATH": path},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.stdout == "True\n", done.stderr


def test_an_error_in_what_is_of_somebody_else_names_it() -> None:
    """An attribute that a waveform misspells had been a traceback of ours."""
    program = """
import stickslip_ros as ss
from stickslip_ros.physics.laws import LAWS
ss.register_waveform("ramp", lambda d: d.knee)
ss.register_waveform("flat", lambda d: (1.0, 2.0))
ss.register_law("bad", LAWS["ceim"]._replace(contact=lambda c, f: c.no_such))
for values in ({"waveform": "ramp"}, {"waveform": "flat"}, {"model": "bad"}):
    try:
        ss.simulate(**values)
    except ss.StickslipError as error:
        print(error)
"""
    path = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run([sys.executable, "-c", program], env=path, capture_output=True, text=True)
    ramp, flat, law = done.stdout.splitlines()
    assert "the waveform ramp of __main__ fails: AttributeError" in ramp
    assert "mend it there" in ramp
    assert "(1.0, 2.0), not a stickslip_ros.Shape" in flat
    assert "the law bad of __main__ fails: AttributeError" in law
