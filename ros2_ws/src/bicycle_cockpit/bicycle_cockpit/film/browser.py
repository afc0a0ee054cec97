"""A Chromium without a display, driven over its DevTools protocol."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import shutil
import tempfile
from collections.abc import AsyncIterator
from typing import Any

import aiohttp

NAMED = "BICYCLE_CHROMIUM"
"""Environment variable that names the program."""
PROGRAMS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "brave-browser",
)
START = 60.0
"""Time that the browser has to start (s)."""
ANSWER = 120.0
"""Time that one call may take (s)."""


class BrowserError(RuntimeError):
    """There is no browser, or it does not do what it must."""


def find_browser() -> str:
    """Return the path of a Chromium.

    Raises:
        BrowserError: if there is none.
    """
    named = os.environ.get(NAMED, "")
    if named:
        if shutil.which(named) is None:
            raise BrowserError(f"{NAMED} names {named}, which is no program")
        return named
    found = next((path for name in PROGRAMS if (path := shutil.which(name))), None)
    if found is None:
        raise BrowserError(
            "a film needs Chromium or Chrome to draw it: sudo apt install chromium, "
            f"or name one in {NAMED}"
        )
    return found


class BrowserTab:
    """One page of the browser."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket = socket
        self._number = 0
        self.errors: list[str] = []

    async def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol.

        Raises:
            BrowserError: if the browser refuses it, ends, or takes too long.
        """
        self._number += 1
        text = {"id": self._number, "method": method, "params": parameters}
        await self._socket.send_json(text)
        try:
            return await asyncio.wait_for(self._answer(self._number), ANSWER)
        except asyncio.TimeoutError:
            raise BrowserError(f"the browser does not answer to {method}") from None

    async def _answer(self, number: int) -> dict[str, Any]:
        async for message in self._socket:
            data = message.json()
            if data.get("method") == "Runtime.exceptionThrown":
                details = data["params"]["exceptionDetails"]
                thrown = details.get("exception", {})
                self.errors.append(str(thrown.get("description", details["text"])))
            if data.get("id") != number:
                continue
            if "error" in data:
                raise BrowserError(f"the browser refuses: {data['error']['message']}")
            result: dict[str, Any] = data["result"]
            return result
        raise BrowserError("the browser ended")

    async def evaluate(self, expression: str) -> Any:
        """Return the value of an expression of the page, awaited.

        Raises:
            BrowserError: if it throws.
        """
        answer = await self.call(
            "Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True
        )
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            thrown = details.get("exception", {}).get("description", details["text"])
            raise BrowserError(f"the page fails: {str(thrown).splitlines()[0]}")
        return answer["result"].get("value")


@contextlib.asynccontextmanager
async def browser_tab(address: str, size: tuple[int, int]) -> AsyncIterator[BrowserTab]:
    """Open a page in a browser of its own, which ends with this context.

    Args:
        address: the page's address.
        size: width and height, CSS pixels.
    """
    program = find_browser()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        flags = [
            "--headless=new",
            "--remote-debugging-port=0",
            f"--user-data-dir={profile}",
            "--no-first-run",
            "--disable-sync",
            "--disable-background-networking",
            "--disable-component-update",
            "--enable-unsafe-swiftshader",
            "--hide-scrollbars",
            *(["--no-sandbox"] if os.geteuid() == 0 else []),
        ]
        process = await asyncio.create_subprocess_exec(
            program,
            *flags,
            "about:blank",
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
        )
        try:
            port = await _port(process)
            async with aiohttp.ClientSession() as session:
                url = await _page_socket(session, port)
                async with session.ws_connect(url, max_msg_size=0) as socket:
                    tab = BrowserTab(socket)
                    await tab.call("Runtime.enable")
                    width, height = size
                    await tab.call(
                        "Emulation.setDeviceMetricsOverride",
                        width=width,
                        height=height,
                        deviceScaleFactor=1,
                        mobile=False,
                    )
                    await tab.call("Page.navigate", url=address)
                    yield tab
        finally:
            with contextlib.suppress(ProcessLookupError):
                process.terminate()
            with contextlib.suppress(asyncio.TimeoutError):
                await asyncio.wait_for(process.wait(), 10.0)
            if process.returncode is None:
                process.kill()
                await process.wait()


async def _port(process: asyncio.subprocess.Process) -> int:
    """Return the port of the protocol, which the browser prints."""
    stream = process.stderr
    assert stream is not None

    async def heard() -> int:
        said = ""
        async for line in stream:
            said = line.decode(errors="replace").strip() or said
            found = re.search(r"DevTools listening on ws://[^:]+:(\d+)/", said)
            if found:
                return int(found[1])
        raise BrowserError(f"the browser does not start: {said[:200]}")

    try:
        return await asyncio.wait_for(heard(), START)
    except asyncio.TimeoutError:
        raise BrowserError(f"the browser does not start within {START:.0f} s") from None


async def _page_socket(session: aiohttp.ClientSession, port: int) -> str:
    """Return the address of the first page's protocol."""
    async with session.get(f"http://127.0.0.1:{port}/json/list") as answer:
        targets = await answer.json()
    pages = [target for target in targets if target["type"] == "page"]
    if not pages:
        raise BrowserError("the browser opens no page")
    url: str = pages[0]["webSocketDebuggerUrl"]
    return url
