"""An actor's inputs by name, in a policy file of version 2 and everywhere it goes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from policies import make_policy
from remembering import make_remembering

from bicycle_controller.control.past import Past
from bicycle_controller.evaluation.model_card import card
from bicycle_controller.policy import inference
from bicycle_controller.policy.export import save_onnx
from bicycle_controller.policy.inputs import Inputs, parse, with_history
from bicycle_controller.policy.policy import PolicyError, load_policy, save_policy
from bicycle_controller.policy.policy_file import metadata
from bicycle_controller.policy.torch_policy import TorchPolicy
from bicycle_controller.policy.trained_for import unlike_training
from bicycle_sim.plants import registry
from bicycle_sim.task.scenario import SCENARIOS


def numbered(count: int, periods: int) -> tuple[np.ndarray, np.ndarray, Past]:
    """Rides whose every number tells ride, age and column."""
    past = Past(count, periods, np.full((count, 1), 7000.0))
    ride = 1000.0 * np.arange(count)[:, None, None]
    past.rows = ride + 10.0 * np.arange(1, periods + 1)[None, :, None] + np.arange(10)[None, None]
    return ride[:, 0] + np.arange(6.0), ride[:, 0, 0] + 6.0, past


def test_each_name_gets_its_number() -> None:
    seen, speed, past = numbered(2, 4)
    inputs = Inputs(("speed", "lean_rate[-3]", "torque[-1]", "plant.motor.lag", "steer_angle"))
    assert (inputs.memory, inputs.plant_parameters, inputs.plain) == (
        3,
        ("plant.motor.lag",),
        False,
    )
    expected = [[6.0, 33.0, 17.0, 7000.0, 0.0], [1006.0, 1033.0, 1017.0, 7000.0, 1000.0]]
    np.testing.assert_array_equal(inputs.gather(seen, speed, past), expected)


def test_the_six_states_pass_unchanged() -> None:
    seen = np.ones((3, 6))
    assert make_policy().inputs.gather(seen, None, None) is seen


def test_without_a_past_a_ride_begins() -> None:
    policy = make_remembering()
    seen, speed = np.random.default_rng(1).normal(size=(5, 6)), np.full(5, 3.0)
    begun = policy.act(seen, speed, Past.of_start(seen, speed, policy.memory))
    np.testing.assert_array_equal(policy.act(seen, speed), begun)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("lean_rat", "did you mean 'lean_rate'"),
        ("torque", r"torque\[-1\]"),
        ("lean_rate[-0]", "no input"),
        ("lean_rate[-999]", "more than"),
        ("plant.", "no input"),
    ],
)
def test_a_name_that_is_none(name: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse(name)


def test_one_name_twice() -> None:
    with pytest.raises(ValueError, match="each once"):
        Inputs(("speed", "speed"))


def test_what_is_missing_is_told() -> None:
    policy, seen = make_remembering(("plant.delay",)), np.zeros((1, 6))
    with pytest.raises(ValueError, match="speed"):
        policy.act(seen)
    with pytest.raises(ValueError, match="parameters of the bicycle"):
        policy.act(seen, np.ones(1))
    with pytest.raises(ValueError, match="3 past control periods"):
        policy.act(seen, np.ones(1), Past(1, 2, np.zeros((1, 1))))


def test_history_names() -> None:
    names = with_history(("speed",), ("lean_rate", "torque"), 2)
    assert names == ("speed", "lean_rate[-1]", "torque[-1]", "lean_rate[-2]", "torque[-2]")


def test_file_keeps_everything(tmp_path: Path) -> None:
    policy = make_remembering(("plant.motor.lag",))
    save_policy(policy, tmp_path / "a.safetensors")
    again = load_policy(tmp_path / "a.safetensors")
    assert again.info == policy.info
    assert metadata(again.info)["version"] == "2"
    assert metadata(make_policy().info)["version"] == "1"
    seen, speed, past = numbered(1, 3)
    np.testing.assert_array_equal(again.act(seen, speed, past), policy.act(seen, speed, past))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("inputs", '["lean_rate", "wind"]'),
        ("inputs", "5"),
        ("inputs", '["speed"]'),
        ("plants", "5"),
        ("speeds", "[3, 1]"),
        ("speeds", "[1]"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path: Path, name: str, value: str) -> None:
    from safetensors.numpy import save_file

    policy = make_remembering()
    path = tmp_path / "wrong.safetensors"
    save_file(policy.tensors, path, metadata(policy.info) | {name: value})
    with pytest.raises(PolicyError) as caught:
        load_policy(path)
    assert "\n" not in str(caught.value)


def test_all_runtimes_agree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    policy = make_remembering()
    rng = np.random.default_rng(2)
    seen, speed, past = rng.normal(size=(4, 6)), rng.uniform(1.0, 6.0, 4), Past(4, 3)
    past.rows = rng.normal(size=past.rows.shape)
    many = policy.act(seen, speed, past)
    np.testing.assert_allclose(TorchPolicy(policy).act(seen, speed, past), many, atol=1e-5)
    monkeypatch.setattr(inference, "load", lambda: None)
    plain = make_remembering()
    for ride in range(4):
        one = Past(1, 3)
        one.rows = past.rows[ride : ride + 1]
        row = seen[ride : ride + 1], speed[ride : ride + 1], one
        np.testing.assert_allclose(policy.act(*row)[0], many[ride], atol=1e-5)
        np.testing.assert_allclose(plain.act(*row)[0], many[ride], atol=1e-5)
    save_onnx(policy, tmp_path / "a.onnx", TorchPolicy(policy))
    session = onnxruntime.InferenceSession(tmp_path / "a.onnx")
    rows = policy.inputs.gather(seen, speed, past).astype(np.float32)
    np.testing.assert_allclose(session.run(None, {"observation": rows})[0], many, atol=1e-4)
    stored = session.get_modelmeta().custom_metadata_map
    assert json.loads(stored["inputs"]) == list(policy.info.inputs)


def test_the_card_names_what_it_sees() -> None:
    text = card(make_remembering(("plant.delay",)))
    for fact in (
        "saw in the last 3 periods, told 1 numbers of the bicycle",
        "| lean_rate, 0 to 3 periods ago | 1 | rad/s |",
        "| torque, 1 to 3 periods ago | 1 | N m |",
        "| plant.delay | 1 |  |",
        "any bicycle of: whipple. Speeds 1 to 6 m/s.",
    ):
        assert fact in text


def test_it_rides_any_bicycle_of_its_plants() -> None:
    policy, scenario = make_remembering(), SCENARIOS["random-start-random-goal"]
    assert unlike_training(policy, registry.named("whipple", "benchmark"), scenario) == []
    assert unlike_training(policy, registry.default(), scenario)
