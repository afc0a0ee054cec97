"""Signal handling from a program's start to its end, without tracebacks.

Imports take a second, during which Ctrl-C would print a traceback from inside some library. At
exit Python restores the default handlers before the process is gone, so that a late signal would
kill it and change its exit status. So every program starts with this module, which imports
next to nothing:

    if __name__ == "__main__":
        from bicycle_common.signals import run_module

        run_module("bicycle_sim.nodes.sim_node")

in front of its other imports, and as `functools.partial(run_module, ...)` in `programs.py`.
Whoever starts one blocks the signals meanwhile (`env --block-signal`, or `block`): what comes
before Python itself can answer waits until then.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import os
import signal
import sys
from collections.abc import Callable, Iterator
from types import FrameType
from typing import NoReturn

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that ask a program to end."""
AGAIN = 1.0
"""s after which an interrupt that had no effect strikes again."""


def on_signals(handler: Callable[[int, FrameType | None], object]) -> None:
    """Call `handler` when the program is asked to end, or its terminal is closed."""
    for number in ENDING:
        # nohup ignores SIGHUP; keep that.
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)


def block() -> None:
    """Block the signals: for a child between fork and exec, whose program unblocks them."""
    signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)


def unblock() -> None:
    """Take the signals that wait."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)


@contextlib.contextmanager
def blocked() -> Iterator[None]:
    """Start here, in any thread, a child that calls `unblock` when it can answer signals."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    yield
    signal.pthread_sigmask(signal.SIG_SETMASK, before)


def run_module(name: str) -> NoReturn:
    """Import a module and run its `main`, which takes nothing and returns an exit status.

    A signal ends the program quietly, with 128 + its number, until `main` answers signals itself.
    There SIGINT raises KeyboardInterrupt; a second SIGINT ends the program at once. When `main` is
    over, its status stands, whatever comes.
    """
    on_signals(_leave)
    unblock()
    _check_shared_memory(name)
    main = importlib.import_module(name).main
    try:
        signal.signal(signal.SIGINT, _interrupt)
        status = _status_of(main)
        for number in (*ENDING, signal.SIGALRM):
            signal.signal(number, signal.SIG_IGN)
    except KeyboardInterrupt:
        _leave(signal.SIGINT)
    if signal.getitimer(signal.ITIMER_REAL)[0]:  # interrupted
        atexit._run_exitfuncs()
        # Python kills itself at its end where the exception struck in an exec of a dataclass, say.
        _end(status if isinstance(status, int) else bool(status))
    sys.exit(status)


@contextlib.contextmanager
def importing() -> Iterator[None]:
    """Import here what `main` needs: SIGINT ends the program, as no library expects it then."""
    mine = signal.getsignal(signal.SIGINT) is _interrupt
    if mine:
        signal.signal(signal.SIGINT, _leave)
    yield
    if mine:
        signal.signal(signal.SIGINT, _interrupt)


def _check_shared_memory(name: str) -> None:
    """End a program that would load ROS where that would kill it."""
    from bicycle_common import shared_memory

    if ".nodes." in name and (reason := shared_memory.refusal()):
        print(f"{name.rpartition('.')[2]}: {reason}", file=sys.stderr)
        sys.exit(1)


def _status_of(main: Callable[[], int | None]) -> str | int | None:
    try:
        return main()
    except SystemExit as leaving:
        return leaving.code


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    """Raise what `main` may catch, again and again: C code, such as hasattr's, may swallow it."""
    if number == signal.SIGINT:
        signal.signal(signal.SIGINT, _leave)
        signal.signal(signal.SIGALRM, _interrupt)
        signal.setitimer(signal.ITIMER_REAL, AGAIN, AGAIN)
    raise KeyboardInterrupt


def _leave(number: int, frame: FrameType | None = None) -> NoReturn:
    """End the program without a word."""
    _end(128 + number)


def _end(status: int) -> NoReturn:
    """End the process without Python's and C++'s long farewell."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            stream.flush()
    os._exit(status)
