"""The command line of a ride and the parameter files."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
import yaml

from bicycle_bringup.ride_options import parse
from bicycle_common.node_commands import config_folder
from bicycle_common.parameters import parameters_of
from bicycle_sim.nodes.sim_settings import SimSettings
from bicycle_tools.rates import Rate


def test_each_node_gets_its_own_parameters(tmp_path: Path) -> None:
    extra = tmp_path / "mine.yaml"
    extra.write_text("{}")
    words = ["--goals", "3", "controller.policy:=lqr", "simulator.pace:=lockstep", str(extra)]
    options = parse([*words, "simulator.seed:=4"], tmp_path)
    assert (options.goals, options.minutes, options.respawn) == (3, 0.0, True)
    simulator, controller = options.command("simulator"), options.command("controller")
    assert simulator[:3] == [sys.executable, "-m", "bicycle_sim.nodes.sim_node"]
    assert simulator[-4:] == ["-p", "pace:=lockstep", "-p", "seed:=4"]
    assert controller[-2:] == ["-p", "policy:=lqr"]
    assert str(extra) in simulator
    assert simulator.index(str(config_folder() / "simulator.yaml")) < simulator.index(str(extra))
    assert options.command("recorder")[-2:] == ["--output", str(options.folder / "bag")]


def test_runs_are_numbered_and_never_overwritten(tmp_path: Path) -> None:
    folders = [parse([], tmp_path).folder for _ in range(3)]
    assert [folder.name[-2:] for folder in folders] == ["-1", "-2", "-3"]
    assert all(folder.parent == tmp_path / "runs" for folder in folders)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--goals", "0"], "--goals is 0"),
        (["--goals", "many"], "invalid int value"),
        (["--minutes", "nan"], "--minutes is nan"),
        (["--seed", "-1"], "--seed is -1"),
        (["--field", "5"], "--field is 5.0: choose 20 to 2000 m"),
        (["--gaols", "3"], "unrecognized arguments: --gaols"),
        (["pace:=lockstep"], "names no node"),
        (["simulator.:=3"], "names no parameter of simulator"),
        (["simulator.9:=3"], "names no parameter of simulator"),
        (["controller.a b:=3"], "names no parameter of controller"),
        (["simulator.plant:="], "gives no value"),
        (["controller.policy:= "], "gives no value"),
        (["simulater.pace:=lockstep"], "did you mean 'simulator'"),
        (["none.yaml"], "no parameter file 'none.yaml'"),
        (["ten"], "unknown argument 'ten'"),
    ],
)
def test_mistakes_are_one_line(
    tmp_path: Path, words: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        parse(words, tmp_path)
    assert caught.value.code == 2
    error = capsys.readouterr().err
    assert complaint in error
    assert error.count("\n") == 1
    assert error.endswith("; see ride.sh --help\n")


def test_an_existing_output_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parse(["--output", str(tmp_path)], tmp_path)
    assert "exists: choose another --output" in capsys.readouterr().err


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_an_unwritable_workspace_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(SystemExit):
        parse([], tmp_path)
    assert "cannot make a folder" in capsys.readouterr().err


def test_the_simulators_file_holds_its_defaults() -> None:
    stored = yaml.safe_load((config_folder() / "simulator.yaml").read_text())
    defaults = {item.name: item.default for item in parameters_of(SimSettings)}
    assert stored == {"/**": {"ros__parameters": defaults}}


def test_a_rate_is_taken_over_its_window() -> None:
    rate = Rate(window=5)
    assert str(rate) == "0 messages so far"
    for index in range(10):
        rate.add(0.1 * index if index < 5 else 0.4 + 0.025 * (index - 4), 100)
    assert rate.hertz == pytest.approx(40.0)
    assert str(rate).startswith("40.00 Hz, period 25.0 to 25.0 ms")
    assert "10 messages" in str(rate)
