"""The single scripts: help, mistakes, signals, stop, topics and goals, with real nodes."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml
from node_process import NodeProcess
from probe import Probe
from std_srvs.srv import SetBool
from waiting import PATIENCE, until

from bicycle_common.node_commands import config_folder
from bicycle_common.nodes.topics import PAUSE
from bicycle_common.parameters import parameters_of
from bicycle_controller.nodes.controller_settings import ControllerSettings

pytestmark = [pytest.mark.ros, pytest.mark.slow]

WORKSPACE = Path(__file__).resolve().parents[2] / "ros2_ws"
SCRIPTS = (
    "sim",
    "controller",
    "goal",
    "reset",
    "push",
    "service",
    "record",
    "replay",
    "topic",
    "stop",
    "ride",
    "setup",
    "trainer",
    "record_and_learn",
    "report",
    "foxglove",
    "teleop",
    "path",
)
Start = Callable[..., NodeProcess]


def script(name: str, *words: object, cwd: Path = Path("/")) -> subprocess.CompletedProcess[str]:
    """Run a script to its end, from a folder that is not the workspace."""
    return subprocess.run(
        [str(WORKSPACE / f"{name}.sh"), *map(str, words)],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )


@pytest.fixture
def start_script(start_node: Start) -> Start:
    """Start a script by its name."""
    return lambda name, *words: start_node(WORKSPACE / f"{name}.sh", words)


@pytest.fixture
def bicycle(start_script: Start) -> tuple[NodeProcess, NodeProcess]:
    """Return a simulator and a controller that ride as fast as they can."""
    simulator = start_script("sim", "pace:=lockstep")
    simulator.wait_for_line("waits for its first command")
    controller = start_script("controller", "policy:=lqr")
    controller.wait_for_line("waits for a goal")
    return simulator, controller


@pytest.fixture
def probe(ros_domain: int) -> Iterator[Probe]:
    result = Probe(ros_domain)
    yield result
    result.close()


@pytest.mark.parametrize("name", SCRIPTS)
def test_help_tells_usage_and_exit_status(name: str, ros_domain: int) -> None:
    done = script(name, "--help")
    assert done.returncode == 0
    assert f"Usage: {name}.sh" in done.stdout
    assert "Exit status: 0" in done.stdout
    assert done.stderr == ""


@pytest.mark.parametrize(
    ("name", "parameter"), [("sim", "pace"), ("controller", "policy"), ("foxglove", "host")]
)
def test_help_lists_parameters(name: str, parameter: str, ros_domain: int) -> None:
    assert f"  {parameter}:=" in script(name, "--help").stdout


def test_the_controllers_file_holds_its_defaults() -> None:
    stored = yaml.safe_load((config_folder() / "controller.yaml").read_text())
    defaults = {item.name: item.default for item in parameters_of(ControllerSettings)}
    assert stored == {"/**": {"ros__parameters": defaults}}


@pytest.mark.parametrize(
    ("words", "status", "complaint"),
    [
        (("sim", "pase:=lockstep"), 2, "unknown parameter 'pase' (did you mean 'pace'?)"),
        (("sim", "pace:=fast"), 2, "pace"),
        (("sim", "real_time_factor:=-1.0"), 2, "real_time_factor"),
        (("sim", "none.yaml"), 2, "no parameter file 'none.yaml'"),
        (("sim", "--fast"), 2, "unknown argument '--fast'"),
        (("controller", "policy:=/none.safetensors"), 2, "/none.safetensors"),
        (("goal",), 2, "give X and Y in metres, or --file"),
        (("goal", "1", "north"), 2, "invalid float value: 'north'"),
        (("goal", "nan", "1"), 2, "not finite"),
        (("goal", "1", "2", "--timeout", "0"), 2, "--timeout is 0.0"),
        (("goal", "--file", "/none.csv"), 2, "cannot read /none.csv"),
        (
            ("goal", "1", "2", "--timeout", "0.5"),
            4,
            "no simulator (start sim.sh) and no controller (start controller.sh) within 0.5 s",
        ),
        (("reset", "--timeout", "0.5"), 4, "nobody offers /bicycle/reset within 0.5 s: start sim"),
        (("reset", "1", "inf"), 2, "y is inf: give a finite number"),
        (("reset", "1", "--random"), 2, "give a place or --random, not both"),
        (("push", "left", "--timeout", "0.5"), 4, "nobody offers /bicycle/push within 0.5 s"),
        (("push", "up"), 2, "invalid choice: 'up'"),
        (("push", "left", "-1"), 2, "the strength is -1.0"),
        (("service", "call", "no/such", "--timeout", "0.5"), 1, "nobody offers /no/such"),
        (("service", "call", "a", "no/srv/Such"), 1, "type 'no/srv/Such' is not installed here"),
        (("service", "call", "a", ".../srv/X"), 1, "type '.../srv/X' is not installed here"),
        (("service",), 2, "required: list|type|call"),
        (
            ("topic", "pub", "a", "no/msg/Such"),
            1,
            "/a has type no/msg/Such, which is not installed here",
        ),
        (("topic", "pub", "a", "--rate", "0"), 2, "--rate is 0.0"),
        (("topic", "pub", "a", "std_msgs/msg/Bool", "{data: 2}"), 2, "must be true or false"),
        *(
            ((name, *words, "a b"), 2, "'a b' is no name of a")
            for name, words in (
                ("topic", ("info",)),
                ("topic", ("type",)),
                ("topic", ("echo",)),
                ("topic", ("rate",)),
                ("service", ("type",)),
                ("service", ("call",)),
            )
        ),
        (
            ("topic", "echo", "9x"),
            2,
            "name token must not start with a number",
        ),
        (
            ("topic", "info", "/x/"),
            2,
            "name must not end with a forward slash",
        ),
        (("topic", "pub", "ü", "std_msgs/msg/Bool", "{}"), 2, "'ü' is no name of a topic: "),
        (("goal", "1", "2", "timeout:=3"), 2, "there are no parameters here"),
        *(
            ((name, *words, "pace:=lockstep"), 2, "there are no parameters here")
            for name, words in {
                "record": (),
                "replay": (),
                "reset": (),
                "push": ("left",),
                "topic": ("list",),
                "service": ("list",),
                "report": (),
            }.items()
        ),
        (("stop", "pace:=lockstep"), 2, "'pace:=lockstep' is no name of what runs here"),
        (("setup", "pace:=lockstep"), 2, "unknown option 'pace:=lockstep'"),
        (("record_and_learn", "pace:=lockstep", "1"), 2, "unknown option 'pace:=lockstep'"),
        (("replay", "/none"), 1, "no bag /none"),
        (("replay", "--verify", "/none"), 1, "no bag /none"),
        (("record", "--repair", "/none"), 1, "no bag /none"),
        (("report", "/none"), 1, "no bag /none"),
        (("report", "--output", "x.html"), 2, "required: bags"),
        (("foxglove", "port:=70000"), 2, "port"),
        (("foxglove", "topics:=("), 2, "not a regular expression"),
        (("topic",), 2, "required: list|info|type|echo|rate|hz|pub"),
        (("topic", "watch"), 2, "invalid choice: 'watch'"),
        (("stop", "--now"), 2, "unknown option '--now'"),
        (("ride", "--gaols", "3"), 2, "unrecognized arguments: --gaols"),
    ],
)
def test_a_mistake_is_one_line_with_a_status(
    words: tuple[str, ...], status: int, complaint: str, ros_domain: int
) -> None:
    done = script(*words)
    assert done.returncode == status, done
    assert complaint in done.stderr
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1, done.stderr


ODD = ("", " ", "-1", "nan", "1e3", "0x1", "1 2", "a\nb", "x" * 5000, "\udcff", "1;id", "9" * 400)
"""Values that no number is, nor a name of what there is."""


@pytest.mark.parametrize("option", ["minutes", "updates", "goals", "seed", "sigmas"])
@pytest.mark.parametrize("value", [*ODD, "0"], ids=lambda value: repr(value[:9]))
def test_a_number_of_record_and_learn_that_is_none_is_one_line(option: str, value: str) -> None:
    if (option, value) in (("seed", "0"), ("sigmas", "0"), ("sigmas", "1 2")):
        value = f"{value} x"
    mistaken("record_and_learn", f"--{option}", value)


@pytest.mark.parametrize(
    "words",
    [
        *(("setup", "--with", value) for value in ODD),
        *(("setup", value) for value in ODD),
        *(("stop", value) for value in ODD if not value.isalpha()),
        *(("record_and_learn", value) for value in ODD),
        *(("record_and_learn", value, "1") for value in ODD),
        ("record_and_learn", "--policy", ""),
        ("record_and_learn", "--output", ""),
        ("record_and_learn", "--output", "/"),
        ("record_and_learn", "--seed"),
        ("setup", "--with"),
    ],
    ids=lambda words: repr(" ".join(words)[:30]),
)
def test_a_word_that_a_script_does_not_know_is_one_line(words: tuple[str, ...]) -> None:
    mistaken(*words)


def mistaken(name: str, *words: str) -> None:
    """Assert that a script tells a mistake in one line, with status 2."""
    given = [os.fsencode(word) for word in words]
    done = subprocess.run(
        [os.fsencode(WORKSPACE / f"{name}.sh"), *given], capture_output=True, timeout=PATIENCE
    )
    assert (done.returncode, done.stdout) == (2, b""), done
    assert done.stderr.startswith(f"{name}.sh: ".encode())
    assert done.stderr.count(b"\n") == 1
    assert len(done.stderr) < 1200


def test_two_recorders_of_the_same_second_record_into_two_bags(
    start_script: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ros_domain: int
) -> None:
    """One was refused: its bag was there. The recorders of two bicycles are started together."""
    (tmp_path / "date").write_text(f"#!/bin/sh\necho 2001-01-01-{ros_domain}\n")
    (tmp_path / "date").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    recorders = [start_script("record") for _ in range(3)]
    try:
        into = r"recording into \S*/(bag-2001\S*);"
        names = sorted(recorder.wait_for_line(into)[1] for recorder in recorders)
        assert [recorder.stop() for recorder in recorders] == [0, 0, 0]
        base = f"bag-2001-01-01-{ros_domain}"
        assert names == [base, f"{base}-2", f"{base}-3"]
    finally:
        for bag in (WORKSPACE / "runs").glob(f"bag-2001-01-01-{ros_domain}*"):
            shutil.rmtree(bag)


def test_a_script_of_another_name_tells_the_new_one() -> None:
    done = script("circle", "--help")
    assert (done.returncode, done.stderr) == (0, "circle.sh is called record_and_learn.sh now\n")
    assert done.stdout == script("record_and_learn", "--help").stdout


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_script_becomes_its_node_and_ends_with_status_0(
    start_script: Start, number: signal.Signals
) -> None:
    simulator = start_script("sim")
    simulator.wait_for_line("waits for its first command")
    command = Path(f"/proc/{simulator.pid}/cmdline").read_text()
    assert "bicycle_sim.nodes.sim_node" in command
    assert simulator.stop(number) == 0


def test_parameters_come_from_files_and_words_and_the_later_wins(
    start_script: Start, tmp_path: Path
) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text("/**: {ros__parameters: {start_x: 5.0, start_y: 7.0}}")
    start_script("sim", mine, "start_y:=9.0").wait_for_line("waits for its first command")
    done = script("topic", "echo", "bicycle/state", "--once", "--field", "rear_contact")
    assert done.stdout.splitlines()[:2] == ["rear_contact.x: 5.0", "rear_contact.y: 9.0"]


def test_stop_ends_what_was_started_and_nothing_else(
    bicycle: tuple[NodeProcess, NodeProcess], start_node: Start, tmp_path: Path
) -> None:
    stranger = start_node("bicycle_bag.nodes.recorder_node", ["--output", tmp_path / "bag"])
    stranger.wait_for_line("recording into")
    only = script("stop", "controller")
    assert only.stdout.startswith("stopped controller (process ")
    assert bicycle[1].wait() == 0
    assert bicycle[0].running
    rest = script("stop")
    assert rest.stdout == f"stopped simulator (process {bicycle[0].pid}, SIGINT)\n"
    assert bicycle[0].wait() == 0
    assert stranger.running
    again = script("stop")
    assert (again.returncode, again.stdout) == (
        0,
        f"nothing of this workspace runs on domain {os.environ['ROS_DOMAIN_ID']}\n",
    )


def test_a_stale_note_kills_nobody(ros_domain: int) -> None:
    sleeper = subprocess.Popen(["sleep", "infinity"])
    folder = WORKSPACE / "runs" / "pids" / str(ros_domain)
    folder.mkdir(parents=True, exist_ok=True)
    note = folder / f"simulator.{sleeper.pid}"
    note.write_text("12345\n")  # another process's start time: the pid was given out again
    try:
        assert "nothing of this workspace runs" in script("stop").stdout
        assert sleeper.poll() is None
        assert not note.exists()
    finally:
        sleeper.kill()
        sleeper.wait()


def told(words: tuple[str, ...], *lines: str) -> str:
    """Ask what there is until all of this is told: a very busy machine finds nodes late."""

    def answer() -> str:
        text = re.sub(" +", " ", script(*words).stdout)
        return text if all(line in text for line in lines) else ""

    return until(answer)


def test_topics_are_listed_described_and_measured(
    bicycle: tuple[NodeProcess, NodeProcess],
) -> None:
    kind = "bicycle_msgs/msg/BicycleState"
    told(("topic", "list"), f"/bicycle/state {kind} (1 publish, 1 subscribe)\n")
    ends = "published by /bicycle_controller", "subscribed by /bicycle_sim"
    told(("topic", "info", "/bicycle/command"), *(f"{end} (reliable, volatile)" for end in ends))
    rate = script("topic", "rate", "bicycle/state", "--seconds", "1")
    assert rate.returncode == 0
    assert " Hz, period " in rate.stdout
    feedback = "bicycle/ride_to_pose/_action/feedback"
    told(("topic", "type", feedback), " goal_id: unique_identifier_msgs/UUID\n")
    latched = script("topic", "echo", "bicycle/episode", "--once").stdout
    assert "pace: lockstep" in latched


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("echo", "bicycle/stat", "--once"), "nobody publishes /bicycle/stat (did you mean"),
        (("echo", "bicycle/state", "--once", "--field", "roll"), "has no field 'roll'"),
    ],
)
def test_a_wrong_topic_is_one_line(
    bicycle: tuple[NodeProcess, NodeProcess], words: tuple[str, ...], complaint: str
) -> None:
    done = script("topic", *words)
    assert done.returncode == 1
    assert complaint in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_goal_for_a_bicycle_that_lies_is_told_at_once_and_a_reset_mends_it(
    start_script: Start, tmp_path: Path
) -> None:
    simulator = start_script("sim")
    simulator.wait_for_line("waits for its first command")
    start_script("controller", "policy:=lqr").wait_for_line("waits for a goal")
    waiting = start_script("goal", 900, 0, "--wait")
    simulator.wait_for_line("rides under")
    for _ in range(40):
        if script("push", "left", 2).returncode == 3:
            break
    # It falls while it is waited for, and is found lying.
    assert waiting.wait() == 3, waiting.output
    for words in (("goal", 5, 5, "--wait"), ("goal", 5, 5)):
        done = script(*words)
        assert (done.returncode, done.stdout) == (3, "")
        assert done.stderr == (
            "goal.sh: the bicycle lies: reset.sh puts it up again; no goal was sent\n"
        )
    done = script("push", "left")
    assert (done.returncode, done.stderr) == (
        3,
        "push.sh: the bicycle lies: reset.sh puts it up again\n",
    )
    done = script("reset", 3, 4, 1.5, "--speed", 2)
    assert (done.returncode, done.stdout) == (
        0,
        "episode 2 waits for its first command, seed 2\n",
    )
    placed = script("topic", "echo", "bicycle/state", "--once", "--field", "rear_contact").stdout
    assert placed.splitlines()[:2] == ["rear_contact.x: 3.0", "rear_contact.y: 4.0"]
    assert script("goal", 3, 25, "--wait").returncode == 0


def test_a_controller_that_is_gone_is_not_waited_for(
    bicycle: tuple[NodeProcess, NodeProcess], start_script: Start
) -> None:
    waiting = start_script("goal", 9000, 0, "--wait")
    bicycle[1].wait_for_line(r"goal 1 \(9000, 0\) active")
    assert bicycle[1].stop() == 0
    assert waiting.wait() == 4, waiting.output
    assert "no controller for 10 s: start controller.sh" in waiting.lines[-1]


def test_a_bicycle_that_stands_still_is_not_said_to_ride_on(
    bicycle: tuple[NodeProcess, NodeProcess], start_script: Start, probe: Probe
) -> None:
    assert script("goal", "9000", "0").stdout == "accepted\n"
    bicycle[1].wait_for_line(r"goal 1 \(9000, 0\) active")
    assert probe.call(PAUSE, SetBool.Request(data=True)).success
    # A machine that stood still for a second has brought no state.
    assert re.search("stands still: is it paused|no state has come for", timed_out(4))


def timed_out(seconds: float) -> str:
    """Return the last line of a goal that is far too far; a busy machine finds nobody so soon."""
    for patience in (seconds, 5 * seconds, 20 * seconds):
        done = script("goal", "9999", "0", "--wait", "--timeout", patience)
        assert done.returncode == 4
        if "not reached within" in done.stderr:
            assert f"not reached within {patience:g} s" in done.stderr
            return done.stderr
    raise AssertionError(done.stderr)


def test_services_are_listed_described_and_called(
    bicycle: tuple[NodeProcess, NodeProcess],
) -> None:
    listed = told(("service", "list"), "/bicycle/pause std_srvs/srv/SetBool\n")
    assert "get_parameters" not in listed
    told(("service", "list", "--all"), "get_parameters")
    assert script("service", "type", "bicycle/push").stdout.splitlines() == [
        "bicycle_msgs/srv/Push",
        "  lean_rate: double",
    ]
    done = script("service", "call", "bicycle/pause", "std_srvs/srv/SetBool", "{data: true}")
    assert (done.returncode, done.stdout) == (0, "success: true\nmessage: paused\n")
    done = script("service", "call", "bicycle/load_policy", "{path: nothing}")
    assert done.returncode == 1, "the service said that it failed"
    assert "success: false" in done.stdout
    for values, complaint in {
        "{dta: true}": "has no field 'dta' (did you mean 'data'?)",
        "{data: 1}": "data must be true or false, not 1",
        "[1": "is not YAML",
        "true": "must be fields",
    }.items():
        done = script("service", "call", "bicycle/pause", values)
        assert done.returncode == 2
        assert complaint in done.stderr
        assert done.stderr.count("\n") == 1


def test_a_message_is_published_and_arrives(bicycle: tuple[NodeProcess, NodeProcess]) -> None:
    values = "{header: {frame_id: odom}, pose: {position: {x: 12, y: 3.5}}}"
    done = script("topic", "pub", "--once", "goal_pose", values)
    assert (done.returncode, done.stdout) == (0, "published 1 message on /goal_pose\n")
    bicycle[1].wait_for_line(r"goal 1 \(12, 3.5\) active")
    sent = script("topic", "pub", "/mine", "std_msgs/msg/String", "data: a", "-t", 3, "-w", 0)
    assert sent.stdout == "published 3 messages on /mine\n"
    alone = script("topic", "pub", "/mine", "std_msgs/msg/String", "data: a", "--once")
    assert alone.returncode == 1
    assert "0 subscribe to /mine after 3 s, not 1" in alone.stderr
    unknown = script("topic", "pub", "/mine", "data: a", "--once")
    assert (unknown.returncode, "write pkg/msg/Type" in unknown.stderr) == (2, True)
    assert script("topic", "type", "goal_pose").stdout.splitlines()[0] == (
        "geometry_msgs/msg/PoseStamped"
    )


def test_tools_find_a_bicycle_in_a_namespace(start_script: Start) -> None:
    space = "__ns:=/red"
    start_script("sim", "pace:=lockstep", space).wait_for_line("waits for its first command")
    start_script("controller", "policy:=lqr", space).wait_for_line("waits for a goal")
    assert script("goal", 12, 3, "--timeout", 1).returncode == 4
    assert script("goal", 12, 3, "--wait", space).returncode == 0
    assert script("topic", "echo", "bicycle/state", "--once", space).returncode == 0
    assert script("push", "left", space).returncode == 0
    assert script("reset", space).returncode == 0
    assert script("service", "call", "bicycle/pause", "{data: true}", space).returncode == 0


def test_a_goal_is_ridden_to(bicycle: tuple[NodeProcess, NodeProcess]) -> None:
    done = script("goal", "12", "-3", "--wait")
    assert done.returncode == 0, done
    assert "goal 1 at (12, -3): reached after" in done.stdout


def test_a_far_goal_is_rejected_and_a_second_one_replaces_the_first(
    bicycle: tuple[NodeProcess, NodeProcess], start_script: Start
) -> None:
    rejected = script("goal", "1e6", "0")
    assert (rejected.returncode, rejected.stdout) == (2, "")
    assert "goal rejected: its position (1e+06, 0)" in rejected.stderr
    first = start_script("goal", "9000", "0", "--wait")
    bicycle[1].wait_for_line(r"goal \d+ \(9000, 0\) active")
    assert script("goal", "-9000", "0").stdout == "accepted\n"
    assert first.wait() == 4
    assert "goal 1 replaced: a newer goal came" in first.output


def test_waypoints_are_ridden_to_in_order(
    bicycle: tuple[NodeProcess, NodeProcess], tmp_path: Path
) -> None:
    (tmp_path / "way.csv").write_text("x,y\n12,0\n12,14\n")
    done = script("goal", "--file", "way.csv", "--wait", cwd=tmp_path)
    assert done.returncode == 0, done
    first, second = done.stdout.splitlines()
    assert first.startswith("goal 1 at (12, 0): reached")
    assert second.startswith("goal 2 at (12, 14): reached")


def test_a_goal_times_out(bicycle: tuple[NodeProcess, NodeProcess]) -> None:
    assert "; the bicycle stands" not in timed_out(1.5)
