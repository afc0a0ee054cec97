"""Access control: the host and the origin of a request, and the token for other machines.

Any page in the user's browser can send requests to 127.0.0.1, and a foreign name can be made to
point there. So a request must name this server in Host, a WebSocket must come from a page of this
server, and clients on other machines must know the token.
"""

from __future__ import annotations

import hmac
import ipaddress
from dataclasses import dataclass
from urllib.parse import urlsplit

LOCAL_NAMES = frozenset(("localhost", "127.0.0.1", "::1"))
NO_NAME = frozenset(" /\\?#@:[]")
"""Characters that a host name cannot have: they belong to the rest of an address."""
SHORTEST_TOKEN = 16
"""Least length of a token, in characters."""


class RefusedError(Exception):
    """A rejected request; the text is one line for the log, without the token."""

    def __init__(self, status: int, text: str) -> None:
        super().__init__(text)
        self.status = status
        """HTTP status."""


def is_local(address: str) -> bool:
    """Return True if an address to bind to can be reached from this machine only."""
    if address == "localhost":
        return True
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True)
class AccessPolicy:
    """Access rules of one server.

    Raises:
        ValueError: if other machines can reach it without a token, on a short one, or on a name
            that no browser sends.
    """

    address: str = "127.0.0.1"
    """Address to which the server is bound."""
    token: str = ""
    """Token that every page must know; empty for none."""
    names: frozenset[str] = frozenset()
    """Accepted host names, besides those of this machine and numeric addresses."""

    def __post_init__(self) -> None:
        if not is_local(self.address) and not self.token:
            raise ValueError(
                f"--bind {self.address} opens the cockpit to other machines: have a secret made "
                "with --token auto, or give one in --token-file FILE or BICYCLE_COCKPIT_TOKEN"
            )
        if self.token and not (len(self.token) >= SHORTEST_TOKEN and self.token.isalnum()):
            raise ValueError(f"the token must be at least {SHORTEST_TOKEN} letters and digits")
        for name in self.names:
            if NO_NAME.intersection(name) and not _is_number(name):
                raise ValueError(f"--host-name {name[:80]!r}: give the name alone")

    def check_host(self, host: str) -> None:
        """Check the Host header.

        Raises:
            RefusedError: if it does not name this server. The address to which it is bound names
                it. Any number suffices if other machines are admitted: nobody can make it point
                elsewhere.
        """
        name = _name_of(f"//{host}")
        if name in LOCAL_NAMES or name in self.names or name == self.address.lower():
            return
        if not is_local(self.address) and _is_number(name):
            return
        raise RefusedError(421, f"Host {host[:80]!r} is not this server")

    def check_origin(self, origin: str | None, host: str) -> None:
        """Check the Origin header of a WebSocket.

        Raises:
            RefusedError: if the page that opens it did not come from this server.
        """
        if origin not in (f"http://{host}", f"https://{host}"):
            raise RefusedError(403, f"origin {str(origin)[:80]!r} is foreign")

    def check_site(self, site: str | None, mode: str | None, path: str) -> None:
        """Check the origin that a browser states for a request; other clients state none.

        Args:
            site: Sec-Fetch-Site.
            mode: Sec-Fetch-Mode.
            path: requested path.

        Raises:
            RefusedError: if another site's page requests anything except to open this one.
        """
        if site in (None, "same-origin", "none") or (mode == "navigate" and path == "/"):
            return
        raise RefusedError(403, f"a page of another site asks ({str(site)[:20]!r})")

    def check_token(self, token: str) -> None:
        """Check the token.

        Raises:
            RefusedError: if a token is required and this is not it.
        """
        given = token.encode(errors="surrogatepass")
        if self.token and not hmac.compare_digest(given, self.token.encode()):
            raise RefusedError(401, "the token is missing or wrong")


def _name_of(address: str) -> str:
    try:
        return (urlsplit(address).hostname or "").lower()
    except ValueError:
        return ""


def _is_number(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
