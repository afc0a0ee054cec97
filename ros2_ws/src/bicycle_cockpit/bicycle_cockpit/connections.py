"""Limits on connections to the web server: their number, and their durations.

Any process that reaches the port can open connections, with a token or without. So a connection
is closed if it sends no complete request in time, or reads nothing of its answer. If there are too
many, the oldest one that waits for a request makes room for a new one, so that idle connections
keep nobody out.
"""

from __future__ import annotations

import asyncio
import contextlib
import resource
from collections.abc import Callable, Iterator
from typing import Any

from aiohttp import web

REQUEST_TIME = 10.0
"""Time for a complete request, since the connection's start or its last answer (s)."""
STALL_TIME = 30.0
"""Time after which a connection that reads nothing is closed (s)."""
MOST = 64
"""Largest number of connections; a page has one WebSocket and up to six for its parts."""
FEWEST = 20

Log = Callable[[str], None]


def most_connections() -> int:
    """Return the number that the process's limit of open files allows; ROS needs files too."""
    allowed, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return MOST if allowed < 0 else max(FEWEST, min(MOST, allowed // 3))


class Connection(web.RequestHandler):
    """One connection, with its deadlines.

    Args:
        book: all of them.
        manager: the application's own.
        loop: that it is served in.
        more: for `web.RequestHandler`.
    """

    def __init__(
        self,
        book: Connections,
        manager: web.Server,
        loop: asyncio.AbstractEventLoop,
        **more: Any,
    ) -> None:
        super().__init__(manager, loop=loop, **more)
        self._book = book
        self._event_loop = loop
        self._due: asyncio.TimerHandle | None = None
        self._stalled: asyncio.TimerHandle | None = None
        self._heard = False
        self.name = "?"
        """Address of the peer."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Start to wait for a request, if there is room."""
        super().connection_made(transport)
        peer = transport.get_extra_info("peername")
        self.name = str(peer[0]) if peer else "?"
        self._book.opened(self)
        self._wait()

    def connection_lost(self, exc: BaseException | None) -> None:
        """Remove it."""
        for timer in (self._due, self._stalled):
            if timer is not None:
                timer.cancel()
        self._book.closed(self)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Receive bytes."""
        self._heard = True
        super().data_received(data)

    def pause_writing(self) -> None:
        """Start the deadline: the peer does not read."""
        super().pause_writing()
        why = f"took nothing for {STALL_TIME:g} s"
        self._stalled = self._event_loop.call_later(STALL_TIME, self.cut, why)

    def resume_writing(self) -> None:
        """Stop the deadline: the peer reads again."""
        super().resume_writing()
        if self._stalled is not None:
            self._stalled.cancel()

    @contextlib.contextmanager
    def at_work(self) -> Iterator[None]:
        """Mark the connection busy while a request is answered."""
        self._book.busy(self)
        if self._due is not None:
            self._due.cancel()
        try:
            yield
        finally:
            self._heard = False
            self._book.idle(self)
            self._wait()

    def _wait(self) -> None:
        self._due = self._event_loop.call_later(REQUEST_TIME, self._overdue)

    def _overdue(self) -> None:
        # A browser opens connections in advance that it may not need: their timeout is not logged.
        why = f"sent no whole request within {REQUEST_TIME:g} s" if self._heard else ""
        self.cut(why)

    def cut(self, why: str) -> None:
        """Close it at once; `why`, if not empty, is logged."""
        if self.transport is not None:
            if why:
                self._book.log(f"{self.name}: connection closed: {why}")
            self.transport.abort()

    def handle_error(
        self,
        request: web.BaseRequest,
        status: int = 500,
        exc: BaseException | None = None,
        message: str | None = None,
    ) -> web.StreamResponse:
        """Log one line and answer shortly, on invalid HTTP and on errors of this server."""
        text = " ".join(str(message or exc or "").split())
        self._book.log(f"{self.name}: {status}, {type(exc).__name__}: {text[:120]}{_where(exc)}")
        response = web.Response(status=status, text=f"{status}\n")
        response.headers["Server"] = "cockpit"
        response.force_close()
        return response


class Connections:
    """All connections of a server; called as the factory of each connection's protocol.

    Args:
        manager: created by aiohttp's runner for the application.
        log: logs one line.
        most: largest number of connections.
        more: for `web.RequestHandler`.
    """

    def __init__(self, manager: web.Server, log: Log, most: int, **more: Any) -> None:
        self.log = log
        self._manager, self._most, self._more = manager, most, more
        self._waiting: dict[Connection, None] = {}
        self._busy: set[Connection] = set()

    def __call__(self) -> Connection:
        """Create the protocol of a new connection."""
        return Connection(self, self._manager, asyncio.get_running_loop(), **self._more)

    def opened(self, connection: Connection) -> None:
        """Admit a connection; if there are too many, close the one that has waited longest."""
        self._waiting[connection] = None
        if len(self._waiting) + len(self._busy) > self._most:
            oldest = next(iter(self._waiting))
            # Remove it now, although it ends later: otherwise the next one would not be closed.
            del self._waiting[oldest]
            oldest.cut(f"there are {self._most}, and it waited longest")

    def busy(self, connection: Connection) -> None:
        """Mark it as answering a request."""
        self._waiting.pop(connection, None)
        self._busy.add(connection)

    def idle(self, connection: Connection) -> None:
        """Mark it as waiting for a request."""
        self._busy.discard(connection)
        if connection.transport is not None and not connection.transport.is_closing():
            self._waiting[connection] = None

    def closed(self, connection: Connection) -> None:
        """Remove it."""
        self._waiting.pop(connection, None)
        self._busy.discard(connection)


def _where(error: BaseException | None) -> str:
    """Return the place of an error in this server; empty for a client's error."""
    trace = error.__traceback__ if error is not None and not _is_http(error) else None
    if trace is None:
        return ""
    while trace.tb_next is not None:
        trace = trace.tb_next
    return f" ({trace.tb_frame.f_code.co_filename.rpartition('/')[2]}:{trace.tb_lineno})"


def _is_http(error: BaseException) -> bool:
    return type(error).__module__.startswith("aiohttp.")
