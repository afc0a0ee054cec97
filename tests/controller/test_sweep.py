import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from tqdm import tqdm
from waiting import PATIENCE, until

from bicycle_controller.cli import main
from bicycle_controller.config import loading
from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.policy.policy import load_policy
from bicycle_controller.training import online, sweep

SHORT = ["steps=6000", "warm_up=1000", "ddpg.actor_hidden=[16, 16]", "ddpg.critic_hidden=[16, 16]"]
SHORT += ["evaluation.every=20", "evaluation.max_steps=100", "tensorboard=false"]
SCENARIO = "fixed-start-fixed-goal"


def jobs(out: Path, seeds: tuple[int, ...] = (1,), *more: str) -> list[sweep.Job]:
    return sweep.plan(out, ["fast"], [SCENARIO], seeds, [*SHORT, *more])


def test_plan_is_every_preset_on_every_scenario_with_every_seed(tmp_path: Path) -> None:
    found = sweep.plan(tmp_path, ["fast", "paper"], [SCENARIO, "learned-speed"], [1, 2])
    assert len({job.folder for job in found}) == len(found) == 8
    assert [job.seed for job in found] == [1] * 4 + [2] * 4
    job = found[6]
    assert job.folder == tmp_path / "paper" / SCENARIO / "seed-2"
    assert job.config == loading.preset("paper", [f"scenario={SCENARIO}", "seed=2"])


def test_a_run_is_trained_and_scored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", sys.argv)
    (job,) = jobs(tmp_path / "sweep")
    result, policy = sweep.run_job(job, 20, ["bicycle", "sweep", "--out", "x"])
    (same,) = jobs(tmp_path / "plain")
    result_again = online.run(same.config, same.folder)
    assert (result["status"], result["updates"]) == ("finished", result_again.updates)
    best = load_policy(same.folder / "best.safetensors")
    config = job.config
    expected = evaluate(best, config.scenario, config.physics, 20).summary()
    assert result["evaluation"]["mean_return"] == expected["mean_return"]
    assert (job.folder / "best.safetensors").read_bytes() == policy
    trained = load_policy(job.folder).info.trained
    assert trained["command"] == "bicycle sweep --out x"


def test_a_run_that_was_begun_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", sys.argv)
    (job,), (whole,) = jobs(tmp_path / "halves"), jobs(tmp_path / "whole")
    calls = iter(range(10_000))
    online.run(job.config, job.folder, stop=lambda: next(calls) >= 20)
    result, policy = sweep.run_job(job, 5, ["bicycle"])
    again, expected = sweep.run_job(whole, 5, ["bicycle"])
    assert result["steps"] == again["steps"]
    assert result["evaluation"]["mean_return"] == again["evaluation"]["mean_return"]
    assert len(policy) == len(expected)


def test_a_run_with_other_settings_is_not_mixed_in(tmp_path: Path) -> None:
    (job,) = jobs(tmp_path)
    online.run(job.config, job.folder, stop=lambda: True)
    assert jobs(tmp_path) == [job]
    with pytest.raises(ValueError, match="other settings"):
        jobs(tmp_path, (1,), "ddpg.tau=0.5")


def test_groups_worked_by_hand() -> None:
    def run(seed: int, reach: float, fall: float, median: float | None, cpu: float) -> Any:
        score = {"reach_rate": reach, "fall_rate": fall, "median_time_s": median}
        about = {"preset": "a", "scenario": "b", "seed": seed, "status": "finished"}
        return about | {"evaluation": score, "cpu_s": cpu, "wall_s": 2 * cpu}

    runs = [
        run(1, 0.9, 0.1, 30.0, 10.0),
        run(2, 0.0, 1.0, None, 20.0),
        run(3, 1.0, 0.0, 50.0, 60.0),
    ]
    failed = {"preset": "a", "scenario": "b", "seed": 4, "status": "failed", "error": "diverged"}
    other = failed | {"preset": "c"}
    assert sweep.groups([*runs, failed, other]) == [
        {
            "preset": "a",
            "scenario": "b",
            "runs": 4,
            "failed": 1,
            "reach_rate": [0.0, 0.9, 1.0],
            "fall_rate": [0.0, 0.1, 1.0],
            "median_time_s": 40.0,
            "cpu_s": 20.0,
            "wall_s": 40.0,
        },
        {
            "preset": "c",
            "scenario": "b",
            "runs": 1,
            "failed": 1,
            "reach_rate": None,
            "fall_rate": None,
            "median_time_s": None,
            "cpu_s": None,
            "wall_s": None,
        },
    ]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--presets", "fats"], "'fast'"),
        (["--scenarios", "learned-sped"], "'learned-speed'"),
        (["--seeds", "0"], "--seeds"),
        (["--parallel", "0"], "--parallel"),
        (["--set", "ddpg.taw=1"], "'tau'"),
        (["--ray-address", "127.0.0.1:1"], "no Ray cluster answers"),
        (["--ray-address", "nonsense"], "no Ray cluster answers"),
    ],
)
def test_mistakes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], expected: str
) -> None:
    assert main.main(["sweep", "--out", str(tmp_path), *words]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert expected in err


class SlowRay:
    """Ray on a busy machine: its first starts fail."""

    def __init__(self, failures: int) -> None:
        self.failures, self.started, self.ended = failures, 0, 0

    def init(self, **options: object) -> None:
        self.started += 1
        if self.started <= self.failures:
            raise Exception("The current node timed out during startup.\nMore of it.")

    def shutdown(self) -> None:
        self.ended += 1


def test_ray_that_cannot_start_at_once_is_started_again() -> None:
    slow = SlowRay(failures=2)
    sweep._start(slow)
    assert (slow.started, slow.ended) == (3, 2)


def test_ray_that_cannot_start_is_told_in_one_line() -> None:
    slow = SlowRay(failures=1000)
    with pytest.raises(ConnectionError) as raised:
        sweep._start(slow)
    assert slow.started == slow.ended == sweep.STARTS
    assert str(raised.value).startswith(
        "Ray does not start, 4 times tried (The current node timed"
    )
    assert "\n" not in str(raised.value)


@pytest.mark.slow
def test_a_killed_sweep_keeps_what_is_done_and_goes_on(tmp_path: Path) -> None:
    out = tmp_path / "sweep"
    command = [sys.executable, "-m", "bicycle_controller.cli.main", "sweep", "--out", str(out)]
    command += ["--scenarios", SCENARIO, "--seeds", "2", "--episodes", "20", "--parallel", "1"]
    for change in [*SHORT, "steps=6000"]:
        command += ["--set", change]
    results = [out / "fast" / SCENARIO / f"seed-{seed}" / "result.json" for seed in (1, 2)]
    killed = subprocess.Popen(command, start_new_session=True)
    until(lambda: any(path.exists() for path in results), killed, 3 * PATIENCE)
    os.kill(killed.pid, signal.SIGKILL)
    killed.wait()
    done = {path: path.stat().st_mtime_ns for path in results if path.exists()}
    finished = subprocess.run([*command, "--json"], capture_output=True, text=True, check=True)
    found = json.loads(finished.stdout)
    assert [run["status"] for run in found["runs"]] == ["finished", "finished"]
    assert [run["seed"] for run in found["runs"]] == [1, 2]
    assert found["groups"][0]["runs"] == 2
    assert {path: path.stat().st_mtime_ns for path in done} == done
    again = subprocess.run([*command, "--json"], capture_output=True, text=True, check=True)
    assert again.stdout == finished.stdout


def test_an_interrupted_sweep_leaves_checkpoints_and_nothing_running(tmp_path: Path) -> None:
    out = tmp_path / "sweep"
    command = [sys.executable, "-m", "bicycle_controller.cli.main", "sweep", "--out", str(out)]
    command += ["--scenarios", SCENARIO, "--seeds", "2", "--parallel", "2", "--quiet"]
    for change in [*SHORT, "steps=10000000"]:
        command += ["--set", change]
    runs = [out / "fast" / SCENARIO / f"seed-{seed}" for seed in (1, 2)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    until(lambda: all((run / "log.jsonl").exists() for run in runs), process)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate()
    assert process.returncode == 130
    assert told.startswith("stopping: each run saves its checkpoint\n")
    assert "Traceback" not in told
    assert all((run / "checkpoint").exists() for run in runs), sorted(runs[0].iterdir())
    assert not any((run / "result.json").exists() for run in runs)


@pytest.mark.slow
def test_ray_makes_the_same_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", sys.argv)
    (there,), (here,) = jobs(tmp_path / "there"), jobs(tmp_path / "here")

    def made() -> bool:
        try:
            sweep._run_on_ray(None, 1, [there], 5, tqdm(disable=True))
        except ConnectionError:  # it gives up after 30 s, too soon for a busy machine
            return False
        return True

    until(made, patience=5.0 * PATIENCE)
    sweep.sweep([here], 5, parallel=1)
    found, expected = (json.loads(job.result.read_text()) for job in (there, here))
    assert found["status"] == expected["status"] == "finished"
    assert found["evaluation"] == expected["evaluation"]
