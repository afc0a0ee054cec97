"""The shelf of bags: what it lists, what it never opens, and a ride as the page gets it."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest
from bicycle_msgs.msg import BicycleCommand, BicycleState, GoalStatus, Push
from rclpy.serialization import serialize_message

from bicycle_bag.errors import BagError
from bicycle_bag.metadata import Topic
from bicycle_bag.schemas import Schemas
from bicycle_bag.writer import BagWriter
from bicycle_cockpit import bags
from bicycle_cockpit.bags import BagShelf, session
from bicycle_cockpit.choices import Choices
from bicycle_controller.policy import load_policy, save_policy

sys.path.append(str(Path(__file__).parents[1] / "bag"))
from clocks import CLOCKS, with_clock

STEPS = 200
TOPICS = {
    "/bicycle/state": BicycleState,
    "/bicycle/command": BicycleCommand,
    "/bicycle/goal_status": GoalStatus,
    "/bicycle/pushed": Push,
}
PERIOD = 25_000_000


def write_bag(folder: Path) -> Path:
    """5 s along +x at 2 m/s, two policies, a push at 1 s, a goal reached at 4 s."""
    schemas = Schemas()
    with BagWriter(folder) as writer:
        for name, kind in TOPICS.items():
            full = f"bicycle_msgs/msg/{kind.__name__}"
            topic = Topic(name, full, type_hash=schemas.type_hash(full))
            writer.add_topic(topic, schemas.definition(full))
        for step in range(STEPS):
            now = 10**9 + step * PERIOD
            state = BicycleState(episode=1, step=step, speed=2.0, goal_distance=float("nan"))
            state.header.stamp.nanosec = (step * PERIOD) % 10**9
            state.header.stamp.sec = (step * PERIOD) // 10**9
            state.rear_contact.x = 0.05 * step
            writer.write("/bicycle/state", serialize_message(state), now, now)
            policy = "first" if step < 100 else "second"
            command = BicycleCommand(episode=1, step=step, torque=0.01 * step, policy=policy)
            writer.write("/bicycle/command", serialize_message(command), now + 10**6, now)
            if step == 40:
                push = serialize_message(Push(episode=1, step=40, lean_rate=-0.3))
                writer.write("/bicycle/pushed", push, now, now)
            if step == 160:
                status = GoalStatus(goal_id=1, status=GoalStatus.REACHED, message="there")
                status.position.x = 8.0
                writer.write("/bicycle/goal_status", serialize_message(status), now, now)
    return folder


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("made") / "bag")


def test_a_ride_as_the_page_gets_it(bag: Path) -> None:
    data = session(bag)
    json.dumps(data, allow_nan=False)
    columns = dict(zip(data["columns"], data["data"], strict=True))
    assert columns["t"] == pytest.approx([0.025 * step for step in range(STEPS)])
    assert columns["x"][-1] == pytest.approx(0.05 * (STEPS - 1))
    assert columns["goal_distance"] == [None] * STEPS
    assert columns["torque"][0] is None, "the first command came after the first state"
    assert columns["torque"][50] == pytest.approx(0.49)
    assert data["duration"] == pytest.approx(0.025 * (STEPS - 1))
    assert [one["name"] for one in data["policies"]] == ["", "first", "second"]
    assert data["policies"][2]["t"] == pytest.approx(101 * 0.025)
    push, goal = data["marks"]
    assert (push["kind"], push["text"]) == ("push", "pushed to the left, 0.30 rad/s")
    assert push["t"] == pytest.approx(1.0)
    assert (goal["kind"], goal["x"], goal["t"]) == ("reached", 8.0, pytest.approx(4.0))


def test_a_long_one_is_thinned_evenly(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bags, "MOST_ROWS", 60)
    steps = session(bag)["data"][2]
    assert steps == list(range(0, STEPS, 4))


def test_the_shelf_lists_what_is_finished_and_opens_nothing_else(
    bag: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "runs"
    shutil.copytree(bag, folder / "ride-1" / "bag")
    shutil.copytree(bag, folder / "a" / "b" / "c" / "too-deep")
    shutil.copytree(bag, folder / "unfinished")
    (folder / "unfinished" / "metadata.yaml").unlink()
    outside = tmp_path / "outside"
    shutil.copytree(bag, outside)
    (folder / "link").symlink_to(outside)
    shelf = BagShelf(folder)
    (entry,) = shelf.listed()
    assert entry["name"] == "ride-1/bag"
    assert entry["duration"] == pytest.approx(0.025 * (STEPS - 1) + 0.001)
    assert shelf.load("ride-1/bag")["name"] == "ride-1/bag"
    for name in ("link", "../outside", str(outside), "unfinished", "", ".", "ride-1"):
        with pytest.raises(KeyError):
            shelf.load(name)
    assert BagShelf(tmp_path / "nothing").listed() == []


def test_a_damaged_bag_is_one_line(bag: Path, tmp_path: Path) -> None:
    shutil.copytree(bag, tmp_path / "bag")
    (file,) = (tmp_path / "bag").glob("*.mcap")
    file.write_bytes(file.read_bytes()[:2000])
    with pytest.raises(BagError, match=r"record\.sh --repair"):
        BagShelf(tmp_path).load("bag")


def test_a_page_can_name_only_the_controllers_it_was_offered(tmp_path: Path) -> None:
    policy = load_policy()
    for path in ("loose.safetensors", "mine/best.safetensors", "tuned/2/best.safetensors"):
        save_policy(policy, tmp_path / path)
    choices = Choices(tmp_path)
    offered = {one["name"]: one["group"] for one in choices.offered()}
    assert {offered[name] for name in ("fixed-speed", "naf", "ppo")} == {"shipped"}
    assert offered["lqr"] == "classical"
    assert {"loose", "mine", "tuned/2"} == {k for k, v in offered.items() if v == "trained here"}
    assert choices.path("mine") == str(tmp_path / "mine" / "best.safetensors")
    assert choices.path("lqr") == "lqr"
    for name in ("../mine", str(tmp_path / "loose.safetensors"), "nobody"):
        with pytest.raises(KeyError):
            choices.path(name)


@pytest.mark.parametrize("publishers", [False, True])
@pytest.mark.parametrize("name", CLOCKS)
def test_the_recordings_clock_does_not_matter(
    bag: Path, tmp_path: Path, name: str, publishers: bool
) -> None:
    """Set back, set ahead, standing still: the page draws the same ride."""
    assert session(with_clock(bag, tmp_path / "bag", CLOCKS[name], publishers)) == session(bag)
