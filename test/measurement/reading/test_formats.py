# SPDX-License-Identifier: Apache-2.0
"""One file of each format, made by its own writer or by its published layout, read exactly."""

import bz2
import gzip
import json
import lzma
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy
from waveform_files import (
    COARSE,
    COUNT,
    ONE,
    STEP,
    STEP_SIZE,
    STEPS,
    VOLTS,
    keysight,
    lecroy,
    tektronix,
    write_isf,
    write_keysight,
    write_rigol_bin,
    write_rigol_wfm,
    write_tektronix,
    write_trc,
)

from stickslip_ros.cli.main import main
from stickslip_ros.measurement.bags.load_motion import joint_columns, load_motion
from stickslip_ros.measurement.reading import MeasurementError, Reading, read_loop, read_measurement
from stickslip_ros.measurement.reading.table import Column, Loaded, Table

T = STEP * np.arange(COUNT)
X = 50e-9 * VOLTS  # m
TYPICAL = Path(__file__).parents[3] / "config" / "table1_typical.yaml"
IN_VOLTS = Reading(scale={"x": "50nm/V"})


def write_npy_with_names(path: Path) -> None:
    kind = np.dtype([("time_s", float), ("position_nm", float)])
    np.save(path, np.array(list(zip(T, 1e9 * X, strict=True)), dtype=kind))


def write_npz(path: Path) -> None:
    np.savez(path, time=1e3 * T, position=1e9 * X, other=np.arange(3))


def write_mat_of_a_picoscope(path: Path) -> None:
    """Channels are vectors; the clock is two scalars."""
    scipy.io.savemat(
        path, {"A": VOLTS, "Tstart": -1e-3, "Tinterval": STEP, "Length": COUNT}, do_compression=True
    )


def write_mat_of_structs(path: Path) -> None:
    scipy.io.savemat(path, {"run": {"time_s": T, "position_um": 1e6 * X}})


def write_mat_with_an_object(path: Path) -> None:
    """As MATLAB saves a `table` beside vectors, with the workspace of its class at the end."""

    def element(kind: int, data: bytes) -> bytes:
        return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)

    def matrix(kind: int, shape: tuple[int, int], numbers: bytes) -> bytes:
        head = element(6, struct.pack("<II", kind, 0)) + element(5, struct.pack("<ii", *shape))
        return element(14, head + element(1, b"") + numbers)

    names = b"".join(element(1, name) for name in (b"events", b"MCOS", b"table"))
    content = matrix(13, (6, 1), element(6, struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1)))
    scipy.io.savemat(path, {"time_s": T, "position_nm": 1e9 * X})
    with path.open("ab") as file:
        file.write(element(14, element(6, struct.pack("<II", 17, 0)) + names + content))
        file.write(matrix(9, (1, 8), element(2, bytes(8))))


def write_mat_73(path: Path) -> None:
    """As MATLAB has it: HDF5 behind 512 bytes that say so."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        file["time_s"], file["x_nm"] = T[None, :], 1e9 * X[None, :]
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\0\2IM")


def write_hdf5(path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, values, unit in (("time", 1e6 * T, "us"), ("position", 1e9 * X, "nm")):
            file[f"bench/{name}"] = values
            file[f"bench/{name}"].attrs["units"] = unit


def write_hdf5_of_a_keysight(path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        group = file.create_group("Waveforms/Channel 1")
        group.attrs.update({"XInc": STEP, "XOrg": -1e-3, "YUnits": b"V"})
        group["Channel 1Data"] = VOLTS


def write_tdms(path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    properties = {"wf_increment": STEP, "wf_start_offset": -1e-3, "unit_string": "nm"}
    channel = nptdms.ChannelObject("bench", "displacement", 1e9 * X, properties=properties)
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([channel])


@pytest.mark.parametrize(("late", "every"), [(400, 1), (0, 2), (401, 2), (-300, 3)])
def test_channels_with_times_of_their_own_meet(tmp_path: Path, late: int, every: int) -> None:
    """The voltage begins so many samples later, and has every so-manyth of them."""
    nptdms = pytest.importorskip("nptdms")
    begun, step, number = np.datetime64("2026-03-01T10:00:00.000000"), 1e-5, np.arange(5000)

    def channel(name: str, unit: str, numbers: Any, first: int, each: int, gain: float) -> Any:
        facts = {
            "wf_start_time": begun + np.timedelta64(10 * first, "us"),
            "wf_start_offset": 0.0,
            "wf_increment": each * step,
            "unit_string": unit,
        }
        values = gain * (50.0 - 50.0 * np.cos(2.0 * np.pi * 20.0 * step * numbers))
        return nptdms.ChannelObject("g", name, values, properties=facts)

    voltages = number[max(late, 0) :: every] if late >= 0 else np.arange(late, 4000, every)
    path = tmp_path / "loop.tdms"
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([
            channel("deflection", "m", number, 0, 1, 1e-8),
            channel("voltage", "V", voltages, late, every, 1.0),
        ])  # fmt: skip
    found = read_loop(path, Reading({"voltage": "g/voltage", "deflection": "g/deflection"}))
    assert found.deflection == pytest.approx(1e-8 * found.volts, abs=1e-12)
    common = min(5000, voltages[-1]) - max(late, 0)
    assert len(found.volts) == pytest.approx(common / every, abs=1)
    assert any("times of their own" in note for note in found.notes)


def write_uff(path: Path) -> None:
    pyuff = pytest.importorskip("pyuff")
    data = pyuff.prepare_58(
        func_type=1, rsp_node=1, rsp_dir=1, ref_node=1, ref_dir=1, data=X, x=T, id1="runner",
        binary=0, ordinate_spec_data_type=8, ordinate_axis_units_lab="m",
        abscissa_spec_data_type=17, abscissa_axis_units_lab="s", abscissa_inc=STEP,
        orddenom_spec_data_type=0, orddenom_axis_units_lab="NONE",
        z_axis_axis_units_lab="NONE", abscissa_spacing=1, ord_data_type=4,
    )  # fmt: skip
    pyuff.UFF(str(path)).write_sets([data], "overwrite")


def write_lvm(path: Path) -> None:
    """The header of National Instruments' specification; decimal commas, no column of time."""
    head = ["LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab",
            "Decimal_Separator\t,", "Multi_Headings\tNo", "X_Columns\tNo", "Time_Pref\tRelative",
            "***End_of_Header***\t", "\t", "Channels\t1\t", f"Samples\t{COUNT}\t",
            "Y_Unit_Label\tnm\t", "X_Dimension\tTime\t", "X0\t-1,0E-3\t", "Delta_X\t2,5E-5\t",
            "***End_of_Header***\t\t", "X_Value\tRunner\tComment"]  # fmt: skip
    rows = [f"\t{1e9 * x:.3f}".replace(".", ",") for x in X]
    path.write_text("\r\n".join([*head, *rows, ""]), newline="")


#: Suffix, writer, what has to be said, time of the first sample, rounding (m).
FILES: list[tuple[str, Callable[[Path], None], Reading | None, float, float]] = [
    (".npy", write_npy_with_names, None, 0.0, 0.0),
    (".npz", write_npz, Reading({"x": "position"}, {"t": "ms", "x": "nm"}), 0.0, 0.0),
    (".mat", write_mat_of_a_picoscope, Reading(scale={"x": "50nm/V"}), -1e-3, 0.0),
    (".mat", write_mat_of_structs, None, 0.0, 0.0),
    (".mat", write_mat_with_an_object, None, 0.0, 0.0),
    (".mat", write_mat_73, None, 0.0, 0.0),
    (".h5", write_hdf5, None, 0.0, 0.0),
    (".h5", write_hdf5_of_a_keysight, IN_VOLTS, -1e-3, 0.0),
    (".tdms", write_tdms, None, -1e-3, 0.0),
    (".uff", write_uff, None, 0.0, 0.0),
    (".lvm", write_lvm, None, -1e-3, 0.0),
    (".isf", write_isf, IN_VOLTS, -1e-3, 0.51 * ONE * 50e-9),
    (".trc", write_trc, IN_VOLTS, -1e-3, 0.51 * ONE * 50e-9),
    (".wfm", write_tektronix, IN_VOLTS, -1e-3, 0.51 * ONE * 50e-9),
    (".wfm", write_rigol_wfm, IN_VOLTS, -1e-3, 0.51 * COARSE * 50e-9),
    (".bin", write_rigol_bin, IN_VOLTS, -1e-3, 0.0),
    (".bin", write_keysight, IN_VOLTS, -1e-3, 0.0),
]
#: Those that RigolWFM reads.
WAVEFORMS = (".isf", ".trc", ".wfm", ".bin")


@pytest.mark.parametrize(
    ("suffix", "write", "how", "start", "rounding"), FILES, ids=[one[1].__name__ for one in FILES]
)
def test_a_format_is_read(
    suffix: str,
    write: Callable[[Path], None],
    how: Reading | None,
    start: float,
    rounding: float,
    tmp_path: Path,
) -> None:
    if suffix in WAVEFORMS:
        pytest.importorskip("RigolWFM")
    path = tmp_path / f"axis{suffix}"
    write(path)
    before = sorted(tmp_path.iterdir())
    found = read_measurement(path, how=how)
    np.testing.assert_allclose(found.t, start + T, rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(found.x, X, rtol=1e-6, atol=max(rounding, 1e-15))
    assert found.notes == ()
    assert sorted(tmp_path.iterdir()) == before


def options_of(how: Reading | None) -> list[str]:
    """Return what a user writes for a reading on the command line."""
    how = how or Reading()
    given = {"--columns": how.columns, "--units": how.units, "--scale": how.scale}
    words: list[str] = []
    for option, values in given.items():
        if values:
            words += [option, ",".join(f"{key}={value}" for key, value in values.items())]
    return words


@pytest.mark.parametrize(
    "files",
    [[FILES[1], FILES[-1]], pytest.param([FILES[0], *FILES[2:-1]], marks=pytest.mark.long)],
    ids=["two", "all others"],
)
def test_the_command_line_takes_columns_units_and_scales(
    files: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`analyse` finds the steps that are in each file; `compare` sees the same."""
    pytest.importorskip("RigolWFM")
    for suffix, write, how, *_ in files:
        path, given = tmp_path / f"{write.__name__}{suffix}", options_of(how)
        write(path)
        assert main(["analyse", str(path), "--json", "--frequency", "1000", *given]) == 0, path
        (run,) = json.loads(capsys.readouterr().out)["runs"]
        assert (run["steps"], run["direction"]) == (STEPS, 1), path
        assert run["frequency"] == pytest.approx(1000.0, rel=5e-3), path
        assert run["step_size"] == pytest.approx(50e-9 * STEP_SIZE, abs=1.5e-9), path
    arguments = ["compare", str(TYPICAL), str(path), "--set", "frequency=1000", "--json"]
    assert main([*arguments, *given]) == 0
    (seen,) = json.loads(capsys.readouterr().out)["runs"]
    assert seen["steps"] == STEPS


def test_labview_text_is_read_as_by_another_reader(tmp_path: Path) -> None:
    lvm_read = pytest.importorskip("lvm_read")
    path = tmp_path / "axis.lvm"
    write_lvm(path)
    other = lvm_read.read_str(path.read_text())[0]
    np.testing.assert_allclose(read_measurement(path).x, 1e-9 * other["data"][:, 0])


@pytest.mark.parametrize(
    ("suffix", "content", "words"),
    [
        (".trc", lecroy(segments=4), "4 segments with gaps"),
        (".trc", lecroy(along=b"Hz"), "over Hz, not over time"),
        (".trc", lecroy(value=b"A"), "is in A, which is no unit of length"),
        (".trc", lecroy(value=b"V"), "is a voltage.*--scale x=50nm/V"),
        (".trc", lecroy()[:300], "cannot be read"),
        (".wfm", tektronix(frames=3), "3 segments with gaps"),
        (".wfm", tektronix(along=b"Hz"), "over Hz, not over time"),
        (".wfm", tektronix(value=b"A"), "is in A, which is no unit of length"),
        (".wfm", tektronix()[:900], "cannot be read"),
        (".bin", keysight(x_unit=6), "over Hz, not over time"),
        (".bin", keysight(y_unit=4), "is in A, which is no unit of length"),
        (".bin", keysight()[:900], "cannot be read"),
    ],
)
def test_a_waveform_is_not_taken_for_what_it_is_not(
    suffix: str, content: bytes, words: str, tmp_path: Path
) -> None:
    pytest.importorskip("RigolWFM")
    path = tmp_path / f"axis{suffix}"
    path.write_bytes(content)
    with pytest.raises(MeasurementError, match=words):
        read_measurement(path)


@pytest.mark.parametrize(
    ("suffix", "write"), [(".h5", write_hdf5), (".mat", write_mat_73), (".tdms", write_tdms)]
)
def test_numbers_that_are_read_from_a_wrong_byte_on_are_refused(
    suffix: str, write: Callable[[Path], None], tmp_path: Path
) -> None:
    """A byte too many among the samples makes numbers of every size of those behind it."""
    path = tmp_path / f"axis{suffix}"
    write(path)
    whole = path.read_bytes()
    place = whole.index((1e9 * X[50:60]).tobytes())
    path.write_bytes(whole[:place] + b"~" + whole[place:])
    with pytest.raises(MeasurementError, match=r"holds numbers from .* it is damaged"):
        read_measurement(path)


@pytest.mark.parametrize(
    ("name", "content", "cure"),
    [
        ("a.wvf", bytes(2000), "waveforms of Yokogawa cannot be read; export it as CSV"),
        ("a.hdr", b"//YOKOGAWA ASCII FILE FORMAT\r\n\r\n$PublicInfo\r\n", "Yokogawa .*; export"),
        ("a.dat", b"%WDF" + bytes(2000), "Yokogawa .*; export it as CSV"),
        ("a.Wfm.bin", bytes(2000), "Rohde & Schwarz cannot be read; export it as CSV"),
        ("a.bin", b'<?xml version="1.0"?>\n<Database FWVersion="">', "Rohde & Schwarz .*; export"),
        (
            "a.mat",
            b"# Created by Octave 8.4.0, Mon Jan 01 2024 <me@bench>\n# name: x\n# type: matrix\n",
            "Octave's text cannot be read; save it with save -v7",
        ),
    ],
)
def test_what_is_not_read_is_refused_with_the_cure(
    name: str, content: bytes, cure: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(MeasurementError, match=cure):
        read_measurement(path)


def test_a_file_that_is_being_written_says_so(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "axis.h5", "w", libver="latest") as file:
        file["time_s"], file["x_nm"] = T, 1e9 * X
        file.swmr_mode = True
        reading = "import stickslip_ros as ss; ss.read_measurement('axis.h5')"
        said = subprocess.run(
            [sys.executable, "-c", reading], cwd=tmp_path, capture_output=True, text=True
        ).stderr
    assert "axis.h5: it is still open for writing; close the writer" in said


def test_what_is_no_vector_of_numbers_is_left_out_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "axis.npz"
    np.savez(path, time_s=T, x_nm=1e9 * X, about=np.array({"who": "me"}), z=1j * X)
    found = read_measurement(path)
    assert found.x == pytest.approx(X)
    assert found.notes == ("about: objects of Python, not numbers, left out; save float64 arrays",)
    with pytest.raises(MeasurementError, match="3 z holds complex numbers; expected is one real"):
        read_measurement(path, Reading(columns={"x": "z"}))
    np.save(tmp_path / "axis.npy", np.array([None, {}]))
    with pytest.raises(MeasurementError, match=r"no columns of numbers .* its array: objects of"):
        read_measurement(tmp_path / "axis.npy")


@pytest.mark.parametrize("kind", ["u1", "<i2", ">i2"])
def test_a_binary_file_puts_none_of_its_bytes_into_a_message(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "axis.dat"
    for head in (b"", b"time (s),x (nm)\n" + b"0,1\n1,2\n2,3\n" * 3000):
        samples = 180 + 70 * np.sin(0.1 * np.arange(4000))
        path.write_bytes(head + samples.astype(kind).tobytes().replace(b"\n", b""))
        with pytest.raises(MeasurementError) as refused:
            read_measurement(path)
        text = str(refused.value).replace(str(path), "")
        assert text.isascii(), text
        assert not any(name in text for name in ("\\x", "\\u")), text


@pytest.mark.parametrize("unit", ["V", "furlong"])
def test_a_voltage_of_the_actuator_needs_no_scale(unit: str, tmp_path: Path) -> None:
    path = tmp_path / "axis.csv"
    rows = [f"{k},{2 * k},{k % 10}" for k in range(40)]
    path.write_text("\n".join([f"t (ms),x (nm),drive ({unit})", *rows]))
    assert read_measurement(path).voltage is None
    found = read_measurement(path, Reading(columns={"voltage": "drive"}))
    assert found.u is None
    assert found.x[1] == pytest.approx(2e-9)
    part = found.between(0.0105, 0.0125)
    assert part.voltage is not None
    assert part.voltage.tolist() == [1.0, 2.0]


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress, lzma.compress])
def test_packed_text_is_unpacked(pack: Callable[[bytes], bytes], tmp_path: Path) -> None:
    rows = "\n".join(f"{t!r},{1e9 * x!r}" for t, x in zip(T.tolist(), X.tolist(), strict=True))
    path = tmp_path / "axis.csv.packed"
    path.write_bytes(pack(f"time (s),x (nm)\n{rows}\n".encode()))
    assert read_measurement(path).x == pytest.approx(X)
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(MeasurementError, match="cannot be unpacked"):
        read_measurement(path)


def write_bag(path: Path, ros: int, storage: str = "") -> None:
    """A laser that measures a range, and joints, as rosbags writes them."""
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if ros == 1 else typesys.Stores.LATEST)
    kinds = store.types
    header, stamp = kinds["std_msgs/msg/Header"], kinds["builtin_interfaces/msg/Time"]
    joints, laser = kinds["sensor_msgs/msg/JointState"], kinds["sensor_msgs/msg/Range"]

    def fill(writer: Any) -> None:
        topics = {
            kind: writer.add_connection(name, kind.__msgtype__, typestore=store)
            for name, kind in (("/joint_states", joints), ("/laser", laser))
        }
        for t, x in zip(T.tolist(), X.tolist(), strict=True):
            ns = 1_700_000_000_000_000_000 + round(1e9 * t)
            told = [stamp(ns // 10**9, ns % 10**9), "bench"]
            first = header(0, *told) if ros == 1 else header(*told)
            messages = [
                joints(first, ["axis_slider", "axis_piezo"], np.array([x, 2 * x]),
                       np.empty(0), np.empty(0)),
                laser(first, 0, 0.0, 0.0, 1.0, x, *([] if ros == 1 else [0.0])),
            ]  # fmt: skip
            for kind, message in zip((joints, laser), messages, strict=True):
                serialize = store.serialize_ros1 if ros == 1 else store.serialize_cdr
                writer.write(topics[kind], ns + 500, serialize(message, kind.__msgtype__))

    if ros == 1:
        from rosbags.rosbag1 import Writer

        with Writer(path) as writer:
            fill(writer)
        return
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2

    with Writer2(path, version=9, storage_plugin=StoragePlugin[storage]) as writer2:
        fill(writer2)


def test_bags_of_others_are_read(tmp_path: Path) -> None:
    """The slider by itself; any other number of any topic by its path."""
    for name, ros, storage in [("axis.bag", 1, ""), ("sqlite", 2, "SQLITE3"), ("mcap", 2, "MCAP")]:
        path = tmp_path / name
        write_bag(path, ros, storage)
        found = load_motion(path)
        assert found.motion.t == pytest.approx(T, abs=1e-9)
        assert found.motion.x == pytest.approx(X, abs=1e-16)
        assert found.motion.u == pytest.approx(2 * X, abs=1e-16)
        later = load_motion(path, origin_ns=1_699_999_999_000_000_000)
        assert later.motion.t[0] == pytest.approx(1.0, abs=2e-6)
        laser = load_motion(path, Reading(columns={"x": "/laser/range"}))
        assert laser.motion.x == pytest.approx(X, rel=1e-7, abs=1e-14)  # a float32
        with pytest.raises(MeasurementError, match=r"no column '/laser/nix'; the columns are: .*"):
            load_motion(path, Reading(columns={"x": "/laser/nix"}))


def test_a_type_that_cannot_be_parsed_is_passed_over_quietly(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """ROS 1 allowed names of fields that ROS 2 does not."""
    typesys = pytest.importorskip("rosbags.typesys")
    from rosbags.rosbag1 import Writer

    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
    store.register(typesys.get_types_from_msg("float64 m_Odd\n", "axis_msgs/msg/Odd"))
    path = tmp_path / "axis.bag"
    with Writer(path) as writer:
        topic = writer.add_connection("/odd", "axis_msgs/msg/Odd", typestore=store)
        odd = store.types["axis_msgs/msg/Odd"](1.0)
        writer.write(topic, 1_000_000_000, store.serialize_ros1(odd, odd.__msgtype__))
    with pytest.raises(MeasurementError, match="it holds no messages with numbers"):
        load_motion(path)
    assert capfd.readouterr().err == ""


def test_a_bag_without_joints_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "axis.bag"
    write_bag(path, 1)
    with pytest.raises(MeasurementError, match="no joint 'knee'; there are: axis_piezo"):
        load_motion(path, joint="knee")

    def chosen(*columns: tuple[str, int]) -> str | None:
        held = [Column(f"{name}/position", "m", number=k, length=length)
                for k, (name, length) in enumerate(columns, 1)]  # fmt: skip
        return joint_columns(Table(held, lambda wanted: Loaded([])), None).get("x")

    assert chosen(("/states/knee", 9)) == "/states/knee/position"
    assert chosen(("/states/knee", 9), ("/states/hip", 9)) is None
    assert chosen(("/a/x_slider", 9), ("/b/x_slider", 9)) == "/a/x_slider/position"
    assert chosen(("/a/x_slider", 8), ("/b/x_slider", 9)) == "/b/x_slider/position"
    with pytest.raises(
        MeasurementError, match="has x_slider, y_slider; name one: --joint x_slider"
    ):
        chosen(("/a/x_slider", 9), ("/a/y_slider", 9))


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_a_loop_is_read_from_any_format(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"loop{suffix}"
    if suffix == ".npz":
        np.savez(path, time_s=T, voltage_V=VOLTS, deflection_nm=1e9 * X)
        how = Reading(columns={"voltage": "voltage_V"}, units={"voltage": "V"})
    else:
        rows = np.column_stack([T, 1e3 * VOLTS, 1e6 * X])
        head = "time (s),drive (mV),deflection (um)"
        np.savetxt(path, rows, delimiter=",", header=head, fmt="%.17g")
        how = Reading()
    found = read_loop(path, how)
    np.testing.assert_allclose(found.volts, VOLTS, rtol=1e-12)
    np.testing.assert_allclose(found.deflection, X, rtol=1e-12)
    if suffix == ".csv":
        rated = read_loop(path, Reading(rate=100.0)).times
        assert found.times is not None
        assert rated is not None
        np.testing.assert_allclose(found.times, T, rtol=1e-12)
        np.testing.assert_allclose(rated, np.arange(len(T)) / 100.0, rtol=1e-12)


def test_a_loop_without_units_has_to_be_of_a_size_that_is_possible(tmp_path: Path) -> None:
    path = tmp_path / "loop.csv"
    np.savetxt(path, np.column_stack([VOLTS, 1e9 * X]), delimiter=",")
    with pytest.raises(MeasurementError, match="--units deflection=um"):
        read_loop(path)
    found = read_loop(path, Reading(units={"deflection": "nm"}))
    np.testing.assert_allclose(found.deflection, X, rtol=1e-12)
    assert found.times is None
