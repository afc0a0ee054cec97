"""The words for an address that cannot be listened on."""

from __future__ import annotations

import asyncio
import socket

from bicycle_cockpit.listening import listen, why_not


def words_for(address: str, port: int = 0) -> str:
    try:
        asyncio.run(listen(asyncio.Protocol, address, port))
    except OSError as error:
        return why_not(error, address, port)
    raise AssertionError(f"{address} is listened on")


def test_a_name_that_nobody_has_is_not_the_port_s_fault() -> None:
    for name in ("no.such.host.invalid", "a b", "ü" * 70, "999.1.1.1"):
        words = words_for(name)
        assert "choose an address of this machine with --bind" in words
        assert "--port" not in words
        assert "Unknown error" not in words


def test_an_address_of_another_machine_is_not_the_port_s_fault() -> None:
    words = words_for("192.0.2.1")
    assert "Cannot assign requested address" in words
    assert "--bind" in words


def test_a_port_that_is_taken_is() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        words = words_for("127.0.0.1", port)
    assert words.startswith(f"cannot listen on 127.0.0.1 port {port}: Address already in use")
    assert words.endswith("choose another with --port N")
