"""The microcontroller's clock beside the PC's, from questions and answers."""

from __future__ import annotations

WRAP = 2**32
SLEW = 2e-4
"""s per s by which the offset may change while one rides: clocks drift by less."""


class ClockOffset:
    """Turns the microcontroller's microseconds, which wrap after 71 minutes, into s of the PC."""

    def __init__(self) -> None:
        self._offset: float | None = None
        self._used = 0.0
        self._told: float | None = None
        self._best = float("inf")
        self._turns = 0
        self._last = 0
        self.round_trip = float("nan")
        """s of the last question."""

    def answered(self, asked: float, now: float, stamp_us: int) -> None:
        """Take an answer: asked and received at s of the PC's clock."""
        self.round_trip = now - asked
        # The quickest answers are the most exact; trust in an answer fades with its age.
        self._best *= 1.02
        if self.round_trip <= self._best or self._offset is None:
            self._best = self.round_trip
            self._offset = 0.5 * (asked + now) - self.unwrapped(stamp_us)

    def unwrapped(self, stamp_us: int) -> float:
        """Return the microcontroller's time since its start, s, for stamps in order."""
        if stamp_us < self._last - WRAP // 2:
            self._turns += 1
            self._last = stamp_us
        elif stamp_us > self._last + WRAP // 2 and self._turns > 0:
            return (stamp_us + (self._turns - 1) * WRAP) * 1e-6
        else:
            self._last = max(self._last, stamp_us)
        return (stamp_us + self._turns * WRAP) * 1e-6

    @property
    def known(self) -> bool:
        """True once there was an answer."""
        return self._offset is not None

    def follow(self, stamp_us: int, leap: bool) -> None:
        """Let the offset in use follow what the answers said, once a control period.

        Args:
            stamp_us: of the period.
            leap: True to take it over at once; False, so that stamps stay in order, slowly.
        """
        now = self.unwrapped(stamp_us)
        gone = 0.0 if self._told is None else max(0.0, now - self._told)
        self._told = now
        if self._offset is None:
            return
        most = float("inf") if leap else SLEW * gone
        self._used += min(max(self._offset - self._used, -most), most)

    def to_pc(self, stamp_us: int) -> float:
        """Convert to the PC's clock, s, with the offset that `follow` took over."""
        return self.unwrapped(stamp_us) + self._used
