"""A flipped bit in every kind of record: no message is invented, and each loss is reported."""

from __future__ import annotations

import os
import random
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from itertools import chain
from pathlib import Path

import pytest
from foreign_bag import ForeignFile
from mcap.opcode import Opcode
from ride_bag import TYPES, make_bag, ride, schemas
from syncing import noted_syncs

from bicycle_bag import container, repair
from bicycle_bag.errors import BagError
from bicycle_bag.metadata import Topic
from bicycle_bag.reader import BagReader
from bicycle_bag.writer import BagWriter

STEPS = 30
HEAD = 9
MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None
Message = tuple[str, bytes, int, int]
KINDS = (
    Opcode.HEADER,
    Opcode.METADATA,
    Opcode.CHUNK,
    Opcode.MESSAGE_INDEX,
    Opcode.DATA_END,
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.STATISTICS,
    Opcode.CHUNK_INDEX,
    Opcode.METADATA_INDEX,
    Opcode.SUMMARY_OFFSET,
    Opcode.FOOTER,
)


@pytest.fixture
def folder() -> Iterator[Path]:
    """Return a folder in memory, because a repair waits for the disk."""
    with tempfile.TemporaryDirectory(dir=MEMORY) as name:
        yield Path(name)


@cache
def original(compression: str) -> bytes:
    with tempfile.TemporaryDirectory(dir=MEMORY) as name:
        make_bag(Path(name) / "bag", STEPS, chunk_bytes=2048, compression=compression)
        return (Path(name) / "bag" / "bag_0.mcap").read_bytes()


def recorded() -> list[Message]:
    return [(topic, data, now, now - 1000) for topic, data, now in ride(STEPS)]


def places(data: bytes) -> dict[int, list[tuple[int, int]]]:
    """Start and end of each record at the top level of a whole file, by its kind."""
    found: dict[int, list[tuple[int, int]]] = {}
    with tempfile.TemporaryDirectory(dir=MEMORY) as name:
        file = Path(name) / "x.mcap"
        file.write_bytes(data)
        with file.open("rb") as stream:
            stream.read(len(container.MAGIC))
            for offset, record in container.records(stream, len(data)):
                end = offset + HEAD + len(record.body)
                found.setdefault(record.opcode, []).append((offset, end))
    return found


def top_level(data: bytes) -> list[tuple[int, int]]:
    """Start and end of each record of an unfinished file."""
    found, at = [], len(container.MAGIC)
    while at < len(data):
        end = at + HEAD + int.from_bytes(data[at + 1 : at + HEAD], "little")
        found.append((at, end))
        at = end
    return found


def messages_in(data: bytes, span: tuple[int, int]) -> int:
    """Return the messages of a chunk."""
    inner = container.chunk_records(data[span[0] + HEAD : span[1]])
    return sum(record.opcode == Opcode.MESSAGE for record in inner)


def read(file: Path) -> tuple[list[Message], str]:
    """Return the messages read, and the error at the end."""
    found: list[Message] = []
    trouble = ""
    try:
        for m in BagReader(file).messages():
            found.append((m.topic, m.data, m.log_time_ns, m.publish_time_ns))
    except BagError as error:
        trouble = str(error)
    assert "\n" not in trouble
    return found, trouble


def is_part(found: list[Message], of: list[Message]) -> bool:
    """Return True if all were recorded, in this order, none twice."""
    rest = iter(of)
    return all(any(one == other for other in rest) for one in found)


def check_flip(folder: Path, data: bytes, bit: int, most: int) -> repair.RepairReport:
    """Read and repair a file with one flipped bit, of which at most so many may be lost."""
    wanted = recorded()
    flipped = bytearray(data)
    flipped[bit // 8] ^= 1 << bit % 8
    file = folder / f"flip_{bit}.mcap"
    file.write_bytes(flipped)
    found, trouble = read(file)
    assert is_part(found, wanted)
    assert trouble.endswith("recover it with record.sh --repair")
    report = repair.repair(file)
    found, trouble = read(file)
    assert trouble == ""
    assert is_part(found, wanted)
    lost = len(wanted) - len(found)
    assert lost <= most
    assert report.rewritten == [file]
    assert (report.messages, report.lost_messages) == (len(found), lost)
    if lost:
        assert f"{len(found)} messages are whole of {len(wanted)}" in str(report)
        assert " s after the beginning" in str(report)
        (kept,) = report.kept
        assert kept.read_bytes() == flipped
    assert repair.repair(file).rewritten == []
    for path in folder.iterdir():
        path.unlink()
    return report


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name.lower())
def test_a_flipped_bit_loses_one_chunk_at_most(
    folder: Path, kind: Opcode, compression: str
) -> None:
    data = original(compression)
    spans = places(data)[kind]
    rng = random.Random(f"{kind}{compression}")
    for start, end in {spans[0], spans[len(spans) // 2], spans[-1]}:
        most = messages_in(data, (start, end)) if kind == Opcode.CHUNK else 0
        heads = rng.sample(range(start * 8, (start + HEAD) * 8), 3)
        bodies = rng.sample(range((start + HEAD) * 8, end * 8), 3)
        for bit in chain(heads, bodies):
            check_flip(folder, data, bit, 0 if bit in heads else most)


def test_a_flipped_bit_in_the_magic_loses_nothing(folder: Path) -> None:
    data = original("zstd")
    for bit in (0, 9, 63, len(data) * 8 - 1, len(data) * 8 - 64):
        check_flip(folder, data, bit, 0)


def test_a_chunk_that_calls_itself_an_index_is_read_by_the_index_of_the_file(folder: Path) -> None:
    data = original("zstd")
    for start, _ in places(data)[Opcode.CHUNK][::4]:
        assert data[start] == Opcode.CHUNK
        for bit in range(8):
            report = check_flip(folder, data, start * 8 + bit, 0)
            assert report.messages == len(recorded())


def test_an_index_that_calls_itself_a_message_is_none(folder: Path) -> None:
    data = original("zstd")
    for start, _ in places(data)[Opcode.MESSAGE_INDEX]:
        assert check_flip(folder, data, start * 8 + 1, 0).messages == len(recorded())


def unfinished(compression: str) -> bytes:
    """Return the file of a killed recorder: no index, no footer."""
    data = original(compression)
    return data[: places(data)[Opcode.DATA_END][0][0]]


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_a_flipped_bit_in_a_head_of_an_unfinished_file_loses_nothing(
    folder: Path, compression: str
) -> None:
    data, wanted = unfinished(compression), recorded()
    found = places(original(compression))
    starts = [start for start, _ in found[Opcode.CHUNK] + found[Opcode.MESSAGE_INDEX]]
    for start in starts[::5]:
        for bit in (*range(start * 8, start * 8 + 8), start * 8 + 13, start * 8 + 30):
            flipped = bytearray(data)
            flipped[bit // 8] ^= 1 << bit % 8
            file = folder / "x.mcap"
            file.write_bytes(flipped)
            assert "record.sh --repair" in read(file)[1]
            report = repair.repair(file)
            assert (read(file), report.lost_chunks) == ((wanted, ""), 0), bit


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_a_lost_chunk_of_an_unfinished_file_is_told(folder: Path, compression: str) -> None:
    data, wanted = unfinished(compression), recorded()
    for start, end in places(original(compression))[Opcode.CHUNK][1::4]:
        flipped = bytearray(data)
        flipped[(start + end) // 2] ^= 4
        file = folder / "x.mcap"
        file.write_bytes(flipped)
        report = repair.repair(file)
        found, trouble = read(file)
        assert trouble == ""
        assert is_part(found, wanted)
        assert len(found) == len(wanted) - messages_in(original(compression), (start, end))
        assert report.lost_chunks == 1
        assert "lost: 1 chunks, of " in str(report)


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_the_first_chunk_of_an_unfinished_file_takes_nothing_else_along(
    folder: Path, compression: str
) -> None:
    """Topics are defined in two chunks, also one that came later."""
    writer = BagWriter(folder / "bag", compression=compression)
    wanted = []
    for name, short in TYPES.items():
        type_name = f"bicycle_msgs/msg/{short}"
        writer.add_topic(Topic(name, type_name), schemas().definition(type_name))
        for topic, data, now in ride(STEPS):
            if topic == name:
                writer.write(topic, data, now, now - 1000)
                wanted.append((topic, data, now, now - 1000))
                writer.flush()
    file = folder / "bag" / "bag_0.mcap"
    data = file.read_bytes()  # as a killed recorder leaves it
    writer.close()
    chunks = [span for span in top_level(data) if data[span[0]] == Opcode.CHUNK]
    assert len(chunks) == len(wanted)
    for number in (0, STEPS, 2 * STEPS):
        start, end = chunks[number]
        flipped = bytearray(data)
        flipped[(start + end) // 2] ^= 4
        file = folder / "x.mcap"
        file.write_bytes(flipped)
        assert repair.repair(file).lost_chunks == 1
        assert read(file) == ([one for at, one in enumerate(wanted) if at != number], "")


def test_a_flipped_bit_in_a_head_of_a_file_without_chunks_loses_a_message(folder: Path) -> None:
    file = folder / "x.mcap"
    with ForeignFile(file, use_chunking=False) as result:
        result.ride_channels()
        for topic, data, now in ride(STEPS):
            result.write(topic, data, now, now - 1000)
    whole, wanted = file.read_bytes(), recorded()
    assert read(file) == (wanted, "")
    for start, _ in places(whole)[Opcode.MESSAGE][1::20]:
        for bit in (*range(start * 8, start * 8 + 8), *range(start * 8 + 8, start * 8 + 72, 5)):
            flipped = bytearray(whole)
            flipped[bit // 8] ^= 1 << bit % 8
            file.write_bytes(flipped)
            assert "record.sh --repair" in read(file)[1]
            report = repair.repair(file)
            found, trouble = read(file)
            assert trouble == ""
            assert is_part(found, wanted)
            assert len(wanted) - len(found) == report.lost_messages == 1, bit
            file.with_name("x.mcap.damaged").unlink()


@pytest.mark.parametrize("kind", [Opcode.CHANNEL, Opcode.SCHEMA], ids=["channel", "schema"])
def test_a_flipped_bit_in_a_definition_of_a_file_without_chunks_loses_nothing(
    folder: Path, kind: Opcode
) -> None:
    """No message comes out on another topic or as another type: the summary knows better."""
    file = folder / "x.mcap"
    with ForeignFile(file, use_chunking=False) as result:
        result.ride_channels()
        for topic, data, now in ride(STEPS):
            result.write(topic, data, now, now - 1000)
    whole, types = file.read_bytes(), {n: t.type for n, t in BagReader(file).topics.items()}
    start, end = places(whole)[kind][1]
    # Bit 7 of an opcode makes a private record, which is none of ours: all else stays as it was.
    for bit in (
        *range(start * 8, start * 8 + 7),
        start * 8 + 8,
        *range(start * 8 + 72, end * 8, 997),
        end * 8 - 1,
    ):
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 1 << bit % 8
        file.write_bytes(flipped)
        assert (read(file)[0], read(file)[1].split()[-1]) == ([], "--repair"), bit
        report = repair.repair(file)
        assert read(file) == (recorded(), ""), bit
        assert {name: topic.type for name, topic in BagReader(file).topics.items()} == types
        assert (report.lost_messages, len(report.kept)) == (0, 1)


def test_what_only_the_checksum_of_all_data_can_tell_is_told_so(folder: Path) -> None:
    file = folder / "x.mcap"
    with ForeignFile(file, use_chunking=False, enable_data_crcs=True) as result:
        result.ride_channels()
        for topic, data, now in ride(STEPS):
            result.write(topic, data, now)
    flipped = bytearray(file.read_bytes())
    flipped[places(bytes(flipped))[Opcode.MESSAGE][5][1] - 3] ^= 1
    file.write_bytes(flipped)
    assert "the checksum of its data is wrong" in read(file)[1]
    report = repair.repair(file)
    assert f"which of {len(ride(STEPS))} messages" in str(report)
    assert [kept.read_bytes() for kept in report.kept] == [flipped]
    assert read(file)[1] == ""


@pytest.mark.parametrize("checked", [False, True])
def test_it_is_told_where_no_checksum_could_tell_of_damage(folder: Path, checked: bool) -> None:
    file = folder / "x.mcap"
    with ForeignFile(file, use_chunking=False, enable_data_crcs=checked) as result:
        result.ride_channels()
        for topic, data, now in ride(STEPS):
            result.write(topic, data, now)
    told = f"; {len(ride(STEPS))} have no checksum, so that damage in them cannot be seen"
    assert (told in str(repair.repair(file))) == (not checked)
    file.write_bytes(original("zstd"))
    assert "checksum" not in str(repair.repair(file))


def test_an_original_that_was_kept_before_stays(folder: Path) -> None:
    file = folder / "x.mcap"
    file.write_bytes(original("zstd"))
    before = []
    for number in range(3):
        data = bytearray(file.read_bytes())
        _, end = places(bytes(data))[Opcode.CHUNK][number]
        data[end - 5] ^= 1
        file.write_bytes(data)
        before.append(bytes(data))
        repair.repair(file)
    kept = [folder / f"x.mcap.damaged{end}" for end in ("", ".2", ".3")]
    assert [path.read_bytes() for path in kept] == before


def finish_badly(change: Callable[[bytes], bytes]) -> Callable[[int], None]:
    """Return a sync after which the file holds something else."""

    def sync(descriptor: int) -> None:
        place = Path(f"/proc/self/fd/{descriptor}").readlink()
        if place.is_file():
            place.write_bytes(change(place.read_bytes()))

    return sync


def test_a_repaired_file_that_does_not_read_back_takes_no_place(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = folder / "x.mcap"
    damaged = original("zstd")[:-1]
    for change in (
        lambda data: data[:3000] + bytes([data[3000] ^ 1]) + data[3001:],
        lambda data: data[:2000] + bytes(4096) + data[6096:],
        lambda _: b"",
        lambda data: data[:-30],
    ):
        file.write_bytes(damaged)
        monkeypatch.setattr(os, "fsync", finish_badly(change))
        with pytest.raises(BagError, match="the bag is as it was"):
            repair.repair(file)
        assert {path.name: path.read_bytes() for path in folder.iterdir()} == {"x.mcap": damaged}


def test_a_repaired_file_is_on_the_disk_before_it_takes_the_old_ones_place(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced = noted_syncs(monkeypatch)
    file = folder / "x.mcap"
    file.write_bytes(original("zstd")[:-1])
    repair.repair(file)
    assert synced == [(".x.mcap.repair", file.read_bytes()), (folder.name, ["x.mcap"])]
