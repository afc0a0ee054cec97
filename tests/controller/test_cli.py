import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from policies import make_policy
from waiting import finish, until

from bicycle_controller.cli import main
from bicycle_controller.control.lqr import LqrController
from bicycle_controller.evaluation.evaluate import evaluate
from bicycle_controller.policy.policy import load_policy, save_policy
from bicycle_sim.plants import registry
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import SCENARIOS

BICYCLE = [sys.executable, "-m", "bicycle_controller.cli.main"]
QUICK = ["--scenario", "fixed-start-fixed-goal", "--episodes", "20", "--seed", "3"]


@pytest.fixture
def policy(tmp_path: Path) -> Path:
    """Return a policy file."""
    path = tmp_path / "random.safetensors"
    save_policy(make_policy(), path)
    return path


def output(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Standard output of a command that succeeds and says nothing else."""
    assert main.main(list(arguments)) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return out


def mistake(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Return the one line with which a command refuses its arguments."""
    status = main.main(list(arguments))
    out, err = capsys.readouterr()
    assert (status, out) == (2, "")
    assert err.startswith("bicycle")
    assert err.count("\n") == 1
    return err


def test_evaluate_prints_what_evaluate_finds(capsys: pytest.CaptureFixture[str]) -> None:
    found = json.loads(output(capsys, "evaluate", "lqr", *QUICK, "--json"))
    scenario = SCENARIOS["fixed-start-fixed-goal"]
    expected = evaluate(LqrController(), scenario, episodes=20, seed=3).summary()
    assert found == json.loads(json.dumps(expected)) | {"unlike_training": []}
    assert found["reach_rate"] > 0.5
    promised = {"episodes", "reach_rate", "fall_rate", "timeout_rate", "median_time_s"}
    promised |= {"reach_rate_interval", "fall_rate_interval", "timeout_rate_interval"}
    assert promised | {"path_ratio", "orbit_rate"} <= found.keys()


def test_evaluate_passes_every_choice_on(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = tmp_path / "new" / "found.json"
    choices = ["--set", "max_steps=40", "--set", "goal.low=[90, 90]", "--set", "goal.high=[99,99]"]
    trial = {
        "roll_kick": 0.1,
        "kick_time": 0.5,
        "initial_tilt": 0.02,
        "displacement_noise": 0.01,
        "action_delay": 2,
        "speed": 3.0,
    }
    for name, value in trial.items():
        choices += [f"--{name.replace('_', '-')}", str(value)]
    choices += ["--observation-noise", "0.01,0,0,0,0,0.02", "--physics", "corrected"]
    output(capsys, "evaluate", "lqr", *QUICK, *choices, "--out", str(out), "--quiet")
    found = json.loads(out.read_text())
    assert found["scenario"]["max_steps"] == 40
    assert found["scenario"]["goal"] == {"low": [90.0, 90.0], "high": [99.0, 99.0]}
    noise = [0.01, 0.0, 0.0, 0.0, 0.0, 0.02]
    assert found["disturbance"] == trial | {"observation_noise": noise}
    assert registry.from_dict(found["physics"]) == ChoiPlant.named("corrected")
    assert (found["episodes"], found["seed"], found["timeout_rate"]) == (20, 3, 1.0)


def test_evaluate_uses_what_the_policy_was_trained_on(
    capsys: pytest.CaptureFixture[str], policy: Path
) -> None:
    found = json.loads(output(capsys, "evaluate", str(policy), "--episodes", "5", "--json"))
    assert found["scenario"]["name"] == "random-start-random-goal"
    assert found["controller"] == load_policy(policy).policy_id


def test_an_onnx_file_rides_what_it_was_trained_on_too(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    pytest.importorskip("onnxruntime")
    output(capsys, "export", "any-bicycle", "--to", str(tmp_path), "--format", "onnx")
    words = ("--episodes", "1", "--set", "max_steps=3", "--kicks", "none", "--json")
    (file,) = tmp_path.glob("*.onnx")
    worlds = [
        {key: json.loads(output(capsys, "evaluate", name, *words))[key] for key in WORLD}
        for name in (str(file), "any-bicycle")
    ]
    assert worlds[0] == worlds[1]
    assert worlds[0]["unlike_training"] == []


WORLD = ("scenario", "physics", "unlike_training")


@pytest.mark.parametrize(
    ("words", "unlike"),
    [
        ([], []),
        (["--physics", "faithful", "--displacement-noise", "0.01"], []),
        (
            ["--physics", "corrected"],
            [
                "chord_follows_steering true, not false",
                "gyroscopic_correction true, not false",
                "stop_absorbs_steering true, not false",
            ],
        ),
        (["--speed", "1"], ["start speed 1 m/s, not 2.78"]),
        (["--set", "torque_limit=0.5"], ["torque limited to 0.5 N m, not 2"]),
    ],
)
def test_a_policy_that_rides_another_bicycle_than_it_was_trained_on_is_warned_of(
    capsys: pytest.CaptureFixture[str], policy: Path, words: list[str], unlike: list[str]
) -> None:
    assert main.main(["evaluate", str(policy), "--episodes", "2", "--json", *words]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["unlike_training"] == unlike
    assert printed.err.count("\n") == bool(unlike)
    for text in unlike:
        assert text in printed.err
    assert main.main(["evaluate", "lqr", *QUICK, *words, "--against", str(policy)]) == 0
    said = capsys.readouterr().err
    assert ("lqr" in said, policy_id(policy) in said) == (False, bool(unlike))


def policy_id(path: Path) -> str:
    return load_policy(path).policy_id


def test_evaluate_takes_a_run_folder(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    save_policy(make_policy(), tmp_path / "run" / "best.safetensors")
    text = output(capsys, "evaluate", str(tmp_path / "run"), *QUICK)
    assert make_policy().policy_id in text
    assert "reached the goal" in text


def test_evaluate_compares(capsys: pytest.CaptureFixture[str], policy: Path) -> None:
    words = ["evaluate", "lqr", "--against", str(policy), *QUICK]
    found = json.loads(output(capsys, *words, "--json"))
    assert found["comparison"]["controllers"] == [
        found["controller"],
        found["against"]["controller"],
    ]
    assert found["comparison"]["only_first_reaches"] > 10
    assert "only lqr" in output(capsys, *words)


def test_evaluate_without_a_gpu_says_so(capsys: pytest.CaptureFixture[str], policy: Path) -> None:
    assert main.main(["evaluate", str(policy), *QUICK, "--device", "cuda:63"]) == 0
    assert "runs on the CPU" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["evalute"], "'evaluate'"),
        (["evaluate"], "CONTROLLER"),
        (["evaluate", "lrq"], "'lqr'"),
        (["evaluate", "lqr", "--episods", "3"], "'--episodes'"),
        (["evaluate", "lqr", "--episodes", "many"], "--episodes"),
        (["evaluate", "lqr", "--episodes", "0"], "at least one"),
        (["evaluate", "lqr", "--seed", "-1"], "seed"),
        (["evaluate", "lqr", "--scenario", "learned-sped"], "'learned-speed'"),
        (["evaluate", "lqr", "--set", "goal_radus=2"], "'goal_radius'"),
        (["evaluate", "lqr", "--set", "goal_radius=-2"], "goal_radius"),
        (["evaluate", "lqr", "--set", "goal_radius"], "NAME=VALUE"),
        (["evaluate", "lqr", "--physics", "corected"], "'corrected'"),
        (["evaluate", "lqr", "--device", "cdua"], "'cuda'"),
        (["evaluate", "lqr", "--observation-noise", "1,2"], "1 or 6"),
        (["evaluate", "lqr", "--speed", "0"], "start_speed"),
        (["evaluate", "lqr", "--out", "/proc/none/a.json"], "/proc/none"),
        (["export", "none", "--to", "/tmp"], "none"),
        (["train", "--out", "/tmp/none", "--preset", "fats"], "'fast'"),
        (["train", "--out", "/tmp/none", "--seed", "x"], "--seed: must be a whole number"),
        (["train", "--out", "/tmp/none", "--steps", "1.5"], "--steps: must be a whole number"),
        (["learn", "--out", "/tmp/none", "--updates", "nan"], "--updates: must be a whole"),
        (["learn", "--out", "/tmp/none", "--resume", "--seed", "0"], "its own seed"),
        (["reproduce", "11", "--short", "--device", "cdua"], "must be one of cpu, cuda"),
    ],
)
def test_a_mistake_is_one_line_with_the_remedy(
    capsys: pytest.CaptureFixture[str], words: list[str], expected: str
) -> None:
    assert expected in mistake(capsys, *words)


WITHOUT_CHANCE = ("identify", "import", "info", "plot")
"""Commands that draw nothing and run no network."""
WITHOUT_TORCH = ("sensing",)
"""Commands that ride one step at a time, with the controllers of the node."""


def test_every_command_has_help_seed_device_and_json(capsys: pytest.CaptureFixture[str]) -> None:
    for name in main.COMMANDS:
        text = output(capsys, name, "--help")
        wanted = ["--help", "--json"]
        wanted += [] if name in WITHOUT_CHANCE else ["--seed"]
        wanted += [] if name in (*WITHOUT_CHANCE, *WITHOUT_TORCH) else ["--device"]
        for option in wanted:
            assert option in text, f"{name} lacks {option}"
        assert name in output(capsys)


def test_export_writes_what_loads_again(
    capsys: pytest.CaptureFixture[str], policy: Path, tmp_path: Path
) -> None:
    scored = tmp_path / "scored.json"
    output(capsys, "evaluate", str(policy), *QUICK, "--out", str(scored))
    words = ["--name", "new", "--to", str(tmp_path / "to"), "--evaluation", str(scored), "--json"]
    found = json.loads(output(capsys, "export", str(policy), *words))
    new = load_policy(tmp_path / "to" / "new.safetensors")
    assert found["policy_id"] == new.policy_id
    assert new.policy_id.startswith("new@")
    assert set(found["parity"]) == {"onnxruntime", "torch"}
    assert sorted(path.name for path in (tmp_path / "to").iterdir()) == [
        "new.md",
        "new.onnx",
        "new.safetensors",
    ]
    card = (tmp_path / "to" / "new.md").read_text()
    assert f"| controller | {new.policy_id} |" in card
    only = ["--to", str(tmp_path / "only"), "--format", "safetensors"]
    assert "wrote" in output(capsys, "export", str(policy), *only)
    files = sorted(path.name for path in (tmp_path / "only").iterdir())
    assert files == ["random.md", "random.safetensors"]


def test_export_refuses_another_policy_s_evaluation(
    capsys: pytest.CaptureFixture[str], policy: Path, tmp_path: Path
) -> None:
    scored = tmp_path / "scored.json"
    output(capsys, "evaluate", "lqr", *QUICK, "--out", str(scored))
    words = ["export", str(policy), "--to", str(tmp_path / "to"), "--evaluation"]
    assert "is about lqr" in mistake(capsys, *words, str(scored))
    scored.write_text("{}")
    assert "evaluate again" in mistake(capsys, *words, str(scored))
    assert "unknown format" in mistake(capsys, *words[:-1], "--format", "onx")
    assert not (tmp_path / "to").exists()


def test_ctrl_c_ends_without_a_traceback(tmp_path: Path) -> None:
    begun = tmp_path / "begun"
    words = ["evaluate", "lqr", "--episodes", "1000000", "--out", str(begun / "found.json")]
    process = subprocess.Popen(
        [*BICYCLE, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A test run in a shell's background ignores SIGINT, and so would this.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    until(begun.exists, process)
    process.send_signal(signal.SIGINT)
    out, err = finish(process)
    assert process.returncode == 130
    assert out == ""
    assert err == "bicycle evaluate: interrupted\n"


def test_help_loads_nothing_heavy() -> None:
    code = "import sys; from bicycle_controller.cli.main import main; main([])"
    code += "; print(*sys.modules)"
    text = subprocess.check_output([sys.executable, "-c", code], text=True)
    loaded = text.splitlines()[-1].split()
    assert "bicycle_controller.cli.main" in loaded
    assert not {"numpy", "torch", "ray", "scipy"} & set(loaded)


def test_no_command_loads_torch_to_tell_its_arguments() -> None:
    """It takes four seconds."""
    words = "import sys; from bicycle_controller.cli import main\n"
    words += "for name in main.COMMANDS: main.main([name, '--help'])\n"
    words += "print('torch' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", words], capture_output=True, text=True, check=True
    )
    assert done.stdout.count("usage: bicycle ") == len(main.COMMANDS)
    assert done.stdout.endswith("\nFalse\n")


def test_missing_torch_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "torch.py").write_text("raise ModuleNotFoundError(name='torch')\n")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [*BICYCLE, "train", "--out", str(tmp_path / "run")],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": path},
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "needs torch" in done.stderr
    assert "setup.sh --with train" in done.stderr
