"""ROS domains that no other test on this machine uses meanwhile."""

from __future__ import annotations

import contextlib
import fcntl
import os
import random
import tempfile
from collections.abc import Iterator
from pathlib import Path

# Up to 101 no DDS port falls in Linux' ephemeral range; those up to 50, with the
# workspace's default 42, are left to people.
DOMAINS = range(51, 101)
VARIABLE = b"ROS_DOMAIN_ID="
LOCKS = Path(tempfile.gettempdir()) / f"bicycle_test_domains_{os.getuid()}"


@contextlib.contextmanager
def claimed_domain() -> Iterator[int]:
    """A domain for as long as the context lasts.

    A lock on a file holds it, so that parallel workers and other checkouts keep off and a killed
    test frees it, once what it has started is gone as well. The one that was left longest ago
    comes first: nodes that were killed at the end of a test are taken for alive for some seconds.

    Raises:
        RuntimeError: when none is free.
    """
    LOCKS.mkdir(exist_ok=True)
    free = set(DOMAINS) - lived_in()
    drawn = random.Random().sample(sorted(free), len(free))
    for domain in sorted(drawn, key=left_at):
        with (LOCKS / str(domain)).open("a") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            try:
                yield domain
            finally:
                os.utime(lock.fileno())
            return
    raise RuntimeError("no free ROS domain between 51 and 100: are other tests hanging?")


def lived_in() -> set[int]:
    """Domains of the processes that are there: of a person, or of a test that was killed."""
    found = set()
    for environment in Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):
            words = environment.read_bytes().split(b"\0")
            found |= {word.partition(b"=")[2] for word in words if word.startswith(VARIABLE)}
    return {int(word) for word in found if word.isdigit()}


def left_at(domain: int) -> float:
    """Return the time at which a test left a domain, s since 1970; 0 if none did."""
    path = LOCKS / str(domain)
    return path.stat().st_mtime if path.exists() else 0.0


@contextlib.contextmanager
def shared_memory(flag: int) -> Iterator[None]:
    """/dev/shm with `fcntl.LOCK_EX` for who makes files there, with LOCK_SH for who counts them.

    Parallel workers and other checkouts have the same folder.
    """
    LOCKS.mkdir(exist_ok=True)
    with (LOCKS / "shared_memory").open("w") as lock:
        fcntl.flock(lock, flag)
        yield
