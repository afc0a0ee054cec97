"""Actors trained elsewhere, as policy files and as ONNX, give what their library predicts."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper
from policies import make_policy

from bicycle_controller.cli.main import main
from bicycle_controller.control.controller import Controller
from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.nodes.policy_loader import load as load_by_service
from bicycle_controller.policy.export import save_onnx
from bicycle_controller.policy.policy import PolicyError, load_controller
from bicycle_controller.policy.trained_for import unlike_training
from bicycle_sim.plants import registry
from bicycle_sim.task.scenario import named

SCALE = np.array([0.8, 3.0, 0.3, 1.0, 5.0, 2.0])


def observations() -> np.ndarray:
    return np.random.default_rng(2).normal(size=(50, 6)) * SCALE


def imported(path: Path, to: Path, *more: str) -> Controller:
    words = ["import", str(path), "--scenario", "learned-speed", "--to", str(to), *more]
    assert main([*words, "--observation-scale", "natural"]) == 0
    (found,) = to.glob(f"{path.stem}.*")
    return load_controller(found)


@pytest.mark.parametrize("kind", ["PPO", "TD3", "SAC"])
@pytest.mark.parametrize("activation", [None, torch.nn.Tanh, torch.nn.ReLU])
def test_stable_baselines3_rides_as_it_predicts(
    tmp_path: Path, kind: str, activation: Any
) -> None:
    library = pytest.importorskip("stable_baselines3")
    importlib.import_module("bicycle_sim.task.gym_env")  # names the environments
    own = {} if activation is None else {"activation_fn": activation}
    model = getattr(library, kind)(
        "MlpPolicy",
        "bicycle/learned-speed-train-v0",
        policy_kwargs={"net_arch": [16, 8], **own},
        device="cpu",
        seed=1,
    )
    model.save(tmp_path / "mine.zip")
    controller = imported(tmp_path / "mine.zip", tmp_path / "out")
    seen = observations()
    limits = named("learned-speed").action_limits
    predicted, _ = model.predict((seen / SCALE).astype(np.float32), deterministic=True)
    np.testing.assert_allclose(controller.act(seen, np.ones(50)) / limits, predicted, atol=2e-5)
    assert controller.policy_id.startswith("mine@")


def test_an_import_says_which_bicycle_it_was_trained_on(tmp_path: Path) -> None:
    """Else it would be warned of on its own bicycle, and not on others."""
    net = torch.nn.Sequential(torch.nn.Linear(6, 4), torch.nn.ReLU(), torch.nn.Linear(4, 2))
    torch.save(net.state_dict(), tmp_path / "mine.pt")
    found = imported(tmp_path / "mine.pt", tmp_path / "out", "--bicycle", "browser-rider")
    browser = registry.named("whipple", "browser-rider")
    assert unlike_training(found, browser) == []
    assert unlike_training(found, registry.default()) == ["plant choi, not whipple"]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_state_dict_and_torchscript(tmp_path: Path) -> None:
    torch.manual_seed(0)
    net = torch.nn.Sequential(
        torch.nn.Linear(6, 16), torch.nn.Tanh(), torch.nn.Linear(16, 3), torch.nn.Tanh()
    )
    torch.save(net.state_dict(), tmp_path / "plain.pt")
    torch.jit.script(net).save(str(tmp_path / "script.pt"))  # type: ignore[no-untyped-call]
    seen = observations()
    wanted = net(torch.as_tensor(seen / SCALE, dtype=torch.float32)).detach().numpy()
    for name in ("plain", "script"):
        controller = imported(tmp_path / f"{name}.pt", tmp_path / name, "--hidden", "tanh")
        found = controller.act(seen, np.ones(50)) / named("learned-speed").action_limits
        np.testing.assert_allclose(found, wanted, atol=2e-5)


def test_what_export_writes_as_onnx_rides_as_its_policy(tmp_path: Path) -> None:
    policy = make_policy()
    save_onnx(policy, tmp_path / "mine.onnx")
    controller: Any = load_controller(tmp_path / "mine.onnx")
    seen = observations()
    np.testing.assert_allclose(controller.act(seen), policy.act(seen), atol=1e-4)
    assert controller.info == policy.info
    assert load_by_service(str(tmp_path / "mine.onnx")).policy_id == controller.policy_id


def foreign_model(path: Path, width: int, **said: Any) -> Path:
    """A model that gives the first `width` observations."""
    take = helper.make_node("Gemm", ["x", "w"], ["y"])
    weights = np.eye(6, width, dtype=np.float32)
    graph = helper.make_graph(
        [take],
        "mine",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, ["N", 6])],
        [helper.make_tensor_value_info("y", TensorProto.FLOAT, ["N", width])],
        [onnx.numpy_helper.from_array(weights, "w")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, {name: json.dumps(value) for name, value in said.items()})
    onnx.save(model, path)
    return path


def test_an_onnx_file_of_ones_own(tmp_path: Path) -> None:
    seen = observations()
    physical = load_controller(foreign_model(tmp_path / "a.onnx", 3))
    np.testing.assert_allclose(physical.act(seen, np.ones(50)), seen[:, :3], rtol=1e-6)
    said = {"observation_scale": SCALE.tolist(), "action_limits": [2.0, 0.0, 100.0]}
    shares = load_controller(foreign_model(tmp_path / "b.onnx", 2, **said))
    wanted = np.zeros((50, 3))
    wanted[:, [0, 2]] = np.clip(seen[:, :2] / SCALE[:2], -1, 1) * [2.0, 100.0]
    np.testing.assert_allclose(shares.act(seen, np.ones(50)), wanted, rtol=1e-5)


class Upright:
    """Steers into the lean; a controller of one's own."""

    policy_id = "upright@1"

    def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return (N, 3)."""
        action = np.zeros((len(observation), 3))
        action[:, 0] = 2.0 * observation[:, 2]
        return action


class Narrow(Upright):
    """Gives too few actions."""

    def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return (N, 1)."""
        return np.zeros((len(observation), 1))


def test_a_class_of_ones_own_and_an_installed_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert load_controller(f"{__name__}:Upright").policy_id == "upright@1"
    info = tmp_path / "mine-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[bicycle.controllers]\nmine = {__name__}:Upright\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert load_controller("mine").policy_id == "upright@1"
    assert load_by_service("mine").policy_id == "upright@1"
    with pytest.raises(PolicyError, match="give it to the parameter policy at the start"):
        load_by_service(f"{__name__}:Upright")


def test_what_cannot_be_loaded_says_what_can(tmp_path: Path) -> None:
    wide = foreign_model(tmp_path / "wide.onnx", 2)
    (tmp_path / "text.onnx").write_text("no model")
    (tmp_path / "model.zip").write_bytes(b"PK\x03\x04" + bytes(80))
    cases = {
        str(wide): r"gives \(1, 2\) for one bicycle, not \(1, 3\).*action_limits",
        str(tmp_path / "text.onnx"): "ONNX Runtime cannot load it",
        str(tmp_path / "model.zip"): "bicycle import",
        "no.such.module:Class": "class without arguments that has policy_id and act",
        f"{__name__}:Narrow": r"give \(N, 3\) actions",
        "nothing": "give a .safetensors or .onnx file, module:Class, or an installed controller",
    }
    for name, words in cases.items():
        with pytest.raises(PolicyError, match=words) as caught:
            load_controller(name)
        assert "\n" not in str(caught.value)


def test_import_refuses_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    net = torch.nn.Sequential(torch.nn.Linear(6, 2))
    torch.save(net.state_dict(), tmp_path / "two.pt")
    torch.save(net, tmp_path / "code.pt")
    (tmp_path / "text.zip").write_text("text")
    torch.save(torch.nn.Conv2d(1, 1, 3).state_dict(), tmp_path / "conv.pt")
    cases = {
        "two.pt": "gives 2 actions, but scenario learned-speed has 3",
        "code.pt": "save module.state_dict()",
        "text.zip": "neither a stable-baselines3 .zip nor a file of torch.save",
        "conv.pt": "export the module as ONNX",
        "none.pt": "cannot read",
    }
    for name, words in cases.items():
        words_of_command = ["import", str(tmp_path / name), "--scenario", "learned-speed"]
        assert main([*words_of_command, "--to", str(tmp_path / "out")]) == 2
        error = capsys.readouterr().err
        assert words in error
        assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_help_names_the_scenarios() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "bicycle_controller.cli.main", "import", "--help"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "learning-to-turn-fixed-speed" in done.stdout


def test_an_algorithm_outside_the_package_makes_a_policy(tmp_path: Path) -> None:
    example = Path(__file__).parents[2] / "ros2_ws" / "src" / "examples" / "own_algorithm.py"
    path = tmp_path / "own.onnx"
    done = subprocess.run(
        [sys.executable, str(example), str(path), "3"], capture_output=True, text=True, check=True
    )
    first, *_, last = (float(line.split()[4].rstrip(",")) for line in done.stdout.splitlines())
    assert last > first, "it learns"
    rides = evaluate(load_controller(path), named("random-start-random-goal"), episodes=20).rides
    assert len(rides.steps) == 20
