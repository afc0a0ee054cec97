"""Messages that the recorder hears: to its end, of passing publishers, after a standstill."""

from __future__ import annotations

import os
import re
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from node_process import NodeProcess
from probe import Probe, goal
from waiting import PATIENCE

from bicycle_bag import columns
from bicycle_bag.reader import BagReader
from bicycle_common.nodes.topics import COMMAND, COMMAND_ECHO, GOAL_POSE, STATE, TIMING

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("no_new_shared_memory")]

SPEAKER = Path(__file__).parents[1] / "support" / "speaker.py"
CLOCK_JUMP = SPEAKER.with_name("clock_jump.c")
RECORDER = "bicycle_bag.nodes.recorder_node"
# A recorder that is late: until it ends it takes one message in a turn.
LATE = f"""
import sys, time
from bicycle_bag.nodes.taking import Taker
from {RECORDER} import Recorder, main
take, drain, finish, calls = Taker.take, Recorder.drain, Recorder.finish, iter(range(10**9))
def ending(recorder):
    Taker.take = take
    finish(recorder)
Taker.take = lambda taker, handle: None if next(calls) % 2 else take(taker, handle)
Recorder.finish = ending
sys.exit(main(sys.argv[1:]))
"""
# One that stands still for a moment as soon as it is asked to end, with messages unheard.
STANDING = LATE.replace(
    "    finish",
    "    Recorder.drain = lambda self: (setattr(Recorder, 'drain', drain), time.sleep(1.0))\n"
    "    finish",
)
# One whose middleware has dropped every publisher during a standstill, and meets them 2 s later.
FORGETFUL = f"""
import sys, time
from bicycle_bag.nodes.recorded_topic import TopicSubscription
from {RECORDER} import main
publishers, drain = TopicSubscription.publishers.fget, TopicSubscription.drain
turned = meets = time.monotonic()
def alone(subscription):
    global turned, meets
    now, before = time.monotonic(), turned
    turned, meets = now, now + 2.0 if now - before > 3.0 else meets
    return now < meets
TopicSubscription.publishers = property(lambda self: 0 if alone(self) else publishers(self))
TopicSubscription.drain = lambda self: None if alone(self) else drain(self)
sys.exit(main(sys.argv[1:]))
"""
# One whose reliable subscriptions alone meet the publishers again so late.
BEHIND = FORGETFUL.replace(
    "    global turned",
    "    if subscription._subscription.qos_profile.reliability.name != 'RELIABLE':\n"
    "        return False\n"
    "    global turned",
)
# One whose first node never meets them again.
PARTED = FORGETFUL.replace("now + 2.0 if", "1e9 if").replace(
    "return now < meets",
    "return now < meets and subscription._node.get_name() == 'bicycle_recorder'",
)
LONG = PATIENCE
Start = Callable[..., NodeProcess]


def speaker(start_node: Start, *words: object) -> NodeProcess:
    return start_node(sys.executable, [SPEAKER, *words])


def recorder_of(start_node: Start, bag: Path, *topics: str) -> NodeProcess:
    recorder = start_node(RECORDER, ["--output", bag, "--topics", *topics])
    recorder.wait_for_line("recording into", LONG)
    return recorder


def numbers(bag: Path, topic: str) -> list[int]:
    return [int(text.split()[0]) for text in columns.load(bag, topic)["data"]]


def parted(recorder: NodeProcess) -> bool:
    """Return True if the middleware itself did not meet a publisher again; losses are told then.

    It seldom happens, and has a test of its own.
    """
    if "joins anew" not in recorder.output:
        return False
    assert re.search(r", [1-9]\d* lost on the way", recorder.lines[-1])
    return True


def test_no_effect_is_recorded_without_its_cause(start_node: Start, tmp_path: Path) -> None:
    """Both are sent by one node, cause first; the recorder may end at any moment."""
    talk = speaker(start_node, "/a/cause", "/b/effect", "--count", 10**6, "--hz", 2000)
    for attempt in range(3):
        bag = tmp_path / f"bag{attempt}"
        recorder = recorder_of(start_node, bag, "/a/cause", "/b/effect")
        talk.wait_for_line("heard", LONG)
        recorder.wait_for_line("recording /b/effect", LONG)
        time.sleep(0.3)
        assert recorder.stop(timeout=LONG) == 0, recorder.output
        causes, effects = numbers(bag, "/a/cause"), numbers(bag, "/b/effect")
        assert causes[-1] - effects[-1] in (0, 1)
        reader = BagReader(bag)
        ended = datetime.fromisoformat(reader.metadata.custom_data["ended"]).timestamp()
        assert max(message.publish_time_ns for message in reader.messages()) < 1e9 * ended + 2e6


def test_what_was_sent_before_the_end_is_recorded_however_late_it_is_heard(
    start_node: Start, tmp_path: Path
) -> None:
    """More than the recorder's socket holds, so that some must be sent again."""
    recorder = recorder_of(start_node, tmp_path / "bag", "/said")
    talk = speaker(start_node, "/said", "--count", 2000, "--hz", 0, "--bytes", 10_000, "--wait")
    recorder.wait_for_line("recording /said", LONG)
    talk.wait_for_line("heard", LONG)
    recorder.send_signal(signal.SIGSTOP)
    talk.send_signal(signal.SIGUSR1)
    talk.wait_for_line("said", LONG)
    recorder.send_signal(signal.SIGINT)
    recorder.send_signal(signal.SIGCONT)
    assert recorder.wait(LONG) == 0, recorder.output
    assert numbers(tmp_path / "bag", "/said") == list(range(2000))


@pytest.mark.parametrize("jump", [-3600, 3600])
def test_what_waits_when_the_clock_is_set_is_recorded(
    start_node: Start, tmp_path: Path, jump: int
) -> None:
    """The clock goes back by an hour while messages wait for a late recorder; then it ends."""
    moved, library = tmp_path / "moved", tmp_path / "clock_jump.so"
    moved.write_bytes(struct.pack("q", 0))
    build = ["g++", "-x", "c", "-shared", "-fPIC", str(CLOCK_JUMP), "-o", str(library)]
    subprocess.run(build, check=True)
    env = {"LD_PRELOAD": str(library), "CLOCK_JUMP": str(moved)}
    words = ["-c", LATE, "--output", tmp_path / "bag", "--topics", "/said"]
    recorder = start_node(sys.executable, words, env)
    recorder.wait_for_line("recording into", LONG)
    talk = start_node(sys.executable, [SPEAKER, "/said", "--count", 5000, "--hz", 0], env)
    assert talk.wait(LONG) == 0
    with moved.open("r+b") as file:
        file.write(struct.pack("q", jump))
    assert recorder.stop(timeout=LONG) == 0, recorder.output
    assert numbers(tmp_path / "bag", "/said") == list(range(5000))


def test_the_last_drain_takes_what_waits_for_a_recorder_that_is_late(
    start_node: Start, tmp_path: Path
) -> None:
    bag, count = tmp_path / "bag", 5000
    recorder = start_node(sys.executable, ["-c", LATE, "--output", bag, "--topics", "/said"])
    recorder.wait_for_line("recording into", LONG)
    talk = speaker(start_node, "/said", "--count", count, "--hz", 0)
    assert talk.wait(LONG) == 0
    assert recorder.stop(timeout=LONG) == 0, recorder.output
    assert numbers(bag, "/said") == list(range(count))


def test_a_standstill_at_its_end_is_not_taken_for_the_end(
    start_node: Start, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    talk = speaker(start_node, "/said", "--count", 10**6, "--hz", 1000)
    recorder = start_node(sys.executable, ["-c", STANDING, "--output", bag, "--topics", "/said"])
    recorder.wait_for_line("recording /said", LONG)
    talk.wait_for_line("heard", LONG)
    time.sleep(4.0)  # it falls behind by some thousand messages
    assert recorder.stop(timeout=LONG) == 0, recorder.output
    found = numbers(bag, "/said")
    assert found == list(range(found[0], found[-1] + 1))
    reader = BagReader(bag)
    ended = datetime.fromisoformat(reader.metadata.custom_data["ended"]).timestamp()
    assert 1e9 * ended - max(message.publish_time_ns for message in reader.messages()) < 1e9


def stood_still(start_node: Start, program: str, bag: Path) -> NodeProcess:
    """Start a speaker and a recorder of it, which has been stopped for 4 s then."""
    recorder = start_node(sys.executable, ["-c", program, "--output", bag, "--topics", "/said"])
    recorder.wait_for_line("recording into", LONG)
    talk = speaker(start_node, "/said", "--count", 10**6, "--hz", 100)
    recorder.wait_for_line("/said: first message", LONG)
    talk.wait_for_line("heard", LONG)
    time.sleep(0.5)
    recorder.send_signal(signal.SIGSTOP)
    time.sleep(4.0)
    return recorder


def test_an_end_waits_for_publishers_that_a_standstill_has_cost(
    start_node: Start, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    recorder = stood_still(start_node, FORGETFUL, bag)
    recorder.send_signal(signal.SIGINT)
    recorder.send_signal(signal.SIGCONT)
    assert recorder.wait(LONG) == 0, recorder.output
    recorder.wait_for_line("waits 20 s at most for publishers of /said, which a standstill has")
    found = numbers(bag, "/said")
    assert found == list(range(found[0], found[-1] + 1))
    if parted(recorder):
        return
    reader = BagReader(bag)
    ended = datetime.fromisoformat(reader.metadata.custom_data["ended"]).timestamp()
    assert 1e9 * ended - max(message.publish_time_ns for message in reader.messages()) < 1e9


@pytest.mark.parametrize("ends", [False, True])
def test_publishers_that_the_middleware_never_meets_again_are_met_by_a_new_node(
    start_node: Start, tmp_path: Path, ends: bool
) -> None:
    """Messages sent until then are lost, and counted."""
    bag = tmp_path / "bag"
    recorder = stood_still(start_node, PARTED, bag)
    if ends:
        recorder.send_signal(signal.SIGINT)
    recorder.send_signal(signal.SIGCONT)
    recorder.wait_for_line("publishers of /said have not come back after the standstill", LONG)
    if not ends:
        recorder.wait_for_line("[1-9][0-9]* messages of /said lost", LONG)
        time.sleep(0.5)
        recorder.send_signal(signal.SIGINT)
    assert recorder.wait(LONG) == 0, recorder.output
    told = re.search(r", (\d+) lost on the way", recorder.lines[-1])
    assert told
    found = numbers(bag, "/said")
    lost = found[-1] - found[0] + 1 - len(found)
    if ends:
        assert lost == 0
        assert int(told[1]) > 300
    else:
        assert int(told[1]) == lost > 300
        gaps = np.flatnonzero(np.diff(found) != 1)
        assert len(gaps) == 1
        assert found == sorted(found)


def test_a_best_effort_publisher_that_came_and_went_costs_a_reliable_one_nothing(
    start_node: Start, tmp_path: Path
) -> None:
    """A burst during a standstill of the recorder is more than its socket holds."""
    bag, count = tmp_path / "bag", 2000
    recorder = recorder_of(start_node, bag, "/mixed")
    burst = ["--count", count, "--hz", 0, "--bytes", 10_000, "--wait"]
    reliable = speaker(start_node, "/mixed", *burst)
    recorder.wait_for_line("recording /mixed", LONG)
    reliable.wait_for_line("heard", LONG)
    hasty = speaker(start_node, "/mixed", "--best-effort", "--count", 40)
    recorder.wait_for_line("subscribed to these, too", LONG)
    assert hasty.wait(LONG) == 0
    recorder.send_signal(signal.SIGSTOP)
    reliable.send_signal(signal.SIGUSR1)
    reliable.wait_for_line("said", LONG)
    recorder.send_signal(signal.SIGCONT)
    assert reliable.wait(2 * LONG) == 0
    again = speaker(start_node, "/mixed", "--best-effort", "--count", 5)
    assert again.wait(LONG) == 0
    assert recorder.stop(timeout=LONG) == 0, recorder.output
    assert ", 0 lost on the way" in recorder.lines[-1]
    texts = columns.load(bag, "/mixed")["data"]
    long = [int(text.split()[0]) for text in texts if len(text) > 10_000]
    short = [int(text.split()[0]) for text in texts if len(text) < 10_000]
    assert long == list(range(count))
    # It may speak before it is heard, and what it says last may come after the word that it has
    # gone, and is dropped then; in between nothing is missing.
    second = next(index for index in range(1, len(short)) if short[index] < short[index - 1])
    for heard in (short[:second], short[second:]):
        assert heard == list(range(heard[0], heard[0] + len(heard)))


def test_a_best_effort_subscription_that_is_ahead_after_a_standstill_changes_no_order(
    start_node: Start, tmp_path: Path
) -> None:
    """The middleware drops a publisher in a standstill, and may meet it there again first."""
    bag, count = tmp_path / "bag", 2400
    recorder = start_node(sys.executable, ["-c", BEHIND, "--output", bag, "--topics", "/mixed"])
    recorder.wait_for_line("recording into", LONG)
    burst = ["--count", 3000, "--hz", 0, "--bytes", 10_000, "--wait", "--halt", 2000, count]
    reliable = speaker(start_node, "/mixed", *burst)
    recorder.wait_for_line("recording /mixed", LONG)
    reliable.wait_for_line("heard", LONG)
    hasty = speaker(start_node, "/mixed", "--best-effort", "--count", 40)
    recorder.wait_for_line("subscribed to these, too", LONG)
    assert hasty.wait(LONG) == 0
    recorder.send_signal(signal.SIGSTOP)
    reliable.send_signal(signal.SIGUSR1)
    reliable.wait_for_line("halts at 2000", LONG)
    time.sleep(4.0)
    recorder.send_signal(signal.SIGCONT)
    recorder.wait_for_line(r"stood still for \d+\.\d s", LONG)
    reliable.send_signal(signal.SIGUSR1)
    reliable.wait_for_line(f"halts at {count}", LONG)
    assert recorder.stop(timeout=LONG) == 0, recorder.output
    assert ", 0 lost on the way" in recorder.lines[-1]
    texts = columns.load(bag, "/mixed")["data"]
    assert [int(text.split()[0]) for text in texts if len(text) > 10_000] == list(range(count))


def test_losses_of_several_publishers_that_have_gone_are_counted(
    start_node: Start, tmp_path: Path
) -> None:
    """Two keep 100 messages each of a burst that is more than the recorder's socket holds."""
    bag, count = tmp_path / "bag", 2000
    recorder = start_node(sys.executable, ["-c", LATE, "--output", bag, "--topics", "/said"])
    recorder.wait_for_line("recording into", LONG)
    burst = ["--count", count, "--hz", 0, "--depth", 100, "--halt", 10, "--bytes"]
    talks = [speaker(start_node, "/said", *burst, size) for size in (9_000, 10_000)]
    hasty = speaker(start_node, "/said", "--best-effort", "--count", 40)
    for talk in talks:
        talk.wait_for_line("halts at 10", LONG)
    recorder.wait_for_line("recording /said", LONG)
    assert hasty.wait(LONG) == 0
    recorder.send_signal(signal.SIGSTOP)
    for talk in talks:
        talk.send_signal(signal.SIGUSR1)
        talk.wait_for_line("said", LONG)
    recorder.send_signal(signal.SIGCONT)
    for talk in talks:
        assert talk.wait(2 * LONG) == 0
    assert recorder.stop(timeout=LONG) == 0, recorder.output
    told = re.search(r", (\d+) lost on the way", recorder.lines[-1])
    assert told is not None
    texts = columns.load(bag, "/said")["data"]
    found = [
        [int(text.split()[0]) for text in texts if len(text) // 1000 == size]
        for size in (9, 10, 0)
    ]
    assert found[0][-1] == found[1][-1] == count - 1
    lost = [numbers[-1] - numbers[0] + 1 - len(numbers) for numbers in found]
    assert lost[0] > 0
    assert lost[1] > 0
    assert int(told[1]) == sum(lost)
    assert BagReader(bag).metadata.custom_data["lost_messages"] == told[1]


@pytest.mark.slow
@pytest.mark.parametrize("steps_awake", [0, 40])
def test_a_recorder_that_stood_still_for_longer_than_the_lease_loses_no_step(
    start_node: Start, tmp_path: Path, ros_domain: int, steps_awake: int
) -> None:
    """This holds for a very small socket buffer, too, and if it is to end as it awakes."""
    bag, profiles = tmp_path / "bag", tmp_path / "profiles.xml"
    given = Path(os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"]).read_text()
    small = re.sub(r"(<receiveBufferSize>)\d+", r"\g<1>65536", given)
    assert small != given
    profiles.write_text(small)
    names = [f"/{topic.name}" for topic in (STATE, COMMAND, TIMING, COMMAND_ECHO)]
    words = ["--output", bag, "--topics", *names]
    recorder = start_node(RECORDER, words, {"FASTRTPS_DEFAULT_PROFILES_FILE": str(profiles)})
    recorder.wait_for_line("recording into", LONG)
    start_node("bicycle_sim.nodes.sim_node").wait_for_line("waits for its first command", LONG)
    start_node("bicycle_controller.nodes.controller_node", ["--ros-args", "-p", "policy:=lqr"])
    for name in names:
        recorder.wait_for_line(f"recording {name}", LONG)
    probe = Probe(ros_domain, STATE)
    probe.say(GOAL_POSE, goal(9000.0, 0.0))

    def rides_on(steps: int) -> None:
        begun = probe[STATE][-1].step
        probe.spin_until(lambda: probe[STATE][-1].step > begun + steps, LONG)

    probe.spin_until(lambda: probe[STATE] and probe[STATE][-1].step > 20, LONG)
    recorder.send_signal(signal.SIGSTOP)
    rides_on(880)  # 22 s; what is silent for 20 s is forgotten otherwise
    if steps_awake:
        recorder.send_signal(signal.SIGCONT)
        rides_on(steps_awake)
    last = probe[STATE][-1].step
    recorder.send_signal(signal.SIGINT)
    recorder.send_signal(signal.SIGCONT)
    assert recorder.wait(LONG) == 0, recorder.output
    probe.close()
    recorder.wait_for_line(r"stood still for \d+\.\d s")
    if parted(recorder):
        return
    assert ", 0 lost on the way" in recorder.lines[-1]
    for name in names:
        steps = columns.load(bag, name)["step"].astype(int)
        steps = steps[steps > 0]
        assert (np.diff(steps) == 1).all(), name
        assert steps[-1] >= last - 2, name


def test_a_head_that_is_missing_is_told(start_node: Start, tmp_path: Path) -> None:
    first = recorder_of(start_node, tmp_path / "first", "/said")
    talk = speaker(start_node, "/said", "--count", 10**6)
    first.wait_for_line("recording /said", LONG)
    talk.wait_for_line("heard", LONG)
    time.sleep(0.5)
    recorder = recorder_of(start_node, tmp_path / "bag", "/said")
    begins = int(
        recorder.wait_for_line(r"/said begins with message (\d+) of its publisher", LONG)[1]
    )
    assert recorder.stop(timeout=LONG) == 0
    assert begins > 1
    assert numbers(tmp_path / "bag", "/said")[0] == begins - 1
    assert "begins with message" not in first.output
