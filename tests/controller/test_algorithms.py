import re
from pathlib import Path

import pytest

from bicycle_controller.config import loading


@pytest.mark.parametrize(
    ("preset", "override", "words"),
    [
        ("ppo", "warm_up=5", "warm_up must be 0 for ppo"),
        ("ppo", "noise.kind=ou", "noise.kind must be none for ppo"),
        ("ppo", "updates=2", "updates must be 1 for ppo"),
        ("ppo", "ppo.batch=5000", "ppo.batch must be at most 2048"),
        ("ppo", "ppo.clip=0", "clip must be above zero"),
        ("ppo", "ppo.gae_lamda=0.9", "did you mean 'gae_lambda'"),
        ("ppo", "ppo=null", "exactly one of ddpg, naf, ppo, imitation, not none"),
        ("naf", "naf.tau=2", "tau must lie within"),
        ("naf", "naf.hidden=[]", "hidden needs sizes"),
        ("naf", "naf.gamma=1", "gamma must lie within 0 and below 1"),
    ],
)
def test_a_mistake_is_one_line_that_names_the_field(
    preset: str, override: str, words: str
) -> None:
    with pytest.raises(ValueError, match=re.escape(words)) as caught:
        loading.preset(preset, [override])
    assert "\n" not in str(caught.value)


def test_a_run_has_one_algorithm(tmp_path: Path) -> None:
    path = tmp_path / "two.yaml"
    path.write_text(loading.dump(loading.preset("naf")).replace("ddpg: null\n", ""))
    assert loading.load(path).algorithm == "naf"
    path.write_text("extends: naf\nppo:\n" + _ppo_part())
    with pytest.raises(
        ValueError, match="exactly one of ddpg, naf, ppo, imitation, not naf and ppo"
    ):
        loading.load(path)


def _ppo_part() -> str:
    text = loading.dump(loading.preset("ppo"))
    return text.split("ppo:\n")[1].split("bicycles:")[0]
