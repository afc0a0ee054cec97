import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from training_maker import ddpg_of, small_run

from bicycle_controller.config import loading
from bicycle_controller.config.run import DdpgConfig, EvaluationConfig, StartsConfig
from bicycle_sim.task.scenario import SCENARIOS


def test_the_paper_preset_is_tables_2_and_3() -> None:
    config = loading.preset("paper")
    ddpg, noise = ddpg_of(config), config.noise
    assert (ddpg.actor_hidden, ddpg.critic_hidden) == ((400, 300), (200, 200))
    assert (ddpg.actor_learning_rate, ddpg.critic_learning_rate) == (1e-3, 1e-3)
    assert (ddpg.initialisation, ddpg.action_layer) == ("literal", 2)
    assert (ddpg.gamma, ddpg.tau, ddpg.batch, ddpg.capacity) == (0.99, 0.001, 64, 500_000)
    assert (noise.kind, noise.theta, noise.sigma) == ("ou", 0.15, 0.2)
    assert (ddpg.fall, config.bicycles) == ("frozen", 1)


def test_the_paper_preset_uses_nothing_that_the_paper_has_not() -> None:
    found = ddpg_of(loading.preset("paper"))
    plain = {
        "n_step": 1,
        "critics": 1,
        "actor_every": 1,
        "reward_scale": 1.0,
        "bound_values": False,
        "actor_layer_norm": False,
        "critic_layer_norm": False,
        "mirror": False,
    }
    zero = ("fall_penalty", "smoothing", "huber", "grad_clip", "saturation_penalty", "bc_weight")
    assert {name: getattr(found, name) for name in plain} == plain
    assert not any(getattr(found, name) for name in zero)


def test_rows_28_to_31_35_and_36_the_authors_preset() -> None:
    config = loading.preset("authors")
    ddpg = ddpg_of(config)
    assert ddpg.critic_hidden == (400, 300)
    assert (ddpg.actor_learning_rate, ddpg.critic_learning_rate) == (1e-4, 1e-3)
    assert ddpg.initialisation == "output"
    assert (config.noise.sigma, config.noise.theta) == (0.1, 0.15)
    scale = (math.pi / 2, 1, math.pi / 6, 1, 1, 1)
    assert ddpg.observation_scale == pytest.approx(scale)
    assert (config.warm_up, config.starts.max_steps) == (1000, 400)


@pytest.mark.parametrize("name", loading.preset_names())
def test_every_preset_survives_yaml(name: str, tmp_path: Path) -> None:
    config = loading.preset(name, ["scenario.max_steps=77", "physics=corrected", "seed=5"])
    path = tmp_path / "config.yaml"
    path.write_text(loading.dump(config))
    assert loading.load(path) == config
    assert config.preset == name


def test_a_file_may_extend_a_preset(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("extends: authors\nddpg:\n  tau: 5e-3\nscenario: learned-speed\n")
    config = loading.load(path, ["ddpg.n_step=3", "noise.sigma=0.3"])
    base = loading.preset("authors")
    assert config.ddpg == replace(ddpg_of(base), tau=0.005, n_step=3)
    assert config.noise == replace(base.noise, sigma=0.3)
    assert config.scenario == SCENARIOS["learned-speed"]


def test_an_override_changes_what_it_names_and_nothing_else() -> None:
    base = loading.preset("fast")
    config = loading.preset("fast", ["scenario.reward.heading_error=3", "steps=2e5"])
    assert config.scenario.reward == replace(base.scenario.reward, heading_error=3.0)
    assert isinstance(config.steps, int)
    assert replace(config, steps=base.steps, scenario=base.scenario) == base


def test_a_scenario_of_ones_own_in_yaml() -> None:
    own = {
        "name": "yard",
        "start": {"low": [0, 0], "high": [9, 9]},
        "goal": {"low": [3, 3], "high": [3, 3]},
    }
    tree = yaml.safe_load(loading.dump(loading.preset("paper"))) | {"scenario": own}
    scenario = loading.build(tree).scenario
    assert (scenario.name, scenario.start.high, scenario.max_steps) == ("yard", (9.0, 9.0), 400)


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("ddpg.tua=0.01", ["DdpgConfig", "'tua'", "'tau'"]),
        ("dpg.tau=0.01", ["'dpg'", "'ddpg'"]),
        ("scenario.max_step=9", ["'max_step'", "'max_steps'"]),
        ("scenario=learned-sped", ["'learned-sped'", "'learned-speed'"]),
        ("physics=exact", ["'exact'", "faithful"]),
        ("starts.tlit=0.1", ["'tlit'", "'tilt'"]),
        ("ddpg.batch=1.5", ["ddpg.batch", "whole number"]),
        ("ddpg.tau=fast", ["ddpg.tau", "number", "'fast'"]),
        ("ddpg.mirror=1", ["ddpg.mirror", "true or false"]),
        ("ddpg.actor_hidden=300", ["ddpg.actor_hidden", "list"]),
        ("ddpg.observation_scale=[1, 2]", ["observation_scale", "six"]),
        ("starts.near_distance=[1, 2, 3]", ["starts.near_distance", "2 values"]),
        ("ddpg=3", ["DdpgConfig", "mapping"]),
        ("ddpg.tau", ["'ddpg.tau'", "NAME=VALUE"]),
        ("ddpg.tau=[", ["cannot read the value"]),
        ("=3", ["NAME=VALUE"]),
        ("seed=nan", ["seed", "whole number"]),
        ("bicycles=true", ["bicycles", "whole number"]),
    ],
)
def test_a_typo_is_one_line_that_names_the_nearest(override: str, words: list[str]) -> None:
    with pytest.raises(ValueError, match=re.escape(words[0])) as caught:
        loading.preset("fast", [override])
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


def test_an_unknown_preset_names_the_nearest() -> None:
    with pytest.raises(ValueError, match="did you mean 'paper'"):
        loading.preset("papr")


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("ddpg: [", "cannot read"),
        ("- 1", "mapping"),
        ("extends: papr", "papr"),
        ("steps: 5", "missing noise"),
        ("extends: paper\nddgp: {}", "ddpg"),
    ],
)
def test_a_bad_file_is_one_line_with_its_name(text: str, word: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=word) as caught:
        loading.load(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_one_line() -> None:
    with pytest.raises(ValueError, match="cannot read the configuration /nowhere"):
        loading.load(Path("/nowhere.yaml"))


@pytest.mark.parametrize(
    "changes",
    [
        {"actor_hidden": ()},
        {"critic_hidden": (0,)},
        {"actor_learning_rate": 0.0},
        {"critic_learning_rate": math.nan},
        {"tau": 1.1},
        {"gamma": 1.0},
        {"batch": 0},
        {"critics": 3},
        {"action_layer": 3},
        {"action_layer": 0},
        {"observation_scale": (1.0, 1.0, 0.0, 1.0, 1.0, 1.0)},
        {"initialisation": "zero"},
        {"fall": "terminal"},
        {"backend": "jax"},
        {"reward_min": 1.0},
        {"grad_clip": -1.0},
    ],
)
def test_impossible_ddpg_is_refused(changes: dict[str, Any]) -> None:
    config = ddpg_of(loading.preset("paper"))
    with pytest.raises(ValueError, match=next(iter(changes))):
        replace(config, **changes)


def test_impossible_starts_and_evaluations_are_refused() -> None:
    with pytest.raises(ValueError, match="near_share"):
        StartsConfig(near_share=1.5)
    with pytest.raises(ValueError, match="near_distance"):
        StartsConfig(near_distance=(3.0, 2.0))
    with pytest.raises(ValueError, match=r"evaluation\.every"):
        EvaluationConfig(every=0)
    with pytest.raises(ValueError, match="device"):
        small_run("device=tpu")


def test_the_least_value_counts_penalty_and_scale() -> None:
    changes: dict[str, Any] = {
        "reward_min": -20.0,
        "fall_penalty": 5.0,
        "reward_scale": 0.1,
        "gamma": 0.9,
    }
    config: DdpgConfig = replace(ddpg_of(loading.preset("paper")), **changes)
    assert config.value_min == pytest.approx(-25.0)


def test_a_mirror_without_displacement_refuses_the_pedal() -> None:
    fixed = ("scenario=learned-speed", "scenario.displacement_limit=0")
    with pytest.raises(ValueError, match=r"need a scenario\.displacement_limit above zero"):
        loading.preset("fast", fixed)
    assert loading.preset("fast", ["scenario.displacement_limit=0"]).learner.gamma == 0.99


@pytest.mark.parametrize(("old", "new"), loading.RENAMED.items())
def test_a_preset_of_another_name_tells_the_new_one(
    old: str, new: str, capsys: pytest.CaptureFixture[str]
) -> None:
    loading._say_renamed.cache_clear()
    assert loading.preset(old) == loading.preset(old) == loading.preset(new)
    assert capsys.readouterr().err == f"the preset {old!r} is called {new!r} now\n"
