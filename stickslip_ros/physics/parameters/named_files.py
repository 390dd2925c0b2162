# SPDX-License-Identifier: Apache-2.0
"""Files that parameters name: which are used, their digests, and where strangers may name them.

They belong to a run as the parameters do: an event that sets parameters holds the digest of each
file that they use.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from pathlib import Path

from stickslip_ros.physics.parameters.bounded_files import read_bytes
from stickslip_ros.physics.parameters.parameters import PARAMETERS, Parameters
from stickslip_ros.physics.parameters.row import ParameterError, file_names

_DIGEST = "_sha256"  # end of the names of details that are digests of files


def files_of(p: Parameters) -> dict[str, Path]:
    """Return the files that parameters use, by the parameter that names them."""
    files = {}
    if p.drive.waveform == "table" and p.drive.waveform_table is not None:
        files["waveform_table"] = Path(p.drive.waveform_table)
    if p.actuator.actuator == "hysteresis" and p.actuator.hysteresis_file is not None:
        files["hysteresis_file"] = Path(p.actuator.hysteresis_file)
    return files


def digests_of(p: Parameters) -> dict[str, str]:
    """Return the SHA-256 of the files that parameters use, by detail name; ParameterError."""
    return {f"{name}{_DIGEST}": _digest(name, path) for name, path in files_of(p).items()}


def is_digest(name: str) -> bool:
    """Return whether a detail of an event is the digest of a file."""
    return name.endswith(_DIGEST)


def check_files(p: Parameters, details: Mapping[str, object], but: Collection[str]) -> None:
    """Raise ParameterError if a file that parameters use is not the one of the details.

    Those of the parameters ``but`` may be others.
    """
    for name, path in files_of(p).items():
        noted = None if name in but else details.get(f"{name}{_DIGEST}")
        if noted and noted != (found := _digest(name, path)):
            raise ParameterError(
                f"{name} {path} has changed since the run: its SHA-256 is {found}, that of the "
                f"run was {noted}; restore the file of the run"
            )


def check_place(p: Parameters, changes: Mapping[str, object]) -> None:
    """Raise ParameterError if a change that comes from outside names a file it must not.

    Whoever starts an axis may name any file; others only those in ``data_directory``.
    """
    for name in file_names(PARAMETERS):
        path = changes.get(name)
        if not path or path == p.value(name):
            continue
        folder = p.node.data_directory
        if folder is None:
            raise ParameterError(
                f"{name} names a file, and none may be named while the axis runs: start it with "
                "data_directory, the folder of such files"
            )
        try:
            inside = Path(str(path)).resolve().is_relative_to(Path(folder).resolve())
        except (OSError, ValueError, RuntimeError):  # not a path, or links in a circle
            inside = False
        if not inside:
            raise ParameterError(f"{name} is outside data_directory, {folder}: put the file there")


def _digest(name: str, path: Path) -> str:
    try:
        return hashlib.sha256(read_bytes(path)).hexdigest()
    except ParameterError as error:
        raise ParameterError(f"{name}: {error}; put the file in its place") from None
