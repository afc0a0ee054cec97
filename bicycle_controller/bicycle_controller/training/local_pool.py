"""Runs of a sweep on this machine's processors, each in a process of its own."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from multiprocessing import connection
from typing import Any

from bicycle_common.processes import begin_spawned, joined_or_killed
from bicycle_common.signals import blocked

RETRIES = 3
"""New starts of a run whose process was killed, for example by a lack of memory."""


@dataclass
class Task:
    """One call in a process of its own.

    Attributes:
        name: for messages.
        work: function that is called there; importable by its name.
        arguments: its arguments, which can be pickled.
        processors: that it uses.
        deaths: processes of this task that were killed.
    """

    name: str
    work: Callable[..., Any]
    arguments: tuple[Any, ...]
    processors: int = 1
    deaths: int = 0


class LostTaskError(RuntimeError):
    """A task whose process died again and again, or whose function raised; says why."""


@dataclass
class LocalPool:
    """Processes for at most so many processors' worth of tasks at a time.

    Attributes:
        processors: to be used; by default those that this process may use.
    """

    processors: int = field(default_factory=lambda: len(os.sched_getaffinity(0)))
    _waiting: list[Task] = field(default_factory=list, init=False)
    _running: dict[Any, tuple[Task, Any]] = field(default_factory=dict, init=False)

    def add(self, task: Task) -> None:
        """Queue a task; it starts in `done` as soon as processors are free."""
        self._waiting.append(task)

    def done(self, timeout: float) -> Iterator[tuple[Task, Any]]:
        """Start what can start, wait for a while and give the tasks that have ended.

        Args:
            timeout: s.

        Returns:
            Each with its result, or with a `LostTaskError`.
        """
        while self._waiting and self._fits(self._waiting[0]):
            self._start(self._waiting.pop(0))
        for pipe in connection.wait(list(self._running), timeout):
            assert isinstance(pipe, connection.Connection)
            task, process = self._running.pop(pipe)
            try:
                found = pipe.recv()
            except EOFError:
                process.join()
                task.deaths += 1
                if process.exitcode < 0 and task.deaths <= RETRIES:
                    self._waiting.insert(0, task)
                    continue
                found = LostTaskError(f"{task.name}: {_ending(process.exitcode)}")
            process.join()
            yield task, found

    @property
    def left(self) -> bool:
        """True while a task waits or runs."""
        return bool(self._waiting or self._running)

    def stop(self, patience: float) -> None:
        """Ask every process to save and end; kill those that have not within `patience` s."""
        self._waiting.clear()
        for _, process in self._running.values():
            process.terminate()
        deadline = time.monotonic() + patience
        for pipe, (_, process) in self._running.items():
            # A process cannot end while its result fills the pipe, so the result is read first.
            if pipe.poll(max(0.0, deadline - time.monotonic())):
                with contextlib.suppress(EOFError):
                    pipe.recv()
            joined_or_killed(process, deadline - time.monotonic())
        self._running.clear()

    def _fits(self, task: Task) -> bool:
        used = sum(running.processors for running, _ in self._running.values())
        return not self._running or used + task.processors <= self.processors

    def _start(self, task: Task) -> None:
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe(duplex=False)
        process = context.Process(target=_run, args=(task, there), name=task.name, daemon=True)
        with blocked():  # until `begin_spawned`
            process.start()
        there.close()
        self._running[here] = task, process


def _ending(status: int) -> str:
    if status < 0:
        return f"its process was killed by {signal.Signals(-status).name} {RETRIES + 1} times"
    return f"its process ended with status {status}"


def _run(task: Task, pipe: Any) -> None:
    """Do a task's work and send its result; runs in the task's process."""
    # If the sweep is killed, this process ends too: its checkpoint keeps the work, and a process
    # that went on would keep the run's folder locked.
    begin_spawned(signal.SIGKILL)
    os.environ.setdefault("OMP_NUM_THREADS", str(task.processors))
    try:
        found = task.work(*task.arguments)
    except Exception as error:  # whatever it is, the sweep tells it and goes on
        found = LostTaskError(f"{task.name}: {type(error).__name__}: {error}")
    pipe.send(found)
    pipe.close()
    os._exit(0)  # all is sent; torch takes a second to shut down by itself
