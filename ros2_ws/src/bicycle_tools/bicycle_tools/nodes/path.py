"""`path.sh`: follow a course, and report its progress."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_tools.nodes.path")

import sys
from pathlib import Path
from typing import Any

import rclpy
from tqdm import tqdm

from bicycle_common.command_line import OneLineParser
from bicycle_common.nodes.runner import start_tool
from bicycle_controller.control import courses
from bicycle_controller.control.guide import PathEnd
from bicycle_tools.nodes.commander import BicycleCommander, CommanderError

STATUS = {PathEnd.FINISHED: 0, PathEnd.REJECTED: 2, PathEnd.FALLEN: 3}
"""Exit status by the path's end; 4 for any other."""


def main() -> int:
    """Follow the course of the command line; return the exit status."""
    parser = OneLineParser(prog="path.sh", add_help=False)
    add = parser.add_argument
    add("course")
    add("--laps", type=int, default=0)
    add("--speed", type=float, default=0.0)
    add("--namespace", default="")
    given, ros = parser.parse_with_ros(sys.argv[1:])
    try:
        courses.load(given.course)
    except ValueError as error:
        parser.error(str(error))
    if not 0 <= given.laps <= courses.MOST_LAPS or not 0.0 <= given.speed <= courses.FASTEST:
        parser.error(f"choose up to {courses.MOST_LAPS} laps and up to {courses.FASTEST:g} m/s")
    name = given.course
    if Path(name).suffix in courses.SUFFIXES:
        name = str(Path(name).resolve())
    if given.namespace:
        ros = [*(ros or ["--ros-args"]), "-r", f"__ns:={given.namespace}"]
    start_tool("path.sh", ros)
    bar = tqdm(disable=None, bar_format="{desc} {elapsed}")

    def show(feedback: Any) -> None:
        far = f"{feedback.along:.0f} of {feedback.length:.0f} m"
        bar.set_description_str(f"{far}, {feedback.cross_track:+.2f} m beside")

    try:
        with BicycleCommander(context=rclpy.get_default_context()) as bicycle:
            bicycle.follow_course(name, given.laps, given.speed)
            outcome = bicycle.wait(show)
    except CommanderError as error:
        print(f"path.sh: {error}", file=sys.stderr)
        return 4
    except KeyboardInterrupt:
        return 130
    finally:
        bar.close()
        rclpy.try_shutdown()
    end = PathEnd(outcome.result.status)
    print(f"{end.name.lower()}: {outcome.message}")
    return STATUS.get(end, 4)
