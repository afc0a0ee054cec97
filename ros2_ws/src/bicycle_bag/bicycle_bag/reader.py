"""Reads bags without ROS: topics, counts, times and the raw messages."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from bicycle_bag import container, metadata
from bicycle_bag.container import CONVERT, DamageError, Registry
from bicycle_bag.contents import Contents
from bicycle_bag.errors import BagError
from bicycle_bag.folder import visible
from bicycle_bag.message_packing import MARK
from bicycle_bag.metadata import NO_START, BagMetadata, FileInformation, Topic
from bicycle_bag.summary import Summary, indexed_times

PACKED = ".mcap.zstd"
"""Endings of the files that rosbag2 has compressed as a whole."""


_NO_METADATA = BagMetadata(ros_distro="")


class BagMessage(NamedTuple):
    """One recorded message in its encoding, nearly always CDR; times are in nanoseconds.

    `number` is its place in the bag's recorded order, which no clock can change.
    """

    topic: str
    type: str
    log_time_ns: int
    publish_time_ns: int
    data: bytes
    encoding: str = "cdr"
    number: int = 0


class BagReader:
    """A finished bag: a directory as `ros2 bag record` leaves it, or one `.mcap` file.

    Opening reads the index only. Nothing stays open between calls.

    Args:
        path: Bag directory, MCAP file, or the folder of a run of ride.sh.

    Attributes:
        files: Its MCAP files.

    Raises:
        BagError: There is no such bag, it is foreign, or it was never finished.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = bag_in(Path(path))
        self.files = find_files(self.path)
        self._topics: dict[str, Topic] = {}
        self._definitions: dict[str, str] = {}
        self._counts: dict[str, int] = {}
        self._informations: list[FileInformation] = []
        self._stored = self._stored_metadata()
        for file in self.files:
            self._open(file)

    def _stored_metadata(self) -> BagMetadata:
        if (self.path / metadata.FILE_NAME).is_file():
            return metadata.read(self.path)
        return _NO_METADATA

    @property
    def topics(self) -> dict[str, Topic]:
        """Recorded topics by name, also those without messages."""
        return dict(self._topics)

    @property
    def counts(self) -> dict[str, int]:
        """Messages of each topic."""
        return dict(self._counts)

    @property
    def message_count(self) -> int:
        """Messages of all topics."""
        return sum(self._counts.values())

    @property
    def metadata(self) -> BagMetadata:
        """Contents of the bag, counted from its files; custom data from `metadata.yaml`."""
        return BagMetadata(
            topics=tuple(self._topics.values()),
            counts=self.counts,
            files=tuple(self._informations),
            custom_data=self._stored.custom_data,
            ros_distro=self._stored.ros_distro or "jazzy",
        )

    @property
    def odd(self) -> str:
        """Return what `metadata.yaml` says otherwise than the files do; empty if nothing."""
        if self._stored is _NO_METADATA:
            return ""
        return metadata.oddity(self._stored, replace(self.metadata, counts=dict(self._counts)))

    @property
    def starting_time_ns(self) -> int:
        """Log time of the first message; `metadata.NO_START` in an empty bag."""
        return self.metadata.starting_time_ns

    @property
    def duration_ns(self) -> int:
        """Time from the first message to the last, ns."""
        return self.metadata.duration_ns

    def moments(self, longest_ns: int) -> Iterator[int]:
        """Yield log times in recorded order, with no message between two that is of interest.

        Args:
            longest_ns: Of a chunk that is no longer, only the first and the last time are
                yielded; of a longer one, that of each message.

        Raises:
            BagError: A file has been damaged since the bag was opened.
        """
        for file, about in zip(self.files, self._informations, strict=True):
            if about.message_count:
                try:
                    yield from _moments(file, about, longest_ns)
                except DamageError as error:
                    raise damaged(file, error) from None

    def definition(self, topic: str) -> str:
        """Return the `ros2msg` text of a topic's type; empty if the bag has none.

        Raises:
            BagError: The bag has no such topic.
        """
        self.require([topic])
        return self._definitions[topic]

    def require(self, topics: Collection[str]) -> None:
        """Check that the bag has these topics.

        Raises:
            BagError: One is missing; the text lists what there is.
        """
        missing = sorted(set(topics) - set(self._topics))
        if missing:
            there = ", ".join(sorted(self._topics)) or "none"
            raise BagError(f"{self.path} has no topic {', '.join(missing)}: it has {there}")

    def check_kind(self, topic: str, type_name: str, encoding: str) -> None:
        """Check that a message can be decoded by its topic's definition.

        Raises:
            BagError: It is not CDR, or of another type than the topic's first channel.
        """
        if encoding != "cdr":
            raise BagError(
                f"{self.path} holds {topic} as {encoding or 'unknown'}, not cdr: only what ROS 2 "
                "recorded can be decoded; leave that topic out"
            )
        known = self._topics[topic].type if topic in self._topics else ""
        if type_name != known:
            raise BagError(
                f"{self.path} holds {topic} as {known or 'no type'} and as "
                f"{type_name or 'no type'}: its messages cannot be read together"
            )

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """Yield the messages in the order in which they were recorded.

        Args:
            topics: Only these; all by default.

        Raises:
            BagError: A topic is missing, or the bag is corrupt where it is being read.
        """
        if topics is not None:
            self.require(topics)
        before = 0
        for file, about in zip(self.files, self._informations, strict=True):
            yield from _file_messages(file, topics, before)
            before += about.message_count

    def _open(self, file: Path) -> None:
        try:
            registry, counts, first, last = _inspect(file)
        except DamageError as error:
            raise damaged(file, error) from None
        for channel_id, channel in registry.channels.items():
            topic = registry.topic_of(channel)
            self._topics.setdefault(topic.name, topic)
            self._definitions.setdefault(topic.name, registry.definition_of(channel))
            known = self._counts.get(topic.name, 0)
            self._counts[topic.name] = known + counts.get(channel_id, 0)
        total = sum(counts.values())
        start, duration = (first, last - first) if total else (NO_START, 0)
        self._informations.append(FileInformation(file.name, start, duration, total))


def damaged(file: Path, error: DamageError) -> BagError:
    """Return the error for a file that a reader must not continue with."""
    return BagError(f"{file} is damaged ({error}): recover it with record.sh --repair")


def bag_in(path: Path) -> Path:
    """Return the bag of a path, which may be the folder of a run of ride.sh."""
    inside = path / "bag"
    try:
        is_run = inside.is_dir() and not visible(path, ".mcap")
    except OSError:
        return path
    return inside if is_run else path


def find_files(path: Path, listed: bool = True) -> list[Path]:
    """Return the MCAP files of a bag in order.

    Args:
        path: Bag directory or MCAP file.
        listed: Go by `metadata.yaml` where there is one, not by what lies in the directory.

    Raises:
        BagError: There is no bag there.
    """
    try:
        is_file, is_folder = path.is_file(), path.is_dir()
    except OSError as error:
        raise BagError(f"cannot open {path.name[:50]!r}... ({error.strerror})") from None
    if is_file:
        return [path]
    if not is_folder:
        raise BagError(f"there is no bag {path}: name a bag directory or a .mcap file")
    if listed and (path / metadata.FILE_NAME).is_file():
        files = _listed_files(path)
        if files:
            return files
    files = sorted((one for one in visible(path, ".mcap") if _lies_in(path, one)), key=_natural)
    if not files and visible(path, ".db3"):
        raise BagError(f"{path} is stored as sqlite3, and only mcap can be read here: {CONVERT}")
    if not files and visible(path, PACKED):
        raise BagError(f"{path} is compressed as a whole: record.sh --repair unpacks it")
    if not files:
        note = _link_note(visible(path, ".mcap"))
        raise BagError(f"{path} holds no .mcap file{note}: name the directory that record.sh made")
    return files


def _listed_files(path: Path) -> list[Path]:
    files: dict[Path, Path] = {}
    for information in metadata.read(path).files:
        file = _listed_file(path, PurePosixPath(information.path))
        if file is None:
            note = _link_note([path / Path(information.path).name])
            raise BagError(
                f"{path} lacks its file {information.path[:100]!r}{note}: put it into that "
                "folder, or go on without it after record.sh --repair"
            )
        files.setdefault(file.resolve(), file)
    return list(files.values())


def _link_note(files: Collection[Path]) -> str:
    """Return a note about a file that is a link out of the bag, or to nowhere; else empty."""
    with contextlib.suppress(OSError, RuntimeError, ValueError):
        for file in files:
            if file.is_symlink():
                return (
                    f" ({file.name} is a link to {file.readlink()}, out of the bag or to no file, "
                    "and is not followed)"
                )
    return ""


def _listed_file(folder: Path, name: PurePosixPath) -> Path | None:
    """Return a file named by metadata.yaml; None if it is not in the bag's folder."""
    if name.is_absolute() or ".." in name.parts:
        return None
    # rosbag2 once wrote the paths relative to the directory above.
    inside = name.parts[1:] if name.parts[:1] == (folder.resolve().name,) else name.parts
    found = (file for file in (folder / name, folder.joinpath(*inside)) if _lies_in(folder, file))
    return next(found, None)


def _lies_in(folder: Path, file: Path) -> bool:
    """Return True for a regular file in or below the folder that no link out leads to."""
    try:
        return file.is_file() and file.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # a name too long, links in a circle, a zero byte
        return False


def _natural(path: Path) -> list[tuple[int, str]]:
    parts = re.findall(r"\d+|\D+", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


class _Found(NamedTuple):
    registry: Registry
    counts: dict[int, int]
    first_ns: int
    last_ns: int


def _summary(contents: Contents) -> Summary:
    if contents.summary is None:
        raise DamageError(contents.unfinished)
    return contents.summary


def _inspect(file: Path) -> _Found:
    contents = Contents(file)
    summary = _summary(contents)
    if summary.statistics is None or not (summary.complete and summary.agrees):
        return _scan(contents)
    found = summary.statistics
    counts = dict(found.channel_message_counts)
    return _Found(summary.registry, counts, found.message_start_time, found.message_end_time)


def _scan(contents: Contents) -> _Found:
    first, last = 2**64, 0
    for message in contents.messages():
        first, last = min(first, message.log_time_ns), max(last, message.log_time_ns)
    return _Found(contents.registry, contents.counts, first, last)


def _moments(file: Path, about: FileInformation, longest_ns: int) -> Iterator[int]:
    contents = Contents(file)
    chunks = _summary(contents).chunks
    if not chunks and about.duration_ns <= longest_ns:
        yield from (about.starting_time_ns, about.starting_time_ns + about.duration_ns)
    elif not chunks:
        yield from (message.log_time_ns for message in contents.messages())
    chunks.sort(key=lambda chunk: chunk.chunk_start_offset)
    with container.open_binary(file) as stream:
        for chunk in chunks:
            span = chunk.message_start_time, chunk.message_end_time
            if span == (0, 0) and not chunk.message_index_offsets:  # it has only definitions
                continue
            yield from span if span[1] - span[0] <= longest_ns else indexed_times(stream, chunk)


def _file_messages(
    file: Path, topics: Collection[str] | None, before: int
) -> Iterator[BagMessage]:
    """Yield the messages of a file, numbered on from those before."""
    contents = Contents(file)
    wanted: dict[int, tuple[str, str, str] | None] = {}
    try:
        raw = enumerate(contents.messages(), before)
        for number, (channel_id, log_time, publish_time, data) in raw:
            if channel_id not in wanted:
                wanted[channel_id] = _kind(contents.registry, channel_id, topics)
            if (kind := wanted[channel_id]) is not None:
                topic, type_name, encoding = kind
                if data.startswith(MARK) and encoding == "cdr":
                    raise BagError(f"{file} cannot be read: its {metadata.PACKED_MESSAGES}")
                yield BagMessage(topic, type_name, log_time, publish_time, data, encoding, number)
    except DamageError as error:
        raise damaged(file, error) from None


def _kind(
    registry: Registry, channel_id: int, topics: Collection[str] | None
) -> tuple[str, str, str] | None:
    """Return topic, type and encoding of a channel's messages; None for an unwanted channel."""
    channel = registry.channels[channel_id]
    if topics is not None and channel.topic not in topics:
        return None
    return channel.topic, registry.type_of(channel), channel.message_encoding
