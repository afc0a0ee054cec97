"""`reset.sh`: a new episode, which also puts a fallen bicycle upright."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_tools.nodes.reset")

import argparse
import math
import sys

from bicycle_common.command_line import OneLineParser
from bicycle_common.nodes.convert import to_quaternion
from bicycle_common.nodes.topics import RESET
from bicycle_tools.nodes.calling import PATIENCE, Caller, ToolError, run_tool

SCENARIOS_SPEED, NEXT_SEED = -1.0, -1
"""Values in a reset request if the user chose no speed, or no seed."""


def parse(arguments: list[str]) -> tuple[argparse.Namespace, list[str]]:
    """Read the command line; on an error end the program with status 2 and one line."""
    parser = OneLineParser(prog="reset.sh", add_help=False)
    add = parser.add_argument
    for name in ("x", "y", "yaw"):
        add(name, type=float, nargs="?", default=0.0)
    add("--speed", type=float)
    add("--seed", type=int)
    add("--random", action="store_true")
    add("--timeout", type=float, default=PATIENCE)
    given, ros = parser.parse_with_ros(arguments)
    for name in ("x", "y", "yaw"):
        if not math.isfinite(getattr(given, name)):
            parser.error(f"{name} is {getattr(given, name)}: give a finite number")
    if given.speed is not None and not 0.0 <= given.speed < math.inf:
        parser.error(f"--speed is {given.speed}: give 0 or more m/s")
    if given.seed is not None and not 0 <= given.seed < 2**62:
        parser.error(f"--seed is {given.seed}: give a whole number from 0 on")
    if not 0.0 < given.timeout < 1e6:
        parser.error(f"--timeout is {given.timeout}: choose a positive number of seconds")
    if given.random and (given.x, given.y, given.yaw) != (0.0, 0.0, 0.0):
        parser.error("give a place or --random, not both")
    return given, ros


def reset(caller: Caller, given: argparse.Namespace) -> int:
    """Begin a new episode; return the exit status.

    Raises:
        ToolError: if there is no simulator, or it refuses.
    """
    request = RESET.type.Request(
        random_start=given.random,
        speed=SCENARIOS_SPEED if given.speed is None else given.speed,
        seed=NEXT_SEED if given.seed is None else given.seed,
    )
    request.pose.position.x, request.pose.position.y = given.x, given.y
    request.pose.orientation = to_quaternion(given.yaw)
    answer = caller.call(RESET, request, given.timeout, "start sim.sh")
    if not answer.success:
        raise ToolError(2, answer.message)
    print(answer.message)
    return 0


def main() -> int:
    """Run the command line; return the exit status."""
    given, ros = parse(sys.argv[1:])
    return run_tool("reset.sh", ros, lambda caller: reset(caller, given))
