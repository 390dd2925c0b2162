# SPDX-License-Identifier: Apache-2.0
"""Recordings as tables, CSV or Parquet: one for each topic, or one of all, in order of time."""

from __future__ import annotations

import csv
import math
import shutil
import struct
import tempfile
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import accumulate, groupby, takewhile
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

from stickslip_ros.base.errors import printable
from stickslip_ros.base.files import whole_file, whole_folder
from stickslip_ros.recordings.cdr import decoder_for, fields_of, not_of_type
from stickslip_ros.recordings.errors import BagError, UndecodableError, short
from stickslip_ros.recordings.layouts import (
    LONGEST_ARRAY,
    RECORDED,
    TIME,
    Columns,
    Layouts,
    Rows,
    Times,
)
from stickslip_ros.recordings.message_types import JOINT_STATE_TYPE, STATUS_TYPE, stamp_of
from stickslip_ros.recordings.reader import BagReader

_AT_ONCE = 10_000  # messages that are decoded and written together, or
_BYTES_AT_ONCE = 16 * 1024 * 1024  # so many bytes of them
#: Columns of a table at most: a file of so many names and as many rows fills any disk
_MOST_COLUMNS = 10_000
_HEARD_EVERY = 10_000_000  # ns between joint states that a clock is learnt from
_LONGEST_NAME = 200  # bytes of the name of a file, without its end

#: Called with the count of messages done since it was called last
Note = Callable[[int], object]


class Exported(NamedTuple):
    """What was written of a bag, and what was not."""

    path: Path  #: the file or folder
    left_out: dict[str, str]  #: topics that cannot be decoded, each with the reason


def export(bag: BagReader, out: Path, on_messages: Note = lambda count: None) -> Exported:
    """Write the messages of a bag as tables; topics that cannot be decoded are left out and named.

    Parameters
    ----------
    bag : BagReader
        The bag to export.
    out : Path
        A file that ends in .csv or .parquet takes one table with a row for each moment, its columns
        named ``<topic>/<field>``; anything else is a new folder with a CSV file for each topic.
    on_messages : callable, optional
        Called with the count of messages written since it was called last.

    Returns
    -------
    Exported
        The file or folder written, and the topics left out.

    Raises
    ------
    BagError
        The bag is damaged, has no messages that can be decoded, or ``pyarrow`` is not installed.
    WriteError
        The file or folder cannot be written.
    """
    topics, left_out = dict[str, _Decoded](), dict[str, str]()
    clocks = _clocks(bag)
    for name in [name for name, count in bag.counts.items() if count]:
        try:
            topics[name] = _Decoded(bag, name, clocks)
        except BagError as error:
            left_out[name] = str(error)
    write = _WRITERS.get(out.suffix, _write_folder)
    try:
        _check_some(bag, topics, left_out)
        write(bag, topics, out, on_messages)
    except UndecodableError:  # then all that cannot be decoded is looked for, and left out
        left_out |= _broken(bag, topics)
        topics = {name: one for name, one in topics.items() if name not in left_out}
        _check_some(bag, topics, left_out)
        write(bag, topics, out, on_messages)
    return Exported(out, left_out)


def _check_some(bag: BagReader, topics: Mapping[str, Any], left_out: Mapping[str, str]) -> None:
    if not topics:
        why = "".join(f"; {reason}" for reason in left_out.values())
        raise BagError(f"{bag.path} has no messages that can be decoded; record some with cdr{why}")


# -- rows


def _nearness(one: str, other: str) -> tuple[int, int]:
    """Return how many parts names of topics have in common; a topic of all comes first."""
    pairs = zip(one.split("/"), other.split("/"), strict=False)
    common = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
    return common, -one.count("/")


Clocks = Mapping[str, tuple[list[int], list[int]]]
"""By topic: ns since the start of the bag when stamps were recorded, and what these are ahead."""


def _clocks(bag: BagReader) -> Clocks:
    """Learn the clocks of stamps from joint states; an axis that dropped time is behind."""
    found: dict[str, tuple[list[int], list[int]]] = {}
    names = [one.name for one in bag.topics.values() if one.type == JOINT_STATE_TYPE]
    start = bag.start_ns
    for block in bag.blocks(names) if names else ():
        for name, ns, data in zip(block.topics, block.log_ns, block.data, strict=True):
            heard, ahead = found.setdefault(name, ([], []))
            since = ns - start
            if heard and since < heard[-1] + _HEARD_EVERY:
                continue
            if stamp := _stamp_in(data):
                heard.append(since)
                ahead.append(stamp - ns)
    return {name: one for name, one in found.items() if one[0]}


def _stamp_in(data: bytes) -> int:
    """Return the stamp (ns) of a message whose header comes first, 0 if it has none."""
    if len(data) < 12:
        return 0
    seconds, ns = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, 4)
    return int(seconds * 10**9 + ns)


class _Decoded:
    """A topic whose messages become rows."""

    def __init__(self, bag: BagReader, name: str, clocks: Clocks) -> None:
        """Take the clocks of stamps; the nearest by name is its own. BagError: not decodable."""
        self._bag, self._name = bag, name
        own = max(clocks, key=lambda one: _nearness(one, name), default="")
        self._clock = clocks.get(own, Times([], 0).clock)
        topic = bag.topics[name]
        self._type = topic.type
        self._decode = decoder_for(topic)
        self._layouts = Layouts(topic.type, topic.schema, self._decode)
        self._columns = {TIME, RECORDED}

    def rows(self, data: Mapping[int, bytes], recorded: Sequence[int]) -> list[Rows]:
        """Return the rows of messages by their numbers, in that order, with the times first.

        recorded: ns, of every number. Raises UndecodableError: a message is not of its type.
        """
        times = Times(recorded, self._bag.start_ns, self._clock)
        try:
            made, left = self._layouts.rows(data, times)
            for number in left:
                made += self._one_by_one(number, data[number], times)
        except (AttributeError, TypeError, ValueError) as error:
            raise not_of_type(self._bag, self._name, error) from None
        self._columns.update(*(one.columns for one in made))
        if len(self._columns) > _MOST_COLUMNS:
            raise UndecodableError(
                f"the messages on {self._name} of {self._bag.path} have more than {_MOST_COLUMNS} "
                "columns together; read them with `stickslip_ros.open_bag`"
            )
        return made if len(made) < 2 else list(_in_order(made))

    def earliest(self, data: Mapping[int, bytes], recorded: Sequence[int]) -> float:
        """Return the least time (s) in the rows of messages, of stamps alone where that will do."""
        if self._layouts.headed:
            stamps = [_stamp_in(one) for one in data.values()]
            times = Times(recorded, self._bag.start_ns, self._clock)
            return float(min(times.columns(list(data), stamps)[0]))
        rows = self.rows(data, recorded)
        return min((float(values[0]) for one in rows for values in one.values), default=math.inf)

    def _one_by_one(self, number: int, data: bytes, times: Times) -> Iterator[Rows]:
        message = self._decode(data)
        rows = [dict(fields_of(message, self._type, LONGEST_ARRAY))]
        if self._type == STATUS_TYPE:
            rows = [
                {pair.key: pair.value for pair in status.values}
                | {name: getattr(status, name) for name in ("name", "level", "message")}
                for status in message.status
            ]
        (seconds,), (ns,) = times.columns([number], [stamp_of(message, 0)])
        for row in rows:
            row = {TIME: seconds, RECORDED: ns} | row | {TIME: seconds, RECORDED: ns}
            yield Rows([number], tuple(row), [tuple(row.values())])


def _in_order(made: list[Rows]) -> Iterator[Rows]:
    """Yield rows in the order of their messages, those of the same columns together."""
    each = [
        (number, one.columns, values)
        for one in made
        for number, values in zip(one.numbers, one.values, strict=True)
    ]
    each.sort(key=itemgetter(0))
    for columns, alike in groupby(each, key=itemgetter(1)):
        numbers, _, values = zip(*alike, strict=True)
        yield Rows(numbers, columns, values)


Block = tuple[dict[str, dict[int, bytes]], list[int]]
"""Messages by topic and by their number in the block, and when each number was recorded, ns."""


def _blocks(bag: BagReader, topics: Iterable[str], note: Note) -> Iterator[Block]:
    """Yield all messages, many at a time."""
    data, recorded, size = dict[str, dict[int, bytes]](), list[int](), 0
    for block in bag.blocks(topics):
        each = zip(block.topics, block.data, strict=True)
        for number, (topic, one) in enumerate(each, len(recorded)):
            try:
                data[topic][number] = one
            except KeyError:
                data[topic] = {number: one}
        recorded += block.log_ns
        size += sum(map(len, block.data))
        if len(recorded) >= _AT_ONCE or size >= _BYTES_AT_ONCE:
            yield data, recorded
            note(len(recorded))
            data, recorded, size = {}, [], 0
    if recorded:
        yield data, recorded
        note(len(recorded))


def _broken(bag: BagReader, topics: Mapping[str, _Decoded]) -> dict[str, str]:
    """Return the topics with messages that cannot be decoded, each with the reason."""
    found: dict[str, str] = {}
    for block, recorded in _blocks(bag, topics, lambda count: None):
        for name, data in block.items():
            try:
                topics[name].rows(data, recorded)
            except UndecodableError as error:
                found.setdefault(name, str(error))
    return found


Part = tuple[Columns, Sequence[Sequence[Any]]]
"""Columns, and rows that have these."""


_One = tuple[int, str, Columns, Sequence[Any]]
"""A row by the number of its message: with the topic, the columns and the values."""


def _time_of(one: _One) -> float:
    return float(one[3][0])


def _each(
    topics: Mapping[str, _Decoded], block: dict[str, dict[int, bytes]], recorded: list[int]
) -> list[_One]:
    """Return the rows of a block in the order of its messages."""
    each = [
        (number, topic, rows.columns, values)
        for topic, data in block.items()
        for rows in topics[topic].rows(data, recorded)
        for number, values in zip(rows.numbers, rows.values, strict=True)
    ]
    each.sort(key=itemgetter(0))
    return each


def _times_to_come(bag: BagReader, topics: Mapping[str, _Decoded]) -> list[float]:
    """Return for each block the least time (s) of all that follow it."""
    earliest = [
        min(topics[topic].earliest(data, recorded) for topic, data in block.items())
        for block, recorded in _blocks(bag, topics, lambda count: None)
    ]
    return [*accumulate([math.inf, *earliest[:0:-1]], min)][::-1]


def _joined(
    bag: BagReader, topics: Mapping[str, _Decoded], to_come: Sequence[float], note: Note
) -> Iterator[Part]:
    """Yield a row for each time, with the values of all topics; columns are named by topic.

    to_come: of `_times_to_come`. What comes late is waited for, so memory grows with that alone.
    """
    names: dict[tuple[str, Columns], Columns] = {}
    waiting: tuple[Columns, tuple[Any, ...]] | None = None
    held: list[_One] = []
    for block, later in zip(_blocks(bag, topics, note), to_come, strict=True):
        held += _each(topics, *block)
        held.sort(key=_time_of)
        ready = bisect_left(held, later, key=_time_of)
        each, held = held[:ready], held[ready:]
        done = []
        for _, topic, own, values in each:
            columns = names.get((topic, own))
            if columns is None:
                columns = *own[:2], *(f"{topic}/{name}" for name in own[2:])
                names[topic, own] = columns
            if waiting and (waiting[1][0] != values[0] or set(waiting[0][2:]) & set(columns[2:])):
                done.append(waiting)
                waiting = None
            if waiting:
                waiting = waiting[0] + columns[2:], (*waiting[1], *values[2:])
            else:
                waiting = columns, tuple(values)
        for columns, alike in groupby(done, key=itemgetter(0)):
            yield columns, [values for _, values in alike]
    if waiting:
        yield waiting[0], [waiting[1]]


# -- tables


class _Csv:
    """A table that takes rows before all of its columns are known."""

    def __init__(self, path: Path, body: Path) -> None:
        """Begin the table that :meth:`finish` writes into a file; body takes its rows till then."""
        self._path, self._body = path, body
        self._columns = {TIME: 0, RECORDED: 1}
        self._narrow = False  # whether some rows lack columns that came later

    def add(self, columns: Columns, rows: Sequence[Sequence[Any]]) -> None:
        """Append rows; BagError: there are too many columns."""
        known = len(self._columns)
        for name in columns:
            self._columns.setdefault(name, len(self._columns))
        if len(self._columns) > _MOST_COLUMNS:
            raise BagError(
                f"one table of all topics has more than {_MOST_COLUMNS} columns; "
                "name a folder, which takes a table for each topic"
            )
        self._narrow |= known < len(self._columns) and self._body.exists()
        with self._body.open("a", encoding="utf-8", newline="") as file:
            if len(columns) < len(self._columns) or list(self._columns) != list(columns):
                at = [self._columns[name] for name in columns]
                width = len(self._columns)
                csv.writer(file).writerows(_spread(row, at, width) for row in rows)
            elif any(isinstance(value, str) for value in rows[0]):
                csv.writer(file).writerows(rows)
            else:  # numbers alone, of which this makes what csv does, in half the time
                lines = repr([*map(tuple, rows)])[2:-2].replace("), (", "\r\n")
                file.write(f"{lines.replace(', ', ',')}\r\n")

    def finish(self) -> None:
        """Write names and rows into the file."""
        with self._path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(self._columns)
            if self._body.exists():
                with self._body.open(encoding="utf-8", newline="") as body:
                    if not self._narrow:
                        shutil.copyfileobj(body, file)
                    for row in csv.reader(body) if self._narrow else ():
                        writer.writerow(row + [""] * (len(self._columns) - len(row)))
        self._body.unlink(missing_ok=True)


def _spread(row: Sequence[Any], at: Sequence[int], width: int) -> list[Any]:
    """Return a row with its values in some of the columns of a table."""
    cells: list[Any] = [None] * width
    for place, value in zip(at, row, strict=True):
        cells[place] = value
    return cells


def _write_folder(bag: BagReader, topics: Mapping[str, _Decoded], out: Path, note: Note) -> None:
    with whole_folder(out) as folder:
        folder.mkdir()
        tables = {
            name: _Csv(folder / f"{file}.csv", folder / f"{file}.rows")
            for name, file in _file_names(topics).items()
        }
        for block, recorded in _blocks(bag, topics, note):
            for name, data in block.items():
                for rows in topics[name].rows(data, recorded):
                    tables[name].add(rows.columns, rows.values)
        for table in tables.values():
            table.finish()


def _write_csv(bag: BagReader, topics: Mapping[str, _Decoded], out: Path, note: Note) -> None:
    with whole_file(out) as part:
        beside = None if part == out else part.parent  # there is no room beside a device
        with tempfile.TemporaryDirectory(dir=beside) as folder:
            table = _Csv(part, Path(folder, "rows"))
            for columns, rows in _joined(bag, topics, _times_to_come(bag, topics), note):
                table.add(columns, rows)
            table.finish()


def _write_parquet(bag: BagReader, topics: Mapping[str, _Decoded], out: Path, note: Note) -> None:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise BagError(
            f"{out.name} needs pyarrow: pip install 'stickslip_ros[parquet]', or write .csv"
        ) from None
    kinds: dict[str, type] = {TIME: float, RECORDED: int}
    to_come = _times_to_come(bag, topics)
    for columns, rows in _joined(bag, topics, to_come, lambda count: None):
        for name, value in zip(columns, rows[0], strict=True):
            kind = kinds.setdefault(name, type(value))
            if kind is not type(value):
                kinds[name] = float if {kind, type(value)} <= {int, float} else str
    arrow = {float: pyarrow.float64(), int: pyarrow.int64(), bool: pyarrow.bool_()}
    types = {name: arrow.get(kind, pyarrow.string()) for name, kind in kinds.items()}
    schema = pyarrow.schema(list(types.items()))
    with whole_file(out) as part, parquet.ParquetWriter(part, schema) as writer:
        for columns, rows in _joined(bag, topics, to_come, note):
            found = {
                name: map(str, values) if kinds[name] is str else values
                for name, values in zip(columns, zip(*rows, strict=True), strict=True)
            }
            try:
                arrays = [
                    pyarrow.array(found[name], kind)
                    if name in found
                    else pyarrow.nulls(len(rows), kind)
                    for name, kind in types.items()
                ]
            except (OverflowError, pyarrow.ArrowException) as error:
                raise BagError(
                    f"{bag.path} does not fit into {out.name}: {short(error)}; write .csv"
                ) from error
            writer.write_batch(pyarrow.RecordBatch.from_arrays(arrays, schema=schema))


def _file_names(topics: Iterable[str]) -> dict[str, str]:
    """Return a name for the file of each topic, all different, that any disk takes."""
    names: dict[str, str] = {}
    for topic in topics:
        plain = printable(topic.strip("/").replace("/", ".")).encode()[:_LONGEST_NAME]
        name = plain.decode(errors="ignore") or "topic"
        names[topic] = name if name not in names.values() else f"{name}_{len(names)}"
    return names


_WRITERS = {".csv": _write_csv, ".parquet": _write_parquet}
