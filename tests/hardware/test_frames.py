"""Frames of the serial line."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from busy_machine import UNHURRIED
from hypothesis import given, settings
from hypothesis import strategies as st

from bicycle_hardware.clock_offset import ClockOffset
from bicycle_hardware.cobs import stuff, unstuff
from bicycle_hardware.frames import KINDS, Actuators, DriverState, Splitter, decode, encode


def test_published_examples_of_the_stuffing() -> None:
    for plain, stuffed in (
        ("00", "0101"),
        ("0000", "010101"),
        ("001100", "01021101"),
        ("11220033", "0311220233"),
        ("11223344", "0511223344"),
        ("11000000", "0211010101"),
    ):
        assert stuff(bytes.fromhex(plain)) == bytes.fromhex(stuffed)


@settings(UNHURRIED, max_examples=200)
@given(st.binary(max_size=600))
def test_stuffing_goes_back_and_forth_without_a_zero(plain: bytes) -> None:
    stuffed = stuff(plain)
    assert 0 not in stuffed
    assert unstuff(stuffed) == plain


def test_stuffing_is_that_of_the_kept_library() -> None:
    """`pip install cobs`: no wheel of it for Linux, so set-up does not bring it."""
    cobs = pytest.importorskip("cobs.cobs")
    random = np.random.default_rng(0)
    for _ in range(20_000):
        share = random.random()
        values = random.integers(1, 256, random.integers(0, 97))  # no frame is longer
        plain = bytes(np.where(random.random(len(values)) < share, 0, values).tolist())
        stuffed = stuff(plain)
        assert stuffed == cobs.encode(plain)
        assert unstuff(stuffed) == cobs.decode(stuffed) == plain


def test_message_goes_back_and_forth() -> None:
    message = DriverState(5, 2, 129, 0.5, -1.0, 24.0, 65535, 7, 3)
    frame = encode(message, 70000)
    assert decode(frame[:-1]) == (message, 70000 & 0xFFFF)


def test_any_flipped_bit_is_found() -> None:
    frame = encode(Actuators(1, 2.0, 3.0, 4), 5)
    for index in range(len(frame) - 1):
        for bit in range(8):
            bad = bytearray(frame[:-1])
            bad[index] ^= 1 << bit
            with pytest.raises(ValueError, match=r"."):
                decode(bytes(bad))


def test_splitter_takes_any_portions_and_counts_losses() -> None:
    frames = [encode(Actuators(n, 0.0, 0.0, 0), n) for n in range(20)]
    stream = b"".join(frames[:5] + frames[7:]) + b"\x05rubbish\0"
    found, splitter = [], Splitter()
    rng = np.random.default_rng(0)
    while stream:
        size = int(rng.integers(1, 9))
        found += splitter.feed(stream[:size])
        stream = stream[size:]
    assert [message.stamp_us for message in found] == [*range(5), *range(7, 20)]  # type: ignore[union-attr]
    assert (splitter.missing, splitter.bad) == (2, 1)


def test_the_page_has_every_kind_with_its_size() -> None:
    page = (Path(__file__).parents[2] / "docs" / "wire.md").read_text()
    for number, kind in KINDS.items():
        assert f"| {number} | `{kind.__name__}` | {struct.calcsize(kind.layout)} |" in page


def test_clock_is_known_from_the_quickest_answer_and_wraps() -> None:
    clock = ClockOffset()
    assert not clock.known
    clock.answered(asked=100.0, now=100.002, stamp_us=2**32 - 500_000)
    clock.answered(asked=100.1, now=100.2, stamp_us=2**32 - 350_000)
    clock.follow(2**32 - 500_000, leap=True)
    assert clock.to_pc(2**32 - 500_000) == pytest.approx(100.001)
    assert clock.to_pc(500_000) == pytest.approx(101.001)


def test_clock_is_followed_slowly_while_one_rides() -> None:
    clock = ClockOffset()
    clock.answered(asked=10.0, now=10.0, stamp_us=1_000_000)
    clock.follow(1_000_000, leap=True)
    clock.answered(asked=11.5, now=11.5, stamp_us=2_000_000)
    clock.follow(2_000_000, leap=False)
    assert clock.to_pc(2_000_000) == pytest.approx(11.0002, abs=1e-6)
    clock.follow(3_000_000, leap=True)
    assert clock.to_pc(3_000_000) == pytest.approx(12.5)
