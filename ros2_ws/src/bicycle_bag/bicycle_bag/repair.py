"""Makes a bag whole again that a killed recorder, a full disk or a power cut left behind."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_bag.repair")

import contextlib
import shutil
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bicycle_bag import container, metadata
from bicycle_bag.container import LIBRARY, Registry
from bicycle_bag.contents import Contents
from bicycle_bag.errors import BagError
from bicycle_bag.folder import visible
from bicycle_bag.in_use import held
from bicycle_bag.keeping import keep
from bicycle_bag.message_packing import MessageUnpacker
from bicycle_bag.metadata import BagMetadata, FileInformation, Topic
from bicycle_bag.reader import BagReader, bag_in, find_files
from bicycle_bag.rewrite import Rewrite
from bicycle_bag.salvage import Progress, Salvage
from bicycle_bag.sqlite_files import SUFFIX, convert_files
from bicycle_bag.syncing import sync_folder
from bicycle_bag.unpacking import unpack_files
from bicycle_common.command_line import OneLineParser
from bicycle_common.progress import ProgressBar

MOST_SPANS = 5
"""Largest number of lost chunks whose times are reported."""


@dataclass
class RepairReport:
    """Result of a repair; `kept` are copies of the damaged files, `converted` were databases.

    The messages of `unpacked` files, whose originals are kept, were compressed one by one. `odd`
    is what `metadata.yaml` said otherwise than the files.

    `lost_messages` is known only of files that were finished; `lost_spans` are the first and last
    times of lost chunks in ns; `lost_bytes` belong to no recognisable record. Of the `unproved`
    messages, which have no checksum, some may be damaged; `unchecked` messages are in files
    without any checksum. Topic and type of `adopted` messages come from damaged parts of a file.
    """

    messages: int = 0
    rewritten: list[Path] = field(default_factory=list)
    lost_bytes: int = 0
    lost_chunks: int = 0
    lost_messages: int = 0
    lost_spans: list[tuple[int, int]] = field(default_factory=list)
    unproved: int = 0
    unchecked: int = 0
    adopted: int = 0
    starting_time_ns: int = metadata.NO_START
    kept: list[Path] = field(default_factory=list)
    converted: list[Path] = field(default_factory=list)
    unpacked: list[Path] = field(default_factory=list)
    odd: str = ""

    def __str__(self) -> str:
        of = f" of {self.messages + self.lost_messages}" if self.lost_messages else ""
        line = (
            f"{self.messages} messages are whole{of}, {len(self.rewritten)} files were rewritten"
        )
        if self.converted:
            line += f"; made of sqlite3: {', '.join(path.name for path in self.converted)}"
        if self.odd:
            line += f"; metadata.yaml was written anew, as {self.odd}"
        if self.unpacked:
            line += (
                "; messages that were compressed one by one were unpacked, originals kept as "
                + ", ".join(str(path) for path in self.unpacked)
            )
        losses = {
            "messages": self.lost_messages,
            "chunks": self.lost_chunks,
            "bytes": self.lost_bytes,
        }
        if any(losses.values()):
            line += "; lost: " + ", ".join(f"{n} {name}" for name, n in losses.items() if n)
        if self.lost_spans:
            line += f", of {self._spans()} after the beginning"
        if self.unproved:
            line += (
                f"; the checksum of all data is wrong, and which of {self.unproved} messages that "
                "have none of their own are damaged cannot be told"
            )
        elif self.unchecked:
            line += f"; {self.unchecked} have no checksum, so that damage in them cannot be seen"
        if self.adopted:
            line += (
                "; only damaged parts of the file say topics and types of "
                f"{self.adopted} messages: look whether they are right"
            )
        if self.kept:
            line += f"; damaged originals kept as {', '.join(str(path) for path in self.kept)}"
        return line

    def _spans(self) -> str:
        start = min(self.starting_time_ns, *(first for first, _ in self.lost_spans))
        seconds = [
            f"{1e-9 * (a - start):.3f} to {1e-9 * (b - start):.3f} s" for a, b in self.lost_spans
        ]
        more = f" and {len(seconds) - MOST_SPANS} more" if len(seconds) > MOST_SPANS else ""
        return ", ".join(seconds[:MOST_SPANS]) + more


def repair(path: Path | str, progress: Progress = lambda _: None) -> RepairReport:
    """Rewrite the unfinished or damaged files of a bag and its `metadata.yaml`, in place.

    All intact records stay unchanged, also those of unknown kinds. The new file is read again in
    full before it replaces the old one in one step, so an interrupted repair can be run again. The
    damaged file stays beside it as `*.damaged`.

    Args:
        path: Bag directory or MCAP file.
        progress: Called with the number of bytes read since the last call.

    Raises:
        BagError: There is no bag, a file is foreign, the disk does not take the copy, or another
            process records or repairs the bag.
    """
    path = Path(path)
    with held(path):
        return _repair(path, progress)


def _repair(path: Path, progress: Progress) -> RepairReport:
    report = RepairReport()
    parts: list[BagMetadata] = []
    custom_data: dict[str, str] = {}
    unpack_files(path)
    report.converted = convert_files(path)
    if path.suffix == SUFFIX and path.is_file():
        path = path.with_suffix(".mcap")
    for source in present_files(path):
        salvage = _repair_file(source, report, progress)
        custom_data.update(salvage.custom_data)
        parts.append(BagReader(source).metadata)
        report.messages += parts[-1].message_count
    report.starting_time_ns = min(part.starting_time_ns for part in parts)
    if path.is_dir():
        with _disk_errors(path):
            _write_metadata(path, parts, custom_data, report)
    return report


def present_files(path: Path) -> list[Path]:
    """Return the MCAP files, whatever `metadata.yaml` says; `BagError` if there are none."""
    return find_files(path, listed=False)


def _readable(path: Path) -> list[Path]:
    """Return the files that will be read: databases where there are no MCAP files yet."""
    with contextlib.suppress(OSError, ValueError):  # a name that is too long, or no name
        if not visible(path, ".mcap") and (found := visible(path, SUFFIX)):
            return found
    return present_files(path)


def _write_metadata(
    folder: Path, parts: Sequence[BagMetadata], custom_data: dict[str, str], report: RepairReport
) -> None:
    """Write `metadata.yaml` unless it is correct already."""
    topics: dict[str, Topic] = {}
    counts: dict[str, int] = {}
    for part in parts:
        for topic in part.topics:
            topics.setdefault(topic.name, topic)
            counts[topic.name] = counts.get(topic.name, 0) + part.counts.get(topic.name, 0)
    files = tuple(file for part in parts for file in part.files)
    old = folder / metadata.FILE_NAME
    distro = "jazzy"
    if old.is_file():
        with contextlib.suppress(BagError):
            stored = metadata.read(folder, of_any_storage=True)
            custom_data.update(stored.custom_data)
            distro = stored.ros_distro or distro
            named = [file.name for file in find_files(folder)]
            new = BagMetadata(tuple(topics.values()), counts, files)
            odd = metadata.oddity(stored, new)
            same = named == [file.path for file in files] and stored.counts == counts
            if same and not odd:
                return
            if not (report.rewritten or report.converted or report.unpacked):
                report.odd = odd  # else the files have changed, not what was said of them
        report.kept.append(keep(old))
    metadata.write(folder, BagMetadata(tuple(topics.values()), counts, files, custom_data, distro))


def _repair_file(source: Path, report: RepairReport, progress: Progress) -> Salvage:
    check = Salvage(source)
    for _ in check.pieces(progress):
        pass
    if not check.contents.has_checksum:
        report.unchecked += check.unproved
    if check.whole:
        return check
    scratch = source.with_name(f".{source.name}.repair")
    try:
        with _disk_errors(source):
            scratch.unlink(missing_ok=True)
            adopted = _adopted(check.contents)
            salvage, counts, lost = _copy(source, scratch, adopted, check.packed > 0)
            report.adopted += sum(counts.get(channel, 0) for channel in adopted.channels)
            _read_again(scratch, source, counts)
            report.lost_messages += lost
            _swap(source, scratch, salvage, report)
    finally:
        scratch.unlink(missing_ok=True)
    return salvage


def _adopted(contents: Contents) -> Registry:
    """Return the channels of messages that only damaged parts define, with their schemas.

    In our own files two chunks define each, and nothing is taken that is not proved.
    """
    found = Registry()
    if contents.library in ("", LIBRARY):
        return found
    for number in contents.orphans:
        channel = contents.unproved.channels.get(number)
        if channel is None or not channel.topic.isprintable():
            continue
        schema = contents.unproved.schemas.get(channel.schema_id)
        schema = schema or contents.registry.schemas.get(channel.schema_id)
        if schema is not None:
            found.schemas[schema.id] = schema
        if schema is not None or channel.schema_id == 0:
            found.channels[number] = channel
    return found


def _copy(
    source: Path, scratch: Path, adopted: Registry, is_packed: bool
) -> tuple[Salvage, dict[int, int], int]:
    """Write the new file; returns what was read, the messages by channel, and those lost."""
    salvage = Salvage(source)
    registry = salvage.contents.registry
    registry.channels.update(adopted.channels)
    registry.schemas.update(adopted.schemas)
    unpacker = MessageUnpacker(registry)
    with contextlib.closing(Rewrite(source, scratch, registry)) as written:
        for piece in salvage.pieces(lambda _: None):
            for one in unpacker.pieces(piece) if is_packed else (piece,):
                written.add(one)
        if salvage.is_rosbag2:
            topics = {number: registry.topic_of(one) for number, one in registry.channels.items()}
            counts = dict.fromkeys((topic.name for topic in topics.values()), 0)
            for number, count in written.counts.items():
                counts[topics[number].name] += count
            first, last = written.span or (metadata.NO_START, metadata.NO_START)
            file = FileInformation(source.name, first, last - first, sum(counts.values()))
            about = BagMetadata(tuple(topics.values()), counts, (file,), salvage.custom_data)
            written.add_metadata("rosbag2", about.to_record())
        written.finish()
    return salvage, written.counts, unpacker.lost


def _read_again(scratch: Path, source: Path, counts: dict[int, int]) -> None:
    again = Salvage(scratch)
    for _ in again.pieces(lambda _: None):
        pass
    if not again.whole or again.contents.counts != counts:
        raise BagError(
            f"cannot repair {source}: the new file was not read back as it was written; the "
            "bag is as it was; check the disk and the memory, then try again"
        )


def _swap(source: Path, scratch: Path, salvage: Salvage, report: RepairReport) -> None:
    damages = salvage.damages
    report.lost_bytes += sum(one.end - one.offset for one in damages if not one.is_chunk)
    report.lost_chunks += sum(one.is_chunk for one in damages)
    report.lost_spans += [one.span for one in damages if one.span is not None]
    announced = salvage.contents.announced
    known = announced is not None and announced >= salvage.messages
    orphans = sum(one.orphans for one in damages)
    report.lost_messages += announced - salvage.messages if announced and known else orphans
    if damages and not salvage.explained:
        report.unproved += salvage.unproved
    if damages:
        report.kept.append(keep(source))
    elif salvage.packed:
        report.unpacked.append(keep(source, "packed"))
    shutil.copymode(source, scratch)
    scratch.replace(source)
    sync_folder(source.parent)
    report.rewritten.append(source)


@contextlib.contextmanager
def _disk_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise BagError(
            f"cannot repair {path} ({error.strerror}): it is as it was; free some space and "
            "check the rights, then try again"
        ) from None


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command `bicycle_repair`; return its exit status."""
    parser = OneLineParser(prog="record.sh --repair", description=__doc__)
    parser.add_argument(
        "bag",
        type=Path,
        help="bag directory or .mcap file, repaired in place; .db3 files get an .mcap beside them",
    )
    bag = bag_in(parser.parse_args(arguments).bag)
    try:
        with held(bag):
            unpack_files(bag)
            total = sum(container.size_of(file) for file in _readable(bag))
            with ProgressBar(total=total, unit="B", unit_scale=True) as bar:
                report = _repair(bag, bar.update)
    except BagError as error:
        print(f"record.sh: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("record.sh: interrupted; the bag is as it was, run it again", file=sys.stderr)
        return 130
    print(f"{bag}: {report}")
    return 0
