"""Contents of an MCAP file, piece by piece, and a check that nothing is missing."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Header

from bicycle_bag import container
from bicycle_bag.container import HEAD, DamageError, RawMessage, Record, Registry
from bicycle_bag.errors import BagError
from bicycle_bag.summary import Summary, read_summary
from bicycle_bag.walk import Damage, Piece, UnreadableError, Walk


class Contents:
    """One file, read from its beginning to its end.

    Attributes:
        size: Bytes of the file.
        summary: What its end says; None where the file was never finished or its end is damaged.
        unfinished: Why there is none.
        registry: Channels and schemas that are known so far.
        counts: Messages found so far, by channel.
        span: Their first and last log time in ns; None before there is one.
        has_checksum: True if a checksum of all data could be compared; known at the end.
        library: What wrote it; empty if it does not say.
        orphans: Messages found so far whose channel is unknown, by channel.
        unproved: Channels and schemas as damaged chunks, or else a damaged summary, have them.

    Raises:
        BagError: The file cannot be read, or is of another kind.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = container.size_of(path)
        self.summary: Summary | None = None
        self.unfinished = ""
        self.registry = Registry()
        self.counts: dict[int, int] = {}
        self.span: tuple[int, int] | None = None
        self.has_checksum = False
        self.library = ""
        self.orphans: dict[int, int] = {}
        self.unproved = Registry()
        self._start = ""
        with container.open_binary(path) as stream:
            foreign: BagError | None = None
            try:
                container.check_magic(path, stream)
            except DamageError as error:
                self._start = str(error)
            except BagError as error:
                foreign, self._start = error, "its first bytes are wrong"
            try:
                self.summary = read_summary(stream, self.size)
            except DamageError as error:
                self.unfinished = str(error)
        if foreign is not None and self.summary is None:  # else its end is that of an MCAP file
            raise foreign
        if self.summary is not None:
            self.registry.channels.update(self.summary.registry.channels)
            self.registry.schemas.update(self.summary.registry.schemas)

    @property
    def announced(self) -> int | None:
        """Number of messages by the file's statistics; None if it has none."""
        found = self.summary.statistics if self.summary else None
        return found.message_count if found else None

    @property
    def miscounted(self) -> str:
        """Return what the statistics say otherwise than the file, once read; empty if nothing."""
        found = self.summary.statistics if self.summary else None
        if found is None or self.span is None:
            return ""
        said = {channel: n for channel, n in found.channel_message_counts.items() if n}
        if said and said != self.counts:
            return "its statistics count the messages of its channels wrong"
        if (found.message_start_time, found.message_end_time) != self.span:
            return "its statistics have wrong times"
        return ""

    def messages(self) -> Iterator[RawMessage]:
        """Return the messages of an undamaged file.

        Raises:
            DamageError: It is not.
        """
        for piece in self.pieces():
            if isinstance(piece, Damage):
                raise DamageError(piece.what)
            for item in piece.items:
                if item.opcode == Opcode.MESSAGE:
                    yield container.parse_message(item.body)

    def pieces(self) -> Iterator[Piece | Damage]:
        """Yield everything valid and all damage; messages only of known channels."""
        damaged = False
        for piece in self._pieces():
            damaged = damaged or isinstance(piece, Damage)
            yield piece
        total = sum(self.counts.values())
        if not damaged and self.announced not in (None, total):
            what = f"it holds {total} messages, its statistics say {self.announced}"
            yield Damage(self.size, self.size, what)

    def _pieces(self) -> Iterator[Piece | Damage]:
        if self._start:
            yield Damage(0, 0, self._start)
        with container.open_binary(self.path) as stream:
            walk = Walk(stream, self.size, self.summary, self.registry)
            end = self.size
            try:
                for piece in walk:
                    end = piece.end
                    if isinstance(piece, Damage) and piece.is_chunk:
                        self._keep_definitions(stream, piece)
                    yield from self._take(piece) if isinstance(piece, Piece) else (piece,)
            except UnreadableError as error:
                raise BagError(f"{self.path} cannot be read: {error}") from None
            self.has_checksum = walk.has_checksum
            if self.summary is None and self.orphans:
                self._keep_definitions_of_the_end(stream, end)

    def _take(self, piece: Piece) -> Iterator[Piece | Damage]:
        known, channels, counts = [], self.registry.channels, self.counts
        first, last = self.span or (2**64, -1)
        for item in piece.items:
            if item.opcode == Opcode.MESSAGE:
                channel = container.channel_of(item.body)
                if channel not in channels:
                    self.orphans[channel] = self.orphans.get(channel, 0) + 1
                    continue
                counts[channel] = counts.get(channel, 0) + 1
                time = container.log_time_of(item.body)
                first, last = min(first, time), max(last, time)
            elif piece.content is None and self._contradicts(item):
                what = f"the record at byte {piece.offset} is not as the summary has it"
                yield Damage(piece.offset, piece.end, what)
                return
            else:
                if item.opcode == Opcode.HEADER:
                    self.library = container.parse(Header.read, item.body).library
                self.registry.take(item, lenient=piece.content is not None)
            known.append(item)
        if last >= 0:
            self.span = first, last
        orphans = len(piece.items) - len(known)
        if orphans:
            what = f"{orphans} messages belong to no channel"
            yield Damage(piece.offset, piece.offset, what, orphans=orphans)
        yield piece._replace(items=known)

    def _keep_definitions(self, stream: BinaryIO, lost: Damage) -> None:
        """Remember what a lost chunk seems to define."""
        stream.seek(lost.offset + HEAD.size)
        length = lost.end - lost.offset - HEAD.size
        body = stream.read(max(0, min(length, container.MAX_RECORD_BYTES)))
        found = container.definitions_of_a_damaged_chunk(body)
        self.unproved.schemas.update(found.schemas)
        self.unproved.channels.update(found.channels)

    def _keep_definitions_of_the_end(self, stream: BinaryIO, start: int) -> None:
        """Remember what a damaged summary seems to define, and no damaged chunk."""
        stream.seek(start)
        found = container.definitions_of_a_damaged_summary(stream.read(container.MOST_DEFINING))
        self.unproved.schemas.update(found.schemas | self.unproved.schemas)
        self.unproved.channels.update(found.channels | self.unproved.channels)

    def _contradicts(self, item: Record) -> bool:
        """Return True if the summary has another channel or schema than this one."""
        said = self.summary.registry if self.summary else Registry()
        if item.opcode == Opcode.CHANNEL:
            channel = container.parse_channel(item.body)
            return said.channels.get(channel.id, channel) != channel
        if item.opcode == Opcode.SCHEMA:
            schema = container.parse_schema(item.body)
            return said.schemas.get(schema.id, schema) != schema
        return False
