"""Web server in its own thread: one page, its WebSocket, and the bags.

The thread shares with the caller only calls of the methods below, which pass text, and the two
callbacks, which must only store data for later.
"""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import logging
import threading
from collections.abc import AsyncIterator, Callable, Sequence
from pathlib import Path
from typing import Any

from aiohttp import web

from bicycle_cockpit.access import AccessPolicy, RefusedError
from bicycle_cockpit.assets import Assets, accepts_gzip
from bicycle_cockpit.bag_desk import BagDesk, BagProblemError
from bicycle_cockpit.broadcaster import Broadcaster
from bicycle_cockpit.connections import Connection, Connections, most_connections
from bicycle_cockpit.json_text import json_text
from bicycle_cockpit.listening import listen
from bicycle_cockpit.one_line import OneLine, ToOneLine, listened_to
from bicycle_cockpit.page_socket import PageSocket
from bicycle_cockpit.policy_catalogue import PolicyCatalogue
from bicycle_cockpit.requests import MOST_BYTES, Request
from bicycle_cockpit.riders import Palette
from bicycle_cockpit.rows import Rows

WEB = Path(__file__).parent / "web"
LIBRARIES = ("aiohttp", "asyncio")
"""Loggers of what serves; a client can make them speak."""
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
    "Cache-Control": "no-cache",
    "Server": "cockpit",
}


class Server:
    """Serves pages until it is stopped.

    Args:
        access_policy: access rules, and the address.
        port: to listen on; 0 selects a free one.
        bags: folder of the bags.
        on_request: called in the server's thread with a page's number and its request.
        on_join: called in the server's thread with the number of a new page.
        log: called in the server's thread with one line about a refusal.
        choices: controllers that can ride a bag's goals again; by default those that come along.
    """

    def __init__(
        self,
        access_policy: AccessPolicy,
        port: int,
        bags: Path,
        on_request: Callable[[int, Request], None],
        on_join: Callable[[int], None],
        log: Callable[[str], None],
        choices: PolicyCatalogue | None = None,
    ) -> None:
        self.port = port
        self.palette = Palette()
        self._access_policy = access_policy
        self._bags = BagDesk(bags)
        self._choices = choices or PolicyCatalogue(None)
        self._on_request, self._on_join = on_request, on_join
        self._log = OneLine(log)
        self._broadcaster = Broadcaster()
        self._pages: set[PageSocket] = set()
        self._assets = Assets(WEB)
        self._loop = asyncio.new_event_loop()
        self._over = asyncio.Event()
        self._ready = threading.Event()
        self._error: OSError | None = None
        self._thread = threading.Thread(target=self._run, name="web", daemon=True)

    # Called from other threads.

    def start(self) -> None:
        """Start to serve.

        Raises:
            OSError: if the address cannot be bound.
        """
        self._thread.start()
        self._ready.wait()
        if self._error is not None:
            raise self._error

    def stop(self) -> None:
        """Disconnect all pages and end the thread."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._over.set)
            self._thread.join(5.0)

    def greet(self, page: int, hello: dict[str, Any], history: Sequence[Rows]) -> None:
        """Send the first message of a page, and the rows until now."""
        self._loop.call_soon_threadsafe(self._broadcaster.greet, page, json_text(hello), history)

    def begin_anew(self, hello: dict[str, Any], history: Sequence[Rows]) -> None:
        """Greet all pages again, for another ride."""
        self._loop.call_soon_threadsafe(self._broadcaster.begin_anew, json_text(hello), history)

    def stream(self, rows: Rows) -> None:
        """Send new rows to all pages."""
        self._loop.call_soon_threadsafe(self._broadcaster.stream, rows)

    def latest(self, data: dict[str, Any]) -> None:
        """Send data that replace older data of the same `type`."""
        self._loop.call_soon_threadsafe(self._broadcaster.latest, data["type"], json_text(data))

    def reliable(self, data: dict[str, Any], to: int | None = None) -> None:
        """Send data that must not be lost, to one page or to all."""
        self._loop.call_soon_threadsafe(self._broadcaster.reliable, json_text(data), to)

    def colour(self, keys: Sequence[str]) -> None:
        """Assign colours to policies, see `Palette`."""
        if self.palette.add(keys):
            self.latest(self.palette.message())

    @property
    def pages(self) -> int:
        """Return the number of connected pages."""
        return self._broadcaster.count

    @property
    def dropped(self) -> int:
        """Return the number of frames that the connected pages never received."""
        return self._broadcaster.dropped

    # The server's thread.

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._ready.set()
            self._loop.close()

    async def _serve(self) -> None:
        self.latest(self.palette.message())
        compressing = asyncio.create_task(asyncio.to_thread(self._assets.read_all))
        try:
            async with self._listening():
                self._ready.set()
                await self._over.wait()
        except OSError as error:
            self._error = error
        await compressing

    @contextlib.asynccontextmanager
    async def _listening(self) -> AsyncIterator[None]:
        """Accept connections within this context; raise OSError if that fails."""
        app = web.Application(middlewares=[self._guard], client_max_size=MOST_BYTES)
        app.router.add_get("/", self._page)
        app.router.add_get("/web/{name:.+}", self._part)
        app.router.add_get("/ws", self._socket)
        app.router.add_get("/bags", self._list_bags)
        app.router.add_get(r"/bags/{name:[\s\S]+}", self._open_bag)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        assert runner.server is not None
        most = most_connections()
        logger = logging.Logger("web")
        logger.addHandler(ToOneLine(self._log))
        libraries = listened_to(self._log, LIBRARIES)
        connections = Connections(runner.server, self._log, most, logger=logger, access_log=None)
        self._loop.set_exception_handler(self._on_exception)
        try:
            with libraries:
                self.port, listeners = await listen(
                    connections, self._access_policy.address, self.port
                )
                yield
                for listener in listeners:
                    listener.close()
                leaving = (page.close() for page in self._pages)
                await asyncio.gather(*leaving, return_exceptions=True)
        finally:
            await self._bags.close()
            await runner.cleanup()

    def _on_exception(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Log one line for an error that asyncio would print with a traceback."""
        error = context.get("exception")
        words = f" ({type(error).__name__}: {error})" if error is not None else ""
        self._log(f"{context.get('message', 'the web server failed')}{words}")

    @web.middleware
    async def _guard(self, request: web.Request, handler: Any) -> web.StreamResponse:
        """Check access; every answer forbids what the page does not need."""
        connection = request.protocol
        assert isinstance(connection, Connection)
        with connection.at_work():
            try:
                self._check(request)
                response = await handler(request)
            except RefusedError as refusal:
                self._log(f"{request.remote}: {request.path[:80]!r} refused: {refusal}")
                response = web.Response(status=refusal.status, text=f"{refusal}\n")
            except web.HTTPException as error:
                response = web.Response(status=error.status, text=f"{error.reason}\n")
            if not response.prepared:
                response.headers.update(HEADERS)
                with contextlib.suppress(ConnectionError):  # it may have left
                    await response.prepare(request)
                    await response.write_eof()
        return response

    def _check(self, request: web.Request) -> None:
        self._access_policy.check_host(request.host)
        site, mode = (request.headers.get(f"Sec-Fetch-{name}") for name in ("Site", "Mode"))
        self._access_policy.check_site(site, mode, request.path)

    async def _page(self, request: web.Request) -> web.Response:
        return self._assets.response(request, "index.html")

    async def _part(self, request: web.Request) -> web.Response:
        return self._assets.response(request, request.match_info["name"])

    async def _list_bags(self, request: web.Request) -> web.Response:
        self._access_policy.check_token(_bearer(request))
        try:
            return _json_response({"bags": await self._bags.listed()})
        except BagProblemError as problem:
            return _json_response({"error": str(problem)}, problem.status)

    async def _open_bag(self, request: web.Request) -> web.Response:
        self._access_policy.check_token(_bearer(request))
        try:
            rider = request.query.get("rider", "")
            path = self._choices.path(rider) if rider else ""
            bag = await self._bags.load(request.match_info["name"], path, rider)
        except KeyError:
            return _json_response({"error": f"there is no controller {rider[:40]!r}"}, 404)
        except BagProblemError as problem:
            return _json_response({"error": str(problem)}, problem.status)
        self.colour(bag.colours)
        if accepts_gzip(request):
            packed = {"Content-Encoding": "gzip", "Vary": "Accept-Encoding"}
            return web.Response(body=bag.body, content_type="application/json", headers=packed)
        body = await asyncio.to_thread(gzip.decompress, bag.body)
        return web.Response(body=body, content_type="application/json")

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        self._access_policy.check_origin(request.headers.get("Origin"), request.host)
        self._access_policy.check_token(request.query.get("token", ""))
        joined = self._broadcaster.join()
        if joined is None:
            raise RefusedError(503, "too many pages are connected")
        number, box = joined
        page = PageSocket(request, self._broadcaster, number, self._log)
        self._pages.add(page)
        try:
            await page.serve(box, self._on_join, self._on_request)
        finally:
            self._broadcaster.leave(number)
            self._pages.discard(page)
        # One that left before it was let in has a socket that cannot be ended.
        return page.socket if page.admitted else web.Response(status=400)


def _bearer(request: web.Request) -> str:
    """Return the token of a request other than a WebSocket's."""
    return request.headers.get("Authorization", "").removeprefix("Bearer ")


def _json_response(data: dict[str, Any], status: int = 200) -> web.Response:
    return web.Response(text=json_text(data), content_type="application/json", status=status)
