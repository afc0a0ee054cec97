"""The rows of updates/s in docs/performance.md, from the file that `bench_updates.py` writes.

python tests/benchmarks/updates_table.py [results/updates.json]
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).parent / "results" / "updates.json"
FILE = "[updates.json](../tests/benchmarks/results/updates.json)"
OURS = "ours, native"
SB3 = "stable-baselines3"
FUSED = f"{SB3}, fused Adam"
CLEAN = "CleanRL's style"
SBX = ("SBX, 1 a call", "SBX, 8 a call", "SBX, 160 a call")


def rows(results: dict[str, Any]) -> list[str]:
    """Return one line of the table of speeds for each batch."""
    return [_row(name.removeprefix("batch "), found) for name, found in results.items()]


def sentence(results: dict[str, Any]) -> str:
    """Return the comparison with SBX's best and stable-baselines3's best, medians of turns."""
    parts = [
        f"at batch {int(name.removeprefix('batch ')):,} {_times(found, SBX):.2f} times as many as"
        f" SBX's best and {_times(found, (SB3, FUSED)):.1f} times as many as stable-baselines3's"
        for name, found in results.items()
    ]
    return f"Ours, one a call, makes {'; '.join(parts)} (medians of turns)."


def _row(batch: str, found: dict[str, Any]) -> str:
    """Return the line of one batch size."""
    rate = {name: f"{row['updates_per_cpu_s']:,.0f}" for name, row in found["results"].items()}
    ours = f"{rate[OURS]}, one draw each; {rate[f'{OURS}, 8 from one draw']}, eight from one draw"
    peers = f"SBX {' / '.join(rate[name] for name in SBX)} at 1 / 8 / 160 updates a call"
    others = f"{SB3} {rate[FUSED]} with fused Adam, {rate[SB3]} without"
    style = f"{CLEAN} {rate[CLEAN]}"
    what = f"gradient updates/s, DDPG at the paper's sizes, batch {int(batch):,} ({FILE})"
    return f"| {what} | {ours} | {peers}; {others}; {style} |"


def _times(found: dict[str, Any], peers: tuple[str, ...]) -> float:
    """Return the least ratio of our updates to those of any of the peers."""
    return min(float(found["results"][OURS][f"times {name}"]) for name in peers)


if __name__ == "__main__":
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else RESULTS
    read = json.loads(path.read_text())
    print("\n".join([*rows(read), "", sentence(read)]))
