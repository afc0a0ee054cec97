"""Sockets that a process and its children have bound, from the kernel's own tables."""

from __future__ import annotations

import ipaddress
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

TABLES = ("tcp", "tcp6", "udp", "udp6", "udplite", "udplite6", "raw", "raw6")
LISTENING = "0A"


@dataclass(frozen=True)
class Socket:
    """One socket that others could send to."""

    process: str
    protocol: str
    address: str
    port: int

    @property
    def loopback(self) -> bool:
        """True if only this machine reaches it."""
        return ipaddress.ip_address(self.address).is_loopback

    @property
    def multicast(self) -> bool:
        """True if it is bound to a group's address, so that it hears that group alone."""
        return ipaddress.ip_address(self.address).is_multicast


def family(pid: int) -> list[int]:
    """Return a process and all that descend from it."""
    parents = {}
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = entry.read_text().rpartition(") ")[2].split()
        except OSError:
            continue  # ended meanwhile
        parents[int(entry.parent.name)] = int(fields[1])
    found = [pid]
    for member in found:
        found += [child for child, parent in parents.items() if parent == member]
    return found


def bound(pid: int) -> list[Socket]:
    """TCP sockets of one process that listen, and all its sockets of the connectionless kinds."""
    inodes = set()
    for descriptor in Path(f"/proc/{pid}/fd").iterdir():
        try:
            target = str(descriptor.readlink())
        except OSError:
            continue  # closed meanwhile
        if target.startswith("socket:["):
            inodes.add(target[len("socket:[") : -1])
    name = Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ").strip()
    return list(_of_tables(pid, name, inodes))


def _of_tables(pid: int, name: str, inodes: set[str]) -> Iterator[Socket]:
    for table in TABLES:
        path = Path(f"/proc/{pid}/net/{table}")
        if not path.exists():
            continue
        for line in path.read_text().splitlines()[1:]:
            fields = line.split()
            local, state, inode = fields[1], fields[3], fields[9]
            if inode in inodes and (not table.startswith("tcp") or state == LISTENING):
                address, port = local.split(":")
                yield Socket(name, table, _readable(address), int(port, 16))


def _readable(address: str) -> str:
    """Return an address as people write it; the kernel prints this machine's byte order."""
    words = [bytes.fromhex(address[at : at + 8])[::-1] for at in range(0, len(address), 8)]
    return str(ipaddress.ip_address(b"".join(words)))
