"""Decoded messages of a bag, without ROS and without the packages that define them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from bicycle_bag.decoding import decoder
from bicycle_bag.errors import BagError
from bicycle_bag.reader import BagReader


class DecodedMessage(NamedTuple):
    """One message; `message` has the fields of its type, times are in nanoseconds."""

    topic: str
    type: str
    log_time_ns: int
    publish_time_ns: int
    message: Any


def read(
    bag: BagReader | Path | str, topics: Collection[str] | None = None
) -> Iterator[DecodedMessage]:
    """Yield a bag's messages in recorded order, decoded by the definitions in the bag.

    For long recordings of numbers, `columns.load` is some fifty times faster.

    Args:
        bag: An open bag, or the path of one.
        topics: Only these; all by default.

    Raises:
        BagError: The bag cannot be read, lacks a topic or the definition of one, or holds a
            message that is not of its type.
    """
    reader = bag if isinstance(bag, BagReader) else BagReader(bag)
    decoders: dict[str, Callable[[bytes], Any]] = {}
    for topic, type_name, log_time, publish_time, data, encoding, _ in reader.messages(topics):
        reader.check_kind(topic, type_name, encoding)
        if topic not in decoders:
            decoders[topic] = decoder(topic, type_name, reader.definition(topic))
        try:
            decoded = decoders[topic](data)
        except Exception as error:  # whatever the decoder makes of foreign bytes
            raise BagError(
                f"a message of {topic} is not a {type_name} ({error}): the bag's recorder was "
                "another version or the bag is corrupt"
            ) from None
        yield DecodedMessage(topic, type_name, log_time, publish_time, decoded)
