# SPDX-License-Identifier: Apache-2.0
"""Broken files of every format: an error in our words, or samples that are those of the whole file.

Bytes are changed, cut out, put in, doubled and cut off. Some damage nobody can see: another digit
in a number, another bit in a sample. It touches few samples; more has to be refused or told.
``STICKSLIP_MUTATIONS=5000`` breaks each format as often (with MATLAB's, half a second each).
"""

import gzip
import os
import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from test_formats import FILES, WAVEFORMS, T, X, write_bag
from waveform_files import COUNT

from stickslip_ros.measurement.bags.load_motion import load_motion
from stickslip_ros.measurement.reading import MeasurementError, Reading
from stickslip_ros.recordings import BagError
from stickslip_ros.simulation.motion import Motion

TIMES = int(os.environ.get("STICKSLIP_MUTATIONS", "0"))
#: Samples that one piece of damage may change unseen: a doubled or a cut line at both its ends.
_UNSEEN = 4


def write_csv(path: Path) -> None:
    rows = [f"{t:.6f},{1e9 * x:.3f}" for t, x in zip(T.tolist(), X.tolist(), strict=True)]
    path.write_text("\n".join(["time (s),x (nm)", *rows, ""]))


def write_german_csv(path: Path) -> None:
    rows = [f"{1e3 * t:.6f};{1e9 * x:.3f}" for t, x in zip(T.tolist(), X.tolist(), strict=True)]
    path.write_text("\n".join(["Zeit [ms];Weg [nm]", *rows, ""]).replace(".", ","))


def write_numbered_csv(path: Path) -> None:
    rows = [f"{k},{1e9 * x:.3f}," for k, x in enumerate(X.tolist())]
    head = ["X,CH1,Start,Increment,", "Sequence,Volt,0.0,2.5e-05"]
    path.write_text("\n".join([*head, *rows, ""]))


def write_packed_csv(path: Path) -> None:
    write_csv(path)
    path.write_bytes(gzip.compress(path.read_bytes(), mtime=0))


def write_ros1(path: Path) -> None:
    write_bag(path, 1)


#: Suffix, writer, what has to be said, whether damage in text shows in the line that has it.
WHOLE: list[tuple[str, Callable[[Path], None], Reading | None, bool]] = [
    (".csv", write_csv, None, True),
    (".csv", write_german_csv, None, True),
    (".csv", write_numbered_csv, Reading(scale={"x": "1nm/V"}), True),
    (".csv.gz", write_packed_csv, None, False),
    (".bag", write_ros1, None, False),
    *((one[0], one[1], one[2], False) for one in FILES),
]


def broken(whole: bytes, chance: random.Random) -> bytes:
    """One piece of damage."""
    content = bytearray(whole)
    spread = len(content) if chance.random() < 0.6 else min(len(content), 600)
    place = chance.randrange(spread)
    match chance.randrange(6):
        case 0:
            content[place] = chance.randrange(256)
        case 1:
            content[place] ^= 1 << chance.randrange(8)
        case 2:
            del content[place : place + chance.choice((1, 2, 7, 50, 1000))]
        case 3:
            content[place:place] = chance.randbytes(chance.choice((1, 4, 40)))
        case 4:
            del content[place:]
        case _:
            content[place:place] = content[place : place + chance.randrange(1, 300)]
    return bytes(content)


def unlike(found: Motion, whole: Motion) -> int:
    """Samples that are none of the whole file."""
    near = np.clip(np.searchsorted(whole.t, found.t - 0.5 * whole.spacing), 0, len(whole.t) - 1)
    same = np.abs(whole.t[near] - found.t) < 1e-9
    return int((~(same & (np.abs(whole.x[near] - found.x) < 1e-14))).sum())


@pytest.mark.parametrize(
    ("suffix", "write", "how", "by_line"), WHOLE, ids=[one[1].__name__ for one in WHOLE]
)
def test_a_broken_file_is_refused_or_read_as_far_as_it_is_whole(
    suffix: str, write: Callable[[Path], None], how: Reading | None, by_line: bool, tmp_path: Path
) -> None:
    if suffix in WAVEFORMS:
        pytest.importorskip("RigolWFM")
    path = tmp_path / f"axis{suffix}"
    write(path)
    content, whole = path.read_bytes(), load_motion(path, how=how).motion
    assert len(whole.t) == COUNT
    chance = random.Random(5)
    times = TIMES or (3 if suffix == ".mat" else 20)
    refused = 0
    for _ in range(times):
        path.write_bytes(broken(content, chance))
        try:
            found = load_motion(path, how=how).motion
        except (MeasurementError, BagError) as error:
            refused += 1
            assert str(path.name) in str(error)
            continue
        assert np.isfinite(found.x).all()
        assert (np.diff(found.t) > 0.0).all()
        if by_line and len(found.t) > 0.5 * COUNT:
            scaled = abs(found.spacing - whole.spacing) > 1e-9 or found.t[0] != whole.t[0]
            header_changed = content[:60] not in path.read_bytes()
            assert unlike(found, whole) <= _UNSEEN or (header_changed and scaled)
    assert refused
