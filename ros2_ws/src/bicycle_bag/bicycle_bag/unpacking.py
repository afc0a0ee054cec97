"""Unpacks the files of a bag that rosbag2 compressed as a whole (`--compression-mode file`)."""

from __future__ import annotations

import os
from pathlib import Path

import zstandard

from bicycle_bag.errors import BagError
from bicycle_bag.reader import PACKED


def unpack_files(folder: Path) -> None:
    """Lay each `*.mcap` beside its `*.mcap.zstd`, which stays, unless it is there.

    Raises:
        BagError: One is corrupt, or the disk does not take it.
    """
    if not os.path.isdir(folder):  # noqa: PTH112 (a Path raises on a name that is too long)
        return
    for packed in sorted(folder.glob(f"*{PACKED}")):
        target = packed.with_suffix("")
        if target.exists():
            continue
        scratch = packed.with_name(f".{packed.name}.repair")
        try:
            with packed.open("rb") as source, scratch.open("wb") as plain:
                zstandard.ZstdDecompressor().copy_stream(source, plain)
            scratch.replace(target)
        except zstandard.ZstdError as error:
            raise BagError(f"cannot unpack {packed} ({error}): take another copy of it") from None
        except OSError as error:
            raise BagError(
                f"cannot unpack {packed} ({error.strerror}): free some space and check the rights"
            ) from None
        finally:
            scratch.unlink(missing_ok=True)
