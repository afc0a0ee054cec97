"""A controller in an ONNX file, run by ONNX Runtime: what `bicycle export` writes, or your own.

A file of `bicycle export` or `bicycle import` says everything about itself. Another one has one
input, float32 (N, 6) in the order of OBSERVATION_FIELDS, and one output, and may say in its
metadata, as JSON:

    observation_scale   six divisors of the observation (default: SI units)
    action_limits       largest |T| N m, |d| m and |F| N; the output (N, k) are then shares, -1..1,
                        of those above zero (default: the output is (N, 3) in N m, m and N)
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_common import json_input
from bicycle_common.observation import OBSERVATION_FIELDS
from bicycle_controller.control.past import Past
from bicycle_controller.policy.inputs import Inputs
from bicycle_controller.policy.policy_file import (
    FORMAT,
    MAX_FILE_BYTES,
    PolicyError,
    PolicyInfo,
    info_of,
)


class OnnxPolicy:
    """A controller as `Controller` has it.

    Attributes:
        info: what the file says of its scenario, plant and limits; None if it is not ours.
        action_limits: (3,) N m, m, N; infinite if the file does not say.
        inputs: what it sees.
    """

    def __init__(self, data: bytes, name: str) -> None:
        """Read the model.

        Raises:
            PolicyError: if ONNX Runtime is missing or cannot load it, or it is no controller.
        """
        try:
            import onnxruntime
        except ModuleNotFoundError:
            raise PolicyError(
                "an ONNX file needs onnxruntime, which is not installed: run 'ros2_ws/setup.sh "
                "--with train', or 'pip install onnxruntime'"
            ) from None
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.log_severity_level = 4
        try:
            self._session = onnxruntime.InferenceSession(
                data, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:
            reason = " ".join(str(error).split())[:200]
            raise PolicyError(f"ONNX Runtime cannot load it ({reason})") from None
        said = self._session.get_modelmeta().custom_metadata_map
        ours = said.get("format") == FORMAT
        self.info: PolicyInfo | None = info_of(dict(said)) if ours else None
        self.inputs = Inputs(OBSERVATION_FIELDS if self.info is None else self.info.inputs)
        scale = None if ours else _numbers(said, "observation_scale", 6)
        limits = None if ours else _numbers(said, "action_limits", 3)
        self._scale = np.ones(6) if scale is None else scale
        self._limits = limits
        self.action_limits = np.full(3, np.inf) if limits is None else limits
        if self.info is not None:
            self.action_limits = np.array(self.info.action_limits)
        word = re.sub(r"[^A-Za-z0-9._-]", "-", name if self.info is None else self.info.name)
        self.policy_id = f"{word[:64]}@{hashlib.sha256(data).hexdigest()[:10]}"
        self._check()

    def _check(self) -> None:
        """Refuse what takes or gives something else; answer once, which takes longest."""
        takes, gives = self._session.get_inputs(), self._session.get_outputs()
        width = len(self.inputs.names)
        wanted = f"it must take float32 (N, {width}) and give (N, 3) or its own actions"
        good = len(takes) == 1 and takes[0].type == "tensor(float)" and gives
        good = good and len(takes[0].shape) == 2 and takes[0].shape[1] in (width, None, "")
        if not (good or (len(takes) == 1 and isinstance(takes[0].shape[-1], str))):
            shapes = ", ".join(f"{one.name} {one.type} {one.shape}" for one in takes)
            raise PolicyError(f"{wanted}; it takes {shapes}")
        self._input, self._output = takes[0].name, gives[0].name
        self._one_by_one = isinstance(takes[0].shape[0], int)
        try:
            found = self._run(np.zeros((1, width), dtype=np.float32))
        except Exception as error:
            reason = " ".join(str(error).split())[:200]
            raise PolicyError(f"{wanted}; ONNX Runtime says: {reason}") from None
        count = 3 if self._limits is None else int((self._limits > 0).sum())
        if found.shape != (1, count):
            raise PolicyError(
                f"it gives {found.shape} for one bicycle, not (1, {count}): actions in N m, m and "
                "N, or shares of the metadata's action_limits"
            )

    def __reduce__(self) -> tuple[Any, ...]:
        """Refuse to be copied: a session cannot be."""
        raise TypeError("an ONNX policy cannot be pickled; give its file to the other process")

    @property
    def memory(self) -> int:
        """Number of past control periods that it sees, see `Controller`."""
        return self.inputs.memory

    @property
    def plant_parameters(self) -> tuple[str, ...]:
        """Names of the bicycle's parameters among its inputs, see `Controller`."""
        return self.inputs.plant_parameters

    def _run(self, inputs: np.ndarray) -> np.ndarray:
        (found,) = self._session.run([self._output], {self._input: inputs})
        return np.asarray(found, dtype=np.float64)

    def act(
        self,
        observation: np.ndarray,
        speed: np.ndarray | None = None,
        past: Past | None = None,
    ) -> np.ndarray:
        """Return the actions (N, 3) in N m, m and N of N bicycles; see `Policy.act`."""
        seen = self.inputs.gather(observation, speed, past)
        if self.info is None:
            seen = seen / self._scale
        seen = seen.astype(np.float32)
        if self._one_by_one and len(seen) != 1:
            found = np.concatenate([self._run(row[None]) for row in seen])
        else:
            found = self._run(seen)
        if self._limits is None:
            return found
        action = np.zeros((len(found), 3))
        driven = self._limits > 0
        action[:, driven] = np.clip(found, -1.0, 1.0) * self._limits[driven]
        return action


def _numbers(said: dict[str, str], name: str, count: int) -> np.ndarray | None:
    """Return numbers of the metadata, None if they are not there."""
    if name not in said:
        return None
    try:
        values = np.asarray(json_input.parse(said[name]), dtype=float)
    except (ValueError, TypeError):
        values = np.empty(0)
    good = values.shape == (count,) and np.isfinite(values).all() and (values >= 0).all()
    if not good or not values.any() or (name == "observation_scale" and not values.all()):
        raise PolicyError(f"its metadata's {name} must be a JSON list of {count} numbers")
    return values


def load_onnx(path: Path) -> OnnxPolicy:
    """Load an ONNX file.

    Raises:
        PolicyError: one line with the remedy, for every failure.
    """
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise PolicyError(f"it is too large for a policy: more than {MAX_FILE_BYTES} bytes")
        return OnnxPolicy(path.read_bytes(), path.stem)
    except OSError as error:
        raise PolicyError(f"cannot read policy {str(path)!r}: {error.strerror}") from None
    except PolicyError as error:
        raise PolicyError(f"cannot load policy {str(path)!r}: {error}") from None
