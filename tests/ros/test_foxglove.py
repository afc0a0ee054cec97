"""foxglove.sh: the real server and nodes, and a client that speaks Foxglove's protocol."""

from __future__ import annotations

import json
import math
import re
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from foxglove_client import FoxgloveClient
from geometry_msgs.msg import PoseStamped
from node_process import NodeProcess
from rclpy.serialization import serialize_message

from bicycle_bag.schemas import Schemas

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("no_new_shared_memory")]

WORKSPACE = Path(__file__).resolve().parents[2] / "ros2_ws"
POSE = "geometry_msgs/msg/PoseStamped"
STATE, STATUS = "/bicycle/state", "/bicycle/goal_status"
FAR = ["150", "40"]
"""A goal, m."""
Start = Callable[..., NodeProcess]


@pytest.fixture
def bicycle(start_node: Start) -> None:
    start_node(WORKSPACE / "sim.sh", ["pace:=lockstep"]).wait_for_line("waits for its first")
    start_node(WORKSPACE / "controller.sh", ["policy:=lqr"]).wait_for_line("waits for a goal")


def serve(start_node: Start, *words: str) -> tuple[NodeProcess, int]:
    server = start_node(WORKSPACE / "foxglove.sh", ["port:=0", *words])
    return server, int(server.wait_for_line(r"ws://127\.0\.0\.1:(\d+)")[1])


@pytest.fixture
def client(start_node: Start, bicycle: None) -> Iterator[FoxgloveClient]:
    _, port = serve(start_node, "publish:=true")
    result = FoxgloveClient(port)
    yield result
    result.close()


def goal(x: object, y: object, frame: str = "odom") -> bytes:
    """Return the message that Foxglove's 3D panel publishes."""
    position = {"x": x, "y": y, "z": 0}
    orientation = {"x": 0, "y": 0, "z": 0, "w": 1}
    header = {"stamp": {"sec": 1, "nsec": 2}, "frame_id": frame}
    return json.dumps(
        {"header": header, "pose": {"position": position, "orientation": orientation}}
    ).encode()


def test_topics_come_as_they_are_with_their_definitions(
    client: FoxgloveClient, start_node: Start
) -> None:
    client.subscribe(STATE)
    start_node(WORKSPACE / "goal.sh", FAR)
    state = client.until(lambda: client.messages.get(STATE))[0]
    assert state.speed == pytest.approx(10 / 3.6)
    assert state.header.frame_id == "odom"
    channel = client.channels[STATE]
    assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
    assert channel["schemaName"] == "bicycle_msgs/msg/BicycleState"
    assert channel["schema"] == Schemas().definition("bicycle_msgs/msg/BicycleState")
    assert "clientPublish" in client.info["capabilities"]
    assert "services" in client.info["capabilities"]
    assert set(client.info["supportedEncodings"]) == {"json", "cdr"}


def test_foxglove_gets_the_meshes_of_the_model_and_no_other_file(
    client: FoxgloveClient,
) -> None:
    model = "/robot_description"
    assert "assets" in client.info["capabilities"]
    client.subscribe(model)
    text = client.until(lambda: client.messages.get(model))[0].data
    names = set(re.findall(r'mesh filename="([^"]+)"', text))
    assert len(names) >= 8
    for name in names:
        data = client.asset(name)
        assert data is not None, name
        count = int.from_bytes(data[80:84], "little")
        assert len(data) == 84 + 50 * count > 84
    folder = next(iter(names)).rpartition("/")[0]
    for other in ("../package.xml", "none.stl", "", "%2e%2e/package.xml"):
        assert client.asset(f"{folder}/{other}") is None, other
    assert client.asset("file:///etc/hostname") is None
    assert client.asset("package://bicycle_sim/package.xml") is None


def test_a_goal_in_json_is_ridden_to(client: FoxgloveClient) -> None:
    client.subscribe(STATUS)
    client.subscribe(STATE)
    client.offer(7, "/goal_pose", POSE)
    client.publish(7, goal(12, -3))
    reached = client.until(lambda: [s for s in client.messages.get(STATUS, ()) if s.status == 2])[
        0
    ]
    assert (reached.position.x, reached.position.y) == (12.0, -3.0)

    def is_there() -> bool:
        places = [state.rear_contact for state in client.messages[STATE]]
        return any(math.hypot(place.x - 12.0, place.y + 3.0) <= 1.0 for place in places)

    client.until(is_there)  # states may come behind the status


def test_a_goal_in_cdr_is_taken_and_shown_to_who_comes_later(
    client: FoxgloveClient, start_node: Start
) -> None:
    message = PoseStamped()
    message.header.frame_id = "map"
    message.pose.position.x = 500.0
    client.subscribe(STATUS)
    client.offer(1, "/goal_pose", POSE, "cdr")
    client.publish(1, serialize_message(message))
    client.until(lambda: [s for s in client.messages.get(STATUS, ()) if s.status == 1])
    active = "/bicycle/active_goal"
    client.subscribe(active)
    assert client.until(lambda: client.messages.get(active))[0].pose.position.x == 500.0
    other = FoxgloveClient(int(client._socket.get_extra_info("peername")[1]))
    other.subscribe(active)  # latched, and this server subscribed to it before
    assert other.until(lambda: other.messages.get(active))[0].pose.position.x == 500.0
    other.close()


def test_what_is_no_goal_is_refused_with_the_reason(client: FoxgloveClient) -> None:
    client.subscribe(STATUS)
    client.offer(1, "/goal_pose", POSE)
    client.offer(2, "/goal_pose", POSE, "cdr")
    cases = (
        (1, goal("NaN", 1), "its x is 'NaN'"),
        (1, goal(1e9, 1), "beyond 10000 m"),
        (1, goal(1, 1, "moon"), "its frame is 'moon'"),
        (1, b"{", "not JSON"),
        (1, b"[" * 4000, "not JSON"),
        (1, goal(1, "2" * 5000), "more than a pose needs"),
        (2, b"\0\1\0\0", "not a PoseStamped in CDR"),
    )
    for number, data, reason in cases:
        client.statuses.clear()
        client.publish(number, data)
        (said,) = client.until(lambda: client.statuses)
        assert reason in said
    for number, topic, kind, reason in (
        (8, "/bicycle/command", "bicycle_msgs/msg/BicycleCommand", "is not taken from clients"),
        (9, "/goal_pose", "std_msgs/msg/String", "takes geometry_msgs/PoseStamped"),
    ):
        client.statuses.clear()
        client.offer(number, topic, kind)
        assert reason in client.until(lambda: client.statuses)[0]
        client.publish(number, b"{}")
    client.publish(1, goal(12, 0))  # and it still works
    assert client.until(lambda: client.messages.get(STATUS))[0].position.x == 12.0
    assert all(message.status != 7 for message in client.messages[STATUS])


def test_it_only_shows_unless_it_is_told_otherwise(start_node: Start, bicycle: None) -> None:
    _, port = serve(start_node, "topics:=^/bicycle/")
    start_node(WORKSPACE / "goal.sh", FAR)
    client = FoxgloveClient(port)
    client.subscribe(STATE)
    client.until(lambda: client.messages.get(STATE))
    assert client.info["capabilities"] == ["assets"]
    assert client.services == {}
    client.offer(1, "/goal_pose", POSE)
    client.publish(1, goal(12, 0))
    client.until(lambda: client.statuses)
    assert "publish" in client.statuses[0].lower()
    assert all(topic.startswith("/bicycle/") for topic in client.channels)
    client.close()


def test_services_are_called_in_json(client: FoxgloveClient) -> None:
    client.subscribe(STATE)
    client.until(lambda: {"/bicycle/reset", "/bicycle/push"} <= set(client.services))
    offer = client.services["/bicycle/reset"]
    assert offer["type"] == "bicycle_msgs/srv/Reset"
    schema = json.loads(offer["request"]["schema"])
    assert schema["properties"]["random_start"] == {"type": "boolean", "default": False}
    place = {"pose": {"position": {"x": 3.0, "y": 4.0}}, "speed": -1.0, "seed": -1}
    answer = client.call("/bicycle/reset", place)
    assert answer["success"], answer
    client.until(lambda: [s for s in client.messages[STATE] if s.rear_contact.x == 3.0])
    refused = client.call("/bicycle/push", {"lean_rate": 99.0})
    assert not refused["success"]
    assert "99" in refused["message"]
    assert "no field 'rate'" in client.call("/bicycle/push", {"rate": 1})
    assert "must be true or false" in client.call("/bicycle/pause", {"data": "yes"})


def test_a_service_that_nobody_offers_is_told(start_node: Start, ros_domain: int) -> None:
    _, port = serve(start_node, "publish:=true")
    client = FoxgloveClient(port)
    client.until(lambda: client.services)
    assert "start sim.sh" in client.call("/bicycle/pause", {"data": True})
    client.close()


def test_a_goal_that_nobody_takes_is_told(start_node: Start, ros_domain: int) -> None:
    _, port = serve(start_node, "publish:=true")
    client = FoxgloveClient(port)
    client.offer(1, "/goal_pose", POSE)
    client.publish(1, goal(12, 0))
    assert "nobody takes /goal_pose" in client.until(lambda: client.statuses)[0]
    client.close()


def watch_once(port: int) -> None:
    client = FoxgloveClient(port)
    client.subscribe(STATE)
    client.until(lambda: client.messages.get(STATE))
    client.close()


def test_a_client_that_goes_leaves_no_subscription(start_node: Start, bicycle: None) -> None:
    server, port = serve(start_node)
    start_node(WORKSPACE / "goal.sh", FAR)
    for _ in range(3):
        watch_once(port)
    assert server.stop() == 0
    assert "Traceback" not in server.output


def test_it_listens_on_this_machine_alone(start_node: Start, ros_domain: int) -> None:
    server, port = serve(start_node)
    found = {
        line.split()[1]
        for line in Path(f"/proc/{server.pid}/net/tcp").read_text().splitlines()[1:]
        if int(line.split()[1].split(":")[1], 16) == port
    }
    assert found == {f"0100007F:{port:04X}"}


def test_a_taken_port_is_one_line(start_node: Start, ros_domain: int) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        server = start_node(WORKSPACE / "foxglove.sh", [f"port:={port}"])
        assert server.wait() == 2
    (line,) = server.lines
    assert f"cannot listen on 127.0.0.1:{port}" in line
    assert "choose host:= and port:=" in line


def test_another_address_is_warned_of(start_node: Start, ros_domain: int) -> None:
    server = start_node(WORKSPACE / "foxglove.sh", ["port:=0", "host:=0.0.0.0"])
    server.wait_for_line("0.0.0.0 is not loopback: whoever reaches this port sees all topics")
