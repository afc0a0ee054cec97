"""Age of the commands at the simulated microcontroller and at the driver, in rides in real time.

    python tests/benchmarks/bench_command_age.py

Each ride is a process group of its own, in its pace of 40 Hz: give it a machine with nothing else
to do. The ages are from the end of a period to the command that answers it, of the last 2000
commands, as `/diagnostics` in the ride's bag tells them at its end. Writes
`docs/results/hardware/command-age.json`.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from machine import machine
from rclpy.serialization import deserialize_message

from bicycle_bag.reader import BagReader
from bicycle_common.nodes import topics
from bicycle_common.origin import made_by

ROOT = Path(__file__).parents[2]
OUT = ROOT / "docs" / "results" / "hardware" / "command-age.json"
RIDE = (
    *("./ros2_ws/ride.sh", "--hardware-in-the-loop", "--goals", "2", "--seed", "3"),
    "simulator.pace:=realtime",
)
WHERE = {
    "microcontroller": ("bicycle_sim: microcontroller", "period to command at the board"),
    "driver": ("bicycle_driver: line", "period to command"),
}
"""Entry of the diagnostics, and the key in it."""


def ages(bag: Path) -> dict[str, dict[str, float]]:
    """Return median and 99 % (ms) of the last report of each entry of `WHERE`.

    Raises:
        KeyError: if the bag has no such report.
    """
    last: dict[str, dict[str, str]] = {}
    for one in BagReader(bag).messages([f"/{topics.DIAGNOSTICS.name.lstrip('/')}"]):
        for entry in deserialize_message(one.data, topics.DIAGNOSTICS.type).status:
            last[entry.name] = {value.key: value.value for value in entry.values}
    return {
        where: {f"p{part}_ms": float(last[entry][f"{key} p{part} (ms)"]) for part in (50, 99)}
        for where, (entry, key) in WHERE.items()
    }


def ridden(folder: Path) -> dict[str, Any]:
    """Make one ride into a folder; return its steps and ages.

    Raises:
        SystemExit: if the ride failed, with its last lines.
    """
    load = os.getloadavg()[0]
    done = subprocess.run(
        [*RIDE, "--output", str(folder)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        last = "\n".join((done.stdout + done.stderr).splitlines()[-20:])
        raise SystemExit(f"the ride ended with {done.returncode}:\n{last}")
    echoes = BagReader(folder / "bag").messages([f"/{topics.COMMAND_ECHO.name}"])
    steps = [deserialize_message(one.data, topics.COMMAND_ECHO.type).step for one in echoes]
    return {"load_before": load, "steps": max(steps), **ages(folder / "bag")}


def main() -> None:
    """Ride, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rides", type=int, default=5)
    parser.add_argument("--beside", default="nothing", help="other work of the machine, in words")
    parser.add_argument("--out", type=Path, default=OUT)
    given = parser.parse_args()
    result: dict[str, Any] = {
        **made_by(),
        "ride": shlex.join(RIDE),
        "beside": given.beside,
        "machine": machine(),
        "rides": [],
    }
    for _ in range(given.rides):
        with tempfile.TemporaryDirectory() as folder:
            result["rides"].append(ridden(Path(folder) / "run"))
        print(json.dumps(result["rides"][-1]), file=sys.stderr)
        given.out.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
