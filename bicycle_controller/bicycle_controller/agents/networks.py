"""Actor and critic of section 4.1 of the paper (figure 7, Table 2), and state values."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

OUTPUT_RANGE = 3e-3
"""Half width of the uniform initialisation of output layers (Table 2, errata row 30)."""


class Actor(nn.Module):
    """Policy: observations to normalised actions.

    Attributes:
        layers: linear layers, `layer.{i}` in a policy file.
        norms: layer normalisations after each hidden layer's product, or none.
    """

    def __init__(
        self,
        inputs: int,
        hidden: Sequence[int],
        actions: int,
        layer_norm: bool = False,
        symmetric: bool = False,
        mirror: Sequence[float] | None = None,
    ) -> None:
        """Build it with torch's default initialisation; see `initialise`.

        Args:
            inputs: numbers per observation.
            hidden: units of each hidden layer.
            actions: numbers per action.
            layer_norm: True to follow each hidden product by a layer normalisation.
            symmetric: True to make left and right mirror images: the output is the mean of the
                network's answer and of the mirror image of its answer to the mirrored observation.
            mirror: 1 or -1 for each input: how a mirror changes it; it negates all by default.
        """
        super().__init__()
        self.inputs, self.symmetric = inputs, symmetric
        sides = torch.tensor([-1.0] * inputs if mirror is None else list(mirror))
        self.mirror: Tensor
        self.register_buffer("mirror", sides, persistent=False)
        sizes = [inputs, *hidden, actions]
        self.layers = nn.ModuleList(map(nn.Linear, sizes[:-1], sizes[1:]))
        self.norms = nn.ModuleList(nn.LayerNorm(size) for size in hidden if layer_norm)

    def features(self, observation: Tensor) -> Tensor:
        """Return the last hidden layer, (..., units), for scaled observations (..., inputs)."""
        x = observation
        for index, layer in enumerate(self.layers[:-1]):
            x = layer(x)
            x = torch.relu(self.norms[index](x) if self.norms else x)
        return x

    def raw(self, observation: Tensor) -> Tensor:
        """Return the input of tanh, (..., actions), for scaled observations (..., inputs)."""
        if not self.symmetric:
            return self.layers[-1](self.features(observation))
        return folded(self.layers[-1](self.features(self.both(observation))))

    def both(self, observation: Tensor) -> Tensor:
        """Return observations (B, inputs) and, below, what a mirror shows: (2B, inputs)."""
        return torch.cat([observation, observation * self.mirror])

    def forward(self, observation: Tensor) -> Tensor:
        """Return actions within [-1, 1], (..., actions), for scaled observations (..., inputs)."""
        return torch.tanh(self.raw(observation))


def folded(both: Tensor) -> Tensor:
    """Return a symmetric actor's output (B, actions) from its network's (2B,) [seen, mirrored]."""
    seen, mirrored = both.chunk(2)
    return 0.5 * (seen + _sides(both) * mirrored)


def unfolded(slope: Tensor) -> Tensor:
    """Return the gradient in `folded`'s input (2B, actions) from its output's (B, actions)."""
    return 0.5 * torch.cat([slope, _sides(slope) * slope])


def _sides(like: Tensor) -> Tensor:
    """Return -1 for actions that a mirror negates (torque, displacement), 1 for pedal force."""
    sides = torch.ones_like(like[0])
    sides[:2] = -1.0
    return sides


class Value(Actor):
    """Value of a state, V(s): an actor's layers with one output and no tanh."""

    def __init__(self, inputs: int, hidden: Sequence[int]) -> None:
        """Build it with torch's default initialisation.

        Args:
            inputs: numbers per observation, or per feature of another network.
            hidden: units of each hidden layer; an empty one makes it one linear layer.
        """
        super().__init__(inputs, hidden, 1)

    def forward(self, observation: Tensor) -> Tensor:
        """Return V (...,) for (..., inputs)."""
        return self.raw(observation).squeeze(-1)


class Critic(nn.Module):
    """Value of an action; the action enters at a hidden layer, the second one in the paper."""

    def __init__(
        self,
        inputs: int,
        hidden: Sequence[int],
        actions: int,
        action_layer: int = 2,
        layer_norm: bool = False,
    ) -> None:
        """Build it with torch's default initialisation; see `initialise`.

        Args:
            inputs: numbers per observation.
            hidden: units of each hidden layer.
            actions: numbers per action.
            action_layer: hidden layer at which the action enters; 1 is the first.
            layer_norm: True to follow each hidden product by a layer normalisation.
        """
        super().__init__()
        self.inputs = inputs
        self.action_layer = action_layer
        widths = [inputs, *hidden]
        widths[action_layer - 1] += actions
        self.layers = nn.ModuleList(map(nn.Linear, widths, [*hidden, 1]))
        self.norms = nn.ModuleList(nn.LayerNorm(size) for size in hidden if layer_norm)

    def forward(self, observation: Tensor, action: Tensor) -> Tensor:
        """Return Q (...,) for observations (..., inputs) and normalised actions (..., actions)."""
        x = observation
        for index, layer in enumerate(self.layers):
            if index == self.action_layer - 1:
                x = torch.cat([x, action], dim=-1)
            x = layer(x)
            if index < len(self.layers) - 1:
                x = torch.relu(self.norms[index](x) if self.norms else x)
        return x.squeeze(-1)


def linear_layers(network: Actor | Critic) -> list[nn.Linear]:
    """Return the network's linear layers, in order."""
    return [layer for layer in network.layers if isinstance(layer, nn.Linear)]


def initialise(network: Actor | Critic, scheme: str, generator: torch.Generator) -> None:
    """Initialise a network's parameters.

    Args:
        network: changed in place.
        scheme: `literal`, every parameter within 3e-3 (Table 2 as printed); `output`, Xavier
            weights with zero biases and only the output layer within 3e-3 (errata row 30);
            `fan_in`, hidden parameters within 1 / sqrt(inputs) (Lillicrap et al. 2016).
        generator: source of the numbers, on the CPU.
    """
    *_, last = layers = linear_layers(network)
    for layer in layers:
        weight_range = bias_range = OUTPUT_RANGE
        if layer is not last and scheme == "output":
            weight_range = math.sqrt(6.0 / (layer.in_features + layer.out_features))
            bias_range = 0.0
        elif layer is not last and scheme == "fan_in":
            weight_range = bias_range = 1.0 / math.sqrt(layer.in_features)
        with torch.no_grad():
            for parameter, limit in ((layer.weight, weight_range), (layer.bias, bias_range)):
                drawn = torch.rand(parameter.shape, generator=generator)
                parameter.copy_((2.0 * drawn - 1.0) * limit)


def policy_tensors(actor: Actor) -> dict[str, np.ndarray]:
    """Return copies of the actor's weights under the names of a policy file.

    A symmetric actor becomes a plain one of twice the width: its network beside its mirror image.
    """
    plain = {
        name.replace("layers.", "layer.").replace("norms.", "norm."): value.cpu().numpy().copy()
        for name, value in actor.state_dict().items()
    }
    if not actor.symmetric:
        return plain
    return _doubled(plain, len(actor.layers) - 1, actor.mirror.cpu().numpy())


def _doubled(
    tensors: dict[str, np.ndarray], last: int, mirror: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the tensors of the plain network that is equivalent to a symmetric one."""
    result = {}
    for index in range(last + 1):
        weight, bias = tensors[f"layer.{index}.weight"], tensors[f"layer.{index}.bias"]
        if index == last:
            sides = _sides(torch.zeros(1, len(bias))).numpy()
            weight = 0.5 * np.concatenate([weight, sides[:, None] * weight], axis=1)
            bias = 0.5 * (1.0 + sides) * bias
        else:
            blank = np.zeros_like(weight)
            halves = (
                [[weight], [weight * mirror]] if index == 0 else [[weight, blank], [blank, weight]]
            )
            weight, bias = np.block(halves), np.tile(bias, 2)
        result[f"layer.{index}.weight"], result[f"layer.{index}.bias"] = weight, bias
    return result


@torch.no_grad()
def blend(slow: Sequence[nn.Module], main: Sequence[nn.Module], share: float) -> None:
    """Blend `share` of the main networks' parameters into the slow ones, equations (16), (18)."""
    slow_values = [item.data for net in slow for item in net.parameters()]
    main_values = [item.data for net in main for item in net.parameters()]
    torch._foreach_lerp_(slow_values, main_values, share)
