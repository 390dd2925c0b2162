# SPDX-License-Identifier: Apache-2.0
"""Recordings as tables, CSV or Parquet: one for each topic, or one of all, in order of time."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from stickslip_ros.files import whole_file, whole_folder
from stickslip_ros.recordings.cdr import decode_messages, decoder_for, fields_of, not_of_type
from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.message_types import STATUS_TYPE, stamp_of
from stickslip_ros.recordings.reader import BagReader

#: The first columns of every table: s since the start of the bag by the stamp in the message, or
#: when it was recorded if it has none; and when it was recorded, ns since the Unix epoch
_TIME, _RECORDED = "time (s)", "recorded (ns)"
_LONGEST_ARRAY = 64  # values of one whose values are columns; images have millions
_BATCH = 10_000  # rows that a Parquet file takes at once

Row = dict[str, Any]
#: Called after each message
Note = Callable[[], object]


def export(bag: BagReader, out: Path, on_message: Note = lambda: None) -> Path:
    """Write the messages of a bag as tables.

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
    Path
        The file or folder written.

    Raises
    ------
    BagError
        The bag is damaged, has no messages that can be decoded, or ``pyarrow`` is not installed.
    WriteError
        The file or folder cannot be written.
    """
    topics = []
    for topic in [name for name, count in bag.counts.items() if count]:
        with suppress(BagError):  # what cannot be decoded is left out
            decoder_for(bag.topics[topic])
            topics.append(topic)
    if not topics:
        raise BagError(f"{bag.path} has no messages that can be decoded; record topics with cdr")
    if out.suffix in _WRITERS:
        with whole_file(out) as part:
            _WRITERS[out.suffix](part, lambda note: _join_rows(bag, topics, note), on_message)
    else:
        with whole_folder(out) as folder:
            folder.mkdir()
            for topic in topics:
                name = topic.strip("/").replace("/", ".") or "topic"
                _write_csv(folder / f"{name}.csv", partial(_rows_of, bag, topic), on_message)
    return out


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


def _columns(rows: Iterable[Row]) -> dict[str, type]:
    """Return the columns of a table, each with its type: time, then in the order of recording."""
    kinds: dict[str, type] = {_TIME: float, _RECORDED: int}
    for row in rows:
        for name, value in row.items():
            kind = kinds.setdefault(name, type(value))
            if kind is not type(value):
                kinds[name] = float if {kind, type(value)} <= {int, float} else str
    return kinds


def _write_csv(path: Path, rows: Callable[[Note], Iterator[Row]], note: Note) -> None:
    columns = _columns(rows(lambda: None))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(columns))
        writer.writeheader()
        writer.writerows(rows(note))


def _write_parquet(path: Path, rows: Callable[[Note], Iterator[Row]], note: Note) -> None:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise BagError(
            f"{path.name} needs pyarrow: pip install 'stickslip_ros[parquet]', or write .csv"
        ) from None
    columns = _columns(rows(lambda: None))
    arrow = {float: pyarrow.float64(), int: pyarrow.int64(), bool: pyarrow.bool_()}
    schema = pyarrow.schema([(n, arrow.get(kind, pyarrow.string())) for n, kind in columns.items()])
    texts = [name for name, kind in columns.items() if kind not in arrow]
    table = rows(note)
    with parquet.ParquetWriter(path, schema) as writer:
        while batch := list(islice(table, _BATCH)):
            for row in batch:
                row.update({name: str(row[name]) for name in texts if name in row})
            writer.write_batch(pyarrow.RecordBatch.from_pylist(batch, schema))


_WRITERS = {".csv": _write_csv, ".parquet": _write_parquet}
