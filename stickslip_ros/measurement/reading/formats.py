# SPDX-License-Identifier: Apache-2.0
"""The formats of files, and the reader of each.

How a file begins says which reader takes it, and its suffix where that is not enough. A new format
is a function from a path to a `Table` and a line in `_BY_START` or `_BY_SUFFIX`.
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

Reader = Callable[[Path], Table]

_BY_START: tuple[tuple[bytes, Reader], ...] = (
    (rb"\x93NUMPY", arrays.read_npy),
    (rb"\x89HDF\r\n\x1a\n", arrays.read_hdf5),
    (rb"MATLAB 5\.0 MAT-file", arrays.read_mat),
    (rb"MATLAB 7\.3 MAT-file", arrays.read_hdf5),
    (rb"TDSm", instruments.read_tdms),
)
_BY_SUFFIX: dict[str, Reader] = {
    ".npz": arrays.read_npz,
    ".mat": arrays.read_mat,
    **dict.fromkeys((".uff", ".unv", ".uf"), instruments.read_uff),
    ".tdms": instruments.read_tdms,
    **dict.fromkeys((".wfm", ".trc", ".isf", ".bin"), instruments.read_waveform),
}
#: LeCroy's mark may come after what an interface put before it.
_WAVEFORM = b"WAVEDESC"
#: What is not read, by its start or the end of its name, and the cure.
_NOT_READ: tuple[tuple[str, bytes, tuple[str, ...], str], ...] = (
    ("waveforms of Yokogawa", rb"\$PublicInfo|\A%WDF", (".wvf", ".wdf"), "export it as CSV"),
    ("binary waveforms of Rohde & Schwarz", rb"(?s)\A\s*<\?xml.*<Database", (".wfm.bin",),
     "export it as CSV"),
    ("Octave's text", rb"(?s)\A#.*# name:.*\n# type:", (), "save it with save -v7"),
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
    for what, mark, ends, cure in _NOT_READ:
        if re.search(mark, start) or path.name.lower().endswith(ends):
            raise MeasurementError(f"{what} cannot be read; {cure}")
    reader = next((reader for mark, reader in _BY_START if re.match(mark, start)), None)
    reader = reader or _BY_SUFFIX.get(path.suffix.lower())
    if reader is None and _WAVEFORM in start[:64]:
        reader = instruments.read_waveform
    table = reader(path) if reader else read_text_table(path, decimal)
    if table is None:
        raise MeasurementError(f"it is neither text nor a known format; {_KNOWN}")
    return table


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Turn every error into a MeasurementError that begins with the name of the file."""
    try:
        yield
    except OSError as error:
        raise MeasurementError(f"cannot read {path}: {error.strerror or error}") from None
    except ReadError as error:  # it names the file
        raise MeasurementError(str(error)) from None
    except MemoryError:
        raise MeasurementError(f"{path}: it does not fit into memory; cut it") from None
    except MeasurementError as error:
        raise MeasurementError(f"{path}: {error}") from None
