"""The cockpit with a real simulator and controller: rides, pushes, records and tells."""

from __future__ import annotations

import math
import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from bicycle_msgs.msg import GoalStatus, TrainerStatus
from cockpit_page import COCKPIT, Page, address_of
from domains import claimed_domain
from node_process import NodeProcess
from probe import Probe

from bicycle_common.nodes import topics
from bicycle_common.processes import MOST_DEATHS
from bicycle_tools.nodes import ride_recording, verify_states

pytestmark = [pytest.mark.ros, pytest.mark.slow]

SIM = "bicycle_sim.nodes.sim_node"
Start = Callable[..., NodeProcess]
Made = tuple[NodeProcess, Page, Path, int]


@pytest.fixture(scope="module")
def cockpit(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Made]:
    """Yield a cockpit with its own ride under LQR, a page of it, its folder and its domain."""
    folder = tmp_path_factory.mktemp("bags")
    models = tmp_path_factory.mktemp("models")
    (models / "broken.safetensors").write_bytes(b"no policy")
    words = [str(COCKPIT), "--port", "0", "--bags", str(folder), "--models", str(models)]
    words += ["controller.policy:=lqr"]
    with claimed_domain() as domain, NodeProcess(words, {"ROS_DOMAIN_ID": str(domain)}) as process:
        page = Page(address_of(process))
        yield process, page, folder, domain
        page.close()


def last(page: Page, name: str) -> float:
    return float(page.rows[-1][name])


def process_of(name: str, domain: int) -> int:
    """Number of a process that the cockpit has started."""
    (note,) = (COCKPIT.parent / "runs" / "pids" / str(domain)).glob(f"{name}.*")
    return int(note.suffix[1:])


def test_a_ride_is_recorded_pushed_and_proved(cockpit: Made) -> None:
    _, page, folder, domain = cockpit
    assert page.newest("hello")["largest_push"] == 2.0
    assert page.ask("record", on=True)["ok"]
    page.until(lambda: phases(page)[-1:] == ["recording"])
    assert phases(page)[0] == "starting", "it says that it records once the recorder hears it"
    page.until(lambda: "recording /bicycle/timing" in _log(domain, "recorder"))
    assert page.ask("goal", x=14.0, y=4.0)["ok"]
    page.until(lambda: last(page, "x") > 3.0)
    pushed = page.ask("push", lean_rate=0.25)
    assert pushed["ok"], pushed
    assert "0.25 rad/s" in page.event("push")["text"]
    reached = page.event("reached")
    assert (reached["x"], reached["y"]) == (14.0, 4.0)
    # Events are sent before rows.
    page.until(lambda: min(math.hypot(row["x"] - 14.0, row["y"] - 4.0) for row in page.rows) < 1.2)
    status = page.until(lambda: rated(page.newest("status")))
    assert status["mode"] == "riding"
    assert status["who"]["driver"]["name"] == status["who"]["chosen"]["name"] == "lqr"
    assert status["loop"]["rate"] > 0
    assert status["controllers"] == 1
    assert page.ask("record", on=False)["ok"]
    page.until(lambda: not page.newest("status")["recording"])

    (bag,) = page.get("bags")["bags"]
    shown = page.get(f"bags/{bag['name']}")
    kinds = {mark["kind"] for mark in shown["marks"]}
    assert {"active", "reached", "push"} <= kinds
    x = shown["data"][shown["columns"].index("x")]
    assert max(x) > 12.0
    recording = ride_recording.read(folder / bag["name"])
    assert sum(map(len, recording.pushes.values())) == 1
    (*_, verdict) = verify_states.verify(recording)
    assert verdict.proved, verdict
    recording.pushes.clear()
    (*_, verdict) = verify_states.verify(recording)
    assert "lean_angle was" in verdict.difference


def rated(status: dict[str, Any]) -> dict[str, Any]:
    """Return a status that knows the loop's rate; an empty one for another."""
    return status if status["loop"]["rate"] else {}


def phases(page: Page) -> list[str]:
    """Return the messages to the page about the recorder, in order."""
    recordings = (
        m["recording"] for m in list(page.heard) if m["type"] == "status" and m["recording"]
    )
    return [recording["phase"] for recording in recordings]


def _log(domain: int, name: str) -> str:
    """Return the output of a process that the cockpit started."""
    path = COCKPIT.parent / "log" / "cockpit" / str(domain) / f"{name}.log"
    return path.read_text() if path.exists() else ""


def test_pause_step_and_reset_do_what_they_say(cockpit: Made) -> None:
    _, page, _, domain = cockpit
    assert page.ask("goal", x=60.0, y=0.0)["ok"]
    page.until(lambda: page.newest("status")["mode"] == "riding")
    assert page.ask("pause", paused=True)["ok"]
    page.until(lambda: page.newest("status")["mode"] == "paused")
    # The page may hear of the pause before it hears of the last steps.
    told = page.until(lambda: re.findall(r"paused at step (\d+)", _log(domain, "simulator")))
    before = int(told[-1])
    page.until(lambda: last(page, "step") == before)
    assert page.ask("step")["ok"]
    page.until(lambda: last(page, "step") == before + 1)
    assert page.ask("pause", paused=False)["ok"]
    page.until(lambda: last(page, "step") > before + 10)
    assert not page.ask("step")["ok"]
    answer = page.ask("reset", random=False)
    assert answer["ok"]
    page.until(lambda: (last(page, "step"), last(page, "x"), last(page, "y")) == (0.0, 0.0, 0.0))
    page.until(lambda: page.newest("status")["mode"] == "held")


def test_waypoints_are_added_to_what_lies_ahead(cockpit: Made) -> None:
    _, page, _, _ = cockpit
    assert page.ask("goal", x=40.0, y=0.0)["ok"]
    page.until(lambda: page.newest("status")["goal"] == [40.0, 0.0])
    assert page.ask("waypoints", points=[[60.0, 10.0], [80.0, 0.0]])["ok"]
    page.until(lambda: page.newest("status")["ahead"] == [[60.0, 10.0], [80.0, 0.0]])
    assert page.newest("status")["goal"] == [40.0, 0.0]
    assert page.ask("clear")["ok"]
    page.until(lambda: page.newest("status")["goal"] is None)


def test_a_waypoint_follows_a_goal_that_a_busy_controller_has_not_taken(cockpit: Made) -> None:
    _, page, _, domain = cockpit
    assert page.ask("reset", random=False)["ok"]
    page.until(lambda: page.newest("status")["mode"] == "held")
    controller = process_of("controller", domain)
    os.kill(controller, signal.SIGSTOP)
    try:
        assert page.ask("goal", x=40.0, y=0.0)["message"] == "goal (40.0, 0.0) sent"
        answer = page.ask("waypoints", points=[[60.0, 10.0]])["message"]
        assert answer == "goal (60.0, 10.0) sent by way of 1 point"
    finally:
        os.kill(controller, signal.SIGCONT)
    page.until(lambda: page.newest("status")["goal"] == [40.0, 0.0])
    page.until(lambda: page.newest("status")["ahead"] == [[60.0, 10.0]])
    assert page.ask("clear")["ok"]
    page.until(lambda: page.newest("status")["goal"] is None)


def test_a_flood_of_goals_puts_no_page_out(cockpit: Made) -> None:
    _, page, _, domain = cockpit
    assert page.ask("goal", x=50.0, y=0.0)["ok"]
    page.until(lambda: page.newest("status")["goal"] == [50.0, 0.0])
    heard = len(page.heard)
    points = [[60.0 + number, 5.0] for number in range(150)]
    assert page.ask("waypoints", points=points)["ok"]
    page.until(lambda: len(page.newest("status")["ahead"]) == 150)
    assert page.ask("clear")["ok"]
    page.until(lambda: page.newest("status")["ahead"] == [])
    cancelled = [m for m in page.heard[heard:] if m.get("kind") == "cancelled"]
    assert [(m["x"], m["y"]) for m in cancelled] == [(50.0, 0.0)], "not one for each waypoint"
    probe = Probe(domain)
    rejected = GoalStatus(status=GoalStatus.REJECTED)

    def cut() -> bool:
        """Return True if the ongoing flood was too much to report."""
        for _ in range(40):
            probe.say(topics.GOAL_STATUS, rejected)
        return any("are not listed" in m.get("text", "") for m in page.heard[heard:])

    page.until(cut)
    probe.close()
    assert page.ask("pause", paused=True)["ok"], "the page is still there"
    assert page.ask("pause", paused=False)["ok"]
    events = [m for m in page.heard[heard:] if m["type"] == "event"]
    assert len(events) < 500, "as many as there may be in a wait of the longest kind"


def test_the_controller_is_switched_by_name_only(cockpit: Made) -> None:
    _, page, _, _ = cockpit
    offered = {one["name"] for one in page.newest("hello")["controllers"]}
    assert {"fixed-speed", "lqr"} <= offered
    assert page.ask("goal", x=0.0, y=60.0)["ok"]
    assert page.ask("controller", name="fixed-speed")["ok"]
    page.until(lambda: page.newest("status")["who"]["driver"]["name"] == "fixed-speed")
    driver = page.newest("status")["who"]["driver"]
    assert driver["policy"].startswith("fixed-speed@")
    assert driver["colour"] in page.newest("palette")["slots"]
    refused = page.ask("controller", name="/etc/passwd")
    assert not refused["ok"]
    assert "is offered" in refused["message"]


def test_the_trainer_is_told(cockpit: Made) -> None:
    _, page, _, domain = cockpit
    probe = Probe(domain)
    status = TrainerStatus(phase="learning", updates=1200, reach_rate=0.75, mean_return=math.nan)
    probe.say(topics.TRAINER, status)
    trainer = page.until(lambda: next((m for m in page.heard if m["type"] == "trainer"), None))
    assert (trainer["phase"], trainer["updates"], trainer["reach_rate"]) == (
        "learning",
        1200,
        0.75,
    )
    assert trainer["mean_return"] is None
    probe.close()


def test_a_course_is_ridden_by_its_name(cockpit: Made) -> None:
    _, page, _, _ = cockpit
    assert page.ask("reset", random=False)["ok"]
    answer = page.ask("course", name="slalom")
    assert answer["ok"], answer
    path = page.until(lambda: next((m for m in page.heard if m["type"] == "path"), None))
    assert len(path["points"]) > 50
    page.until(lambda: last(page, "x") > 1.0)
    assert page.ask("clear")["ok"]
    refused = page.ask("course", name="../road")
    assert not refused["ok"]


def test_a_page_sets_up_another_bicycle_with_sensors_and_another_speed(cockpit: Made) -> None:
    _, page, _, _ = cockpit
    hello = page.newest("hello")
    assert hello["setup"]["plant"] == "choi"
    assert hello["setups"]["ours"]
    words = {"plant": "whipple", "bicycle": "browser-rider", "sensors": "mpu6050-rtk"}
    answer = page.ask("setup", **words, scenario="learned-speed", speed=3.0, controller="lqr")
    assert answer == {"type": "answer", "id": answer["id"], "ok": True} | {
        "message": "simulator and controller start anew"
    }
    page.until(lambda: page.newest("setup")["bicycle"] == "browser-rider")
    page.until(lambda: page.newest("facts").get("plant") == "whipple")
    assert page.newest("facts")["scenario"] == "learned-speed"
    page.until(lambda: last(page, "speed") == 3.0 and last(page, "step") == 0.0)

    def rides() -> bool:
        """Return True once a goal is ridden to; a controller that begins may miss the first."""
        page.ask("goal", x=30.0, y=5.0)
        time.sleep(1.0)
        return last(page, "x") > 2.0

    page.until(rides)
    # The newest row may have come before its estimate.
    row = next(one for one in reversed(page.rows) if one["est_lean"] is not None)
    assert abs(row["est_lean"] - row["lean"]) < 0.1
    assert abs(row["est_x"] - row["x"]) < 2.0
    assert row["t"] - 1.0 < row["est_t"] <= row["t"]
    before = page.newest("facts")
    assert page.ask("setup", **words, scenario="learned-speed", speed=4.0)["ok"]
    page.until(lambda: (last(page, "step"), last(page, "speed")) == (0.0, 4.0))
    assert page.newest("facts")["episode"] == before["episode"] + 1, "the same simulator"


def test_a_setup_that_cannot_run_brings_the_ride_before_back(cockpit: Made) -> None:
    _, page, _, _ = cockpit
    now = page.newest("facts")["plant"]
    assert page.ask("setup", plant="choi", bicycle="", sensors="", controller="broken")["ok"]
    event = page.event_with("the one before comes back")
    assert "broken" in event["text"]
    page.until(lambda: page.newest("setup")["plant"] == now)
    # Facts of the simulator that ended may still be under way.
    page.until(lambda: page.newest("facts")["plant"] == now)
    page.have_done("goal", x=5.0, y=5.0)


def test_a_dead_controller_is_started_again(cockpit: Made) -> None:
    _, page, _, domain = cockpit
    os.kill(process_of("controller", domain), signal.SIGKILL)
    page.until(lambda: any("started again" in m.get("text", "") for m in page.heard))
    page.have_done("goal", x=5.0, y=5.0)


def test_ctrl_c_ends_all_of_it(cockpit: Made) -> None:
    process, _, _, domain = cockpit
    assert process.stop(signal.SIGINT) == 0, process.output
    assert "Traceback" not in process.output
    left = list((COCKPIT.parent / "runs" / "pids" / str(domain)).glob("[cs]*"))
    assert [path.name for path in left if not path.name.startswith("cockpit")] == []


def test_a_cockpit_that_gives_up_tells_its_pages_why(start_node: Start) -> None:
    process = start_node(COCKPIT, ["--port", "0"])
    page = Page(address_of(process))
    folder = COCKPIT.parent / "runs" / "pids" / os.environ["ROS_DOMAIN_ID"]
    for death in range(MOST_DEATHS + 1):
        (note,) = page.until(lambda: list(folder.glob("simulator.*")))
        os.kill(int(note.suffix[1:]), signal.SIGKILL)
        if death < MOST_DEATHS:
            page.until(lambda death=death: starts(page) == death + 1)  # type: ignore[misc]
    assert process.wait() == 2
    assert "simulator was killed by SIGKILL" in process.lines[-1]
    end = page.event("end")
    assert "the cockpit ends: simulator was killed by SIGKILL" in end["text"]
    page.close()


def starts(page: Page) -> int:
    """Return the number of messages that the simulator was started again."""
    return sum(m.get("text") == "simulator started again" for m in list(page.heard))


def test_the_form_begins_with_what_the_simulator_has(start_node: Start, tmp_path: Path) -> None:
    """Also where its parameters came from a file, and from another terminal."""
    file = tmp_path / "mine.yaml"
    values = "{plant: whipple, bicycle: browser-rider, start_speed: 4.5, sensors: mpu6050}"
    file.write_text(f"/**: {{ros__parameters: {values}}}")
    start_node(SIM, ["--ros-args", "--params-file", file]).wait_for_line("episode 1 waits")
    words = ["--no-ride", "--port", "0", "--bags", tmp_path]
    page = Page(address_of(start_node(COCKPIT, words)))
    page.until(lambda: page.newest("setup")["plant"] == "whipple")
    told = page.newest("setup")
    assert (told["bicycle"], told["speed"], told["sensors"]) == ("browser-rider", 4.5, "mpu6050")
    assert told["own_bicycle"] == ""
    later = Page(page.address)
    assert later.newest("hello")["setup"]["bicycle"] == "browser-rider"
    for one in (page, later):
        one.close()


def test_without_a_ride_it_says_what_is_missing(start_node: Start, tmp_path: Path) -> None:
    words = ["--no-ride", "--port", "0", "--bags", tmp_path]
    page = Page(address_of(start_node(COCKPIT, words)))
    assert page.newest("status")["mode"] == "silent"
    assert "controller.sh" in page.ask("goal", x=1.0, y=1.0)["message"]
    assert "sim.sh" in page.ask("pause", paused=True)["message"]
    assert "controller.sh" in page.ask("controller", name="lqr")["message"]
    assert "sim.sh plant:=whipple" in page.ask("setup", plant="whipple")["message"]
    page.close()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--bind", "0.0.0.0"], "have a secret made with --token auto"),
        (["--token", "0123456789abcdef"], "every user of this machine can read a command line"),
        (["--token-file", "/none"], "cannot read --token-file '/none': No such file"),
        (["--port", "99999"], "choose 1 to 65535"),
        (["--speed", "3"], "unrecognized arguments: --speed"),
        (["pilot.policy:=lqr"], "names no node"),
        (["--no-ride", "controller.policy:=lqr"], "sets nothing with --no-ride"),
    ],
)
def test_mistakes_are_one_line(start_node: Start, words: list[str], said: str) -> None:
    process = start_node(COCKPIT, words)
    assert process.wait() == 2
    (line,) = process.lines
    assert said in line


def test_a_wrong_parameter_of_the_controller_ends_it(start_node: Start) -> None:
    process = start_node(COCKPIT, ["--port", "0", "controller.policy:=/none.safetensors"])
    assert process.wait() == 2
    assert "controller exited with status 2" in process.lines[-1]
    assert "/none.safetensors" in process.lines[-1]
