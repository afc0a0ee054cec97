"""Comparing two run folders to the bit."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bicycle_controller.policy.policy import load_policy
from bicycle_controller.training import checkpoint

CLOCKS = {"wall_s", "cpu_s"}


def rows(folder: Path) -> list[dict[str, Any]]:
    """Return the log without its clocks."""
    lines = (folder / "log.jsonl").read_text().splitlines()
    return [{k: v for k, v in json.loads(line).items() if k not in CLOCKS} for line in lines]


def state_of(folder: Path) -> dict[str, Any]:
    """Return the checkpoint without clocks and origin."""
    state = checkpoint.load(folder / "checkpoint" / "state.pt")
    return {k: v for k, v in state.items() if k not in ("spent", "origin", "log_bytes")}


def same(one: Any, other: Any) -> bool:
    """Return True if two nested states are equal to the bit."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, torch.Tensor):
        return one.dtype == other.dtype and torch.equal(one, other)
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    return type(one) is type(other) and one == other


def assert_same_run(one: Path, other: Path) -> None:
    """Logs, checkpoints and policies, all but clocks and origin."""
    assert rows(one) == rows(other)
    first, second = state_of(one), state_of(other)
    for key in first:
        assert same(first[key], second[key]), key
    for name in ("best.safetensors", "last.safetensors"):
        mine, theirs = (load_policy(folder / name).tensors for folder in (one, other))
        assert all(np.array_equal(mine[key], theirs[key]) for key in theirs)


def after(rounds: int) -> Callable[[], bool]:
    """Says stop at the given step of all bicycles."""
    left = iter(range(rounds))
    return lambda: next(left, None) is None
