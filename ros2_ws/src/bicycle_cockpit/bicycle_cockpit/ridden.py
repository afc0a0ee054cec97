"""Duration of a bag's ride in simulated time, from its first and its last state."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from pathlib import Path

from mcap.reader import SeekingReader
from mcap.summary import Summary

from bicycle_tools.ride_log import STATE

_CDR_HEADER = 4
_LITTLE_ENDIAN = 1
LARGEST_CHUNK = 64 * 1024 * 1024
"""Largest chunk that is opened for this (bytes)."""


def ridden(files: Sequence[Path]) -> float | None:
    """Return the simulated time between the first and the last state, s.

    Args:
        files: the MCAP files of a bag, in order.

    Returns:
        None if that is unknown: no bicycle or several, no index, a restart of the simulator, or
        unreadable files.
    """
    try:
        first = _first_known(_stamp(file, last=False) for file in files)
        last = _first_known(_stamp(file, last=True) for file in reversed(files))
    except Exception:  # any error of the reader in a broken file: the list omits the duration
        return None
    if first is None or last is None or last < first:
        return None
    return last - first


def _first_known(stamps: Iterable[float | None]) -> float | None:
    return next((stamp for stamp in stamps if stamp is not None), None)


def _stamp(file: Path, *, last: bool) -> float | None:
    """Return the stamp of a file's first or last state, s; read only the chunk that holds it."""
    with file.open("rb") as stream:
        reader = SeekingReader(stream)
        summary = reader.get_summary()
        topic = _state_topic(summary) if summary is not None else ""
        if not topic:
            return None
        for _, _, message in reader.iter_messages([topic], reverse=last):
            return _seconds(message.data)
    return None


def _state_topic(summary: Summary) -> str:
    """Return the state topic of the only bicycle; empty if the file's index lacks it."""
    names = {one.topic for one in summary.channels.values() if one.topic.endswith(STATE)}
    chunks = summary.chunk_indexes
    small = all(chunk.uncompressed_size <= LARGEST_CHUNK for chunk in chunks)
    return names.pop() if len(names) == 1 and chunks and small else ""


def _seconds(data: bytes) -> float | None:
    """Return the stamp in the header of a message, s."""
    if len(data) < _CDR_HEADER + 8 or data[1] != _LITTLE_ENDIAN:
        return None
    seconds, nanoseconds = struct.unpack_from("<iI", data, _CDR_HEADER)
    return float(seconds + 1e-9 * nanoseconds)
