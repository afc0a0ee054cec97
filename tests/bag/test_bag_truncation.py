"""A power cut at every kind of record, and inside each: at most one second is lost."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import pytest
from mcap.opcode import Opcode
from ride_bag import PERIOD_NS, TYPES, Message, ride, schemas, store

from bicycle_bag import container, repair
from bicycle_bag.metadata import Topic
from bicycle_bag.reader import BagReader
from bicycle_bag.writer import FLUSH_SECONDS, BagWriter

STEPS = 120
FLUSH_STEPS = round(FLUSH_SECONDS * 1e9 / PERIOD_NS)
SECOND_NS = 1_000_000_000
KINDS = {
    Opcode.HEADER,
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.CHUNK,
    Opcode.MESSAGE_INDEX,
    Opcode.CHUNK_INDEX,
    Opcode.METADATA,
    Opcode.METADATA_INDEX,
    Opcode.STATISTICS,
    Opcode.SUMMARY_OFFSET,
    Opcode.DATA_END,
    Opcode.FOOTER,
}
"""Records at the top level of a file; messages lie in chunks."""


def recorded(path: Path, compression: str) -> Path:
    """Return a ride, flushed as often as the recorder does; the file."""
    writer = BagWriter(path, compression=compression)
    for name, short in TYPES.items():
        type_name = f"bicycle_msgs/msg/{short}"
        topic = Topic(name, type_name, (), store().hash_rihs01(type_name))
        writer.add_topic(topic, schemas().definition(type_name))
    for number, (name, data, now) in enumerate(ride(STEPS)):
        writer.write(name, data, now, now)
        if number % (2 * FLUSH_STEPS) == 0:
            writer.flush()
    writer.close()
    return path / f"{path.name}_0.mcap"


def places(file: Path) -> dict[int, list[tuple[int, int]]]:
    """Start and end of each record at the top level, by its kind."""
    found: dict[int, list[tuple[int, int]]] = defaultdict(list)
    with file.open("rb") as stream:
        stream.read(len(container.MAGIC))
        for offset, record in container.records(stream, file.stat().st_size):
            found[record.opcode].append((offset, offset + 9 + len(record.body)))
    return found


def cuts(start: int, end: int) -> set[int]:
    """Before a record, in its kind, its length and its content, before its last byte and after."""
    return {start, start + 1, start + 5, start + 9, (start + 9 + end) // 2, end - 1, end}


def written_before(file: Path, cut: int) -> list[Message]:
    """Return the messages in a whole file's chunks before a byte."""
    with file.open("rb") as stream:
        stream.read(len(container.MAGIC))
        count = 0
        for offset, record in container.records(stream, file.stat().st_size):
            if record.opcode == Opcode.CHUNK and offset + 9 + len(record.body) <= cut:
                inner = container.chunk_records(record.body)
                count += sum(1 for item in inner if item.opcode == Opcode.MESSAGE)
    return ride(STEPS)[:count]


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_a_cut_at_every_kind_of_record_loses_at_most_a_second(
    tmp_path: Path, compression: str
) -> None:
    file = recorded(tmp_path / "bag", compression)
    whole = file.read_bytes()
    found = places(file)
    assert set(found) == KINDS
    chunks = found[Opcode.CHUNK]
    assert len(chunks) >= STEPS // FLUSH_STEPS
    chosen = {len(whole) - 1, len(whole) - 4, len(whole) - len(container.MAGIC), 4}
    for spans in found.values():
        for start, end in {spans[0], spans[len(spans) // 2], spans[-1]}:
            chosen |= cuts(start, end)
    everything = ride(STEPS)
    for cut in sorted(chosen - {len(whole)}):
        broken = tmp_path / f"{compression}_{cut}.mcap"
        broken.write_bytes(whole[:cut])
        repair.repair(broken)
        got = [(m.topic, m.data, m.log_time_ns) for m in BagReader(broken).messages()]
        assert got == written_before(file, cut), cut
        # Written were all messages of the chunks that had begun; what they lack is what is lost.
        begun = sum(1 for start, _ in chunks if start < cut)
        complete = sum(1 for _, end in chunks if end <= cut)
        assert begun - complete <= 1
        if begun > complete:
            lost = everything[len(got) : len(written_before(file, chunks[begun - 1][1]))]
            assert lost[-1][2] - lost[0][2] < SECOND_NS
        broken.unlink()
        broken.with_name(broken.name + ".damaged").unlink(missing_ok=True)
