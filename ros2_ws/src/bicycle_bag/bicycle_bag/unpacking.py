"""Unpacks the files of a bag that rosbag2 compressed as a whole (`--compression-mode file`)."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import zstandard

from bicycle_bag import container
from bicycle_bag.contents import Contents
from bicycle_bag.errors import BagError
from bicycle_bag.folder import visible
from bicycle_bag.keeping import keep
from bicycle_bag.reader import PACKED

MOST_TIMES = 2000
"""Largest size of a recording as a multiple of its packed size; text of zeros has ten times it."""
LEAST_LIMIT = 64 * 2**20
"""Bytes that any file may unpack to."""
SPARED = 16 * 2**20
"""Bytes of the disk that are left free."""
PARTIAL = ".partial"
"""Suffix of what a file holds that is cut off; no program takes that for a part of the bag."""
_BLOCK = 2**20


class _CutOffError(Exception):
    """The packed file ends too soon."""


def unpack_files(folder: Path) -> None:
    """Lay each `*.mcap` beside its `*.mcap.zstd`, which stays, unless it is there and finished.

    Raises:
        BagError: One is corrupt or cut off, or the disk does not take it.
    """
    if not os.path.isdir(folder):  # noqa: PTH112 (a Path raises on a name that is too long)
        return
    for packed in visible(folder, PACKED):
        target = packed.with_suffix("")
        is_there = os.path.lexists(target)
        if is_there and _is_finished(target):
            continue
        scratch = packed.with_name(f".{packed.name}.repair")
        try:
            _unpack(packed, scratch)
            if is_there:
                keep(target)
            scratch.replace(target)
        except (_CutOffError, zstandard.ZstdError) as error:
            if is_there:  # a repair may save more of it
                continue
            raise BagError(_refusal(packed, scratch, error)) from None
        except OSError as error:
            raise BagError(
                f"cannot unpack {packed} ({error.strerror}): free some space and check the rights"
            ) from None
        finally:
            scratch.unlink(missing_ok=True)


def _unpack(packed: Path, scratch: Path) -> None:
    """Write what a packed file holds.

    Raises:
        BagError: It holds more than the disk has room for, or than a recording can.
        OSError: The disk does not take it.
        _CutOffError, zstandard.ZstdError: It is cut off or corrupt.
    """
    most = max(LEAST_LIMIT, MOST_TIMES * container.size_of(packed))
    free = shutil.disk_usage(packed.parent).free - SPARED
    written, frame = 0, zstandard.ZstdDecompressor().decompressobj()
    is_begun = False
    with packed.open("rb") as source, scratch.open("wb") as plain:
        while block := source.read(_BLOCK >> 4):
            while block:
                is_begun = True
                data = frame.decompress(block)
                written += len(data)
                if written > free:
                    raise BagError(
                        f"cannot unpack {packed}: it needs more than the {max(0, free) >> 20} MiB "
                        "that are free; free some space"
                    )
                if written > most:
                    raise BagError(
                        f"cannot unpack {packed}: it holds more than {MOST_TIMES} times its size, "
                        "as no recording does; take another copy of it"
                    )
                plain.write(data)
                block = frame.unused_data if frame.eof else b""
                if frame.eof:
                    frame, is_begun = zstandard.ZstdDecompressor().decompressobj(), False
    if is_begun or not written:
        raise _CutOffError("it is cut off")


def _refusal(packed: Path, scratch: Path, error: Exception) -> str:
    """Return the line about a file that cannot be unpacked whole; keep what it holds."""
    begin = f"cannot unpack {packed} ({error}): take another copy of it"
    try:
        messages = _readable(scratch)
    except (BagError, OSError):
        messages = 0
    if not messages:
        return begin
    partial = packed.with_suffix(PARTIAL)
    try:
        scratch.replace(partial)
    except OSError:
        return begin
    return (
        f"{begin}; its first {messages} messages can still be read and all later ones are lost: "
        f"record.sh --repair {partial} makes a file of those"
    )


def _readable(file: Path) -> int:
    """Return the number of messages that can be read of a file."""
    contents = Contents(file)
    for _ in contents.pieces():
        pass
    return sum(contents.counts.values())


def _is_finished(file: Path) -> bool:
    """Return True unless the file ends too soon."""
    try:
        return Contents(file).summary is not None
    except BagError:
        return True
