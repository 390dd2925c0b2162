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
from stickslip_ros.opening import Allowance, open_regular

#: A file is broken if it takes longer: seconds, and those for each byte of it.
_PATIENCE, _PATIENCE_A_BYTE = 20.0, 1e-7
#: Memory (bytes) of the interpreter and its libraries; copies of the variables beside it.
_INTERPRETER, _COPIES = 500_000_000, 4
#: Reads the file named first and leaves its variables, or what is wrong, in the one named second;
#: the third argument is the memory (bytes) that it may take, where the system can limit that.
_CHILD = """
import sys
sys.path[:1] = []  # the folder that we happen to be in
import pickle, warnings
warnings.simplefilter("ignore")
try:
    import scipy.io
    try:
        import resource
        resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[3]),) * 2)
    except ImportError:
        pass
    held = scipy.io.loadmat(sys.argv[1])
except BaseException as error:
    held = " ".join(str(error).split())[:160] or type(error).__name__
    held = None if isinstance(error, MemoryError) else held
with open(sys.argv[2], "wb") as file:
    pickle.dump(held, file, 5)
"""


def read_mat(path: Path) -> Table:
    """Return the variables of a MATLAB file. Raises MeasurementError and OSError."""
    with open_regular(path) as file:
        if b"MATLAB 7.3" in file.read(32):
            return read_hdf5(path)
    with tempfile.TemporaryDirectory(prefix="stickslip-") as folder:
        out, allowance = Path(folder, "variables"), Allowance(path)
        memory = _INTERPRETER + _COPIES * allowance.left
        command = [sys.executable, "-c", _CHILD, os.path.abspath(path), str(out), str(memory)]
        patience = _PATIENCE + _PATIENCE_A_BYTE * path.stat().st_size
        one_thread = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # each reserves memory
        try:
            child = subprocess.run(
                command, capture_output=True, timeout=patience, check=False, env=one_thread
            )
        except subprocess.TimeoutExpired:
            raise MeasurementError("its MATLAB variables take too long to read") from None
        if child.returncode != 0 or not out.exists():
            raise MeasurementError("its MATLAB variables are broken; export it anew")
        allowance.spend(out.stat().st_size)
        held = pickle.loads(out.read_bytes())  # what our own program left
    if held is None:
        allowance.spend(allowance.left + 1)
    if isinstance(held, str):
        raise MeasurementError(f"its MATLAB variables cannot be read: {held}; export it anew")
    return of_mapping({name: v for name, v in held.items() if not name.startswith("__")})
