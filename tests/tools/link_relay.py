"""A cable between two network namespaces that loses, delays and can be cut: netem in user space.

Usage: link_relay.py PID PID      two processes whose namespaces each get one end, named eth0

It is a bridge of two TAP devices, so that Ethernet frames pass whatever they hold: ARP, multicast,
DDS. Kernels without sch_netem have no other way to delay them. Orders come as lines of JSON on
standard input, each answered by one line with what has passed so far. The cable ends with it.
"""

from __future__ import annotations

import ctypes
import fcntl
import heapq
import json
import os
import random
import select
import struct
import sys
import time

TUNSETIFF = 0x400454CA
IFF_TAP, IFF_NO_PI = 0x0002, 0x1000
CLONE_NEWNET = 0x40000000
FRAME = 65536
IPV4 = b"\x08\x00"
BURST = 64
"""Frames that are read from one end before the other has its turn."""


def open_end(pid: int) -> int:
    """Return a TAP device in the network namespace of a process; its file descriptor."""
    namespace = os.open(f"/proc/{pid}/ns/net", os.O_RDONLY)
    if ctypes.CDLL(None, use_errno=True).setns(namespace, CLONE_NEWNET) != 0:
        raise OSError(ctypes.get_errno(), "setns")
    os.close(namespace)
    end = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(end, TUNSETIFF, struct.pack("16sH", b"eth0", IFF_TAP | IFF_NO_PI))
    return end


class Cable:
    """The frames under way, and what happens to them.

    Attributes:
        delay: s, one way.
        jitter: s, standard deviation of the delay.
        loss: probability of a frame's loss, one way.
        up: False while the cable is cut.
    """

    def __init__(self, ends: list[int], seed: int = 1) -> None:
        self.ends = ends
        self.delay = 0.0
        self.jitter = 0.0
        self.loss = 0.0
        self.up = True
        self.counts = {name: [0, 0] for name in ("frames", "lost", "ipv4")}
        self.latest = 0.0
        self._random = random.Random(seed)
        self._under_way: list[tuple[float, int, int, bytes]] = []
        self._number = 0

    def take(self, side: int) -> None:
        """Read what has come at one end."""
        for _ in range(BURST):
            try:
                frame = os.read(self.ends[side], FRAME)
            except BlockingIOError:
                return
            self.counts["frames"][side] += 1
            self.counts["ipv4"][side] += frame[12:14] == IPV4
            if not self.up or self._random.random() < self.loss:
                self.counts["lost"][side] += 1
                continue
            delay = max(0.0, self._random.gauss(self.delay, self.jitter))
            self._number += 1
            due = time.monotonic() + delay
            heapq.heappush(self._under_way, (due, self._number, 1 - side, frame))

    def deliver(self) -> float:
        """Write what is due; s until the next is, at most a tenth."""
        while self._under_way:
            now = time.monotonic()
            due, _, side, frame = self._under_way[0]
            if due > now:
                return min(0.1, due - now)
            heapq.heappop(self._under_way)
            self.latest = max(self.latest, now - due)
            try:
                os.write(self.ends[side], frame)
            except (BlockingIOError, OSError):
                self.counts["lost"][1 - side] += 1
        return 0.1


def obey(cable: Cable, line: str) -> str:
    """Change the cable as one line says; the answer."""
    for name, value in json.loads(line).items():
        setattr(cable, name, value)
    return json.dumps({**cable.counts, "latest (s)": round(cable.latest, 6)})


def main() -> None:
    """Relay until standard input ends."""
    cable = Cable([open_end(int(pid)) for pid in sys.argv[1:3]])
    print("up", flush=True)
    wait = 0.0
    while True:
        ready, _, _ = select.select([*cable.ends, sys.stdin], [], [], wait)
        for side, end in enumerate(cable.ends):
            if end in ready:
                cable.take(side)
        if sys.stdin in ready:
            line = sys.stdin.readline()
            if not line:
                return
            print(obey(cable, line), flush=True)
        wait = cable.deliver()


if __name__ == "__main__":
    main()
