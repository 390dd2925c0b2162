# SPDX-License-Identifier: Apache-2.0
"""Recordings as tables, CSV or Parquet: one for each topic, or one of all, in order of time.

Rows are gathered in a temporary database first: what columns there are, which clocks the stamps
are of, and what order the rows have, is known only when all messages have been read.
"""

from __future__ import annotations

import csv
import marshal
import sqlite3
import tempfile
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby, islice, takewhile
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

from stickslip_ros.base.errors import printable
from stickslip_ros.base.files import whole_file, whole_folder
from stickslip_ros.recordings.clocks import HOUR, Bulk, Moments
from stickslip_ros.recordings.errors import BagError, UndecodableError, short
from stickslip_ros.recordings.messages import decoder_for, fields_of, not_of_type
from stickslip_ros.recordings.reader import BagReader
from stickslip_ros.recordings.schemas import JOINT_STATE_TYPE, STATUS_TYPE, stamp_of

TIME, RECORDED, CLOCK = "time (s)", "recorded (ns)", "clock"
"""The first columns of every table; the third only where two clocks meet in one."""

LONGEST_ARRAY = 64
"""Values of an array whose values are columns; images have millions."""

_AT_ONCE = 10_000  # rows that are written together
#: Columns of a table at most: a file of so many names and as many rows fills any disk
_MOST_COLUMNS = 10_000
_HEARD_EVERY = 10_000_000  # ns between joint states that a clock is learnt from
_LONGEST_NAME = 200  # bytes of the name of a file, without its end
_SIGNED = 2**63  # of log times, which have no sign, in the database, where integers have one

#: Called with the count of messages done since it was called last
Note = Callable[[int], object]


class Exported(NamedTuple):
    """What was written of a bag, and what was not."""

    path: Path  #: the file or folder
    left_out: dict[str, str]  #: topics that cannot be decoded, each with the reason
    #: what else there is to say, a sentence each: messages apart from the others, other clocks
    notes: list[str]


def export(bag: BagReader, out: Path, on_messages: Note = lambda count: None) -> Exported:
    """Write the messages of a bag as tables; topics that cannot be decoded are left out and named.

    So are messages whose times are hours from those of all others. The times of a table are by the
    clock of its stamps: from the start of the bag by that of the recorder, else from the first
    stamp of that clock.

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
        The file or folder written, and what was left out.

    Raises
    ------
    BagError
        The bag is damaged, has no messages that can be decoded, or ``pyarrow`` is not installed.
    WriteError
        The file or folder cannot be written.
    """
    write = {".csv": _write_csv, ".parquet": _parquet_writer(out)}.get(out.suffix)
    with (whole_file if write else whole_folder)(out) as part:
        beside = None if part == out else part.parent  # there is no room beside a device
        with tempfile.TemporaryDirectory(dir=beside) as folder:
            try:
                rows = _Rows(bag, Path(folder, "rows"), on_messages)
                (write or _write_folder)(part, rows)
            except sqlite3.Error as error:
                raise BagError(
                    f"cannot gather the rows of {bag.path} beside {out}: {error}; make room on "
                    "the disk or choose a place on another one"
                ) from error
    return Exported(out, rows.left_out, rows.notes)


# -- rows


@dataclass
class _Topic:
    """A topic whose messages become rows."""

    number: int
    name: str
    type: str
    decode: Callable[[bytes], Any]
    columns: dict[str, None] = field(default_factory=dict)  #: in the order in which they came
    stamps: Moments = field(default_factory=Moments)
    #: of joint states: ns since the start at which a stamp was heard, and how much it was ahead
    heard: list[int] = field(default_factory=list)
    ahead: list[int] = field(default_factory=list)
    bulk: Bulk | None = None  #: of the stamps, None if there are none
    clock: str = ""  #: whose stamps begin it; "" for that of the recorder
    origin_ns: int = 0  #: of the times
    told_by: _Topic | None = None  #: the joint states whose clock is that of a topic without stamps

    def stamp(self, message: Any, log_ns: int, start_ns: int) -> int | None:
        """Note and return the stamp of a message, None if its type has none; ValueError: too far.

        log_ns: when it was recorded; start_ns: start of the bag.
        """
        stamp, since = stamp_of(message), log_ns - start_ns
        if stamp is None:
            return None
        if not -_SIGNED <= stamp < _SIGNED:
            raise ValueError(f"its stamp is {stamp} ns")
        self.stamps.add(stamp)
        due = not self.heard or since >= self.heard[-1] + _HEARD_EVERY
        if self.type == JOINT_STATE_TYPE and stamp and due:
            self.heard.append(since)
            self.ahead.append(stamp - log_ns)
        return stamp

    def ahead_at(self, since: int) -> int:
        """Return by how much (ns) the clock of joint states was ahead, ns after the start."""
        later = bisect_left(self.heard, since)
        if not 0 < later < len(self.heard):
            return self.ahead[min(later, len(self.ahead) - 1)]
        (a, b), (before, after) = (one[later - 1 : later + 1] for one in (self.heard, self.ahead))
        return before + (after - before) * (since - a) // (b - a)

    def keep_heard(self, start_ns: int) -> None:
        """Forget what was heard of stamps that are left out."""
        assert self.bulk
        kept = [
            (since, ahead)
            for since, ahead in zip(self.heard, self.ahead, strict=True)
            if self.bulk.start_ns <= start_ns + since + ahead <= self.bulk.end_ns
        ]
        self.heard, self.ahead = [one for one, _ in kept], [one for _, one in kept]


class _Rows:
    """The rows of all messages, in a database beside the file that is written."""

    def __init__(self, bag: BagReader, path: Path, note: Note) -> None:
        """Read the messages of a bag; BagError if none can be decoded."""
        self.left_out: dict[str, str] = {}  #: topics, each with the reason
        self.notes: list[str] = [bag.bulk.told] if bag.bulk.apart else []
        self._bag, self._start = bag, bag.start_ns
        self._names: dict[tuple[str, ...], int] = {}  # the columns that rows have, numbered
        self._topics: dict[str, _Topic] = {}
        for number, (name, count) in enumerate(bag.counts.items()):
            try:
                if count:
                    topic = bag.topics[name]
                    self._topics[name] = _Topic(number, name, topic.type, decoder_for(topic))
            except BagError as error:
                self.left_out[name] = str(error)
        self._database = sqlite3.connect(path, isolation_level=None)
        for text in (
            *("PRAGMA journal_mode = OFF", "PRAGMA synchronous = OFF"),
            *("PRAGMA cache_size = -65536", "BEGIN"),
            "CREATE TABLE rows (topic INTEGER, stamp INTEGER, log INTEGER, names INTEGER, cells)",
        ):
            self._database.execute(text)
        found = self._read(note)
        while some := list(islice(found, _AT_ONCE)):
            self._database.executemany("INSERT INTO rows VALUES (?, ?, ?, ?, ?)", some)
        self._database.execute("COMMIT")
        if not self._topics:
            why = "".join(f"; {reason}" for reason in self.left_out.values())
            raise BagError(
                f"{bag.path} has no messages that can be decoded; record some with cdr{why}"
            )
        self._set_clocks()
        self.topics = {topic.number: topic for topic in self._topics.values()}  #: by their numbers
        self.several_clocks = len({topic.clock for topic in self.topics.values()}) > 1
        self._database.create_function("moment", 3, self._moment)

    def _read(self, note: Note) -> Iterator[tuple[int, int | None, int, int, bytes]]:
        """Yield the rows of all messages that can be decoded, as they stand in the database."""
        for message in self._bag.bulk_messages([*self._topics]):
            note(1)
            topic = self._topics.get(message.topic)
            if topic is None:  # a message of it was not of its type
                continue
            try:
                found = topic.decode(message.data)
                stamp = topic.stamp(found, message.log_ns, self._start)
                for row in _rows_of(found, topic.type):
                    names = tuple(row)
                    number = self._names.setdefault(names, len(self._names))
                    if not row.keys() <= topic.columns.keys():
                        topic.columns |= dict.fromkeys(names)
                    if len(topic.columns) > _MOST_COLUMNS - 2:
                        raise UndecodableError(
                            f"the messages on {topic.name} of {self._bag.path} have more than "
                            f"{_MOST_COLUMNS} columns together; read them with "
                            "`stickslip_ros.open_bag`"
                        )
                    cells = marshal.dumps(tuple(row.values()))
                    yield topic.number, stamp, message.log_ns - _SIGNED, number, cells
            except (AttributeError, TypeError, ValueError, BagError) as error:
                told = error if isinstance(error, BagError) else None
                told = told or not_of_type(self._bag, topic.name, error)
                self.left_out[topic.name] = str(told)
                del self._topics[topic.name]

    def _set_clocks(self) -> None:
        """Find out which topics have stamps of one clock: those that overlap, within an hour."""
        spans: list[tuple[int, int, _Topic | None]] = [(self._start, self._bag.end_ns, None)]
        for topic in self._topics.values():
            bulk = topic.stamps.bulk()
            if bulk != Bulk(0, 0):  # which stands for none
                topic.bulk = bulk
                spans.append((bulk.start_ns, bulk.end_ns, topic))
                if bulk.apart:
                    self.notes.append(f"{topic.name}: {bulk.told}")
                topic.keep_heard(self._start)
        spans.sort(key=itemgetter(0))
        groups: list[list[tuple[int, int, _Topic | None]]] = []
        latest = 0
        for one in spans:
            if not groups or one[0] - latest > HOUR:
                groups.append([])
            latest = max(latest, one[1]) if groups[-1] else one[1]
            groups[-1].append(one)
        for group in groups:
            topics = [topic for *_, topic in group if topic]
            if len(topics) < len(group):  # one is the recorder
                for topic in topics:
                    topic.origin_ns = self._start
                continue
            for topic in topics:
                topic.clock, topic.origin_ns = topics[0].name, group[0][0]
            names = ", ".join(sorted(topic.name for topic in topics)[:5])
            more = f" and {len(topics) - 5} more" if len(topics) > 5 else ""
            self.notes.append(
                f"the stamps of {names}{more} are by another clock than the recorder's; their "
                "times count from the first of them"
            )
        clocks = [topic for topic in self._topics.values() if topic.heard]
        for topic in self._topics.values():
            if not topic.bulk:
                topic.origin_ns = self._start
                if clocks:
                    near = topic.told_by = max(clocks, key=lambda o: _nearness(o.name, topic.name))
                    topic.clock, topic.origin_ns = near.clock, near.origin_ns

    def _moment(self, number: int, stamp: int | None, log: int) -> float | None:
        """Return the time (s) of a row; None if it is left out."""
        topic = self.topics.get(number)
        if topic is None:
            return None
        ns = log + _SIGNED
        if topic.bulk and stamp is not None:
            if not topic.bulk.start_ns <= stamp <= topic.bulk.end_ns:
                return None
            ns = stamp
        elif topic.told_by:
            ns += topic.told_by.ahead_at(ns - self._start)
        return 1e-9 * (ns - topic.origin_ns)

    def select(self, order: str) -> Iterator[tuple[_Topic, float, int, int, Any]]:
        """Yield topic, time (s), recorded (ns), number of the columns and cells of each row.

        order: "topic" or "at", the time; those of one are in the order of the recording.
        """
        for number, at, log, names, cells in self._database.execute(
            "SELECT topic, moment(topic, stamp, log) AS at, log, names, cells FROM rows "
            f"ORDER BY {order}, rowid"
        ):
            if at is not None:
                yield self.topics[number], at, log + _SIGNED, names, marshal.loads(cells)

    def placed(self, columns: Iterable[str], prefix: str = "") -> dict[int, list[int]]:
        """Return for the numbers of columns, where these are among the columns of a table."""
        places = {name: place for place, name in enumerate(columns)}
        return {
            number: [places[f"{prefix}{name}"] for name in names]
            for names, number in self._names.items()
            if all(f"{prefix}{name}" in places for name in names)
        }

    def columns(self) -> list[str]:
        """Return the columns of one table of all topics; BagError if they are too many."""
        first = [TIME, RECORDED, CLOCK] if self.several_clocks else [TIME, RECORDED]
        found = [f"{topic.name}/{name}" for topic in self.topics.values() for name in topic.columns]
        if len(found) > _MOST_COLUMNS - len(first):
            raise BagError(
                f"one table of all topics has more than {_MOST_COLUMNS} columns; "
                "name a folder, which takes a table for each topic"
            )
        return first + found

    def kinds(self, columns: Sequence[str]) -> list[type]:
        """Return a type that all cells of each column of one table have or can be made of."""
        found: dict[str, type] = {TIME: float, RECORDED: int}
        prefixed = [*self._names]
        for topic, _, _, names, cells in self.select("topic"):
            for name, cell in zip(prefixed[names], cells, strict=True):
                column = f"{topic.name}/{name}"
                kind = found.setdefault(column, type(cell))
                if kind is not type(cell):
                    found[column] = float if {kind, type(cell)} <= {int, float} else str
        return [found.get(name, str) for name in columns]

    def joined(self) -> Iterator[list[Any]]:
        """Yield a row of one table for each moment of a clock, with the values of all topics."""
        columns = self.columns()
        places = {n: self.placed(columns, f"{t.name}/") for n, t in self.topics.items()}
        moment, row = None, list[Any]()
        for topic, at, recorded, names, cells in self.select("at"):
            own = places[topic.number][names]
            if moment != (at, topic.clock) or any(row[place] is not None for place in own):
                if moment:
                    yield row
                moment, row = (at, topic.clock), [None] * len(columns)
                row[:2] = at, recorded
                if self.several_clocks:
                    row[2] = topic.clock or "recorder"
            for place, cell in zip(own, cells, strict=True):
                row[place] = cell
        if moment:
            yield row


def _rows_of(message: Any, kind: str) -> Iterator[dict[str, Any]]:
    """Yield the cells of the rows of a message by their columns, but for its times."""
    if kind != STATUS_TYPE:
        yield dict(fields_of(message, kind, LONGEST_ARRAY))
        return
    for status in message.status:
        row = {pair.key: pair.value for pair in status.values}
        row |= {name: getattr(status, name) for name in ("name", "level", "message")}
        yield {name: cell for name, cell in row.items() if name not in (TIME, RECORDED)}


def _nearness(one: str, other: str) -> tuple[int, int]:
    """Return how many parts names of topics have in common; a topic of all comes first."""
    pairs = zip(one.split("/"), other.split("/"), strict=False)
    common = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
    return common, -one.count("/")


# -- tables


def _write_folder(folder: Path, rows: _Rows) -> None:
    folder.mkdir()
    names = _file_names(topic.name for topic in rows.topics.values())
    for topic in rows.topics.values():
        with (folder / f"{names[topic.name]}.csv").open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerow([TIME, RECORDED, *topic.columns])
    for number, some in groupby(rows.select("topic"), key=lambda row: row[0].number):
        topic = rows.topics[number]
        places = rows.placed(topic.columns)
        with (folder / f"{names[topic.name]}.csv").open("a", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows(
                (at, recorded, *_spread(cells, places[columns], len(topic.columns)))
                for _, at, recorded, columns, cells in some
            )


def _spread(cells: Sequence[Any], places: Sequence[int], width: int) -> list[Any]:
    """Return a row with its cells in some of the columns of a table."""
    row: list[Any] = [None] * width
    for place, cell in zip(places, cells, strict=True):
        row[place] = cell
    return row


def _write_csv(path: Path, rows: _Rows) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(rows.columns())
        writer.writerows(rows.joined())


def _parquet_writer(out: Path) -> Callable[[Path, _Rows], None] | None:
    """Return what writes Parquet; BagError if it is wanted and ``pyarrow`` is not there."""
    if out.suffix != ".parquet":
        return None
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise BagError(
            f"{out.name} needs pyarrow: pip install 'stickslip_ros[parquet]', or write .csv"
        ) from None

    def write(path: Path, rows: _Rows) -> None:
        columns = rows.columns()
        kinds = rows.kinds(columns)
        arrow = {float: pyarrow.float64(), int: pyarrow.int64(), bool: pyarrow.bool_()}
        types = [arrow.get(kind, pyarrow.string()) for kind in kinds]
        schema = pyarrow.schema(list(zip(columns, types, strict=True)))
        found = rows.joined()
        with parquet.ParquetWriter(path, schema) as writer:
            while some := list(islice(found, _AT_ONCE)):
                try:
                    arrays = [
                        pyarrow.array(
                            [
                                cell if cell is None or kind is not str else str(cell)
                                for cell in cells
                            ],
                            one,
                        )
                        for cells, kind, one in zip(
                            zip(*some, strict=True), kinds, types, strict=True
                        )
                    ]
                except (OverflowError, pyarrow.ArrowException) as error:
                    raise BagError(
                        f"the recording does not fit into {out.name}: {short(error)}; write .csv"
                    ) from error
                writer.write_batch(pyarrow.RecordBatch.from_arrays(arrays, schema=schema))

    return write


def _file_names(topics: Iterable[str]) -> dict[str, str]:
    """Return a name for the file of each topic, all different, that any disk takes."""
    names: dict[str, str] = {}
    for topic in topics:
        plain = printable(topic.strip("/").replace("/", ".")).encode()[:_LONGEST_NAME]
        name = plain.decode(errors="ignore") or "topic"
        names[topic] = name if name not in names.values() else f"{name}_{len(names)}"
    return names
