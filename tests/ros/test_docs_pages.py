"""The commands of every page of docs/, run on shorter rides than the pages print.

README.md and docs/training.md are run as printed by test_docs_commands.py. Here each command is
run with words appended that shorten it (the last of an option holds), or names the test that runs
its like, or is said to need what is not here.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from node_process import NodeProcess
from printed import run_printed
from test_docs_commands import PAGES, ROOT, SHORT_FILM

pytestmark = [pytest.mark.ros, pytest.mark.slow]

SHORT_RIDE = "--goals 1 --field 20 simulator.pace:=lockstep"
SHORTER: tuple[tuple[str, str], ...] = (
    (r"bicycle evaluate .*--kicks best", "--kick-speeds 3 --episodes 4"),
    (r"bicycle evaluate .*--course random", "--episodes 4"),
    (r"bicycle evaluate .*--course", ""),
    (r"bicycle evaluate .*--plant", "--episodes 4 --kicks none"),
    (r"bicycle evaluate", "--episodes 4 --kick-speeds 3"),
    (r"bicycle sensing .*--link-loss", "--episodes 4 --bicycles browser-rider"),
    (r"bicycle sensing", "--episodes 4 --duration 4 --bicycles browser-rider"),
    (r"bicycle info", ""),
    (r"\./ros2_ws/ride\.sh --course slalom", "simulator.pace:=lockstep"),
    (r".*\./ros2_ws/ride\.sh --goals", "simulator.pace:=lockstep"),
    (r".*\./ros2_ws/ride\.sh", SHORT_RIDE),
    (r"\./ros2_ws/report\.sh .*--video", SHORT_FILM),
    (r"\./ros2_ws/report\.sh", ""),
    (r"\./ros2_ws/\w+\.sh --help", ""),
)
"""Beginnings of commands that are run here, and the words that shorten them."""
FOREVER: tuple[tuple[str, str], ...] = (
    (r"\./ros2_ws/foxglove\.sh", "ws://"),
    (r"\./ros2_ws/cockpit\.sh --no-ride", "cockpit: http://"),
)
"""Beginnings of commands that run until they are ended, and a line by which they are ready."""
ELSEWHERE: tuple[tuple[str, str], ...] = (
    (r"docker ", "tests/bringup/test_docker.py"),
    (r"\./docker/without_docker\.py", "tests/bringup/test_docker.py"),
    (r"bicycle identify", "tests/controller/test_identify.py"),
    (r"bicycle learn", "tests/controller/test_learn.py"),
    (r"bicycle reproduce", "tests/controller/test_reproduce.py"),
    (r"\./ros2_ws/trainer\.sh", "tests/ros/test_trainer_node.py"),
    (r"\./ros2_ws/record_and_learn\.sh", "tests/tools_package/test_record_and_learn.py"),
    (r"\./ros2_ws/setup\.sh", "tests/bringup/test_shell.py"),
    (r"\. tests/env\.sh", "tests/run.sh"),
    (r"L=tests/data/real_bicycles$", "tests/controller/test_identify.py"),
    (r"\./ros2_ws/cockpit\.sh$", "tests/ros/test_cockpit.py"),
    (r"python tests/benchmarks/(\w+\.py)", r"tests/benchmarks/\1"),
    (r"python ros2_ws/src/examples/own_algorithm\.py", "tests/ros/test_own_controller.py"),
    (r"bicycle evaluate mine\.onnx", "tests/ros/test_own_controller.py"),
    (r".*own_policy:Steer", "tests/ros/test_own_controller.py"),
    (r"\./ros2_ws/ride\.sh --course road", "tests/ros/test_ride_course.py"),
    (r"\./ros2_ws/ride\.sh --hardware-in-the-loop", "tests/ros/test_hardware_in_the_loop.py"),
    (r"\./ros2_ws/driver\.sh", "tests/ros/test_driver_node.py"),
    (r"\./ros2_ws/controller\.sh state:=estimated", "tests/ros/test_hardware_in_the_loop.py"),
    (r"BICYCLE_NETWORK=lan", "tests/ros/test_closed.py"),
)
"""Beginnings of commands, and the file that runs their like."""
NOT_HERE = (
    r"sudo apt|apt-get|source /opt/ros|ros2 |export ROS_SECURITY|rviz2|pip install|python3 -m http"
)
"""Commands that need root, ROS from apt, a download or a web server; the pages say so."""
OTHERS = {"docs/rl.md"}
"""Pages with a test of their own: test_rl_page.py; tutorials have test_tutorials.py."""
DOCS = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").glob("*.md"))
ROAD = "\n".join(
    (
        '<gpx version="1.1" creator="test"><trk><trkseg>',
        *(f'<trkpt lat="{52 + 2e-5 * k}" lon="{4.3 + 1e-6 * k * k}"/>' for k in range(40)),
        "</trkseg></trk></gpx>",
    )
)


def commands(page: str) -> list[str]:
    """Return the commands of a page's shell blocks, without comments, continued lines joined."""
    text = (ROOT / page).read_text(encoding="utf-8")
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    joined = "\n".join(blocks).replace("\\\n", " ")
    lines = [line.partition(" #")[0].strip() for line in joined.splitlines()]
    return [line for line in lines if line]


def matched(table: tuple[tuple[str, str], ...], command: str) -> str | None:
    """Return what a table says of a command; None if it does not name its like."""
    for pattern, words in table:
        if found := re.match(pattern, command):
            return found.expand(words)
    return None


PRINTED = [
    (page, command)
    for page in DOCS
    if page not in OTHERS and page not in PAGES
    for command in commands(page)
]


@pytest.mark.parametrize(("page", "command"), PRINTED)
def test_a_printed_command_is_run_or_says_where(page: str, command: str) -> None:
    if re.match(NOT_HERE, command):
        return
    if (file := matched(ELSEWHERE, command)) is not None:
        assert (ROOT / file).is_file(), file
        return
    known = matched(SHORTER, command) is not None or matched(FOREVER, command) is not None
    assert known, f"{page} prints {command!r}: add it to a table here"


RUN_HERE = sorted(
    {
        command
        for _, command in PRINTED
        if not re.match(NOT_HERE, command) and matched(ELSEWHERE, command) is None
    }
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a checkout's likeness to which commands may write, with two rides and a road."""
    result = tmp_path_factory.mktemp("pages")
    for name in ("ros2_ws", "docs", "tests"):
        (result / name).symlink_to(ROOT / name)
    for name in ("my-ride", "other-ride"):
        shutil.copytree(ROOT / "tests" / "data" / "film-ride", result / name)
    (result / "my-road.gpx").write_text(ROAD)
    return result


@pytest.mark.parametrize("command", RUN_HERE)
def test_a_printed_command_does_what_it_says(command: str, folder: Path, ros_domain: int) -> None:
    del ros_domain  # claimed for what the command starts
    if (line := matched(FOREVER, command)) is not None:
        with NodeProcess(["bash", "-c", f"exec {command}"], cwd=folder) as process:
            process.wait_for_line(line)
        return
    run_printed(command, folder, matched(SHORTER, command) or "")
