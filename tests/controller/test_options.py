"""The options that the commands share mean the same in all of them."""

from __future__ import annotations

import argparse
import ast
from collections import defaultdict
from pathlib import Path

import pytest

from bicycle_controller.cli import (
    evaluate,
    export,
    identify,
    import_policy,
    info,
    learn,
    options,
    plot,
    reproduce,
    sensing,
    sweep,
    train,
)

COMMANDS = (
    train,
    learn,
    evaluate,
    sweep,
    reproduce,
    export,
    info,
    identify,
    import_policy,
    plot,
    sensing,
)
TWO_MEANINGS = {
    "--to": "a folder, but of `bicycle info` the highest speed",
    "--speeds": "of `bicycle identify` a list, of `bicycle sensing` bounds",
}
"""Options of several commands that are not the same, and what they mean."""


def test_an_option_of_two_commands_has_one_definition() -> None:
    """A name has one type and one way to be stored, whatever its help and default say."""
    found: dict[str, set[tuple[object, ...]]] = defaultdict(set)
    for module in COMMANDS:
        parser = argparse.ArgumentParser()
        module.add_arguments(parser)
        for action in parser._actions:
            for name in action.option_strings:
                found[name].add((type(action), action.type, action.dest, action.nargs))
    several = {name for name, kinds in found.items() if len(kinds) > 1}
    assert several == set(TWO_MEANINGS)


def test_shared_options_are_declared_in_one_module() -> None:
    def declared(path: Path) -> set[str]:
        return {
            str(word.value)
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Call)
            for word in node.args
            if isinstance(word, ast.Constant) and str(word.value).startswith("--")
        }

    home = Path(options.__file__)
    shared = declared(home)
    assert {"--plant", "--bicycle", "--scenario", "--out", "--parallel", "--seed"} <= shared
    others = {path.name: declared(path) & shared for path in home.parent.glob("*.py")}
    del others[home.name]
    assert {name: again for name, again in others.items() if again} == {}


@pytest.mark.parametrize(
    ("text", "value"), [("7", 7), ("2e5", 200_000), (str(2**60 + 1), 2**60 + 1)]
)
def test_a_whole_number_is_exact(text: str, value: int) -> None:
    assert options.whole_number(text) == value


@pytest.mark.parametrize("text", ["x", "1.5", "nan", "inf", ""])
def test_what_is_no_whole_number_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="must be a whole number"):
        options.whole_number(text)


def test_set_comes_after_the_options_of_their_own() -> None:
    parser = argparse.ArgumentParser()
    train.add_arguments(parser)
    words = ["--out", "runs/a", "--seed", "3", "--set", "seed=4", "--set", "ddpg.tau=0.02"]
    config = train.config_of(parser.parse_args(words))
    assert (config.seed, config.ddpg and config.ddpg.tau) == (4, 0.02)
