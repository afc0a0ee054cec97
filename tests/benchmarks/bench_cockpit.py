"""Do browsers at the cockpit disturb the 40 Hz loop?

Simulator and controller run as nodes in real time and ride to a far goal. In turns there is no
cockpit, a cockpit without pages, and a cockpit with four: three that read and draw nothing, and
one that stalls, which opens its connection and never reads from it. Each turn's LoopTiming
messages are kept; percentiles are over all steps of all turns of a kind. The pages are processes
of their own and, like the cockpit, stand back behind the loop (nice 5). The load that others put
on the machine is told beside them.

    python tests/benchmarks/bench_cockpit.py [--turns 3] [--seconds 20] [--out FILE]

On a machine that others use too, `chrt -r 1` before it keeps them out of the figures; cockpit and
pages then compete with the loop on equal terms, which nice no longer decides.
"""

from __future__ import annotations

import asyncio
import json
import re
from pathlib import Path
from typing import Any

import aiohttp
from machine import machine
from timing_probe import TimingProbe, options, percentiles, ride, save, start, stop

from bicycle_controller.training.run_folder import origin

RESULTS = Path(__file__).parent / "results" / "cockpit.json"
PAGES = str(Path(__file__).parents[1] / "support" / "pages.py")
PORT = 8799
ADDRESS = f"http://127.0.0.1:{PORT}"
READERS = 3
START = 4.0
"""s for cockpit and pages to come up before a turn counts."""
KINDS = ("no cockpit", "no page", "four pages, one stalled")


async def dropped() -> int:
    """Frames that the pages never got, as the cockpit counts them."""
    async with aiohttp.ClientSession() as session:
        page = await session.ws_connect(f"{ADDRESS}/ws", origin=ADDRESS, max_msg_size=0)
        async for message in page:
            data = json.loads(message.data)
            if data["type"] == "status" and data["pages"] > READERS + 1:
                return int(data["dropped_frames"])
    return -1


def turn(probe: TimingProbe, seconds: float, kind: str) -> dict[str, Any]:
    """Take one turn of a kind."""
    cockpit, pages, lost = None, [], 0
    if kind != KINDS[0]:
        cockpit = start("-m", "bicycle_cockpit.nodes.cockpit", "--no-ride", "--port", str(PORT))
        assert cockpit.stdout is not None
        cockpit.stdout.readline()  # its address: it can be reached now
        probe.listen(START)
    if kind == KINDS[2]:
        pages = [start(PAGES, "read", ADDRESS) for _ in range(READERS)]
        pages.append(start(PAGES, "stall", ADDRESS))
        probe.listen(START)
    found = probe.hear(seconds)
    if pages:
        lost = asyncio.run(dropped())
    ends = [re.search(r"^(\d+)\s*$", stop(page), re.MULTILINE) for page in pages]
    frames = [int(end[1]) for end in ends if end]
    if cockpit is not None:
        stop(cockpit)
    return {**found, "frames": frames, "lost": lost}


def summary(turns: list[dict[str, Any]]) -> dict[str, Any]:
    """Percentiles over all turns of a kind, ms, and what came of the frames."""
    result = percentiles(turns)
    result["frames_of_each_reader"] = [found["frames"] for found in turns]
    result["frames_dropped_for_the_stalled"] = [found["lost"] for found in turns]
    return result


def main() -> None:
    args = options(__doc__, RESULTS, 20.0).parse_args()
    turns: dict[str, list[dict[str, Any]]] = {kind: [] for kind in KINDS}
    with ride() as probe:
        for _ in range(args.turns):
            for kind in KINDS:
                turns[kind].append(turn(probe, args.seconds, kind))
    result = {**origin(), "machine": machine("aiohttp")}
    result |= {kind: summary(found) for kind, found in turns.items()}
    save(args.out, result)


if __name__ == "__main__":
    main()
