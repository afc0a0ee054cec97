"""Texts without end, or with line feeds, in messages: a node tells of them in lines that end."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from bicycle_msgs.msg import BicycleCommand
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from node_process import NodeProcess
from probe import Probe
from waiting import until

from bicycle_common.nodes.log_lines import LONGEST, shortened
from bicycle_common.nodes.topics import COMMAND, GOAL_POSE, INITIAL_POSE, STATE

pytestmark = pytest.mark.ros

ENDLESS = "x" * 10_000_000
MOST = LONGEST + 200
"""Characters of a line, with its time and name."""


def test_messages_of_10_mb_make_lines_that_end(
    ros_domain: int, tmp_path: Path, start_node: Callable[..., NodeProcess]
) -> None:
    sim = start_node("bicycle_sim.nodes.sim_node")
    sim.wait_for_line("waits for its first command")
    controller = start_node("bicycle_controller.nodes.controller_node")
    controller.wait_for_line("waits for a goal")
    probe = Probe(ros_domain, STATE)
    for topic in (COMMAND, GOAL_POSE, INITIAL_POSE):
        probe.publisher(topic)
    command = BicycleCommand(episode=1, step=10**6, controller=ENDLESS)
    pose = PoseWithCovarianceStamped()
    goal = PoseStamped()
    pose.header.frame_id = goal.header.frame_id = ENDLESS
    for topic, message in ((COMMAND, command), (GOAL_POSE, goal), (INITIAL_POSE, pose)):
        probe.say(topic, message)
    warnings = ("command for step", "initial pose ignored")
    probe.spin_until(lambda: all(words in sim.output for words in warnings))
    probe.spin_until(lambda: "goal rejected" in controller.output)
    heard = len(probe[STATE])
    probe.spin_until(lambda: len(probe[STATE]) > heard)
    probe.close()
    assert sim.stop() == controller.stop() == 0
    logs = list(Path(os.environ["ROS_LOG_DIR"]).glob("*.log"))
    assert logs
    lines = [*sim.lines, *controller.lines, *(line for log in logs for line in written(log))]
    assert max(map(len, lines)) <= MOST
    assert sum("characters) ..." in line for line in lines) >= 3


def test_a_name_in_a_message_forges_no_line(
    ros_domain: int, start_node: Callable[..., NodeProcess]
) -> None:
    controller = start_node("bicycle_controller.nodes.controller_node")
    controller.wait_for_line("waits for a goal")
    probe = Probe(ros_domain)
    wrong = PoseStamped()
    wrong.header.frame_id = FORGED
    probe.say(GOAL_POSE, wrong)
    controller.wait_for_line("goal rejected")
    probe.close()
    assert controller.stop() == 0
    assert "\x1b" not in controller.output
    assert not any(line.startswith("[FATAL]") for line in controller.lines)


FORGED = "\x1b[31mred\n[FATAL] [1.0] [bicycle_sim]: the brakes failed"


def test_a_line_has_no_second_one_in_it() -> None:
    said = shortened(f"frame {FORGED}")
    assert said == "frame \\x1b[31mred\\n[FATAL] [1.0] [bicycle_sim]: the brakes failed"
    assert shortened("Åse rides at 2 m/s²") == "Åse rides at 2 m/s²"


def written(log: Path) -> list[str]:
    until(log.exists)
    return log.read_text().splitlines()


def test_a_line_keeps_its_beginning_and_its_end() -> None:
    assert shortened("a line") == "a line"
    cut = shortened("begin" + ENDLESS + "end")
    assert cut.startswith("begin")
    assert cut.endswith("end")
    assert "(10000008 characters)" in cut
    assert len(cut) < MOST
