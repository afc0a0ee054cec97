"""A client of Foxglove's WebSocket protocol, as the app is one: subprotocol foxglove.sdk.v1."""

from __future__ import annotations

import asyncio
import json
import re
import struct
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import aiohttp
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from waiting import PATIENCE

PROTOCOL = "foxglove.sdk.v1"
MESSAGE_DATA = 1
SERVICE_REQUEST, SERVICE_RESPONSE = 2, 3
FETCH_ASSET_RESPONSE = 4
UNKNOWN_CHANNEL = re.compile(r"Unknown channel ID: (\d+)")


def subscription(channel: int) -> str:
    """Return the command to subscribe to a channel, under the channel's own number."""
    asked = [{"id": channel, "channelId": channel}]
    return json.dumps({"op": "subscribe", "subscriptions": asked})


class FoxgloveClient:
    """Connects at once; every method serves the connection until it has what it wants.

    Attributes:
        info: the server's first word.
        channels: advertised channels by topic.
        messages: decoded messages by topic, in order.
        statuses: what the server complained about.
    """

    def __init__(self, port: int, origin: str | None = None) -> None:
        self._loop = asyncio.new_event_loop()
        self.info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self.messages: defaultdict[str, list[Any]] = defaultdict(list)
        self.raw: dict[str, list[bytes]] = {}
        self.statuses: list[str] = []
        self.services: dict[str, dict[str, Any]] = {}
        self._answers: dict[int, Any] = {}
        self._assets: dict[int, bytes | None] = {}
        self._topics: dict[int, str] = {}
        self._again: list[int] = []
        self._decode: dict[str, Callable[[bytes], Any]] = {}
        self._run(self._connect(f"ws://127.0.0.1:{port}", origin))
        self.until(lambda: self.info)

    def _run(self, work: Any) -> Any:
        return self._loop.run_until_complete(asyncio.wait_for(work, PATIENCE))

    async def _connect(self, address: str, origin: str | None) -> None:
        self._session = aiohttp.ClientSession()
        headers = {"Origin": origin} if origin else None
        self._socket = await self._session.ws_connect(
            address, protocols=[PROTOCOL], max_msg_size=0, headers=headers
        )
        assert self._socket.protocol == PROTOCOL

    def until(self, condition: Callable[[], Any], patience: float = PATIENCE) -> Any:
        """Take in what comes until a condition holds; returns what it gave."""

        async def serve() -> Any:
            while not (value := condition()):
                self._take(await self._socket.receive())
                while self._again:
                    await self._socket.send_str(subscription(self._again.pop()))
            return value

        return self._loop.run_until_complete(asyncio.wait_for(serve(), patience))

    def _take(self, message: aiohttp.WSMessage) -> None:
        if message.type == aiohttp.WSMsgType.BINARY and message.data[0] == MESSAGE_DATA:
            _, number, _ = struct.unpack_from("<BIQ", message.data)
            topic, data = self._topics[number], message.data[13:]
            self.raw.setdefault(topic, []).append(data)
            self.messages[topic].append(self._decode[topic](data))
        elif message.type == aiohttp.WSMsgType.BINARY and message.data[0] == SERVICE_RESPONSE:
            _, _, call, length = struct.unpack_from("<BIII", message.data)
            self._answers[call] = json.loads(message.data[13 + length :])
        elif message.type == aiohttp.WSMsgType.BINARY and message.data[0] == FETCH_ASSET_RESPONSE:
            _, number, failed, length = struct.unpack_from("<BIBI", message.data)
            self._assets[number] = None if failed else message.data[10 + length :]
        elif message.type == aiohttp.WSMsgType.TEXT:
            said = json.loads(message.data)
            if said["op"] == "serverInfo":
                self.info = said
            elif said["op"] == "advertise":
                self.channels.update({item["topic"]: item for item in said["channels"]})
            elif said["op"] == "advertiseServices":
                self.services.update({item["name"]: item for item in said["services"]})
            elif said["op"] == "serviceCallFailure":
                self._answers[said["callId"]] = said["message"]
            elif said["op"] == "status":
                self._hear(said["message"])
        else:
            assert message.type == aiohttp.WSMsgType.BINARY, message

    def _hear(self, complaint: str) -> None:
        """Ask again for a channel that the server told of before it knew it.

        The SDK advertises a new channel to its clients a moment before it accepts subscriptions.
        """
        unknown = UNKNOWN_CHANNEL.fullmatch(complaint)
        if unknown and int(unknown[1]) in self._topics:
            self._again.append(int(unknown[1]))
        else:
            self.statuses.append(complaint)

    def send(self, **said: Any) -> None:
        """Send one command in JSON."""
        self._run(self._socket.send_str(json.dumps(said)))

    def call(self, name: str, values: Any) -> Any:
        """Call a service in JSON; return its answer, or why there is none as a text."""
        number = len(self._answers) + 1
        head = struct.pack("<BIII", SERVICE_REQUEST, self.services[name]["id"], number, 4)
        self._run(self._socket.send_bytes(head + b"json" + json.dumps(values).encode()))
        return self.until(lambda: self._answers.get(number))

    def asset(self, uri: str) -> bytes | None:
        """Ask for a file; return its contents, None if it is refused."""
        number = len(self._assets) + 1
        self.send(op="fetchAsset", uri=uri, requestId=number)
        self.until(lambda: number in self._assets)
        return self._assets[number]

    def subscribe(self, topic: str) -> None:
        """Ask for a topic, once it is advertised."""
        channel = self.until(lambda: self.channels.get(topic))
        schema = Schema(1, channel["schema"].encode(), "ros2msg", channel["schemaName"])
        decode = DecoderFactory().decoder_for(channel["encoding"], schema)
        assert decode is not None
        self._decode[topic] = decode
        self._topics[channel["id"]] = topic
        self._run(self._socket.send_str(subscription(channel["id"])))

    def offer(self, number: int, topic: str, kind: str, encoding: str = "json") -> None:
        """Say that this client will publish a topic."""
        channel = {"id": number, "topic": topic, "encoding": encoding, "schemaName": kind}
        self.send(op="advertise", channels=[channel])

    def publish(self, number: int, data: bytes) -> None:
        """Publish on a channel that was offered."""
        self._run(self._socket.send_bytes(struct.pack("<BI", MESSAGE_DATA, number) + data))

    def close(self) -> None:
        """Leave."""
        self._run(self._socket.close())
        self._run(self._session.close())
        self._loop.close()
