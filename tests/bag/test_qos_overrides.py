"""The file of QoS overrides: what ros2 bag record takes, and mistakes in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from bicycle_bag.errors import BagError
from bicycle_bag.qos import INFINITE_NS
from bicycle_bag.qos_overrides import read_overrides


def test_the_example_of_rosbag2s_documentation(tmp_path: Path) -> None:
    path = tmp_path / "qos.yaml"
    path.write_text(
        "/talker:\n  history: keep_all\n"
        "/chatter:\n  reliability: best_effort\n  durability: transient_local\n  depth: 20\n"
        "  history: keep_last\n  deadline: {sec: 0, nsec: 500000000}\n"
        "  liveliness: manual_by_topic\n  avoid_ros_namespace_conventions: false\n"
    )
    read = read_overrides(str(path))
    assert read["/talker"].history == "keep_all"
    assert read["/talker"].reliability == "reliable"
    chatter = read["/chatter"]
    assert (chatter.reliability, chatter.durability) == ("best_effort", "transient_local")
    assert (chatter.history, chatter.depth) == ("keep_last", 20)
    assert (chatter.deadline, chatter.lifespan) == (500_000_000, INFINITE_NS)
    assert chatter.liveliness == "manual_by_topic"
    assert read_overrides("") == {}


def test_a_duration_beyond_the_longest_is_endless(tmp_path: Path) -> None:
    """Other middlewares write their own numbers for it."""
    path = tmp_path / "qos.yaml"
    path.write_text("/a: {lifespan: {sec: 18446744073, nsec: 709551615}}\n")
    assert read_overrides(str(path))["/a"].lifespan == INFINITE_NS


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("- 1", "must hold topics"),
        ("{", "is not YAML"),
        ("/a: 3", "/a must have a QoS profile, not 3"),
        ("/a: {relaibility: reliable}", "'relaibility'; a profile has history, depth"),
        ("/a: {reliability: perfect}", "reliability is 'perfect', not one of"),
        ("/a: {history: unknown}", "history is unknown"),
        ("/a: {depth: -1}", "depth is -1"),
        ("/a: {depth: true}", "depth is True"),
        ("/a: {depth: 99999999999999999999}", "depth is 99999999999999999999: give a whole"),
        ("/a: {deadline: 3}", "/a: deadline is '3': write {sec: 1, nsec: 0}"),
        ("/a: {deadline: {sec: 1}}", "/a: deadline is "),
        ("/a: {lifespan: {sec: .inf, nsec: 0}}", "lifespan is "),
        ("/a: {lifespan: {sec: -1, nsec: 0}}", "lifespan is -1000000000 ns: give 0 to"),
        ("/a: {liveliness: manual_by_node}", "no manual_by_node any more"),
        ("/a: {avoid_ros_namespace_conventions: maybe}", "is 'maybe': give true or false"),
    ],
)
def test_mistakes(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "qos.yaml"
    path.write_text(text)
    with pytest.raises(BagError) as raised:
        read_overrides(str(path))
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)
    with pytest.raises(BagError, match="cannot read"):
        read_overrides(str(tmp_path / "none.yaml"))
