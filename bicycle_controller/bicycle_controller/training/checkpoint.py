"""Complete state of a run in one file, written atomically."""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bicycle_controller.policy.policy import write_atomically

VERSION = 2
"""Version of the file's layout; other versions are refused."""

_ARRAY = "__array__"


def save(path: Path, state: dict[str, Any]) -> None:
    """Write nested dictionaries, lists, tensors, arrays and plain values.

    Raises:
        OSError: if the file cannot be written; an older one is kept.
    """
    buffer = io.BytesIO()
    torch.save({"version": VERSION, "state": _packed(state)}, buffer)
    write_atomically(path, buffer.getvalue())


def load(path: Path) -> dict[str, Any]:
    """Read the state that `save` wrote, tensors on the CPU; nothing in the file is executed.

    Raises:
        ValueError: if it cannot be read, is damaged or has another version.
    """
    try:
        found = torch.load(path, map_location="cpu", weights_only=True)
        version = found["version"]
    except (OSError, RuntimeError, EOFError, KeyError, TypeError, pickle.UnpicklingError) as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise ValueError(
            f"cannot resume from {path}: {reason}; delete it to start again from config.yaml"
        ) from None
    if version != VERSION:
        raise ValueError(f"{path} has version {version}, not {VERSION}: resume it with its code")
    state: dict[str, Any] = _unpacked(found["state"])
    return state


def restore(path: Path, take: Callable[[dict[str, Any]], None]) -> None:
    """Pass the state in a file to `take`.

    Raises:
        ValueError: as `load`, or if the file lacks something that `take` needs.
    """
    state = load(path)
    try:
        take(state)
    except KeyError as error:
        commit = state.get("origin", {}).get("commit", "unknown")
        raise ValueError(
            f"{path} holds no {error}: it is of another version of this code (commit {commit}): "
            "resume it with its code, or delete it to start again from config.yaml"
        ) from None


def _packed(value: Any) -> Any:
    """Replace arrays by marked tensors, because the safe reader knows only tensors."""
    if isinstance(value, dict):
        return {key: _packed(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_packed(item) for item in value]
    if isinstance(value, np.ndarray):
        return {_ARRAY: torch.from_numpy(np.ascontiguousarray(value))}
    return value


def _unpacked(value: Any) -> Any:
    if isinstance(value, dict):
        if _ARRAY in value:
            return value[_ARRAY].numpy()
        return {key: _unpacked(item) for key, item in value.items()}
    return [_unpacked(item) for item in value] if isinstance(value, list) else value
