"""Listening sockets, and the number of connections accepted at once."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
from collections.abc import Callable

QUEUE = 128
"""Connections that the kernel queues until they are accepted."""
AT_ONCE = 8
"""Connections that asyncio accepts before it serves existing ones: together with the open ones
they must not exhaust this process's limit of files."""


THE_PORT_S_FAULT = (errno.EADDRINUSE, errno.EACCES)
"""Numbers of errors that another port does not have."""


def why_not(error: OSError, address: str, port: int) -> str:
    """Return one line that says why an address cannot be listened on, with the remedy."""
    resolved = not isinstance(error, socket.gaierror)
    reason = os.strerror(error.errno or 0) if resolved else error.strerror
    remedy = "choose an address of this machine with --bind"
    if resolved and error.errno in THE_PORT_S_FAULT:
        remedy = "choose another with --port N"
    return f"cannot listen on {address} port {port}: {reason}; {remedy}"


async def listen(
    protocol: Callable[[], asyncio.BaseProtocol], address: str, port: int
) -> tuple[int, list[asyncio.Server]]:
    """Listen on all addresses of a name, such as both kinds of localhost.

    Args:
        protocol: creates the protocol of a connection.
        address: name or number.
        port: zero selects a free one, the same for all.

    Returns:
        The port, and the servers to close.

    Raises:
        OSError: if it cannot be bound.
    """
    loop = asyncio.get_running_loop()
    flags = socket.AI_PASSIVE
    try:
        found = await loop.getaddrinfo(address, port, type=socket.SOCK_STREAM, flags=flags)
    except UnicodeError:  # such as a label of more than 63 letters
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known") from None
    servers: list[asyncio.Server] = []
    try:
        for family, _, _, _, place in dict.fromkeys(found):
            line = _bound(family, (place[0], port, *place[2:]))
            port = line.getsockname()[1]
            servers.append(await loop.create_server(protocol, sock=line, backlog=AT_ONCE))
            line.listen(QUEUE)
    except OSError:
        for server in servers:
            server.close()
        raise
    return port, servers


def _bound(family: int, place: tuple[object, ...]) -> socket.socket:
    line = socket.socket(family, socket.SOCK_STREAM)
    try:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            line.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        line.bind(place)
    except OSError:
        line.close()
        raise
    return line
