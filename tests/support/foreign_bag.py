"""Bags that others wrote, made with the MCAP package itself: whatever its format allows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer
from ride_bag import TYPES, ride, schemas

SECOND = 1_000_000_000


class ForeignFile:
    """One MCAP file, closed by `close` or at the end of a `with` block."""

    def __init__(self, path: Path, profile: str = "ros2", library: str = "other", **options: Any):
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._stream = path.open("wb")
        self.writer = Writer(self._stream, **options)
        self.writer.start(profile=profile, library=library)
        self.channels: dict[str, int] = {}

    def channel(
        self,
        topic: str,
        type_name: str = "",
        definition: bytes = b"",
        schema_encoding: str = "ros2msg",
        encoding: str = "cdr",
        metadata: dict[str, str] | None = None,
    ) -> int:
        """Register a channel; one without a type has no schema."""
        schema = self.writer.register_schema(type_name, schema_encoding, definition)
        number = self.writer.register_channel(
            topic, encoding, schema if type_name else 0, metadata or {}
        )
        self.channels[topic] = number
        return number

    def ride_channels(self) -> None:
        """Register the three topics of `ride_bag.ride`."""
        for topic, short in TYPES.items():
            kind = f"bicycle_msgs/msg/{short}"
            self.channel(topic, kind, schemas().definition(kind).encode())

    def write(self, topic: str, data: bytes, log_ns: int, publish_ns: int | None = None) -> None:
        """Append a message."""
        published = log_ns if publish_ns is None else publish_ns
        self.writer.add_message(self.channels[topic], log_ns, data, published)

    def close(self) -> None:
        """Finish the file."""
        self.writer.finish()  # type: ignore[no-untyped-call]
        self._stream.close()

    def __enter__(self) -> ForeignFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def ride_with_times(path: Path, times: Sequence[tuple[int, int]], **options: Any) -> Path:
    """Return the ride of `ride_bag` with other log and publish times, a pair per message."""
    messages = ride((len(times) + 1) // 2)[: len(times)]
    with ForeignFile(path, **options) as file:
        file.ride_channels()
        for (topic, data, _), (log_ns, publish_ns) in zip(messages, times, strict=True):
            file.write(topic, data, log_ns, publish_ns)
    return path


UNCHUNKED = {"use_chunking": False}
UNCOMPRESSED = {"compression": CompressionType.NONE}
