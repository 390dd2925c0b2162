# SPDX-License-Identifier: Apache-2.0
"""Text as instruments and programs of many makers write it, by what their files look like."""

from pathlib import Path

import numpy as np
import pytest

from stickslip_ros.measurement.reading import MeasurementError, Reading, read_measurement

COUNT, START, STEP = 40, -2e-4, 1e-5
T = START + STEP * np.arange(COUNT)
VOLTS = np.round(0.01 * np.arange(COUNT) ** 1.5, 3)
IN_VOLTS = Reading(scale={"x": "50nm/V"})
CH1 = Reading(columns={"x": "CH1"}, scale={"x": "50nm/V"})


def rows(form: str, end: str = "\n", decimal: str = ".", count: int = COUNT) -> str:
    lines = [
        form.format(k=k, t=t, ms=1e3 * t, us=1e6 * t, v=v, mv=1e3 * v, nm=50 * v).replace(
            "." if decimal == "," else "\0", decimal
        )
        for k, (t, v) in enumerate(zip(T.tolist(), VOLTS.tolist(), strict=True))
    ][:count]
    return end.join(lines) + end


_TEK_KEYS = [
    "Record Length,4.0e+01", "Sample Interval,1.0e-05", "Trigger Point,2.0e+01", "Source,CH1",
    "Vertical Units,V", "Vertical Scale,1.0e+00", "Horizontal Units,s", "Pt Fmt,Y",
]  # fmt: skip
#: An old Tektronix has its settings beside the first samples.
_OLD_TEK = "\r\n".join(
    f"{_TEK_KEYS[k] if k < len(_TEK_KEYS) else ','},,{t:.6f},{v:.3f},"
    for k, (t, v) in enumerate(zip(T.tolist(), VOLTS.tolist(), strict=True))
)
_LVM_HEAD = "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\n***End_of_Header***\t\n\n"

#: Dialect, text, what has to be said.
DIALECTS: list[tuple[str, str, Reading | None]] = [
    ("Rigol, samples numbered",
        "X,CH1,Start,Increment,\nSequence,Volt,-2.0E-04,1.0E-05\n" + rows("{k},{v:.3f},"),
        IN_VOLTS),
    ("Rigol, two channels",
        "X,CH1,CH2,Start,Increment\nSequence,Volt,Volt,-2.0E-04,1.0E-05\n" + rows("{k},{v:.3f},9"),
        CH1),
    ("Rigol, MSO5000", "CH1V, t0 =-2.0E-04s, tInc = 1.0E-05s,\n" + rows("{v:.3f},"), IN_VOLTS),
    ("Rigol, DS2000", "Time(s),CH1(V)\n" + rows("{t:.6f},{v:.3f}"), IN_VOLTS),
    ("Tektronix, new", "Model,MDO34\nFirmware Version,1.2\n\nWaveform Type,ANALOG\nPoint Format,Y\n"
        "Horizontal Units,s\nSample Interval,1e-05\nRecord Length,40\nVertical Units,V\n"
        "Vertical Scale,10\n\n\nLabel,\nTIME,CH1\n" + rows("{t:.6e},{v:.3f}"), IN_VOLTS),
    ("Tektronix, old", _OLD_TEK, IN_VOLTS),
    ("Keysight", "x-axis,1\nsecond,Volt\n" + rows("{t:+.6E},{v:+.3E}"), IN_VOLTS),
    ("Keysight, two channels, the first sample missing",
        "x-axis,1,2\nsecond,Volt,Volt\n-210.0E-06,,\n" + rows("{t:+.6E},{v:+.3E},+1.0E+00"),
        Reading(columns={"x": "1"}, scale={"x": "50nm/V"})),
    ("Infiniium",
        "Revision: 0\nType: raw\nPoints: 40\nXInc: 1.0E-05\nXOrg: -2.0E-04\nXUnits: Second\n"
        "YUnits: Volt\nData:\n" + rows("{v:.3f}"), IN_VOLTS),
    ("LeCroy", "LECROYWS24Xs,21529,Waveform\nSegments,1,SegmentSize,40\n"
        "Segment,TrigTime,TimeSinceSegment1\n#1,06-May-2025 17:27:01,0\nTime,Ampl\n"
        + rows("{t:.6f},{v:.3f}"), IN_VOLTS),
    ("Rohde & Schwarz, RTB", "in s,C1 in V\n" + rows("{t:.6E},{v:.3E}"), IN_VOLTS),
    ("Siglent", "Record Length,Analog:40\nSample Interval,CH1:0.00001\nVertical Units,CH1:V\n"
        "Horizontal Units,s\nSource,CH1\nSecond,Volt\n" + rows("{t:.6f},{v:.3f}"), IN_VOLTS),
    ("Yokogawa",
        '"Model","Xviewer"\n"TraceName","CH1",\nBlockSize,40,\nVUnit,V,\nHResolution,1.0e-05,\n'
        "HOffset,-2.0e-04,\nHUnit,s,\n" + rows(",{v:.3f}"), IN_VOLTS),
    ("PicoScope", "Time,Channel A\n(ms),(mV)\n\n" + rows("{ms:.6f},{mv:.3f}"), IN_VOLTS),
    ("PicoScope, beyond its range",
        "Time;Channel A\n(us);(mV)\n\n-210,0;∞\n" + rows("{us:.4f};{mv:.3f}", decimal=","),
        IN_VOLTS),
    ("PicoScope 7, German", "Zeit;Kanal A\n(ms);(mV)\n\n" + rows("{ms:.8f};{mv:.8f}", decimal=","),
     IN_VOLTS),
    ("Saleae Logic 2", "Time [s],Channel 0\n" + rows("{t:.9f},{v:.4f}"), IN_VOLTS),
    ("Digilent WaveForms",
        "#Digilent WaveForms Oscilloscope Acquisition\n#Device Name: Discovery2\n"
        "#Serial Number: SN:210321A3C1F9\n#Date Time: 2026-09-28 00:00:00.000.000.000\n"
        "#Sample rate: 100000Hz\n#Samples: 40\n#Trigger: Source: Channel 1 Type: Edge Condition: "
        "Rise Level: 1 V Hysteresis: 10 mV HoldOff: 0 s\n#Channel 1: Range: 500 mV/div Offset: -1 V"
        "\n\nTime (s),Channel 1 (V),Channel 2 (V)\n" + rows("{t:.6e},{v:.6f},0.1"),
        Reading(columns={"x": "Channel 1"}, scale={"x": "50nm/V"})),
    ("Polytec", "Source File Name:\tC:\\scan.svd\nPoint Index:\t1\nSignal:\tVib ; Displacement\n\n"
        "Time\tDisplacement\n[ s ]\t[ nm ]\n" + rows("{t:.6E}\t{nm:.4f}", end="\r\n"), None),
    ("PlotJuggler", "__time,/joint_states/axis/position,/other/data\n"
        + rows("{t:.6f},{nm:.4f},\n{t:.7f}5,,1.0"),
        Reading(columns={"x": "/joint_states/axis/position"}, units={"x": "nm"})),
    ("LabVIEW, a time beside each channel",
        f"{_LVM_HEAD}Channels\t2\t\t\t\nY_Unit_Label\tVolts\t\tVolts\n***End_of_Header***\n"
        "X_Value\tA\tX_Value\tB\tComment\n" + rows("{t:.6f}\t9\t{t:.6f}\t{v:.3f}"),
        Reading(columns={"x": "B"}, units={"t": "s"}, scale={"x": "50nm/V"})),
    ("MATLAB's own", rows("   {t:.7e}   {v:.7e}"),
        Reading(units={"t": "s"}, scale={"x": "50nm/V"})),
    ("printed by NumPy 2", "t (s), x (nm)\n" + rows("(np.float64({t:.6f}), np.float64({nm:.4f}))"),
        None),
    ("quoted, decimal commas", '"t (ms)", "x (nm)"\n' + rows('"{ms:.6f}", "{nm:.4f}"', decimal=","),
        None),
    ("quoted, between blanks", '"t(s)" "x(nm)"\n' + rows('"{t:.6f}" "{nm:.4f}"'), None),
    ("thousands", "t (us);x (nm)\n" + rows("{us:,.4f};{nm:,.4f}"), None),
    ("a clock on the wall", "stamp;x (nm)\n" + "".join(
            ("2024-05-31 23:59:59" if t < -1e-9 else "2024-06-01 00:00:00")
            + f".{round(1e6 * t) % 1_000_000:06d};{50 * v:.4f}\n"
            for t, v in zip(T.tolist(), VOLTS.tolist(), strict=True)
        ), None),
    ("a clock on the wall, the date beside it", "Datum;Uhrzeit;Position (nm)\n" + "".join(
            ("31.05.2024;23:59:59" if t < -1e-9 else "01.06.2024;00:00:00")
            + f",{round(1e6 * t) % 1_000_000:06d};{50 * v:.4f}\n".replace(".", ",")
            for t, v in zip(T.tolist(), VOLTS.tolist(), strict=True)
        ), None),
    ("since 1970", "t (s),x (nm)\n" + rows("1700000000.{k:03d},{nm:.4f}"), None),
    ("a long preamble",
        "remark,of,a,logger,1\n" * 3000 + "t (us),x (nm)\n" + rows("{us:.3f},{nm:.4f}"), None),
]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "how"), [one[1:] for one in DIALECTS], ids=[one[0] for one in DIALECTS]
)
def test_a_dialect_is_understood(text: str, how: Reading | None, tmp_path: Path) -> None:
    path = tmp_path / "axis.txt"
    path.write_text(text, encoding="utf-8", newline="")
    found = read_measurement(path, how=how)
    t = T
    if "23:59:59" in text:
        t = T - T[0]  # counts from the first row
    elif "1700000000." in text:
        t = 1e-3 * np.arange(COUNT)
    near = 3e-7 if "1700000000." in text else 1e-10  # as many digits as the number of the date has
    assert found.t == pytest.approx(t, rel=0.0, abs=near)
    assert found.x == pytest.approx(50e-9 * VOLTS, rel=1e-9, abs=1e-16)


def test_what_a_dialect_leaves_open_is_asked(tmp_path: Path) -> None:
    for text, words in [
        (DIALECTS[1][1], ["which column is the position?", "--columns x=CH1", "--scale x=50nm/V"]),
        (rows("{v:.3f}"), ["no column of time", "--rate 10kHz", "--units x=nm"]),
        ("Sample,x (nm)\n" + rows("{k},{v:.3f}"), ["no column of time", "--rate 10kHz"]),
        ("TIME,CH1\n" + rows("{t:.6f},{v:.3f}"), ["--units t=ms,x=nm", "1 | TIME,CH1"]),
        (
            "X,CH1,Start,Increment,\nSequence,Volt,soon,1.0E-05\n" + rows("{k},{v:.3f},"),
            ["no column of time"],
        ),
        (
            "X,CH1,C\nStart,Increment,\nSequence,Volt,0.0,1.0E-05\n" + rows("{k},{v:.3f},"),
            ["which column is the position?", "--columns x=CH1"],
        ),
        (
            "Points: 41\nXInc: 1.0E-05\nYUnits: nm\n" + rows("{v:.3f}"),
            ["states 41 samples and has 40", "--rows 1:40"],
        ),
        (
            "XInc: 1.0E-05\nYUnits: nm\n" + rows("{v:.3f}") + "again\n" + rows("{v:.3f}"),
            ["before line 44", "--rows 1:40 or --rows 41:"],
        ),
        (
            "t (s),x (nm)\n" + rows("1700000000.{k:09d},{nm:.4f}"),
            ["have more digits than a number holds", "take the first one from all", "--rate"],
        ),
        ("t (s),x (um),x (um)\n" + rows("{t:.6f},{v},{v}"), ["2 columns are named 'x'", "2, 3"]),
    ]:
        path = tmp_path / "axis.csv"
        path.write_text(text, encoding="utf-8")
        how = Reading(columns={"x": "x"}) if "x (um),x" in text else None
        with pytest.raises(MeasurementError) as error:
            read_measurement(path, how=how)
        for word in [str(path), *words]:
            assert word in str(error.value)


def test_a_unit_that_contradicts_the_file_is_used_with_a_note(tmp_path: Path) -> None:
    path = tmp_path / "axis.csv"
    path.write_text("Zeit in us;x (nm)\n" + rows("{us:.3f};{nm:.4f}"))
    assert read_measurement(path, how=Reading(units={"t": "us", "x": "nanometers"})).notes == ()
    found = read_measurement(path, how=Reading(units={"t": "ms", "x": "nm"}))
    assert found.t == pytest.approx(1e3 * T)
    assert found.notes == ("the header says us; --units t=ms is used",)


def test_samples_are_placed_by_their_number(tmp_path: Path) -> None:
    """Whichever are missing."""
    path = tmp_path / "axis.csv"
    head = "X,CH1,Start,Increment,\nSequence,Volt,-2.0E-04,1.0E-05\n"
    lines = rows("{k},{v:.3f},").splitlines()
    path.write_text(head + "\n".join(lines[3:10] + lines[12:]) + "\n")
    found = read_measurement(path, how=IN_VOLTS)
    kept = [*range(3, 10), *range(12, COUNT)]
    assert found.t == pytest.approx(T[kept])
    assert found.x == pytest.approx(50e-9 * VOLTS[kept])


def test_a_labview_channel_of_another_rate_has_its_own_times(tmp_path: Path) -> None:
    """The column of times is that of the first channel."""
    keys = ["Delta_X\t1.0E-5\t1.0E-3\t", "X0\t-2.0E-4\t5.0E-1\t", "Y_Unit_Label\tV\tnm\t"]
    lines = rows("{t:.6f}\t{v:.3f}\t{nm:.4f}").splitlines()
    lines[20:] = [line.rpartition("\t")[0] + "\t" for line in lines[20:]]  # it has fewer samples
    head = [*keys, "***End_of_Header***\t", "X_Value\tfast\tslow\tComment"]
    path = tmp_path / "axis.lvm"
    path.write_text(_LVM_HEAD + "\n".join([*head, *lines]) + "\n")
    slow = read_measurement(path)
    assert slow.t == pytest.approx(0.5 + 1e-3 * np.arange(20))
    assert slow.x == pytest.approx(50e-9 * VOLTS[:20])
    how = Reading(columns={"x": "fast"}, scale={"x": "50nm/V"}, units={"t": "s"})
    fast = read_measurement(path, how=how)
    assert fast.t == pytest.approx(T)
    assert fast.x == pytest.approx(50e-9 * VOLTS)


def test_even_times_that_were_rounded_are_even_again(tmp_path: Path) -> None:
    path = tmp_path / "axis.csv"
    t = 1e-7 * np.arange(500) + 0.01
    path.write_text("t (s),x (nm)\n" + "".join(f"{s:.6f},{k}\n" for k, s in enumerate(t)))
    found = read_measurement(path)
    assert found.t == pytest.approx(t, rel=0.0, abs=2e-7)
    assert found.spacing == pytest.approx(1e-7, rel=2e-3)
    assert "rounded" in found.notes[0]


def test_an_export_of_two_files(tmp_path: Path) -> None:
    """Rohde & Schwarz describe the numbers in a file beside them; either may be named."""
    facts = {"XStart": START, "SignalResolution": STEP, "BaseUnit": "V", "Source": "Ch1Wfm1",
             "MultiChannelExport": "Off", "NumberOfAcquisitions": 1,
             "SignalRecordLength": COUNT}  # fmt: skip
    described = tmp_path / "axis.csv"
    described.write_text("".join(f"{key}:{value}:\n" for key, value in facts.items()))
    numbers = tmp_path / "axis.Wfm.csv"
    for text in (rows("{v:.3f}"), rows("{t:.6f},{v:.3f}")):
        numbers.write_text(text)
        for path in (described, numbers):
            found = read_measurement(path, how=IN_VOLTS)
            assert found.t == pytest.approx(T, abs=1e-12)
            assert found.x == pytest.approx(50e-9 * VOLTS)


def test_sign_angle_and_scale(tmp_path: Path) -> None:
    path = tmp_path / "axis.csv"
    path.write_text("t (s),x (nm)\n" + rows("{t:.6f},{nm:.4f}"))
    turned = read_measurement(path, how=Reading(scale={"x": "-1"}, angle=np.radians(60.0)))
    assert turned.x == pytest.approx(-2.0 * 50e-9 * VOLTS)
    for scale, words in (("50nm/V", "but the scale is per voltage"), ("2um", "say per what")):
        with pytest.raises(MeasurementError, match=words):
            read_measurement(path, how=Reading(scale={"x": scale}))


def test_a_setting_in_the_header_is_no_unit(tmp_path: Path) -> None:
    """``voltbase=500000(uV)`` is how the scope was set; its samples are not in uV."""
    path = tmp_path / "axis.csv"
    two, one = rows("{t:.6f},{v:.3f}"), "time(s),#voltbase=500000(uV)\n"
    settings = "#CLOCK=2.50uS\n#timebase=100(us),#voltbase=500000(uV)\n"
    for text, asked in ((one, r"column 2 .* states no unit"), (settings, "states no unit")):
        path.write_text(text + two)
        with pytest.raises(MeasurementError, match=asked):
            read_measurement(path)
        with pytest.raises(MeasurementError, match=r"column 2 .* states no unit"):
            read_measurement(path, how=Reading(units={"t": "s"}, scale={"x": "3"}))
        how = Reading(
            columns={"t": "1", "x": "2"}, units={"t": "s", "x": "V"}, scale=IN_VOLTS.scale
        )
        assert read_measurement(path, how=how).x == pytest.approx(50e-9 * VOLTS)


def test_labview_over_time_knows_its_seconds(tmp_path: Path) -> None:
    path = tmp_path / "axis.lvm"
    for dimension, known in (("Time", True), ("Frequency", False)):
        head = f"X_Dimension\t{dimension}\nY_Unit_Label\tnm\n***End_of_Header***\nX_Value\tA\n"
        path.write_text(_LVM_HEAD + head + rows("{t:.6f}\t{nm:.4f}"))
        if known:
            assert read_measurement(path).t == pytest.approx(T)
        else:
            with pytest.raises(MeasurementError, match=r"X_Value .* states no unit"):
                read_measurement(path)
