"""Time of a byte there and back between two processes, over a pseudo-terminal and over a pipe.

    python tests/benchmarks/bench_pseudo_terminal.py

Both processes have the real-time priority of the loop's nodes; so what a pseudo-terminal takes
longer than a pipe is the kernel's. Writes `docs/results/hardware/pseudo-terminal.json`.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import time
import tty
from pathlib import Path
from typing import Any

from machine import machine

from bicycle_common.nodes.diagnostics import percentiles
from bicycle_common.nodes.realtime import Priority
from bicycle_common.origin import made_by

OUT = Path(__file__).parents[2] / "docs" / "results" / "hardware" / "pseudo-terminal.json"
PRIORITY = 10
BETWEEN = 0.01
"""s between two bytes."""


def pseudo_terminal() -> tuple[tuple[int, int], tuple[int, int]]:
    """Return two ends to read from and to write to."""
    master, slave = os.openpty()
    tty.setraw(slave)
    return (slave, slave), (master, master)


def pipes() -> tuple[tuple[int, int], tuple[int, int]]:
    """Return two ends to read from and to write to."""
    first, second = os.pipe(), os.pipe()
    return (first[0], second[1]), (second[0], first[1])


def there_and_back(ours: tuple[int, int], theirs: tuple[int, int], count: int) -> dict[str, float]:
    """Return median and 99 % of the time (ms) until another process has sent a byte back."""
    echo = os.fork()
    if echo == 0:
        while True:
            os.write(theirs[1], os.read(theirs[0], 1))
    times = []
    for _ in range(count):
        time.sleep(BETWEEN)
        begun = time.monotonic()
        os.write(ours[1], b"x")
        os.read(ours[0], 1)
        times.append(time.monotonic() - begun)
    os.kill(echo, signal.SIGKILL)
    os.waitpid(echo, 0)
    return percentiles(times, "there and back")


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000, help="bytes")
    parser.add_argument("--beside", default="nothing", help="other work of the machine, in words")
    parser.add_argument("--out", type=Path, default=OUT)
    given = parser.parse_args()
    result: dict[str, Any] = {
        **made_by(),
        "beside": given.beside,
        "machine": machine(),
        "priority": Priority().take(PRIORITY),
        "pseudo-terminal": there_and_back(*pseudo_terminal(), given.count),
        "pipe": there_and_back(*pipes(), given.count),
    }
    given.out.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
