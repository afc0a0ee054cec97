"""Connections by hand: half-open, silent, oversized, stalled; nobody is kept out by them."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import resource
import socket
import struct
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import aiohttp
import pytest
from server_desk import Desk
from waiting import PATIENCE, until

from bicycle_cockpit import connections
from bicycle_cockpit.access import AccessPolicy
from bicycle_cockpit.server import HEADERS

HALF = b"GET / HTTP/1.1\r\nHost: localhost\r\n"


@pytest.fixture
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Deadlines that a test can wait for."""
    monkeypatch.setattr(connections, "REQUEST_TIME", 1.0)
    monkeypatch.setattr(connections, "STALL_TIME", 1.0)


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    result = Desk(AccessPolicy(), tmp_path)
    yield result
    result.server.stop()


def connected(desk: Desk, sends: bytes = b"") -> socket.socket:
    line = socket.create_connection(("127.0.0.1", desk.server.port))
    line.settimeout(PATIENCE)
    if sends:
        line.sendall(sends)
    return line


def closed(line: socket.socket) -> bool:
    """Wait until the server closes the connection; return True if it does."""
    try:
        return line.recv(1000) == b""
    except ConnectionError:
        return True


def answer(line: socket.socket, request: bytes) -> bytes:
    """Return all that comes until the connection ends."""
    with contextlib.suppress(ConnectionError):
        line.sendall(request)
    got = b""
    with contextlib.suppress(ConnectionError):
        while data := line.recv(65536):
            got += data
    return got


@pytest.mark.parametrize("sends", [b"", b"G", HALF, HALF + b"X-Slow: " + b"a" * 3000])
def test_a_connection_that_sends_no_whole_request_is_closed(
    hurried: None, desk: Desk, sends: bytes
) -> None:
    with connected(desk, sends) as line:
        assert closed(line)
    reported = [line for line in desk.lines if "no whole request within" in line]
    assert len(reported) == (1 if sends else 0), "a browser that opens one ahead is not told of"


def test_a_request_that_trickles_in_is_not_waited_for(hurried: None, desk: Desk) -> None:
    with connected(desk, HALF) as line:
        line.settimeout(0.05)
        ended = False
        for number in range(10_000):
            try:
                line.sendall(f"X-{number}: a\r\n".encode())
                ended = line.recv(10) == b""
            except TimeoutError:
                continue
            except ConnectionError:
                ended = True
            if ended:
                break
        assert ended


def test_an_idle_connection_is_closed_without_a_word(hurried: None, desk: Desk) -> None:
    request = b"GET /web/icon.svg HTTP/1.1\r\nHost: localhost\r\n\r\n"
    with connected(desk, request) as line:
        assert line.recv(10).startswith(b"HTTP/1.1")
        with contextlib.suppress(ConnectionError):
            while line.recv(65536):
                pass
    assert desk.lines == []


def test_a_body_that_never_comes_is_not_waited_for(hurried: None, desk: Desk) -> None:
    request = HALF + b"Content-Length: 1000\r\n\r\nabc"
    with connected(desk, request) as line:
        assert line.recv(12) == b"HTTP/1.1 200"
        with contextlib.suppress(ConnectionError):
            while line.recv(65536):
                pass


def test_who_takes_nothing_of_an_answer_is_cut_off(hurried: None, desk: Desk) -> None:
    line = socket.socket()
    line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    line.connect(("127.0.0.1", desk.server.port))
    with line:
        for _ in range(400):
            try:
                line.sendall(b"GET /web/main.js HTTP/1.1\r\nHost: localhost\r\n\r\n")
            except ConnectionError:
                break
        until(lambda: any("took nothing" in line for line in desk.lines))


def test_many_half_open_connections_keep_nobody_out(desk: Desk) -> None:
    """The oldest that waits makes room; who has a request is answered."""

    async def story() -> None:
        async with aiohttp.ClientSession() as session:
            page = await session.ws_connect(f"{desk.url}/ws", origin=desk.url)
            for _ in range(5):
                async with session.get(f"{desk.url}/web/main.js") as response:
                    assert response.status == 200
            desk.server.reliable({"type": "event"})
            kinds = {(await page.receive_json())["type"] for _ in range(3)}
            assert kinds == {"hello", "palette", "event"}, "the page's WebSocket lives on"

    lines = []
    try:
        for number in range(3 * connections.MOST):
            lines.append(connected(desk, HALF if number % 2 else b""))
        asyncio.run(story())
    finally:
        for line in lines:
            line.close()
    assert any("it waited longest" in line for line in desk.lines)
    assert len(desk.lines) < 60, "the log does not grow with the attack"


def test_pages_that_are_open_are_never_put_out_by_new_connections(desk: Desk) -> None:
    async def story() -> None:
        async with aiohttp.ClientSession() as session:
            pages = [
                await session.ws_connect(f"{desk.url}/ws", origin=desk.url) for _ in range(16)
            ]
            lines = [connected(desk) for _ in range(2 * connections.MOST)]
            # It is answered after all that came before it were taken in.
            async with session.get(f"{desk.url}/web/main.js") as response:
                assert response.status == 200
            desk.server.reliable({"type": "event"})
            for page in pages:
                kinds = {(await page.receive_json())["type"] for _ in range(3)}
                assert kinds == {"hello", "palette", "event"}
            for line in lines:
                line.close()

    asyncio.run(story())


@pytest.mark.parametrize(
    ("request_", "status"),
    [
        (b"GET / HTTP/1.1\r\nHost: localhost\r\nX-A: " + b"a" * 20_000 + b"\r\n\r\n", b"400"),
        (b"GET /" + b"a" * 20_000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n", b"400"),
        (b"GET / HTTP/1.1\r\nHost: localhost\r\n" + b"X: a\r\n" * 5000 + b"\r\n", b"400"),
        (b"GET / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: x\r\n\r\n", b"400"),
        (b"GET / HTTP/9.9\r\n\r\n", b"400"),
        (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", b"400"),
        (b"\x00" * 100, b"400"),
        (b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n", b"4"),
        (b"GET http://[ HTTP/1.1\r\nHost: localhost\r\n\r\n", b"4"),
    ],
)
def test_what_is_no_request_is_answered_and_told_in_one_line(
    desk: Desk, capfd: pytest.CaptureFixture[str], request_: bytes, status: bytes
) -> None:
    with connected(desk) as line:
        got = answer(line, request_)
    if got:  # a server may also just close on rubbish that is longer than it reads
        assert got.split()[1].startswith(status), got[:200]
        assert b"aiohttp" not in got
        assert b"Traceback" not in got
    until(lambda: desk.lines)
    assert len(desk.lines) == 1
    assert len(desk.lines[0]) < 400
    assert capfd.readouterr() == ("", "")


def test_a_mistake_of_ours_is_one_line_that_says_where(
    desk: Desk, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("this went\nwrong")

    monkeypatch.setattr(desk.server._assets, "response", broken)
    with connected(desk) as line:
        got = answer(line, b"GET / HTTP/1.0\r\nHost: localhost\r\n\r\n")
    assert got.split()[1] == b"500"
    (logged,) = desk.lines
    assert "RuntimeError: this went wrong (test_connections.py:" in logged
    assert capfd.readouterr() == ("", "")


def test_a_page_that_leaves_while_it_is_written_to_is_nothing_to_tell(desk: Desk) -> None:
    async def story() -> None:
        for _ in range(10):
            async with aiohttp.ClientSession() as session:
                page = await session.ws_connect(f"{desk.url}/ws", origin=desk.url)
                await page.receive_json()
                assert page._response.connection is not None
                transport = page._response.connection.transport
                assert transport is not None
                transport.abort()
                for _ in range(50):
                    desk.server.reliable({"type": "event", "text": "x" * 1000})

    asyncio.run(story())
    until(lambda: desk.server.pages == 0)
    assert desk.lines == []


UPGRADE = (
    "GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{0}\r\nOrigin: http://127.0.0.1:{0}\r\n"
    "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n{1}\r\n"
)


def test_a_page_that_leaves_before_it_is_let_in_is_nothing_to_tell(desk: Desk) -> None:
    request = UPGRADE.format(desk.server.port, "").encode()
    for _ in range(20):
        with connected(desk) as line:
            line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            line.sendall(request)
    with connected(desk) as line:
        answer(line, b"GET / HTTP/1.0\r\nHost: localhost\r\n\r\n")
    until(lambda: desk.server.pages == 0)
    assert desk.lines == []


def test_what_the_library_says_is_short_and_goes_the_same_way(
    desk: Desk, capfd: pytest.CaptureFixture[str]
) -> None:
    words = f"Sec-WebSocket-Protocol: {'x' * 6000}\r\n"
    for _ in range(30):
        with connected(desk, UPGRADE.format(desk.server.port, words).encode()) as line:
            assert line.recv(12) == b"HTTP/1.1 101"
    for name in ("asyncio", "aiohttp.server"):
        logging.getLogger(name).warning("said by %s", name)
    assert 20 <= len(desk.lines) <= 25
    assert max(map(len, desk.lines)) < 400
    assert "Client protocols" in desk.lines[0]
    assert capfd.readouterr() == ("", "")


def test_no_answer_tells_versions(desk: Desk) -> None:
    for request in (b"GET / HTTP/1.0\r\nHost: localhost\r\n\r\n", b"rubbish\r\n\r\n"):
        with connected(desk) as line:
            got = answer(line, request)
        assert f"Server: {HEADERS['Server']}".encode() in got
        assert b"Python" not in got


STARVED = """
    import json, resource, socket, sys, time, urllib.request
    from pathlib import Path
    from bicycle_cockpit.access import AccessPolicy
    from bicycle_cockpit.server import Server
    lines = []
    server = Server(AccessPolicy(), 0, Path(sys.argv[1]), print, print, lines.append)
    server.start()
    print(json.dumps({"port": server.port}), flush=True)
    sys.stdin.readline()
    url = f"http://127.0.0.1:{server.port}/web/main.js"
    print(json.dumps({"status": urllib.request.urlopen(url, timeout=180).status,
                      "lines": lines}), flush=True)
    server.stop()
"""


def test_a_process_with_few_files_is_not_made_unreachable(tmp_path: Path) -> None:
    """260 half-open connections at 200 descriptors once made 45,302 lines in 12 s and no page."""

    def few_files() -> None:
        _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (200, hard))

    child = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(STARVED), str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=few_files,
        env=os.environ.copy(),
    )
    lines = []
    try:
        assert child.stdout is not None
        port = json.loads(child.stdout.readline())["port"]
        for _ in range(260):
            line = socket.create_connection(("127.0.0.1", port))
            line.sendall(HALF)
            lines.append(line)
        out, err = child.communicate("go\n", timeout=PATIENCE)
        found = json.loads(out.splitlines()[-1])
    finally:
        for line in lines:
            line.close()
        child.kill()
    assert found["status"] == 200
    assert len(found["lines"]) < 60
    assert not any("Too many open files" in line for line in found["lines"])
    assert err == ""


def test_running_out_of_files_is_one_line_and_no_traceback(
    desk: Desk, capfd: pytest.CaptureFixture[str]
) -> None:
    """asyncio's own messages go the same way as all lines of the log."""
    error = OSError(24, "Too many open files")
    context = {"message": "socket.accept() out of system resource", "exception": error}
    for _ in range(1000):
        desk.server._loop.call_soon_threadsafe(
            desk.server._loop.call_exception_handler, dict(context)
        )
    until(lambda: len(desk.lines) >= 20)
    assert "Too many open files" in desk.lines[0]
    assert len(desk.lines) < 60
    assert capfd.readouterr() == ("", "")
