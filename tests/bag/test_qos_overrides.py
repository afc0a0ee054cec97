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
        ("/a: {deadline: 3}", "/a: "),
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
