"""Record, replay and repair with real processes."""

from __future__ import annotations

import shutil
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from node_process import NodeProcess
from probe import Probe
from rosbags.highlevel import AnyReader
from std_srvs.srv import Trigger
from waiting import until

from bicycle_bag import columns, repair
from bicycle_bag.errors import BagError
from bicycle_bag.reader import BagReader
from bicycle_common.nodes.topics import Service

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("no_new_shared_memory")]

TALKER = Path(__file__).parents[1] / "support" / "talker.py"
RECORDER = "bicycle_bag.nodes.recorder_node"
PLAYER = "bicycle_bag.nodes.player_node"
STATE = "/bicycle/state"
EPISODE = "/bicycle/episode"
StartNode = Callable[..., NodeProcess]


def start_recorder(start_node: StartNode, bag: Path, *options: object) -> NodeProcess:
    recorder = start_node(RECORDER, ["--output", bag, *options])
    recorder.wait_for_line("recording into")
    return recorder


def start_talker(start_node: StartNode, *options: object) -> NodeProcess:
    return start_node(sys.executable, [TALKER, *options])


def record_talk(start_node: StartNode, bag: Path, count: int) -> str:
    """Record a whole talk; returns what the recorder printed."""
    recorder = start_recorder(start_node, bag)
    start_talker(start_node, "--count", count).wait_for_line("said")
    assert recorder.stop(signal.SIGINT) == 0, recorder.output
    return recorder.output


def payloads(bag: Path, topic: str) -> list[bytes]:
    return [message.data for message in BagReader(bag).messages([topic])]


@pytest.fixture(scope="module")
def talk_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the bag that several tests replay."""
    return tmp_path_factory.mktemp("talk")


@pytest.fixture
def talk(start_node: StartNode, talk_folder: Path) -> Path:
    """Return a bag of 300 states and a latched episode, recorded for the first test."""
    bag = talk_folder / "bag"
    if not bag.is_dir():
        record_talk(start_node, bag, 300)
    return bag


def test_recorded_messages_are_all_there_for_everyone(
    start_node: StartNode, tmp_path: Path
) -> None:
    talk = tmp_path / "bag"
    printed = record_talk(start_node, talk, 300)
    assert "0 lost on the way" in printed
    reader = BagReader(talk)
    assert reader.counts[STATE] == 300
    assert reader.counts[EPISODE] == 1
    assert list(columns.load(talk, STATE)["step"]) == list(range(300))
    times = [message.log_time_ns for message in reader.messages()]
    assert times == sorted(times)
    with AnyReader([talk]) as foreign:  # checks the type hashes too
        by_rosbags = Counter(connection.topic for connection, _, _ in foreign.messages())
    with (talk / "bag_0.mcap").open("rb") as stream:
        decoded = make_reader(stream, decoder_factories=[DecoderFactory()])
        by_mcap = Counter(item.channel.topic for item in decoded.iter_decoded_messages())
    counts = {topic: count for topic, count in reader.counts.items() if count}
    assert dict(by_rosbags) == dict(by_mcap) == counts
    offer = reader.topics[EPISODE].qos[0]
    assert (offer.durability, offer.reliability) == ("transient_local", "reliable")
    assert reader.metadata.custom_data["recorder"].startswith("bicycle_bag")


def resume_when_recorded(domain: int, recorder: NodeProcess, *topics: str) -> None:
    """Let a replay that begins held go on when a recorder hears its topics."""
    for topic in topics:
        recorder.wait_for_line(f"recording {topic}")
    probe = Probe(domain)
    try:
        resume = Service("/bicycle_player/resume", Trigger)
        assert probe.call(resume, Trigger.Request()).success
    finally:
        probe.close()


def test_replay_recorded_again_is_identical(
    start_node: StartNode, ros_domain: int, talk: Path, tmp_path: Path
) -> None:
    recorder = start_recorder(start_node, tmp_path / "again")
    player = start_node(PLAYER, [talk, "--rate", "4", "--delay", "0", "--pause"])
    resume_when_recorded(ros_domain, recorder, STATE, EPISODE)
    assert player.wait() == 0, player.output
    assert recorder.stop(signal.SIGTERM) == 0, recorder.output
    for topic in (STATE, EPISODE):
        assert payloads(tmp_path / "again", topic) == payloads(talk, topic)
    again, first = BagReader(tmp_path / "again"), BagReader(talk)
    assert again.topics[STATE] == first.topics[STATE]
    assert again.topics[EPISODE] == first.topics[EPISODE]
    assert again.definition(STATE) == first.definition(STATE)


def test_replay_options(
    start_node: StartNode, ros_domain: int, talk: Path, tmp_path: Path
) -> None:
    recorder = start_recorder(start_node, tmp_path / "part", "--topics", "/clock", "bicycle/state")
    first = BagReader(talk).starting_time_ns
    moments = [message.log_time_ns for message in BagReader(talk).messages([STATE])]
    offset = (moments[100] - first) / 1e9
    options = ["--start-offset", offset, "--clock", "100", "--topics", STATE, "--delay", "0"]
    player = start_node(PLAYER, [talk, *options, "--pause"])
    resume_when_recorded(ros_domain, recorder, STATE, "/clock")
    assert player.wait() == 0, player.output
    assert recorder.stop() == 0
    part = BagReader(tmp_path / "part")
    assert set(part.topics) == {"/clock", STATE}
    clock = columns.load(part, "/clock")["clock"]
    assert clock[0] == pytest.approx(moments[100] / 1e9, abs=1e-6)
    assert clock[1] - clock[0] == pytest.approx(0.01, abs=1e-6)
    steps = columns.load(part, STATE)["step"]
    assert steps[0] in (100, 101)
    assert list(steps) == list(range(steps[0], 300))


def test_looping_replay_ends_on_sigint(start_node: StartNode, talk: Path) -> None:
    player = start_node(PLAYER, [talk, "--loop", "--rate", "50"])
    player.wait_for_line("playing")
    assert player.stop(signal.SIGINT) == 0
    assert "played" in player.lines[-1]
    assert "Traceback" not in player.output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_recorder_ends_on_a_signal_with_a_whole_bag(
    start_node: StartNode, tmp_path: Path, number: signal.Signals
) -> None:
    bag = tmp_path / "bag"
    recorder = start_recorder(start_node, bag)
    start_talker(start_node, "--count", 100000, "--hz", 500).wait_for_line("heard")
    recorder.wait_for_line(f"recording {STATE}")
    assert recorder.stop(number) == 0
    assert "Traceback" not in recorder.output
    assert (bag / "metadata.yaml").is_file()
    assert f"recorded {BagReader(bag).message_count} messages" in recorder.output


def written(bag: Path, folder: Path) -> int:
    """Return the number of states that a kill of the recorder would leave now."""
    copy = folder / "copy"
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(bag, copy)
    repair.repair(copy)
    return BagReader(copy).counts.get(STATE, 0)


def test_killed_recorder_loses_nothing_that_it_has_had_for_a_while(
    start_node: StartNode, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    recorder = start_recorder(start_node, bag)
    talker = start_talker(start_node, "--count", 100_000, "--hz", 200)
    talker.wait_for_line("step 500")
    talker.send_signal(signal.SIGSTOP)
    until(lambda: written(bag, tmp_path) >= 500)
    recorder.kill()
    with pytest.raises(BagError, match=r"record\.sh --repair"):
        BagReader(bag)
    report = repair.repair(bag)
    steps = list(columns.load(bag, STATE)["step"])
    assert steps == list(range(len(steps)))
    assert len(steps) >= 500
    assert BagReader(bag).counts[EPISODE] == 1
    with AnyReader([bag]) as reader:
        assert reader.message_count == report.messages


def test_a_publisher_may_leave_and_come_back(start_node: StartNode, tmp_path: Path) -> None:
    recorder = start_recorder(start_node, tmp_path / "bag", "--exclude", "rosout|parameter")
    for _ in range(2):
        assert start_talker(start_node, "--count", 20).wait() == 0
        time.sleep(1.5)  # long enough for the recorder to look at a topic that nobody publishes
    assert recorder.stop() == 0
    assert BagReader(tmp_path / "bag").counts == {STATE: 40, EPISODE: 2}
    assert "anew" not in recorder.output
    assert "0 lost on the way" in recorder.output


def test_what_cannot_be_done_is_said_in_one_line(start_node: StartNode, tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(b"\x89MCAP0\r\n" + bytes(100))
    new = ["-o", tmp_path / "new"]
    for module, args, status, said in (
        (RECORDER, ["-o", tmp_path / "there"], 2, "exists: choose another name"),
        (RECORDER, [*new, "--regex", "("], 2, "not a regular expression"),
        (RECORDER, [*new, "--custom-data", "seed"], 2, "key=value"),
        (RECORDER, [*new, "--max-bag-size", "-1"], 2, "choose 0 or >="),
        (RECORDER, [*new, "--ros-args", "-r", "__ns:=b"], 2, "is no namespace"),
        (PLAYER, [broken], 1, r"record\.sh --repair"),
        (PLAYER, [tmp_path / "nothing"], 1, "there is no bag"),
        (PLAYER, [broken, "--rate", "0"], 2, "rate is 0"),
        (PLAYER, [broken, "--qos-profile-overrides-path", "/none"], 2, "cannot read /none"),
    ):
        process = start_node(module, args)
        assert process.wait() == status
        process.wait_for_line(said)
        assert len(process.lines) == 1, process.output
    assert not (tmp_path / "new").exists()
