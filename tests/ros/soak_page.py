"""One page of a cockpit: takes every frame and parses it, until SIGINT.

python tests/ros/soak_page.py ADDRESS
"""

from __future__ import annotations

import asyncio
import json
import signal
import sys

import aiohttp


async def read(address: str) -> None:
    asyncio.get_running_loop().add_signal_handler(signal.SIGINT, asyncio.current_task().cancel)
    async with aiohttp.ClientSession() as session:
        page = await session.ws_connect(f"{address}/ws", origin=address, max_msg_size=0)
        print("open", flush=True)
        async for message in page:
            json.loads(message.data)
    sys.exit("the cockpit closed the page")


if __name__ == "__main__":
    try:
        asyncio.run(read(sys.argv[1]))
    except asyncio.CancelledError:
        print("closed")
