"""A serial line or pseudo-terminal, raw and without waiting; the standard library suffices."""

from __future__ import annotations

import errno
import os
import select
import termios
from pathlib import Path

from bicycle_common.validation import require
from bicycle_hardware.frames import Message, Splitter, encode

SPEEDS = {
    115200: termios.B115200,
    230400: termios.B230400,
    460800: termios.B460800,
    921600: termios.B921600,
}
"""Bits per second; a USB line takes no notice of them."""


class SerialLine:
    """Sends and receives messages."""

    def __init__(self, path: str | Path, speed: int = 921600) -> None:
        """Open the line.

        Raises:
            OSError: if there is no such line, or it may not be opened.
            ValueError: on a speed that is none.
        """
        known = ", ".join(map(str, SPEEDS))
        require(speed in SPEEDS, f"a serial line has no {speed} bits/s: choose one of {known}")
        self._file = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            settings = termios.tcgetattr(self._file)
        except termios.error as error:
            os.close(self._file)
            raise OSError(f"{path} is no serial line: {error.args[-1]}") from None
        settings[0] = settings[1] = settings[3] = 0
        settings[2] = termios.CS8 | termios.CREAD | termios.CLOCAL
        settings[4] = settings[5] = SPEEDS[speed]
        termios.tcsetattr(self._file, termios.TCSANOW, settings)
        termios.tcflush(self._file, termios.TCIFLUSH)
        self.splitter = Splitter()
        self.sequence = 0
        self.unsent = 0
        """Frames that the line did not take."""

    def send(self, message: Message) -> int:
        """Send a message; what the line does not take is lost, as on any wire.

        Returns:
            Its sequence.
        """
        self.sequence = (self.sequence + 1) & 0xFFFF
        frame = encode(message, self.sequence)
        try:
            if os.write(self._file, frame) != len(frame):
                self.unsent += 1
        except OSError:  # it is full, or gone, which `receive` tells
            self.unsent += 1
        return self.sequence

    def receive(self, timeout: float = 0.0) -> list[Message]:
        """Return the received messages; wait for bytes for up to `timeout`, s.

        Raises:
            OSError: if the line is gone.
        """
        if not select.select([self._file], [], [], timeout)[0]:
            return []
        try:
            data = os.read(self._file, 65536)
        except BlockingIOError:
            return []
        if not data:
            raise OSError(errno.EIO, "hung up")
        return self.splitter.feed(data)

    @property
    def file(self) -> int:
        """The descriptor, to wait for."""
        return self._file

    def close(self) -> None:
        """Close the line."""
        os.close(self._file)
