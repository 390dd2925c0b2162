# SPDX-License-Identifier: Apache-2.0
"""Files of every format that is read, with hostile contents: read, or refused in one line.

Damage to whole files is in ``test_broken_files`` and `hostile_bags`; here the contents are built
from the grammar of each format, or are bytes of anything.
"""

import io
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from hypothesis import strategies as some
from hypothesis.strategies import SearchStrategy

from stickslip_ros.base.errors import StickslipError
from stickslip_ros.measurement.bags.load_motion import load_motion
from stickslip_ros.measurement.reading import MeasurementError
from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.parameters import PARAMETERS, Parameters, read_yaml
from stickslip_ros.recordings import open_bag
from validation.campaigns.hostile_messages import search

LONGEST = 2.0  # s of computing for one file

CELLS = (
    "", "0", "1", "-1", "1e-9", "0.001", "1e999", "nan", "inf", "-", "1,5", "1.2.3", "0x1",
    "time (s)", "x (nm)", "Zeit [ms]", "#", '"', "'", "\0", "ä", "9" * 400, "True", "12:30",
)  # fmt: skip


def _yaml_values() -> SearchStrategy[Any]:
    plain = some.sampled_from((*CELLS, 0, 1, -1, True, None, 1e308, float("nan"), 10**40))
    return plain | some.lists(plain, max_size=3) | some.dictionaries(plain, plain, max_size=2)


def _yaml_files() -> SearchStrategy[bytes]:
    """Give parameter files with some of the names of the table and any values."""
    body = some.dictionaries(
        some.sampled_from(sorted(PARAMETERS)) | some.sampled_from(CELLS), _yaml_values(), max_size=6
    )
    whole = some.builds(
        lambda node, inner: yaml.safe_dump({node: {"ros__parameters": inner}}, allow_unicode=True),
        some.sampled_from(("/**", "axis", "", "0")),
        body,
    )
    signs = ("a: ", "- ", "{", "}", "[", "]", "&a ", "*a", "<<: ", "!!python/name:os ", "? ", "|")
    pieces = some.lists(some.sampled_from((*signs, "\n", "  ", *CELLS)), max_size=30).map("".join)
    return (whole | pieces).map(lambda text: text.encode())


def _tables() -> SearchStrategy[bytes]:
    """Give tables of cells, and of whole rows that are repeated so that there are enough."""
    row = some.lists(some.sampled_from(CELLS) | some.floats().map(repr), min_size=1, max_size=4)
    text = some.builds(
        lambda rows, between, times: "\n".join(between.join(one) for one in rows * times),
        some.lists(row, max_size=6),
        some.sampled_from((",", ";", "\t", " ", ", ")),
        some.sampled_from((1, 20)),
    )
    return text.map(lambda one: one.encode())


def _arrays() -> SearchStrategy[bytes]:
    """Give files of numpy with any numbers, types and shapes."""

    def saved(kind: str, rows: int, columns: int, fill: float) -> bytes:
        with np.errstate(all="ignore"):
            array = np.full((rows, columns), fill).astype(kind)
        array[:, :1] = np.arange(rows).reshape(-1, 1).astype(kind)
        stream = io.BytesIO()
        np.save(stream, array, allow_pickle=False)
        return stream.getvalue()

    return some.builds(
        saved,
        some.sampled_from(("f8", "f4", "i8", "u1", "c16", "S3", "U2", "?", ">f8", "M8[s]")),
        some.sampled_from((0, 1, 15, 40)),
        some.integers(0, 3),
        some.sampled_from((0.0, 1e-9, float("nan"), float("inf"), 1e308)),
    )


def _read_parameters(path: Path) -> None:
    p = read_yaml(path)
    assert Parameters.of(p.flat()) == p
    Plant.of(p), drive_of(p)


def _read_waveform(path: Path) -> None:
    drive_of(Parameters.of({"waveform": "table", "waveform_table": str(path)}))


def _read_hysteresis(path: Path) -> None:
    Plant.of(Parameters.of({"actuator": "hysteresis", "hysteresis_file": str(path)}))


def _read_motion(path: Path) -> None:
    found = load_motion(path).motion
    assert np.isfinite(found.x).all()
    assert (np.diff(found.t) > 0.0).all()


def _read_bag(path: Path) -> None:
    with open_bag(path) as bag:
        list(bag.messages())


ANYTHING = some.binary(max_size=300)
FORMATS: dict[str, tuple[Callable[[Path], None], SearchStrategy[bytes]]] = {
    "parameters.yaml": (_read_parameters, _yaml_files()),
    "waveform.csv": (_read_waveform, _tables()),
    "hysteresis.csv": (_read_hysteresis, _tables()),
    "motion.csv": (_read_motion, _tables()),
    "motion.npy": (_read_motion, _arrays() | ANYTHING),
    **{
        f"motion.{suffix}": (_read_motion, ANYTHING)
        for suffix in ("npz", "mat", "h5", "tdms", "uff", "lvm", "isf", "trc", "bag", "txt", "db3")
    },
    "bag.mcap": (_read_bag, ANYTHING.map(lambda data: b"\x89MCAP0\r\n" + data)),
    "bag.mcap.zstd": (_read_bag, ANYTHING),
}


#: Names of columns were repeated in full: whoever reads the message saw nothing else.
FINDS = [("motion.csv", b"\n\n0\n0 " + b"9" * 400 + b" " + b"9" * 400 + b"\n0.0")]


def files(seconds: float, seed: int) -> int:
    """Read files for so long; return 1 if one was neither read nor refused in one line."""

    def check(example: tuple[str, bytes]) -> None:
        name, data = example
        path = Path(folder, name)
        path.write_bytes(data)
        begin = time.process_time()
        try:
            FORMATS[name][0](path)
        except StickslipError as error:
            text = str(error)
            # A refused measurement shows how it begins, in lines of its own.
            assert "\n" not in text or isinstance(error, MeasurementError), text
            assert len(text) < 2000, text
        finally:
            path.unlink()
        assert time.process_time() - begin < LONGEST

    found = [some.tuples(some.just(name), data) for name, (_, data) in FORMATS.items()]
    with tempfile.TemporaryDirectory() as folder:
        try:
            print(f"{search(some.one_of(found), check, seconds, seed, FINDS)} files")
        except Exception:
            traceback.print_exc()
            return 1
    return 0
