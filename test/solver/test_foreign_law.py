# SPDX-License-Identifier: Apache-2.0
"""A law of another form is one file and one line; the solver takes its general way for it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "stickslip_ros"

#: Dahl (1968), with the exponent 1 of bristles that give way in proportion
LAW = '''
"""Dahl's friction: z' = w (1 - z sgn(w) / z_c)."""
from __future__ import annotations
import math
from stickslip_ros.compiled import compiled
from stickslip_ros.model.friction.contact import Contact
from stickslip_ros.model.friction.law import Law
from stickslip_ros.model.friction.lugre import LUGRE

@compiled
def _rate(z: float, w: float, contact: Contact) -> float:
    return w * (1.0 - z * math.copysign(1.0, w) / contact.z_k)

DAHL = Law(LUGRE.constants, LUGRE.contact, _rate)
'''
PROGRAM = """
import json
from stickslip_ros.model import Plant, drive_of
from stickslip_ros.parameters import Parameters
from stickslip_ros.solver import Simulation
found = []
for model in ("lugre", "dahl"):
    p = Parameters.of({"model": model, "mu_s": 0.2, "mu_k": 0.2, "frequency": 2e4, "spring": 1e4})
    s = Simulation(Plant.of(p), p.solver.tolerance)
    s.start(drive_of(p), 2)
    found.append(s.run_cycles(2).position.tolist())
    s.advance(s.state.t + 3.3e-5)
    found[-1] += [s.state.x, 1e-4 * s.state.v, s.state.z]
print(json.dumps(found))
"""


@pytest.mark.slow
def test_a_law_is_one_file_and_one_line(tmp_path: Path) -> None:
    """With mu_s = mu_k LuGre is Dahl's law too, and goes another way: series and tables."""
    package = tmp_path / "stickslip_ros"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    friction = package / "model" / "friction"
    (friction / "dahl.py").write_text(LAW, encoding="utf-8")
    laws = friction / "laws.py"
    text = laws.read_text(encoding="utf-8")
    line = '    "epm_calc": EPM_CALC,\n'
    assert line in text
    text = text.replace(line, line + '    "dahl": DAHL,\n')
    text = text.replace(
        "import LUGRE\n", "import LUGRE\nfrom stickslip_ros.model.friction.dahl import DAHL\n"
    )
    laws.write_text(text, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(tmp_path)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    series, general = np.array(json.loads(done.stdout))
    assert abs(series[1]) > 1e-8
    np.testing.assert_allclose(general, series, rtol=0.0, atol=2e-12)
