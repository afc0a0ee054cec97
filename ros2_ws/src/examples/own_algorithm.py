"""An algorithm of one's own, outside the package: random search on the vector environment.

The cross-entropy method on a linear law: each round tries many laws on the same starts, and the
best fifth makes the next round's mean and spread. What comes out is an ONNX policy:

    python own_algorithm.py mine.onnx && bicycle evaluate mine.onnx --episodes 200
"""

import json
import sys

import gymnasium
import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

LIMITS = [2.0, 0.2, 0.0]
"""N m, m, N: of the scenario random-start-random-goal."""


def search(rounds: int, laws: int, starts: int, seed: int) -> np.ndarray:
    """Return the mean law, (2, 6): shares of the limits from the natural observation."""
    envs = gymnasium.make_vec(
        "bicycle_sim:bicycle/random-start-random-goal-train-v0",
        num_envs=laws * starts,
        observation_scale="natural",
        max_episode_steps=300,
        autoreset_mode="Disabled",
    )
    rng = np.random.default_rng(seed)
    mean, spread = np.zeros((2, 6)), np.ones((2, 6))
    for turn in range(rounds):
        tried = mean + spread * rng.normal(size=(laws, 2, 6))
        matrices = np.repeat(tried, starts, axis=0)
        seeds = [seed + turn * starts + start for start in range(starts)] * laws
        observation, _ = envs.reset(seed=seeds)
        returns, rides, worth = np.zeros(laws * starts), np.ones(laws * starts, dtype=bool), 1.0
        while rides.any():
            action = np.clip(np.einsum("nij,nj->ni", matrices, observation), -1, 1).astype("f4")
            observation, reward, terminated, truncated, _ = envs.step(action)
            returns += worth * reward * rides
            worth *= 0.99
            ended = terminated | truncated
            rides &= ~ended
            if ended.any():
                observation, _ = envs.reset(options={"reset_mask": ended})
        score = returns.reshape(laws, starts).mean(axis=1)
        best = tried[np.argsort(score)[-laws // 5 :]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + 0.05 * 0.95**turn
        print(f"round {turn}: mean return {score.mean():.2f}, best {score.max():.2f}")
    return mean


def save(law: np.ndarray, scale: list[float], path: str) -> None:
    """Write the law as an ONNX file that `policy:=` and `bicycle evaluate` take."""
    graph = helper.make_graph(
        [helper.make_node("Gemm", ["observation", "law"], ["action"], transB=1)],
        "own",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["N", 6])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["N", 2])],
        [numpy_helper.from_array(law.astype(np.float32), "law")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    said = {"observation_scale": json.dumps(scale), "action_limits": json.dumps(LIMITS)}
    helper.set_model_props(model, said)
    onnx.save(model, path)


if __name__ == "__main__":
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else 40
    found = search(rounds, laws=100, starts=8, seed=1)
    save(found, [0.8, 3.0, 0.3, 1.0, 5.0, 2.0], sys.argv[1])
