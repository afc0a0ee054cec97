"""A page of a cockpit without a browser: one that takes every frame, or one that stalls.

    python tests/support/pages.py read|stall ADDRESS

The reader parses what it takes and draws nothing; it prints `open` when it is connected and its
number of frames at the end. The other opens its connection and never reads from it; it comes back
when the cockpit gives it up. Both stand back behind the loop (nice 5) and end with SIGINT.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import sys
import time
from urllib.parse import urlsplit

import aiohttp


async def read(address: str) -> None:
    """One page that takes every frame."""
    frames = 0
    task = asyncio.current_task()
    assert task is not None
    asyncio.get_running_loop().add_signal_handler(signal.SIGINT, task.cancel)
    try:
        async with aiohttp.ClientSession() as session:
            page = await session.ws_connect(f"{address}/ws", origin=address, max_msg_size=0)
            print("open", flush=True)
            async for message in page:
                frames += json.loads(message.data)["type"] == "frame"
    except asyncio.CancelledError:
        print(frames)
    else:
        sys.exit("the cockpit closed the page")


def stall(address: str) -> None:
    """One page that never reads."""
    signal.signal(signal.SIGINT, lambda *_: sys.exit(0))
    where = urlsplit(address)
    while True:
        line = socket.socket()
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        line.connect((where.hostname, where.port))
        line.sendall(
            f"GET /ws HTTP/1.1\r\nHost: {where.netloc}\r\nOrigin: {address}\r\n"
            "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode()
        )
        time.sleep(15.0)


if __name__ == "__main__":
    os.nice(5)
    kind, server = sys.argv[1:]
    asyncio.run(read(server)) if kind == "read" else stall(server)
