"""ROS arguments of a command line, told from values of options."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable

import pytest

from bicycle_bag.nodes import player_node, recorder_node

QOS = "--qos-profile-overrides-path"


@pytest.mark.parametrize("parse", [player_node.parse, recorder_node.parse])
def test_the_value_of_an_option_is_no_word_of_ros(
    parse: Callable[..., tuple[Namespace, list[str]]],
) -> None:
    """A YAML file after this option was once taken for a file of parameters."""
    bag = ["bag"] if parse is player_node.parse else []
    options, ros = parse([*bag, QOS, "mine.yaml", "--topics", "/a", "/b.yaml"])
    assert (options.qos_profile_overrides_path, options.topics) == ("mine.yaml", ["/a", "/b.yaml"])
    assert ros == []
    options, ros = parse([*bag, f"{QOS}=mine.yaml"])
    assert (options.qos_profile_overrides_path, ros) == ("mine.yaml", [])


def test_what_is_ros_is_passed_on() -> None:
    words = ["__ns:=/red", "bag", "/a:=/b", "--loop", "__node:=mine", "--rate", "2"]
    options, ros = player_node.parse([*words, "--ros-args", "--log-level", "warn", "--", "-p"])
    assert (str(options.bag), options.loop, options.rate, options.start_paused) == (
        *("bag", True, 2.0),
        True,
    )
    rules = ["-r", "__ns:=/red", "-r", "/a:=/b", "-r", "__node:=mine"]
    assert ros == ["--ros-args", *rules, "--log-level", "warn"]


def test_options_with_rules_and_with_a_value_that_may_lack() -> None:
    options, ros = player_node.parse(["bag", "--remap", "/a:=/b", "c:=d", "--clock", "__ns:=/x"])
    assert (options.remap, options.clock) == (["/a:=/b", "c:=d"], 40.0)
    assert ros == ["--ros-args", "-r", "__ns:=/x"]
    options, ros = player_node.parse(["bag", "--clock", "100", "--topics", "/a", "__ns:=/x"])
    assert (options.clock, options.topics, ros[1:]) == (100.0, ["/a"], ["-r", "__ns:=/x"])


def test_a_parameter_is_a_mistake_where_there_are_none(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        recorder_node.parse(["pace:=lockstep"])
    said = capsys.readouterr().err
    assert end.value.code == 2
    assert said.count("\n") == 1
    assert "there are no parameters here, so 'pace:=lockstep' does nothing" in said
