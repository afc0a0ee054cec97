"""Paths and cmd_vel by topic: what is ridden, and what is refused where others can see it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import pytest
from bicycle_msgs.msg import BicycleState
from geometry_msgs.msg import Twist, TwistStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from nav_msgs.msg import Path
from node_process import NodeProcess
from probe import Probe, goal

from bicycle_common.nodes import convert, topics
from bicycle_common.nodes.topics import Service
from bicycle_controller.control.guide import PathEnd

pytestmark = [
    pytest.mark.ros,
    pytest.mark.slow,
    pytest.mark.usefixtures("no_new_shared_memory"),
]

StartNode = Callable[..., NodeProcess]
MOST_STEPS = 100_000
"""Steps in which a turn must be ridden to its end; one takes 1,000."""
CHANGE = Service("bicycle_controller/change_state", ChangeState)


def words(**values: object) -> list[str]:
    return ["--ros-args", *(w for n, v in values.items() for w in ("-p", f"{n}:={v}"))]


@pytest.fixture
def controller(start_node: StartNode) -> NodeProcess:
    """The controller of a Whipple bicycle with rider in lock-step; it is not active yet."""
    bicycle = {"plant": "whipple", "bicycle": "browser-rider", "start_speed": 3.0}
    sim = words(pace="lockstep", scenario="learned-speed", **bicycle)
    start_node("bicycle_sim.nodes.sim_node", sim).wait_for_line("episode 1 waits")
    # In lock-step the next command may come after many simulated seconds.
    settings = words(policy="lqr-pedal", managed="true", cmd_vel_timeout=60.0)
    node = start_node("bicycle_controller.nodes.controller_node", settings)
    node.wait_for_line("waits to be configured and activated")
    return node


@pytest.fixture
def probe(ros_domain: int, controller: NodeProcess) -> Iterator[Probe]:
    probe = Probe(ros_domain, topics.STATE, topics.COMMAND, topics.PATH_STATUS)
    yield probe
    probe.close()


def activate(probe: Probe, controller: NodeProcess) -> None:
    for number in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
        request = ChangeState.Request(transition=Transition(id=number))
        assert probe.call(CHANGE, request).success
    controller.wait_for_line("waits for a goal")


def path(*points: tuple[float, float], frame: str = "odom") -> Path:
    message = Path(poses=[goal(x, y, frame) for x, y in points])
    message.header.frame_id = frame
    return message


def refusal(probe: Probe, message: Path) -> str:
    """Return why a path is refused on bicycle/path_status."""
    before = len(probe[topics.PATH_STATUS])
    probe.say(topics.FOLLOW_PATH, message)
    probe.spin_until(lambda: len(probe[topics.PATH_STATUS]) > before)
    status = probe[topics.PATH_STATUS][-1]
    assert (status.status, status.path_id) == (PathEnd.REJECTED, 0)
    return str(status.message)


def newer(probe: Probe, seen: int) -> list[BicycleState]:
    """Return the states after the first `seen`."""
    return probe[topics.STATE][seen:]


def twist(speed: float, yaw_rate: float) -> Twist:
    message = Twist()
    message.linear.x, message.angular.z = speed, yaw_rate
    return message


def stamped(speed: float, yaw_rate: float, stamp: float = 0.0, frame: str = "") -> TwistStamped:
    message = TwistStamped(twist=twist(speed, yaw_rate))
    message.header.stamp = convert.to_stamp(round(stamp * 1e9))
    message.header.frame_id = frame
    return message


def test_what_is_refused_is_told(probe: Probe, controller: NodeProcess) -> None:
    straight = path((0.0, 0.0), (50.0, 0.0))
    assert "not active" in refusal(probe, straight)
    probe.say(topics.CMD_VEL_PLAIN, twist(3.0, 0.1))
    controller.wait_for_line("cmd_vel ignored: the controller is not active")
    activate(probe, controller)
    assert "not finite" in refusal(probe, path((0.0, 0.0), (math.nan, 0.0)))
    assert "its frame is 'mars'" in refusal(probe, path((0.0, 0.0), (50.0, 0.0), frame="mars"))
    assert probe[topics.COMMAND] == []  # nothing of all that was ridden


@pytest.mark.parametrize(
    ("frame", "age", "said"),
    [
        ("map", 0.0, "its frame is 'map': send it in 'base_link'"),
        ("base_link", 100.0, r"it is 1\d\d\.\d s old, more than cmd_vel_timeout"),
    ],
)
def test_a_foreign_or_an_old_cmd_vel_does_not_steer(
    probe: Probe, controller: NodeProcess, frame: str, age: float, said: str
) -> None:
    activate(probe, controller)
    message = stamped(3.0, 0.1, time.time() - age, frame)
    probe.say(topics.CMD_VEL, message)
    controller.wait_for_line(f"cmd_vel ignored: .*{said}")
    for _ in range(5):
        probe.say(topics.CMD_VEL, message)
    probe.spin_for(0.5)
    assert probe[topics.COMMAND] == []
    assert len([line for line in controller.lines if "cmd_vel ignored" in line]) == 1

    # By the simulator's clock it is fresh, and without a stamp it is taken as it comes.
    state = probe[topics.STATE][-1].header.stamp
    now = state.sec + state.nanosec * 1e-9 + 0.025
    for good in (stamped(3.0, 0.1, now, "base_link"), stamped(3.0, 0.1)):

        def steers(good: TwistStamped = good) -> bool:
            probe.say(topics.CMD_VEL, good)
            probe.spin_for(0.05)
            return bool(probe[topics.COMMAND])

        probe.spin_until(steers)
    assert probe[topics.COMMAND][-1].policy.startswith("cmd_vel")


def last_turn(side: float, ridden: list[BicycleState]) -> list[float]:
    """Return distances (m) of the last whole turn's states from the newest, the oldest first."""
    turned = np.unwrap([state.heading for state in ridden])
    before = np.flatnonzero(side * (turned[-1] - turned) >= 2.0 * math.pi)
    if not before.size:
        return []
    places = [state.rear_contact for state in ridden[before[-1] :]]
    return [math.hypot(place.x - places[-1].x, place.y - places[-1].y) for place in places]


def test_a_figure_eight_by_cmd_vel_alone(probe: Probe, controller: NodeProcess) -> None:
    """Circles to the left by TwistStamped, and to the right by Twist."""
    activate(probe, controller)
    for side, topic in ((1.0, topics.CMD_VEL), (-1.0, topics.CMD_VEL_PLAIN)):
        wanted = twist(3.0, side * 0.25)
        message = wanted if topic is topics.CMD_VEL_PLAIN else TwistStamped(twist=wanted)
        probe.say(topic, message)
        seen = len(probe[topics.STATE])
        ridden = [probe[topics.STATE][-1]]
        distances: list[float] = []
        # On a busy machine states are lost, or come so late that the bicycle has long been without
        # a fresh command: what counts is a whole turn in which nothing of the kind happened.
        while not distances or distances[0] >= 3.0:
            heard = probe.spin_until(partial(newer, probe, seen))
            probe.say(topic, message)
            seen += len(heard)
            for state in heard:
                assert not state.fallen
                if state.step != ridden[-1].step + 1:
                    ridden.clear()
                ridden.append(state)
            assert ridden[-1].step < MOST_STEPS, f"no turn closed: {distances[:1]}"
            distances = last_turn(side, ridden)
        assert 20.0 < max(distances) < 30.0, "the diameter of 3 m/s at 0.25 rad/s is 24 m"
