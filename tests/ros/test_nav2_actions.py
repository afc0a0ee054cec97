"""Nav2's actions are served where its messages are; a stand-in of their names is built here."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from node_process import NodeProcess

pytestmark = [
    pytest.mark.ros,
    pytest.mark.slow,
    pytest.mark.usefixtures("no_new_shared_memory"),
]

SUPPORT = Path(__file__).parents[1] / "support"
SUCCEEDED, ABORTED = 4, 6
"""action_msgs/GoalStatus."""
ASKED = (math.pi / 2, math.pi)
"""rad, directions of arrival of the client's two rides to poses."""


@pytest.fixture(scope="module")
def nav2(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Build nav2_msgs's stand-in; return the variables that let a process find it."""
    folder = tmp_path_factory.mktemp("nav2")
    venv = os.environ.get("VIRTUAL_ENV", "")
    if not venv:
        pytest.skip("a native ROS 2 has nav2_msgs of its own")
    start = "import sys; from colcon_core.command import main; sys.exit(main())"
    build = [sys.executable, "-c", start, "--log-base", "/dev/null", "build"]
    build += [
        "--base-paths",
        str(SUPPORT / "nav2_stand_in"),
        "--build-base",
        str(folder / "build"),
    ]
    build += ["--install-base", str(folder / "install"), "--merge-install"]
    build += ["--cmake-args", "-G", "Ninja", f"-DCMAKE_PREFIX_PATH={venv}"]
    build += [f"-DPython3_EXECUTABLE={venv}/bin/python", "-DBUILD_TESTING=OFF"]
    done = subprocess.run(build, capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    install = folder / "install"
    (packages,) = install.glob("lib/python3*/*-packages")

    def before(name: str, value: object) -> str:
        old = os.environ.get(name, "")
        return f"{value}:{old}" if old else str(value)

    return {
        "PYTHONPATH": before("PYTHONPATH", packages),
        "LD_LIBRARY_PATH": before("LD_LIBRARY_PATH", install / "lib"),
        "AMENT_PREFIX_PATH": before("AMENT_PREFIX_PATH", install),
    }


def words(**values: object) -> list[str]:
    return ["--ros-args", *(w for n, v in values.items() for w in ("-p", f"{n}:={v}"))]


def test_a_program_of_nav2_rides(
    nav2: dict[str, str], start_node: Callable[..., NodeProcess]
) -> None:
    sim = words(pace="lockstep", scenario="learned-speed")
    start_node("bicycle_sim.nodes.sim_node", sim).wait_for_line("episode 1 waits")
    controller = words(policy="lqr-pedal")
    module = "bicycle_controller.nodes.controller_node"
    start_node(module, controller, nav2).wait_for_line("waits for a goal")
    client = start_node(sys.executable, [SUPPORT / "nav2_client.py"], nav2)
    assert client.wait(240.0) == 0, client.lines
    names = ("navigate_to_pose:", "navigate_through_poses:", "follow_path:")
    outcomes = [line.split() for line in client.lines if line.startswith(names)]
    assert [line[0] for line in outcomes] == [*names, "follow_path:", "navigate_to_pose:"]
    for _, status, error, left, count in outcomes[:3]:
        assert (int(status), int(error)) == (SUCCEEDED, 0)
        assert float(left) >= 0.0
        assert int(count) > 1
    # The orientation of the last of several poses is the direction of arrival, too.
    yaws = [float(line.split()[1]) for line in client.lines if line.startswith("yaw")]
    off = [
        math.remainder(yaw - asked, 2.0 * math.pi) for yaw, asked in zip(yaws, ASKED, strict=True)
    ]
    assert max(map(abs, off)) < 0.5, yaws
    # FollowPath names why: INVALID_PATH, UNKNOWN. NavigateToPose has no numbers of its own there.
    assert [(int(line[1]), int(line[2])) for line in outcomes[3:]] == [
        (ABORTED, 103),
        (ABORTED, 100),
    ]
