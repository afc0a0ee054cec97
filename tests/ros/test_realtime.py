"""The loop's nodes ask for real-time priority, and ride on without it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from node_process import NodeProcess
from probe import Probe, goal

from bicycle_common.nodes.topics import GOAL_POSE, STATE
from bicycle_sim.nodes.sim_settings import SimSettings

pytestmark = pytest.mark.ros

Start = Callable[..., NodeProcess]
SIMULATOR = "bicycle_sim.nodes.sim_node"
CONTROLLER = "bicycle_controller.nodes.controller_node"
BENCH = "bicycle_hardware.nodes.bench_node"
ORDINARY = {(os.SCHED_OTHER, 0)}


def permitted() -> bool:
    """Return True if this user may have real-time priority."""
    child = os.fork()
    if child == 0:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
        except OSError:
            os._exit(1)
        os._exit(0)
    return os.waitpid(child, 0)[1] == 0


def schedules(process: int) -> set[tuple[int, int]]:
    """Policy and priority of each thread."""
    threads = [int(task.name) for task in Path(f"/proc/{process}/task").iterdir()]
    return {
        (os.sched_getscheduler(thread), os.sched_getparam(thread).sched_priority)
        for thread in threads
    }


def ride(probe: Probe) -> None:
    """Some steps towards a goal."""
    probe.say(GOAL_POSE, goal(9000.0, 0.0))
    probe.spin_until(lambda: probe[STATE] and probe[STATE][-1].step > 20)


@pytest.mark.skipif(not permitted(), reason="this user may not have real-time priority")
@pytest.mark.parametrize(("pace", "expected"), [("realtime", 7), ("lockstep", 0)])
def test_all_threads_have_the_priority_in_real_time_only(
    ros_domain: int, start_node: Start, pace: str, expected: int
) -> None:
    """In lock-step the loop may take a whole processor, and must leave it to others."""
    ours = ["--ros-args", "-p", "realtime_priority:=7", "-p"]
    probe = Probe(ros_domain, STATE)
    try:
        sim = start_node(SIMULATOR, [*ours, f"pace:={pace}"])
        controller = start_node(CONTROLLER, [*ours, "policy:=lqr"])
        ride(probe)
        wanted = {(os.SCHED_FIFO, expected)} if expected else ORDINARY
        assert schedules(sim.pid) == wanted
        assert schedules(controller.pid) == wanted
    finally:
        probe.close()


@pytest.mark.skipif(not permitted(), reason="this user may not have real-time priority")
@pytest.mark.parametrize(("pace", "expected"), [("realtime", 8), ("lockstep", 0)])
def test_a_simulated_microcontroller_goes_before_the_loop_s_nodes(
    start_node: Start, pace: str, expected: int
) -> None:
    words = ("realtime_priority:=7", f"pace:={pace}", "plant:=whipple", "sensors:=mpu6050")
    bench = start_node(BENCH, ["--ros-args", *(word for one in words for word in ("-p", one))])
    bench.wait_for_line("serial line is")
    children = Path(f"/proc/{bench.pid}/task/{bench.pid}/children").read_text().split()
    assert [schedules(int(child)) for child in children] == [
        {(os.SCHED_FIFO, expected)} if expected else ORDINARY
    ]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can take the permission from a node")
def test_without_permission_it_says_so_and_rides(ros_domain: int, start_node: Start) -> None:
    powerless = ["--bounding-set=-sys_nice", "--inh-caps=-sys_nice", sys.executable, "-m"]
    probe = Probe(ros_domain, STATE)
    try:
        nodes = [
            start_node("/usr/bin/setpriv", [*powerless, module])
            for module in (SIMULATOR, CONTROLLER)
        ]
        ride(probe)
        for node in nodes:
            node.wait_for_line("real-time priority 10 is not permitted.*ulimit -r")
            assert schedules(node.pid) == ORDINARY
    finally:
        probe.close()


def test_faster_than_real_time_it_asks_for_none() -> None:
    assert SimSettings(realtime_priority=7).loop_priority() == 7
    assert SimSettings(realtime_priority=7, real_time_factor=2.0).loop_priority() == 0
    assert SimSettings(realtime_priority=0).loop_priority() == 0


REPORT = """
import sys
from bicycle_common.nodes.diagnostics import percentiles
before = set(sys.modules)
found = percentiles([float("nan"), 0.001, 0.002, 0.004], "period")
assert set(sys.modules) == before, set(sys.modules) - before
print(*found.values())
"""


def test_a_report_from_within_the_loop_loads_nothing() -> None:
    """numpy's percentiles load numpy.ma, which once held up the 16th step of each ride."""
    done = subprocess.run([sys.executable, "-c", REPORT], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert [float(word) for word in done.stdout.split()] == pytest.approx([2.0, 3.96])
