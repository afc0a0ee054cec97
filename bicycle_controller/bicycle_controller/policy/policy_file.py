"""Policy file: safetensors with one actor's weights and everything needed to use them.

Tensors, float32: `layer.{i}.weight` (out, in), `layer.{i}.bias` (out,), and for a hidden layer
with layer normalisation `norm.{i}.weight` and `norm.{i}.bias` (out,). The metadata are strings;
all but the first three hold JSON:

    format              "bicycle-policy"
    version             "1", or "2" where something below needs it
    name                a short word, the first half of the policy's id
    observation_fields  version 1: must equal `bicycle_sim.task.task.OBSERVATION_FIELDS`
    inputs              version 2: names of the inputs, see `inputs.py`
    observation_scale   the inputs are divided by it, one positive number per input
    action_fields       must equal `bicycle_sim.task.task.ACTION_FIELDS`
    action_limits       the network's outputs, in -1..1, are multiplied by those above zero
    scenario, physics   what the policy was trained on; the latter is JSON of the plant
    plants              version 2: kinds of plant of which it rides any bicycle
    speeds              version 2: m/s, least and largest of its training, or null
    time_step           s between two actions
    trained             algorithm, seed, command, commit, steps, ...
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from bicycle_common.observation import ACTION_FIELDS, OBSERVATION_FIELDS
from bicycle_common.validation import one_line
from bicycle_controller.policy.inputs import Inputs
from bicycle_sim.plants import registry
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.scenario import Scenario

FORMAT = "bicycle-policy"
VERSIONS = ("1", "2")
MAX_HEADER_BYTES = 256 * 1024
MAX_FILE_BYTES = 64 * 1024 * 1024

Tensors = dict[str, np.ndarray]
"""Weights by the names above, float32."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


class PolicyError(ValueError):
    """A policy that cannot be used; the message is one line with the remedy."""

    def __init__(self, text: str = "") -> None:
        super().__init__(one_line(text))


@dataclass(frozen=True)
class PolicyInfo:
    """Description of a policy's weights.

    Raises:
        PolicyError: on an invalid name, scale or limit.
    """

    name: str
    scenario: Scenario
    plant: Plant[Any]
    observation_scale: tuple[float, ...]
    """A number above zero for each of `inputs`, in its unit."""
    action_limits: tuple[float, ...]
    """Largest |T| (N m), |d| (m) and |F| (N); zero for actions that the policy does not use."""
    trained: dict[str, Any] = field(default_factory=dict)
    inputs: tuple[str, ...] = OBSERVATION_FIELDS
    """Names, see `inputs.py`; the paper's six states by default."""
    plants: tuple[str, ...] = ()
    """Kinds of plant of which it was trained to ride any bicycle, within any limits; without
    one, it was trained for `plant` alone."""
    speeds: tuple[float, float] | None = None
    """m/s, least and largest of its training; None for those of the scenario."""

    def __post_init__(self) -> None:
        _check(
            isinstance(self.name, str) and _NAME.fullmatch(self.name) is not None,
            f"name {self.name!r} is not a word of letters, digits, '.', '_' and '-'",
        )
        for name in ("inputs", "plants"):
            words = getattr(self, name)
            good = isinstance(words, (list, tuple)) and all(isinstance(w, str) for w in words)
            _check(good, f"{name} must be a list of names")
            object.__setattr__(self, name, tuple(words))
        try:
            Inputs(self.inputs)
        except ValueError as error:
            raise PolicyError(f"{error}; update bicycle, or train it again") from None
        if self.speeds is not None:
            low, high = _numbers("speeds", self.speeds, 2)
            _check(0 < low <= high, "speeds must be above zero, the least first")
            object.__setattr__(self, "speeds", (low, high))
        for name, size in (("observation_scale", len(self.inputs)), ("action_limits", 3)):
            numbers = _numbers(name, getattr(self, name), size)
            object.__setattr__(self, name, numbers)
        _check(min(self.observation_scale) > 0, "observation_scale must be above zero")
        _check(
            min(self.action_limits) >= 0 and max(self.action_limits) > 0,
            "action_limits must be zero or more, and not all zero",
        )

    @property
    def outputs(self) -> int:
        """Number of actions that the network chooses: the limits above zero."""
        return sum(limit > 0 for limit in self.action_limits)


def _check(condition: bool, problem: str) -> None:
    if not condition:
        raise PolicyError(f"{problem}; write the file again with 'bicycle export'")


def _numbers(name: str, values: Any, size: int) -> tuple[float, ...]:
    """Return `size` finite floats, or raise PolicyError."""
    try:
        numbers = tuple(float(value) for value in values)
    except (TypeError, ValueError, OverflowError):
        numbers = ()
    good = len(numbers) == size and all(math.isfinite(number) for number in numbers)
    _check(good, f"{name} must be {size} finite numbers")
    return numbers


def metadata(info: PolicyInfo) -> dict[str, str]:
    """Return the file's metadata, see this module's docstring."""
    old = info.inputs == OBSERVATION_FIELDS and not info.plants and info.speeds is None
    inputs = {"observation_fields" if old else "inputs": json.dumps(info.inputs)}
    if not old:
        inputs |= {"plants": json.dumps(info.plants), "speeds": json.dumps(info.speeds)}
    return {
        "format": FORMAT,
        "version": VERSIONS[0] if old else VERSIONS[1],
        "name": info.name,
        **inputs,
        "observation_scale": json.dumps(info.observation_scale),
        "action_fields": json.dumps(ACTION_FIELDS),
        "action_limits": json.dumps(info.action_limits),
        "scenario": info.scenario.to_json(),
        "physics": info.plant.to_json(),
        "time_step": json.dumps(info.plant.time_step),
        "trained": json.dumps(info.trained, sort_keys=True),
    }


def encode(info: PolicyInfo, tensors: Tensors) -> bytes:
    """Return the file's bytes, equal for equal policies.

    Raises:
        PolicyError: if the tensors do not form a network for `info`.
    """
    check_tensors(info, tensors)
    ordered = {name: np.ascontiguousarray(tensors[name]) for name in sorted(tensors)}
    return _ordered_header(save(ordered, metadata(info)))


def _ordered_header(data: bytes) -> bytes:
    """Return the same file with its header's keys sorted: the library's order is random."""
    size = int.from_bytes(data[:8], "little")
    header = json.dumps(json.loads(data[8 : 8 + size]), sort_keys=True).encode()
    header += b" " * (-len(header) % 8)
    _check(len(header) <= MAX_HEADER_BYTES, f"metadata exceed {MAX_HEADER_BYTES} bytes")
    return len(header).to_bytes(8, "little") + header + data[8 + size :]


def decode(data: bytes) -> tuple[PolicyInfo, Tensors]:
    """Parse a policy file's bytes without running anything; memory stays near their size.

    Raises:
        PolicyError: on anything but a complete policy of this version for this bicycle.
    """
    header = _header(data)
    info = info_of(header.pop("__metadata__", None))
    kinds = {entry.get("dtype") for entry in header.values() if isinstance(entry, dict)}
    _check(kinds == {"F32"}, "its tensors are not all float32")
    try:
        tensors: Tensors = load(data)
    except (SafetensorError, ValueError, MemoryError) as error:
        raise PolicyError(f"it is damaged or cut short ({_line(error)}); copy it again") from None
    check_tensors(info, tensors)
    return info, tensors


def _header(data: bytes) -> dict[str, Any]:
    """Return the JSON header of safetensors bytes."""
    size = int.from_bytes(data[:8], "little")
    _check(len(data) > 8, "it is empty or cut short")
    if size > MAX_HEADER_BYTES and data.startswith((b"PK\x03\x04", b"\x80")):
        raise PolicyError(
            "it is a pickle or a PyTorch checkpoint, which is never opened; give the "
            ".safetensors file that 'bicycle train' writes beside it, or convert a "
            "stable-baselines3 .zip or a torch file with 'bicycle import'"
        )
    _check(0 < size <= MAX_HEADER_BYTES, "it is not a safetensors file, or its header is too big")
    _check(8 + size <= len(data), "it is cut short")
    try:
        header = json.loads(data[8 : 8 + size])
    except (ValueError, RecursionError):
        header = None
    _check(isinstance(header, dict), "its header is damaged")
    return dict(header)


def info_of(metadata: Any) -> PolicyInfo:
    """Return the policy info in a file's metadata.

    Raises:
        PolicyError: if they are not complete and of a known version.
    """
    _check(
        isinstance(metadata, dict) and metadata.get("format") == FORMAT,
        "it is a safetensors file, but not a bicycle policy",
    )
    version = metadata.get("version")
    if version not in VERSIONS:
        known = " or ".join(map(repr, VERSIONS))
        raise PolicyError(f"its format is version {version!r}, not {known}; update bicycle")
    fixed: dict[str, tuple[str, ...]] = {"action_fields": ACTION_FIELDS}
    if version == "1":
        fixed["observation_fields"] = OBSERVATION_FIELDS
    for name, expected in fixed.items():
        found = _json(metadata, name)
        _check(found == list(expected), f"its {name} are {found}, not {list(expected)}")
    new = {} if version == "1" else {n: _json(metadata, n) for n in ("inputs", "plants", "speeds")}
    trained = _json(metadata, "trained")
    _check(isinstance(trained, dict), "its 'trained' is not a mapping")
    info = PolicyInfo(
        name=metadata.get("name", ""),
        scenario=_config(metadata, "scenario", Scenario.from_json),
        plant=_config(metadata, "physics", registry.from_json),
        observation_scale=_json(metadata, "observation_scale"),
        action_limits=_json(metadata, "action_limits"),
        trained=trained,
        **new,
    )
    step = info.plant.time_step
    _check(_json(metadata, "time_step") == step, f"its time_step is not its plant's {step} s")
    return info


def _json(metadata: dict[str, Any], name: str) -> Any:
    try:
        return json.loads(metadata[name])
    except (KeyError, TypeError, ValueError, RecursionError):
        raise PolicyError(
            f"its {name} are missing or damaged; write the file again with 'bicycle export'"
        ) from None


def _config(metadata: dict[str, Any], name: str, made_of: Callable[[str], Any]) -> Any:
    """Build the object in the metadata of that name, or raise PolicyError."""
    try:
        return made_of(metadata[name])
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise PolicyError(
            f"its {name} cannot be read ({_line(error)}); write the file again with "
            "'bicycle export'"
        ) from None


def check_tensors(info: PolicyInfo, tensors: Tensors) -> int:
    """Return the number of layers of the network.

    Raises:
        PolicyError: if names, types, shapes or values do not form a network for `info`.
    """
    count = sum(name.startswith("layer.") and name.endswith(".weight") for name in tensors)
    _check(count > 0, "it has no layer.0.weight")
    width, expected = len(info.inputs), {}
    for index in range(count):
        weight = tensors.get(f"layer.{index}.weight")
        good = weight is not None and weight.ndim == 2 and weight.shape[1] == width
        _check(good, f"layer.{index}.weight must have shape (outputs, {width})")
        assert weight is not None
        width = weight.shape[0]
        expected[f"layer.{index}.weight"] = weight.shape
        expected[f"layer.{index}.bias"] = (width,)
        if index < count - 1 and f"norm.{index}.weight" in tensors:
            expected[f"norm.{index}.weight"] = expected[f"norm.{index}.bias"] = (width,)
    _check(width == info.outputs, f"it has {width} outputs for {info.outputs} actions")
    _check(set(tensors) == set(expected), f"its tensors are not {sorted(expected)}")
    for name, shape in expected.items():
        tensor = tensors[name]
        _check(tensor.shape == shape, f"{name} has shape {tensor.shape}, not {shape}")
        _check(tensor.dtype == np.float32, f"{name} is {tensor.dtype}, not float32")
        _check(bool(np.isfinite(tensor).all()), f"{name} holds a value that is not finite")
    return count


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
