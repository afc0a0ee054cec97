"""The web server with real connections: who gets in, what is refused, who is too slow."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterator
from pathlib import Path

import aiohttp
import pytest
from waiting import until

from bicycle_cockpit.bags import BagShelf
from bicycle_cockpit.door import Door
from bicycle_cockpit.requests import MOST_BYTES, Request
from bicycle_cockpit.server import HEADERS, MOST_REFUSALS, Server

TOKEN = "0123456789abcdef"


class Desk:
    """A server, what it asks for and what it says."""

    def __init__(self, door: Door, folder: Path) -> None:
        self.requests: list[tuple[int, Request]] = []
        self.joined: list[int] = []
        self.lines: list[str] = []
        self.server = Server(
            door,
            0,
            BagShelf(folder),
            lambda page, request: self.requests.append((page, request)),
            self.joined.append,
            self.lines.append,
        )
        self.server.start()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server.port}"


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    made = Desk(Door(), tmp_path)
    yield made
    made.server.stop()


Session = aiohttp.ClientSession


async def status_of(session: Session, url: str, **headers: str) -> int:
    async with session.get(url, headers=headers) as response:
        return response.status


def test_the_page_and_its_parts_with_strict_headers(desk: Desk) -> None:
    async def story() -> None:
        async with Session() as session:
            for path in ("/", "/web/main.js", "/web/style.css"):
                async with session.get(desk.url + path) as response:
                    assert response.status == 200
                    for name, value in HEADERS.items():
                        assert response.headers[name] == value
                    assert "http://" not in (await response.text()).replace("http://www.w3", "")

    asyncio.run(story())


@pytest.mark.parametrize(
    "path",
    ["/web/../server.py", "/web/%2e%2e/server.py", "/bags/../../etc", "/bags/%2Fetc", "/nothing"],
)
def test_nothing_else_is_served(desk: Desk, path: str) -> None:
    with socket.create_connection(("127.0.0.1", desk.server.port)) as line:
        line.sendall(f"GET {path} HTTP/1.0\r\nHost: localhost\r\n\r\n".encode())
        answer = line.makefile("rb").read()
    assert answer.split()[1] in (b"403", b"404"), answer[:200]


def test_a_foreign_host_or_origin_is_refused_and_logged(desk: Desk) -> None:
    async def story() -> None:
        async with Session() as session:
            assert await status_of(session, desk.url, Host="evil.example") == 421
            for origin in ("http://evil.example", "null", None):
                with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
                    await session.ws_connect(f"{desk.url}/ws", origin=origin)
                assert caught.value.status == 403

    asyncio.run(story())
    assert [line.partition(": ")[2] for line in desk.lines] == [
        "'/' refused: Host 'evil.example' is not this server",
        "'/ws' refused: origin 'http://evil.example' is foreign",
        "'/ws' refused: origin 'null' is foreign",
        "'/ws' refused: origin 'None' is foreign",
    ]
    assert desk.joined == []


def test_an_open_server_wants_its_token(tmp_path: Path) -> None:
    desk = Desk(Door("0.0.0.0", TOKEN), tmp_path)

    async def story() -> None:
        async with Session() as session:
            assert await status_of(session, f"{desk.url}/bags") == 401
            bearer = {"Authorization": f"Bearer {TOKEN}"}
            assert await status_of(session, f"{desk.url}/bags", **bearer) == 200
            with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
                await session.ws_connect(f"{desk.url}/ws?token=wrong", origin=desk.url)
            assert caught.value.status == 401
            await session.ws_connect(f"{desk.url}/ws?token={TOKEN}", origin=desk.url)

    try:
        asyncio.run(story())
        until(lambda: len(desk.joined) == 1)
        assert not any(TOKEN in line for line in desk.lines)
    finally:
        desk.server.stop()


def test_requests_come_through_and_answers_go_to_who_asked(desk: Desk) -> None:
    async def story() -> None:
        async with Session() as session:
            one = await session.ws_connect(f"{desk.url}/ws", origin=desk.url)
            other = await session.ws_connect(f"{desk.url}/ws", origin=desk.url)
            await one.send_str('{"type":"step","id":5}')
            await asyncio.to_thread(until, lambda: desk.requests)
            page, request = desk.requests[0]
            desk.server.letter({"type": "answer", "id": request.id}, page)
            desk.server.letter({"type": "event"})
            assert (await one.receive_json())["id"] == 5
            assert (await one.receive_json())["type"] == "event"
            assert (await other.receive_json())["type"] == "event"

    asyncio.run(story())


def test_bad_messages_are_refused_logged_and_at_last_end_it(desk: Desk) -> None:
    async def story() -> int | None:
        async with Session() as session:
            page = await session.ws_connect(f"{desk.url}/ws", origin=desk.url)
            await page.send_bytes(b"\x00\x01")
            assert "not text" in (await page.receive_json())["message"]
            for _ in range(MOST_REFUSALS):
                await page.send_str('{"type":"fly\\n\\u001b[31m"}')
            while not page.closed:
                await page.receive()
            return page.close_code

    assert asyncio.run(story()) == aiohttp.WSCloseCode.POLICY_VIOLATION
    assert desk.requests == []
    assert "not text" in desk.lines[0]
    assert all("\n" not in line and "\x1b" not in line for line in desk.lines)


def test_a_message_too_large_ends_the_connection_with_a_line(desk: Desk) -> None:
    async def story() -> int | None:
        async with Session() as session:
            page = await session.ws_connect(f"{desk.url}/ws", origin=desk.url)
            await page.send_str("x" * (MOST_BYTES + 1))
            while not page.closed:
                await page.receive()
            return page.close_code

    assert asyncio.run(story()) == aiohttp.WSCloseCode.MESSAGE_TOO_BIG
    until(lambda: desk.lines)
    assert desk.lines[0].endswith(f"size {MOST_BYTES + 1} exceeds limit {MOST_BYTES}")


def test_too_many_messages_are_refused(desk: Desk) -> None:
    async def story() -> None:
        async with Session() as session:
            page = await session.ws_connect(f"{desk.url}/ws", origin=desk.url)
            for _ in range(50):
                await page.send_str('{"type":"step"}')
            assert "slow down" in (await page.receive_json())["message"]

    asyncio.run(story())
    assert 40 <= len(desk.requests) < 50


def test_a_page_that_reads_nothing_holds_up_nobody(desk: Desk) -> None:
    frame = {"type": "frame", "rows": [[0.125] * 20] * 200}

    def stalled() -> socket.socket:
        line = socket.create_connection(("127.0.0.1", desk.server.port))
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        line.sendall(
            f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{desk.server.port}\r\nOrigin: {desk.url}\r\n"
            "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode()
        )
        return line

    async def story() -> list[int]:
        async with Session() as session:
            page = await session.ws_connect(f"{desk.url}/ws", origin=desk.url)
            got = []
            until(lambda: len(desk.joined) == 2)
            for number in desk.joined:
                desk.server.letter({"type": "hello"}, number)
            await page.receive_json()
            for number in range(600):
                desk.server.frame({**frame, "number": number})
                got.append((await page.receive_json())["number"])
            return got

    line = stalled()
    until(lambda: desk.joined)
    assert asyncio.run(story()) == list(range(600))
    assert desk.server.dropped > 0
    line.close()


def test_a_port_that_is_taken_is_said(desk: Desk, tmp_path: Path) -> None:
    second = Server(Door(), desk.server.port, BagShelf(tmp_path), print, print, print)
    with pytest.raises(OSError, match="in use"):
        second.start()


def test_the_end_tells_the_pages(desk: Desk) -> None:
    async def story() -> int | None:
        async with Session() as session:
            page = await session.ws_connect(f"{desk.url}/ws", origin=desk.url)
            await asyncio.to_thread(until, lambda: desk.joined)
            last = asyncio.create_task(page.receive())
            await asyncio.to_thread(desk.server.stop)
            await last
            return page.close_code

    assert asyncio.run(story()) == aiohttp.WSCloseCode.GOING_AWAY
