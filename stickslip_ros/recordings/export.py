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
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from itertools import groupby, islice, takewhile
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

from stickslip_ros.base.errors import printable
from stickslip_ros.base.files import whole_file, whole_folder
from stickslip_ros.recordings.clocks import HOUR, Bulk, Moments
from stickslip_ros.recordings.errors import BagError, short
from stickslip_ros.recordings.mcap_files import BagMessage
from stickslip_ros.recordings.messages import decoder_for, fields_of, not_of_type
from stickslip_ros.recordings.metadata import is_kept
from stickslip_ros.recordings.reader import BagReader
from stickslip_ros.recordings.schemas import JOINT_STATE_TYPE, STATUS_TYPE, stamp_of

#: The first columns of every table; the third only where two clocks meet in one
_TIME, _RECORDED, _CLOCK = "time (s)", "recorded (ns)", "clock"
_LONGEST_ARRAY = 64  # values of an array whose values are columns; images have millions
_AT_ONCE = 10_000  # rows that are written together
#: Columns of a table at most: a file of so many names and as many rows fills any disk
_MOST_COLUMNS = 10_000
_HEARD_EVERY = 10_000_000  # ns between joint states that a clock is learnt from
_LONGEST_NAME = 200  # bytes of the name of a file, without its end
_SIGNED = 2**63  # of log times, which have no sign, in the database, where integers have one


class Exported(NamedTuple):
    """What was written of a bag, and what was not."""

    left_out: dict[str, str]  #: topics that cannot be decoded, each with the reason
    #: what else there is to say, a sentence each: messages apart from the others, other clocks
    notes: list[str]


def export(
    bag: BagReader, out: Path, on_messages: Callable[[int], object] = lambda count: None
) -> Exported:
    """Write the messages of a bag as tables; topics that cannot be decoded are left out and named.

    So are messages whose times are hours from those of all others. The times of a table are by the
    clock of its stamps: from the start of the bag by that of the recorder, else from the first
    stamp of that clock.

    out: a file that ends in .csv or .parquet takes one table with a row for each moment, its
    columns named ``<topic>/<field>``; else a new folder takes a CSV file for each topic.
    on_messages: called with the count of messages written since it was called last.
    Raises BagError: the bag is damaged, has no messages that can be decoded, or ``pyarrow`` is not
    installed. Raises WriteError: the file or folder cannot be written.
    """
    one = out.suffix in (".csv", ".parquet")
    write = (
        _parquet_writer(out) if out.suffix == ".parquet" else _write_csv if one else _write_folder
    )
    with (whole_file if one else whole_folder)(out) as part:
        beside = None if part == out else part.parent  # there is no room beside a device
        with tempfile.TemporaryDirectory(dir=beside) as folder:
            try:
                # Open, it would be kept for ever: its function knows the rows, and they know it.
                with closing(sqlite3.connect(f"{folder}/rows", isolation_level=None)) as database:
                    rows = _Rows(bag, database, on_messages)
                    write(part, rows)
            except sqlite3.Error as error:
                raise BagError(
                    f"cannot gather the rows of {bag.path} beside {out}: {error}; make room on "
                    "the disk or choose a place on another one"
                ) from error
    return Exported(rows.left_out, rows.notes)


# -- rows


@dataclass
class _Topic:
    """A topic whose messages become rows."""

    number: int
    name: str
    of_type: str
    decode: Callable[[bytes], Any]
    kept: bool  #: for late subscribers: the stamps may be of long before the recording
    #: in the order in which they came, and of what type their values are
    columns: dict[str, type] = field(default_factory=dict)
    stamps: Moments = field(default_factory=Moments)
    #: of joint states: when stamps were recorded, ns, and how much they were ahead of that
    heard: list[tuple[int, int]] = field(default_factory=list)
    bulk: Bulk | None = None  #: of the stamps, None if there are none
    clock: str = "recorder"  #: that of the times, or the topic whose stamps begin it
    origin_ns: int = 0  #: that the times count from
    #: the joint states that tell the clock of one without stamps, or whose stamps are older
    told_by: _Topic | None = None

    def rows(self, message: BagMessage) -> Iterator[tuple[int, int | None, int, bytes]]:
        """Yield the rows of a message as they stand in the database; BagError if it is none."""
        found = self.decode(message.data)
        stamp, log_ns = stamp_of(found), message.log_ns
        if stamp is not None:
            if not -_SIGNED <= stamp < _SIGNED:
                raise ValueError(f"its stamp is {stamp} ns")
            self.stamps.add(stamp)
            due = not self.heard or log_ns >= self.heard[-1][0] + _HEARD_EVERY
            if self.of_type == JOINT_STATE_TYPE and due:
                self.heard.append((log_ns, stamp - log_ns))
        for cells in _cells_of(found, self.of_type):
            for name, cell in cells.items():
                if (kind := self.columns.setdefault(name, type(cell))) is not type(cell):
                    both = {kind, type(cell)} == {int, float}
                    self.columns[name] = float if both else str
            if len(self.columns) > _MOST_COLUMNS - 2:
                raise BagError(
                    f"the messages on {self.name} have more than {_MOST_COLUMNS} columns together; "
                    "read them with `stickslip_ros.open_bag`"
                )
            yield self.number, stamp, log_ns - _SIGNED, marshal.dumps(cells)

    def seconds(self, stamp: int | None, log: int) -> float | None:
        """Return the time (s) of a row by stamp and log time in the database; None: left out."""
        ns = log + _SIGNED
        if self.bulk and stamp is not None:
            if not self.bulk.holds(stamp):
                return None
            ns = stamp
        elif self.told_by:
            heard = self.told_by.heard
            later = min(max(bisect_left(heard, (ns,)), 1), len(heard) - 1)
            (before, ahead), (after, then) = heard[later - 1], heard[later]
            if before < ns < after:
                ahead += (then - ahead) * (ns - before) // (after - before)
            ns += ahead if ns < after else then
        return 1e-9 * (ns - self.origin_ns)


def _cells_of(message: Any, kind: str) -> Iterator[dict[str, Any]]:
    """Yield the cells of the rows of a message by their columns, but for its times."""
    if kind != STATUS_TYPE:
        yield dict(fields_of(message, kind, _LONGEST_ARRAY))
        return
    for status in message.status:
        cells = {pair.key: pair.value for pair in status.values}
        cells |= {name: getattr(status, name) for name in ("name", "level", "message")}
        yield {name: cell for name, cell in cells.items() if name not in (_TIME, _RECORDED)}


class _Rows:
    """The rows of all messages, in a database beside the file that is written."""

    def __init__(
        self, bag: BagReader, database: sqlite3.Connection, note: Callable[[int], object]
    ) -> None:
        """Read the messages of a bag; BagError if none can be decoded."""
        self.left_out: dict[str, str] = {}  #: topics, each with the reason
        self.notes: list[str] = [bag.bulk.told] if bag.bulk.apart else []
        self._topics: dict[str, _Topic] = {}
        for number, (name, count) in enumerate(bag.counts.items()):
            try:
                if count:
                    topic = bag.topics[name]
                    decode, kept = decoder_for(topic), is_kept(topic.offered_qos)
                    self._topics[name] = _Topic(number, name, topic.type, decode, kept)
            except BagError as error:
                self.left_out[name] = str(error)
        self._database = database
        database.executescript(
            "PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; PRAGMA cache_size = -65536;"
            "CREATE TABLE rows (topic INTEGER, stamp INTEGER, log INTEGER, cells BLOB); BEGIN;"
        )
        database.executemany("INSERT INTO rows VALUES (?, ?, ?, ?)", self._read(bag, note))
        database.execute("COMMIT")
        if not self._topics:
            why = "".join(f"; {reason}" for reason in self.left_out.values())
            raise BagError(
                f"{bag.path} has no messages that can be decoded; record some with cdr{why}"
            )
        self._set_clocks(bag)
        self.topics = {topic.number: topic for topic in self._topics.values()}  #: by their numbers
        database.create_function(
            "seconds",
            3,
            lambda of, *ns: self.topics[of].seconds(*ns) if of in self.topics else None,
        )

    def _read(
        self, bag: BagReader, note: Callable[[int], object]
    ) -> Iterator[tuple[int, int | None, int, bytes]]:
        """Yield the rows of all messages; a topic ends with one that is not of its type."""
        for message in bag.bulk_messages([*self._topics]):
            note(1)
            if topic := self._topics.get(message.topic):
                try:
                    yield from topic.rows(message)
                except (AttributeError, TypeError, ValueError, BagError) as error:
                    wrong = isinstance(error, BagError)
                    told = error if wrong else not_of_type(bag, topic.name, error)
                    self.left_out[topic.name] = str(told)
                    del self._topics[topic.name]

    def _set_clocks(self, bag: BagReader) -> None:
        """Find out which topics have stamps of one clock: those that overlap, within an hour."""
        recorder = Bulk(bag.start_ns, bag.end_ns)
        spans: list[tuple[Bulk, _Topic | None]] = [(recorder, None)]
        clocks = list[_Topic]()
        for topic in self._topics.values():
            topic.origin_ns, bulk = bag.start_ns, topic.stamps.bulk()
            if bulk != Bulk(0, 0):  # which stands for none
                topic.bulk = bulk
                topic.heard = [one for one in topic.heard if bulk.holds(sum(one))]
                clocks += [topic] if topic.heard else []
        for topic in self._topics.values():
            if topic.bulk and topic.kept and clocks:
                topic.bulk = Bulk(-_SIGNED, _SIGNED)
            elif topic.bulk:
                spans.append((topic.bulk, topic))
                self.notes += [f"{topic.name}: {topic.bulk.told}"] if topic.bulk.apart else []
        spans.sort(key=itemgetter(0))
        latest, groups = spans[0][0].start_ns, list[list[tuple[Bulk, _Topic | None]]]([[]])
        for bulk, one in spans:
            if bulk.start_ns > latest + HOUR:
                groups.append([])
            groups[-1].append((bulk, one))
            latest = max(latest, bulk.end_ns)
        for group in groups:
            topics = [one for _, one in group if one]
            if len(topics) < len(group):  # the recorder is among them
                continue
            for topic in topics:
                topic.clock, topic.origin_ns = topics[0].name, group[0][0].start_ns
            more = f" and {len(topics) - 5} more" if len(topics) > 5 else ""
            self.notes.append(
                f"the stamps of {', '.join(sorted(topic.name for topic in topics)[:5])}{more} are "
                "by another clock than the recorder's; their times count from the first of them"
            )
        for topic in self._topics.values():
            if clocks and (topic.kept or not topic.bulk):
                near = topic.told_by = max(clocks, key=lambda one: _nearness(one.name, topic.name))
                topic.clock, topic.origin_ns = near.clock, near.origin_ns

    def select(self, order: str) -> Iterator[tuple[_Topic, list[Any], dict[str, Any]]]:
        """Yield topic, time (s) and when it was recorded (ns), and cells of each row.

        order: "topic" or "at", the time; those of one are in the order of the recording.
        """
        for number, at, log, cells in self._database.execute(
            "SELECT topic, seconds(topic, stamp, log) AS at, log, cells FROM rows "
            f"ORDER BY {order}, rowid"
        ):
            if at is not None:
                yield self.topics[number], [at, log + _SIGNED], marshal.loads(cells)

    def joined(self) -> tuple[dict[str, type], Iterator[list[Any]]]:
        """Return columns and types of one table of all topics, and what yields its rows.

        There is one for each moment of a clock, with the values of all topics. Raises BagError:
        there are too many columns.
        """
        clocks = {topic.clock for topic in self.topics.values()}
        first = {_TIME: float, _RECORDED: int} | ({_CLOCK: str} if len(clocks) > 1 else {})
        own = {
            f"{topic.name}/{name}": kind
            for topic in self.topics.values()
            for name, kind in topic.columns.items()
        }
        if len(own) > _MOST_COLUMNS - 3:
            raise BagError(
                f"one table of all topics has more than {_MOST_COLUMNS} columns; "
                "name a folder, which takes a table for each topic"
            )
        return first | own, (
            [*moment[: len(first)], *map(row.get, own)] for moment, row in self._moments()
        )

    def _moments(self) -> Iterator[tuple[list[Any], dict[str, Any]]]:
        """Yield time, when it was recorded and clock, and the cells of all topics of a moment."""
        moment, row = list[Any](), dict[str, Any]()
        for topic, (at, recorded), cells in self.select("at"):
            more = {f"{topic.name}/{name}": cell for name, cell in cells.items()}
            if moment[::2] != [at, topic.clock] or row.keys() & more.keys():
                if moment:
                    yield moment, row
                moment, row = [at, recorded, topic.clock], {}
            row |= more
        if moment:
            yield moment, row


def _nearness(one: str, other: str) -> tuple[int, int]:
    """Return how many parts names of topics have in common; a topic of all comes first."""
    pairs = zip(one.split("/"), other.split("/"), strict=False)
    common = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
    return common, -one.count("/")


# -- tables


def _write_table(path: Path, columns: Iterable[str], rows: Iterable[list[Any]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(rows)


def _write_csv(path: Path, rows: _Rows) -> None:
    _write_table(path, *rows.joined())


def _write_folder(folder: Path, rows: _Rows) -> None:
    folder.mkdir()
    names = _file_names(topic.name for topic in rows.topics.values())
    for number, some in groupby(rows.select("topic"), key=lambda row: row[0].number):
        topic = rows.topics[number]
        own = (times + [cells.get(name) for name in topic.columns] for _, times, cells in some)
        path = folder / f"{names[topic.name]}.csv"
        _write_table(path, [_TIME, _RECORDED, *topic.columns], own)


def _parquet_writer(out: Path) -> Callable[[Path, _Rows], None]:
    """Return what writes Parquet; BagError if ``pyarrow`` is not there."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise BagError(
            f"{out.name} needs pyarrow: pip install 'stickslip_ros[parquet]', or write .csv"
        ) from None

    def write(path: Path, rows: _Rows) -> None:
        columns, found = rows.joined()
        arrow = {float: pyarrow.float64(), int: pyarrow.int64(), bool: pyarrow.bool_()}
        schema = pyarrow.schema(
            [(name, arrow.get(kind, pyarrow.string())) for name, kind in columns.items()]
        )
        with parquet.ParquetWriter(path, schema) as writer:
            while some := list(islice(found, _AT_ONCE)):
                cells = (
                    [None if one is None else kind(one) for one in column]
                    for kind, column in zip(columns.values(), zip(*some, strict=True), strict=True)
                )
                try:
                    batch = pyarrow.RecordBatch.from_arrays(
                        [pyarrow.array(*one) for one in zip(cells, schema.types, strict=True)],
                        schema=schema,
                    )
                except (OverflowError, pyarrow.ArrowException) as error:
                    raise BagError(
                        f"a number does not fit into {out.name}: {short(error)}; write .csv"
                    ) from error
                writer.write_batch(batch)

    return write


def _file_names(topics: Iterable[str]) -> dict[str, str]:
    """Return a name for the file of each topic, all different, that any disk takes."""
    names: dict[str, str] = {}
    for topic in topics:
        plain = printable(topic.strip("/").replace("/", ".")).encode()[:_LONGEST_NAME]
        name = plain.decode(errors="ignore") or "topic"
        names[topic] = name if name not in names.values() else f"{name}_{len(names)}"
    return names
