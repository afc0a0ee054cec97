"""Multilayer perceptron with hand-written gradients on flat, preallocated memory.

It uses the parameters of an `Actor` or a `Critic`, which become views of one flat vector, so that
one call of Adam and one target update serve all of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from bicycle_controller.agents.networks import Actor, Critic, linear_layers

ATEN = torch.ops.aten
NARROW = 16
"""Largest number of inputs of a narrow layer, see `_views`."""


class Flat:
    """Parameters of several networks as views of one vector.

    Attributes:
        values: all parameters, network by network.
        sizes: number of parameters of each network.
    """

    def __init__(self, networks: Sequence[nn.Module], turned: bool) -> None:
        """Move the parameters of `networks` into one new vector; for `turned` see `_views`."""
        self.sizes = [sum(item.numel() for item in net.parameters()) for net in networks]
        device = next(networks[0].parameters()).device
        self.values = torch.zeros(sum(self.sizes), device=device)
        views = flat_views(networks, self.values, turned)
        for item, view in zip(_parameters(networks), views, strict=True):
            view.copy_(item.data)
            item.data = view


def flat_views(networks: Sequence[nn.Module], flat: Tensor, turned: bool) -> list[Tensor]:
    """Return `flat` in the shapes of the networks' parameters, in their order; see `_views`."""
    sizes = [sum(item.numel() for item in net.parameters()) for net in networks]
    parts = zip(networks, torch.split(flat, sizes), strict=True)
    return [view for net, part in parts for view in _views(net, part, turned)]


def _parameters(networks: Sequence[nn.Module]) -> list[nn.Parameter]:
    return [item for net in networks for item in net.parameters()]


def gradient_views(network: nn.Module, flat: Tensor, turned: bool = False) -> dict[str, Tensor]:
    """Return views of `flat` by the network's parameter names; for `turned` see `_views`."""
    names = [name for name, _ in network.named_parameters()]
    return dict(zip(names, _views(network, flat, turned), strict=True))


def _views(network: nn.Module, flat: Tensor, turned: bool) -> list[Tensor]:
    """Return `flat` in the shapes of the network's parameters, in their order.

    With `turned` the weight of a layer with few inputs is stored transposed: torch then computes
    the product for its gradient five times faster.
    """
    sizes = [item.numel() for item in network.parameters()]
    parts = torch.split(flat, sizes)
    shapes = [item.shape for item in network.parameters()]
    return [
        part.view(shape[::-1]).t() if turned and _is_narrow(shape) else part.view(shape)
        for part, shape in zip(parts, shapes, strict=True)
    ]


def _is_narrow(shape: Sequence[int]) -> bool:
    return len(shape) == 2 and shape[1] <= NARROW < shape[0]


class FusedNet:
    """Forward and backward pass of one network for batches of one size.

    Each pass reuses the same memory, so a result is valid until the next pass.

    Attributes:
        gradient: flat, in the order of the network's parameters; the last `backward`'s.
        output: (B, outputs) of the last `forward`, before any tanh.
    """

    def __init__(self, network: Actor | Critic, batch: int, gradient: Tensor | None) -> None:
        """Allocate the memory.

        Args:
            network: its parameters are used in place, so they must not be moved.
            batch: B.
            gradient: flat memory for `backward`; None for a network that is never trained.
        """
        self.network, self.batch = network, batch
        self.layers = linear_layers(network)
        self.norms = [norm for norm in network.norms if isinstance(norm, nn.LayerNorm)]
        self.join = network.action_layer - 1 if isinstance(network, Critic) else -1
        self.gradient = gradient
        if gradient is not None:
            self._grads = gradient_views(network, gradient, turned=True)
        device = self.layers[0].weight.device
        self._transposed = [layer.weight.detach().t() for layer in self.layers]
        self._weights = [layer.weight.detach() for layer in self.layers]
        self._biases = [layer.bias.detach() for layer in self.layers]
        self._inputs = [torch.empty(batch, w.shape[1], device=device) for w in self._weights]
        self._slopes = [torch.empty(batch, w.shape[1], device=device) for w in self._weights]
        hidden = [layer.out_features for layer in self.layers[:-1]]
        # A layer's output is written directly into the next one's input, left of the action.
        pairs = list(zip(self._inputs[1:], hidden, strict=True))
        self._hidden = [memory[:, :width] for memory, width in pairs]
        self._products = self._hidden
        if self.norms:
            self._products = [torch.empty(batch, width, device=device) for width in hidden]
        self._moments: list[tuple[Tensor, Tensor]] = []
        self.output = torch.empty(batch, self.layers[-1].out_features, device=device)

    def forward(self, observation: Tensor, action: Tensor | None = None) -> Tensor:
        """Return (B, outputs) of scaled observations (B, inputs); a critic has actions (B, A)."""
        if self.join == 0:
            self._inputs[0][:, : observation.shape[1]] = observation
        else:
            self._inputs[0] = observation
        if action is not None:
            self._inputs[self.join][:, -action.shape[1] :] = action
        self._moments.clear()
        last = len(self.layers) - 1
        for index, (bias, weight) in enumerate(zip(self._biases, self._transposed, strict=True)):
            target = self.output if index == last else self._products[index]
            torch.addmm(bias, self._inputs[index], weight, out=target)
            if index < last:
                if self.norms:
                    self._normalise(index)
                torch.relu_(self._hidden[index])
        return self.output

    def _normalise(self, index: int) -> None:
        norm = self.norms[index]
        result, mean, scale = torch.native_layer_norm(
            self._products[index],
            norm.normalized_shape,
            norm.weight.data,
            norm.bias.data,
            norm.eps,
        )
        self._hidden[index].copy_(result)
        self._moments.append((mean, scale))

    def backward(self, slope: Tensor) -> None:
        """Fill `gradient` from the loss's gradient in the output, (B, outputs)."""
        for index in range(len(self.layers) - 1, -1, -1):
            torch.mm(slope.t(), self._inputs[index], out=self._grads[f"layers.{index}.weight"])
            torch.sum(slope, 0, out=self._grads[f"layers.{index}.bias"])
            if index > 0:
                slope = self._through_hidden(slope, index, learn=True)

    def action_slope(self, slope: Tensor) -> Tensor:
        """Return a critic's gradient in the action (B, A), from that in the output."""
        for index in range(len(self.layers) - 1, self.join, -1):
            slope = self._through_hidden(slope, index, learn=False)
        before = self._hidden[self.join - 1].shape[1] if self.join > 0 else self.network.inputs
        columns = self._weights[self.join][:, before:]
        return torch.mm(columns.t().contiguous(), slope.t()).t()

    def _through_hidden(self, slope: Tensor, index: int, learn: bool) -> Tensor:
        """Propagate the gradient from layer `index`'s product to the product before it."""
        hidden = self._hidden[index - 1]
        width = hidden.shape[1]
        result = self._slopes[index][:, :width]
        torch.mm(slope, self._weights[index][:, :width], out=result)
        ATEN.threshold_backward.grad_input(result, hidden, 0.0, grad_input=result)
        if not self.norms:
            return result
        norm = self.norms[index - 1]
        mean, scale = self._moments[index - 1]
        back, weight, bias = ATEN.native_layer_norm_backward(
            result,
            self._products[index - 1],
            norm.normalized_shape,
            mean,
            scale,
            norm.weight.data,
            norm.bias.data,
            [True, learn, learn],
        )
        if learn:
            self._grads[f"norms.{index - 1}.weight"].copy_(weight)
            self._grads[f"norms.{index - 1}.bias"].copy_(bias)
        return back
