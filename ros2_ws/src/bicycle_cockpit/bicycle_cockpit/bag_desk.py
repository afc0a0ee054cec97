"""Asks the process that reads bags, one thing at a time, and ends it where it takes too long."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, NamedTuple

from bicycle_cockpit.shelf import Signature, signature

WORKER = (sys.executable, "-m", "bicycle_cockpit.bag_worker")
"""Command of the worker process, without the folder of the bags."""
ENTRY_TIME = 10.0
"""s for one bag of the list, which needs its index only."""
LIST_TIME = 60.0
"""s for the whole list."""
LOAD_TIME = 60.0
"""s for one bag."""
START_TIME = 30.0
"""s for the process to come up."""
MOST_WAITING = 8
"""Requests that wait for the process; more are sent away."""
IDLE = 300.0
"""s without a request after which the process is ended, and its memory is free."""
LONGEST_LINE = 1024 * 1024
"""Bytes of one answer but for the bag itself."""


class BagProblemError(Exception):
    """A bag cannot be shown; the text is one line for the page."""

    def __init__(self, status: int, text: str) -> None:
        super().__init__(text)
        self.status = status
        """HTTP status."""


class Loaded(NamedTuple):
    """A bag for the page."""

    body: bytes
    """JSON, compressed with gzip."""
    colours: list[str]
    """Keys in the palette of the policies that rode."""


class BagDesk:
    """The bags of one folder, read by a process of its own; belongs to one event loop."""

    def __init__(self, folder: Path) -> None:
        """Read from `folder`; the process is started with the first request."""
        self._folder = folder
        self._process: asyncio.subprocess.Process | None = None
        self._turn = asyncio.Lock()
        self._waiting = 0
        self._too_slow: dict[str, tuple[Signature, str]] = {}
        self._idle: asyncio.TimerHandle | None = None

    async def listed(self) -> list[dict[str, Any]]:
        """Return the bags, the newest first; see `shelf.entry`.

        Raises:
            BagProblemError: when too many wait.
        """
        async with self._asking():
            end = asyncio.get_running_loop().time() + LIST_TIME
            while True:
                self._look_again()
                found, stuck = await self._list_once(end)
                if stuck:
                    self._give_up(stuck, "takes too long to look into")
                if not stuck or asyncio.get_running_loop().time() > end:
                    slow = [{"name": n, "problem": why} for n, (_, why) in self._too_slow.items()]
                    return found + slow

    async def load(self, name: str, rider: str = "", title: str = "") -> Loaded:
        """Return a bag.

        Args:
            name: the bag's name.
            rider: controller that rides it again, see `same_ride`; empty for the ride itself.
            title: displayed name of that controller.

        Raises:
            BagProblemError: there is no such bag, it cannot be shown, it takes too long, or too
                many wait.
        """
        async with self._asking():
            self._look_again()
            if name in self._too_slow:
                raise BagProblemError(422, self._too_slow[name][1])
            try:
                wanted = {"do": "load", "name": name, "rider": rider, "title": title}
                answer = await self._ask(wanted, LOAD_TIME)
                if "size" in answer:
                    return Loaded(await self._bytes(int(answer["size"])), answer["colours"])
            except (asyncio.TimeoutError, EOFError, ValueError) as error:
                await self._end()
                slow = isinstance(error, asyncio.TimeoutError)
                why = f"takes longer than {LOAD_TIME:g} s to read" if slow else "cannot be read"
                raise BagProblemError(422, self._give_up(name, why)) from None
        if "problem" in answer:
            raise BagProblemError(422, str(answer["problem"]))
        raise BagProblemError(404, f"there is no bag {name[:80]!r} in the folder")

    async def close(self) -> None:
        """End the process."""
        if self._idle is not None:
            self._idle.cancel()
        await self._end()

    @contextlib.asynccontextmanager
    async def _asking(self) -> AsyncIterator[None]:
        """Wait for a turn to ask the worker."""
        if self._waiting >= MOST_WAITING:
            raise BagProblemError(503, "too many bags are being read: try again in a moment")
        self._waiting += 1
        try:
            async with self._turn:
                if self._idle is not None:
                    self._idle.cancel()
                try:
                    yield
                except asyncio.CancelledError:
                    self._kill()  # its answer would be taken for the next one's
                    self._process = None
                    raise
                loop = asyncio.get_running_loop()
                self._idle = loop.call_later(IDLE, self._kill)
        finally:
            self._waiting -= 1

    def _look_again(self) -> None:
        """Retry bags that took too long and have changed since."""
        for name, (was, _) in list(self._too_slow.items()):
            if signature(self._folder / name) != was:
                del self._too_slow[name]

    def _give_up(self, name: str, why: str) -> str:
        """Do not try it again as long as it is the same; returns the line that says so."""
        line = f"{name[:80]} {why}"
        self._too_slow[name] = (signature(self._folder / name), line)
        return line

    async def _list_once(self, end: float) -> tuple[list[dict[str, Any]], str]:
        """Return the bags that could be looked into, and the name of the one that took too long.

        Args:
            end: of all patience, on the loop's clock.
        """
        found: list[dict[str, Any]] = []
        reading = ""
        try:
            answer = await self._ask({"do": "list", "skip": list(self._too_slow)}, ENTRY_TIME)
            while "done" not in answer:
                reading = answer.get("reading", "")
                if "entry" in answer:
                    found.append(answer["entry"])
                left = end - asyncio.get_running_loop().time()
                answer = await self._answer(max(0.0, min(ENTRY_TIME, left)))
        except (asyncio.TimeoutError, EOFError, ValueError):
            await self._end()
            if not reading:
                raise BagProblemError(503, "the bags could not be looked through") from None
            return found, reading
        return found, ""

    async def _ask(self, request: dict[str, Any], patience: float) -> dict[str, Any]:
        """Return the first line of an answer.

        Raises:
            TimeoutError, EOFError, ValueError: it took too long, the process ended, or said
                something else.
        """
        process = self._process
        fresh = process is None or process.returncode is not None
        if process is None or process.returncode is not None:
            process = self._process = await asyncio.create_subprocess_exec(
                *WORKER,
                str(self._folder),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.DEVNULL,
                limit=LONGEST_LINE,
                start_new_session=True,
            )
        assert process.stdin is not None
        with contextlib.suppress(ConnectionError):
            process.stdin.write(json.dumps(request).encode() + b"\n")
            await process.stdin.drain()
        return await self._answer(patience + (START_TIME if fresh else 0.0))

    async def _answer(self, patience: float) -> dict[str, Any]:
        process = self._process
        assert process is not None
        assert process.stdout is not None
        line = await asyncio.wait_for(process.stdout.readline(), patience)
        if not line:
            raise EOFError
        answer = json.loads(line)
        if not isinstance(answer, dict):
            raise ValueError
        return answer

    async def _bytes(self, size: int) -> bytes:
        process = self._process
        assert process is not None
        assert process.stdout is not None
        return await asyncio.wait_for(process.stdout.readexactly(size), LOAD_TIME)

    def _kill(self) -> None:
        if self._process is not None and self._process.returncode is None:
            self._process.kill()

    async def _end(self) -> None:
        """End the process; the next request starts another."""
        self._kill()
        if self._process is not None:
            await self._process.wait()
        self._process = None
