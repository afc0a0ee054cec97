"""Walks the records of an MCAP file and accepts only consistent ones.

A record is accepted if its head and its body are consistent; the index of a finished file locates
a record whose head is damaged. Inconsistent bytes are skipped up to the next consistent record,
and reported.
"""

from __future__ import annotations

import re
import struct
import zlib
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode

from bicycle_bag import container
from bicycle_bag.container import (
    HEAD,
    MAGIC,
    MAX_RECORD_BYTES,
    Content,
    DamageError,
    Record,
    Registry,
)
from bicycle_bag.proofs import MESSAGE_BYTES, PROOFS, unproved
from bicycle_bag.summary import Summary

PRIVATE = 0x80
"""First opcode reserved for applications."""
LAST_KNOWN = 0x0F
"""Last opcode of this version of the format."""
MOST_RECORDS = 2**21
"""Largest number of records in a chunk: more than any writer packs, few enough for any machine."""
_CHUNK = struct.Struct("<QQQII")
_DEFINING = (Opcode.SCHEMA, Opcode.CHANNEL)
_LIKELY = re.compile(rb"(?=[\x03-\x07\x09\x0c\x0f].{3}\0{5})", re.DOTALL)
"""Pattern at which a record of less than 16 MiB may begin."""
_CHUNKS = re.compile(rb"(?=\x06.{3}\0{5})", re.DOTALL)
_FOOTER = re.compile(HEAD.pack(Opcode.FOOTER, 20) + rb".{20}" + re.escape(MAGIC), re.DOTALL)
_END_BYTES = HEAD.size + 20 + len(MAGIC)
_WINDOW = 2**20
WRONG_CHECKSUM = "the checksum of its data is wrong"
_SMALLER = f"chunks of more than {MAX_RECORD_BYTES >> 20} MiB cannot be read here"
_FEWER = "so many cannot be read here"
_PACK = "only zstd, lz4 and none can be read here"
_HUGE = 2**40
_PATIENCE = 300
_CHAIN = 3
"""Length of a sequence of consistent records that is no coincidence."""


class UnreadableError(Exception):
    """A chunk that is whole and yet cannot be read here; `str()` says why."""


class Damage(NamedTuple):
    """Damaged bytes of a file.

    `span` are the times of a lost chunk in ns, `orphans` messages that are left out.
    """

    offset: int
    end: int
    what: str
    is_chunk: bool = False
    span: tuple[int, int] | None = None
    orphans: int = 0


class Piece(NamedTuple):
    """A valid record; of a chunk also its contents, of a huge record no body."""

    offset: int
    end: int
    opcode: int
    body: bytes
    content: Content | None = None
    items: Sequence[Record] = ()


class Walk:
    """The data of a file, from its first record to the end of its data.

    Args:
        stream: The file, behind its magic bytes or not.
        size: Its bytes.
        summary: Of a finished file whose summary is sound.
        registry: Channels that are known, filled by who takes the pieces.

    Attributes:
        has_checksum: True if a checksum of all data was there and could be compared.
    """

    def __init__(
        self, stream: BinaryIO, size: int, summary: Summary | None, registry: Registry
    ) -> None:
        self.has_checksum = False
        self._stream = stream
        self._size = size
        self._registry = registry
        self._summary = summary
        self._data_end = summary.data_end if summary else None
        self._has_data_end = summary is None or summary.has_data_end
        self._limit = size if self._data_end is None else self._data_end
        self._places = summary.places if summary else {}
        self._offsets = sorted(at for at in self._places if len(MAGIC) <= at < self._limit)
        self._is_chunked = summary.is_chunked if summary else None
        self._patience = _PATIENCE
        self._reached = len(MAGIC)  # in sequence, each record behind a sound one
        self._among_messages = False  # outside chunks

    def __iter__(self) -> Iterator[Piece | Damage]:
        offset, sound, in_sequence = len(MAGIC), True, True
        checksum: int | None = zlib.crc32(self._read(0, offset))
        while offset < self._size:
            if offset == self._data_end and not self._has_data_end:
                return
            self._reached = offset if in_sequence else -1
            found = self._at(offset)
            if found is None:
                end = self._resume(offset)
                what = "it is cut off or corrupt in the record at byte"
                found = Damage(offset, end, f"{what} {offset}")
            elif isinstance(found, Piece) and not self._head_is(found):
                sound = False
                yield Damage(offset, offset, f"the head of the record at byte {offset} is wrong")
            sound = sound and isinstance(found, Piece)
            if isinstance(found, Piece) and found.opcode == Opcode.DATA_END:
                (stored,) = struct.unpack("<I", found.body)
                self.has_checksum = sound and stored != 0
                if self.has_checksum and stored != checksum:
                    yield Damage(offset, offset, WRONG_CHECKSUM)
                offset, sound, in_sequence = self._end(found.end), False, False
                continue
            if sound:
                checksum = self._checksum(offset, found.end, checksum)
            yield found
            offset, in_sequence = found.end, isinstance(found, Piece)
            if isinstance(found, Piece):
                self._among_messages = found.opcode == Opcode.MESSAGE
            ended = self._has_data_end and offset == self._data_end
            if ended and self._at(offset) is None:
                yield Damage(offset, offset, "its data has no end")
                return

    def _end(self, offset: int) -> int:
        """Return the offset behind the footer that comes after an offset, where something follows.

        Of a file whose summary is sound, and where there is no footer, it is the file's size.
        """
        while self._summary is None and offset < self._size:
            window = self._read(offset, _WINDOW + _END_BYTES)
            if found := _FOOTER.search(window):
                return offset + found.end()
            offset += _WINDOW
        return self._size

    def _at(self, offset: int) -> Piece | Damage | None:
        """Return the record or damage at an offset; None if it cannot be recognised."""
        head = self._read(offset, HEAD.size)
        if len(head) < HEAD.size:
            return None
        opcode, length = HEAD.unpack(head)
        if opcode == Opcode.CHUNK and self._is_chunked is None:
            self._is_chunked = True
        own = self._record(opcode, offset, length)
        if opcode > LAST_KNOWN:
            own = self._chunk_with_a_wrong_head(offset) or own
        place = self._places.get(offset)
        if place is None:
            return own or self._chunk_with_a_wrong_head(offset)
        indexed = own
        if own is None or own.end != offset + place.length or opcode != place.opcode:
            indexed = self._record(place.opcode, offset, place.length - HEAD.size)
        if own is None and indexed is None and place.opcode == Opcode.CHUNK:
            end = min(offset + max(place.length, HEAD.size), self._limit)
            return self._lost(offset, end, "a chunk is corrupt")
        return indexed or own

    def _lost(
        self, offset: int, end: int, what: str, span: tuple[int, int] | None = None
    ) -> Damage:
        """Return a lost chunk with its times from the index, or else from its own head."""
        for chunk in self._summary.chunks if self._summary else ():
            if chunk.chunk_start_offset != offset:
                continue
            span = chunk.message_start_time, chunk.message_end_time
            if max(chunk.uncompressed_size, chunk.chunk_length) > MAX_RECORD_BYTES:
                raise UnreadableError(f"a chunk has {chunk.uncompressed_size} bytes: {_SMALLER}")
            if chunk.compression not in ("", "lz4", "zstd"):
                raise UnreadableError(
                    f"its chunks are packed as {chunk.compression!r:.40}: {_PACK}"
                )
        return Damage(offset, end, what, True, span)

    def _chunk_bytes(self, offset: int) -> int:
        """Return the length of a chunk by its own fields; -1 if it cannot be a chunk."""
        start = self._read(offset + HEAD.size, _CHUNK.size + 12)
        name = _CHUNK.unpack_from(start)[-1] if len(start) == _CHUNK.size + 12 else 5
        if name > 4:
            return -1
        (packed,) = struct.unpack_from("<Q", start, _CHUNK.size + name)
        return int(_CHUNK.size + name + 8 + packed)

    def _chunk_with_a_wrong_head(self, offset: int) -> Piece | None:
        length = self._chunk_bytes(offset)
        fits = self._fits(Opcode.CHUNK, offset, offset + HEAD.size + length)
        if not 0 < length <= MAX_RECORD_BYTES or not fits or self._patience == 0:
            return None
        found = self._chunk(offset, length)
        if isinstance(found, Piece) and found.items:
            return found
        self._patience -= 1  # bounds the work on files with thousands of false heads
        return None

    def _record(self, opcode: int, offset: int, length: int) -> Piece | Damage | None:
        """Return a record of this kind and length if there is one; damage for a broken chunk."""
        end = offset + HEAD.size + length
        if length < 0 or not self._fits(opcode, offset, end):
            return None
        if length > MAX_RECORD_BYTES:
            huge = opcode == Opcode.ATTACHMENT or opcode >= PRIVATE
            return Piece(offset, end, opcode, b"") if huge and self._goes_on(offset, end) else None
        if opcode == Opcode.CHUNK:
            return self._chunk(offset, length)
        body = self._read(offset + HEAD.size, length)
        if LAST_KNOWN < opcode < PRIVATE and self._is_another(opcode, offset, length):
            return None
        if opcode == Opcode.MESSAGE and self._is_chunked and _is_like_an_index(body):
            return None
        proof = PROOFS.get(opcode, unproved)(body)
        if proof is None or (not proof and not self._goes_on(offset, end)):
            return None
        if opcode == Opcode.MESSAGE and not self._is_chunked:
            self._is_chunked = False
        return Piece(offset, end, opcode, body, None, (Record(opcode, body),))

    def _is_another(self, opcode: int, offset: int, length: int) -> bool:
        """Return True if a record of an unknown kind is one of a known kind with a wrong bit."""
        near = [known for known in PROOFS if (opcode ^ known).bit_count() == 1]
        return any(self._likely(known, offset + HEAD.size, length) for known in near)

    def _fits(self, opcode: int, offset: int, end: int, in_sequence: bool | None = None) -> bool:
        """Return True if a record of this kind may be there and fits into the file.

        Args:
            opcode: Of the record.
            offset: Of the record.
            end: Of the record.
            in_sequence: True if it follows a sound record; by default, if it is the next one.
        """
        follows = offset == self._reached if in_sequence is None else in_sequence
        if opcode == Opcode.DATA_END:
            return end <= self._size and self._data_end in (None, offset)
        if opcode == Opcode.HEADER:
            return end <= self._limit and offset == len(MAGIC)
        is_placed = self._may_be_mixed and (follows or self._among_messages)
        if opcode == Opcode.MESSAGE and self._is_chunked and not is_placed:
            return False  # as they lie in a broken chunk
        known = opcode in PROOFS or opcode == Opcode.CHUNK or opcode >= PRIVATE
        return (known or (follows and opcode > LAST_KNOWN)) and end <= self._limit

    @property
    def _may_be_mixed(self) -> bool:
        """True if nothing says that all messages lie in chunks."""
        return self._summary is None or self._summary.statistics is None

    def _chunk(self, offset: int, length: int) -> Piece | Damage | None:
        body = self._read(offset + HEAD.size, length)
        try:
            chunk = container.parse_chunk(body)
        except DamageError:
            return None
        end = offset + HEAD.size + length
        try:
            content = container.unpack(chunk)
            if content.holds_more_than(MOST_RECORDS):
                raise UnreadableError(f"a chunk holds more than {MOST_RECORDS} records: {_FEWER}")
            items = [record for _, record in content.records()]
            for opcode, inner in items:
                short = opcode == Opcode.MESSAGE and len(inner) < MESSAGE_BYTES
                if short:
                    raise DamageError("a record in a chunk is corrupt")
                if opcode in _DEFINING:
                    Registry().take(Record(opcode, inner), content.has_checksum)
        except DamageError as error:
            span = chunk.message_start_time, chunk.message_end_time
            return self._lost(offset, end, str(error), span)
        return Piece(offset, end, Opcode.CHUNK, body, content, items)

    def _goes_on(self, offset: int, end: int) -> bool:
        """Return True if an unproved record ends where the next one begins."""
        if bisect_right(self._offsets, offset) != bisect_right(self._offsets, end - 1):
            return False
        ahead = self._read(end, HEAD.size)
        if end == self._limit or end in self._places or len(ahead) < HEAD.size:
            return True
        follows = offset == self._reached
        if self._begins(end, self._limit, in_sequence=follows):
            return True
        opcode, length = HEAD.unpack(ahead)
        if opcode <= LAST_KNOWN and self._begins(end, self._limit, 1, follows):
            return True
        # The next record's head may be broken, or cut off.
        after, resumed = end + HEAD.size + length, self._resume(offset)
        is_message = opcode == Opcode.MESSAGE and self._likely(opcode, end + HEAD.size, length)
        cut_off = opcode in PROOFS and after > self._limit == resumed
        return resumed > end and (after == resumed or is_message or cut_off)

    def _resume(self, offset: int) -> int:
        """Return the offset of the next record after an unreadable one."""
        if self._is_chunked is None:
            self._is_chunked = self._search(offset + 1, self._limit, _CHUNKS) < self._limit
        place = bisect_right(self._offsets, offset)
        bound = self._offsets[place] if place < len(self._offsets) else self._limit
        return self._search(offset + 1, max(bound, offset + 1))

    def _search(self, start: int, bound: int, likely: re.Pattern[bytes] = _LIKELY) -> int:
        while start < bound:
            window = self._read(start, min(_WINDOW + HEAD.size - 1, bound - start))
            for match in likely.finditer(window):
                at = match.start()
                if self._is_chunked and window[at] in _DEFINING:
                    continue  # as they lie in a broken chunk
                if self._begins(start + at, bound):
                    return start + at
            start += _WINDOW
        return bound

    def _begins(
        self, offset: int, bound: int, chain: int = _CHAIN, in_sequence: bool = False
    ) -> bool:
        """Return True if a sequence of consistent records begins here."""
        for _ in range(chain):
            head = self._read(offset, HEAD.size)
            if len(head) < HEAD.size:
                return False
            opcode, length = HEAD.unpack(head)
            if not self._fits(opcode, offset, offset + HEAD.size + length, in_sequence):
                return False
            if opcode == Opcode.CHUNK:
                if self._summary is not None and self._summary.chunks:
                    return offset in self._places
                return self._chunk_bytes(offset) == length
            if not self._likely(opcode, offset + HEAD.size, length):
                return False
            offset += HEAD.size + length
            if opcode == Opcode.DATA_END or offset == bound:
                return True
        return True

    def _likely(self, opcode: int, body: int, length: int) -> bool:
        if opcode == Opcode.MESSAGE:
            (channel,) = struct.unpack("<H", self._read(body, 2).ljust(2, b"\0"))
            return length >= MESSAGE_BYTES and channel in self._registry.channels
        if opcode > LAST_KNOWN or length > _WINDOW:
            return opcode > LAST_KNOWN
        return PROOFS[opcode](self._read(body, length)) is not None

    def _head_is(self, piece: Piece) -> bool:
        head = HEAD.pack(piece.opcode, piece.end - piece.offset - HEAD.size)
        return self._read(piece.offset, HEAD.size) == head

    def _checksum(self, start: int, end: int, before: int | None) -> int:
        checksum = before or 0
        for at in range(start, end, _WINDOW):
            checksum = zlib.crc32(self._read(at, min(_WINDOW, end - at)), checksum)
        return checksum

    def _read(self, offset: int, length: int) -> bytes:
        self._stream.seek(offset)
        return self._stream.read(length)


def _is_like_an_index(body: bytes) -> bool:
    """Return True for a message's body that is a chunk's message index: its kind is wrong.

    Where a message has the time at which it was published, an index has an offset in the chunk.
    """
    offset = int.from_bytes(body[14:22], "little")
    return offset < MAX_RECORD_BYTES and PROOFS[Opcode.MESSAGE_INDEX](body) is True
