"""Deterministic actor for the control loop: no torch, a few microseconds.

An observation in SI units is divided by the policy's scale, passed through fully connected
layers (relu, with layer normalisation before it where the file has one; tanh at the end) in
single precision, and the outputs are multiplied by the action limits (errata row 35).
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bicycle_common.validation import nearest
from bicycle_controller.control.past import Past
from bicycle_controller.policy.inference import forward_pass
from bicycle_controller.policy.inputs import Inputs
from bicycle_controller.policy.policy_file import (
    MAX_FILE_BYTES,
    PolicyError,
    PolicyInfo,
    Tensors,
    check_tensors,
    decode,
    encode,
)
from bicycle_sim.plants.base import Plant

if TYPE_CHECKING:
    from bicycle_controller.control.controller import Controller

__all__ = [
    "DEFAULT_POLICY",
    "LQR",
    "Policy",
    "PolicyError",
    "PolicyInfo",
    "load_controller",
    "load_policy",
    "save_policy",
    "shipped_policies",
]

DEFAULT_POLICY = "fixed-speed"
"""Shipped policy that is used if none is named."""

LQR = ("lqr", "lqr-displacement", "lqr-pedal", "lqr-displacement-pedal", "lqr-20cm")
"""Names of the classical controller, by its actions beside the handlebar.

The displacement is 2 cm at most, except in the last, which needs a scenario that allows 20.
"""

SUFFIX = ".safetensors"
BEST = "best.safetensors"
KEPT = "policies"
"""Folder in a run of the policies that were kept during training, named by their updates."""
"""File name of the best policy in a training run's folder."""
CHUNK = 256
"""Bicycles per pass through the network: both hidden layers fit the cache."""
NORM_EPSILON = 1e-5
"""Added to the variance in layer normalisation, as torch does."""


class Policy:
    """A deterministic actor; its buffers are reused, so one thread at a time may call `act`.

    Attributes:
        info: scenario, plant, scaling and origin.
        inputs: what it sees.
        tensors: the weights by their names in the file, float32.
    """

    def __init__(self, info: PolicyInfo, tensors: Tensors, digest: str | None = None) -> None:
        """Build the network.

        Args:
            info: meaning of the weights.
            tensors: see `policy_file`.
            digest: sha256 of the source file; if None, of the file that would be written.

        Raises:
            PolicyError: if the tensors do not form a network for `info`.
        """
        self.info = info
        self.inputs = Inputs(info.inputs)
        self.tensors = tensors
        self._digest = digest
        count = check_tensors(info, tensors)
        self._layers = [_layer(tensors, index) for index in range(count)]
        # Rows of zeros for undriven actions give the output (T, d, F) without a copy.
        driven = np.array(info.action_limits) > 0
        self._layers[-1] = tuple(_rows(array, driven) for array in self._layers[-1])
        self._scale = np.array(info.observation_scale)[:, None]
        self._limits = np.array(info.action_limits)
        widths = [len(info.inputs), *(layer[0].shape[0] for layer in self._layers)]
        self._memory = [np.zeros(width * CHUNK, dtype=np.float32) for width in widths]
        self._one = forward_pass(self._layers, self._scale[:, 0], self._limits, NORM_EPSILON)

    def __reduce__(self) -> tuple[object, ...]:
        """Return the constructor arguments, so that a policy can be copied and pickled."""
        return Policy, (self.info, self.tensors, self._digest)

    @property
    def name(self) -> str:
        """Short name of the policy."""
        return self.info.name

    @cached_property
    def policy_id(self) -> str:
        """Id `NAME@DIGEST`, with the first ten hexadecimal digits of the file's sha256."""
        digest = self._digest or hashlib.sha256(encode(self.info, self.tensors)).hexdigest()
        return f"{self.info.name}@{digest[:10]}"

    @property
    def memory(self) -> int:
        """Number of past control periods that it sees, see `Controller`."""
        return self.inputs.memory

    @property
    def plant_parameters(self) -> tuple[str, ...]:
        """Names of the bicycle's parameters among its inputs, see `Controller`."""
        return self.inputs.plant_parameters

    def act(
        self,
        observation: np.ndarray,
        speed: np.ndarray | None = None,
        past: Past | None = None,
    ) -> np.ndarray:
        """Choose the actions of N bicycles.

        Rows are independent of each other, but their last digits depend on the number of rows.

        Args:
            observation: (N, 6) SI units, see OBSERVATION_FIELDS.
            speed: (N,) m/s; ignored by a policy of the paper's six states.
            past: of the N rides, for a policy with memory; without, they begin now.

        Returns:
            (N, 3) N m, m and N, see ACTION_FIELDS; within the limits, or NaN for an observation
            with NaN.

        Raises:
            ValueError: if the shape is not (N, 6), or something that it sees is missing.
        """
        if observation.ndim != 2 or observation.shape[1] != 6:
            raise ValueError(f"observation must have shape (N, 6), not {observation.shape}")
        return self.answer(self.inputs.gather(observation, speed, past))

    def answer(self, inputs: np.ndarray) -> np.ndarray:
        """Return the actions (N, 3) for inputs (N, n), both in physical units; see `act`."""
        count = len(inputs)
        if count == 1:
            return self._one(inputs)
        action = np.empty((count, 3))
        for first in range(0, count, CHUNK):
            rows = inputs[first : first + CHUNK]
            action[first : first + CHUNK] = self._forward(rows, self._buffers(len(rows)))
        return action

    def _buffers(self, count: int) -> list[np.ndarray]:
        """Return buffers for the input and every layer's output, (width, count) each."""
        return [flat[: flat.size // CHUNK * count].reshape(-1, count) for flat in self._memory]

    def _forward(self, seen: np.ndarray, buffers: list[np.ndarray]) -> np.ndarray:
        """Return (n, 3) actions; bicycles are columns."""
        inputs = np.divide(seen.T, self._scale, out=buffers[0], casting="same_kind")
        for layer, outputs in zip(self._layers, buffers[1:], strict=True):
            np.dot(layer[0], inputs, out=outputs)
            np.add(outputs, layer[1], out=outputs)
            if layer is self._layers[-1]:
                break
            if len(layer) == 4:
                _normalise(outputs, layer[2], layer[3])
            np.maximum(outputs, 0.0, out=outputs)
            inputs = outputs
        return np.tanh(outputs).T * self._limits


def _layer(tensors: Tensors, index: int) -> tuple[np.ndarray, ...]:
    """Return weight (out, in), bias (out, 1) and, with a norm, its weight and bias (out, 1)."""
    names = (f"layer.{index}.bias", f"norm.{index}.weight", f"norm.{index}.bias")
    columns = [tensors[name][:, None] for name in names if name in tensors]
    weight = np.ascontiguousarray(tensors[f"layer.{index}.weight"])
    if len(columns) == 1:
        return weight, columns[0]
    # The mean that the norm subtracts is linear in the inputs, so it is subtracted here once.
    return _centred(weight), _centred(columns[0]), *columns[1:]


def _centred(array: np.ndarray) -> np.ndarray:
    """Return `array` minus the mean of its rows, computed in double precision."""
    return (array - array.mean(axis=0, dtype=np.float64)).astype(np.float32)


def _rows(array: np.ndarray, driven: np.ndarray) -> np.ndarray:
    """Place `array` in the rows where `driven` holds, zeros in the others."""
    whole = np.zeros((len(driven), array.shape[1]), dtype=np.float32)
    whole[driven] = array
    return whole


def _normalise(values: np.ndarray, weight: np.ndarray, bias: np.ndarray) -> None:
    """Normalise every column of (width, n), whose mean is already zero, in place."""
    variance = np.einsum("ij,ij->j", values, values) / len(values)
    values *= 1.0 / np.sqrt(variance + np.float32(NORM_EPSILON))
    values *= weight
    values += bias


def shipped_policies() -> list[str]:
    """Return the names of the shipped policies."""
    folder = resources.files("bicycle_controller") / "models"
    if not folder.is_dir():
        return []
    found = (item.name for item in folder.iterdir())
    return sorted(name.removesuffix(SUFFIX) for name in found if name.endswith(SUFFIX))


def load_controller(
    name_or_path: str | Path,
    plant: Plant[Any] | None = None,
    torque_limit: float | None = None,
    may_import: bool = True,
) -> Controller:
    """Return any controller, by its name or file.

    Args:
        name_or_path: one of the names LQR, what `load_policy` takes, an ONNX file (see
            `onnx_policy`), or a class of one's own (see `own_controller`).
        plant: what a classical controller is designed for; the paper's bicycle by default.
        torque_limit: N m of its torque on another bicycle; the motor's by default.
        may_import: False refuses `module:Class`, which would run any code that Python finds.

    Raises:
        PolicyError: as `load_policy`.
    """
    text = os.fspath(name_or_path)
    if text not in LQR:
        return _loaded(text, may_import)
    # Imported here: it needs scipy, which a policy does not.
    from bicycle_controller.control.lqr import LqrController

    return LqrController.named(str(name_or_path), plant, torque_limit)


def _loaded(text: str, may_import: bool) -> Controller:
    """Return a controller that is not classical; see `load_controller`."""
    if text in shipped_policies() or _is_file(Path(text, BEST)):
        return load_policy(text)
    if text.endswith(".onnx") and _is_file(Path(text)):
        from bicycle_controller.policy.onnx_policy import load_onnx

        return load_onnx(Path(text))
    if not _is_file(Path(text)):
        from bicycle_controller.policy import own_controller

        if not may_import and own_controller.is_class(text):
            raise PolicyError(
                f"{text!r} runs code of yours: give it to the parameter policy at the start, or "
                f"install it as an entry point of {own_controller.GROUP}"
            )
        found = own_controller.load_own(text)
        if found is not None:
            return found
    return load_policy(text)


def load_policy(name_or_path: str | Path = DEFAULT_POLICY) -> Policy:
    """Load a shipped policy by its name, a policy file, or the best one of a run's folder.

    Raises:
        PolicyError: one line with the remedy, for every error in the name or the file.
    """
    text = os.fspath(name_or_path)
    shipped = shipped_policies()
    if text in shipped:
        item = resources.files("bicycle_controller") / "models" / f"{text}{SUFFIX}"
        data = item.read_bytes()
    else:
        best = Path(text, BEST)
        data = _read(best if _is_file(best) else Path(text), shipped)
    try:
        info, tensors = decode(data)
    except PolicyError as error:
        raise PolicyError(f"cannot load policy {text!r}: {error}") from None
    return Policy(info, tensors, hashlib.sha256(data).hexdigest())


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # the name is too long, or contains a null byte
        return False


def _read(path: Path, shipped: list[str]) -> bytes:
    """Return the bytes of a file; raise PolicyError if it is too large for a policy."""
    name, choices = repr(str(path)), f"shipped policies: {', '.join(shipped) or 'none'}"
    try:
        if not path.is_file():
            what = "is not a file" if path.exists() else "does not exist"
            hint = nearest(str(path), [*shipped, *LQR])
            raise PolicyError(
                f"policy {name} {what}{hint}; give a {SUFFIX} or .onnx file, module:Class, or an "
                f"installed controller; {choices}"
            )
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except (OSError, ValueError) as error:
        if isinstance(error, PolicyError):
            raise
        reason = getattr(error, "strerror", None) or error
        raise PolicyError(f"cannot read policy {name}: {reason}; {choices}") from None
    if len(data) > MAX_FILE_BYTES:
        raise PolicyError(f"{name} is too large for a policy: {MAX_FILE_BYTES} bytes; {choices}")
    return data


def save_policy(policy: Policy, path: str | Path) -> None:
    """Write a policy file atomically: a reader sees the old one or the new one, never a part.

    Raises:
        OSError: if the file cannot be written.
    """
    write_atomically(Path(path), encode(policy.info, policy.tensors))


def write_atomically(path: Path, data: bytes) -> None:
    """Write to a temporary name beside `path`, then rename.

    Raises:
        OSError: if that fails; the temporary file is removed.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
