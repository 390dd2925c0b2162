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
        """Yield messages in order of time; at one time, in the order of their spans.

        :raises BagError: a file is damaged.
        """
        spans = self._spans(wanted)
        waiting = next(spans, None)
        # The next message of each open span; its number, which no two have; the others; its size.
        heap: list[tuple[int, int, BagMessage, Iterator[BagMessage], int]] = []
        held = number = 0
        while heap or waiting:
            while waiting and (not heap or waiting[1][0] <= heap[0][0]):
                reader, row = waiting
                records = reader.records(row)
                others = reader.messages_of(records, row, wanted)
                first = next(others, None)
                waiting = next(spans, None)
                if first is None:
                    continue
                number += 1
                heapq.heappush(heap, (first.log_ns, number, first, others, len(records)))
                held += len(records)
                if held > _LARGEST_OPEN and len(heap) > 1:
                    raise BagError(
                        f"{self._path}: its messages are too far out of order to be sorted in "
                        "memory; sort them with `mcap sort` or `ros2 bag convert`"
                    )
            if not heap:
                break
            _, own, message, others, size = heap[0]
            yield message
            following = next(others, None)
            if following is None:
                heapq.heappop(heap)
                held -= size
            else:
                heapq.heapreplace(heap, (following.log_ns, own, following, others, size))

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
