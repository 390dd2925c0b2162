# SPDX-License-Identifier: Apache-2.0
"""Messages out of an MCAP file that is cut or damaged: everything that is whole, nothing else.

Checksums decide. What a chunk with a right checksum says of topics counts; the index counts if its
own checksum is right; what no checksum protects is kept where nothing contradicts it, and reported.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Statistics

from stickslip_ros.recordings.cdr import decoder_for
from stickslip_ros.recordings.channels import Channels
from stickslip_ros.recordings.damage_scanner import DamageScanner
from stickslip_ros.recordings.errors import BagError
from stickslip_ros.recordings.mcap_file import Block
from stickslip_ros.recordings.mcap_reader import BagMessage
from stickslip_ros.recordings.mcap_records import BROKEN, MESSAGE_HEAD, metadata_text, records_in
from stickslip_ros.recordings.metadata import TopicDescription
from stickslip_ros.recordings.unpacking import UnpackError, unpack_message

Found = tuple[TopicDescription, BagMessage]


class DamagedMcap(DamageScanner):
    """One pass over a file; its attributes are complete when :meth:`messages` has ended.

    :ivar metadata_text: the last metadata that rosbag2 left in the file, "" if none.
    """

    def __init__(
        self, path: Path, on_bytes: Callable[[int], object], packed_messages: bool = False
    ) -> None:
        """Open the file, as a scanner of damage does.

        :param packed_messages: whether rosbag2 packed each message with zstd by itself.
        """
        super().__init__(path, on_bytes)
        self.metadata_text = ""
        self._packed_messages = packed_messages
        self._protected = Channels()  # of chunks and an index with the right checksum
        self._unprotected = Channels()  # of what no checksum protects

    def messages(self) -> Iterator[Found]:
        """Yield every message that is whole, in the order of the file."""
        if not self.size:
            return
        # What stands in the index is known even if the chunk with its first description is lost.
        statistics = self._learn_from_index()
        kept = 0
        for block in self.blocks():
            for found in self._messages_in(block):
                kept += 1
                yield found
        damage = self.damage
        if damage.dropped_bytes:
            damage.find(f"is damaged: {damage.dropped_bytes} bytes were left out")
        if statistics and statistics.message_count != kept:
            damage.find(f"had {statistics.message_count} messages by its index, {kept} were found")
        if damage.unprotected and damage.findings:
            damage.find(
                f"has no checksum for {damage.unprotected} of these messages or their topics"
            )

    def _learn_from_index(self) -> Statistics | None:
        """Learn topics; return the counts that the index holds."""
        try:
            footer = self.footer()
        except BROKEN:
            self.damage.find("has no end: what its writer had not written yet is missing")
            return None
        if not footer.summary_start:
            return None
        channels = self._protected if footer.summary_crc else self._unprotected
        try:
            return self.index(footer, channels).statistics
        except BROKEN as error:
            reason = " ".join(str(error).split())[:200]
            self.damage.find(f"has a damaged index, which is not believed: {reason}")
            return None

    def _messages_in(self, block: Block) -> Iterator[Found]:
        """Yield the messages of a block, up to the first that is not whole."""
        done = 0
        with contextlib.suppress(*BROKEN):
            for opcode, start, end in records_in(block.records):
                if opcode == Opcode.MESSAGE:
                    found = self._message(block, start, end)
                    if found is None:
                        self.damage.dropped_bytes += end - done
                    else:
                        yield found
                elif opcode == Opcode.METADATA:
                    text = metadata_text(block.records[start:end])
                    self.metadata_text = text or self.metadata_text
                elif opcode:
                    channels = self._protected if block.protected else self._unprotected
                    channels.learn(opcode, block.records[start:end])
                else:  # zeros, as a disk leaves them after a power failure
                    break
                done = end
        self.damage.dropped_bytes += len(block.records) - done

    def _message(self, block: Block, start: int, end: int) -> Found | None:
        """Return a message, None if it belongs to no topic or is not one."""
        channel, sequence, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(block.records, start)
        topic = self._protected.topics.get(channel) or self._unprotected.topics.get(channel)
        if topic is None or start + MESSAGE_HEAD.size > end:
            return None
        data = block.records[start + MESSAGE_HEAD.size : end]
        if self._packed_messages:
            try:
                data = unpack_message(data, self.allowance)
            except UnpackError:
                return None
        if not block.protected:
            chunk = block.chunk
            if chunk and not chunk.start_ns <= log_ns <= chunk.end_ns:
                return None
            if not _fits(topic, data):
                return None
        self.damage.unprotected += not (block.protected and channel in self._protected.topics)
        return topic, BagMessage(topic.name, log_ns, publish_ns, sequence, data)


def _fits(topic: TopicDescription, data: bytes) -> bool:
    """Return whether data can be a message on a topic, as far as that can be known."""
    decode = _decoder(topic)
    if decode is None:
        return True
    try:
        decode(data)
    except BagError:
        return False
    return True


@lru_cache(maxsize=256)
def _decoder(topic: TopicDescription) -> Callable[[bytes], Any] | None:
    if "wstring" in topic.schema:  # which the decoder does not know
        return None
    try:
        return decoder_for(topic)
    except BagError:  # of a format that is not known here
        return None
