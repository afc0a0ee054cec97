"""Checks that the body of an MCAP record is of the kind that its head names."""

from __future__ import annotations

import contextlib
import struct
import zlib
from collections.abc import Callable
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from bicycle_bag import container
from bicycle_bag.container import DamageError

MESSAGE_BYTES = 22
"""Bytes of a message record without its data."""
_INDEX = struct.Struct("<HI")

_Proof = Callable[[bytes], "bool | None"]
"""Check of one kind's body: True if the body alone proves the kind, None if it is another."""


def unproved(_: bytes) -> bool | None:
    """Return False for a kind whose body cannot be checked."""
    return False


def _parsed(read: Callable[[Any], object]) -> _Proof:
    def proof(body: bytes) -> bool | None:
        for whole in (True, False):
            with contextlib.suppress(DamageError):
                container.parse(read, body, whole)
                return whole
        return None

    return proof


def _message(body: bytes) -> bool | None:
    topic = int.from_bytes(body[4:8], "little")
    is_channel = topic < len(body) and PROOFS[Opcode.CHANNEL](body)
    return None if is_channel or len(body) < MESSAGE_BYTES else False


def _message_index(body: bytes) -> bool | None:
    length = _INDEX.unpack_from(body)[1] if len(body) >= _INDEX.size else 1
    return True if length == len(body) - _INDEX.size and length % 16 == 0 else None


def _attachment(body: bytes) -> bool | None:
    stored = int.from_bytes(body[-4:], "little")
    right = stored in (0, zlib.crc32(memoryview(body)[:-4]))
    return True if right and _parsed(Attachment.read)(body) else None


PROOFS: dict[int, _Proof] = {
    Opcode.HEADER: _parsed(Header.read),
    Opcode.SCHEMA: _parsed(Schema.read),
    Opcode.CHANNEL: _parsed(Channel.read),
    Opcode.MESSAGE: _message,
    Opcode.MESSAGE_INDEX: _message_index,
    Opcode.ATTACHMENT: _attachment,
    Opcode.METADATA: _parsed(Metadata.read),
    Opcode.DATA_END: lambda body: True if len(body) == 4 else None,
}
"""The kinds of records that may lie in a file's data, besides chunks and private ones."""
