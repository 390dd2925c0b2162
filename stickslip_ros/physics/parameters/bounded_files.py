# SPDX-License-Identifier: Apache-2.0
"""Files that strangers wrote, within bounds: YAML, columns of numbers, parameter files of ROS.

YAML is bounded in size, depth and digits, and a key twice is refused. Its numbers are those that
ROS takes: `1e-6` and `7.0e6` are numbers, `1:30` is text.
"""

from __future__ import annotations

import logging
import math
import re
import stat
from collections.abc import Iterator, Mapping
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from stickslip_ros.base.opening import open_regular
from stickslip_ros.physics.parameters.groups import AXIS_NODE
from stickslip_ros.physics.parameters.row import Parameter, ParameterError, file_names

_LARGEST = 1024 * 1024  # characters, and values once aliases are followed
_DEEPEST = 20
_TOO_DEEP = f"YAML nested more than {_DEEPEST} deep"
# libyaml stops at 1000 levels. It scans at most 1024 characters ahead of its events: only a row of
# brackets takes it there before the events are too deep for us.
_RUN = re.compile(rf"[\[{{]{{{_DEEPEST + 1}}}")
_LONGEST_NUMBER = 100  # characters; 64 bits in binary take 67

# The parsers in C are ten times as fast; they are missing where PyYAML was built without libyaml.
_C = hasattr(yaml, "CSafeLoader")
_BASE: Any = yaml.CBaseLoader if _C else yaml.BaseLoader
_SAFE: Any = yaml.CSafeLoader if _C else yaml.SafeLoader

_FLOAT = "tag:yaml.org,2002:float"
#: Numbers as in YAML 1.1, but for those to the base of 60, and with exponents as C reads them
_NUMBERS = {
    "tag:yaml.org,2002:int": re.compile(
        r"[-+]?(0b[0-1_]+|0[0-7_]+|0|[1-9][0-9_]*|0x[0-9a-fA-F_]+)\Z"
    ),
    _FLOAT: re.compile(
        r"([-+]?([0-9][0-9_]*\.[0-9_]*|\.[0-9][0-9_]*)([eE][-+]?[0-9]+)?"
        r"|[-+]?[0-9][0-9_]*[eE][-+]?[0-9]+|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN))\Z"
    ),
}


class _OneOfEach:
    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> Any:
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.value in seen:
                    line = key.start_mark.line + 1
                    raise yaml.YAMLError(f"{key.value!r} stands there twice, again in line {line}")
                seen.add(key.value)
        return super().construct_mapping(node, deep=deep)  # type: ignore[misc]


class _Texts(_OneOfEach, _BASE):  # type: ignore[misc]
    pass


class _Values(_OneOfEach, _SAFE):  # type: ignore[misc]
    yaml_implicit_resolvers = {  # noqa: RUF012  as in the class above
        first: [(tag, _NUMBERS.get(tag, pattern)) for tag, pattern in resolvers]
        for first, resolvers in _SAFE.yaml_implicit_resolvers.items()
    }

    def construct_yaml_int(self, node: yaml.ScalarNode) -> Any:
        if len(node.value) > _LONGEST_NUMBER:
            raise yaml.YAMLError(f"a number of {len(node.value)} digits")
        return super().construct_yaml_int(node)


_Values.add_constructor("tag:yaml.org,2002:int", _Values.construct_yaml_int)


class _NoValue(ParameterError):
    """A name below `ros__parameters` stands alone, which ROS refuses without saying which."""


class _Filled(_Values):
    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> Any:
        for key, value in node.value:
            if key.value == _VALUES and isinstance(value, yaml.MappingNode):
                for name, one in value.value:
                    if one.tag == "tag:yaml.org,2002:null":
                        line = name.start_mark.line + 1
                        wanted = "it has to be a number or a text, or be left out"
                        raise _NoValue(f"line {line}: {name.value} is None; {wanted}")
        return super().construct_mapping(node, deep=deep)


def load_values(text: str) -> Any:
    """Load YAML text.

    Raises ValueError: not YAML, a duplicate key, or text that takes much time or memory to load.
    """
    return _load(text, _Values)


def load_texts(text: str) -> Any:
    """Load YAML text with all values as texts, without numbers and dates.

    Raises ValueError: as :func:`load_values`.
    """
    return _load(text, _Texts)


def _load(text: str, loader: Any) -> Any:
    if len(text) > _LARGEST:
        raise ValueError(f"it has {len(text)}, at most {_LARGEST} characters of YAML are allowed")
    try:
        _refuse_traps(text)
        return yaml.load(text, Loader=loader)
    except (yaml.YAMLError, RecursionError) as error:
        if _RUN.search(text):
            raise ValueError(_TOO_DEEP) from None
        raise ValueError(f"not YAML ({' '.join(str(error).split())[:300]})") from None


def _refuse_traps(text: str) -> None:
    """Deep nesting overflows the stack; aliases can make a short text very long."""
    sizes: dict[str | None, int] = {}  # of the values with an anchor, in scalars
    inside: list[tuple[str | None, int]] = []  # anchor of each open collection, size before it
    size = 0
    for event in yaml.parse(text, Loader=_BASE):
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise ValueError("YAML with a value inside itself, or an unknown alias")
            size += sizes[event.anchor]
        elif isinstance(event, yaml.CollectionStartEvent):
            inside.append((event.anchor, size))
            size += 1
            if len(inside) > _DEEPEST:
                raise ValueError(_TOO_DEEP)
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = inside.pop()
            sizes[anchor] = size - before
        elif isinstance(event, yaml.ScalarEvent):
            size += 1
            sizes[event.anchor] = 1
        if size > _LARGEST:
            raise ValueError(f"YAML that is too long: more than {_LARGEST} values")


# -- columns of numbers

#: Size of a file that a parameter may name; a waveform of 10 000 points takes half of it.
MOST_BYTES = 1_000_000
#: Text that programs print around a number, such as np.float64(0.5).
_WRAPPED = re.compile(r"(?:np|numpy)\.\w+\(\s*'?([^()']*)'?\s*\)|Decimal\('([^']*)'\)")


def unwrap_numbers(text: str) -> str:
    """Return a text in which numbers replace ``np.float64(0.5)`` and the like."""
    return _WRAPPED.sub(lambda found: found[1] if found[1] is not None else found[2], text)


class FileVersion(NamedTuple):
    """Path, time of change and size of a file: the key of its cached content."""

    path: Path
    changed: int  #: ns, by the file system
    size: int  #: bytes

    @classmethod
    def of(cls, path: Path) -> FileVersion:
        """Return which version of a file is there; ParameterError if none can be read."""
        try:
            found = path.stat()
        except (OSError, ValueError) as error:
            raise cannot_read(path, error) from None
        if not stat.S_ISREG(found.st_mode):
            raise ParameterError(f"cannot read {path}: it is not a regular file; name one")
        if found.st_size > MOST_BYTES:
            raise ParameterError(
                f"cannot read {path}: it has {found.st_size} bytes, {MOST_BYTES} is the limit; "
                "name a shorter file"
            )
        return cls(path, found.st_mtime_ns, found.st_size)


def cannot_read(path: Path, error: Exception) -> ParameterError:
    """Return the error that says why a file cannot be read."""
    return ParameterError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}")


def read_bytes(path: Path) -> bytes:
    """Return the content of a regular file of moderate size; ParameterError for any other file.

    A remote user may name the file: a pipe would block, a device may have no end.
    """
    FileVersion.of(path)
    try:
        with open_regular(path) as file:
            return file.read(MOST_BYTES)
    except OSError as error:
        raise cannot_read(path, error) from None


def read_small_text(path: Path) -> str:
    """Return the text of a file as `read_bytes` does; UnicodeDecodeError if it is none."""
    return read_bytes(path).decode("utf-8-sig")


def read_rows(
    path: Path, widths: tuple[int, ...], form: str
) -> tuple[list[int], list[list[float]]]:
    """Return the numbers of the lines with numbers, and the rows of numbers.

    Columns are separated by commas, semicolons or blanks; ``#`` begins a comment.
    ``np.float64(0.5)`` is a number. widths are the allowed numbers of columns, form names them in
    words. Raises ParameterError with the line for anything else.
    """
    try:
        text = read_small_text(path)
    except UnicodeDecodeError:
        raise ParameterError(f"{path} is not a text file; it has to hold {form}") from None
    lines: list[int] = []
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), 1):
        cells = unwrap_numbers(line.partition("#")[0]).replace(";", ",").replace(",", " ").split()
        if not cells:
            continue
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            raise ParameterError(
                f"{path}, line {number} is not a row of numbers; it has to hold {form}"
            ) from None
        if not all(math.isfinite(value) for value in row):
            raise ParameterError(f"{path}, line {number}: every number has to be finite")
        if len(row) not in widths or (rows and len(row) != len(rows[0])):
            raise ParameterError(
                f"{path}, line {number}: {len(row)} columns; it has to hold {form}, "
                "as many in every line"
            )
        lines.append(number)
        rows.append(row)
    return lines, rows


# -- the YAML files that ROS nodes take: ``/**:`` or a node, below it ``ros__parameters:``

#: Prefixes of the parameters that every ROS node has; the table does not contain them.
OF_EVERY_NODE = ("use_sim_time", "start_type_description_service", "qos_overrides.")

#: Those of the process of an axis, which `ros2 param dump` writes between those of the axis
OF_PROCESS = ("axes", "emulate", "emulate_port")

_VALUES = "ros__parameters"
_FORM = f"a file starts with '/**:' and below it '{_VALUES}:', or holds names with values alone"


def read_values(path: str | PathLike[str], known: Mapping[str, Parameter]) -> dict[str, Any]:
    """Return the values that a parameter file gives the node of an axis, not checked yet.

    known are the names of the table. The sections for the node of an axis, or for all nodes, are
    used; without any, those that contain a name of the table; names and values without a section
    are for commands, not for nodes. Relative paths in the file are tried from its own folder first.
    Raises ParameterError that names the file.
    """
    path = Path(path)
    content = _content(path)
    if isinstance(content, dict) and set(content) & set(known):
        content = {"/**": {_VALUES: content}}
    found = list(_sections(content, "", path))
    own = [values for node, values in found if node.rpartition("/")[2] in (AXIS_NODE, "*", "**")]
    if not own:
        own = [values for _, values in found if len(found) == 1 or set(values) & set(known)]
    if not own:
        nodes = ", ".join(node for node, _ in found)
        raise ParameterError(f"{path} configures {nodes}, none with a parameter of an axis")
    merged = {name: value for values in own for name, value in values.items()}
    for name in file_names(known):
        if merged.get(name) and (beside := path.parent / str(merged[name])).is_file():
            merged[name] = str(beside)
    if alone := ", ".join(name for name in OF_PROCESS if name in merged):
        _say_once(f"{path}: {alone} are of nodes alone, and passed over")
    others = (*OF_EVERY_NODE, *OF_PROCESS)
    return {name: value for name, value in merged.items() if not name.startswith(others)}


@cache
def _say_once(text: str) -> None:
    logging.getLogger(__name__).warning(text)


def nodes_in(path: str | PathLike[str]) -> list[str]:
    """Return the full names of the nodes, wildcards among them, that a parameter file configures.

    Raises ParameterError that names the file.
    """
    path = Path(path)
    return [node for node, _ in _sections(_content(path), "", path)]


def values_in(path: Path, name: str) -> list[object]:
    """Return the values that a file gives a parameter, for any node; none if it is broken."""
    try:
        sections = list(_sections(_content(path), "", path))
    except ParameterError:
        return []
    return [values[name] for _, values in sections if name in values]


def parameter_file_text(values: Mapping[str, Any]) -> str:
    """Return the text of a parameter file with values by name."""
    return yaml.safe_dump({"/**": {_VALUES: dict(values)}}, sort_keys=False)


def _content(path: Path) -> Any:
    try:
        return _load(read_small_text(path), _Filled)
    except _NoValue as error:
        raise ParameterError(f"{path}, {error}") from None
    except ParameterError:
        raise
    except ValueError as error:
        found = "it is not text" if isinstance(error, UnicodeDecodeError) else error
        raise ParameterError(f"{path} is not a YAML file: {found}") from None


def _sections(content: object, above: str, path: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the name of each node, namespaces before it, and its values."""
    if not isinstance(content, dict):
        raise ParameterError(f"{path} holds no names with values; {_FORM}")
    for name, body in content.items():
        node = f"{above}/{str(name).strip('/')}"
        if not isinstance(body, dict):
            raise ParameterError(f"{path}: {str(name)!r} has no {_VALUES}; {_FORM}")
        if _VALUES not in body:
            yield from _sections(body, node, path)
            continue
        if not isinstance(body[_VALUES], dict):
            raise ParameterError(f"{path} holds no names with values; {_FORM}")
        yield node, dict(_flat(body[_VALUES], ""))


def _flat(values: Mapping[Any, Any], above: str) -> Iterator[tuple[str, Any]]:
    """Yield names with values; ROS writes a nested mapping as one name with dots."""
    for name, value in values.items():
        if isinstance(value, dict) and value:
            yield from _flat(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value
