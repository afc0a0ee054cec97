"""`teleop.sh`: ride by the keyboard, by `cmd_vel`."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_tools.nodes.teleop")

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from dataclasses import dataclass, replace

import rclpy
from geometry_msgs.msg import TwistStamped
from rclpy.node import Node

from bicycle_common.command_line import OneLineParser
from bicycle_common.nodes import topics
from bicycle_common.nodes.runner import start_tool
from bicycle_common.nodes.topics import BASE_FRAME, advertise

PERIOD = 0.1
"""s between commands."""
FASTEST, TIGHTEST = 8.0, 1.0
"""m/s and rad/s, largest that keys ask for; the controller has limits of its own."""
HELP = "w faster, s slower, a left, d right, space straight on, q ends"


@dataclass(frozen=True)
class Wish:
    """Speed and yaw rate that the keys ask for."""

    speed: float = 3.0
    """m/s."""
    yaw_rate: float = 0.0
    """rad/s, positive to the left."""

    def pressed(self, key: str) -> Wish:
        """Return the wish after a key."""
        speed = {"w": 0.25, "s": -0.25}.get(key, 0.0) + self.speed
        turn = {"a": 0.05, "d": -0.05}.get(key, 0.0) + self.yaw_rate
        turn = 0.0 if key == " " else turn
        return replace(
            self,
            speed=min(max(speed, 0.0), FASTEST),
            yaw_rate=round(min(max(turn, -TIGHTEST), TIGHTEST), 6),
        )


@contextlib.contextmanager
def _raw(stream: int) -> Iterator[None]:
    """Let keys come one by one, and put the terminal back."""
    kept = termios.tcgetattr(stream)
    try:
        tty.setcbreak(stream)
        yield
    finally:
        termios.tcsetattr(stream, termios.TCSADRAIN, kept)


def ride(node: Node, stream: int) -> None:
    """Publish the commands that the keys ask for, until q."""
    publisher = advertise(node, topics.CMD_VEL)[topics.CMD_VEL.name]
    wish = Wish()
    print(HELP, flush=True)
    while True:
        ready, _, _ = select.select([stream], [], [], PERIOD)
        if ready:
            # Not sys.stdin: it would keep all but the first of the keys that came together.
            keys = os.read(stream, 64).decode(errors="ignore")
            if not keys or "q" in keys or "\x04" in keys:
                return
            for key in keys:
                wish = wish.pressed(key)
            print(f"\r{wish.speed:.2f} m/s, {wish.yaw_rate:+.2f} rad/s  ", end="", flush=True)
        message = TwistStamped()
        message.header.stamp = node.get_clock().now().to_msg()
        message.header.frame_id = BASE_FRAME
        message.twist.linear.x, message.twist.angular.z = wish.speed, wish.yaw_rate
        publisher.publish(message)


def main() -> int:
    """Ride by the keyboard; return the exit status."""
    parser = OneLineParser(prog="teleop.sh", add_help=False)
    _, ros = parser.parse_with_ros(sys.argv[1:])
    if not sys.stdin.isatty():
        print("teleop.sh: standard input is no terminal: run it in one", file=sys.stderr)
        return 2
    start_tool("teleop.sh", ros)
    node = Node("bicycle_teleop")
    try:
        with _raw(sys.stdin.fileno()):
            ride(node, sys.stdin.fileno())
    except KeyboardInterrupt:
        return 130
    finally:
        print()
        node.destroy_node()
        rclpy.try_shutdown()
    return 0
