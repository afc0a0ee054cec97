"""Export of a policy to ONNX, checked against numpy and torch.

The ONNX model includes the scaling: `observation` (N, n) float32 in SI units to `action` (N, 3)
float32 in N m, m and N; inputs and metadata as in the policy file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from bicycle_controller.policy.policy import NORM_EPSILON, Policy, write_atomically
from bicycle_controller.policy.policy_file import metadata

OPSET = 17
IR_VERSION = 8
"""IR version of ONNX 1.12 (2022), the first with LayerNormalization."""
TOLERANCE = 5e-5
"""Largest difference between two runtimes, as a share of the action limit."""


class ExportError(RuntimeError):
    """Two runtimes disagree about a policy, so nothing was written."""


def to_onnx(policy: Policy) -> onnx.ModelProto:
    """Return the policy with its scaling as an ONNX model."""
    tensors = policy.tensors
    count = sum(name.startswith("layer.") for name in tensors) // 2
    limits = np.array(policy.info.action_limits)
    constants = {"scale": np.array(policy.info.observation_scale), "limits": limits}
    constants |= tensors
    driven, width = limits > 0, len(policy.info.inputs)
    # Rows of zeros give the actions that the policy does not drive.
    for name in (f"layer.{count - 1}.weight", f"layer.{count - 1}.bias"):
        constants[name] = np.zeros((3, *tensors[name].shape[1:]))
        constants[name][driven] = tensors[name]
    nodes = [helper.make_node("Div", ["observation", "scale"], ["hidden.0"])]
    for index in range(count):
        nodes += _layer(index, index == count - 1, f"norm.{index}.weight" in tensors)
    nodes.append(helper.make_node("Mul", [f"hidden.{count}", "limits"], ["action"]))
    graph = helper.make_graph(
        nodes,
        policy.info.name,
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["N", width])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["N", 3])],
        [numpy_helper.from_array(v.astype(np.float32), n) for n, v in constants.items()],
    )
    opset = helper.make_opsetid("", OPSET)
    model = helper.make_model(graph, opset_imports=[opset], ir_version=IR_VERSION)
    helper.set_model_props(model, metadata(policy.info) | {"policy_id": policy.policy_id})
    onnx.checker.check_model(model, full_check=True)
    return model


def _layer(index: int, last: bool, norm: bool) -> list[onnx.NodeProto]:
    """Return the nodes from `hidden.{index}` to `hidden.{index + 1}`."""
    names = [f"hidden.{index}", f"layer.{index}.weight", f"layer.{index}.bias"]
    nodes = [helper.make_node("Gemm", names, [f"sum.{index}"], transB=1)]
    value = f"sum.{index}"
    if norm:
        names = [value, f"norm.{index}.weight", f"norm.{index}.bias"]
        value = f"normal.{index}"
        node = helper.make_node("LayerNormalization", names, [value], epsilon=NORM_EPSILON)
        nodes.append(node)
    nodes.append(helper.make_node("Tanh" if last else "Relu", [value], [f"hidden.{index + 1}"]))
    return nodes


def save_onnx(
    policy: Policy, path: Path, torch_actor: Any = None, seed: int = 0
) -> dict[str, float]:
    """Write the ONNX model if ONNX Runtime and numpy (and torch) agree on it.

    Args:
        policy: to be written.
        path: of the file; replaced atomically.
        torch_actor: anything with `answer` as in `TorchPolicy`; compared too if given.
        seed: of the observations compared.

    Returns:
        What `parity` returns.

    Raises:
        ExportError: if they disagree.
        OSError: if the file cannot be written.
    """
    data = to_onnx(policy).SerializeToString()
    differences = parity(policy, data, torch_actor, seed)
    write_atomically(path, data)
    return differences


def parity(
    policy: Policy, model: bytes, torch_actor: Any = None, seed: int = 0
) -> dict[str, float]:
    """Compare the runtimes on 4,096 rows of inputs, from far inside to far outside the scales.

    Returns:
        Largest difference from numpy by runtime, as a share of the action limit.

    Raises:
        ExportError: if one exceeds TOLERANCE.
    """
    spread = np.geomspace(0.01, 10.0, 4096)[:, None] * np.array(policy.info.observation_scale)
    inputs = np.random.default_rng(seed).normal(size=spread.shape) * spread
    answers = {"onnxruntime": _run_onnx(model, inputs)}
    if torch_actor is not None:
        answers["torch"] = torch_actor.answer(inputs)
    limits = np.array(policy.info.action_limits)
    differences = {}
    for name, answer in answers.items():
        error = np.abs(answer - policy.answer(inputs)) / np.where(limits > 0, limits, 1.0)
        differences[name] = float(error.max())
        if not error.max() <= TOLERANCE:
            raise ExportError(
                f"{name} and numpy differ by {error.max():.1e} of the limit about"
                f" {policy.policy_id}; nothing was written"
            )
    return differences


def _run_onnx(model: bytes, inputs: np.ndarray) -> np.ndarray:
    """Return ONNX Runtime's output, (N, 3)."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    (answer,) = session.run(["action"], {"observation": inputs.astype(np.float32)})
    return np.asarray(answer, dtype=np.float64)
