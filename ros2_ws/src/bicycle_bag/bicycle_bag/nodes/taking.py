"""Taking messages with the publisher of each, of which rclpy tells nothing."""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

from bicycle_bag.errors import BagError

_UNNUMBERED = 2**64 - 1
_OK, _NOTHING = 0, 401
"""`RCL_RET_OK` and `RCL_RET_SUBSCRIPTION_TAKE_FAILED`."""


class Taken(NamedTuple):
    """A message and what the middleware says of it."""

    data: bytes
    received_ns: int
    """Time on this host's clock."""
    sent_ns: int
    """Time on the publisher's clock."""
    number: int | None
    """Number that the publisher gave it, from 1; None from a middleware that has none."""
    publisher: bytes
    """Id of the publisher, as discovery tells it; the same when it is met again."""


class _Allocator(ctypes.Structure):
    """`rcutils_allocator_t`."""

    _fields_ = [
        (name, ctypes.c_void_p)
        for name in ("allocate", "deallocate", "reallocate", "zero_allocate", "state")
    ]


class _Bytes(ctypes.Structure):
    """`rcutils_uint8_array_t`, which is `rcl_serialized_message_t`."""

    _fields_ = [
        ("buffer", ctypes.c_void_p),
        ("length", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
        ("allocator", _Allocator),
    ]


class _Info(ctypes.Structure):
    """`rmw_message_info_t`, with room for a longer one."""

    _fields_ = [
        ("sent", ctypes.c_int64),
        ("received", ctypes.c_int64),
        ("number", ctypes.c_uint64),
        ("received_number", ctypes.c_uint64),
        ("implementation", ctypes.c_void_p),
        ("publisher", ctypes.c_uint8 * 16),
        ("rest", ctypes.c_uint8 * 64),
    ]


class Taker:
    """Takes serialized messages out of subscriptions, all into one buffer."""

    def __init__(self) -> None:
        utils = ctypes.CDLL("librcutils.so")
        utils.rcutils_get_default_allocator.restype = _Allocator
        self._take = ctypes.CDLL("librcl.so").rcl_take_serialized_message
        self._take.argtypes = [ctypes.c_void_p] * 4
        self._message, self._info = _Bytes(), _Info()
        allocator = utils.rcutils_get_default_allocator()
        size = ctypes.c_size_t(0)
        utils.rcutils_uint8_array_init(ctypes.byref(self._message), size, ctypes.byref(allocator))
        self._at = ctypes.addressof(self._message), ctypes.addressof(self._info)

    def take(self, handle: Any) -> Taken | None:
        """Return the next message of a subscription's handle, entered by the caller; None if none.

        Raises:
            BagError: The middleware failed.
        """
        message, info = self._message, self._info
        result = self._take(handle.pointer, *self._at, None)
        if result == _NOTHING:
            return None
        if result != _OK:
            raise BagError(f"ROS cannot take a message (error {result}): start again")
        return Taken(
            ctypes.string_at(message.buffer, message.length),
            info.received,
            info.sent,
            None if info.number == _UNNUMBERED else info.number,
            bytes(info.publisher),
        )
