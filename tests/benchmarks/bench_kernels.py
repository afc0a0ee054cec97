"""Distance of the native networks, and of other libraries, from the processor's limit.

GFLOP/s of one thread for the paper's actor (6-400-300-3) and for its largest product alone
(400 x 300): ours forward and backward, torch's float32 (MKL), oneDNN in float32 and in bfloat16,
and the limit, which is a loop of multiply-adds in registers. All take turns; medians and the best
turns are told, per second of processor time.

    python tests/benchmarks/bench_kernels.py [--batch 64 1024] [--turns 15] [--out FILE]
"""

from __future__ import annotations

import argparse
import ctypes
import json
import shlex
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from machine import machine

from bicycle_common.native_library import compiled
from bicycle_controller.agents.fused_net import Flat
from bicycle_controller.agents.native import FLAGS, NativeNet
from bicycle_controller.agents.networks import Actor
from bicycle_controller.training.run_folder import origin

RESULTS = Path(__file__).parent / "results" / "kernels.json"
TURN = 0.02
"""s that a turn lasts."""
PEAK = b"""
typedef float Vector __attribute__((vector_size(64)));
extern "C" float peak(long rounds) {
  Vector sum[12], x = {}, y = {};
  for (int i = 0; i < 16; i++) x[i] = 0.999f, y[i] = 0.001f;
  for (int k = 0; k < 12; k++) sum[k] = x * (float)k;
  for (long i = 0; i < rounds; i++)
#pragma GCC unroll 12
    for (int k = 0; k < 12; k++) sum[k] = sum[k] * x + y;
  float total = 0;
  for (int k = 0; k < 12; k++) total += sum[k][0];
  return total;
}
"""
ROUNDS = 10_000

Work = tuple[Callable[[], Any], float]
"""Work to do, and its number of additions and multiplications."""


def contestants(batch: int) -> dict[str, Work]:
    """Return all who take part, by name."""
    actor = Actor(6, [400, 300], 3)
    gradient = torch.zeros_like(Flat([actor], turned=False).values)
    net = NativeNet(actor, batch, gradient)
    seen, slope = torch.randn(batch, 6), torch.randn(batch, 3)
    whole = 2.0 * batch * (6 * 400 + 400 * 300 + 300 * 3)
    x, weight, bias = torch.randn(batch, 400), torch.randn(300, 400), torch.zeros(300)
    half, narrow = x.bfloat16(), weight.bfloat16()
    packed = [value.to_mkldnn() for value in (x, weight, bias)]
    product = 2.0 * batch * 400 * 300
    peak = ctypes.CDLL(str(compiled({"peak.cpp": PEAK}, FLAGS))).peak
    return {
        "limit": (lambda: peak(ctypes.c_long(ROUNDS)), 2.0 * 12 * 16 * ROUNDS),
        "ours, forward": (lambda: net.forward(seen), whole),
        "ours, backward": (lambda: net.backward(slope), 2.0 * whole),
        "MKL, float32": (lambda: torch.mm(x, weight.t()), product),
        "oneDNN, float32": (lambda: torch.ops.aten.mkldnn_linear(*packed), product),
        "oneDNN, bfloat16": (lambda: torch.mm(half, narrow.t()), product),
    }


def rate(work: Work) -> float:
    """GFLOP per second of processor time, over a turn."""
    call, size = work
    count, begun = 0, time.process_time()
    while (spent := time.process_time() - begun) < TURN:
        for _ in range(10):
            call()
        count += 10
    return 1e-9 * size * count / spent


def main() -> None:
    """Run, print and write the results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--batch", type=int, nargs="+", default=[64, 1024])
    parser.add_argument("--turns", type=int, default=15)
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    torch.set_num_threads(1)
    found: dict[str, Any] = {}
    for batch in args.batch:
        players = contestants(batch)
        turns: dict[str, list[float]] = {name: [] for name in players}
        for _ in range(args.turns):
            for name, work in players.items():
                turns[name].append(rate(work))
        found[f"batch {batch}"] = {
            name: {"median": round(statistics.median(each), 1), "best": round(max(each), 1)}
            for name, each in turns.items()
        }
    about = {"command": shlex.join(["python", *sys.argv]), "commit": origin()["commit"]}
    result = about | {"machine": machine("torch"), "unit": "GFLOP/s of one thread"} | found
    args.out.write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
