"""Messages that rosbag2 compressed one by one (`ros2 bag record --compression-mode message`)."""

from __future__ import annotations

from collections.abc import Iterator

import zstandard
from mcap.opcode import Opcode

from bicycle_bag import container
from bicycle_bag.container import HEAD, MAX_RECORD_BYTES, Content, Record, Registry
from bicycle_bag.proofs import MESSAGE_BYTES
from bicycle_bag.walk import Piece

MARK = b"\x28\xb5\x2f\xfd"
"""First bytes of such a message; no CDR begins so."""
_CHUNK_BYTES = 16 * 2**20
"""Size at which a chunk of unpacked messages ends."""


def unpack(data: bytes) -> bytes:
    """Return what a message was before it was compressed.

    Raises:
        zstandard.ZstdError: It is corrupt, or larger than a record may be.
    """
    # The library would reserve whatever size the frame announces.
    announced = zstandard.frame_content_size(data)
    if announced > MAX_RECORD_BYTES:
        raise zstandard.ZstdError(f"it announces {announced} bytes")
    return bytes(zstandard.ZstdDecompressor().decompress(data, max_output_size=MAX_RECORD_BYTES))


def is_packed(message: Record, registry: Registry) -> bool:
    """Return True for the record of a message in CDR that was compressed by itself."""
    if not message.body.startswith(MARK, MESSAGE_BYTES) or message.opcode != Opcode.MESSAGE:
        return False
    channel = registry.channels.get(container.channel_of(message.body))
    return channel is not None and channel.message_encoding == "cdr"


class MessageUnpacker:
    """Unpacks the messages of a file, piece by piece.

    Args:
        registry: The file's channels, complete for each piece that comes.

    Attributes:
        lost: Messages that could not be unpacked, and are left out.
    """

    def __init__(self, registry: Registry) -> None:
        self.lost = 0
        self._registry = registry

    def pieces(self, piece: Piece) -> Iterator[Piece]:
        """Yield what a piece becomes: several where a chunk grows large."""
        if piece.opcode == Opcode.METADATA:
            if container.parse_metadata(piece.body).name != "rosbag2":  # it names the compression
                yield piece
            return
        if not any(is_packed(item, self._registry) for item in piece.items):
            yield piece
            return
        held: list[Record] = []
        size = 0
        for item in self._unpacked(piece):
            held.append(item)
            size += HEAD.size + len(item.body)
            if size > _CHUNK_BYTES:
                yield _made_of(piece, held)
                held, size = [], 0
        if held:
            yield _made_of(piece, held)

    def _unpacked(self, piece: Piece) -> Iterator[Record]:
        for item in piece.items:
            if not is_packed(item, self._registry):
                yield item
                continue
            try:
                data = unpack(item.body[MESSAGE_BYTES:])
            except zstandard.ZstdError:
                self.lost += 1
                continue
            yield Record(item.opcode, item.body[:MESSAGE_BYTES] + data)


def _made_of(piece: Piece, items: list[Record]) -> Piece:
    """Return a piece with other records."""
    if piece.content is None:
        return piece._replace(body=items[0].body, items=items)
    plain = b"".join(HEAD.pack(opcode, len(body)) + body for opcode, body in items)
    return piece._replace(content=Content("", b"", plain, True), items=items)
