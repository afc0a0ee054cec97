import argparse
import itertools
import json
import re
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest
import torch
from run_compare import after, assert_same_run, rows, same, state_of
from train_process import bicycle_train, start, struck, went_on
from training_maker import SMALL, small_run
from waiting import PATIENCE, finish, until

from bicycle_controller.agents.answer import Answer
from bicycle_controller.cli.train import add_arguments, run_command
from bicycle_controller.config import loading
from bicycle_controller.evaluation.score import score
from bicycle_controller.policy.policy import load_policy
from bicycle_controller.training import checkpoint, online
from bicycle_controller.training.run_folder import BusyError, RunFolder
from bicycle_sim.task import native_task

RUNS = {
    "paper": (),
    "fused": ("ddpg.backend=fused",),
    "authors, autograd": ("ddpg.backend=autograd", "ddpg.initialisation=output"),
    "everything": (
        "ddpg.fall=absorbing",
        "ddpg.n_step=3",
        "ddpg.critics=2",
        "ddpg.smoothing=0.2",
        "ddpg.mirror=true",
        "ddpg.actor_every=2",
        "ddpg.critic_layer_norm=true",
        "starts.near_share=0.5",
        "starts.ride_on=0.5",
        "starts.tilt=0.05",
        "noise.kind=gaussian",
        "physics.displacement_noise=0.02",
        "ddpg.cost_cap=4",
        "ddpg.learning_rate_end=0.1",
        "ddpg.actor_average=0.01",
        "evaluation.near_episodes=4",
        "evaluation.keep=3",
        "updates=2",
        "update_every=3",
    ),
}


@pytest.mark.parametrize("name", RUNS)
def test_a_resumed_run_gives_the_same_numbers_to_the_bit(name: str, tmp_path: Path) -> None:
    config = small_run(*RUNS[name])
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert online.run(config, whole).status == "finished"
    result = online.run(config, parts, stop=after(70))
    assert (result.status, result.steps) == ("interrupted", 71 * 8)
    assert online.resume(parts, stop=after(61)).status == "interrupted"
    result = online.resume(parts)
    assert (result.status, result.steps) == ("finished", 1600)
    assert_same_run(whole, parts)
    kinds = [row["kind"] for row in rows(whole)]
    assert kinds.count("train") >= 2
    assert kinds.count("evaluation") >= 1


def slowly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take the readable way everywhere: numpy's step, the actor as a module."""
    monkeypatch.setattr(native_task, "load", lambda: None)
    monkeypatch.setattr(Answer, "__call__", Answer._called)


@pytest.mark.parametrize("preset", ["authors", "paper", "naf", "ppo"])
def test_the_quick_loop_makes_the_run_of_the_readable_one(
    preset: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    changes = ["steps=1500", "starts.max_steps=60", "evaluation.episodes=5"]
    changes += ["record.episodes=true", "record.tracks_every=2", "log_every=50"]
    changes += ["scenario=learned-speed", "tensorboard=false", "seed=3"]
    changes += ["ppo.rollout=32"] if preset == "ppo" else ["warm_up=300"]
    changes += [f"evaluation.every={100 if preset == 'ppo' else 600}"]
    config = loading.preset(preset, changes)
    online.run(config, tmp_path / "quick")
    slowly(monkeypatch)
    online.run(config, tmp_path / "readable")
    assert_same_run(tmp_path / "quick", tmp_path / "readable")
    for name in ("episodes.csv", "tracks.csv"):
        quick, readable = ((tmp_path / kind / name).read_bytes() for kind in ("quick", "readable"))
        assert quick == readable
        assert quick.count(b"\n") > 20


def test_a_seed_repeats_a_run_and_another_does_not(tmp_path: Path) -> None:
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        online.run(small_run(f"seed={seed}", "steps=800"), tmp_path / name)
    assert_same_run(tmp_path / "a", tmp_path / "b")
    assert not same(state_of(tmp_path / "a")["agent"], state_of(tmp_path / "c")["agent"])


def test_saving_often_changes_no_number(tmp_path: Path) -> None:
    online.run(small_run("steps=800"), tmp_path / "a")
    online.run(small_run("steps=800", "save_every=0"), tmp_path / "b")
    assert_same_run(tmp_path / "a", tmp_path / "b")


def wait_for(path: Path, process: subprocess.Popen[str], lines: int) -> None:
    """Wait until the log has so many lines and there is a checkpoint."""
    log, state = path / "log.jsonl", path / "checkpoint" / "state.pt"
    until(lambda: state.exists() and log.read_bytes().count(b"\n") >= lines, process)


def test_a_run_killed_at_any_moment_goes_on_to_the_same_end(tmp_path: Path) -> None:
    config = small_run("steps=4000", "save_every=0.05")
    online.run(config, tmp_path / "whole")
    killed = tmp_path / "killed"
    words = bicycle_train(killed, config=config)
    for lines in (2, 8):
        struck(words, killed, lines, signal.SIGKILL)
        words = bicycle_train(killed, "--resume")
    assert "finished after 4000 steps" in went_on(words)
    assert_same_run(tmp_path / "whole", killed)
    assert not list(killed.glob(".*"))


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_saves_and_leaves(number: signal.Signals, code: int, tmp_path: Path) -> None:
    config = small_run("steps=10_000_000", "save_every=0.2")
    process = start(bicycle_train(tmp_path / "run", config=config))
    wait_for(tmp_path / "run", process, 3)
    process.send_signal(number)
    out, err = finish(process)
    assert (process.returncode, err) == (code, "")
    assert "bicycle train --resume --out" in out
    state = state_of(tmp_path / "run")
    assert state["updates"] >= rows(tmp_path / "run")[-1]["updates"]


def test_the_folder_holds_what_it_promises(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = small_run("seed=7")
    monkeypatch.setattr("sys.argv", ["/somewhere/cli/__main__.py", "train", "--seed", "7"])
    result = online.run(config, tmp_path / "run")
    assert loading.load(tmp_path / "run" / "config.yaml") == config
    about = json.loads((tmp_path / "run" / "run.json").read_text())
    assert about["seed"] == 7
    assert {"command", "commit", "version", "started", "processor"} < about.keys()
    assert about["command"] == "bicycle train --seed 7"
    assert about["processor"], "seconds of one processor are not those of another"
    assert (result.updates, result.steps) == (176, 1600)
    best = [row for row in rows(tmp_path / "run") if row["kind"] == "evaluation"]
    assert result.best is not None
    rates = [row["reach_rate"] - row["fall_rate"] for row in best]
    assert max(rates) == result.best.reach_rate - result.best.fall_rate
    for name in ("best", "last"):
        info = load_policy(tmp_path / "run" / f"{name}.safetensors").info
        assert info.scenario == config.scenario
        assert (info.trained["seed"], info.trained["preset"]) == (7, "paper")
        assert info.observation_scale == config.learner.observation_scale


def test_the_best_policy_is_the_one_that_scored_best(tmp_path: Path) -> None:
    config = small_run("evaluation.every=10", "steps=2400")
    result = online.run(config, tmp_path / "run")
    found = score(
        load_policy(tmp_path / "run" / "best.safetensors"),
        config.scenario,
        config.physics,
        config.evaluation,
    )
    assert found == result.best


def test_policies_of_evaluations_are_kept_and_change_no_number(tmp_path: Path) -> None:
    words = ("evaluation.every=10", "steps=2400")
    with_none = online.run(small_run(*words), tmp_path / "none")
    result = online.run(small_run(*words, "evaluation.keep=4"), tmp_path / "kept")
    assert result.best == with_none.best
    assert not (tmp_path / "none" / "policies").exists()
    files = sorted((tmp_path / "kept" / "policies").glob("*"))
    updates = [int(file.stem) for file in files]
    assert len(updates) == 4
    assert updates[0] == 10
    assert updates[-1] > result.updates - 10
    assert [load_policy(file).info.trained["updates"] for file in files] == updates
    ids = {load_policy(file).policy_id for file in files}
    assert len(ids) == 4, "it has learned between them"
    gaps = [after - before for before, after in itertools.pairwise(updates[:-1])]
    assert max(gaps) <= 3 * min(gaps), "spread over the run; the newest is there anyhow"


def test_a_met_goal_rate_ends_the_run(tmp_path: Path) -> None:
    config = small_run("scenario.goal_radius=500", "evaluation.stop_at=0.9")
    result = online.run(config, tmp_path / "run")
    assert result.status == "reached"
    assert result.updates == 50


def test_more_steps_go_on_with_a_finished_run(tmp_path: Path) -> None:
    online.run(small_run("steps=2400"), tmp_path / "whole")
    online.run(small_run("steps=1200"), tmp_path / "parts")
    online.resume(tmp_path / "parts", ["steps=2400"])
    assert_same_run(tmp_path / "whole", tmp_path / "parts")


def test_another_backend_may_go_on_and_one_line_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = small_run("ddpg.backend=fused")
    online.run(config, tmp_path / "run", stop=after(60))
    path = tmp_path / "run" / "config.yaml"
    path.write_text(path.read_text().replace("backend: fused", "backend: autograd"))
    assert online.resume(tmp_path / "run").status == "finished"
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "fused began this run and autograd goes on with it: its numbers will differ by rounding"
    ]


def test_a_run_killed_before_its_first_checkpoint_starts_again(tmp_path: Path) -> None:
    config = small_run("steps=800")
    online.run(config, tmp_path / "whole")
    RunFolder(tmp_path / "young").create(config)
    (tmp_path / "young" / "log.jsonl").write_text('{"kind": "train"}\n')
    online.resume(tmp_path / "young")
    assert_same_run(tmp_path / "whole", tmp_path / "young")


def test_mistakes_with_folders_are_one_line_with_the_remedy(tmp_path: Path) -> None:
    config = small_run("steps=400")
    online.run(config, tmp_path / "run")
    with pytest.raises(ValueError, match=r"holds a run already.*--resume"):
        online.run(config, tmp_path / "run")
    with pytest.raises(ValueError, match="no run to resume"):
        online.resume(tmp_path / "nowhere")
    with pytest.raises(ValueError, match=r"ddpg cannot change.*another --out"):
        online.resume(tmp_path / "run", ["ddpg.tau=0.5"])
    online.run(small_run("steps=400", "ddpg.learning_rate_end=0.1"), tmp_path / "annealed")
    with pytest.raises(ValueError, match="steps cannot change"):
        online.resume(tmp_path / "annealed", ["steps=800"])
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="cannot write"):
        online.run(config, tmp_path / "file" / "run")


def test_two_processes_never_train_in_one_folder(tmp_path: Path) -> None:
    config = small_run("steps=10_000_000", "save_every=0.2")
    process = start(bicycle_train(tmp_path / "run", config=config))
    wait_for(tmp_path / "run", process, 1)
    with pytest.raises(BusyError, match=r"another process trains in .*run: wait for it"):
        online.resume(tmp_path / "run")
    with pytest.raises(BusyError):
        online.run(config, tmp_path / "run")
    process.kill()
    process.communicate()
    assert online.resume(tmp_path / "run", stop=lambda: True).status == "interrupted"


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 not a checkpoint", None])
def test_a_damaged_checkpoint_is_one_line_with_the_remedy(
    damage: bytes | None, tmp_path: Path
) -> None:
    online.run(small_run("steps=400"), tmp_path / "run")
    path = tmp_path / "run" / "checkpoint" / "state.pt"
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2] if damage is None else damage)
    with pytest.raises(ValueError, match=r"cannot resume from .*state\.pt.*delete it") as caught:
        online.resume(tmp_path / "run")
    assert "\n" not in str(caught.value)


def test_a_checkpoint_of_other_code_is_one_line_with_the_remedy(tmp_path: Path) -> None:
    """Something was added to the state since; once this was a traceback."""
    online.run(small_run("steps=400"), tmp_path / "run")
    path = tmp_path / "run" / "checkpoint" / "state.pt"
    state = checkpoint.load(path)
    del state["collector"]["returns"]["shown"]
    checkpoint.save(path, state)
    with pytest.raises(ValueError, match=r"holds no 'shown'.*commit .*resume it with") as caught:
        online.resume(tmp_path / "run")
    assert "\n" not in str(caught.value)


def test_a_checkpoint_runs_no_code(tmp_path: Path) -> None:
    class Evil:
        def __reduce__(self) -> Any:
            return (Path.touch, (tmp_path / "owned",))

    torch.save({"version": checkpoint.VERSION, "state": Evil()}, tmp_path / "state.pt")
    with pytest.raises(ValueError, match="cannot resume"):
        checkpoint.load(tmp_path / "state.pt")
    assert not (tmp_path / "owned").exists()


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is CUDA here")
def test_without_cuda_it_says_so_in_one_line_and_trains(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = online.run(small_run("device=cuda", "steps=400"), tmp_path / "run")
    assert result.status == "finished"
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["no CUDA device was found: training on the CPU"]


def test_the_command_trains_and_prints_json(tmp_path: Path) -> None:
    words = bicycle_train(tmp_path / "run", "--json", "--preset", "paper", "--seed", "3")
    overrides = [word for override in SMALL for word in ("--set", override)]
    done = subprocess.run([*words, *overrides], capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert (result["status"], result["steps"], result["updates"]) == ("finished", 1600, 176)
    assert loading.load(tmp_path / "run" / "config.yaml").seed == 3


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--preset", "fats"], ["'fats'", "'fast'"]),
        (["--set", "ddpg.tua=1"], ["'tua'", "'tau'"]),
        (["--set", "seed=x"], ["seed", "whole number"]),
        (["--scenario", "learned-sped"], ["'learned-speed'"]),
        (["--device", "gpu"], ["device", "cuda"]),
        (["--resume"], ["no run to resume"]),
        (["--resume", "--preset", "fast"], ["leave out"]),
        (["--preset", "fast", "--config", "x.yaml"], ["not both"]),
        (["--config", "/nowhere.yaml"], ["cannot read", "/nowhere.yaml"]),
    ],
)
def test_mistakes_on_the_command_line_are_one_line(
    arguments: list[str], words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    args = parser.parse_args(["--out", str(tmp_path / "run"), *arguments])
    with pytest.raises(ValueError, match=re.escape(words[0])) as caught:
        run_command(args)
    assert "\n" not in str(caught.value)
    assert all(word in str(caught.value) for word in words)
    assert not (tmp_path / "run").exists()


def test_tensorboard_gets_the_same_rows(tmp_path: Path) -> None:
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    online.run(small_run("tensorboard=true"), tmp_path / "run")
    events = accumulator.EventAccumulator(str(tmp_path / "run" / "tensorboard"))
    events.Reload()
    expected = [row for row in rows(tmp_path / "run") if row["kind"] == "train"]
    found = events.Scalars("train/critic_loss")
    assert [event.step for event in found] == [row["step"] for row in expected]
    assert [e.value for e in found] == pytest.approx([row["critic_loss"] for row in expected])
