# SPDX-License-Identifier: Apache-2.0
"""Many messages of one type at once: those of one layout have every number at the same place.

`mcap_ros2` reads a message field by field, 50 us for joint states. Here it reads the first message
of each layout; where the numbers of the others lie follows from that one (OMG, formal/02-06), and
NumPy takes them out. A layout that does not give back what the library read is not used.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from stickslip_ros.recordings.cdr import fields_of
from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.message_types import JOINT_STATE_TYPE, STATUS_TYPE, stamp_of

TIME, RECORDED = "time (s)", "recorded (ns)"
"""The first columns of every table, see :meth:`Times.columns`."""

LONGEST_ARRAY = 64
"""Values of an array whose values are columns; images have millions."""

#: NumPy's words for the types of numbers, as the library reads them
_NUMBERS = {"bool": "?", "byte": "u1", "char": "i1", "float32": "<f4", "float64": "<f8"}
_NUMBERS |= {f"int{8 * size}": f"<i{size}" for size in (1, 2, 4, 8)}
_NUMBERS |= {f"uint{8 * size}": f"<u{size}" for size in (1, 2, 4, 8)}
_BYTES = ("byte", "uint8")  # arrays of these are data, not lists of numbers
#: Type, length of an array, name; a constant has = behind its name
_FIELD = re.compile(r"\s*([\w/]+)(?:<=\d+)?(\[(?:<=)?\d*\])?\s+(\w+)\s*(=?)")
_TIME = [("uint32", "", "sec"), ("uint32", "", "nanosec")]
_FEW = 8  # messages of a size that are not worth a layout
_MOST_LAYOUTS = 16  # of a size; more are due to texts, and looking for them costs more than reading

Definitions = Mapping[str, Sequence[tuple[str, str, str]]]
Columns = tuple[str, ...]
Bytes = npt.NDArray[np.uint8]


class Place(NamedTuple):
    """Where a number or a text lies in a message: its type in NumPy's words, its first byte."""

    kind: str
    offset: int

    def of(self, messages: Bytes) -> npt.NDArray[Any]:
        """Return what is there in messages of one size, a row each."""
        kind = np.dtype(self.kind)
        part = messages[:, self.offset : self.offset + kind.itemsize]
        return np.ascontiguousarray(part).view(kind)[:, 0]


class Rows(NamedTuple):
    """Rows of a table that have the same columns."""

    numbers: Sequence[int]  #: of the messages that they are of
    columns: Columns
    values: Sequence[Sequence[Any]]  #: a row each


class Times(NamedTuple):
    """When messages were recorded, by their numbers, ns; and the start of the bag, ns."""

    recorded: Sequence[int]
    start_ns: int
    #: ns since the start at which the clock of the stamps was heard, and by how much it is ahead
    clock: tuple[Sequence[int], Sequence[int]] = ((0,), (0,))

    def columns(self, numbers: Sequence[int], stamps: Sequence[int]) -> list[Sequence[Any]]:
        """Return the columns with the times of messages.

        These are s since the start of the bag by the stamp (ns) in the message, or what the clock
        of the stamps showed when it was recorded if it has none, 0; and when it was recorded, ns
        since the Unix epoch.
        """
        recorded = [self.recorded[number] for number in numbers]
        start = self.start_ns
        since = [ns - start for ns in recorded]
        if not all(stamps):
            # The clock of a damaged bag may be ahead by more than the integers of NumPy hold.
            heard, by = (np.asarray(one, dtype=np.float64) for one in self.clock)
            ahead = [round(one) for one in np.interp(since, heard, by).tolist()]
            since = [ns + more for ns, more in zip(since, ahead, strict=True)]
        times = [
            1e-9 * (stamp - start if stamp else ns) for stamp, ns in zip(stamps, since, strict=True)
        ]
        return [times, recorded]


class Layout:
    """Where the numbers and texts lie in all messages of one layout."""

    def __init__(
        self, definitions: Definitions, type_name: str, data: bytes, decode: Callable[[bytes], Any]
    ) -> None:
        """Take a message, and what the library reads messages with.

        Raises ValueError: the values of this message, or of one like it, are others here.
        """
        walk = _Walk(definitions, data, len(data) if type_name == JOINT_STATE_TYPE else 0)
        try:
            places = walk.message(type_name)
            found = dict(fields_of(places, type_name, LONGEST_ARRAY))
            stamp = getattr(getattr(places, "header", None), "stamp", None)
            self._stamp = (stamp.sec, stamp.nanosec) if stamp else ()
        except (AttributeError, LookupError, TypeError, ValueError, struct.error) as error:
            raise ValueError(f"it cannot be followed: {error}") from None
        self._columns = (TIME, RECORDED, *found)
        self._cells: list[Any] = list(found.values())
        self._fixed = np.array(list(chain.from_iterable(walk.fixed)))
        message = np.frombuffer(data, np.uint8)
        self._expected = message[self._fixed]
        # Zeros are the same wherever they are looked for, so a message without zeros is read, too.
        other = np.arange(1, len(data) + 1, dtype=np.int64) * 37 % 127 + 1
        other[self._fixed] = self._expected
        for one in (message, other.astype(np.uint8)):
            own, read = self.rows([0], one[None, :], Times([0], 0)), decode(one.tobytes())
            values = dict(fields_of(read, type_name, LONGEST_ARRAY))
            theirs = (
                self._columns[:2] + tuple(values),
                (1e-9 * stamp_of(read, 0), 0, *values.values()),
            )
            if not data[1] & 1 or repr((own.columns, own.values[0])) != repr(theirs):
                raise ValueError("the library reads other values")

    def fits(self, messages: Bytes) -> npt.NDArray[np.bool_]:
        """Return which of some messages of its size have this layout."""
        fits: npt.NDArray[np.bool_] = (messages[:, self._fixed] == self._expected).all(axis=1)
        return fits

    def rows(self, numbers: Sequence[int], messages: Bytes, times: Times) -> Rows:
        """Return the rows of messages of this layout; ValueError: a text is none."""
        stamps = [0] * len(messages)
        if self._stamp:
            seconds, ns = (place.of(messages).astype(np.int64) for place in self._stamp)
            stamps = (seconds * 10**9 + ns).tolist()
        columns = times.columns(numbers, stamps)
        columns += [
            _values(cell, messages) if isinstance(cell, Place) else [cell] * len(messages)
            for cell in self._cells
        ]
        return Rows(numbers, self._columns, list(zip(*columns, strict=True)))


class Layouts:
    """The layouts of the messages of one type."""

    def __init__(self, type_name: str, schema: str, decode: Callable[[bytes], Any]) -> None:
        """Know none yet; decode is what the library reads messages with."""
        self._type, self._decode = type_name, decode
        self._definitions = _definitions_in(schema, type_name)
        self._known: dict[int, list[Layout]] = {}  # by the size of the messages
        self._refused = type_name == STATUS_TYPE  # which has several rows a message
        package, *_, kind = type_name.split("/")
        fields = self._definitions.get(f"{package}/{kind}", ())
        #: Whether messages begin with the stamp of a header
        self.headed = [*fields[:1]] == [("std_msgs/Header", "", "header")]

    def rows(self, data: Mapping[int, bytes], times: Times) -> tuple[list[Rows], list[int]]:
        """Return the rows of messages by number, and the numbers of those to be read one by one.

        Raises ValueError: a text is none.
        """
        by_size: dict[int, list[int]] = {}
        if len(set(map(len, data.values()))) == 1:
            by_size[len(next(iter(data.values())))] = list(data)
        else:
            for number, one in data.items():
                by_size.setdefault(len(one), []).append(number)
        made, left = list[Rows](), list[int]()
        for size, numbers in by_size.items():
            if self._refused or len(numbers) < _FEW:
                left += numbers
                continue
            joined = b"".join([data[number] for number in numbers])
            messages = np.frombuffer(joined, np.uint8).reshape(len(numbers), size)
            waiting = np.array(numbers)
            known = self._known.setdefault(size, [])
            for number in range(_MOST_LAYOUTS):
                if not len(waiting):
                    break
                if number == len(known) and not self._learn(known, data[int(waiting[0])]):
                    break
                fits = known[number].fits(messages)
                if fits.any():
                    found = waiting[fits].tolist(), messages[fits]
                    made.append(known[number].rows(*found, times))
                waiting, messages = waiting[~fits], messages[~fits]
            left += waiting.tolist()
        return made, left

    def _learn(self, known: list[Layout], data: bytes) -> bool:
        """Add the layout of a message to those of its size; return False if it has none."""
        try:
            known.append(Layout(self._definitions, self._type, data, self._decode))
        except (BagError, ValueError):
            self._refused = True
        return not self._refused


def _values(place: Place, messages: Bytes) -> list[Any]:
    values: list[Any] = place.of(messages).tolist()
    if place.kind[0] != "S":
        return values
    # NumPy takes zeros at the end of a text off.
    return [text.ljust(int(place.kind[1:]), b"\0").decode() for text in values]


def _definitions_in(schema: str, type_name: str) -> Definitions:
    """Return type, array and name of the fields of each type in a ``ros2msg`` schema."""
    found = {f"builtin_interfaces/{name}": _TIME for name in ("Time", "Duration")}
    for number, part in enumerate(re.split(r"^={3,}\s*$", schema, flags=re.MULTILINE)):
        named = re.search(r"^MSG:\s+(\S+)\s*$", part, flags=re.MULTILINE)
        package, *_, kind = (named[1] if named and number else type_name).split("/")
        lines = [line.partition("#")[0] for line in part.splitlines() if "MSG:" not in line]
        fields = [match.groups("") for line in lines if (match := _FIELD.match(line))]
        found[f"{package}/{kind}"] = [
            (t, array, name) for t, array, name, mark in fields if not mark
        ]
    return found


class _Walk:
    """Goes through one message, and notes where everything lies."""

    def __init__(self, definitions: Definitions, data: bytes, longest: int) -> None:
        self._definitions, self._data = definitions, data
        self._longest = longest or LONGEST_ARRAY
        self._at = 4  # behind the words that name the encoding
        #: bytes that are the same in every message of the layout: lengths, and texts in lists
        self.fixed: list[range] = [range(4)]

    def message(self, type_name: str) -> SimpleNamespace:
        """Return a message that has places instead of numbers and texts."""
        package, *_, kind = type_name.split("/")
        fields = self._definitions[f"{package}/{kind}"]
        self._at += not fields  # a byte stands for nothing
        made = SimpleNamespace(__slots__=[name for _, _, name in fields])
        for kind, array, name in fields:
            full = kind if "/" in kind else f"{package}/{kind}"
            setattr(made, name, self._list(kind, full, array) if array else self._one(kind, full))
        return made

    def _list(self, kind: str, full: str, array: str) -> Any:
        size = array.strip("[]")
        count = int(size) if size.isdecimal() else self._length()
        if kind in _BYTES:
            self._at += count
            return b""
        if kind in _NUMBERS and count > self._longest:  # nobody asks for the places of so many
            first, offset = self._number(kind)
            self._at = offset + count * np.dtype(first).itemsize
            return [None] * (LONGEST_ARRAY + 1)
        return [self._one(kind, full, fixed=True) for _ in range(count)]

    def _one(self, kind: str, full: str, fixed: bool = False) -> Any:
        if kind in _NUMBERS:
            return self._number(kind)
        if kind != "string":
            return self.message(full)
        length = self._length()
        start, end = self._at, self._at + max(length - 1, 0)  # behind it is a zero
        self._at += length
        if fixed:
            self.fixed.append(range(start, end))
        return (
            self._data[start:end].decode()
            if fixed or start == end
            else Place(f"S{end - start}", start)
        )

    def _number(self, kind: str) -> Place:
        size = np.dtype(_NUMBERS[kind]).itemsize
        self._at += -(self._at - 4) % size
        place = Place(_NUMBERS[kind], self._at)
        self._at += size
        return place

    def _length(self) -> int:
        _, offset = self._number("uint32")
        self.fixed.append(range(offset, self._at))
        return int(struct.unpack_from("<I", self._data, offset)[0])
