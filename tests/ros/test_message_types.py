"""Classes of message types by their names."""

from __future__ import annotations

import pytest

from bicycle_tools.nodes.message_types import message_class

pytestmark = pytest.mark.ros


def test_a_message_and_an_action_s_feedback_are_found() -> None:
    from bicycle_msgs.action import RideToPose
    from std_msgs.msg import String

    assert message_class("std_msgs/msg/String") is String
    feedback = message_class("bicycle_msgs/action/RideToPose_FeedbackMessage")
    assert feedback is RideToPose.Impl.FeedbackMessage


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("std_msgs/msg/No", "not installed"),
        ("no/msg/No", "not installed"),
        ("no/action/No_FeedbackMessage", "not installed"),
        ("std_msgs/action/String_FeedbackMessage", "not installed"),
        ("", "not installed"),
        (".../msg/x", "not installed"),
        ("std_msgs/msg/String, std_msgs/msg/Int32", "several types"),
    ],
)
def test_what_cannot_be_found_is_told(kind: str, said: str) -> None:
    with pytest.raises(LookupError, match=said) as caught:
        message_class(kind)
    assert kind in str(caught.value)
