"""A fully connected actor that others have trained, and how it becomes a policy.

stable-baselines3's .zip and torch's files are read without running what they hold: weights by
torch's restricted loader, all else as text.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_common import json_input
from bicycle_controller.policy.policy import Policy
from bicycle_controller.policy.policy_file import PolicyError, PolicyInfo, metadata

HIDDEN = ("relu", "tanh")
OUTPUT = ("tanh", "clip")
_DENSE = {
    # Prefix of the layers' numbers, and the layer after the last of them.
    "td3": (r"actor\.mu\.(\d+)\.", None),
    "sac": (r"actor\.latent_pi\.(\d+)\.", "actor.mu"),
    "tqc": (r"actor\.latent_pi\.(\d+)\.", "actor.mu"),
    "ppo": (r"mlp_extractor\.policy_net\.(\d+)\.", "action_net"),
}
_ACTIVATIONS = {"ReLU": "relu", "Tanh": "tanh"}

Layers = list[tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class ForeignNetwork:
    """Layers of weight (out, in) and bias (out,), float32, and what follows them."""

    layers: Layers
    hidden: str
    """Activation of the hidden layers, one of HIDDEN."""
    output: str
    """Activation of the output, one of OUTPUT."""

    def __post_init__(self) -> None:
        width = 6
        for weight, bias in self.layers:
            if weight.ndim != 2 or bias.shape != weight.shape[:1] or weight.shape[1] != width:
                raise PolicyError(
                    f"its layers do not form a network of six observations: a weight of shape "
                    f"{weight.shape} follows a width of {width}"
                )
            width = len(bias)
        if not self.layers:
            raise PolicyError("it holds no fully connected layer")


def read(path: Path, hidden: str | None, output: str | None) -> ForeignNetwork:
    """Read a file of stable-baselines3 or torch.

    Args:
        path: a .zip of stable-baselines3, or a state dict (or TorchScript) of linear layers.
        hidden: activation of the hidden layers; None where the file says it.
        output: how the output comes into -1..1; None where the file says it.

    Raises:
        PolicyError: on anything else, in one line that says what can be read.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise PolicyError(f"cannot read {str(path)!r}: {error.strerror}") from None
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = archive.namelist()
            if "policy.pth" in names:
                return _of_sb3(archive, hidden, output)
            if any(name.endswith("constants.pkl") for name in names):
                return _of_dense(_script_weights(data), hidden or "relu", output or "tanh")
    except zipfile.BadZipFile:
        raise PolicyError(
            f"{str(path)!r} is neither a stable-baselines3 .zip nor a file of torch.save; an ONNX "
            "file needs no import"
        ) from None
    except KeyError as error:
        raise PolicyError(f"{str(path)!r} lacks {error}") from None
    return _of_dense(_weights(data), hidden or "relu", output or "tanh")


def _weights(data: bytes) -> dict[str, np.ndarray]:
    """Return the arrays of a state dict; torch refuses to run anything in it."""
    import torch

    try:
        found = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
        return {name: tensor.float().numpy() for name, tensor in found.items()}
    except Exception as error:
        reason = " ".join(str(error).split())[:160]
        raise PolicyError(
            f"torch cannot read it as weights alone ({reason}): save module.state_dict()"
        ) from None


def _script_weights(data: bytes) -> dict[str, np.ndarray]:
    """Return the arrays of a TorchScript module."""
    import torch

    module: Any = torch.jit.load(io.BytesIO(data), map_location="cpu")  # type: ignore[no-untyped-call]
    return {name: tensor.float().numpy() for name, tensor in module.state_dict().items()}


def _of_sb3(archive: zipfile.ZipFile, hidden: str | None, output: str | None) -> ForeignNetwork:
    said = json_input.parse(archive.read("data"))
    kind = str(said.get("policy_class", {}).get("__module__", ""))
    weights = _weights(archive.read("policy.pth"))
    found = next((name for name in ("td3", "sac", "tqc") if f".{name}." in f".{kind}."), "ppo")
    pattern, last = _DENSE[found]
    if any(".running_mean" in name for name in weights if name.startswith("actor.")):
        raise PolicyError("its actor has batch normalisation, which no policy file has: use ONNX")
    layers = _numbered(weights, pattern)
    if last is not None:
        layers.append((weights[f"{last}.weight"], weights[f"{last}.bias"]))
    written = str(said.get("policy_kwargs", {}).get("activation_fn", ""))
    named = re.search(r"activation\.(\w+)", written)
    default = "tanh" if found == "ppo" else "relu"
    known = _ACTIVATIONS.get(named[1]) if named else default
    if hidden is None and known is None:
        raise PolicyError(f"its activation is {written}; a policy has {' or '.join(HIDDEN)}")
    squashed = "clip" if found == "ppo" else "tanh"
    return ForeignNetwork(layers, hidden or known or default, output or squashed)


def _of_dense(weights: dict[str, np.ndarray], hidden: str, output: str) -> ForeignNetwork:
    if not weights or any(array.ndim not in (1, 2) for array in weights.values()):
        raise PolicyError("it holds more than linear layers: export the module as ONNX")
    prefix = sorted({name.rpartition(".")[0] for name in weights}, key=_by_number)
    layers = []
    for name in prefix:
        if f"{name}.weight" not in weights or f"{name}.bias" not in weights:
            raise PolicyError(f"{name} is no linear layer with a bias: export the module as ONNX")
        layers.append((weights[f"{name}.weight"], weights[f"{name}.bias"]))
    return ForeignNetwork(layers, hidden, output)


def _by_number(name: str) -> list[int | str]:
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def _numbered(weights: dict[str, np.ndarray], pattern: str) -> Layers:
    """Return the layers whose names match, in the order of their numbers."""
    numbers = sorted({int(m[1]) for name in weights if (m := re.match(pattern, name))})
    stem = re.sub(r"\\|\(.*", "", pattern)
    return [
        (weights[f"{stem}{number}.weight"], weights[f"{stem}{number}.bias"]) for number in numbers
    ]


def to_policy(network: ForeignNetwork, info: PolicyInfo) -> Policy | None:
    """Return it as a policy; None where a policy file has no such activation."""
    _check_outputs(network, info)
    if (network.hidden, network.output) != ("relu", "tanh"):
        return None
    tensors = {}
    for index, (weight, bias) in enumerate(network.layers):
        tensors[f"layer.{index}.weight"], tensors[f"layer.{index}.bias"] = weight, bias
    return Policy(info, {name: np.ascontiguousarray(a, "f4") for name, a in tensors.items()})


def to_onnx(network: ForeignNetwork, info: PolicyInfo) -> bytes:
    """Return it as an ONNX model with its scaling, which `onnx_policy` runs."""
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    _check_outputs(network, info)
    limits = np.array(info.action_limits)
    constants = {"scale": np.array(info.observation_scale), "limits": limits}
    nodes = [helper.make_node("Div", ["observation", "scale"], ["hidden.0"])]
    names = {"relu": "Relu", "tanh": "Tanh"}
    for index, (weight, bias) in enumerate(network.layers):
        last = index == len(network.layers) - 1
        if last:  # rows of zeros give the actions that it does not drive
            whole = np.zeros((3, weight.shape[1])), np.zeros(3)
            whole[0][limits > 0], whole[1][limits > 0] = weight, bias
            weight, bias = whole
        constants[f"weight.{index}"], constants[f"bias.{index}"] = weight, bias
        inputs = [f"hidden.{index}", f"weight.{index}", f"bias.{index}"]
        nodes.append(helper.make_node("Gemm", inputs, [f"sum.{index}"], transB=1))
        kind = network.output if last else network.hidden
        if kind == "clip":
            constants |= {"least": np.array(-1.0), "most": np.array(1.0)}
            limited = [f"sum.{index}", "least", "most"]
            nodes.append(helper.make_node("Clip", limited, [f"hidden.{index + 1}"]))
        else:
            nodes.append(helper.make_node(names[kind], [f"sum.{index}"], [f"hidden.{index + 1}"]))
    nodes.append(helper.make_node("Mul", [f"hidden.{len(network.layers)}", "limits"], ["action"]))
    graph = helper.make_graph(
        nodes,
        info.name,
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["N", 6])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["N", 3])],
        [numpy_helper.from_array(v.astype(np.float32), n) for n, v in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, metadata(info))
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString())


def _check_outputs(network: ForeignNetwork, info: PolicyInfo) -> None:
    count = len(network.layers[-1][1])
    if count != info.outputs:
        raise PolicyError(
            f"it gives {count} actions, but scenario {info.scenario.name} has {info.outputs}; "
            "give the scenario that it was trained on"
        )


def scale_of(text: str, named: dict[str, Sequence[float]]) -> tuple[float, ...]:
    """Return the observation scale of a name, or of six numbers with commas.

    Raises:
        ValueError: on anything else.
    """
    if text in named:
        return tuple(named[text])
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != 6 or min(values) <= 0:
        raise ValueError(
            f"the observation scale must be {', '.join(named)} or six numbers with commas between"
            f" them, not {text!r}"
        )
    return values
