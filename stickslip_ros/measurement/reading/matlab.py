# SPDX-License-Identifier: Apache-2.0
"""MATLAB files, read in a process of their own: a broken one can crash SciPy's reader."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
from pathlib import Path

from stickslip_ros.measurement.reading.arrays import of_mapping, read_hdf5
from stickslip_ros.measurement.reading.table import MeasurementError, Table

#: A file that takes longer (s) is broken.
_PATIENCE = 300.0
#: Reads the file named first and leaves its variables, or what is wrong, in the one named second.
_CHILD = """
import sys
sys.path[:1] = []  # the folder that we happen to be in
import pickle, warnings
warnings.simplefilter("ignore")
try:
    import scipy.io
    held = scipy.io.loadmat(sys.argv[1])
except BaseException as error:
    held = " ".join(str(error).split())[:160] or type(error).__name__
with open(sys.argv[2], "wb") as file:
    pickle.dump(held, file, 5)
"""


def read_mat(path: Path) -> Table:
    """Return the variables of a MATLAB file. Raises MeasurementError and OSError."""
    with path.open("rb") as file:
        if b"MATLAB 7.3" in file.read(32):
            return read_hdf5(path)
    with tempfile.TemporaryDirectory(prefix="stickslip-") as folder:
        out = Path(folder, "variables")
        command = [sys.executable, "-c", _CHILD, os.path.abspath(path), str(out)]
        try:
            child = subprocess.run(command, capture_output=True, timeout=_PATIENCE, check=False)
        except subprocess.TimeoutExpired:
            raise MeasurementError("its MATLAB variables take too long to read") from None
        if child.returncode != 0 or not out.exists():
            raise MeasurementError("its MATLAB variables are broken; export it anew")
        held = pickle.loads(out.read_bytes())  # what our own program left
    if isinstance(held, str):
        raise MeasurementError(f"its MATLAB variables cannot be read: {held}; export it anew")
    return of_mapping({name: v for name, v in held.items() if not name.startswith("__")})
