"""Makes a bag whole again that a killed recorder, a full disk or a power cut left behind."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_sim.early import run_module

    run_module("bicycle_bag.repair")

import contextlib
import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from tqdm import tqdm

from bicycle_bag import container, metadata
from bicycle_bag.arguments import OneLineParser
from bicycle_bag.container import Registry
from bicycle_bag.errors import BagError
from bicycle_bag.mcap_file import McapFile
from bicycle_bag.metadata import BagMetadata, Topic
from bicycle_bag.reader import BagReader, find_files
from bicycle_bag.salvage import Progress, Salvage


@dataclass
class RepairReport:
    """What a repair found; ``kept`` are copies of files of which something is lost."""

    messages: int = 0
    rewritten: list[Path] = field(default_factory=list)
    lost_bytes: int = 0
    lost_chunks: int = 0
    lost_messages: int = 0
    kept: list[Path] = field(default_factory=list)

    def __str__(self) -> str:
        line = f"{self.messages} messages are whole, {len(self.rewritten)} files were rewritten"
        if self.lost_bytes or self.lost_chunks or self.lost_messages:
            line += (
                f"; lost: {self.lost_bytes} bytes at the end, {self.lost_chunks} chunks, "
                f"{self.lost_messages} messages"
            )
        if self.kept:
            line += f"; damaged originals kept as {', '.join(str(path) for path in self.kept)}"
        return line


def repair(path: Path | str, progress: Progress = lambda _: None) -> RepairReport:
    """Rewrite the unfinished or damaged files of a bag and its ``metadata.yaml``, in place.

    Everything up to the damage is kept, and chunks behind a damaged chunk too. Each file is
    replaced in one step, so an interrupted repair can be run again. The original of a file that
    lost anything stays beside it as ``*.damaged``.

    Args:
        path: Bag directory or MCAP file.
        progress: Called with the number of bytes read since the last call.

    Raises:
        BagError: There is no bag, a file is foreign, or the disk does not take the copy.
    """
    path = Path(path)
    report = RepairReport()
    parts: list[BagMetadata] = []
    custom_data: dict[str, str] = {}
    for source in present_files(path):
        salvage = _repair_file(source, report, progress)
        custom_data.update(salvage.custom_data)
        parts.append(BagReader(source).metadata)
        report.messages += parts[-1].message_count
    if path.is_dir():
        with _disk_errors(path):
            metadata.write(path, _joined(parts, custom_data))
    return report


def present_files(path: Path) -> list[Path]:
    """The MCAP files that are there, whatever ``metadata.yaml`` says; ``BagError`` if none."""
    return find_files(path, listed=False)


def _joined(parts: Sequence[BagMetadata], custom_data: dict[str, str]) -> BagMetadata:
    topics: dict[str, Topic] = {}
    counts: dict[str, int] = {}
    for part in parts:
        for topic in part.topics:
            topics.setdefault(topic.name, topic)
            counts[topic.name] = counts.get(topic.name, 0) + part.counts.get(topic.name, 0)
    files = tuple(file for part in parts for file in part.files)
    return BagMetadata(tuple(topics.values()), counts, files, custom_data)


def _repair_file(source: Path, report: RepairReport, progress: Progress) -> Salvage:
    check = Salvage(source)
    if check.indexed:
        for _ in check.messages(progress):
            pass
        if check.whole:
            return check
    scratch = source.with_name(f".{source.name}.repair")
    salvage = Salvage(source)
    try:
        with _disk_errors(source):
            scratch.unlink(missing_ok=True)
            _copy(salvage, scratch, (lambda _: None) if check.indexed else progress)
            _swap(source, scratch, salvage, report)
    finally:
        scratch.unlink(missing_ok=True)
    return salvage


def _copy(salvage: Salvage, scratch: Path, progress: Progress) -> None:
    written = McapFile(scratch)
    try:
        names: dict[int, str] = {}
        for message in salvage.messages(progress):
            name = names.get(message.channel_id)
            if name is None:
                name = _add_topic(written, salvage.registry, message.channel_id)
                names[message.channel_id] = name
            written.add_message(name, message.data, message.log_time_ns, message.publish_time_ns)
        for channel_id in salvage.registry.channels:
            _add_topic(written, salvage.registry, channel_id)
        file = replace(written.information, path=salvage.path.name)
        topics = tuple(written.topics.values())
        written.add_metadata(BagMetadata(topics, written.counts, (file,), salvage.custom_data))
        written.finish()
    except BaseException:
        written.abandon()
        raise


def _add_topic(written: McapFile, registry: Registry, channel_id: int) -> str:
    channel = registry.channels[channel_id]
    if channel.topic not in written.topics:
        written.add_topic(registry.topic_of(channel), registry.definition_of(channel))
    return channel.topic


def _swap(source: Path, scratch: Path, salvage: Salvage, report: RepairReport) -> None:
    report.lost_bytes += salvage.lost_bytes
    report.lost_chunks += salvage.lost_chunks
    report.lost_messages += salvage.lost_messages
    if not salvage.lossless:
        kept = source.with_name(f"{source.name}.damaged")
        kept.unlink(missing_ok=True)
        os.link(source, kept)
        report.kept.append(kept)
    shutil.copymode(source, scratch)
    scratch.replace(source)
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
    """The command ``bicycle_repair``; returns its exit status."""
    parser = OneLineParser(prog="bicycle_repair", description=__doc__)
    parser.add_argument("bag", type=Path, help="bag directory or .mcap file, repaired in place")
    bag = parser.parse_args(arguments).bag
    try:
        total = sum(container.size_of(file) for file in present_files(bag))
        with tqdm(total=total, unit="B", unit_scale=True, disable=None) as bar:
            report = repair(bag, bar.update)
    except BagError as error:
        print(f"bicycle_repair: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("bicycle_repair: interrupted; the bag is as it was, run it again", file=sys.stderr)
        return 130
    print(f"{bag}: {report}")
    return 0
