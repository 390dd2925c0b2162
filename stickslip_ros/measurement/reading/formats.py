# SPDX-License-Identifier: Apache-2.0
"""The formats of files, and the reader of each.

How a file begins says which reader takes it, and the end of its name where that is not enough. A
new format is a function from a path to a `Table` and a line in `_FORMATS`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from stickslip_ros.base.opening import ReadError, open_regular
from stickslip_ros.measurement.reading import arrays, instruments
from stickslip_ros.measurement.reading.table import MeasurementError, Table
from stickslip_ros.measurement.reading.text import numbers_of, read_text_table

#: How a file of a format begins, how its name ends; its reader, or the cure where there is none.
_FORMATS: tuple[tuple[bytes | None, str | None, Callable[[Path], Table] | str], ...] = (
    (rb"\$PublicInfo|\A%WDF", "wvf|wdf", "waveforms of Yokogawa cannot be read; export it as CSV"),
    (rb"(?s)\A\s*<\?xml.*<Database", r"wfm\.bin",
     "binary waveforms of Rohde & Schwarz cannot be read; export it as CSV"),
    (rb"(?s)\A#.*# name:.*\n# type:", None, "Octave's text cannot be read; save it with save -v7"),
    (rb"\A\x93NUMPY", None, arrays.read_npy),
    (None, "npz", arrays.read_npz),
    (rb"\A\x89HDF\r\n\x1a\n|\AMATLAB 7\.3 MAT-file", None, arrays.read_hdf5),
    (rb"\AMATLAB 5\.0 MAT-file", "mat", arrays.read_mat),
    (rb"\ATDSm", "tdms", instruments.read_tdms),
    (None, "uff|unv|uf", instruments.read_uff),
    # LeCroy's mark may come after what an interface put before it.
    (rb"(?s)\A.{0,56}WAVEDESC", "wfm|trc|isf|bin", instruments.read_waveform),
)  # fmt: skip
_KNOWN = (
    "read are text (also packed with gzip, bzip2 or xz), .npy, .npz, .mat, HDF5, .lvm, .uff, "
    ".tdms, .wfm, .trc, .isf, .bin of oscilloscopes, and bags"
)


def open_table(path: Path, decimal: str | None = None) -> Table:
    """Return the columns of a file; decimal is the sign of a text's numbers, if it is known.

    Raises MeasurementError and OSError.
    """
    path = numbers_of(path)
    with open_regular(path) as file:
        start = file.read(1024)
    if not start:
        raise MeasurementError("it is empty: no row of numbers")
    begun = (how for mark, _, how in _FORMATS if mark and re.search(mark, start))
    name = path.name.lower()
    named = (how for _, end, how in _FORMATS if end and re.search(rf"\.({end})$", name))
    reader = next(begun, None) or next(named, None)
    if isinstance(reader, str):
        raise MeasurementError(reader)
    table = reader(path) if reader else read_text_table(path, decimal)
    if table is None:
        raise MeasurementError(f"it is neither text nor a known format; {_KNOWN}")
    return table


@contextmanager
def naming(what: Path | str) -> Iterator[None]:
    """Turn every error into a MeasurementError that begins with the file, or what a program gave.

    In a program, options are arguments.
    """
    try:
        yield
        return
    except OSError as error:
        text = f"cannot read {what}: {error.strerror or error}"
    except ReadError as error:  # it names the file
        text = str(error)
    except MemoryError:
        text = f"{what}: it does not fit into memory; cut it"
    except MeasurementError as error:
        text = f"{what}: {error}"
        if isinstance(what, str) and "--" in text:
            text += "\nin a program, options are arguments: units='x=nm' of read_measurement, say"
    raise MeasurementError(text)
