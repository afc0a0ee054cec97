"""setup.sh and env.sh where something is missing or wrong; nothing here installs or builds."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import pytest
from waiting import PATIENCE

WORKSPACE = Path(__file__).resolve().parents[2] / "ros2_ws"
TOOLS = (
    "bash basename dirname cat cmp cut find flock git grep ls mkdir mv readlink rm sed sha256sum "
    "sleep sort stat tail touch tr uname xargs"
)


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """Return the scripts in a folder of their own, with nothing set up."""
    place = tmp_path / "a clone" / "ros2_ws"
    place.mkdir(parents=True)
    for name in ("env.sh", "setup.sh", "sim.sh", "fastdds_local.xml"):
        shutil.copy(WORKSPACE / name, place)
    for name in ("lib", "requirements"):
        shutil.copytree(WORKSPACE / name, place / name)
    (place / "src").mkdir()
    return place


@pytest.fixture
def bare(tmp_path: Path) -> dict[str, str]:
    """Return an environment with a few tools, and neither compiler nor Python nor ROS."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for tool in TOOLS.split():
        found = shutil.which(tool)
        assert found is not None, tool
        (folder / tool).symlink_to(found)
    return {"PATH": str(folder), "HOME": str(tmp_path), "LANG": "C"}


def bash(
    script: str, env: Mapping[str, str], cwd: Path = Path("/")
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["bash", "-c", script], env=env, cwd=cwd, capture_output=True, text=True, timeout=PATIENCE
    )


def run(words: Sequence[object], env: Mapping[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(word) for word in words],
        env=env,
        cwd="/",
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )


def fake(folder: Path, name: str, text: str) -> None:
    path = folder / name
    path.unlink(missing_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


def test_all_that_is_missing_is_said_at_once(clone: Path, bare: dict[str, str]) -> None:
    done = run([clone / "setup.sh"], bare)
    assert done.returncode == 3
    assert done.stdout == ""
    assert done.stderr.splitlines() == [
        "setup.sh: missing on this machine: Python 3.10 to 3.13 (python3 is missing), a C++ "
        "compiler, make, CMake. On Debian or Ubuntu: sudo apt-get install -y python3 "
        "python3-venv python3-dev g++ make cmake"
    ]


def test_a_python_of_another_version_is_named(clone: Path, bare: dict[str, str]) -> None:
    folder = Path(bare["PATH"])
    for name in ("c++", "make", "cmake"):
        fake(folder, name, "exit 0")
    fake(folder, "python3", '[ "$1" != -V ] || { echo Python 3.14.0; exit 0; }; exit 1')
    done = run([clone / "setup.sh"], bare)
    assert done.returncode == 3
    assert "Python 3.10 to 3.13 (python3 is Python 3.14.0)" in done.stderr
    assert "compiler" not in done.stderr


def test_another_machine_is_refused(clone: Path, bare: dict[str, str]) -> None:
    fake(Path(bare["PATH"]), "uname", "echo Linux aarch64")
    done = run([clone / "setup.sh"], bare)
    assert done.returncode == 3
    assert "needs Linux on x86-64 (here: Linux aarch64)" in done.stderr


def test_another_ros_is_refused(clone: Path, bare: dict[str, str]) -> None:
    env = {**bare, "AMENT_PREFIX_PATH": "/opt/ros/humble", "ROS_DISTRO": "humble"}
    for command in ([clone / "setup.sh"], ["bash", "-c", f". '{clone}/env.sh'"]):
        done = run(command, env)
        assert done.returncode in (1, 3)
        assert "ROS 2 'humble' is sourced" in done.stderr
        assert "open a fresh shell" in done.stderr


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (
            ["--with", "everything"],
            "--with takes train, foxglove, sbom, dev or bench, not 'everything'.",
        ),
        (["--with"], "--with takes train, foxglove, sbom, dev or bench, not ''."),
        (["--fast"], "unknown option '--fast'; see setup.sh --help."),
    ],
)
def test_bad_arguments_of_setup(
    clone: Path, bare: dict[str, str], words: list[str], complaint: str
) -> None:
    done = run([clone / "setup.sh", *words], bare)
    assert (done.returncode, done.stderr) == (2, f"setup.sh: {complaint}\n")


def test_what_is_in_the_place_of_the_environment_is_kept(
    clone: Path, bare: dict[str, str], tmp_path: Path
) -> None:
    for name in ("c++", "make", "cmake"):
        fake(Path(bare["PATH"]), name, "exit 0")
    precious = clone.parent / ".venv" / "precious"
    precious.parent.mkdir()
    precious.write_text("mine")
    done = run([clone / "setup.sh"], {**bare, "PYTHON": str(Path(sys.executable).resolve())})
    assert done.returncode == 3
    assert "is in the way and is not a virtual environment" in done.stderr
    assert precious.read_text() == "mine"


def test_a_script_without_a_set_up_says_what_to_do(clone: Path, bare: dict[str, str]) -> None:
    done = run([clone / "sim.sh"], bare)
    assert done.returncode == 1
    assert "run ros2_ws/setup.sh first" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("domain", ["102", "-1", "x", "1.5", "010", "9999999999999999999"])
def test_a_bad_domain_is_refused(clone: Path, domain: str) -> None:
    done = bash(f". {WORKSPACE}/env.sh", {**os.environ, "ROS_DOMAIN_ID": domain})
    assert done.returncode != 0
    assert done.stderr == (
        f"env.sh: ROS_DOMAIN_ID is '{domain}'; set it to a whole number from 0 to 101.\n"
    )


def test_a_bad_network_is_refused() -> None:
    done = bash(f". {WORKSPACE}/env.sh", {**os.environ, "BICYCLE_NETWORK": "wifi"})
    assert done.returncode != 0
    assert "set it to 'local' or 'lan'" in done.stderr


def test_the_network_is_chosen(tmp_path: Path) -> None:
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "librmw_cyclonedds_cpp.so").touch()  # as in an overlay of one's own
    show = (
        'echo "$ROS_AUTOMATIC_DISCOVERY_RANGE ${SKIP_DEFAULT_XML_FILE:-0} '
        '${FASTRTPS_DEFAULT_PROFILES_FILE:-none}"'
    )
    for network, middleware, chosen in (
        ("local", "rmw_fastrtps_cpp", f"SUBNET 1 {WORKSPACE}/fastdds_local.xml"),
        ("local", "rmw_cyclonedds_cpp", f"LOCALHOST 1 {WORKSPACE}/fastdds_local.xml"),
        ("lan", "rmw_fastrtps_cpp", f"SUBNET 0 {WORKSPACE}/fastdds_lan.xml"),
    ):
        env = {**os.environ, "BICYCLE_NETWORK": network, "RMW_IMPLEMENTATION": middleware}
        env["AMENT_PREFIX_PATH"] = str(tmp_path)
        assert bash(f". {WORKSPACE}/env.sh && {show}", env).stdout == f"{chosen}\n"
    own = {**os.environ, "FASTRTPS_DEFAULT_PROFILES_FILE": "/my.xml", "BICYCLE_NETWORK": "lan"}
    assert bash(f". {WORKSPACE}/env.sh && {show}", own).stdout.endswith(" /my.xml\n")


def test_a_lost_message_is_asked_for_at_once_on_both_networks() -> None:
    times = []
    for network in ("local", "lan"):
        tree = ElementTree.parse(WORKSPACE / f"fastdds_{network}.xml")
        found = [ElementTree.tostring(node) for node in tree.iter() if node.tag.endswith("}times")]
        assert len(found) == 2
        times.append(found)
    assert times[0] == times[1]
    assert b"nanosec>10000000</" in times[0][0]


def test_sourcing_twice_from_anywhere_changes_nothing(tmp_path: Path) -> None:
    show = "env | LC_ALL=C sort | grep -v '^_='"
    once = bash(f". {WORKSPACE}/env.sh; {show}", os.environ, tmp_path).stdout
    twice = bash(
        f". {WORKSPACE}/env.sh; . {WORKSPACE}/env.sh; {show}", os.environ, tmp_path
    ).stdout
    assert "AMENT_PREFIX_PATH" in once
    assert once == twice


def test_only_the_newest_logs_are_kept(clone: Path) -> None:
    logs = clone / "log" / "ros"
    logs.mkdir(parents=True)
    for index in range(30):
        path = logs / f"node_{index}.log"
        if index % 7:
            path.write_text("")
        else:  # a launch leaves a folder
            path.mkdir()
            (path / "launch.log").write_text("")
        os.utime(path, (index, index))
    (clone.parent / ".venv" / "bin").mkdir(parents=True)
    (clone.parent / ".venv" / "bin" / "python").symlink_to("/bin/true")
    env = {name: value for name, value in os.environ.items() if name != "ROS_LOG_DIR"}
    env["AMENT_PREFIX_PATH"] = ""
    done = bash(f"set -e; . '{clone}/env.sh'", env)
    assert done.returncode == 0, done.stderr
    left = sorted(int(path.stem.removeprefix("node_")) for path in logs.iterdir())
    assert left == list(range(10, 30))
