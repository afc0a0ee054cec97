"""Any bytes as a bag: messages or one line, bounded in time and memory."""

from __future__ import annotations

import resource
import struct
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from ride_bag import COMMAND, EPISODE, STATE, make_bag, ride

from bicycle_bag import columns, container, messages, repair
from bicycle_bag.errors import BagError
from bicycle_bag.reader import BagReader

STEPS = 12
Message = tuple[str, bytes, int, int]
MOST_BYTES = 1500 * 2**20
"""Address space beyond the process's own; believing a corrupt length would need more."""
MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None
"""Folder of the files, in memory: a repair waits for the disk, and hundreds would be slow."""
FUZZ = settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
HUGE = (0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**63, 2**64 - 1)
LENGTHS = st.sampled_from(HUGE)
CHUNK_HEAD = struct.calcsize("<QQQI")
"""Bytes of a chunk's times, size and checksum, before the name of its compression."""


@cache
def original(compression: str) -> bytes:
    with tempfile.TemporaryDirectory(dir=MEMORY) as folder:
        make_bag(Path(folder) / "bag", STEPS, chunk_bytes=1024, compression=compression)
        return (Path(folder) / "bag" / "bag_0.mcap").read_bytes()


@cache
def heads(compression: str) -> list[int]:
    """Return the offset of each record's length."""
    with tempfile.TemporaryDirectory(dir=MEMORY) as folder:
        file = Path(folder) / "x.mcap"
        file.write_bytes(original(compression))
        with file.open("rb") as stream:
            stream.read(len(container.MAGIC))
            return [at + 1 for at, _ in container.records(stream, file.stat().st_size)]


@pytest.fixture(autouse=True)
def bounded_memory() -> Iterator[None]:
    """Limit the memory, so that reserving a corrupt length fails the test."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MOST_BYTES, hard))
    yield
    resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def one_line(error: BagError) -> None:
    if "\n" in str(error) or len(str(error)) > 600:
        raise AssertionError(f"not one line: {error}")


def contents(file: Path) -> tuple[list[Message], bool]:
    """Return the messages read, and True if they are said to be all."""
    found: list[Message] = []
    try:
        for m in BagReader(file).messages():
            found.append((m.topic, m.data, m.log_time_ns, m.publish_time_ns))
    except BagError as error:
        one_line(error)
        return found, False
    return found, True


def are_recorded(found: list[Message]) -> bool:
    """Return True if each was recorded, byte for byte, in this order, none twice."""
    rest = iter([(topic, data, now, now - 1000) for topic, data, now in ride(STEPS)])
    return all(any(one == other for other in rest) for one in found)


def survives(data: bytes, *, cut_off: bool = False) -> None:
    """Read the bag in every way, then repair it and read it again: nothing is invented.

    What is lost is told, but for what lay behind the end of a file that was cut off.
    """
    with tempfile.TemporaryDirectory(dir=MEMORY) as folder:
        file = Path(folder) / "bag_0.mcap"
        file.write_bytes(data)
        before, was_whole = contents(file)
        assert are_recorded(before)
        for read in (
            lambda: list(messages.read(file)),
            lambda: columns.load_topics(file, [STATE, COMMAND, EPISODE]),
        ):
            try:
                read()
            except BagError as error:
                one_line(error)
        try:
            report = repair.repair(file)
        except BagError as error:
            one_line(error)
            return
        found, whole = contents(file)
        assert whole
        assert are_recorded(found)
        assert len(found) == report.messages
        lost = report.lost_messages + report.lost_chunks + report.lost_bytes
        assert lost or cut_off or len(found) == len(ride(STEPS)), report
        assert was_whole or report.rewritten, "the remedy that is named is one"
        if was_whole:
            assert before == found


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
@FUZZ
@given(data=st.data())
def test_flipped_bits(compression: str, data: st.DataObject) -> None:
    content = bytearray(original(compression))
    places = st.tuples(st.integers(0, len(content) - 1), st.integers(0, 7))
    for place, bit in data.draw(st.lists(places, min_size=1, max_size=8)):
        content[place] ^= 1 << bit
    survives(bytes(content))


@pytest.mark.parametrize("place", range(8400, 9030, 30))
def test_header_first_chunk_and_end_at_once(place: int) -> None:
    """Messages in an uncompressed chunk whose checksum is wrong are not taken for loose ones."""
    content = bytearray(original("none"))
    for at in (len(container.MAGIC), place, len(content) - 500):
        content[at] ^= 1
    survives(bytes(content))


@FUZZ
@given(cut=st.integers(0, 10**6), tail=st.binary(max_size=30))
def test_truncated_with_a_tail_of_rubbish(cut: int, tail: bytes) -> None:
    content = original("zstd")
    survives(content[: cut % len(content)] + tail, cut_off=True)


@pytest.mark.parametrize("compression", ["zstd", "none"])
@FUZZ
@given(data=st.data(), length=LENGTHS)
def test_huge_lengths_of_records(compression: str, data: st.DataObject, length: int) -> None:
    content = bytearray(original(compression))
    struct.pack_into("<Q", content, data.draw(st.sampled_from(heads(compression))), length)
    survives(bytes(content))


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
@pytest.mark.parametrize("length", HUGE)
def test_huge_lengths_within_a_chunk(compression: str, length: int) -> None:
    content = bytearray(original(compression or "none"))
    first = next(at for at in heads(compression or "none") if content[at - 1] == Opcode.CHUNK)
    name = compression.encode()
    place = first + 8 + CHUNK_HEAD
    assert content[place : place + 4 + len(name)] == struct.pack("<I", len(name)) + name
    struct.pack_into("<Q", content, place + 4 + len(name), length)
    survives(bytes(content))


@FUZZ
@given(data=st.data(), length=LENGTHS)
def test_huge_lengths_anywhere(data: st.DataObject, length: int) -> None:
    content = bytearray(original("none"))
    place = data.draw(st.integers(0, len(content) - 4))
    struct.pack_into("<I", content, place, length % 2**32)
    survives(bytes(content))


@FUZZ
@given(definition=st.binary(max_size=80) | st.sampled_from([b"float64[99999999] x\n", b"A a\n"]))
def test_wrong_schemas(definition: bytes) -> None:
    content, marker = original("none"), b"# The body of one"
    place = content.find(marker)
    assert place > 0
    changed = content[:place] + definition + content[place + len(definition) :]
    survives(changed)
