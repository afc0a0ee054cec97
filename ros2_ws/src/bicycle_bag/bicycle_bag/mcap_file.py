"""An MCAP file while it is written, in rosbag2's conventions."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Any

from mcap.records import Channel, Schema
from mcap.writer import CompressionType, IndexType, Writer

from bicycle_bag import in_use
from bicycle_bag.container import LIBRARY
from bicycle_bag.metadata import NO_START, BagMetadata, FileInformation, Topic
from bicycle_bag.qos import dump_profiles
from bicycle_bag.syncing import Syncer

COMPRESSIONS = {
    "zstd": CompressionType.ZSTD,
    "lz4": CompressionType.LZ4,
    "none": CompressionType.NONE,
}
CHUNK_BYTES = 32 * 1024
"""Size of a chunk; small, so that a kill of the recorder loses little."""
_LATEST = 2**64


class McapFile:
    """Writes messages of registered topics and keeps count.

    Args:
        path: File to create; it must not exist.
        compression: A key of `COMPRESSIONS`.
        chunk_bytes: Size at which a chunk is packed and written.

    Raises:
        OSError: The disk does not take it; also from the other methods.
    """

    def __init__(
        self, path: Path, compression: str = "zstd", chunk_bytes: int = CHUNK_BYTES
    ) -> None:
        self.path = path
        self.topics: dict[str, Topic] = {}
        self.counts: dict[str, int] = {}
        self._first_ns = _LATEST
        self._last_ns = 0
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._defined_once: list[Schema | Channel] = []
        self._stream = path.open("xb")
        in_use.claim(self._stream.fileno())  # a repair keeps off it
        self._writer = Writer(
            self._stream,
            chunk_size=chunk_bytes,
            compression=COMPRESSIONS[compression],
            index_types=IndexType.ALL,
            enable_data_crcs=True,
        )
        self._writer.start(profile="ros2", library=LIBRARY)
        self._syncer = Syncer(self._stream.fileno())

    @property
    def size(self) -> int:
        """Bytes written so far, without the chunk in the making."""
        return self._stream.tell()

    @property
    def slowest_sync(self) -> float:
        """Longest time that the disk has taken to sync written data, s."""
        return self._syncer.slowest

    @property
    def strayed(self) -> str:
        """Present path of the file by the kernel; empty while its own path leads to it."""
        mine = self._stream.fileno()
        try:
            if os.path.samestat(self.path.stat(), os.fstat(mine)):
                return ""
        except (FileNotFoundError, NotADirectoryError):
            pass
        except OSError:
            return ""
        return str(Path(f"/proc/self/fd/{mine}").readlink())

    @property
    def other_name(self) -> Path | None:
        """Another path of the file in its folder, such as a repair gives what it keeps."""
        mine = os.fstat(self._stream.fileno())
        with contextlib.suppress(OSError):
            for path in self.path.parent.iterdir():
                if path.is_file() and os.path.samestat(path.stat(), mine):
                    return path
        return None

    @property
    def first_ns(self) -> int:
        """Smallest log time, or `NO_START`."""
        return self._first_ns if self._first_ns < _LATEST else NO_START

    def add_topic(self, topic: Topic, definition: str) -> None:
        """Register a topic; an empty `definition` leaves its messages without a schema."""
        schema_id = self._schemas.get(topic.type)
        if schema_id is None:
            encoding = "ros2msg" if definition else ""
            schema_id = self._writer.register_schema(topic.type, encoding, definition.encode())
            self._schemas[topic.type] = schema_id
            self._defined_once.append(Schema(schema_id, definition.encode(), encoding, topic.type))
        about = {
            "offered_qos_profiles": dump_profiles(topic.qos),
            "topic_type_hash": topic.type_hash,
        }
        number = self._writer.register_channel(
            topic=topic.name,
            message_encoding=topic.serialization_format,
            schema_id=schema_id,
            metadata=about,
        )
        self._defined_once.append(
            Channel(number, topic.name, topic.serialization_format, about, schema_id)
        )
        self._channels[topic.name] = number
        self.topics[topic.name] = topic
        self.counts[topic.name] = 0

    def add_message(self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Append one message of a registered topic; times before 1970 become 0."""
        if self._defined_once:
            self._define_again()
        log_time_ns, publish_time_ns = max(0, log_time_ns), max(0, publish_time_ns)
        self._writer.add_message(self._channels[topic], log_time_ns, data, publish_time_ns)
        self.counts[topic] += 1
        self._first_ns = min(self._first_ns, log_time_ns)
        self._last_ns = max(self._last_ns, log_time_ns)

    def add_metadata(self, metadata: BagMetadata) -> None:
        """Append the bag's metadata as it stands now."""
        self._writer.add_metadata("rosbag2", metadata.to_record())

    def flush(self) -> None:
        """Pack the chunk in the making, give all to the kernel, and have it synced soon."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._syncer.ask()

    def _define_again(self) -> None:
        """Put what the last chunks have defined into the next one, too.

        A recorder that is killed leaves no summary; a chunk that is damaged then would take all
        later messages of its topics along.
        """
        # The writer has no public way to put a definition into a second chunk.
        builder: Any = self._writer._Writer__chunk_builder  # type: ignore[attr-defined]
        if builder.count:
            return  # they are in this chunk, too
        for one in self._defined_once:
            one.write(builder.record_writer)
        self._defined_once.clear()

    def end(self) -> None:
        """Write index and footer, give all to the kernel, and have it synced; does not wait."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.flush()
        self._syncer.end()

    @property
    def on_disk(self) -> bool:
        """True if `wait` would return at once."""
        return self._syncer.ended

    def wait(self) -> None:
        """Wait until the disk has all, after `end`, and close the file."""
        try:
            self._syncer.wait()
        finally:
            self.abandon()

    def finish(self) -> None:
        """Write index and footer, wait until the disk has all, and close the file."""
        try:
            self.end()
        except OSError:
            self.abandon()
            raise
        self.wait()

    def abandon(self) -> None:
        """Close the file as it is, after an error."""
        self._syncer.end()
        with contextlib.suppress(OSError):
            self._syncer.wait()
        with contextlib.suppress(OSError):
            self._stream.close()

    @property
    def information(self) -> FileInformation:
        """Entry of this file in `metadata.yaml`."""
        count = sum(self.counts.values())
        return FileInformation(
            path=self.path.name,
            starting_time_ns=self.first_ns,
            duration_ns=self._last_ns - self.first_ns if count else 0,
            message_count=count,
        )
