"""The firmware's portable core as a process of this machine, on a pseudo-terminal.

It is a program of its own, built by the host's C compiler from the same sources that go on a
board; `firmware/board_host.c` is its board layer.
"""

from __future__ import annotations

import subprocess
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

from bicycle_common.native_library import compiled
from bicycle_hardware.frames import Mode

SOURCES = ("bicycle_core.c", "board_host.c", "bicycle_core.h")
FLAGS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic")


def build() -> Path:
    """Compile the simulated board, once for each version of its sources; return the program.

    Raises:
        OSError: if there is no C compiler or it fails, in one line.
    """
    place = resources.files("bicycle_hardware") / "firmware"
    sources = {name: place.joinpath(name).read_bytes() for name in SOURCES}
    try:
        return compiled(sources, FLAGS, ("-lm",))
    except FileNotFoundError:
        raise OSError("the simulated board needs a C compiler: apt install gcc") from None
    except subprocess.TimeoutExpired as error:
        raise OSError(f"the simulated board cannot be compiled: {error}") from None


@dataclass
class BoardInputs:
    """Readings of the board's sensors; REP-103 signs."""

    imu_us: int = 0
    steer_us: int = 0
    wheel_us: int = 0
    gyro: tuple[float, float, float] = (0.0, 0.0, 0.0)
    force: tuple[float, float, float] = (0.0, 0.0, 9.81)
    steer: float = 0.0
    wheel: float = 0.0
    battery: float = 24.0
    stopped: bool = False


@dataclass
class BoardOutputs:
    """Outputs of the board to its motors."""

    torque: float = 0.0
    drive: float = 0.0
    mode: Mode = Mode.DISARMED
    reasons: int = 0


@dataclass(frozen=True)
class BoardHeard:
    """Commands and questions that came to the board over its serial line."""

    stamp_us: int
    """Stamp that the last command answers; 0 before the first."""
    asked: int
    """Number of questions for its time."""
    ages_us: tuple[int, ...]
    """us by a real clock from the end of a period to the arrival of the command that answers it,
    for each command taken since the last answer; 64 at most."""


@dataclass
class SimulatedBoard:
    """The process."""

    program: Path
    link: Path | None = None
    """Becomes a link to the pseudo-terminal; None makes none."""
    path: str = ""
    """Path of the pseudo-terminal."""
    _process: subprocess.Popen[str] = field(init=False)

    def __post_init__(self) -> None:
        self._process = subprocess.Popen(
            [str(self.program), *([str(self.link)] if self.link else [])],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # a terminal's Ctrl-C is for those who talk with it
        )
        assert self._process.stdout is not None
        self.path = self._process.stdout.readline().strip()
        if not self.path:
            raise OSError("the simulated board ended at its start")

    @property
    def pid(self) -> int:
        """Id of the process."""
        return self._process.pid

    def tick(self, now_us: int, inputs: BoardInputs) -> BoardOutputs:
        """Run one period of the board at a time of its clock.

        Raises:
            OSError: if the process has ended.
        """
        self.begin_tick(now_us, inputs)
        return self.end_tick()

    def begin_tick(self, now_us: int, inputs: BoardInputs) -> None:
        """Let it run one period meanwhile: several boards do so beside each other.

        Raises:
            OSError: if the process has ended.
        """
        i = inputs
        numbers = (*i.gyro, *i.force, i.steer, i.wheel, i.battery)
        stamps = (now_us, i.imu_us, i.steer_us, i.wheel_us)
        line = " ".join(str(value & 0xFFFFFFFF) for value in stamps)
        line += " " + " ".join(f"{value:.9g}" for value in numbers) + f" {int(i.stopped)}\n"
        self._tell(line)

    def end_tick(self) -> BoardOutputs:
        """Return the outputs of the period that `begin_tick` began.

        Raises:
            OSError: if the process has ended.
        """
        answer = self._answer().split()
        if len(answer) != 4:
            raise OSError("the simulated board has ended")
        torque, drive, mode, reasons = answer
        return BoardOutputs(float(torque), float(drive), Mode(int(mode)), int(reasons))

    def wait(self, stamp_us: int, asked: int, milliseconds: int) -> BoardHeard:
        """Let it listen, without a tick; return what it has heard.

        Args:
            stamp_us: until a command came that answers this stamp,
            asked: or until it was asked for its time more often than this,
            milliseconds: or for so long.

        Raises:
            OSError: if the process has ended.
        """
        answer = self._asked(f"wait {stamp_us & 0xFFFFFFFF} {asked} {milliseconds}\n").split()
        if len(answer) < 2:
            raise OSError("the simulated board has ended")
        stamp, now_asked, *ages = (int(word) for word in answer)
        return BoardHeard(stamp, now_asked, tuple(ages))

    def restart(self) -> None:
        """Switch its power off and on.

        Raises:
            OSError: if the process has ended.
        """
        self._asked("restart\n")

    def _asked(self, line: str) -> str:
        self._tell(line)
        return self._answer()

    def _answer(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline()

    def _tell(self, line: str) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(line)
            self._process.stdin.flush()
        except BrokenPipeError:
            raise OSError("the simulated board has ended") from None

    def close(self) -> None:
        """End the process."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()
