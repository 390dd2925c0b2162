# SPDX-License-Identifier: Apache-2.0
"""Which reader takes a file: by how it begins, and by its suffix where that is not enough.

A new format is a function from a path to a `Table` and a line in `_BY_START` or `_BY_SUFFIX`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from stickslip_ros.measurement.reading import arrays, instruments
from stickslip_ros.measurement.reading.table import MeasurementError, Table
from stickslip_ros.measurement.reading.text import UNPACKING, numbers_of, read_text_table
from stickslip_ros.opening import open_regular

Reader = Callable[[Path], Table]

_BY_START: tuple[tuple[bytes, Reader], ...] = (
    (b"\x93NUMPY", arrays.read_npy),
    (b"\x89HDF\r\n\x1a\n", arrays.read_hdf5),
    (b"MATLAB 5.0 MAT-file", arrays.read_mat),
    (b"MATLAB 7.3 MAT-file", arrays.read_mat),
    (b"TDSm", instruments.read_tdms),
)
#: LeCroy's mark may come after what an interface put before it.
_WAVEFORM = b"WAVEDESC"
#: The text that describes a Yokogawa waveform, and the file whose layout Yokogawa keeps to itself.
_YOKOGAWA_HEADER, _YOKOGAWA_SECRET = b"$PublicInfo", b"%WDF"
_BY_SUFFIX: dict[str, Reader] = {
    ".npz": arrays.read_npz,
    ".mat": arrays.read_mat,
    ".uff": instruments.read_uff,
    ".unv": instruments.read_uff,
    ".uf": instruments.read_uff,
    ".tdms": instruments.read_tdms,
    ".wfm": instruments.read_waveform,
    ".trc": instruments.read_waveform,
    ".isf": instruments.read_waveform,
    ".bin": instruments.read_waveform,
    ".wvf": instruments.read_wvf,
}
_KNOWN = (
    "read are text (also packed with gzip, bzip2 or xz), .npy, .npz, .mat, HDF5, .lvm, .uff, "
    ".tdms, .wfm, .trc, .isf, .wvf, .bin of oscilloscopes, and bags"
)


def open_table(path: Path, decimal: str | None = None) -> Table:
    """Return the columns of a file. Raises MeasurementError and OSError."""
    path = numbers_of(path)
    with open_regular(path) as file:
        start = file.read(1024)
    if not start:
        raise MeasurementError("it is empty: no row of numbers")
    reader = next((reader for mark, reader in _BY_START if start.startswith(mark)), None)
    reader = reader or _BY_SUFFIX.get(path.suffix.lower())
    if reader is None and _WAVEFORM in start[:64]:
        reader = instruments.read_waveform
    if _YOKOGAWA_HEADER in start:
        reader = instruments.read_wvf
    if start.startswith(_YOKOGAWA_SECRET) and reader is not instruments.read_wvf:
        raise MeasurementError(
            "the layout of Yokogawa's .wdf is not published; save it as .wvf or text (Xviewer does)"
        )
    if arrays.is_octave(start):  # under any name
        reader = arrays.read_octave
    if reader is not None:
        return reader(path)
    try:
        table = read_text_table(path, decimal)
    except UNPACKING as error:
        raise MeasurementError(f"it cannot be unpacked: {error}") from None
    if table is None:
        raise MeasurementError(f"it is neither text nor a known format; {_KNOWN}")
    return table
