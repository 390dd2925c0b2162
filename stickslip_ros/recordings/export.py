# SPDX-License-Identifier: Apache-2.0
"""Recordings as tables, CSV or Parquet: one for each topic, or one of all, in order of time."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from stickslip_ros.files import whole_file, whole_folder
from stickslip_ros.recordings.cdr import STATUS_TYPE, decoder_for, nanoseconds, not_of_type
from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.reader import BagReader

JOINT_STATE = "sensor_msgs/msg/JointState"
#: The first columns of every table: s since the start of the bag by the stamp in the message, or
#: when it was recorded if it has none; and when it was recorded, ns since the Unix epoch
_TIME, _RECORDED = "time (s)", "recorded (ns)"
#: Longer arrays, images say, are no columns.
_LONGEST_ARRAY = 64
_BATCH = 10_000  # rows that a Parquet file takes at once

Row = dict[str, Any]
#: Called after each message
Note = Callable[[], object]


def export(bag: BagReader, out: Path, on_message: Note = lambda: None) -> Path:
    """Write the messages of a bag as tables.

    Parameters
    ----------
    bag : BagReader
        What to write.
    out : Path
        A file that ends in .csv or .parquet takes one table with a row for each moment, its columns
        named ``<topic>/<field>``; anything else is a new folder with a CSV file for each topic.
    on_message : callable, optional
        Called after each message.

    Returns
    -------
    Path
        What was written.

    Raises
    ------
    BagError
        The bag is damaged, has no messages that can be decoded, or ``pyarrow`` is not installed.
    WriteError
        The file or folder cannot be written.
    """
    topics = [name for name, count in bag.counts.items() if count and _decodable(bag, name)]
    if not topics:
        raise BagError(f"{bag.path} has no messages that can be decoded; record topics with cdr")
    if out.suffix in _WRITERS:
        with whole_file(out) as part:
            _WRITERS[out.suffix](part, lambda note: _joined(bag, topics, note), on_message)
    else:
        with whole_folder(out) as folder:
            folder.mkdir()
            for topic in topics:
                name = topic.strip("/").replace("/", ".") or "topic"
                rows = partial(_rows_of, bag, topic)
                _write_csv(folder / f"{name}.csv", rows, on_message)
    return out


def _decodable(bag: BagReader, topic: str) -> bool:
    try:
        decoder_for(bag.topics[topic])
    except BagError:
        return False
    return True


def _rows_of(bag: BagReader, topic: str, note: Note) -> Iterator[Row]:
    """Yield the rows of one topic."""
    return (row for _, row in _rows(bag, [topic], note))


def _joined(bag: BagReader, topics: list[str], note: Note) -> Iterator[Row]:
    """Yield a row for each moment, with what all topics say of it; its columns name the topic."""
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
    decoders = {topic: decoder_for(bag.topics[topic]) for topic in topics}
    for found in bag.messages(topics):
        message = decoders[found.topic](found.data)
        kind = bag.topics[found.topic].type
        try:
            stamp = getattr(getattr(message, "header", None), "stamp", None)
            ns = (nanoseconds(stamp) if stamp else 0) or found.log_ns
            when = {_TIME: 1e-9 * (ns - bag.start_ns), _RECORDED: found.log_ns}
            if kind == STATUS_TYPE:
                for status in message.status:
                    told = {pair.key: pair.value for pair in status.values}
                    head = {name: getattr(status, name) for name in ("name", "level", "message")}
                    yield found.topic, {**told, **head, **when}
            else:
                yield found.topic, {**dict(_fields(message, kind)), **when}
        except (AttributeError, TypeError, ValueError) as error:
            raise not_of_type(bag, found.topic, kind, error) from None
        note()


def _fields(message: Any, kind: str, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield names and values of what a message holds; those of joints are named after them."""
    if kind == JOINT_STATE:
        for name in ("position", "velocity", "effort"):
            for joint, value in zip(message.name, getattr(message, name), strict=False):
                yield f"{joint}/{name}", value
        return
    for name in message.__slots__:
        value = getattr(message, name)
        if isinstance(value, bool | int | float | str):
            yield f"{prefix}{name}", value
        elif isinstance(value, list):
            for number, one in enumerate(value[:_LONGEST_ARRAY]):
                if isinstance(one, bool | int | float | str):
                    yield f"{prefix}{name}[{number}]", one
                elif hasattr(one, "__slots__"):
                    yield from _fields(one, "", f"{prefix}{name}[{number}].")
        elif hasattr(value, "__slots__") and (prefix or name != "header"):
            yield from _fields(value, "", f"{prefix}{name}.")


def _columns(rows: Iterable[Row]) -> dict[str, type]:
    """Return the columns of a table: time, what was recorded first, and so on; each with a type."""
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
