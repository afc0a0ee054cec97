"""The web server with real connections: who gets in, what is refused, who is too slow."""

from __future__ import annotations

import asyncio
import json
import shutil
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import quote

import aiohttp
import pytest
from policies import make_policy, own_policy
from server_desk import TOKEN, Desk
from waiting import until
from yarl import URL

from bicycle_cockpit import page_socket
from bicycle_cockpit.access import AccessPolicy
from bicycle_cockpit.page_socket import MOST_REFUSALS
from bicycle_cockpit.policy_catalogue import PolicyCatalogue
from bicycle_cockpit.requests import MOST_BYTES
from bicycle_cockpit.rows import Rows
from bicycle_cockpit.server import HEADERS, Server
from bicycle_controller.policy.policy import save_policy

RIDE = Path(__file__).resolve().parents[1] / "data" / "film-ride"


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    result = Desk(AccessPolicy(), tmp_path)
    yield result
    result.server.stop()


Session = aiohttp.ClientSession


async def opened(session: Session, desk: Desk) -> aiohttp.ClientWebSocketResponse:
    """Return a page that was greeted."""
    page = await session.ws_connect(f"{desk.url}/ws", origin=desk.url)
    assert (await page.receive_json())["type"] == "hello"
    assert (await page.receive_json())["type"] == "palette"
    return page


async def status_of(session: Session, url: str, **headers: str) -> int:
    async with session.get(url, headers=headers) as response:
        return response.status


def test_the_page_and_its_parts_with_strict_headers(desk: Desk) -> None:
    async def story() -> None:
        async with Session() as session:
            for path in ("/", "/web/main.js", "/web/style.css", "/web/icon.svg", "/bags", "/none"):
                async with session.get(desk.url + path) as response:
                    assert response.status == (404 if path == "/none" else 200)
                    for name, value in HEADERS.items():
                        assert response.headers[name] == value
                    assert "http://" not in (await response.text()).replace("http://www.w3", "")

    asyncio.run(story())


@pytest.mark.parametrize(
    "path",
    [
        "/web/../server.py",
        "/web/%2e%2e/server.py",
        "/bags/../../etc",
        "/bags/%2Fetc",
        "/bags/a?rider=x",
        "/nothing",
    ],
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
    desk = Desk(AccessPolicy("0.0.0.0", TOKEN), tmp_path)

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
            one = await opened(session, desk)
            other = await opened(session, desk)
            await one.send_str('{"type":"step","id":5}')
            await asyncio.to_thread(until, lambda: desk.requests)
            page, request = desk.requests[0]
            desk.server.reliable({"type": "answer", "id": request.id}, page)
            desk.server.reliable({"type": "event"})
            assert (await one.receive_json())["id"] == 5
            assert (await one.receive_json())["type"] == "event"
            assert (await other.receive_json())["type"] == "event"

    asyncio.run(story())


def test_bad_messages_are_refused_logged_and_at_last_end_it(desk: Desk) -> None:
    async def story() -> int | None:
        async with Session() as session:
            page = await opened(session, desk)
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
            page = await opened(session, desk)
            await page.send_str("x" * (MOST_BYTES + 1))
            while not page.closed:
                await page.receive()
            return page.close_code

    assert asyncio.run(story()) == aiohttp.WSCloseCode.MESSAGE_TOO_BIG
    until(lambda: desk.lines)
    assert desk.lines[0].endswith(f"size {MOST_BYTES + 1} exceeds limit {MOST_BYTES}")


def test_too_many_messages_are_refused(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_socket, "MESSAGE_RATE", 0.0)  # however slowly they come

    async def story() -> None:
        async with Session() as session:
            page = await opened(session, desk)
            for _ in range(50):
                await page.send_str('{"type":"step"}')
            assert "slow down" in (await page.receive_json())["message"]

    asyncio.run(story())
    assert len(desk.requests) == page_socket.MESSAGE_BURST


def stalled(desk: Desk, more: str = "") -> socket.socket:
    """Return a page that opens its WebSocket and never reads from it."""
    line = socket.create_connection(("127.0.0.1", desk.server.port))
    line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    line.sendall(
        f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{desk.server.port}\r\nOrigin: {desk.url}\r\n"
        "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        f"{more}Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode()
    )
    return line


def test_a_page_that_reads_nothing_holds_up_nobody(desk: Desk) -> None:
    wide = tuple(f"[{','.join(['0.125'] * 200)}]" for _ in range(20))

    async def story() -> list[int]:
        async with Session() as session:
            page = await opened(session, desk)
            got: list[int] = []
            for number in range(900):
                desk.server.stream(Rows(0, number * len(wide), wide))
                got.append((await page.receive_json())["first"])
            return got

    line = stalled(desk)
    until(lambda: desk.joined)
    assert asyncio.run(story()) == [number * len(wide) for number in range(900)]
    assert desk.server.dropped > 0
    line.close()


def test_rows_that_waited_for_a_slow_line_come_without_a_hole(desk: Desk) -> None:
    """The page takes nothing for a while: what it missed comes in one go, each row once."""

    async def story() -> list[int]:
        async with Session() as session:
            desk.greets = False
            page = await session.ws_connect(f"{desk.url}/ws", origin=desk.url)
            await asyncio.to_thread(until, lambda: desk.joined)
            wide = f"[{','.join(['0.125'] * 400)}]"
            history = [Rows(0, 400, (wide,) * 100), Rows(0, 300, (wide,) * 100)]
            desk.server.greet(desk.joined[0], {"type": "hello"}, history)
            for number in range(500, 900):
                desk.server.stream(Rows(0, number, (wide,)))
            got: list[int] = []
            while len(got) < 600:
                message = await page.receive_json()
                rows = message.get("rows", ())
                got += range(message.get("first", 0), message.get("first", 0) + len(rows))
            return got

    got = asyncio.run(story())
    assert sorted(got) == list(range(300, 900))
    assert desk.server.dropped == 0


async def ridden_by(desk: Desk, rider: str) -> tuple[int, dict[str, Any]]:
    """Return status and answer for a bag that a controller rides again."""
    async with aiohttp.ClientSession() as session:
        url = f"{desk.url}/bags/film-ride"
        async with session.get(url, params={"rider": rider}) as response:
            return response.status, await response.json()


def test_a_policy_of_ones_own_rides_a_bag_again(tmp_path: Path) -> None:
    shutil.copytree(RIDE, tmp_path / "bags" / RIDE.name)
    models = tmp_path / "models"
    kept = models / "mine" / "policies" / "00001500.safetensors"
    for path in (models / "mine" / "best.safetensors", kept):
        save_policy(own_policy(wear=0.01 * (path == kept)), path)
    desk = Desk(AccessPolicy(), tmp_path / "bags", PolicyCatalogue(models))
    try:
        for name, label in (
            ("mine", "mine"),
            ("mine/policies/00001500", "mine after 1,500 updates"),
        ):
            status, ride = asyncio.run(ridden_by(desk, name))
            assert status == 200, ride
            (rider,) = ride["riders"]
            assert (rider["label"], rider["kind"]) == (label, "a neural network")
            assert any(mark["kind"] == "reached" for mark in ride["marks"])
        save_policy(make_policy(), models / "mine" / "best.safetensors")
        _, worse = asyncio.run(ridden_by(desk, "mine"))
        assert any(mark["kind"] == "fell" for mark in worse["marks"]), "the file was replaced"
        status, refusal = asyncio.run(ridden_by(desk, str(kept)))
        assert status == 404
        assert refusal["error"].startswith("there is no controller '/")
    finally:
        desk.server.stop()


@pytest.mark.parametrize(
    "name", ["new\nline", "a%2fb", "a#b?c=1&d", "<img src=x onerror=alert(1)>", "ü", "-rf", "..x"]
)
def test_every_name_that_a_folder_may_have_is_found(tmp_path: Path, name: str) -> None:
    shutil.copytree(RIDE, tmp_path / name)
    desk = Desk(AccessPolicy(), tmp_path)

    async def story() -> None:
        async with Session() as session:
            url = URL(f"{desk.url}/bags/{quote(name)}", encoded=True)
            async with session.get(url) as response:
                assert (response.status, (await response.json())["name"]) == (200, name)

    try:
        asyncio.run(story())
    finally:
        desk.server.stop()


def test_a_port_that_is_taken_is_said(desk: Desk, tmp_path: Path) -> None:
    second = Server(AccessPolicy(), desk.server.port, tmp_path, print, print, print)
    with pytest.raises(OSError, match="in use"):
        second.start()


def test_the_end_tells_the_pages(desk: Desk) -> None:
    async def story() -> int | None:
        async with Session() as session:
            page = await opened(session, desk)
            last = asyncio.create_task(page.receive())
            await asyncio.to_thread(desk.server.stop)
            await last
            return page.close_code

    assert asyncio.run(story()) == aiohttp.WSCloseCode.GOING_AWAY


@pytest.mark.parametrize("path", ["/web/main.js", "/web/style.css", "/", "/bags"])
def test_every_kind_of_answer_is_named_by_its_type(desk: Desk, path: str) -> None:
    kinds = {"/": "text/html", "/bags": "application/json"}
    kind = kinds.get(path, "text/javascript" if path.endswith(".js") else "text/css")

    async def story() -> None:
        async with Session() as session, session.get(desk.url + path) as response:
            assert response.headers["Content-Type"].partition(";")[0] == kind

    asyncio.run(story())


def test_the_page_s_parts_come_compressed_and_are_not_sent_again(desk: Desk) -> None:
    async def story() -> None:
        async with Session(auto_decompress=False) as session:
            url = f"{desk.url}/web/main.js"
            async with session.get(url, headers={"Accept-Encoding": "gzip"}) as response:
                packed, tag = await response.read(), response.headers["ETag"]
                assert response.headers["Content-Encoding"] == "gzip"
            async with session.get(url, headers={"Accept-Encoding": "identity"}) as response:
                plain = await response.read()
                assert "Content-Encoding" not in response.headers
            assert len(packed) < 0.6 * len(plain)
            assert await status_of(session, url, **{"If-None-Match": tag}) == 304

    asyncio.run(story())


def test_a_greeting_and_its_rows_come_compressed(desk: Desk) -> None:
    """582 kB of numbers took twelve seconds on a line of 50 kB/s."""
    text = json.dumps([0.12345 + number for number in range(20)])
    history = [Rows(0, 400 * piece, (text,) * 400) for piece in reversed(range(12))]
    desk.greets = False
    with stalled(desk, "Sec-WebSocket-Extensions: permessage-deflate\r\n") as line:
        until(lambda: desk.joined)
        desk.server.greet(desk.joined[0], {"type": "hello"}, history)
        stream = line.makefile("rb")
        while (header := stream.readline()) != b"\r\n":
            assert header
        sizes = [frame_size(stream) for _ in range(2 + len(history))]
    plain = sum(len(rows.message("history")) for rows in history)
    assert 0 < sum(sizes) < plain / 4


def frame_size(stream: BinaryIO) -> int:
    """Return bytes of the next message of a WebSocket, which is compressed."""
    first, length = stream.read(2)
    assert first & 0x40, "a message that is not compressed"
    if length >= 126:
        length = int.from_bytes(stream.read(2 if length == 126 else 8), "big")
    return len(stream.read(length))


def test_a_compressed_message_that_becomes_too_large_ends_the_connection(desk: Desk) -> None:
    async def story() -> int | None:
        async with Session() as session:
            page = await session.ws_connect(f"{desk.url}/ws", origin=desk.url, compress=15)
            assert page.compress, "the server agrees to compress"
            await page.send_str("x" * 50_000_000)
            while not page.closed:
                await page.receive()
            return page.close_code

    assert asyncio.run(story()) == aiohttp.WSCloseCode.MESSAGE_TOO_BIG


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_another_site_s_page_cannot_have_bags_read_by_an_image(desk: Desk, site: str) -> None:
    async def story() -> None:
        async with Session() as session:
            image = {"Sec-Fetch-Site": site, "Sec-Fetch-Mode": "no-cors"}
            frame = {"Sec-Fetch-Site": site, "Sec-Fetch-Mode": "navigate"}
            for headers in (image, frame):
                assert await status_of(session, f"{desk.url}/bags", **headers) == 403
                assert await status_of(session, f"{desk.url}/bags/any", **headers) == 403
            assert await status_of(session, f"{desk.url}/", **image) == 403
            assert await status_of(session, f"{desk.url}/", **frame) == 200, "a link may lead here"
            own = {"Sec-Fetch-Site": "same-origin", "Sec-Fetch-Mode": "cors"}
            assert await status_of(session, f"{desk.url}/bags", **own) == 200

    asyncio.run(story())
    assert "a page of another site asks" in desk.lines[0]


def test_a_token_that_is_no_text_is_wrong_and_nothing_more(tmp_path: Path) -> None:
    desk = Desk(AccessPolicy("0.0.0.0", TOKEN), tmp_path)
    try:
        with socket.create_connection(("127.0.0.1", desk.server.port)) as line:
            request = (
                b"GET /bags HTTP/1.0\r\nHost: localhost\r\nAuthorization: Bearer \xff\xfe\r\n\r\n"
            )
            line.sendall(request)
            assert line.makefile("rb").read().split()[1] == b"401"
    finally:
        desk.server.stop()
