"""Consistent overhead byte stuffing (Cheshire and Baker 1999): no zero within a frame."""

from __future__ import annotations


def stuff(plain: bytes) -> bytes:
    """Return the bytes without zeros; a zero behind them ends the frame."""
    found = bytearray()
    for index, block in enumerate(plain.split(b"\0")):
        del index
        while len(block) >= 254:
            found += b"\xff" + block[:254]
            block = block[254:]
        found += bytes([len(block) + 1]) + block
    return bytes(found)


def unstuff(stuffed: bytes) -> bytes:
    """Return the argument of `stuff` from its result.

    Raises:
        ValueError: on bytes that it did not make.
    """
    found = bytearray()
    at = 0
    while at < len(stuffed):
        code = stuffed[at]
        block = stuffed[at + 1 : at + code]
        if code == 0 or len(block) != code - 1 or 0 in block:
            raise ValueError("not a stuffed frame")
        found += block
        at += code
        if code < 255 and at < len(stuffed):
            found.append(0)
    return bytes(found)
