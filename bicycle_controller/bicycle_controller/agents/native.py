"""`FusedNet` in C++, and the library that it shares with `native_update.py`; optional.

`native.cpp` is compiled once for the processor it runs on, into the user's cache. If that fails,
training uses torch, and one line says why.
"""

from __future__ import annotations

import ctypes
import functools
import subprocess
import sys
import weakref
from importlib import resources

import numpy as np
import torch
from torch import Tensor, nn

from bicycle_common.native_library import compiled, one_line
from bicycle_controller.agents.fused_net import gradient_views
from bicycle_controller.agents.networks import Actor, Critic, folded, linear_layers

FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-std=c++17", "-shared", "-fPIC")
SOURCES = ("native.cpp", "ddpg.h", "network.h", "gemm.h")


class _Layer(ctypes.Structure):
    """`Layer` of network.h."""

    _fields_ = (
        ("inputs", ctypes.c_int),
        ("outputs", ctypes.c_int),
        *((f"pointer_{index}", ctypes.c_void_p) for index in range(8)),
    )


class NativeNet:
    """Forward and backward pass of one network on the CPU, in one thread; see `FusedNet`.

    Attributes:
        handle: of the network in the library.
    """

    def __init__(
        self, network: Actor | Critic, batch: int, gradient: Tensor | None, sides: int = 1
    ) -> None:
        """Allocate the memory.

        Args:
            network: its parameters are used in place, so they must not be moved.
            batch: B.
            gradient: flat memory for `backward`; None for a network that is never trained.
            sides: 2 for `NativeUpdate` to have room for every transition's mirror image.

        Raises:
            RuntimeError: if the library is not available, or memory is exhausted.
        """
        library = load()
        if library is None:
            raise RuntimeError("the native update step could not be compiled here")
        self.gradient = gradient
        self.join = network.action_layer - 1 if isinstance(network, Critic) else -1
        layers = _layers(network, gradient)
        actions = layers[self.join].inputs - network.inputs if self.join == 0 else 0
        if self.join > 0:
            actions = layers[self.join].inputs - layers[self.join - 1].outputs
        self._keep = [item.data for item in network.parameters()]
        self.output = torch.empty(batch, layers[-1].outputs)
        self._action_slope = torch.empty(batch, actions)
        net = library.net_new(layers, len(layers), self.join, network.inputs, batch, sides)
        if not net:
            raise RuntimeError(f"no memory for a native network of batch {batch}")
        self.handle, self._library = ctypes.c_void_p(net), library
        weakref.finalize(self, library.net_free, self.handle)

    def forward(self, observation: Tensor, action: Tensor | None = None) -> Tensor:
        """Return (B, outputs) of scaled observations (B, inputs); a critic has actions (B, A)."""
        seen = observation.contiguous()
        acted = None if action is None else action.contiguous()
        self._library.net_forward(
            self.handle,
            seen.data_ptr(),
            None if acted is None else acted.data_ptr(),
            self.output.data_ptr(),
        )
        return self.output

    def backward(self, slope: Tensor) -> None:
        """Fill `gradient` from the loss's gradient in the output, (B, outputs)."""
        slope = slope.contiguous()
        self._library.net_backward(self.handle, slope.data_ptr())

    def action_slope(self, slope: Tensor) -> Tensor:
        """Return a critic's gradient in the action (B, A), from that in the output."""
        slope = slope.contiguous()
        self._library.net_action_slope(
            self.handle, slope.data_ptr(), self._action_slope.data_ptr()
        )
        return self._action_slope


class NativeAnswer:
    """Actions of an actor for many raw observations at once, as `answer.Answer` gives them.

    They differ from it by rounding. A forward pass takes 64 rows at a time, so for few bicycles
    torch is quicker.
    """

    def __init__(self, actor: Actor, scale: Tensor, count: int) -> None:
        """Allocate the memory for `count` bicycles.

        Args:
            actor: its parameters are used in place.
            scale: (inputs,) divisors of the observations.
            count: N.
        """
        self.count = count
        self._actor, self._scale = actor, scale
        self._net = NativeNet(actor, 2 * count if actor.symmetric else count, None)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Return normalised actions (N, actions) for raw observations (N, inputs)."""
        seen = torch.from_numpy(observation.astype(np.float32)) / self._scale
        with torch.no_grad():
            if self._actor.symmetric:
                return folded(self._net.forward(self._actor.both(seen))).tanh().numpy()
            return self._net.forward(seen).tanh().numpy()


def _layers(network: Actor | Critic, gradient: Tensor | None) -> ctypes.Array[_Layer]:
    """Return the network as an array of network.h's layers."""
    slopes: dict[str, Tensor] = {}
    if gradient is not None:
        slopes = gradient_views(network, gradient)
    norms = [norm for norm in network.norms if isinstance(norm, nn.LayerNorm)]
    layers = []
    for index, layer in enumerate(linear_layers(network)):
        pairs = [(f"layers.{index}.{name}", getattr(layer, name)) for name in ("weight", "bias")]
        normed = index < len(norms)
        if normed:
            both = ("weight", "bias")
            pairs += [(f"norms.{index}.{name}", getattr(norms[index], name)) for name in both]
        pointers: list[int | None] = []
        for first in range(0, len(pairs), 2):
            two = pairs[first : first + 2]
            pointers += [value.data.data_ptr() for _, value in two]
            pointers += [slopes[n].data_ptr() if slopes else None for n, _ in two]
        pointers += [None] * (8 - len(pointers))
        layers.append(_Layer(layer.in_features, layer.out_features, *pointers))
    return (_Layer * len(layers))(*layers)


@functools.cache
def load() -> ctypes.CDLL | None:
    """Return the compiled library, or None after one line on standard error."""
    package = resources.files("bicycle_controller.agents")
    try:
        sources = {name: package.joinpath(name).read_bytes() for name in SOURCES}
        library = ctypes.CDLL(str(compiled(sources, FLAGS)))
    except (OSError, subprocess.SubprocessError) as error:
        reason = one_line(error)
        print(f"the native update step is not used ({reason}): torch does it", file=sys.stderr)
        return None
    pointer, number = ctypes.c_void_p, ctypes.c_int
    library.net_new.argtypes = [ctypes.POINTER(_Layer)] + [number] * 5
    library.net_new.restype = pointer
    for name, count in (("free", 1), ("forward", 4), ("backward", 2), ("action_slope", 3)):
        function = getattr(library, f"net_{name}")
        function.argtypes, function.restype = [pointer] * count, None
    library.learner_new.argtypes, library.learner_new.restype = [pointer], pointer
    for name, count in (("free", 1), ("update", 2)):
        function = getattr(library, f"learner_{name}")
        function.argtypes, function.restype = [pointer] * count, None
    return library
