# SPDX-License-Identifier: Apache-2.0
"""The MCAP files of a bag as one: their topics, their messages in order of time."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from stickslip_ros.recordings.errors import BagError, damaged
from stickslip_ros.recordings.mcap_reader import BagMessage, McapReader, Row, Wanted
from stickslip_ros.recordings.mcap_records import LARGEST_CHUNK
from stickslip_ros.recordings.metadata import StoredMetadata, TopicDescription, parse_metadata

# Chunks that overlap in time have to be in memory together. Recorders make one or two such, tools
# that write topic after topic a few dozen.
_LARGEST_OPEN = LARGEST_CHUNK + LARGEST_CHUNK // 2
#: An open span: the time of its next message (ns), its number, which no two have, that message,
#: the others, its size (bytes)
_Open = tuple[int, int, BagMessage, Iterator[BagMessage], int]


class McapFiles:
    """Open files.

    :ivar topics: by name.
    :ivar counts: messages by topic.
    :ivar files: a summary of each.
    :ivar sizes: as they lie on the disk, bytes by name.
    :ivar compressions: of the chunks: "zstd", "lz4", "" for none.
    :ivar libraries: names of the programs that wrote the files.
    """

    def __init__(self, path: Path, files: list[Path]) -> None:
        """Open the files of a bag.

        :raises BagError: one cannot be read.
        """
        self._path = path
        self._readers: list[McapReader] = []
        self.topics: dict[str, TopicDescription] = {}
        self.counts: Counter[str] = Counter()
        try:
            for file in files:
                self._readers.append(McapReader(file))
                self._add_topics(self._readers[-1])
        except BaseException:
            self.close()
            raise
        self.files = [reader.summary() for reader in self._readers]
        self.sizes = {reader.path.name: reader.stored_size for reader in self._readers}
        self.compressions = sorted({one for reader in self._readers for one in reader.compressions})
        self.libraries = sorted({reader.library for reader in self._readers})

    def _add_topics(self, reader: McapReader) -> None:
        self.counts.update(reader.counts)
        for topic in reader.channels.topics.values():
            known = self.topics.setdefault(topic.name, topic)
            if known.type != topic.type:
                types = f"{known.type} and {topic.type}"
                raise damaged(reader.path, f"topic {topic.name} has two types, {types}")

    def close(self) -> None:
        """Close the files; twice does no harm."""
        for reader in self._readers:
            reader.close()

    @property
    def metadata(self) -> StoredMetadata:
        """The metadata in the last file that has any; BagError if they are broken."""
        for reader in reversed(self._readers):
            if reader.metadata_text:
                try:
                    return parse_metadata(reader.metadata_text)
                except ValueError as error:
                    raise damaged(reader.path, f"its metadata: {error}") from error
        return StoredMetadata()

    def messages(self, wanted: Wanted) -> Iterator[BagMessage]:
        """Yield messages in order of time; those of one time in the order of their spans.

        :raises BagError: a file is damaged.
        """
        heap: list[_Open] = []
        for number, (reader, row) in enumerate(self._spans(wanted)):
            yield from _messages_before(row[0], heap)
            records = reader.records(row)
            others = reader.messages_of(records, row, wanted)
            if first := next(others, None):
                heapq.heappush(heap, (first.log_ns, number, first, others, len(records)))
            if sum(span[-1] for span in heap) > _LARGEST_OPEN and len(heap) > 1:
                raise BagError(
                    f"{self._path}: its messages are too far out of order to be sorted in "
                    "memory; sort them with `mcap sort` or `ros2 bag convert`"
                )
        yield from _messages_before(Wanted().end_ns, heap)

    def _spans(self, wanted: Wanted) -> Iterator[tuple[McapReader, Row]]:
        """Yield the spans that may hold wanted messages, by their first time."""
        starts = [reader.spans["start"] for reader in self._readers]
        counts = [len(each) for each in starts]
        owners = np.repeat(np.arange(len(counts)), counts)
        places = np.concatenate([np.arange(count) for count in counts])
        for i in np.argsort(np.concatenate(starts), kind="stable"):
            reader = self._readers[owners[i]]
            row = reader.spans[places[i]].item()
            if row[0] < wanted.end_ns and row[1] >= wanted.start_ns:
                yield reader, row


def _messages_before(end_ns: int, heap: list[_Open]) -> Iterator[BagMessage]:
    """Yield the messages of open spans before a time, in order of time."""
    while heap and heap[0][0] < end_ns:
        _, number, message, others, size = heap[0]
        yield message
        if following := next(others, None):
            heapq.heapreplace(heap, (following.log_ns, number, following, others, size))
        else:
            heapq.heappop(heap)
