# SPDX-License-Identifier: Apache-2.0
"""Reader of recordings: rosbag2 folders and single MCAP files, whoever wrote them."""

from __future__ import annotations

import heapq
import logging
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from stickslip_ros.opening import Allowance
from stickslip_ros.recordings.errors import BagError, damaged
from stickslip_ros.recordings.folder import MCAP_ENDS, files_in, not_mcap, stored_metadata
from stickslip_ros.recordings.mcap_reader import BagMessage, McapReader, Row, Span, Wanted
from stickslip_ros.recordings.mcap_records import LARGEST_CHUNK, reading
from stickslip_ros.recordings.metadata import (
    METADATA_FILE,
    FileSummary,
    StoredMetadata,
    TopicDescription,
    metadata_record,
)
from stickslip_ros.recordings.unpacking import UnpackError, unpack_message

_LOG = logging.getLogger(__name__)

# Chunks that overlap in time have to be in memory together. Recorders make one or two such, tools
# that write topic after topic a few dozen.
_LARGEST_OPEN = LARGEST_CHUNK + LARGEST_CHUNK // 2


class BagReader:
    """A recording, open for reading; also a context manager that closes it.

    :ivar path: what was opened.
    :ivar topics: every topic by its name, those without messages too.
    :ivar counts: messages by topic.
    :ivar files: the storage files.
    :ivar sizes: of the storage files as they lie on the disk, bytes by name.
    :ivar warnings: what may be missing, a sentence each; none if nothing is.
    :ivar metadata: what ``metadata.yaml``, or without one the files, say besides.
    :ivar compressions: of the chunks: "zstd", "lz4", "" for none.
    :ivar libraries: names of the programs that wrote the files.
    """

    def __init__(self, path: Path | str) -> None:
        """Open a folder or a file; messages are read later.

        :raises BagError: it cannot be read; the text names the file and the cure.
        """
        self._begin(path)
        self._open_files: list[McapReader] = []
        try:
            with reading(self.path):
                stored = stored_metadata(self.path)
                if stored and stored.storage not in ("", "mcap"):
                    raise not_mcap(self.path, stored.storage)
                for file in self._storage_files(stored):
                    self._open_files.append(McapReader(file))
            self.metadata = stored or self._metadata_inside()
            self._merge_topics()
        except BaseException:
            self.close()
            raise
        self.files: list[FileSummary] = [file.summary() for file in self._open_files]
        self.sizes = {file.path.name: file.stored_size for file in self._open_files}
        self.compressions = sorted({c for file in self._open_files for c in file.compressions})
        self.libraries = sorted({file.library for file in self._open_files})
        if stored:
            self._compare_with_metadata()

    def _begin(self, path: Path | str) -> None:
        self.path = Path(path).expanduser().absolute()
        self.topics: dict[str, TopicDescription] = {}
        self.counts: dict[str, int] = {}
        self.warnings: list[str] = []
        self.metadata = StoredMetadata()

    def __enter__(self) -> BagReader:
        """Return the open bag."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close the bag."""
        self.close()

    def close(self) -> None:
        """Close the files; twice does no harm."""
        for file in self._open_files:
            file.close()

    @property
    def message_count(self) -> int:
        """Messages in the bag."""
        return sum(self.counts.values())

    @property
    def start_ns(self) -> int:
        """Log time of the first message, ns since the Unix epoch; 0 if there is none."""
        return min((file.start_ns for file in self.files if file.message_count), default=0)

    @property
    def end_ns(self) -> int:
        """Log time of the last message, ns since the Unix epoch; 0 if there is none."""
        return max((file.end_ns for file in self.files if file.message_count), default=0)

    @property
    def custom_data(self) -> dict[str, str]:
        """Text by key that the recorder left in the metadata."""
        return self.metadata.custom_data

    def messages(
        self,
        topics: Iterable[str] | None = None,
        start: int | None = None,
        end: int | None = None,
    ) -> Iterator[BagMessage]:
        """Yield messages in order of log time, over all files, reading as it goes.

        :param topics: names, all topics if None.
        :param start: ns since the Unix epoch, the first time to take.
        :param end: ns since the Unix epoch, the first time not to take.
        :raises BagError: a topic is not in the bag; while reading: a file is damaged.
        """
        wanted = self._wanted(topics, start, end)
        found = self._in_order(wanted)
        return self._unpacked(found) if self.metadata.compression_mode == "message" else found

    def _wanted(self, topics: Iterable[str] | None, start: int | None, end: int | None) -> Wanted:
        wanted = Wanted(
            None if topics is None else frozenset(topics),
            0 if start is None else start,
            2**64 if end is None else end,
        )
        for name in sorted(wanted.topics or ()):
            if name not in self.topics:
                known = ", ".join(sorted(self.topics)) or "none at all"
                raise BagError(f"{self.path} has no topic {name}; it has {known}")
        return wanted

    def _in_order(self, wanted: Wanted) -> Iterator[BagMessage]:
        spans = self._spans(wanted)
        waiting = next(spans, None)
        heap: list[tuple[int, int, Span]] = []
        held = number = found = 0
        while heap or waiting:
            while waiting and (not heap or waiting[1][0] <= heap[0][0]):
                file, row = waiting
                span = Span(file, row, wanted)
                found += span.count
                waiting = next(spans, None)
                if span.next_ns is None:
                    continue
                number += 1  # messages of the same time stay in the order of their spans
                heapq.heappush(heap, (span.next_ns, number, span))
                held += span.size
                if held > _LARGEST_OPEN and len(heap) > 1:
                    raise BagError(
                        f"{self.path}: its messages are too far out of order to be sorted in "
                        "memory; sort them with `mcap sort` or `ros2 bag convert`"
                    )
            if not heap:
                break
            _, own, span = heap[0]
            yield span.take()
            if span.next_ns is None:
                heapq.heappop(heap)
                held -= span.size
            else:
                heapq.heapreplace(heap, (span.next_ns, own, span))
        self._compare_counts(wanted, found)

    def _compare_counts(self, wanted: Wanted, found: int) -> None:
        """Raise BagError if a whole topic has been read and had fewer or more messages than told.

        :param wanted: what was read.
        :param found: how many messages there were.
        """
        told = sum(
            self.counts[n] for n in (self.counts if wanted.topics is None else wanted.topics)
        )
        if (wanted.start_ns, wanted.end_ns) == (0, Wanted().end_ns) and found != told:
            raise damaged(self.path, f"{told} messages are counted, {found} were found")

    def _spans(self, wanted: Wanted) -> Iterator[tuple[McapReader, Row]]:
        """Yield the spans that may hold wanted messages, by their first time."""
        starts = [file.spans["start"] for file in self._open_files]
        counts = [len(each) for each in starts]
        owners = np.repeat(np.arange(len(counts)), counts)
        places = np.concatenate([np.arange(count) for count in counts] or [owners])
        order = np.argsort(np.concatenate(starts or [owners]), kind="stable")
        for i in order:
            file = self._open_files[owners[i]]
            row = file.spans[places[i]].item()
            if row[0] < wanted.end_ns and row[1] >= wanted.start_ns:
                yield file, row

    def _unpacked(self, messages: Iterator[BagMessage]) -> Iterator[BagMessage]:
        allowance = Allowance(self.path, sum(self.sizes.values()))
        for message in messages:
            with reading(self.path):
                try:
                    data = unpack_message(message.data, allowance)
                except UnpackError as error:
                    raise damaged(self.path, f"a message on {message.topic}: {error}") from error
            yield message._replace(data=data)

    def _compare_with_metadata(self) -> None:
        told = self.metadata.message_count
        if told not in (None, self.message_count) and not self.warnings:
            self._warn(
                f"{METADATA_FILE} of {self.path} counts {told} messages, its files hold "
                f"{self.message_count}; `ros2 bag reindex` writes it anew"
            )

    def _warn(self, what: str) -> None:
        self.warnings.append(what)
        _LOG.warning(what)  # on stderr, unless the program says otherwise

    def _storage_files(
        self, stored: StoredMetadata | None, ends: tuple[str, ...] = MCAP_ENDS
    ) -> list[Path]:
        if not self.path.exists():
            raise BagError(f"there is no bag {self.path}; check the name")
        if not self.path.is_dir():
            return [self.path]
        if not (stored and stored.files):
            return files_in(self.path, ends)
        # Some versions put the name of the folder in front; the files lie in it in any case.
        found = [self.path / Path(name).name for name in stored.files]
        if missing := [file.name for file in found if not file.exists()]:
            raise BagError(
                f"{self.path} lacks {', '.join(missing)}, which its {METADATA_FILE} names; "
                f"restore it, or move {METADATA_FILE} away to read the rest"
            )
        if others := [file.name for file in files_in(self.path, ends) if file not in found]:
            self._warn(
                f"{METADATA_FILE} of {self.path} does not name {', '.join(others)}, which is "
                "left out; `stickslip bag recover` makes a bag with all files"
            )
        return found

    def _metadata_inside(self) -> StoredMetadata:
        """Return the metadata in the last file that has any."""
        for file in reversed(self._open_files):
            if file.metadata_text:
                try:
                    return metadata_record(file.metadata_text)
                except ValueError as error:
                    raise damaged(file.path, f"its metadata: {error}") from error
        return StoredMetadata()

    def _merge_topics(self) -> None:
        counts: Counter[str] = Counter()
        for file in self._open_files:
            counts.update(file.counts)
            for topic in file.channels.topics.values():
                known = self.topics.setdefault(topic.name, self.metadata.completed(topic))
                if known.type != topic.type:
                    raise damaged(
                        file.path,
                        f"topic {topic.name} has two types, {known.type} and {topic.type}",
                    )
        for topic in self.metadata.topics:
            self.topics.setdefault(topic.name, topic)
        self.topics = dict(sorted(self.topics.items()))
        self.counts = {name: counts[name] for name in self.topics}
