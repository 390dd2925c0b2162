# SPDX-License-Identifier: Apache-2.0
"""The sound MCAP files of a bag: their topics, where messages are, messages in order of time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Header

from stickslip_ros.recordings.errors import BagError, damaged, reading
from stickslip_ros.recordings.mcap_file import McapFile, Span
from stickslip_ros.recordings.mcap_records import (
    LARGEST_CHUNK,
    MAGIC,
    SMALLEST_MESSAGE,
    Block,
    Chunk,
    Part,
    body_at,
    merged,
    messages_in,
    parse,
    place_at,
)
from stickslip_ros.recordings.metadata import (
    FileSummary,
    StoredMetadata,
    TopicDescription,
    parse_metadata,
)

# Chunks that overlap in time have to be in memory together. Recorders make one or two such, tools
# that write topic after topic a few dozen.
_LARGEST_OPEN = LARGEST_CHUNK + LARGEST_CHUNK // 2


class Wanted(NamedTuple):
    """Which messages to take: topics (None: all), from start up to but without end, ns."""

    topics: frozenset[str] | None = None
    start_ns: int = 0
    end_ns: int = 2**64


class McapReader(McapFile):
    """A finished MCAP file; its content is known when it has been opened."""

    def __init__(self, path: Path) -> None:
        """Open the file and read its index, or the whole file if it has no index.

        Raises BagError: it cannot be read, was not finished or is damaged.
        """
        super().__init__(path)
        self.counts: Counter[str] = Counter()  #: of the messages, by topic
        self._times: tuple[int, int] | None = None
        try:
            with reading(path):
                footer = self.footer()
                first = place_at(self.stream, len(MAGIC), self.size)
                if first.opcode != Opcode.HEADER:
                    raise ValueError("its first record is not a header")
                self.library: str = parse(Header, body_at(self.stream, first)).library
                if footer.summary_start:
                    self.read_index(footer)
                if not self._is_complete():
                    self._read_everything(footer.summary_start or self.records_end)
        except BaseException:
            self.close()
            raise

    def summary(self) -> FileSummary:
        """Return name, size, message count, first and last log time."""
        count = sum(self.counts.values())
        if not count:
            return FileSummary(self.path.name, self.stored_size)
        # A chunk without messages says 0; the statistics of the file know better.
        start, end = self._times or (
            min(span.start_ns for span in self.spans),
            max(span.end_ns for span in self.spans),
        )
        return FileSummary(self.path.name, self.stored_size, count, start, end)

    def _is_complete(self) -> bool:
        """Use the index; return False if it lacks needed information."""
        statistics, topics = self.statistics, self.channels.topics
        if statistics is None:
            return False
        counts, chunks = statistics.channel_message_counts, len(self.spans)
        if (
            len(topics) < statistics.channel_count
            or chunks < statistics.chunk_count
            or not counts.keys() <= topics.keys()
            or sum(counts.values()) != statistics.message_count
            or (counts and not chunks)
        ):
            return False
        unpacked = sum(span.size for span in self.spans)
        self.allowance.spend(unpacked)
        if statistics.message_count > unpacked // SMALLEST_MESSAGE:
            raise ValueError(
                f"its index counts {statistics.message_count} messages; "
                f"{unpacked // SMALLEST_MESSAGE} at most fit into its chunks"
            )
        for channel, count in counts.items():
            self.counts[topics[channel].name] += count
        self._times = statistics.message_start_time, statistics.message_end_time
        return True

    def _read_everything(self, end: int) -> None:
        """Find and count the messages of a file without a full index."""
        self.spans, self.compressions = [], set()
        for piece in self.pieces(end):
            heads = messages_in(piece.records, self.channels.learn).heads
            for channel, count in zip(
                *np.unique(heads["channel"], return_counts=True), strict=True
            ):
                self.counts[self._name_of(int(channel))] += int(count)
            if piece.chunk or len(heads):
                self.compressions.add(piece.chunk.compression if piece.chunk else "")
            if len(heads):
                times = int(heads["log_ns"].min()), int(heads["log_ns"].max())
                length = piece.end - piece.start
                self.spans.append(Span(*times, piece.start, length, len(piece.records)))

    def _name_of(self, channel: int) -> str:
        if channel not in self.channels.topics:
            raise ValueError(f"a message names channel {channel}, which does not exist")
        return self.channels.topics[channel].name

    def records(self, span: Span) -> bytes:
        """Return the records of a span, out of their chunk if they are in one.

        Raises BagError: they are damaged.
        """
        end = span.offset + span.length
        with reading(self.path):
            if end > self.size:
                raise ValueError("its index points beyond its end")
            place = place_at(self.stream, span.offset, end)
            if place.opcode != Opcode.CHUNK or place.end != end:
                return self.read(span.offset, span.length)
            chunk = Chunk.read(self.stream, place)
            if chunk.size > span.size:
                raise ValueError("a chunk is larger than its index says")
            return chunk.unpacked(None)  # the allowance has covered the sizes in the index

    def messages_of(self, span: Span, wanted: Wanted) -> Part:
        """Return the wanted messages of a span, in order of time, and the topics by channel.

        Raises BagError: they are damaged.
        """
        records = self.records(span)
        with reading(self.path):
            found = messages_in(records, self.channels.learn)
            times, channels = found.heads["log_ns"], found.heads["channel"]
            names = {number: self._name_of(number) for number in set(channels.tolist())}
            if len(times) and not (span.start_ns <= times.min() and times.max() <= span.end_ns):
                raise ValueError("a message lies outside the time range of the index")
        chosen = np.ones(len(times), bool)
        if wanted.topics is not None:
            chosen &= np.isin(channels, [n for n, name in names.items() if name in wanted.topics])
        if wanted.start_ns > span.start_ns or wanted.end_ns <= span.end_ns:
            start, end = (min(ns, 2**64 - 1) for ns in (wanted.start_ns, wanted.end_ns))
            chosen &= (times >= start) & (times < end)
        order = np.flatnonzero(chosen)
        return found.chosen(order[np.argsort(times[order], kind="stable")]), names


class McapFiles:
    """The open MCAP files of a bag as one."""

    def __init__(self, path: Path, files: list[Path]) -> None:
        """Open the files of a bag.

        Raises BagError: one cannot be read.
        """
        self._path = path
        self._readers: list[McapReader] = []
        self.topics: dict[str, TopicDescription] = {}  #: by name
        self.counts: Counter[str] = Counter()  #: messages by topic
        try:
            for file in files:
                reader = McapReader(file)
                self._readers.append(reader)
                self.counts.update(reader.counts)
                for topic in reader.channels.topics.values():
                    known = self.topics.setdefault(topic.name, topic)
                    if known.type != topic.type:
                        types = f"{known.type} and {topic.type}"
                        raise damaged(file, f"topic {topic.name} has two types, {types}")
        except BaseException:
            self.close()
            raise
        self.files = [reader.summary() for reader in self._readers]  #: a summary of each
        #: of the chunks: "zstd", "lz4", "" for none
        self.compressions = sorted({one for reader in self._readers for one in reader.compressions})
        #: names of the programs that wrote the files
        self.libraries = sorted({reader.library for reader in self._readers})

    def close(self) -> None:
        """Close the files; twice does no harm."""
        for reader in self._readers:
            reader.close()

    @property
    def metadata(self) -> StoredMetadata:
        """The metadata in the last file that has any; BagError if they are broken."""
        for reader in reversed(self._readers):
            if reader.channels.metadata_text:
                try:
                    return parse_metadata(reader.channels.metadata_text)
                except ValueError as error:
                    raise damaged(reader.path, f"its metadata: {error}") from error
        return StoredMetadata()

    def blocks(self, wanted: Wanted) -> Iterator[Block]:
        """Yield messages in order of time; at one time, in the order of their spans.

        Raises BagError: a file is damaged.
        """
        found = [
            (span, reader)
            for reader in self._readers
            for span in reader.spans
            if span.start_ns < wanted.end_ns and span.end_ns >= wanted.start_ns
        ]
        found.sort(key=lambda one: one[0].start_ns)
        opened: list[Part] = []
        for opening in [*found, None]:
            done, left = [], []
            for messages, names in opened:
                count = len(messages.starts)
                if opening:
                    until = np.uint64(opening[0].start_ns)
                    count = int(np.searchsorted(messages.heads["log_ns"], until))
                done.append((messages.chosen(slice(count)), names))
                if count < len(messages.starts):
                    left.append((messages.chosen(slice(count, None)), names))
            if done:
                yield from merged(done)
            opened = left
            if opening:
                span, reader = opening
                opened.append(reader.messages_of(span, wanted))
            if len(opened) > 1 and sum(len(one.records) for one, _ in opened) > _LARGEST_OPEN:
                raise BagError(
                    f"{self._path}: its messages are too far out of order to be sorted in "
                    "memory; sort them with `mcap sort` or `ros2 bag convert`"
                )
