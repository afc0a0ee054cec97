"""Writes a bag directory as rosbag2 does, so that a killed recorder loses at most a second."""

from __future__ import annotations

import contextlib
import errno
import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from bicycle_bag import metadata
from bicycle_bag.errors import BagError, OptionError
from bicycle_bag.mcap_file import CHUNK_BYTES, COMPRESSIONS, McapFile
from bicycle_bag.metadata import BagMetadata, FileInformation, Topic

FLUSH_SECONDS = 0.3
"""Time between two flushes; with the recorder's sorting, a kill of the recorder loses 0.6 s."""
MIN_SPLIT_BYTES = 1024
MAX_SPLIT_SECONDS = 1e9
MOST_OWED = 8
"""Limit of finished but unsynced files, each with a thread and an open file."""
DELETED = " (deleted)"
"""Suffix by the kernel to the name of an open file that was deleted."""


@contextlib.contextmanager
def _disk_errors(path: Path, file: McapFile | None = None) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if file is not None:
            file.abandon()
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        remedy = "free some space" if full else "check the disk"
        raise BagError(
            f"cannot write {path} ({error.strerror}): {remedy}, then recover what was recorded "
            "with record.sh --repair"
        ) from None


class BagWriter:
    """A bag in the making: `add_topic`, then `write`, at last `close`.

    Args:
        path: Directory to create.
        compression: `zstd`, `lz4` or `none`, applied to each chunk.
        split_bytes: Begin a new file beyond this size; 0 never does.
        split_seconds: Begin a new file when one spans this log time; 0 never does.
        custom_data: Free texts for `metadata.yaml`; may be changed until the end.
        chunk_bytes: Size at which a chunk is packed and written.

    Attributes:
        slowest_sync: s, longest that the disk took for it in the files that it has whole; a power
            cut loses so much more.

    Raises:
        BagError: The directory exists or cannot be created, or an option is out of range.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        compression: str = "zstd",
        split_bytes: int = 0,
        split_seconds: float = 0.0,
        custom_data: Mapping[str, str] | None = None,
        chunk_bytes: int = CHUNK_BYTES,
    ) -> None:
        self.path = Path(path)
        if compression not in COMPRESSIONS:
            raise OptionError(f"compression is {compression!r}: choose {', '.join(COMPRESSIONS)}")
        if 0 < split_bytes < MIN_SPLIT_BYTES or split_bytes < 0:
            raise OptionError(
                f"split size is {split_bytes} bytes: choose 0 or >= {MIN_SPLIT_BYTES}"
            )
        if not 0.0 <= split_seconds <= MAX_SPLIT_SECONDS:
            raise OptionError(
                f"split time is {split_seconds} s: choose 0 to {MAX_SPLIT_SECONDS:g}"
            )
        self.custom_data = dict(custom_data or {})
        self._compression = compression
        self._chunk_bytes = chunk_bytes
        self._split_bytes = split_bytes
        self._split_ns = int(split_seconds * 1e9)
        self._topics: dict[str, Topic] = {}
        self._definitions: dict[str, str] = {}
        self._done: list[FileInformation] = []
        self._owed: list[McapFile] = []
        self._ended = False
        self._counts: dict[str, int] = {}
        self.slowest_sync = 0.0
        self._create_directory()
        with _disk_errors(self.path):
            self._file = self._open_file()
        self._flushed = time.monotonic()

    def _create_directory(self) -> None:
        try:
            self.path.mkdir(parents=True)
        except FileExistsError:
            raise OptionError(f"{self.path} exists: choose another name or remove it") from None
        except OSError as error:
            raise BagError(f"cannot create {self.path}: {error.strerror}") from None

    def add_topic(self, topic: Topic, definition: str) -> None:
        """Register a topic before its first message.

        Args:
            topic: Its name, type, offered QoS and type hash.
            definition: `ros2msg` text of the type; empty where none is known.
        """
        self._topics[topic.name] = topic
        self._definitions[topic.name] = definition
        with _disk_errors(self.path, self._file):
            self._file.add_topic(topic, definition)

    def write(self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Append a message; every `FLUSH_SECONDS` all goes to the disk.

        Raises:
            BagError: The disk is full or fails; what was flushed before is safe.
        """
        if self._must_split(log_time_ns):
            self.split()
        with _disk_errors(self.path, self._file):
            self._file.add_message(topic, data, log_time_ns, publish_time_ns)
        self.flush_if_due()

    def flush_if_due(self) -> None:
        """Flush if the last flush is `FLUSH_SECONDS` ago; a recorder's timer calls it."""
        if time.monotonic() - self._flushed >= FLUSH_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Hand all messages to the disk now.

        Raises:
            BagError: The disk is full or fails, or the bag was deleted or moved.
        """
        self._check_place()
        with _disk_errors(self.path, self._file):
            self._file.flush()
            self._collect(MOST_OWED)
        self._flushed = time.monotonic()

    def split(self) -> None:
        """Finish the present file and begin the next; the disk takes the old one meanwhile."""
        with _disk_errors(self.path, self._file):
            self._end_file()
            self._collect(MOST_OWED)
            self._file = self._open_file()
            for name, topic in self._topics.items():
                self._file.add_topic(topic, self._definitions[name])

    def close(self) -> BagMetadata:
        """Finish the bag, write `metadata.yaml`, and wait until the disk has it all.

        Returns:
            What the bag holds.
        """
        self._check_place()
        with _disk_errors(self.path, self._file):
            self._end_file()
            self._ended = True
            final = self._metadata()
            self._collect(0)
            metadata.write(self.path, final)
        return final

    def leave(self) -> bool:
        """Leave to the kernel what `close`, in another thread, waits for, and write the metadata.

        Returns:
            Whether all has been given to the kernel, so that this process may end. If not, `close`
            is still writing.
        """
        if not self._ended:
            return False
        # If the file is missing, `close` has replaced it meanwhile.
        with _disk_errors(self.path), contextlib.suppress(FileNotFoundError):
            metadata.write(self.path, self._metadata(), sync=False)
        return True

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None or not issubclass(kind, BagError):
            self.close()

    def _check_place(self) -> None:
        """Check that the bag is still at its path.

        Raises:
            BagError: The bag was deleted or moved.
        """
        place = self._file.strayed
        if not place:
            return
        with contextlib.suppress(OSError):
            self._file.flush()
        kept, replaced = self._file.other_name, os.path.lexists(self._file.path)
        self._file.abandon()
        if place.endswith(DELETED) and replaced and kept is not None:
            raise BagError(
                f"{self._file.path} was replaced while it was being recorded: what was recorded "
                f"lies in {kept}: copy that to a folder of its own and recover it there with "
                "record.sh --repair"
            )
        if place.endswith(DELETED) and replaced:
            raise BagError(
                f"{self._file.path} was replaced by another file while it was being recorded, "
                "and what it held is lost: record again"
            )
        if place.endswith(DELETED):
            raise BagError(
                f"{self.path} was deleted while it was being recorded, and what it held is lost: "
                "record again"
            )
        raise BagError(
            f"{self.path} was moved to {Path(place).parent} while it was being recorded: recover "
            f"what it holds with record.sh --repair {Path(place).parent}"
        )

    def _must_split(self, log_time_ns: int) -> bool:
        if self._split_bytes and self._file.size >= self._split_bytes:
            return True
        return bool(self._split_ns) and log_time_ns - self._file.first_ns >= self._split_ns

    def _open_file(self) -> McapFile:
        path = self.path / f"{self.path.name}_{len(self._done)}.mcap"
        file = McapFile(path, self._compression, self._chunk_bytes)
        file.add_metadata(self._metadata(file))
        file.flush()
        return file

    def _end_file(self) -> None:
        """Give the present file to the kernel whole, and to the disk as soon as it takes it."""
        self._file.add_metadata(self._metadata(self._file))
        self._file.end()
        self._owed.append(self._file)
        self._done.append(self._file.information)
        for name, count in self._file.counts.items():
            self._counts[name] = self._counts.get(name, 0) + count

    def _collect(self, most: int) -> None:
        """Close finished files that the disk has, and wait until it owes `most` at most."""
        while self._owed and (self._owed[0].on_disk or len(self._owed) > most):
            file = self._owed.pop(0)
            file.wait()
            self.slowest_sync = max(self.slowest_sync, file.slowest_sync)

    def _metadata(self, open_file: McapFile | None = None) -> BagMetadata:
        counts = dict(self._counts)
        files = list(self._done)
        if open_file is not None:
            files.append(open_file.information)
            for name, count in open_file.counts.items():
                counts[name] = counts.get(name, 0) + count
        return BagMetadata(
            topics=tuple(self._topics.values()),
            counts=counts,
            files=tuple(files),
            custom_data=self.custom_data,
        )
