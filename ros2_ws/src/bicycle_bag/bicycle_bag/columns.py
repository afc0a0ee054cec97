"""A topic's messages as numpy columns, decoded all at once: an hour of 40 Hz in a second.

Messages are laid out by CDR (little endian, as Fast DDS and Cyclone write it): each number
aligned to its own size, strings and sequences led by a 32-bit length. Messages with equal lengths
have their numbers at equal places, so they are cut out of one array together.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bicycle_bag.errors import BagError
from bicycle_bag.layout import Leaf, layout
from bicycle_bag.own_types import check_definition
from bicycle_bag.reader import BagReader

Columns = dict[str, NDArray[Any]]
_Bytes = NDArray[np.uint8]
_LENGTH = Leaf("a length", np.dtype("<u4"), 1, is_scalar=True)
_HEADER = 4
_LITTLE_ENDIAN = 1


def load(bag: BagReader | Path | str, topic: str) -> Columns:
    """Return all messages of one topic as columns; see `load_topics`."""
    return load_topics(bag, [topic])[topic]


def load_topics(bag: BagReader | Path | str, topics: Collection[str]) -> dict[str, Columns]:
    """Return all messages of some topics as columns, in one pass over the bag.

    Args:
        bag: An open bag, or the path of one.
        topics: Names of the topics.

    Returns:
        For each topic a dict from dotted field name (`goal.x`) to an array with one row per
        message in recorded order: `(n,)` of the field's own type; `(n, k)` for an array of
        fixed length k, or of a length that happens to be equal in all messages; objects for
        strings and other sequences. Besides, in seconds as float64: `log_time`,
        `publish_time` and, of each `builtin_interfaces/Time`, its sum by its own name
        (`header.stamp`); and `recorded_order`, the place in the bag among all its messages:
        what came before what, also where the recording's clock was set meanwhile.

    Raises:
        BagError: The bag cannot be read, lacks a topic, or a type is not made of numbers and
            strings (a sequence of messages: use `messages.read`).
    """
    reader = bag if isinstance(bag, BagReader) else BagReader(bag)
    reader.require(topics)
    leaves = {topic: _leaves(reader, topic) for topic in topics}
    times: dict[str, list[tuple[int, int, int]]] = {topic: [] for topic in topics}
    data: dict[str, list[bytes]] = {topic: [] for topic in topics}
    for message in reader.messages(topics):
        reader.check_kind(message.topic, message.type, message.encoding)
        moment = message.log_time_ns, message.publish_time_ns, message.number
        times[message.topic].append(moment)
        data[message.topic].append(message.data)
    return {
        topic: {**_time_columns(times[topic]), **_decode(topic, leaves[topic], data[topic])}
        for topic in topics
    }


def _leaves(reader: BagReader, topic: str) -> list[Leaf]:
    type_name, definition = reader.topics[topic].type, reader.definition(topic)
    check_definition(topic, type_name, definition)
    try:
        return layout(type_name, definition)
    except ValueError as error:
        raise BagError(
            f"{topic} ({type_name}) cannot be made columns of ({error}): read it with "
            "bicycle_bag.messages"
        ) from None


def _time_columns(times: list[tuple[int, int, int]]) -> Columns:
    # Unsigned, as the format has them: signed ones end in 2262.
    numbers = np.array(times, dtype=np.uint64).reshape(-1, 3)
    return {
        "log_time": numbers[:, 0] * 1e-9,
        "publish_time": numbers[:, 1] * 1e-9,
        "recorded_order": numbers[:, 2].astype(np.int64),
    }


def _decode(topic: str, leaves: list[Leaf], data: list[bytes]) -> Columns:
    parts: list[tuple[NDArray[np.intp], Columns]] = []
    lengths = np.fromiter(map(len, data), dtype=np.intp, count=len(data))
    try:
        for length in np.unique(lengths):
            rows = np.flatnonzero(lengths == length)
            if length < _HEADER:
                raise ValueError(f"a message has {length} bytes")
            block = np.frombuffer(b"".join(data[row] for row in rows), np.uint8)
            _decode_block(leaves, block.reshape(-1, int(length)), rows, parts)
    except ValueError as error:
        raise BagError(
            f"a message of {topic} is not of the recorded type ({error}): the bag's recorder was "
            "another version or the bag is corrupt"
        ) from None
    return _with_stamps({leaf.name: _merge(leaf, parts, len(data)) for leaf in leaves})


def _decode_block(
    leaves: list[Leaf],
    block: _Bytes,
    rows: NDArray[np.intp],
    parts: list[tuple[NDArray[np.intp], Columns]],
) -> None:
    if (block[:, 1] != _LITTLE_ENDIAN).any() or (block[:, 0] != 0).any():
        raise ValueError("its encoding is not little-endian CDR")
    pending: list[tuple[_Bytes, NDArray[np.intp], int, int, Columns]] = [
        (block[:, _HEADER:], rows, 0, 0, {})
    ]
    while pending:
        body, rows, index, offset, done = pending.pop()
        if index == len(leaves):
            parts.append((rows, done))
            continue
        leaf = leaves[index]
        for chosen, count, start in _lengths(leaf, body, offset):
            values, end = _take(leaf, body[chosen], start, count)
            kept = {name: column[chosen] for name, column in done.items()}
            kept[leaf.name] = values
            pending.append((body[chosen], rows[chosen], index + 1, end, kept))


def _lengths(leaf: Leaf, body: _Bytes, offset: int) -> list[tuple[Any, int, int]]:
    """Yield groups of messages with equally long leaves: rows, length, offset."""
    if leaf.length is not None:
        return [(slice(None), leaf.length, offset)]
    counts, start = _take(_LENGTH, body, offset, 1)
    groups = np.unique(counts)
    if len(groups) == 1:
        return [(slice(None), int(groups[0]), start)]
    return [(np.flatnonzero(counts == group), int(group), start) for group in groups]


def _take(leaf: Leaf, body: _Bytes, offset: int, count: int) -> tuple[NDArray[Any], int]:
    """Return the leaf's values in every message and the offset behind it."""
    size = leaf.dtype.itemsize
    start = -(-offset // size) * size if count else offset
    end = start + size * count
    if end > body.shape[1]:
        raise ValueError(f"it ends before {leaf.name}")
    raw = np.ascontiguousarray(body[:, start:end])
    if leaf.is_string:
        return _strings(raw), end
    if leaf.dtype == np.bool_:
        raw = (raw != 0).view(np.uint8)
    values = raw.view(leaf.dtype) if count else np.empty((len(body), 0), leaf.dtype)
    return (values[:, 0] if leaf.is_scalar else values), end


def _strings(raw: _Bytes) -> NDArray[Any]:
    result = np.empty(len(raw), dtype=object)
    if not len(raw) or (raw == raw[0]).all():
        result[:] = _text(raw[0].tobytes()) if len(raw) else ""
        return result
    different, inverse = np.unique(raw.view(f"S{raw.shape[1]}").ravel(), return_inverse=True)
    texts = np.array([_text(bytes(text)) for text in different], dtype=object)
    result[:] = texts[inverse]
    return result


def _text(raw: bytes) -> str:
    return raw.rstrip(b"\0").decode(errors="replace")


def _merge(leaf: Leaf, parts: list[tuple[NDArray[np.intp], Columns]], total: int) -> NDArray[Any]:
    columns = [columns[leaf.name] for _, columns in parts]
    shapes = {column.shape[1:] for column in columns}
    if len(shapes) > 1:
        merged = np.empty(total, dtype=object)
        for rows, part in parts:
            for row, value in zip(rows, part[leaf.name], strict=True):
                merged[row] = value
        return merged
    dtype = np.dtype(object) if leaf.is_string else leaf.dtype.newbyteorder("=")
    shape = shapes.pop() if shapes else leaf.shape
    merged = np.empty((total, *shape), dtype=dtype)
    for rows, part in parts:
        merged[rows] = part[leaf.name]
    return merged


def _with_stamps(columns: Columns) -> Columns:
    stamps = {
        name.removesuffix(".sec"): columns[name] + columns[f"{name[:-3]}nanosec"] * 1e-9
        for name in columns
        if name.endswith(".sec") and f"{name[:-3]}nanosec" in columns
    }
    return {**columns, **stamps}
