"""One page's WebSocket: sends what waits for it, and takes in what it asks for."""

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
"""s between two pings; a page that answers none is gone."""
MOST_BUFFERED = 64 * 1024
"""Bytes on the way to one page, here and as many in the kernel; it would take megabytes."""
GOOD_BYE = 1.0
"""s that a page gets to answer when it is told that all is over."""
MESSAGE_RATE, MESSAGE_BURST = 20.0, 40.0
MOST_REFUSALS = 20
"""Refused messages after which a page is sent away."""


class PageSocket:
    """A page that is let in.

    Args:
        request: that opens the WebSocket.
        hub: of all pages.
        number: of this page there.
        log: takes one line about what is refused.
    """

    def __init__(
        self, request: web.Request, hub: Broadcaster, number: int, log: Callable[[str], None]
    ) -> None:
        self._request, self._hub, self._number, self._log = request, hub, number, log
        # A greeting has hundreds of kilobytes of numbers; compressed a quarter of that.
        self.socket = web.WebSocketResponse(
            heartbeat=HEARTBEAT, max_msg_size=MOST_BYTES, compress=True, timeout=GOOD_BYE
        )
        self.socket.headers["Server"] = "cockpit"

    async def serve(
        self,
        box: Outbox,
        on_join: Callable[[int], None],
        on_request: Callable[[int, Request], None],
    ) -> None:
        """Talk with the page until it leaves.

        Args:
            box: what waits for it.
            on_join: called once it is connected.
            on_request: called with each of its requests.
        """
        try:
            await self.socket.prepare(self._request)
        except ConnectionError:
            return  # it has left
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
        """Send what waits, at the page's own pace."""
        try:
            while True:
                await self.socket.send_str(await box.take())
        except TooSlowError:
            await self.socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b"too slow")
        except ConnectionError:
            pass  # the page is gone; the receiving side sees it too

    async def _receive(self, on_request: Callable[[int, Request], None]) -> None:
        """Take in a page's requests until it leaves."""
        bucket, refusals = RateLimiter(MESSAGE_RATE, MESSAGE_BURST), 0
        who = self._request.remote
        async for message in self.socket:
            if message.type == WSMsgType.ERROR:
                break  # too large, or no WebSocket frame; the reason follows below
            try:
                if not bucket.take():
                    raise RequestError("too many messages: slow down")
                on_request(self._number, parse(_text(message)))
            except RequestError as error:
                refusals += 1
                self._log(f"{who}: message refused: {error}")
                answer = {"type": "answer", "id": -1, "ok": False, "message": str(error)}
                self._hub.letter(json_text(answer), self._number)
                if refusals >= MOST_REFUSALS:
                    self._log(f"{who}: sent away after {refusals} refused messages")
                    code = WSCloseCode.POLICY_VIOLATION
                    await self.socket.close(code=code, message=b"too many")
        end = self.socket.exception()
        # A page that is closed while it is written to is nothing to tell.
        if end is not None and not isinstance(end, ConnectionError):
            self._log(f"{who}: connection ended: {end}")


def _keep_short(request: web.Request) -> None:
    """Let little pile up on the way to a page: what waits here can be sent in one go later."""
    if request.transport is None:
        return
    request.transport.set_write_buffer_limits(high=MOST_BUFFERED)
    line = request.transport.get_extra_info("socket")
    if line is not None:
        line.setsockopt(SOL_SOCKET, SO_SNDBUF, MOST_BUFFERED)


def _text(message: WSMessage) -> str:
    """Return the text of a message.

    Raises:
        RequestError: when it is not text.
    """
    if message.type != WSMsgType.TEXT:
        raise RequestError("a message that is not text")
    return str(message.data)
