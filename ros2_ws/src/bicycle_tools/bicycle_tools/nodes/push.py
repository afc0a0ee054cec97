"""`push.sh`: a lateral push."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_tools.nodes.push")

import argparse
import sys

from bicycle_common.command_line import OneLineParser
from bicycle_common.nodes.topics import PUSH, STATE
from bicycle_tools.nodes.calling import LYING, PATIENCE, Caller, ToolError, run_tool

STRENGTH = 0.3
"""Default change of the lean rate (rad/s), equal to the cockpit's."""
FIRST_STATE = 1.0
"""Time to receive a state, to see if the bicycle lies (s); one comes at least every 0.1 s."""


def parse(arguments: list[str]) -> tuple[argparse.Namespace, list[str]]:
    """Read the command line; on an error end the program with status 2 and one line."""
    parser = OneLineParser(prog="push.sh", add_help=False)
    add = parser.add_argument
    add("side", choices=("left", "right"))
    add("strength", type=float, nargs="?", default=STRENGTH)
    add("--timeout", type=float, default=PATIENCE)
    given, ros = parser.parse_with_ros(arguments)
    if not 0.0 < given.strength < 1e6:
        parser.error(f"the strength is {given.strength}: give rad/s above 0")
    if not 0.0 < given.timeout < 1e6:
        parser.error(f"--timeout is {given.timeout}: choose a positive number of seconds")
    return given, ros


def push(caller: Caller, given: argparse.Namespace) -> int:
    """Push the bicycle; return the exit status.

    Raises:
        ToolError: if there is no simulator, it refuses, or the bicycle lies.
    """
    states: list[bool] = []
    caller.node.create_subscription(
        STATE.type, STATE.name, lambda state: states.append(state.fallen), 1
    )
    rate = given.strength if given.side == "right" else -given.strength
    request = PUSH.type.Request(lean_rate=float(rate))
    answer = caller.call(PUSH, request, given.timeout, "start sim.sh")
    if answer.success:
        print(answer.message)
        return 0
    caller.spin_until(lambda: states, FIRST_STATE)
    if states and states[-1]:
        raise ToolError(LYING, "the bicycle lies: reset.sh puts it up again")
    raise ToolError(2, answer.message)


def main() -> int:
    """Run the command line; return the exit status."""
    given, ros = parse(sys.argv[1:])
    return run_tool("push.sh", ros, lambda caller: push(caller, given))
