# SPDX-License-Identifier: Apache-2.0
"""Small files that would fill the machine, and files that are none: an error, soon, in bounds.

All are read in one child process, so that its peak of memory is theirs alone.
"""

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

from stickslip_ros.base.opening import UNPACK_VARIABLE
from stickslip_ros.measurement.reading import MeasurementError, Reading, read_measurement

#: Samples of a bomb: 80 MB, above what every file may unpack to; a tenth in the quick test.
COUNT = 10_000_000
#: Largest memory (bytes) and longest time (s of processor) that reading may take.
MOST, LONGEST = 1e9, 10.0
#: Reads each file in a process of its own; prints its error, the time (s) it took, its peak (kB).
CHILD = """
import json, os, sys, time
from pathlib import Path
import RigolWFM.wfm, scipy.io  # once, not in each child
from stickslip_ros.measurement.reading import MeasurementError, Reading, read_measurement
from stickslip_ros.base import opening
opening.ALWAYS_ALLOWED //= int(sys.argv[1])
opening.UNPACK_FACTOR //= int(sys.argv[1])
for name in sys.argv[2:]:
    sys.stdout.flush()
    child = os.fork()
    if not child:
        try:
            said = f"{len(read_measurement(Path(name)).t)} samples"
        except MeasurementError as error:
            said = f"MeasurementError {error}"
        print(json.dumps(said), flush=True)
        os._exit(0)
    used = os.wait4(child, 0)[2]
    print(used.ru_utime + used.ru_stime, used.ru_maxrss)
"""


def packed(pack: Callable[..., bytes]) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        path.write_bytes(pack(b"time (s),x (nm)\n" + b"0,0\n" * (COUNT // 2)))

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
        file.create_dataset(f"x{k}", (COUNT // 200,), "f8", compression="gzip", fillvalue=0.0)


def virtual_of_itself(file: h5py.File) -> None:
    file.create_dataset("y", (9,), "f8", fillvalue=1.0)
    layout = h5py.VirtualLayout((COUNT,), "f8")
    layout[:9] = h5py.VirtualSource(".", "y", (9,))
    file.create_virtual_dataset("x", layout, fillvalue=0.0)


def links_in_a_circle(file: h5py.File) -> None:
    for k in range(30):  # 2**30 paths
        group = file.create_group(f"g{k}")
        for name in "ab":
            group[name] = h5py.SoftLink(f"/g{(k + 1) % 30}")


def table_of_records(file: h5py.File) -> None:
    kind = np.dtype([(f"x{k}", "f8") for k in range(100)])
    file.create_dataset("x", (COUNT // 10,), kind, chunks=(1000,), compression="gzip")


def wide(file: h5py.File) -> None:
    file.create_dataset("x", (200, COUNT), "f4", chunks=(1, 10**5), compression="gzip")


def texts(file: h5py.File) -> None:
    file.create_dataset("x", (10**6,), "S10000", chunks=(100,), compression="gzip")


def members(path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for k in range(100):
            file.writestr(f"x{k}.npy", lying_header(COUNT // 100) + bytes(8 * COUNT // 100))


def one_long_line(path: Path) -> None:
    path.write_bytes(gzip.compress(b"1," * (5 * COUNT)))


def struct_in_matlab(path: Path) -> None:
    inner = {f"x{k}": np.zeros(COUNT // 10) for k in range(10)}
    scipy.io.savemat(path, {"a": {"b": {"c": inner}}}, do_compression=True)


def lines_in_text(line: bytes, count: int) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        rows = b"".join(b"%f,%d\n" % (1e-5 * k, k % 7) for k in range(400))
        text = b"time (s),x (nm)\n" + rows + line * (count * COUNT // 10_000_000)
        path.write_bytes(gzip.compress(text))

    return write


def cells_in_matlab(path: Path) -> None:
    cells = np.empty(COUNT // 100, object)
    cells[:] = [np.zeros(0)] * len(cells)
    scipy.io.savemat(path, {"x": cells}, do_compression=True)


def matlab_4_that_promises(path: Path) -> None:
    path.write_bytes(np.array([0, 10**9, 2, 0, 2], "<i4").tobytes() + b"x\0" + bytes(8000))


def tdms_that_promises(path: Path) -> None:
    name = b"/'a'/'b'"
    index = (20).to_bytes(4, "little") + (10).to_bytes(4, "little") + (1).to_bytes(4, "little")
    index += (2**40).to_bytes(8, "little") + bytes(4)
    meta = (1).to_bytes(4, "little") + len(name).to_bytes(4, "little") + name + index
    lead = b"TDSm" + (0x0E).to_bytes(4, "little") + (4713).to_bytes(4, "little")
    path.write_bytes(lead + (2**60).to_bytes(8, "little") + len(meta).to_bytes(8, "little") + meta)


def isf_that_promises(path: Path) -> None:
    head = b":WFMPRE:BYT_NR 2;NR_PT 1000000000000;XINCR 1e-6;YMULT 1;ENCDG BINARY;BN_FMT RI"
    path.write_bytes(head + b";BYT_OR MSB;PT_FMT Y;:CURVE #9999999999" + bytes(8000))


def uff_that_promises(path: Path) -> None:
    numbers = "         4 1000000000         1  0.00000e+00  1.00000e-03  0.00000e+00"
    path.write_text("\n".join(["    -1", "    58", *["NONE"] * 5, "  1  0", numbers, "    -1"]))


def random_behind(start: bytes) -> Callable[[Path], None]:
    """Return a writer of a file that begins as one of a format, and goes on as it likes."""

    def write(path: Path) -> None:
        dice = np.random.default_rng(len(start))
        path.write_bytes(start + dice.integers(0, 256, 50_000, dtype=np.uint8).tobytes())

    return write


def large_behind(start: bytes) -> Callable[[Path], None]:
    """Return a writer of a file that begins as one of a format, all its numbers large ones."""

    def write(path: Path) -> None:
        path.write_bytes(start + b"\xff\xff\xff\x7f" * 5000)

    return write


def matlab(path: Path) -> None:
    scipy.io.savemat(path, {"x": np.zeros(COUNT)}, do_compression=True)


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
    (".h5", hdf5(virtual_of_itself), ""),
    (".h5", hdf5(links_in_a_circle), ""),
    (".h5", hdf5(table_of_records), UNPACK_VARIABLE),
    (".h5", hdf5(wide), UNPACK_VARIABLE),
    (".h5", hdf5(texts), ""),
    (".npz", members, UNPACK_VARIABLE),
    (".csv.gz", one_long_line, ""),
    (".mat", struct_in_matlab, UNPACK_VARIABLE),
    (".mat", cells_in_matlab, ""),
    (".csv.gz", lines_in_text(b"\n", 100_000_000), UNPACK_VARIABLE),
    (".csv.gz", lines_in_text(b"no number at all,nor this\n", 3_000_000), ""),
    (".csv.gz", lines_in_text(b'"0","0"\n', 10_000_000), UNPACK_VARIABLE),
    (".csv.gz", lines_in_text(b"# comment\n", 10_000_000), UNPACK_VARIABLE),
    (".mat", matlab_4_that_promises, ""),
    (".tdms", tdms_that_promises, ""),
    (".isf", isf_that_promises, ""),
    (".uff", uff_that_promises, ""),
    *((suffix, write(start), "") for write in (random_behind, large_behind) for suffix, start in (
        (".tdms", b"TDSm\x0e\0\0\0\x69\x12\0\0"), (".wfm", b"\x0f\x0f:WFM#003"),
        (".trc", b"#9000050000WAVEDESC\0\0\0\0\0\0\0\0LECROY_2_3\0"), (".bin", b"AG10"),
        (".bin", b"RG01"), (".wfm", b"\xa5\xa5\x00\x00"), (".wfm", b"\x01\0\0\0"),
        (".uff", b"    -1\n    58b     2     6         "), (".h5", b"\x89HDF\r\n\x1a\n\0"),
        (".mat", b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM"), (".npy", b"\x93NUMPY\1\0"),
        (".csv.gz", b"\x1f\x8b\x08\0\0\0\0\0\0\x03"), (".csv.xz", b"\xfd7zXZ\0\0\x04"),
    )),
]  # fmt: skip


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="measures memory as Unix does")
@pytest.mark.parametrize("share", [10, pytest.param(1, marks=pytest.mark.long)])
def test_a_small_file_fills_neither_memory_nor_time(
    tmp_path: Path, share: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("RigolWFM")
    monkeypatch.setitem(globals(), "COUNT", COUNT // share)
    paths = []
    for k, (suffix, write, _) in enumerate(BOMBS):
        paths.append(tmp_path / f"bomb{k}{suffix}")
        write(paths[-1])
        assert paths[-1].stat().st_size < 1_000_000, paths[-1]
    before = sorted(tmp_path.iterdir())
    child = subprocess.run(
        [sys.executable, "-c", CHILD, str(share), *map(str, paths)],
        capture_output=True,
        text=True,
        check=True,
    )
    lines = child.stdout.splitlines()
    for (suffix, _, words), path, line, used in zip(
        BOMBS, paths, lines[::2], lines[1::2], strict=True
    ):
        said, (time, peak) = json.loads(line), map(float, used.split())
        print(f"{path.name}: {time:.1f} s, {1.024e-3 * peak:.0f} MB, {said[:90]}")
        assert said.startswith("MeasurementError"), (path, said)
        assert words in said, (suffix, said)
        assert path.name in said
        assert time < LONGEST, (path, time)
        assert 1024 * peak < MOST, (path, peak)
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


def test_a_user_may_allow_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "large.npz"
    np.savez_compressed(path, t=np.arange(5e5), x_nm=np.zeros(500_000))
    units = {"t": "us"}
    monkeypatch.setattr("stickslip_ros.base.opening.ALWAYS_ALLOWED", 0)
    monkeypatch.setattr("stickslip_ros.base.opening.UNPACK_FACTOR", 2)
    with pytest.raises(MeasurementError, match="unpacks to more than 2 times its size"):
        read_measurement(path, Reading(units=units))
    monkeypatch.setenv(UNPACK_VARIABLE, "1000")
    assert len(read_measurement(path, Reading(units=units)).t) == 500_000
