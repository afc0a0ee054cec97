"""Parameters of the server for Foxglove; no ROS here."""

from __future__ import annotations

from dataclasses import dataclass

from bicycle_common.parameters import parameter

LOOPBACK = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True)
class FoxgloveSettings:
    """ROS parameters of the server."""

    host: str = parameter(
        "127.0.0.1", "address to listen on; anything but loopback lets other machines in"
    )
    port: int = parameter(8765, "to listen on; 0 takes a free one", 0, 65535)
    publish: bool = parameter(
        False,
        "clients may send goals and poses and call services; any web page open on this machine "
        "is one, for the protocol does not say whose it is",
    )
    topics: str = parameter("", "regular expression that shown topics contain; empty shows all")
    backlog: int = parameter(
        256, "messages kept for a client that is slow, then the oldest go", 8, 65536
    )

    @property
    def is_open(self) -> bool:
        """True if other machines can connect."""
        return self.host not in LOOPBACK
