"""Keys in a terminal become cmd_vel, and the terminal is given back as it was."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import termios
from functools import partial

import pytest
from probe import Probe
from waiting import PATIENCE

from bicycle_common.nodes import topics

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("no_new_shared_memory")]

KEYS = (
    ("w", (3.25, 0.0)),
    ("a", (3.25, 0.05)),
    ("d", (3.25, 0.0)),
    ("d", (3.25, -0.05)),
    ("s", (3.0, -0.05)),
    (" ", (3.0, 0.0)),
    ("wwa", (3.5, 0.05)),
)
"""Keys in order, and the speed and yaw rate after each, m/s and rad/s."""


def asks_for(probe: Probe, wanted: tuple[float, float]) -> bool:
    """Return True if the newest cmd_vel is that one."""
    heard = probe[topics.CMD_VEL]
    return bool(heard) and (heard[-1].twist.linear.x, heard[-1].twist.angular.z) == wanted


def test_keys_steer_and_q_ends(ros_domain: int) -> None:
    screen, terminal = pty.openpty()
    before = termios.tcgetattr(terminal)
    command = [sys.executable, "-m", "bicycle_tools.nodes.teleop"]
    with subprocess.Popen(command, stdin=terminal, stdout=subprocess.DEVNULL) as teleop:
        probe = Probe(ros_domain, topics.CMD_VEL)
        try:
            probe.spin_until(partial(asks_for, probe, (3.0, 0.0)))
            for key, wanted in KEYS:
                os.write(screen, key.encode())
                probe.spin_until(partial(asks_for, probe, wanted))
            assert probe[topics.CMD_VEL][-1].header.frame_id == "base_link"
            os.write(screen, b"q")
            assert teleop.wait(PATIENCE) == 0
            assert termios.tcgetattr(terminal) == before
        finally:
            teleop.kill()
            probe.close()
            os.close(screen)
            os.close(terminal)
