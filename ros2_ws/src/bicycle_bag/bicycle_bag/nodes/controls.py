"""Control of a running replay: keys of the terminal and services, as in ros2 bag play."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from bicycle_bag.tempo import FASTER, Tempo

KEYS = "Space pauses and goes on, → plays the next message, ↑ and ↓ change the speed"
PAUSE_FIRST = "plays: pause it first"
"""Answer of what needs a paused replay."""
UP, DOWN, RIGHT = b"\x1b[A", b"\x1b[B", b"\x1b[C"


class Controls:
    """Serves a replay's services and reads its keys.

    Args:
        node: the replay's node.
        tempo: the clock that it goes by.
        keyboard: True to read keys.
        tell: takes one line for a person.
    """

    def __init__(
        self, node: Node, tempo: Tempo, keyboard: bool, tell: Callable[[str], None]
    ) -> None:
        self._tempo = tempo
        self._tell = tell
        self._keyboard = keyboard
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        services = {
            "pause": self._pause,
            "resume": self._resume,
            "toggle_paused": self._toggle,
            "play_next": self._next,
        }
        for name, act in services.items():
            node.create_service(Trigger, f"~/{name}", _answering(act))

    @contextlib.contextmanager
    def reading(self) -> Iterator[None]:
        """Read keys one by one for as long as the context lasts, where there is a terminal."""
        if not self._keyboard or not _owns_terminal():
            self._keyboard = False
            yield
            return
        file = sys.stdin.fileno()
        before = termios.tcgetattr(file)
        tty.setcbreak(file)
        self._tell(KEYS)
        try:
            yield
        finally:
            termios.tcsetattr(file, termios.TCSADRAIN, before)

    def serve(self) -> None:
        """Execute the requests that have arrived."""
        self._executor.spin_once(timeout_sec=0.0)
        if self._keyboard:
            self._read_keys()

    def close(self) -> None:
        """Stop serving."""
        self._executor.shutdown()

    def _read_keys(self) -> None:
        file = sys.stdin.fileno()
        if not select.select([file], [], [], 0.0)[0]:
            return
        pressed = os.read(file, 64)
        if not pressed:  # the terminal is gone
            self._keyboard = False
        for key, act in (
            (b" ", self._toggle),
            (RIGHT, self._next),
            (UP, lambda: self._faster(FASTER)),
            (DOWN, lambda: self._faster(1.0 / FASTER)),
        ):
            for _ in range(pressed.count(key)):
                self._tell(act())

    def _pause(self) -> str:
        self._tempo.pause()
        return "paused"

    def _resume(self) -> str:
        self._tempo.resume()
        return "goes on"

    def _toggle(self) -> str:
        self._tempo.toggle()
        return "paused" if self._tempo.paused else "goes on"

    def _next(self) -> str:
        return "the next message is played" if self._tempo.step() else PAUSE_FIRST

    def _faster(self, factor: float) -> str:
        return f"{self._tempo.speed_up(factor):.2f} times the speed of the start"


def _answering(
    act: Callable[[], str],
) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
    def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = act()
        response.success = response.message != PAUSE_FIRST
        return response

    return answer


def _owns_terminal() -> bool:
    """Return True if pressed keys are meant for this process."""
    try:
        file = sys.stdin.fileno()
        return os.isatty(file) and os.tcgetpgrp(file) == os.getpgrp()
    except (OSError, ValueError, AttributeError):
        return False
