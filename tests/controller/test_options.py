"""The options that the commands share mean the same in all of them."""

from __future__ import annotations

import argparse
from collections import defaultdict

import pytest

from bicycle_controller.cli import evaluate, export, info, learn, options, reproduce, sweep, train

COMMANDS = (train, learn, evaluate, sweep, reproduce, export, info)


def test_an_option_of_two_commands_has_one_definition() -> None:
    """A name has one type and one way to be stored, whatever its help and default say."""
    found: dict[str, set[tuple[object, ...]]] = defaultdict(set)
    for module in COMMANDS:
        parser = argparse.ArgumentParser()
        module.add_arguments(parser)
        for action in parser._actions:
            for name in action.option_strings:
                found[name].add((type(action), action.type, action.dest, action.nargs))
    shared = ("--set", "--seed", "--device", "--json", "--quiet", "--out", "--resume", "--steps")
    assert {name: len(found[name]) for name in shared} == dict.fromkeys(shared, 1)


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
