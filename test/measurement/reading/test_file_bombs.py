# SPDX-License-Identifier: Apache-2.0
"""Small files that would fill the machine, and files that are none: an error, soon, in bounds.

All are read in one child process, so that its peak of memory is theirs alone.
"""

from __future__ import annotations

import bz2
import gzip
import json
import lzma
import os
import pickle
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from stickslip_ros.measurement.reading import MeasurementError, Reading, read_measurement
from stickslip_ros.opening import UNPACK_VARIABLE

#: Samples of a bomb: 80 MB, above what every file may unpack to.
COUNT = 10_000_000
#: Largest memory (bytes) and longest time (s of processor) that reading may take.
MOST, LONGEST = 1e9, 10.0
#: Prints for each file its error and the time (s) that it took; then the peak of memory (kB).
CHILD = """
import json, resource, sys, time
from pathlib import Path
from stickslip_ros.measurement.reading import MeasurementError, Reading, read_measurement
for name in sys.argv[1:]:
    begun = time.process_time()
    try:
        said = f"{len(read_measurement(Path(name)).t)} samples"
    except MeasurementError as error:
        said = f"MeasurementError {error}"
    print(json.dumps([said, time.process_time() - begun]))
who = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
print(max(resource.getrusage(one).ru_maxrss for one in who))
"""


def packed(pack: Callable[..., bytes]) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        path.write_bytes(pack(b"time (s),x (nm)\n" + b"0,0\n" * 5_000_000))

    return write


def lying_header(shape: int) -> bytes:
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({shape},), }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def npz(path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("x.npy", lying_header(COUNT) + bytes(8 * COUNT))


def npz_that_promises(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("x.npy", lying_header(10**12) + bytes(8000))


def npy_that_promises(path: Path) -> None:
    path.write_bytes(lying_header(10**12) + bytes(8000))


def hdf5(make: Callable[[h5py.File], object]) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            make(file)

    return write


def external(name: str) -> Callable[[h5py.File], object]:
    size = 8 * COUNT
    return lambda file: file.create_dataset("x", (COUNT,), "f8", external=[(name, 0, size)])


def virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout((COUNT,), "f8")
    layout[:] = h5py.VirtualSource("/elsewhere.h5", "x", (COUNT,))
    file.create_virtual_dataset("x", layout)


def many(file: h5py.File) -> None:
    for k in range(200):
        file.create_dataset(f"x{k}", (50_000,), "f8", compression="gzip", fillvalue=0.0)


def matlab(path: Path) -> None:
    scipy.io.savemat(path, {"x": np.zeros(COUNT)}, do_compression=True)


def octave(path: Path) -> None:
    parts = [f"# name: x{k}\n# type: range\n0 5e6 1\n" for k in range(20)]
    path.write_text("".join(parts))


#: Suffix, writer, words of the error.
BOMBS: list[tuple[str, Callable[[Path], None], str]] = [
    (".csv.gz", packed(gzip.compress), UNPACK_VARIABLE),
    (".csv.xz", packed(lambda text: lzma.compress(text, preset=0)), UNPACK_VARIABLE),
    (".csv.bz2", packed(bz2.compress), UNPACK_VARIABLE),
    (".npz", npz, UNPACK_VARIABLE),
    (".npz", npz_that_promises, "shorter than its shape"),
    (".npy", npy_that_promises, "cannot be read"),
    (".h5", hdf5(lambda file: file.create_dataset("x", (10**12,), "f8", chunks=(1000,))),
     UNPACK_VARIABLE),
    (".h5", hdf5(lambda file: file.create_dataset("x", (COUNT,), "f8", compression="gzip",
                                                  data=np.zeros(COUNT))), UNPACK_VARIABLE),
    (".h5", hdf5(lambda file: file.create_dataset("x", (9,), "f8", maxshape=(None,),
                                                  chunks=(10**8,), compression="gzip")),
     UNPACK_VARIABLE),
    (".h5", hdf5(many), UNPACK_VARIABLE),
    (".h5", hdf5(virtual), "kept in other files"),
    (".h5", hdf5(external("/dev/zero")), "kept in other files"),
    (".mat", matlab, UNPACK_VARIABLE),
    (".mat", octave, UNPACK_VARIABLE),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="measures memory as Unix does")
def test_a_small_file_fills_neither_memory_nor_time(tmp_path: Path) -> None:
    paths = []
    for k, (suffix, write, _) in enumerate(BOMBS):
        paths.append(tmp_path / f"bomb{k}{suffix}")
        write(paths[-1])
        assert paths[-1].stat().st_size < 1_000_000, paths[-1]
    before = sorted(tmp_path.iterdir())
    child = subprocess.run(
        [sys.executable, "-c", CHILD, *map(str, paths)], capture_output=True, text=True, check=True
    )
    *lines, peak = child.stdout.splitlines()
    for (suffix, _, words), path, line in zip(BOMBS, paths, lines, strict=True):
        said, time = json.loads(line)
        assert said.startswith("MeasurementError"), (path, said)
        assert words in said, (suffix, said)
        assert path.name in said
        assert time < LONGEST, (path, time)
    assert 1024 * int(peak) < MOST
    assert sorted(tmp_path.iterdir()) == before


class Intruder:
    """An object that makes a folder when it is unpickled."""

    def __reduce__(self) -> tuple[Callable[..., object], tuple[str]]:
        return os.mkdir, ("intruded",)


def test_what_a_file_would_run_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    objects = np.array([Intruder()] * 3, dtype=object)
    np.save("a.npy", objects, allow_pickle=True)
    np.savez("a.npz", x=objects)
    (tmp_path / "a.lvm").write_bytes(pickle.dumps(Intruder()))
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(Intruder()))
    for name in ("a.npy", "a.npz", "a.lvm", "a.pkl"):
        with pytest.raises(MeasurementError):
            read_measurement(tmp_path / name)
    assert not (tmp_path / "intruded").exists()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes")
def test_a_pipe_is_refused_whatever_its_name_says(tmp_path: Path) -> None:
    for suffix in (".csv", ".npy", ".npz", ".mat", ".h5", ".tdms", ".uff", ".lvm", ".isf", ".trc",
                   ".wfm", ".bin", ".wvf", ".hdr", ".gz"):  # fmt: skip
        path = tmp_path / f"pipe{suffix}"
        os.mkfifo(path)
        with pytest.raises(MeasurementError, match=r"pipe\..* is not a file but a pipe"):
            read_measurement(path)


def test_a_pipe_beside_a_file_is_not_waited_for(tmp_path: Path) -> None:
    if not hasattr(os, "mkfifo"):
        pytest.skip("there are no pipes")
    rows = "".join(f"{k * 1e-5:.5f},{k}\n" for k in range(100))
    (tmp_path / "scope.Wfm.csv").write_text(rows)
    os.mkfifo(tmp_path / "scope.csv")
    with pytest.raises(MeasurementError, match="states no unit"):
        read_measurement(tmp_path / "scope.Wfm.csv")


@pytest.mark.slow
def test_a_user_may_allow_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "large.npz"
    np.savez_compressed(path, t=np.arange(5e6), x_nm=np.zeros(5_000_000))
    units = {"t": "us"}
    monkeypatch.setattr("stickslip_ros.opening.ALWAYS_ALLOWED", 0)
    monkeypatch.setattr("stickslip_ros.opening.UNPACK_FACTOR", 2)
    with pytest.raises(MeasurementError, match="unpacks to more than 2 times its size"):
        read_measurement(path, Reading(units=units))
    monkeypatch.setenv(UNPACK_VARIABLE, "1000")
    assert len(read_measurement(path, Reading(units=units)).t) == 5_000_000
