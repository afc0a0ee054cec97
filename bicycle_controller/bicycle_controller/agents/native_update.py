"""Whole updates of `FusedDdpg` in one call of `ddpg.h` each: draw, gradients, Adam, averages."""

from __future__ import annotations

import ctypes
import weakref
from dataclasses import dataclass

import torch
from torch import Tensor

from bicycle_controller.agents.fused_net import Flat
from bicycle_controller.agents.native import NativeNet, load
from bicycle_controller.agents.networks import Actor, Critic
from bicycle_controller.config.run import DdpgConfig

_PARTS = ("value", "gradient", "mean", "square", "slow")


class _Part(ctypes.Structure):
    """`Part` of ddpg.h."""

    _fields_ = (*((name, ctypes.c_void_p) for name in _PARTS), ("count", ctypes.c_int64))


class _Plan(ctypes.Structure):
    """`Plan` of ddpg.h."""

    _fields_ = (
        ("actor", ctypes.c_void_p),
        ("actor_target", ctypes.c_void_p),
        ("critics", ctypes.c_void_p * 2),
        ("critic_targets", ctypes.c_void_p * 2),
        ("acting", _Part),
        ("judging", _Part),
        ("average", ctypes.c_void_p),
        ("scale", ctypes.c_void_p),
        ("mirror", ctypes.c_void_p),
        *(
            (name, ctypes.c_int64)
            for name in ("critic_count", "batch", "seen", "inputs", "actions")
        ),
        *((name, ctypes.c_int64) for name in ("symmetric", "bounded", "wanted")),
        *((name, ctypes.c_double) for name in ("tau", "average_share")),
        *((name, ctypes.c_float) for name in ("reward_scale", "value_min", "huber", "clip")),
        *((name, ctypes.c_float) for name in ("saturation", "imitation", "alpha")),
    )


class _Turn(ctypes.Structure):
    """`Turn` of ddpg.h."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("table", "index", "sign", "noise")),
        ("width", ctypes.c_int64),
        *((name, ctypes.c_double) for name in ("judging_rate", "acting_rate")),
        *((name, ctypes.c_int64) for name in ("judging_steps", "acting_steps", "acts")),
        *((name, ctypes.c_float) for name in ("critic_loss", "q_data", "q_policy")),
    )


@dataclass(frozen=True)
class Moved:
    """Parameters that one Adam moves, as flat vectors of equal length."""

    values: Tensor
    gradient: Tensor
    mean: Tensor
    square: Tensor
    slow: Tensor
    """The same parameters of the target networks."""


@dataclass(frozen=True)
class Networks:
    """The networks of an agent; their parameters are views of `Moved`'s vectors."""

    actor: Actor
    critics: list[Critic]
    actor_target: Actor
    critic_targets: list[Critic]
    actor_average: Actor


class NativeUpdate:
    """Updates of one agent, whose parameters it uses in place."""

    def __init__(
        self, config: DdpgConfig, networks: Networks, acting: Moved, judging: Moved, scale: Tensor
    ) -> None:
        """Allocate the memory.

        Args:
            config: the agent's configuration.
            networks: the agent's networks.
            acting: the actor's parameters.
            judging: all critics' parameters, one after the other.
            scale: divisors of a critic's observations.

        Raises:
            RuntimeError: if the library is not available, or memory is exhausted.
        """
        library = load()
        if library is None:
            raise RuntimeError("the native update step could not be compiled here")
        actions = networks.actor.layers[-1].out_features
        assert isinstance(actions, int)
        sides = 2 if config.symmetric_actor else 1
        self._library, self._keep = library, (acting, judging, scale, networks)

        def held(net: Actor | Critic, gradient: Tensor | None, sides: int = 1) -> NativeNet:
            return NativeNet(net, config.batch, gradient, sides)

        count = len(networks.critics)
        parts = torch.chunk(judging.gradient, count)
        pairs = zip(networks.critics, parts, strict=True)
        critics = [held(net, part) for net, part in pairs]
        targets = [held(net, None) for net in networks.critic_targets]
        actor = held(networks.actor, acting.gradient, sides)
        actor_target = held(networks.actor_target, None, sides)
        self._nets = (actor, actor_target, *critics, *targets)
        average: Tensor | None = None
        if config.actor_average > 0:
            self._average = Flat([networks.actor_average], turned=False)
            average = self._average.values
        inputs = len(config.critic_scale)
        recorded = config.bc_to == "recorded"
        plan = _Plan(
            actor=actor.handle,
            actor_target=actor_target.handle,
            critics=(ctypes.c_void_p * 2)(*(net.handle for net in critics)),
            critic_targets=(ctypes.c_void_p * 2)(*(net.handle for net in targets)),
            acting=_part(acting),
            judging=_part(judging),
            average=None if average is None else average.data_ptr(),
            scale=scale.data_ptr(),
            mirror=networks.actor.mirror.data_ptr(),
            critic_count=count,
            batch=config.batch,
            seen=len(config.inputs),
            inputs=inputs,
            actions=actions,
            symmetric=config.symmetric_actor,
            bounded=config.bound_values,
            wanted=inputs if recorded else 2 * inputs + actions + 5,
            tau=config.tau,
            average_share=config.actor_average,
            reward_scale=config.reward_scale,
            value_min=config.value_min,
            huber=config.huber,
            clip=config.grad_clip,
            saturation=config.saturation_penalty,
            imitation=config.bc_weight,
            alpha=config.bc_alpha,
        )
        learner = library.learner_new(ctypes.byref(plan))
        if not learner:
            raise RuntimeError(f"no memory for native updates of batch {config.batch}")
        self._learner = ctypes.c_void_p(learner)
        weakref.finalize(self, library.learner_free, self._learner)
        self._turn = _Turn()

    def __call__(
        self,
        table: Tensor,
        index: Tensor,
        sign: Tensor | None,
        noise: Tensor | None,
        rates: tuple[float, float],
        steps: tuple[int, int],
        acts: bool,
    ) -> None:
        """Make one update.

        Args:
            table: (rows, width) float32 of the replay memory.
            index: (B,) int64, the rows drawn.
            sign: (B,) float32, -1 to mirror a transition; None for no mirroring.
            noise: (B, actions) float32 added to the target's action; None for none.
            rates: learning rates of the critics and of the actor.
            steps: updates of the critics and of the actor, this one included.
            acts: False if only the critics learn.
        """
        turn = self._turn
        turn.table, turn.index, turn.width = table.data_ptr(), index.data_ptr(), table.stride(0)
        turn.sign = None if sign is None else sign.data_ptr()
        turn.noise = None if noise is None else noise.data_ptr()
        turn.judging_rate, turn.acting_rate = rates
        turn.judging_steps, turn.acting_steps = steps
        turn.acts = acts
        self._library.learner_update(self._learner, ctypes.byref(turn))

    @property
    def notes(self) -> tuple[float, float, float]:
        """Loss of the first critic, and its mean values of recorded and of the actor's actions."""
        return self._turn.critic_loss, self._turn.q_data, self._turn.q_policy


def _part(moved: Moved) -> _Part:
    vectors = (moved.values, moved.gradient, moved.mean, moved.square, moved.slow)
    return _Part(*(vector.data_ptr() for vector in vectors), len(moved.values))
