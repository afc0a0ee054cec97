"""Decoders of messages, from the definitions that a bag carries."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mcap.exceptions import McapError
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from bicycle_bag.errors import BagError
from bicycle_bag.own_types import check_definition


def decoder(topic: str, type_name: str, definition: str) -> Callable[[bytes], Any]:
    """Return the decoder of a topic's messages in CDR.

    Args:
        topic: Its name, for the error.
        type_name: As pkg/msg/Type.
        definition: In the bag.

    Raises:
        BagError: The definition is of no use, or lacks fields of this project's type.
    """
    check_definition(topic, type_name, definition)
    schema = Schema(id=1, data=definition.encode(), encoding="ros2msg", name=type_name)
    try:
        decode = DecoderFactory().decoder_for("cdr", schema) if definition else None
    except (McapError, ValueError, KeyError):
        decode = None
    if decode is None:
        raise BagError(
            f"the bag has no usable definition of {type_name} for {topic}: record it again with "
            "the workspace sourced that defines it"
        )
    return decode
