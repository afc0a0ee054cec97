"""The cockpit as a process, and a page of it without a browser."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import aiohttp
from node_process import NodeProcess
from waiting import PATIENCE

from bicycle_cockpit.page_socket import MESSAGE_RATE

COCKPIT = Path(__file__).resolve().parents[2] / "ros2_ws" / "cockpit.sh"


def address_of(cockpit: NodeProcess, timeout: float = PATIENCE) -> str:
    """Return the address that it prints for the browser."""
    return cockpit.wait_for_line(r"cockpit: (http://\S+)", timeout)[1]


class Page:
    """Keeps everything that a page hears; asks and waits for the answer."""

    def __init__(self, address: str) -> None:
        self.address = address.rstrip("/")
        self.heard: list[dict[str, Any]] = []
        self.rows: list[dict[str, Any]] = []
        self._columns: list[str] = []
        self._loop = asyncio.new_event_loop()
        self._socket: aiohttp.ClientWebSocketResponse | None = None
        self._number = 0
        self._asked = 0.0
        self._thread = threading.Thread(target=self._loop.run_until_complete, args=(self._run(),))
        self._thread.start()
        self.until(lambda: self._columns)

    async def _run(self) -> None:
        async with aiohttp.ClientSession() as session:
            url = f"{self.address}/ws"
            self._socket = await session.ws_connect(url, origin=self.address, max_msg_size=0)
            async for message in self._socket:
                self._take(json.loads(message.data))

    def _take(self, message: dict[str, Any]) -> None:
        if message["type"] == "hello":
            self._columns = message["columns"]
        rows = [dict(zip(self._columns, row, strict=True)) for row in message.get("rows", ())]
        at = 0 if message["type"] == "history" else len(self.rows)
        self.rows[at:at] = rows
        self.heard.append(message)

    def until(self, condition: Callable[[], Any], patience: float = PATIENCE) -> Any:
        """Wait until a condition holds; returns what it gave."""
        deadline = time.monotonic() + patience
        while not (value := condition()):
            assert time.monotonic() < deadline, f"in vain; last heard {self.heard[-3:]}"
            time.sleep(0.02)
        return value

    def newest(self, kind: str) -> dict[str, Any]:
        """Return the last message of a type."""
        return self.until(
            lambda: next((m for m in reversed(list(self.heard)) if m["type"] == kind), None)
        )

    def event(self, kind: str) -> dict[str, Any]:
        """Return the first event of a kind."""
        return self.until(lambda: next((m for m in self.heard if m.get("kind") == kind), None))

    def event_with(self, text: str) -> dict[str, Any]:
        """Return the first event that says something."""
        return self.until(
            lambda: next((m for m in list(self.heard) if text in m.get("text", "")), None)
        )

    def ask(self, kind: str, **fields: object) -> dict[str, Any]:
        """Return the answer to a request, which is sent when the cockpit's limit allows it."""
        time.sleep(max(0.0, self._asked + 1.0 / MESSAGE_RATE - time.monotonic()))
        self._asked = time.monotonic()
        self._number += 1
        number = self._number
        text = json.dumps({"type": kind, "id": number, **fields})
        assert self._socket is not None
        asyncio.run_coroutine_threadsafe(self._socket.send_str(text), self._loop).result(PATIENCE)
        return self.until(
            lambda: next(
                (m for m in self.heard if m["type"] == "answer" and m["id"] == number), None
            )
        )

    def have_done(self, kind: str, **fields: object) -> None:
        """Ask until it is done, for the nodes that do it may not be met yet."""
        self.until(lambda: self.ask(kind, **fields)["ok"])

    def get(self, path: str) -> dict[str, Any]:
        """Return the server's answer for a path, decoded."""

        async def fetch() -> Any:
            url = f"{self.address}/{path}"
            async with aiohttp.ClientSession() as session, session.get(url) as response:
                return await response.json()

        return asyncio.run_coroutine_threadsafe(fetch(), self._loop).result(PATIENCE)

    def close(self) -> None:
        """Leave."""
        if self._socket is not None and not self._loop.is_closed():
            asyncio.run_coroutine_threadsafe(self._socket.close(), self._loop)
        self._thread.join(PATIENCE)
