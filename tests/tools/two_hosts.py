"""Two hosts on one machine: each a network, a host name and a /dev/shm of its own, and a cable."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from node_process import NodeProcess
from numpy.typing import NDArray

from bicycle_bag import columns
from bicycle_bag.reader import BagReader

RELAY = Path(__file__).with_name("link_relay.py")
TOOLS = ("unshare", "nsenter", "mount", "ip", "hostname")


def forbidden() -> str:
    """Why there can be no such hosts here; nothing where there can."""
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    if missing:
        return f"no {', '.join(missing)} here"
    if os.geteuid() != 0:
        return "network namespaces need root"
    try:
        os.close(os.open("/dev/net/tun", os.O_RDWR))
    except OSError as error:
        return f"no TAP devices: /dev/net/tun: {error.strerror}"
    words = ["unshare", "--net", "--mount", "--uts", "ip", "link", "set", "lo", "up"]
    done = subprocess.run(words, capture_output=True, text=True)
    return f"no namespaces: {done.stderr.strip()}" if done.returncode else ""


class Host:
    """A place to run programs in.

    Args:
        name: the host's.
        address: IPv4 with its prefix length, such as `10.77.0.1/24`.
    """

    def __init__(self, name: str, address: str) -> None:
        self.name, self.address = name, address
        setup = (
            f"hostname {name} && mount -t tmpfs shm /dev/shm && ip link set lo up"
            " && echo ready && exec sleep infinity"
        )
        self._holder = NodeProcess(["unshare", "--net", "--mount", "--uts", "sh", "-c", setup])
        self._holder.wait_for_line("ready")

    @property
    def pid(self) -> int:
        """A process of it."""
        return self._holder.pid

    def words(self, command: Sequence[object]) -> list[str]:
        """Return the command that runs `command` there."""
        enter = ["nsenter", "--target", str(self.pid), "--net", "--mount", "--uts"]
        return [*enter, *(str(word) for word in command)]

    def run(self, *command: object) -> str:
        """Run something there to its end; its output."""
        done = subprocess.run(self.words(command), capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def start(self, *command: object, env: Mapping[str, str] | None = None) -> NodeProcess:
        """Start something there."""
        return NodeProcess(self.words(command), env)

    def plug_in(self) -> None:
        """Bring up the end of the cable."""
        for words in (
            ("ip", "address", "add", self.address, "dev", "eth0"),
            ("ip", "link", "set", "eth0", "up"),
            ("ip", "route", "add", "default", "dev", "eth0"),
        ):
            self.run(*words)

    def close(self) -> None:
        """End it; what runs there must have ended."""
        self._holder.kill()


class Cable:
    """Link of two hosts; `set` changes it. See link_relay.py."""

    def __init__(self, left: Host, right: Host) -> None:
        self._relay = subprocess.Popen(
            [sys.executable, str(RELAY), str(left.pid), str(right.pid)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._answer() == "up"
        left.plug_in()
        right.plug_in()

    def _answer(self) -> str:
        assert self._relay.stdout is not None
        return self._relay.stdout.readline().strip()

    def set(self, **changes: float | bool) -> dict[str, Any]:
        """Change `delay` and `jitter` (s), `loss` (0 to 1) or `up`.

        Returns:
            `frames`, `ipv4` and `lost` so far, each as sent by the left and the right host.
        """
        assert self._relay.stdin is not None
        self._relay.stdin.write(json.dumps(changes) + "\n")
        self._relay.stdin.flush()
        counted: dict[str, Any] = json.loads(self._answer())
        return counted

    def cut(self) -> None:
        """Nothing passes from now on."""
        self.set(up=False)

    def heal(self) -> None:
        """All passes again."""
        self.set(up=True)

    def close(self) -> None:
        """Take the cable away."""
        self._relay.kill()
        self._relay.wait()


def command_ages(bag: BagReader) -> NDArray[np.float64]:
    """Return the age of the answered state at each command's arrival, s.

    The bag must have been recorded beside the simulator: both times are the recorder's.
    """
    loaded = columns.load_topics(bag, ["/bicycle/state", "/bicycle/command"])
    states, commands = loaded["/bicycle/state"], loaded["/bicycle/command"]
    state_times: dict[tuple[int, int], float] = {}
    for episode, step, time in zip(
        states["episode"], states["step"], states["log_time"], strict=True
    ):
        state_times.setdefault((int(episode), int(step)), float(time))
    answered = zip(commands["episode"], commands["step"], commands["log_time"], strict=True)
    return np.array(
        [
            time - state_times[int(episode), int(step)]
            for episode, step, time in answered
            if (int(episode), int(step)) in state_times
        ]
    )
