"""WebSocket of one page: it sends queued data, and receives requests."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from socket import SO_SNDBUF, SOL_SOCKET

from aiohttp import WSCloseCode, WSMessage, WSMsgType, web

from bicycle_cockpit.broadcaster import Broadcaster, Outbox, TooSlowError
from bicycle_cockpit.json_text import json_text
from bicycle_cockpit.rate_limiter import RateLimiter
from bicycle_cockpit.requests import MOST_BYTES, Request, RequestError, parse

HEARTBEAT = 20.0
"""Period of pings (s); a page that does not answer is gone."""
MOST_BUFFERED = 64 * 1024
"""Limit of the send buffer of one page, here and in the kernel (bytes); default is megabytes."""
GOOD_BYE = 1.0
"""Time for a page to answer the closing message (s)."""
MESSAGE_RATE, MESSAGE_BURST = 20.0, 40.0
MOST_REFUSALS = 20
"""Number of refused messages after which a page is disconnected."""


class PageSocket:
    """An admitted page.

    Args:
        request: that opens the WebSocket.
        broadcaster: queues of all pages.
        number: of this page in it.
        log: logs one line about a refused message.
    """

    def __init__(
        self,
        request: web.Request,
        broadcaster: Broadcaster,
        number: int,
        log: Callable[[str], None],
    ) -> None:
        self._request, self._broadcaster, self._number, self._log = (
            request,
            broadcaster,
            number,
            log,
        )
        # A greeting has hundreds of kilobytes of numbers; compression reduces it to a quarter.
        self.socket = web.WebSocketResponse(
            heartbeat=HEARTBEAT, max_msg_size=MOST_BYTES, compress=True, timeout=GOOD_BYE
        )
        self.socket.headers["Server"] = "cockpit"
        self.admitted = False
        """True once it is connected."""

    async def serve(
        self,
        box: Outbox,
        on_join: Callable[[int], None],
        on_request: Callable[[int, Request], None],
    ) -> None:
        """Serve the page until it leaves.

        Args:
            box: queue of data for it.
            on_join: called once it is connected.
            on_request: called with each of its requests.
        """
        try:
            await self.socket.prepare(self._request)
        except ConnectionError:
            return  # it has left
        self.admitted = True
        _keep_short(self._request)
        sender = asyncio.create_task(self._send(box))
        try:
            on_join(self._number)
            await self._receive(on_request)
        finally:
            sender.cancel()

    async def close(self) -> None:
        """Tell the page that the server ends."""
        await self.socket.close(code=WSCloseCode.GOING_AWAY, message=b"the cockpit ends")

    async def _send(self, box: Outbox) -> None:
        """Send queued data, at the page's own pace."""
        try:
            while True:
                await self.socket.send_str(await box.take())
        except TooSlowError:
            await self.socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b"too slow")
        except ConnectionError:
            pass  # the page is gone; the receiving side notices it too

    async def _receive(self, on_request: Callable[[int, Request], None]) -> None:
        """Receive a page's requests until it leaves."""
        rate_limiter, refusals = RateLimiter(MESSAGE_RATE, MESSAGE_BURST), 0
        who = self._request.remote
        async for message in self.socket:
            if message.type == WSMsgType.ERROR:
                break  # too large, or no WebSocket frame; the reason follows below
            try:
                if not rate_limiter.take():
                    raise RequestError("too many messages: slow down")
                on_request(self._number, parse(_text(message)))
            except RequestError as error:
                refusals += 1
                self._log(f"{who}: message refused: {error}")
                answer = {"type": "answer", "id": -1, "ok": False, "message": str(error)}
                self._broadcaster.reliable(json_text(answer), self._number)
                if refusals >= MOST_REFUSALS:
                    self._log(f"{who}: sent away after {refusals} refused messages")
                    code = WSCloseCode.POLICY_VIOLATION
                    await self.socket.close(code=code, message=b"too many")
        end = self.socket.exception()
        # A page that closes during a write is no error.
        if end is not None and not isinstance(end, ConnectionError):
            self._log(f"{who}: connection ended: {end}")


def _keep_short(request: web.Request) -> None:
    """Keep the send buffers small: data queued here can be merged and sent at once later."""
    if request.transport is None:
        return
    request.transport.set_write_buffer_limits(high=MOST_BUFFERED)
    line = request.transport.get_extra_info("socket")
    if line is not None:
        line.setsockopt(SOL_SOCKET, SO_SNDBUF, MOST_BUFFERED)


def _text(message: WSMessage) -> str:
    """Return the text of a message.

    Raises:
        RequestError: if it is not text.
    """
    if message.type != WSMsgType.TEXT:
        raise RequestError("a message that is not text")
    return str(message.data)
