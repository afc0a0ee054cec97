import json
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
from policies import make_policy

from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.evaluation.model_card import card
from bicycle_controller.evaluation.rollouts import Disturbance
from bicycle_controller.policy.export import ExportError, parity, save_onnx, to_onnx
from bicycle_controller.policy.policy_file import metadata
from bicycle_controller.policy.torch_policy import TorchPolicy
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import SCENARIOS


@pytest.mark.parametrize("norm", [False, True])
@pytest.mark.parametrize("limits", [(2.0, 0.2, 0.0), (2.0, 0.02, 100.0), (0.0, 0.2, 0.0)])
def test_onnx_runtime_gives_the_policy_s_actions(
    tmp_path: Path, norm: bool, limits: tuple[float, float, float]
) -> None:
    policy = make_policy(hidden=(400, 300), limits=limits, norm=norm)
    path = tmp_path / "policy.onnx"
    differences = save_onnx(policy, path, TorchPolicy(policy))
    assert set(differences) == {"onnxruntime", "torch"}
    assert 0.0 < max(differences.values()) <= 5e-5
    session = onnxruntime.InferenceSession(path)
    for count in (1, 300):
        observation = np.random.default_rng(4).normal(size=(count, 6))
        (action,) = session.run(None, {"observation": observation.astype(np.float32)})
        np.testing.assert_allclose(action, policy.act(observation), atol=5e-5 * max(limits))


def test_onnx_keeps_the_metadata() -> None:
    policy = make_policy()
    props = {item.key: item.value for item in to_onnx(policy).metadata_props}
    assert props == metadata(policy.info) | {"policy_id": policy.policy_id}
    (graph_input,) = to_onnx(policy).graph.input
    sizes = graph_input.type.tensor_type.shape.dim
    assert (sizes[0].dim_param, sizes[1].dim_value) == ("N", 6)


def test_disagreement_is_found_and_nothing_written(tmp_path: Path) -> None:
    policy, other = make_policy(), make_policy(seed=1)
    with pytest.raises(ExportError, match="torch and numpy differ"):
        save_onnx(policy, tmp_path / "policy.onnx", TorchPolicy(other))
    with pytest.raises(ExportError, match="onnxruntime and numpy differ"):
        parity(policy, to_onnx(other).SerializeToString())
    assert list(tmp_path.iterdir()) == []


def test_a_slip_in_the_scaling_is_found() -> None:
    policy = make_policy()
    model = to_onnx(policy)
    for tensor in model.graph.initializer:
        if tensor.name == "scale":
            doubled = onnx.numpy_helper.to_array(tensor) * np.float32(1.001)
            tensor.CopyFrom(onnx.numpy_helper.from_array(doubled, "scale"))
    with pytest.raises(ExportError, match="differ"):
        parity(policy, model.SerializeToString())


def test_card_says_where_the_policy_comes_from() -> None:
    policy = make_policy()
    summary = evaluate(
        policy,
        SCENARIOS["fixed-start-fixed-goal"],
        ChoiPlant.named("corrected"),
        episodes=4,
        seed=7,
        disturbance=Disturbance(roll_kick=0.5),
    ).summary()
    text = card(policy, [json.loads(json.dumps(summary))])
    assert text.startswith("# random\n")
    for fact in (
        policy.policy_id,
        "6 - 32 - 24 - 2",
        "- seed: `0`",
        "- command: `make_policy`",
        "| heading_error | 2 | rad |",
        "| displacement | 0.2 | m |",
        "| pedal_force | 0 | N |",
        "Physics: faithful, 0.025 s a step.",
        "- name: `random-start-random-goal`",
        "## Evaluation: fixed-start-fixed-goal, corrected physics, seed 7, roll_kick 0.5",
        "| rides | 4 |",
    ):
        assert fact in text
