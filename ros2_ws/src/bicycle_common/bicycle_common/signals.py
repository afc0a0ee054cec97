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
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType, TracebackType
from typing import Any, NoReturn

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that ask a program to end."""
AGAIN = 1.0
"""Time after which an interrupt without effect is repeated (s)."""
LOOK = 0.05
"""Longest delay until `StopRequest.wait` notices a signal (s)."""


class InterruptError(Exception):
    """Raised inside `StopRequest.at_once` when a signal comes."""


class StopRequest:
    """Flag that the first signal that asks the program to end sets.

    A program that ends in its own time calls `listen` once: from then on no signal ends it. A
    piece of work uses it as a context: the first signal asks for its end, and a second one acts
    as if nothing caught it. Only the main thread can catch signals; in another a context does
    nothing.

    Attributes:
        signal: number of the first signal; 0 until then.
        interrupts: number of SIGINTs so far; may be reset to 0 to count those after a message.
    """

    def __init__(self) -> None:
        self.signal = self.interrupts = 0
        self._raises = False
        self._old: dict[int, Any] = {}

    @property
    def requested(self) -> bool:
        """True if a signal has come."""
        return self.signal != 0

    def listen(self) -> StopRequest:
        """Catch all signals from now on; return itself."""
        _on_signals(self._take)
        return self

    def __enter__(self) -> StopRequest:
        if threading.current_thread() is threading.main_thread():
            self._old = _on_signals(self._take)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._restore()

    @contextlib.contextmanager
    def at_once(self) -> Iterator[None]:
        """Let a signal raise `InterruptError` in this context instead of waiting for a check.

        Raises:
            InterruptError: if a signal comes, or has come.
        """
        self._raises = True
        try:
            if self.requested:
                raise InterruptError
            yield
        finally:
            self._raises = False

    def wait(self, seconds: float) -> bool:
        """Wait until a signal comes or the time is over; return True if a signal has come."""
        # No Event: its lock could be held by the very code that the signal's handler interrupts.
        until = time.monotonic() + seconds
        while not self.requested and (left := until - time.monotonic()) > 0.0:
            time.sleep(min(left, LOOK))
        return self.requested

    def _take(self, number: int, frame: FrameType | None) -> None:
        self.signal = self.signal or number
        self.interrupts += number == signal.SIGINT
        self._restore()
        if self._raises:
            raise InterruptError

    def _restore(self) -> None:
        for number, old in self._old.items():
            signal.signal(number, old)
        self._old = {}


def _on_signals(handler: Callable[[int, FrameType | None], object]) -> dict[int, Any]:
    """Call `handler` when the program is asked to end, or its terminal is closed.

    Returns:
        The former handlers, by the signal's number.
    """
    # nohup ignores SIGHUP; keep that.
    ignored = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    numbers = [number for number in ENDING if not (number == signal.SIGHUP and ignored)]
    return {number: signal.signal(number, handler) for number in numbers}


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
    _on_signals(_leave)
    unblock()
    _check_shared_memory(name)
    _check_progress_settings(name)
    main = importlib.import_module(name).main
    try:
        signal.signal(signal.SIGINT, _interrupt)
        status, error = _status_of(main)
        for number in (*ENDING, signal.SIGALRM):
            signal.signal(number, signal.SIG_IGN)
    except KeyboardInterrupt:
        _leave(signal.SIGINT)
    if signal.getitimer(signal.ITIMER_REAL)[0]:  # interrupted
        atexit._run_exitfuncs()
        # Python kills itself at its end where the exception struck in an exec of a dataclass, say.
        _end(status if isinstance(status, int) else bool(status))
    sys.exit(_after_output(status, error, name.rpartition(".")[2]))


@contextlib.contextmanager
def importing() -> Iterator[None]:
    """Import the modules of `main` here: SIGINT ends the program, as no library expects it."""
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


def _check_progress_settings(name: str) -> None:
    """Set aside the settings with which the progress bar cannot even be imported."""
    from bicycle_common import progress_settings

    if said := progress_settings.set_aside():
        with contextlib.suppress(OSError, AttributeError):  # standard error is closed
            print(f"{name.rpartition('.')[2]}: {said}", file=sys.stderr)


def _status_of(main: Callable[[], int | None]) -> tuple[str | int | None, OSError | None]:
    """Return the status of `main`, and the error that ended it if its output failed."""
    try:
        return main(), None
    except SystemExit as leaving:
        return leaving.code, None
    except OSError:
        error = _output_error(probe=True)
        if error is None:
            raise
        return 0, error


def _output_error(probe: bool) -> OSError | None:
    """Return why standard output takes nothing more; None if it does, or is closed.

    With PYTHONUNBUFFERED nothing is left to flush after a failed print: a probe writes an empty
    line to find out. Without it, only the flush fails.
    """
    if sys.stdout is None:
        return None
    try:
        sys.stdout.flush()
        if probe:
            os.write(sys.stdout.fileno(), b"\n")
    except OSError as error:
        return error
    return None


def _after_output(
    status: str | int | None, error: OSError | None, program: str
) -> str | int | None:
    """Return the status of a program once its output is written, which Python does too late.

    A reader that leaves, such as head, has what it wanted; a full disk makes a failure of success.
    """
    error = error or _output_error(probe=False)
    if error is None:
        return status
    # Python's own flush at its end finds the rest of the output: let that go nowhere.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if status or isinstance(error, BrokenPipeError):  # else the reason has been told
        return status
    print(f"{program}: cannot write the output ({error.strerror})", file=sys.stderr)
    return 1


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    """Raise KeyboardInterrupt repeatedly, because C code, such as hasattr's, may swallow it."""
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
