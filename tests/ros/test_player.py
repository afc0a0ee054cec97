"""Rules of a replay for others that publish the same topics."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from std_msgs.msg import String

from bicycle_bag.errors import BagError
from bicycle_bag.nodes import others, player
from bicycle_bag.nodes.player import Player

pytestmark = pytest.mark.ros
TOPIC = "/player_test"


@pytest.fixture
def nodes(ros_domain: int) -> Iterator[tuple[Node, Node]]:
    context = Context()
    rclpy.init(context=context, domain_id=ros_domain)
    found = Node("one", context=context), Node("other", context=context)
    yield found
    for node in found:
        node.destroy_node()
    context.try_shutdown()


@pytest.mark.parametrize("stays", [True, False])
def test_others_that_end_while_it_looks_are_no_reason_to_refuse(
    nodes: tuple[Node, Node], stays: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    node, other = nodes
    publisher = other.create_publisher(String, TOPIC, 1)
    looking = Player.__new__(Player)
    looking._node, looking._guarded = node, [TOPIC]
    really, looks = others.other_publishers, []

    def look(*words: object) -> dict[str, list[str]]:
        """Look, and end the other one after the first look that has found it."""
        found = really(*words)  # type: ignore[arg-type]
        looks.append(found)
        if found and not stays:
            other.destroy_publisher(publisher)
            while really(*words):  # type: ignore[arg-type]
                pass
        return found

    monkeypatch.setattr(player, "other_publishers", look)
    if stays:
        with pytest.raises(BagError, match="published by /other"):
            looking._look_around(own=0, patience=10.0)
    else:
        looking._look_around(own=0, patience=1.0)
    assert {"/other": [TOPIC]} in looks
