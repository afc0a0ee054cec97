"""The web server in a thread of its own: one page, its WebSocket, and the bags.

The thread shares nothing with the caller's but calls of the methods below, which only hand text
over, and the two callbacks, which must only put things down for later.
"""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable
from pathlib import Path
from socket import SO_SNDBUF, SOL_SOCKET
from typing import Any

from aiohttp import WSCloseCode, WSMessage, WSMsgType, web

from bicycle_bag.errors import BagError
from bicycle_cockpit.bags import BagShelf
from bicycle_cockpit.bucket import Bucket
from bicycle_cockpit.door import Door, RefusedError
from bicycle_cockpit.hub import Hub, Outbox, TooSlowError
from bicycle_cockpit.requests import MOST_BYTES, Request, RequestError, parse

WEB = Path(__file__).parent / "web"
HEARTBEAT = 20.0
"""s between two pings; a page that answers none is gone."""
MOST_BUFFERED = 64 * 1024
"""Bytes on the way to one page, here and as many in the kernel; it would take megabytes."""
GOOD_BYE = 1.0
"""s that a page gets to answer when it is told that all is over."""
MESSAGE_RATE, MESSAGE_BURST = 20.0, 40.0
MOST_REFUSALS = 20
"""Refused messages after which a page is sent away."""
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}


class Server:
    """Serves pages until it is stopped.

    Args:
        door: who may come in, and the address.
        port: to listen on; 0 takes a free one.
        shelf: the bags.
        on_request: called in the server's thread with a page's number and its request.
        on_join: called in the server's thread with the number of a page that is new.
        log: called in the server's thread with one line about what was refused.
    """

    def __init__(
        self,
        door: Door,
        port: int,
        shelf: BagShelf,
        on_request: Callable[[int, Request], None],
        on_join: Callable[[int], None],
        log: Callable[[str], None],
    ) -> None:
        self.port = port
        self._door = door
        self._shelf = shelf
        self._on_request, self._on_join, self._say = on_request, on_join, log
        self._log_bucket = Bucket(rate=1.0, burst=20.0)
        self._unsaid = 0
        self._hub = Hub()
        self._sockets: set[web.WebSocketResponse] = set()
        self._loop = asyncio.new_event_loop()
        self._over = asyncio.Event()
        self._ready = threading.Event()
        self._error: OSError | None = None
        self._thread = threading.Thread(target=self._run, name="web", daemon=True)

    # Called from other threads.

    def start(self) -> None:
        """Begin to serve.

        Raises:
            OSError: when the address cannot be bound.
        """
        self._thread.start()
        self._ready.wait()
        if self._error is not None:
            raise self._error

    def stop(self) -> None:
        """Say good-bye to all pages and end the thread."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._over.set)
            self._thread.join(5.0)

    def frame(self, data: dict[str, Any]) -> None:
        """A frame for all pages; those that do not keep up may lose it."""
        self._loop.call_soon_threadsafe(self._hub.frame, _json(data))

    def newest(self, data: dict[str, Any]) -> None:
        """Something that replaces what was sent before with the same `type`."""
        self._loop.call_soon_threadsafe(self._hub.newest, data["type"], _json(data))

    def letter(self, data: dict[str, Any], to: int | None = None) -> None:
        """Something that must not be lost, for one page or for all."""
        self._loop.call_soon_threadsafe(self._hub.letter, _json(data), to)

    @property
    def pages(self) -> int:
        """How many are connected."""
        return self._hub.count

    @property
    def dropped(self) -> int:
        """Frames that the connected pages never got."""
        return self._hub.dropped

    # The server's thread.

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._ready.set()
            self._loop.close()

    async def _serve(self) -> None:
        app = web.Application(middlewares=[self._guard], client_max_size=MOST_BYTES)
        app.router.add_get("/", self._page)
        app.router.add_get("/ws", self._socket)
        app.router.add_get("/bags", self._list_bags)
        app.router.add_get("/bags/{name:.+}", self._open_bag)
        app.router.add_static("/web", WEB)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        try:
            site = web.TCPSite(runner, self._door.address, self.port)
            await site.start()
            self.port = runner.addresses[0][1]
            self._ready.set()
            await self._over.wait()
        except OSError as error:
            self._error = error
        finally:
            leaving = (
                socket.close(code=WSCloseCode.GOING_AWAY, message=b"the cockpit ends")
                for socket in self._sockets
            )
            await asyncio.gather(*leaving, return_exceptions=True)
            await runner.cleanup()

    @web.middleware
    async def _guard(self, request: web.Request, handler: Any) -> web.StreamResponse:
        """Let in who may come in; every answer forbids what the page does not need."""
        try:
            self._door.check_host(request.host)
            response = await handler(request)
        except RefusedError as refusal:
            self._log(f"{request.remote}: {request.path[:80]!r} refused: {refusal}")
            response = web.Response(status=refusal.status, text=f"{refusal}\n")
        except web.HTTPException as error:
            response = web.Response(status=error.status, text=f"{error.reason}\n")
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    def _log(self, line: str) -> None:
        """Log a line, but not without end."""
        if not self._log_bucket.take():
            self._unsaid += 1
            return
        more = f" (and {self._unsaid} more like it before)" if self._unsaid else ""
        self._unsaid = 0
        self._say("".join(char if char.isprintable() else "?" for char in line) + more)

    async def _page(self, request: web.Request) -> web.StreamResponse:
        return web.FileResponse(WEB / "index.html")

    async def _list_bags(self, request: web.Request) -> web.Response:
        self._door.check_token(_bearer(request))
        found = await asyncio.to_thread(self._shelf.listed)
        return _json_response({"bags": found})

    async def _open_bag(self, request: web.Request) -> web.Response:
        self._door.check_token(_bearer(request))
        name = request.match_info["name"]
        try:
            data = await asyncio.to_thread(self._shelf.load, name)
        except KeyError:
            raise RefusedError(404, f"there is no bag {name[:80]!r} in the folder") from None
        except BagError as error:
            return _json_response({"error": str(error)}, status=422)
        return _json_response(data)

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        self._door.check_origin(request.headers.get("Origin"), request.host)
        self._door.check_token(request.query.get("token", ""))
        socket = web.WebSocketResponse(
            heartbeat=HEARTBEAT, max_msg_size=MOST_BYTES, compress=False, timeout=GOOD_BYE
        )
        joined = self._hub.join()
        if joined is None:
            raise RefusedError(503, "too many pages are connected")
        number, box = joined
        sender: asyncio.Task[None] | None = None
        try:
            await socket.prepare(request)
            _keep_short(request)
            self._sockets.add(socket)
            sender = asyncio.create_task(self._send(socket, box))
            self._on_join(number)
            await self._receive(request, socket, number)
        finally:
            self._hub.leave(number)
            self._sockets.discard(socket)
            if sender is not None:
                sender.cancel()
        return socket

    @staticmethod
    async def _send(socket: web.WebSocketResponse, box: Outbox) -> None:
        """Send what waits, at the page's own pace."""
        try:
            while True:
                await socket.send_str(await box.take())
        except TooSlowError:
            await socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b"too slow")
        except ConnectionError:
            pass  # the page is gone; the receiving side sees it too

    async def _receive(
        self, request: web.Request, socket: web.WebSocketResponse, number: int
    ) -> None:
        """Take in a page's requests until it leaves."""
        bucket, refusals = Bucket(MESSAGE_RATE, MESSAGE_BURST), 0
        async for message in socket:
            if message.type == WSMsgType.ERROR:
                break  # too large, or no WebSocket frame; the reason follows below
            try:
                if not bucket.take():
                    raise RequestError("too many messages: slow down")
                self._on_request(number, parse(_text(message)))
            except RequestError as error:
                refusals += 1
                self._log(f"{request.remote}: message refused: {error}")
                self._hub.letter(
                    _json({"type": "answer", "id": -1, "ok": False, "message": str(error)}),
                    number,
                )
                if refusals >= MOST_REFUSALS:
                    self._log(f"{request.remote}: sent away after {refusals} refused messages")
                    await socket.close(code=WSCloseCode.POLICY_VIOLATION, message=b"too many")
        end = socket.exception()
        if end is not None:
            self._log(f"{request.remote}: connection ended: {end}")


def _keep_short(request: web.Request) -> None:
    """Let little pile up on the way to a page: what is dropped should be old, not shown late."""
    if request.transport is None:
        return
    request.transport.set_write_buffer_limits(high=MOST_BUFFERED)
    line = request.transport.get_extra_info("socket")
    if line is not None:
        line.setsockopt(SOL_SOCKET, SO_SNDBUF, MOST_BUFFERED)


def _text(message: WSMessage) -> str:
    """The text of a message.

    Raises:
        RequestError: when it is not text.
    """
    if message.type != WSMsgType.TEXT:
        raise RequestError("a message that is not text")
    return str(message.data)


def _bearer(request: web.Request) -> str:
    """The token of a request without WebSocket."""
    return request.headers.get("Authorization", "").removeprefix("Bearer ")


def _json(data: dict[str, Any]) -> str:
    """JSON that every browser reads: without NaN.

    Raises:
        ValueError: on a number that is not finite.
    """
    return json.dumps(data, allow_nan=False, separators=(",", ":"))


def _json_response(data: dict[str, Any], status: int = 200) -> web.Response:
    return web.Response(text=_json(data), content_type="application/json", status=status)
