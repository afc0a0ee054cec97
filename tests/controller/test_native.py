from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from training_maker import small_ddpg

from bicycle_common import native_library
from bicycle_controller.agents import native
from bicycle_controller.agents.fused import FusedDdpg
from bicycle_controller.agents.fused_net import Flat, FusedNet
from bicycle_controller.agents.native import NativeNet
from bicycle_controller.agents.networks import Actor, Critic

compiled = pytest.mark.skipif(native.load() is None, reason="no C++ compiler here")


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[pytest.MonkeyPatch]:
    """Yield a machine that has compiled nothing yet."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    native.load.cache_clear()
    yield monkeypatch
    native.load.cache_clear()


# Seeded: a hidden unit that happens to be at its kink may round to either side.
torch.manual_seed(0)


@compiled
@pytest.mark.parametrize("batch", [1, 63, 64, 65, 200])
@pytest.mark.parametrize(
    "network",
    [
        Actor(6, [400, 300], 3),
        Actor(6, [17], 2, layer_norm=True),
        Critic(6, [200, 200], 3),
        Critic(6, [65, 33], 2, action_layer=1, layer_norm=True),
        Critic(6, [8, 70, 16], 1, action_layer=3, layer_norm=True),
    ],
    ids=["paper actor", "narrow", "paper critic", "first layer", "third layer"],
)
def test_every_size_gives_what_autograd_gives(network: Actor | Critic, batch: int) -> None:
    torch.manual_seed(batch)
    flat = Flat([network], turned=False)
    gradient = torch.full_like(flat.values, float("nan"))
    net = NativeNet(network, batch, gradient)
    observation = torch.randn(batch, 6)
    action = None
    if isinstance(network, Critic):
        action = torch.randn(batch, net.action_slope(torch.ones(batch, 1)).shape[1])
        action.requires_grad_(True)
        expected = network(observation, action).unsqueeze(1)
    else:
        expected = network.raw(observation)
    found = net.forward(observation, action)
    assert torch.allclose(found, expected, atol=1e-5)
    slope = torch.randn_like(found)
    names = [parameter for _, parameter in network.named_parameters()]
    wanted = names if action is None else [*names, action]
    slopes = torch.autograd.grad(expected, wanted, slope)
    net.backward(slope)
    size = max(float(each.abs().max()) for each in slopes)
    parts = torch.cat([each.flatten() for each in slopes[: len(names)]])
    assert torch.allclose(gradient, parts, atol=2e-6 * size)
    if action is not None:
        assert torch.allclose(net.action_slope(slope), slopes[-1], atol=2e-6 * size)


@compiled
@pytest.mark.parametrize("symmetric", [False, True])
def test_many_bicycles_get_the_actions_that_torch_gives(symmetric: bool) -> None:
    changes = {"symmetric_actor": symmetric, "actor_hidden": (40, 33), "backend": "native"}
    agent = FusedDdpg(small_ddpg(**changes), 2, 3)
    observation = np.random.default_rng(1).normal(size=(100, 6))
    for count in (100, 70, 100):
        rows = observation[:count]
        np.testing.assert_allclose(agent.act(rows), agent._answer(rows), atol=1e-6)
    next(agent.actor.parameters()).data.mul_(2.0)
    np.testing.assert_allclose(agent.act(observation), agent._answer(observation), atol=1e-6)


@compiled
def test_a_second_backward_pass_replaces_the_first() -> None:
    network = Critic(6, [20, 20], 2, layer_norm=True)
    gradient = torch.zeros_like(Flat([network], turned=False).values)
    net = NativeNet(network, 130, gradient)
    net.forward(torch.randn(130, 6), torch.randn(130, 2))
    net.backward(torch.ones(130, 1))
    first = gradient.clone()
    net.backward(torch.ones(130, 1))
    assert torch.equal(gradient, first)
    assert first.abs().max() > 0


@compiled
def test_it_is_compiled_once_and_kept(bare: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert native.load() is not None
    files = list((tmp_path / "bicycle").iterdir())
    assert [path.suffix for path in files] == [".so"]
    bare.setattr(native_library, "COMPILERS", ())
    native.load.cache_clear()
    assert native.load() is not None


def test_without_a_compiler_torch_does_the_work_and_one_line_says_so(
    bare: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bare.setattr(native_library, "COMPILERS", ("no-such-compiler",))
    torch.set_num_threads(1)
    agents = [FusedDdpg(small_ddpg(), 2, 0) for _ in range(2)]
    assert all(isinstance(agent._actor, FusedNet) for agent in agents)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert "there is no C++ compiler" in lines[0]
    with pytest.raises(ValueError, match=r"needs the CPU and a C\+\+ compiler: choose auto"):
        FusedDdpg(small_ddpg(backend="native"), 2, 0)


def test_a_compiler_that_fails_is_told_in_one_line(
    bare: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "broken"
    broken.write_text("#!/bin/sh\nexit 3\n")
    broken.chmod(0o755)
    bare.setattr(native_library, "COMPILERS", (str(broken),))
    assert native.load() is None
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert "ended with status 3" in lines[0]
    assert not list((tmp_path / "bicycle").iterdir())


def test_more_threads_are_torchs() -> None:
    torch.set_num_threads(2)
    try:
        assert isinstance(FusedDdpg(small_ddpg(), 2, 0)._actor, FusedNet)
    finally:
        torch.set_num_threads(1)
