"""Messages and the types of the pure code: every field, both ways, signs of both conventions."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from bicycle_msgs.msg import BicycleCommand, CommandEcho
from bicycle_msgs.msg import BicycleState as BicycleStateMessage
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point as PointMessage
from geometry_msgs.msg import Pose, Quaternion
from rclpy.serialization import deserialize_message, serialize_message

from bicycle_common.nodes import convert
from bicycle_common.types import (
    AppliedCommand,
    BicycleState,
    Command,
    CommandSource,
    InitialPose,
    Push,
)
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import named

pytestmark = pytest.mark.ros

NOW = 12 * 10**9 + 345_678_901
COMMAND = Command(
    episode=3,
    step=41,
    torque=0.125,
    displacement=-0.0625,
    pedal_force=7.5,
    goal=(3.25, -4.5),
    goal_id=9,
    controller="controller",
    policy="lqr@1",
    heading_error=0.75,
    goal_distance=6.5,
)


def ridden() -> BicycleState:
    """Return a state in which no number is zero, by the paper's bicycle."""
    simulator = Simulator(named("random-start-random-goal"))
    simulator.reset(InitialPose(1.0, -2.0, 0.7, 10.0 / 3.6))
    for step in range(30):
        simulator.step(Command(1, step, 0.05, 0.01, 1.0))
    return simulator.snapshot


@pytest.mark.parametrize(
    ("nanoseconds", "seconds", "rest"),
    [
        (0, 0, 0),
        (NOW, 12, 345_678_901),
        (10**9 - 1, 0, 10**9 - 1),
        (10**9, 1, 0),
        (-1, -1, 10**9 - 1),
    ],
)
def test_a_time_is_split_into_seconds_and_nanoseconds(
    nanoseconds: int, seconds: int, rest: int
) -> None:
    stamp = convert.to_stamp(nanoseconds)
    assert (stamp.sec, stamp.nanosec) == (seconds, rest)
    assert convert.to_stamp(np.int64(nanoseconds)) == stamp  # type: ignore[arg-type]


def test_a_header_has_the_time_and_the_frame() -> None:
    header = convert.to_header(NOW)
    assert (header.stamp, header.frame_id) == (convert.to_stamp(NOW), "odom")
    assert convert.to_header(NOW, "base_link").frame_id == "base_link"


def test_a_point_is_flat_and_no_point_is_not_a_number() -> None:
    assert convert.to_point((1.5, -2.5)) == PointMessage(x=1.5, y=-2.5, z=0.0)
    assert convert.to_point((1, -2), 3).z == 3.0
    nothing = convert.to_point(None)
    assert math.isnan(nothing.x)
    assert math.isnan(nothing.y)
    assert nothing.z == 0.0


@pytest.mark.parametrize("yaw", [-3.0, -1.0, 0.0, 0.25, 1.5, 3.0])
@pytest.mark.parametrize("roll", [-0.5, 0.0, 0.3])
def test_a_quaternion_is_roll_then_yaw(yaw: float, roll: float) -> None:
    """The reference is the product of the two rotations, component by component."""
    turn = convert.to_quaternion(yaw, roll)
    about_z = (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))
    about_x = (math.cos(roll / 2), math.sin(roll / 2), 0.0, 0.0)
    np.testing.assert_allclose(
        [turn.w, turn.x, turn.y, turn.z], hamilton(about_z, about_x), atol=1e-15
    )
    assert convert.to_yaw(turn) == pytest.approx(yaw)
    if roll == 0.0:
        assert convert.to_quaternion(yaw) == turn


def hamilton(p: tuple[float, ...], q: tuple[float, ...]) -> list[float]:
    """Return the product of two quaternions (w, x, y, z)."""
    return [
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    ]


def test_the_yaw_of_any_rotation_is_where_its_forward_axis_points() -> None:
    """Pitched ones too, as a pose of others may be."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        w, x, y, z = (float(value) for value in unit(rng))
        forward = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z))
        assert convert.to_yaw(Quaternion(w=w, x=x, y=y, z=z)) == pytest.approx(
            math.atan2(forward[1], forward[0]), abs=1e-12
        )


def unit(rng: np.random.Generator) -> np.ndarray:
    """Return a random vector of length one, (4,)."""
    vector = rng.normal(size=4)
    return np.asarray(vector / np.linalg.norm(vector))


@pytest.mark.parametrize("length", [0.0, 0.99, 0.9985, 1.0015, 1.01, 2.0, math.nan, math.inf])
def test_what_is_no_rotation_is_refused(length: float) -> None:
    for name in "xyzw":
        with pytest.raises(ValueError, match=r"must have length 1, not [\w.]+$"):
            convert.to_yaw(Quaternion(**{**dict.fromkeys("xyzw", 0.0), name: length}))


def test_the_refusal_names_the_rotation() -> None:
    with pytest.raises(ValueError, match=re.escape("orientation (1, 2, 3, 4) must have length 1")):
        convert.to_yaw(Quaternion(x=1.0, y=2.0, z=3.0, w=4.0))


@pytest.mark.parametrize("length", [0.9992, 1.0, 1.0008])
def test_a_rotation_that_somebody_rounded_is_taken(length: float) -> None:
    turn = Quaternion(w=length * math.cos(0.25), z=length * math.sin(0.25))
    assert convert.to_yaw(turn) == pytest.approx(0.5, abs=2e-3)


def test_a_state_has_the_messages_signs() -> None:
    """REP-103: roll to the right, pitch with the nose down, yaw from +x."""
    state = replace(ridden(), pitch=0.125)
    message = convert.from_snapshot(state, NOW)
    assert message.header == convert.to_header(NOW)
    assert (message.episode, message.step) == (state.episode, state.step) == (1, 30)
    for name in ("lean_angle", "lean_rate", "lean_acceleration", "pitch"):
        assert getattr(message, name) == -getattr(state, name) != 0.0, name
    for name in ("steer_angle", "steer_rate", "speed", "yaw_rate"):
        assert getattr(message, name) == getattr(state, name) != 0.0, name
    along = (state.front_x - state.rear_x, state.front_y - state.rear_y)
    assert message.heading == pytest.approx(math.atan2(along[1], along[0]))
    assert message.heading == convert.yaw_of(state)
    assert message.front_contact == PointMessage(x=state.front_x, y=state.front_y)
    assert message.rear_contact == PointMessage(x=state.rear_x, y=state.rear_y)
    assert (message.fallen, message.estimated) == (False, False)
    assert list(message.plant_state) == []


def test_a_state_survives_the_trip_to_the_bit() -> None:
    """The message is serialised; the heading is computed from the contacts, as in the dynamics."""
    state = ridden()
    message = convert.from_snapshot(state, NOW)
    wired = deserialize_message(serialize_message(message), BicycleStateMessage)
    assert convert.to_snapshot(wired) == state
    wired.heading += 0.5
    assert convert.to_snapshot(wired) == state


@pytest.mark.parametrize("mark", [{"plant_state": (1.0, -2.5)}, {"estimated": True}])
def test_another_plants_heading_is_the_messages(mark: dict[str, object]) -> None:
    state = replace(ridden(), heading=-1.25, **mark)  # type: ignore[arg-type]
    back = convert.to_snapshot(convert.from_snapshot(state, NOW))
    assert back.heading == pytest.approx(-1.25, abs=1e-15)
    assert replace(back, heading=state.heading) == state


def test_a_fallen_state_is_fallen_on_both_sides() -> None:
    state = replace(ridden(), fallen=True)
    message = convert.from_snapshot(state, NOW)
    assert message.fallen is True
    assert convert.to_snapshot(message).fallen is True


def test_every_number_of_a_state_must_be_finite() -> None:
    state = replace(ridden(), plant_state=(1.0, 2.0))
    assert state.is_finite
    numbers = [name for name, value in vars(state).items() if isinstance(value, float)]
    assert len(numbers) == 13
    for name in numbers:
        for wrong in (math.nan, math.inf, -math.inf):
            assert not replace(state, **{name: wrong}).is_finite, name  # type: ignore[arg-type]
    assert not replace(state, plant_state=(1.0, math.nan)).is_finite


def test_a_command_becomes_a_message_with_the_messages_signs() -> None:
    stamp = Time(sec=5, nanosec=6)
    message = convert.from_command(COMMAND, stamp)
    assert message.header.stamp == stamp
    for name in ("episode", "step", "torque", "displacement", "pedal_force", "goal_id"):
        assert getattr(message, name) == getattr(COMMAND, name), name
    for name in ("controller", "policy", "goal_distance"):
        assert getattr(message, name) == getattr(COMMAND, name), name
    assert message.heading_error == -0.75
    assert message.has_goal is True
    assert message.goal == PointMessage(x=3.25, y=-4.5)


def test_a_command_survives_the_trip() -> None:
    message = convert.from_command(COMMAND, Time())
    back = convert.to_command(message)
    assert back == COMMAND
    assert back.message is message


def test_a_command_without_a_goal_has_none() -> None:
    message = convert.from_command(replace(COMMAND, goal=None), Time())
    assert message.has_goal is False
    assert math.isnan(message.goal.x)
    assert convert.to_command(message).goal is None


def test_an_echo_holds_the_command_as_it_came() -> None:
    """The echo holds the message itself, not one rebuilt from its numbers."""
    message = convert.from_command(COMMAND, Time(sec=5))
    message.header.frame_id = "whatever its sender wrote"
    applied = AppliedCommand(CommandSource.HELD, convert.to_command(message))
    echo = convert.from_applied(applied, 3, 42, NOW)
    assert echo.header == convert.to_header(NOW)
    assert (echo.episode, echo.step) == (3, 42)
    assert echo.command_source == CommandEcho.SOURCE_HELD
    assert echo.command is message
    assert convert.to_applied(echo) == applied


def test_an_echo_of_a_command_that_no_message_brought_is_made_of_its_numbers() -> None:
    echo = convert.from_applied(AppliedCommand(CommandSource.FRESH, COMMAND), 3, 42, NOW)
    assert echo.command == convert.from_command(COMMAND, convert.to_stamp(NOW))
    assert echo.command_source == CommandEcho.SOURCE_FRESH


@pytest.mark.parametrize("source", [CommandSource.INITIAL, CommandSource.ZERO])
def test_an_echo_without_a_command_is_zero_and_without_a_goal(source: CommandSource) -> None:
    echo = convert.from_applied(AppliedCommand(source), 3, 42, NOW)
    sent = echo.command
    assert (sent.torque, sent.displacement, sent.pedal_force, sent.has_goal) == (0, 0, 0, False)
    assert (sent.controller, sent.policy) == ("", "")
    for number in (sent.goal.x, sent.goal.y, sent.heading_error, sent.goal_distance):
        assert math.isnan(number)
    assert convert.to_applied(echo) == AppliedCommand(source)


@pytest.mark.parametrize("name", ["torque", "displacement", "pedal_force", "goal.x", "goal.y"])
@pytest.mark.parametrize("source", [CommandSource.FRESH, CommandSource.HELD])
def test_an_echo_of_a_command_that_is_not_finite_is_refused(
    name: str, source: CommandSource
) -> None:
    echo = convert.from_applied(AppliedCommand(source, COMMAND), 3, 42, NOW)
    part, _, field = name.rpartition(".")
    setattr(getattr(echo.command, part) if part else echo.command, field, math.nan)
    with pytest.raises(ValueError, match="its command is not finite"):
        convert.to_applied(echo)


def test_an_echo_from_nowhere_is_refused() -> None:
    with pytest.raises(ValueError, match="4"):
        convert.to_applied(CommandEcho(command_source=4, command=BicycleCommand()))


def test_a_push_to_the_left_is_a_roll_rate_below_zero() -> None:
    push = Push(episode=2, step=17, lean_rate=0.375)
    message = convert.from_push(push, NOW)
    assert message.header == convert.to_header(NOW)
    assert (message.episode, message.step, message.lean_rate) == (2, 17, -0.375)
    assert convert.to_push(message) == push


def test_a_start_is_a_place_and_a_yaw() -> None:
    pose = Pose()
    pose.position = PointMessage(x=3.0, y=-4.0, z=9.0)
    pose.orientation = convert.to_quaternion(0.5 * math.pi)
    start = convert.to_start(pose, 2.5)
    assert (start.x, start.y, start.speed) == (3.0, -4.0, 2.5)
    assert start.heading == pytest.approx(0.0)  # the paper's heading is from +y
    pose.orientation = Quaternion(w=0.0)
    with pytest.raises(ValueError, match="length 1"):
        convert.to_start(pose, 2.5)


@pytest.mark.parametrize("frame", ["odom", "map", "b1/odom", "a/b/map", "/odom"])
def test_a_goal_is_a_point_in_a_known_frame(frame: str) -> None:
    assert convert.to_goal(frame, PointMessage(x=3.5, y=-4.5, z=math.nan)) == (3.5, -4.5)


@pytest.mark.parametrize("frame", ["", "base_link", "odom/b1", "b1/", "odom_b1", "Odom"])
def test_a_goal_in_another_frame_is_refused_with_the_frames_that_do(frame: str) -> None:
    words = re.escape(f"its frame is {frame!r}: send it in 'odom' or 'map'")
    with pytest.raises(ValueError, match=words):
        convert.to_goal(frame, PointMessage())


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_a_goal_that_is_not_finite_is_refused(wrong: float) -> None:
    for point in (PointMessage(x=wrong), PointMessage(y=wrong), PointMessage(x=wrong, y=wrong)):
        with pytest.raises(ValueError, match="is not finite: send finite metres"):
            convert.to_goal("odom", point)


def test_a_goal_beyond_the_farthest_is_refused() -> None:
    for x, y in ((1e4, 0.0), (0.0, -1e4), (-1e4, 1e4)):
        assert convert.to_goal("odom", PointMessage(x=x, y=y)) == (x, y)
    for x, y in ((10_001.0, 0.0), (0.0, 10_001.0), (-10_001.0, 0.0), (0.0, -10_001.0)):
        with pytest.raises(ValueError, match="is beyond 10000 m: send a nearer goal"):
            convert.to_goal("odom", PointMessage(x=x, y=y))
    with pytest.raises(ValueError, match=re.escape("(6, 0) is beyond 5 m")):
        convert.to_goal("odom", PointMessage(x=6.0), 5.0)
