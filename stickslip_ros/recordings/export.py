# SPDX-License-Identifier: Apache-2.0
"""Recordings as tables, CSV or Parquet: one for each topic, or one of all, in order of time."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from stickslip_ros.files import whole_file, whole_folder
from stickslip_ros.recordings.cdr import decode_messages, decoder_for, fields_of, not_of_type
from stickslip_ros.recordings.errors import BagError, UndecodableError
from stickslip_ros.recordings.message_types import STATUS_TYPE, stamp_of
from stickslip_ros.recordings.reader import BagReader

#: The first columns of every table: s since the start of the bag by the stamp in the message, or
#: when it was recorded if it has none; and when it was recorded, ns since the Unix epoch
_TIME, _RECORDED = "time (s)", "recorded (ns)"
_LONGEST_ARRAY = 64  # values of one whose values are columns; images have millions
_BATCH = 10_000  # rows that a Parquet file takes at once

Row = dict[str, Any]
#: The columns of a table with the type of each.
Columns = dict[str, type]
#: Called after each message
Note = Callable[[], object]


class Exported(NamedTuple):
    """What was written of a bag, and what was not."""

    path: Path  #: the file or folder
    left_out: dict[str, str]  #: topics that cannot be decoded, each with the reason


def export(bag: BagReader, out: Path, on_message: Note = lambda: None) -> Exported:
    """Write the messages of a bag as tables; topics that cannot be decoded are left out and named.

    Parameters
    ----------
    bag : BagReader
        The bag to export.
    out : Path
        A file that ends in .csv or .parquet takes one table with a row for each moment, its columns
        named ``<topic>/<field>``; anything else is a new folder with a CSV file for each topic.
    on_message : callable, optional
        Called after each message.

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
    columns, left_out = readable_topics(bag)
    if not columns:
        why = "".join(f"; {reason}" for reason in left_out.values())
        raise BagError(f"{bag.path} has no messages that can be decoded; record some with cdr{why}")
    if out.suffix in _WRITERS:
        with whole_file(out) as part:
            _WRITERS[out.suffix](part, _joined(columns), _join_rows(bag, list(columns), on_message))
    else:
        with whole_folder(out) as folder:
            folder.mkdir()
            for topic, kinds in columns.items():
                name = topic.strip("/").replace("/", ".") or "topic"
                _write_csv(folder / f"{name}.csv", kinds, _rows_of(bag, topic, on_message))
    return Exported(out, left_out)


def readable_topics(bag: BagReader) -> tuple[dict[str, Columns], dict[str, str]]:
    """Return the columns of the topics that can be decoded, and why others cannot, by topic.

    Every message is decoded. Raises BagError: the bag is damaged.
    """
    columns, left_out = dict[str, Columns](), dict[str, str]()
    for topic in [name for name, count in bag.counts.items() if count]:
        try:
            decoder_for(bag.topics[topic])
        except BagError as error:
            left_out[topic] = str(error)
            continue
        try:
            columns[topic] = _columns(_rows_of(bag, topic, lambda: None))
        except UndecodableError as error:
            left_out[topic] = str(error)
    return columns, left_out


def _joined(columns: dict[str, Columns]) -> Columns:
    """Return the columns of one table of all topics, named by topic."""
    joined: Columns = {_TIME: float, _RECORDED: int}
    for topic, kinds in columns.items():
        joined |= {f"{topic}/{name}": one for name, one in kinds.items() if name not in joined}
    return joined


def _rows_of(bag: BagReader, topic: str, note: Note) -> Iterator[Row]:
    """Yield the rows of one topic."""
    return (row for _, row in _rows(bag, [topic], note))


def _join_rows(bag: BagReader, topics: list[str], note: Note) -> Iterator[Row]:
    """Yield a row for each time, with the values of all topics; columns are named by topic."""
    waiting: Row = {}
    for topic, row in _rows(bag, topics, note):
        when = {name: row.pop(name) for name in (_TIME, _RECORDED)}
        named = {f"{topic}/{name}": value for name, value in row.items()}
        if waiting and (waiting[_TIME] != when[_TIME] or waiting.keys() & named.keys()):
            yield waiting
            waiting = {}
        waiting = {**when, **waiting, **named}
    if waiting:
        yield waiting


def _rows(bag: BagReader, topics: list[str], note: Note) -> Iterator[tuple[str, Row]]:
    """Yield topic and row of each message, of each status of diagnostics and events."""
    for found, message in decode_messages(bag, topics):
        kind = bag.topics[found.topic].type
        try:
            seconds = 1e-9 * (stamp_of(message, found.log_ns) - bag.start_ns)
            when = {_TIME: seconds, _RECORDED: found.log_ns}
            if kind == STATUS_TYPE:
                for status in message.status:
                    values = {pair.key: pair.value for pair in status.values}
                    head = {name: getattr(status, name) for name in ("name", "level", "message")}
                    yield found.topic, {**values, **head, **when}
            else:
                yield found.topic, {**dict(fields_of(message, kind, _LONGEST_ARRAY)), **when}
        except (AttributeError, TypeError, ValueError) as error:
            raise not_of_type(bag, found.topic, error) from None
        note()


def _columns(rows: Iterable[Row]) -> Columns:
    """Return the columns of a table, each with its type: time, then in the order of recording."""
    kinds: Columns = {_TIME: float, _RECORDED: int}
    for row in rows:
        for name, value in row.items():
            kind = kinds.setdefault(name, type(value))
            if kind is not type(value):
                kinds[name] = float if {kind, type(value)} <= {int, float} else str
    return kinds


def _write_csv(path: Path, columns: Columns, rows: Iterable[Row]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(columns))
        writer.writeheader()
        writer.writerows(rows)


def _write_parquet(path: Path, columns: Columns, rows: Iterable[Row]) -> None:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise BagError(
            f"{path.name} needs pyarrow: pip install 'stickslip_ros[parquet]', or write .csv"
        ) from None
    arrow = {float: pyarrow.float64(), int: pyarrow.int64(), bool: pyarrow.bool_()}
    schema = pyarrow.schema([(n, arrow.get(kind, pyarrow.string())) for n, kind in columns.items()])
    texts = [name for name, kind in columns.items() if kind not in arrow]
    table = iter(rows)
    with parquet.ParquetWriter(path, schema) as writer:
        while batch := list(islice(table, _BATCH)):
            for row in batch:
                row.update({name: str(row[name]) for name in texts if name in row})
            writer.write_batch(pyarrow.RecordBatch.from_pylist(batch, schema))


_WRITERS = {".csv": _write_csv, ".parquet": _write_parquet}
