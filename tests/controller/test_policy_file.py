import hashlib
import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from policies import make_policy
from safetensors.numpy import save_file

from bicycle_controller.policy import policy_file
from bicycle_controller.policy.policy import (
    PolicyError,
    load_policy,
    save_policy,
    shipped_policies,
)


def test_file_round_trip(tmp_path: Path) -> None:
    policy = make_policy(norm=True)
    path = tmp_path / "deep" / "a.safetensors"
    save_policy(policy, path)
    again = load_policy(path)
    assert again.info == policy.info
    assert set(again.tensors) == set(policy.tensors)
    assert all((again.tensors[name] == policy.tensors[name]).all() for name in policy.tensors)
    assert again.policy_id == policy.policy_id
    assert again.policy_id == "random@" + hashlib.sha256(path.read_bytes()).hexdigest()[:10]
    assert [item.name for item in path.parent.iterdir()] == ["a.safetensors"]


def test_equal_policies_make_equal_files() -> None:
    files = {policy_file.encode(p.info, p.tensors) for p in (make_policy() for _ in range(8))}
    assert len(files) == 1


def test_other_weights_have_another_id() -> None:
    assert make_policy(seed=0).policy_id != make_policy(seed=1).policy_id


def test_failed_write_leaves_nothing(tmp_path: Path) -> None:
    target = tmp_path / "a.safetensors"
    target.mkdir()
    with pytest.raises(OSError, match=r"a\.safetensors"):
        save_policy(make_policy(), target)
    assert [item.name for item in tmp_path.iterdir()] == ["a.safetensors"]


def test_shipped_policies_load() -> None:
    for name in shipped_policies():
        assert load_policy(name).policy_id.startswith(f"{name}@")


def refused(path: str | Path) -> str:
    """Return the one line with which a policy is refused."""
    with pytest.raises(PolicyError) as caught:
        load_policy(path)
    message = str(caught.value)
    assert "\n" not in message
    assert ";" in message, "no remedy"
    return message


def write(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def encoded() -> bytes:
    policy = make_policy()
    return policy_file.encode(policy.info, policy.tensors)


def test_missing_file_and_directory(tmp_path: Path) -> None:
    assert "does not exist" in refused(tmp_path / "none.safetensors")
    assert "is not a file" in refused(tmp_path)
    assert "shipped policies" in refused("no-such-policy")
    refused("nul\0byte")
    refused("two\nlines")


def test_every_truncation_is_refused(tmp_path: Path) -> None:
    data = encoded()
    lengths = [*range(0, 64), *range(64, len(data), 331), len(data) - 1]
    for length in lengths:
        refused(write(tmp_path / "cut.safetensors", data[:length]))
    refused(write(tmp_path / "long.safetensors", data + b"\0"))


def test_no_damage_to_the_header_gets_through_as_another_error(tmp_path: Path) -> None:
    data, rng = encoded(), np.random.default_rng(3)
    size = 8 + int.from_bytes(data[:8], "little")
    messages = []
    for _ in range(400):
        damaged = bytearray(data)
        damaged[rng.integers(size)] = rng.integers(256)
        path = write(tmp_path / "damaged.safetensors", bytes(damaged))
        try:
            load_policy(path)
        except PolicyError as error:
            messages.append(str(error))
    assert len(messages) > 200
    assert not any("\n" in message for message in messages)


def test_pickles_are_never_opened(tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[Any, ...]:
            return (exec, ("raise SystemExit('pickle was run')",))

    bombs = [pickle.dumps(Bomb(), protocol) for protocol in (2, 4, 5)]
    for bomb in bombs:
        assert "pickle" in refused(write(tmp_path / "bomb.safetensors", bomb))
    torch.save({"weight": torch.zeros(3)}, tmp_path / "checkpoint.safetensors")
    assert "pickle" in refused(tmp_path / "checkpoint.safetensors")


@pytest.mark.parametrize("size", [2**63, 2**40, policy_file.MAX_HEADER_BYTES + 1])
def test_huge_header(tmp_path: Path, size: int) -> None:
    data = size.to_bytes(8, "little") + b"{" * 1000
    assert "header" in refused(write(tmp_path / "huge.safetensors", data))


def test_huge_file(tmp_path: Path) -> None:
    path = tmp_path / "sparse.safetensors"
    with path.open("wb") as file:
        file.truncate(policy_file.MAX_FILE_BYTES * 64)
    assert "too large" in refused(path)


def test_nested_header(tmp_path: Path) -> None:
    header = b"[" * 100_000
    data = len(header).to_bytes(8, "little") + header
    assert "header" in refused(write(tmp_path / "nested.safetensors", data))


def metadata() -> dict[str, str]:
    return policy_file.metadata(make_policy().info)


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("format", "other", "not a bicycle policy"),
        ("version", "3", "version '3'"),
        ("name", "two words", "name"),
        ("observation_fields", json.dumps(["lean_angle"] * 6), "observation_fields"),
        ("observation_fields", "nonsense", "observation_fields"),
        ("action_fields", json.dumps(["displacement", "torque", "pedal_force"]), "action_fields"),
        ("observation_scale", "[1, 1, 1, 1, 1, 0]", "observation_scale"),
        ("observation_scale", "[1, 1, 1, 1, 1, NaN]", "observation_scale"),
        ("observation_scale", "[1, 1]", "observation_scale"),
        ("observation_scale", '"abc"', "observation_scale"),
        ("action_limits", "[0, 0, 0]", "action_limits"),
        ("action_limits", "[2, -1, 0]", "action_limits"),
        ("action_limits", "[2, 0.2, 100]", "outputs"),
        ("scenario", '{"name": "x"}', "scenario"),
        ("scenario", "[]", "scenario"),
        ("scenario", '{"name": "x", "start": 5, "goal": 5}', "must be a mapping"),
        ("physics", '{"gravity": 9.8}', "physics"),
        ("time_step", "0.01", "time_step"),
        ("trained", "[]", "trained"),
    ],
)
def test_wrong_metadata(tmp_path: Path, name: str, value: str, expected: str) -> None:
    path = tmp_path / "wrong.safetensors"
    save_file(make_policy().tensors, path, metadata() | {name: value})
    assert expected in refused(path)


def test_missing_metadata(tmp_path: Path) -> None:
    path = tmp_path / "missing.safetensors"
    save_file(make_policy().tensors, path)
    assert "not a bicycle policy" in refused(path)
    for name in metadata():
        rest = {key: value for key, value in metadata().items() if key != name}
        save_file(make_policy().tensors, path, rest)
        refused(path)


@pytest.mark.parametrize(
    ("name", "tensor"),
    [
        ("layer.0.weight", np.zeros((32, 5), np.float32)),
        ("layer.0.weight", np.zeros((32, 6), np.float64)),
        ("layer.0.weight", np.zeros((32, 6), np.float16)),
        ("layer.0.weight", np.full((32, 6), np.nan, np.float32)),
        ("layer.1.bias", np.full(24, np.inf, np.float32)),
        ("layer.1.bias", np.zeros(23, np.float32)),
        ("layer.2.weight", np.zeros((1, 24), np.float32)),
        ("layer.2.weight", np.zeros(24, np.float32)),
        ("layer.7.weight", np.zeros((2, 2), np.float32)),
        ("norm.0.weight", np.zeros(32, np.float32)),
        ("extra", np.zeros(2, np.float32)),
        ("layer.1.weight", None),
        ("layer.2.bias", None),
    ],
)
def test_wrong_tensors(tmp_path: Path, name: str, tensor: np.ndarray | None) -> None:
    tensors = dict(make_policy().tensors)
    tensors.pop(name, None)
    if tensor is not None:
        tensors[name] = tensor
    path = tmp_path / "wrong.safetensors"
    save_file(tensors, path, metadata())
    refused(path)
