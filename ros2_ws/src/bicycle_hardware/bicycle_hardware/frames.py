"""The messages of the serial line, as `firmware/bicycle_core.h` has them; fixed sizes.

A frame is kind (u8), sequence (u16), payload and CRC-16/CCITT-FALSE of these, little-endian, then
stuffed, then a zero. Signs are REP-103: steering positive to the left, roll to the right.
"""

from __future__ import annotations

import binascii
import struct
from dataclasses import astuple, dataclass
from enum import IntEnum, IntFlag
from typing import ClassVar

from bicycle_hardware.cobs import stuff, unstuff

LONGEST = 96
"""Bytes between two zeros beyond which a frame is none."""


class Mode(IntEnum):
    """Mode of the microcontroller."""

    DISARMED = 0
    ARMED = 1
    RIDING = 2
    FALLBACK = 3
    ESTOP = 4


class Reason(IntFlag):
    """Why it refuses to be armed."""

    MOVES = 1
    UNCALIBRATED = 2
    NO_IMU = 4
    NO_STEER = 8
    NO_WHEEL = 16
    NO_COMMANDS = 32
    TOO_FAST = 64
    STOPPED = 128


WORDS = {
    Reason.MOVES: "the gyro is not at rest",
    Reason.UNCALIBRATED: "the gyro is not calibrated: let the bicycle stand still for 1 s",
    Reason.NO_IMU: "the IMU's readings are old, or always the same",
    Reason.NO_STEER: "the steer encoder's readings are old",
    Reason.NO_WHEEL: "the wheel sensor's readings are old",
    Reason.NO_COMMANDS: "commands have not come for 1 s without a gap",
    Reason.TOO_FAST: "the wheel turns",
    Reason.STOPPED: "the emergency stop is pressed",
}


def words(reasons: int) -> str:
    """Return the reasons in words; empty if there is none."""
    return ", ".join(text for reason, text in WORDS.items() if reasons & reason)


@dataclass(frozen=True)
class Actuators:
    """PC to microcontroller."""

    kind: ClassVar[int] = 1
    layout: ClassVar[str] = "<IffH"
    stamp_us: int
    """Stamp of the reading that the command answers, in the microcontroller's clock."""
    torque: float
    """N m on the steering."""
    drive: float
    """N at the rear wheel's rim."""
    valid_ms: int


@dataclass(frozen=True)
class Arm:
    """PC to microcontroller: arm, or disarm."""

    kind: ClassVar[int] = 2
    layout: ClassVar[str] = "<B"
    wanted: int


@dataclass(frozen=True)
class AskTime:
    """PC to microcontroller: a time of the PC's clock, which comes back."""

    kind: ClassVar[int] = 3
    layout: ClassVar[str] = "<Q"
    pc: int


@dataclass(frozen=True)
class Stop:
    """PC to microcontroller: as the stop button does, but for the wire."""

    kind: ClassVar[int] = 4
    layout: ClassVar[str] = "<"


@dataclass(frozen=True)
class Imu:
    """Microcontroller to PC."""

    kind: ClassVar[int] = 16
    layout: ClassVar[str] = "<Iffffff"
    stamp_us: int
    gyro_x: float
    gyro_y: float
    gyro_z: float
    force_x: float
    force_y: float
    force_z: float


@dataclass(frozen=True)
class Steer:
    """Microcontroller to PC."""

    kind: ClassVar[int] = 17
    layout: ClassVar[str] = "<Iff"
    stamp_us: int
    angle: float
    torque: float


@dataclass(frozen=True)
class Wheel:
    """Microcontroller to PC."""

    kind: ClassVar[int] = 20
    layout: ClassVar[str] = "<If"
    stamp_us: int
    speed: float


@dataclass(frozen=True)
class Period:
    """Microcontroller to PC: a control period is over, all its readings are sent; answer it."""

    kind: ClassVar[int] = 21
    layout: ClassVar[str] = "<IIBffH"
    stamp_us: int
    number: int
    """Number of the period, from 0 at the microcontroller's start."""
    mode: int
    torque: float
    """N m, applied last."""
    drive: float
    sequence: int
    """Sequence number of the last accepted command."""


@dataclass(frozen=True)
class DriverState:
    """Microcontroller to PC, 20 times a second."""

    kind: ClassVar[int] = 18
    layout: ClassVar[str] = "<IBBfffHHI"
    stamp_us: int
    mode: int
    reasons: int
    torque: float
    drive: float
    battery: float
    sequence: int
    age_ms: int
    """Time since the reading that the last command answers, ms."""
    bad_frames: int


@dataclass(frozen=True)
class TimeIs:
    """Microcontroller to PC: the answer to AskTime."""

    kind: ClassVar[int] = 19
    layout: ClassVar[str] = "<QI"
    pc: int
    stamp_us: int


Message = Actuators | Arm | AskTime | Stop | Imu | Steer | Wheel | Period | DriverState | TimeIs
KINDS: dict[int, type[Message]] = {
    kind.kind: kind
    for kind in (
        Actuators,
        Arm,
        AskTime,
        Stop,
        Imu,
        Steer,
        Wheel,
        Period,
        DriverState,
        TimeIs,
    )
}


def encode(message: Message, sequence: int) -> bytes:
    """Return the frame, with the zero that ends it."""
    head = struct.pack("<BH", message.kind, sequence & 0xFFFF)
    plain = head + struct.pack(message.layout, *astuple(message))
    return stuff(plain + struct.pack("<H", binascii.crc_hqx(plain, 0xFFFF))) + b"\0"


def decode(stuffed: bytes) -> tuple[Message, int]:
    """Return the message of a frame without its zero, and its sequence.

    Raises:
        ValueError: on a frame that was damaged or is not known.
    """
    plain = unstuff(stuffed)
    if len(plain) < 5 or binascii.crc_hqx(plain[:-2], 0xFFFF) != int.from_bytes(
        plain[-2:], "little"
    ):
        raise ValueError("its checksum is wrong")
    number, sequence = struct.unpack_from("<BH", plain)
    kind = KINDS.get(number)
    if kind is None:
        raise ValueError(f"its kind {number} is not known")
    if len(plain) != 5 + struct.calcsize(kind.layout):
        raise ValueError(f"{kind.__name__} has another size")
    return kind(*struct.unpack(kind.layout, plain[3:-2])), sequence


class Splitter:
    """Cuts a stream of bytes into frames and counts what is damaged or missing."""

    def __init__(self) -> None:
        self._rest = b""
        self.bad = 0
        """Frames that were damaged."""
        self.missing = 0
        """Frames that never came, by their sequence."""
        self._next: int | None = None

    def feed(self, data: bytes) -> list[Message]:
        """Return the messages that are complete now."""
        *whole, self._rest = (self._rest + data).split(b"\0")
        if len(self._rest) > LONGEST:
            self._rest = self._rest[:LONGEST]
        found: list[Message] = []
        for frame in whole:
            if not frame:
                continue
            try:
                message, sequence = decode(frame)
            except ValueError:
                self.bad += 1
                continue
            if self._next is not None:
                self.missing += min((sequence - self._next) & 0xFFFF, 1000)
            self._next = (sequence + 1) & 0xFFFF
            found.append(message)
        return found
