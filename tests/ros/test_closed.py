"""Closed by default: nodes keep to this machine, and none runs open where security is asked."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import open_sockets
import pytest
from node_process import NodeProcess
from waiting import PATIENCE

from bicycle_common.nodes import dds_security

pytestmark = pytest.mark.ros

WORKSPACE = Path(__file__).resolve().parents[2] / "ros2_ws"
DISCOVERY_GROUP = "239.255.0.1"
Start = Callable[..., NodeProcess]

READY = {
    "sim": ([], "waits for its first command"),
    "controller": (["policy:=lqr"], "waits for a goal"),
    "record": (["--output", "{folder}/bag"], "recording into"),
    "trainer": (["out:={folder}/run"], "learns live in"),
    "cockpit": (["--no-ride", "--port", "0", "--bags", "{folder}"], "cockpit: http"),
    "foxglove": (["port:=0"], r"ws://127\.0\.0\.1"),
}
"""Arguments of each script that starts a node, and the line that tells that it is up."""


def test_no_socket_of_any_node_is_reached_from_another_machine(
    start_node: Start, tmp_path: Path
) -> None:
    started = []
    for name, (words, _) in READY.items():
        filled = [word.format(folder=tmp_path) for word in words]
        started.append(start_node(WORKSPACE / f"{name}.sh", filled))
    for process, (_, line) in zip(started, READY.values(), strict=True):
        process.wait_for_line(line)
    for process in started:
        sockets = [
            found for pid in open_sockets.family(process.pid) for found in open_sockets.bound(pid)
        ]
        assert sum(found.loopback for found in sockets) >= 4, (process.command, sockets)
        others = [found for found in sockets if not found.loopback]
        # Discovery's own socket: it is bound to the group, and hears it on loopback alone.
        assert {found.address for found in others if found.multicast} == {DISCOVERY_GROUP}
        assert [found for found in others if not found.multicast] == []


def test_a_profile_in_the_working_directory_does_not_open_it(
    ros_domain: int, tmp_path: Path
) -> None:
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").write_text(
        '<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">'
        '<participant profile_name="open" is_default_profile="true"><rtps><name>open</name></rtps>'
        "</participant></profiles>"
    )
    with NodeProcess([str(WORKSPACE / "sim.sh")], cwd=tmp_path) as process:
        process.wait_for_line("waits for its first command")
        sockets = open_sockets.bound(process.pid)
    assert sockets
    assert all(found.loopback or found.multicast for found in sockets)


@pytest.mark.usefixtures("makes_shared_memory")
def test_lan_mode_opens_by_its_variable_alone(start_node: Start) -> None:
    opened = start_node(WORKSPACE / "sim.sh", env={"BICYCLE_NETWORK": "lan"})
    opened.wait_for_line("waits for its first command")
    assert any(not (found.loopback or found.multicast) for found in open_sockets.bound(opened.pid))


@pytest.mark.parametrize("name", [*READY, "ride", "goal", "topic", "replay"])
def test_security_that_cannot_be_had_is_refused(
    name: str, ros_domain: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    words = {"goal": ["1", "2"], "topic": ["list"], "replay": [old_bag()]}
    words |= {script: arguments for script, (arguments, _) in READY.items()}
    words |= {"ride": ["--output", f"{tmp_path}/ride"]}
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Permissive")  # ROS itself would run open
    monkeypatch.setenv("ROS_SECURITY_KEYSTORE", str(tmp_path))
    done = subprocess.run(
        [WORKSPACE / f"{name}.sh", *(word.format(folder=tmp_path) for word in words[name])],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.returncode == 2, done
    assert "is built without it: unset that" in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    assert not (tmp_path / "bag").exists()


def old_bag() -> str:
    return str(Path(__file__).parents[1] / "data" / "ride-0.1.0")


@pytest.fixture
def secured(tmp_path: Path) -> Path:
    """Make a library look as if it was built with security."""
    library = tmp_path / "libfastrtps.so.2.14"
    library.write_bytes(b"\x7fELF" + bytes(1000) + dds_security.PLUGIN + bytes(1000))
    return library


def test_a_middleware_that_has_security_is_let_through(secured: Path) -> None:
    asked = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"}
    assert dds_security.complaint(asked, secured) == ""
    assert dds_security.complaint(asked, None) == ""
    wheels = dds_security.fast_dds()
    assert wheels is not None
    assert "built without it" in dds_security.complaint(asked, wheels)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({}, ""),
        ({"ROS_SECURITY_ENABLE": ""}, ""),
        ({"ROS_SECURITY_ENABLE": "false", "ROS_SECURITY_KEYSTORE": "/keys"}, ""),
        ({"ROS_SECURITY_KEYSTORE": "/keys"}, "asked for (ROS_SECURITY_KEYSTORE)"),
        ({"ROS_SECURITY_ENABLE": "True"}, "'True': ROS knows 'true' and 'false'"),
        ({"ROS_SECURITY_STRATEGY": "enforce"}, "'enforce': ROS knows 'Enforce' and 'Permissive'"),
    ],
)
def test_what_asks_for_security(asked: dict[str, str], said: str) -> None:
    line = dds_security.complaint(asked, dds_security.fast_dds())
    assert said in line
    assert bool(said) == bool(line)
    assert "\n" not in line
