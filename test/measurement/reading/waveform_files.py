# SPDX-License-Identifier: Apache-2.0
"""Oscilloscopes' own files, byte by byte as their makers' manuals have them.

Offsets and codes are those of: Tektronix, Reference Waveform File Format (077-0220) and the
preamble of `.isf`; LeCroy, template LECROY_2_3; Keysight, InfiniiVision User's Guide, "Binary Data
(.bin) Format"; Rigol, MSO5000 User Guide, the same with another mark. Of Rigol's `.wfm` there is
only what users found. Neither the package nor the library that it reads them with takes part.
"""

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

STEPS, STEP_SIZE = 6, 2.6  #: of the motion in each file; V
COUNT, STEP, START = 320, 25e-6, -1e-3


def _stepping() -> NDArray[np.float64]:
    """Rest, cycles of 1 ms that rise and fall back a little with a ringing, rest; noise; V."""
    t = 1e3 * (START + STEP * np.arange(COUNT))
    done, within = np.divmod(np.clip(t, 0.0, STEPS - 1e-9), 1.0)
    since = np.where(done > 0, within, 0.0) + np.maximum(t - STEPS, 0.0)
    ringing = np.where(t > 1.0, 0.3 * np.exp(-since / 0.1) * np.cos(50.0 * since), 0.0)
    rises = np.where(t < STEPS, (STEP_SIZE + 0.6) * within, STEP_SIZE)
    noise = np.random.default_rng(1).normal(0.0, 0.02, COUNT)
    return np.asarray(np.round(STEP_SIZE * done + rises + ringing + noise, 3))


VOLTS = _stepping()
#: Volts that one of a whole number stands for, with 16 and with 8 bits.
ONE, COARSE = 1e-3, 0.14
CODES = np.round(VOLTS / ONE).astype("<i2")


def _at(size: int, *fields: tuple[int, str, object]) -> bytes:
    """Bytes with fields at their places; all others are 0."""
    block = bytearray(size)
    for place, form, value in fields:
        struct.pack_into(form, block, place, value)
    return bytes(block)


def write_isf(path: Path) -> None:
    """Tektronix's preamble, then a block of 16 bit samples, the high byte first."""
    head = (
        f':WFMP:BYT_N 2;BIT_N 16;ENC BIN;BN_F RI;BYT_O MSB;NR_P {COUNT};WFI "Ch1";PT_F Y;'
        f'XUN "s";XIN {STEP};XZE {START};PT_O 0;YUN "V";YMU {ONE};YOF 0.0;YZE 0.0;:CURV '
    )
    block = CODES.astype(">i2").tobytes()
    path.write_bytes(f"{head}#{len(str(len(block)))}{len(block)}".encode() + block)


def lecroy(segments: int = 1, along: bytes = b"S", value: bytes = b"V") -> bytes:
    """A trace, the low byte first."""
    described = _at(
        346, (0, "8s", b"WAVEDESC"), (16, "10s", b"LECROY_2_3"), (32, "<h", 1), (34, "<h", 1),
        (36, "<i", 346), (60, "<i", CODES.nbytes), (76, "8s", b"LECROYHD"), (116, "<i", COUNT),
        (120, "<i", COUNT), (128, "<i", COUNT - 1), (136, "<i", 1), (144, "<i", segments),
        (148, "<i", 1), (156, "<f", ONE), (160, "<f", 0.0), (164, "<f", 32000.0),
        (168, "<f", -32000.0), (176, "<f", STEP), (180, "<d", START), (196, "48s", value),
        (244, "48s", along), (328, "<f", 1.0), (334, "<f", 1.0),
    )  # fmt: skip
    return described + CODES.tobytes()


def write_trc(path: Path) -> None:
    path.write_bytes(lecroy())


def tektronix(frames: int = 1, along: bytes = b"s", value: bytes = b"V") -> bytes:
    """Version 3, the low byte first; beside the samples are 16 more before and after."""
    size, beside = 838, 16
    codes = np.pad(CODES, beside, mode="edge")
    head = _at(
        size, (0, "<H", 0x0F0F), (2, "8s", b":WFM#003"), (10, "B", 4),
        (11, "<i", size - 15 + codes.nbytes + 8), (15, "B", 2), (16, "<i", size),
        (72, "<I", frames - 1), (76, "<H", size - 78), (78, "<i", int(frames > 1)), (82, "<I", 1),
        (114, "<I", 1), (118, "<I", 1), (122, "<i", 2), (142, "<I", 1),
        # the values, 16 bits each
        (168, "<d", ONE), (176, "<d", 0.0), (184, "<I", 65536), (188, "20s", value),
        (240, "<i", 0), (268, "<d", 1.0), (276, "20s", value), (400, "<i", 6),
        # the times
        (488, "<d", STEP), (496, "<d", START), (504, "<I", COUNT), (508, "20s", along),
        (564, "<d", 1.0), (572, "20s", along), (600, "<d", 1.0), (768, "<i", 0),
        # where the samples lie
        (818, "<I", 0), (822, "<I", 2 * beside), (826, "<I", 2 * (beside + COUNT)),
        (830, "<I", codes.nbytes), (834, "<I", codes.nbytes),
    )  # fmt: skip
    whole = head + codes.tobytes()
    return whole + struct.pack("<Q", sum(whole))


def write_tektronix(path: Path) -> None:
    path.write_bytes(tektronix())


def keysight(mark: bytes = b"AG10", x_unit: int = 2, y_unit: int = 1) -> bytes:
    """One waveform of single precision."""
    data = VOLTS.astype("<f4").tobytes()
    described = _at(
        140, (0, "<i", 140), (4, "<i", 1), (8, "<i", 1), (12, "<i", COUNT), (20, "<f", 5e-3),
        (24, "<d", START), (32, "<d", STEP), (40, "<d", START), (48, "<i", x_unit),
        (52, "<i", y_unit), (56, "16s", b"22 NOV 2026"), (72, "16s", b"11:00:00:00"),
        (88, "24s", b"DSO:MY12345678"), (112, "16s", b"1"),
    )  # fmt: skip
    buffer = _at(12, (0, "<i", 12), (4, "<h", 1), (6, "<h", 4), (8, "<i", len(data)))
    size = 12 + len(described) + len(buffer) + len(data)
    return _at(12, (0, "4s", mark), (4, "<i", size), (8, "<i", 1)) + described + buffer + data


def write_keysight(path: Path) -> None:
    path.write_bytes(keysight())


def write_rigol_bin(path: Path) -> None:
    """What an MSO5000 saves; it counts its start from the left, so that the sign is the other."""
    whole = bytearray(keysight(b"RG01"))
    struct.pack_into("<d", whole, 12 + 40, -START)
    path.write_bytes(whole)


def write_rigol_wfm(path: Path) -> None:
    """What a DS1000E saves: 8 bits, 25 a division, downwards from 125; times about the middle."""
    offset = round(1e12 * (START + 0.5 * COUNT * STEP))  # ps
    head = _at(
        276, (0, "<I", 0xA5A5), (28, "<I", COUNT), (32, "B", 1),
        (36, "<i", round(25e6 * COARSE)), (44, "<f", 1.0), (49, "B", 1),
        (52, "<i", round(25e6 * COARSE)),
        (84, "<q", 10**9), (92, "<q", offset), (100, "<f", 1.0 / STEP), (104, "<q", 10**9),
        (112, "<q", offset),
    )  # fmt: skip
    path.write_bytes(head + np.round(125.0 - VOLTS / COARSE).astype("u1").tobytes())
