"""Options of a ride: its command line, its folder and the commands of its nodes."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bicycle_common.command_line import OneLineParser
from bicycle_common.node_commands import (
    BENCH,
    CONFIGURED,
    MODULES,
    checked_parameter,
    config_folder,
    node_command,
    program,
)
from bicycle_common.types import Point2D
from bicycle_controller.control import courses
from bicycle_tools.course import random_goals

MOST_GOALS = 10_000
MOST_MINUTES = 10_000.0
"""Longest ride, minutes: a week."""


@dataclass(frozen=True)
class RideOptions:
    """Options of one ride."""

    goals: int
    minutes: float
    """Duration in simulated time; zero rides to `goals` goals instead."""
    seed: int
    field: float
    """Side of the square that contains the goals, m."""
    respawn: bool
    folder: Path
    """Folder of the run."""
    config: Path
    """Folder with one parameter file per node."""
    parameters: tuple[str, ...]
    """`NODE.name:=value`."""
    parameter_files: tuple[Path, ...]
    course: str = ""
    """Course to follow instead of goals: a name or a file."""
    laps: int = 0
    """Laps of a loop; zero takes the course's."""
    speed: float = 0.0
    """m/s on the course; zero takes the course's."""
    bench: bool = False
    """True to ride through a simulated microcontroller."""

    @property
    def modules(self) -> dict[str, str]:
        """Modules of the nodes, in start order."""
        return BENCH if self.bench else MODULES

    def draw_goals(self) -> list[Point2D]:
        """Return as many goals as requested, or more than the duration allows."""
        if self.course:
            return []
        count = 10 + round(60.0 * self.minutes) if self.minutes else self.goals
        rng = np.random.default_rng(self.seed)
        return random_goals(count, self.field, (0.0, 0.0), rng)

    def command(self, name: str) -> list[str]:
        """Return the command that starts one node.

        Args:
            name: a key of `modules`.
        """
        if name not in CONFIGURED:
            return [*program(name), "--output", str(self.folder / "bag")]
        parameters = list(self.parameters)
        if self.bench:
            port = str(self.folder / "board")
            parameters = [f"simulator.port:={port}", f"driver.port:={port}", *parameters]
        return node_command(name, self.config, parameters, self.parameter_files, self.modules)


def parse(arguments: Sequence[str], workspace: Path) -> RideOptions:
    """Read the command line; on an error end the program with status 2 and one line."""
    parser = OneLineParser(prog="ride.sh", add_help=False, allow_abbrev=False)
    add = parser.add_argument
    add("--goals", type=int, default=10)
    add("--minutes", type=float, default=0.0)
    add("--seed", type=int, default=0)
    add("--field", type=float, default=60.0)
    add("--course", default="")
    add("--laps", type=int, default=0)
    add("--speed", type=float, default=0.0)
    add("--output", type=Path)
    add("--no-respawn", action="store_true")
    add("--hardware-in-the-loop", action="store_true")
    add("rest", nargs="*")
    given = parser.parse_intermixed_args(arguments)
    try:
        return _checked(given, workspace)
    except ValueError as error:
        parser.error(str(error))


def _checked(given: argparse.Namespace, workspace: Path) -> RideOptions:
    """Return the options.

    Raises:
        ValueError: on a value out of range, an unknown node or a missing file.
    """
    if not 1 <= given.goals <= MOST_GOALS:
        raise ValueError(f"--goals is {given.goals}: choose 1 to {MOST_GOALS}")
    if not 0 <= given.minutes <= MOST_MINUTES:
        raise ValueError(f"--minutes is {given.minutes}: choose a number up to {MOST_MINUTES:g}")
    if given.seed < 0:
        raise ValueError(f"--seed is {given.seed}: choose zero or more")
    if not (math.isfinite(given.field) and 20.0 <= given.field <= 2000.0):
        raise ValueError(f"--field is {given.field}: choose 20 to 2000 m")
    parameters = [checked_parameter(word) for word in given.rest if ":=" in word]
    course = _course(given)
    if course:
        parameters = _suited(parameters, COURSE)
    if given.hardware_in_the_loop:
        parameters = _on_bench(parameters)
    elif any(word.startswith("driver.") for word in parameters):
        raise ValueError("parameters of the driver belong to --hardware-in-the-loop")
    files = [_file(word) for word in given.rest if ":=" not in word]
    return RideOptions(
        goals=given.goals,
        minutes=given.minutes,
        seed=given.seed,
        field=given.field,
        respawn=not given.no_respawn,
        folder=_new_folder(given.output, workspace),
        config=config_folder(),
        parameters=tuple(parameters),
        parameter_files=tuple(files),
        course=course,
        laps=given.laps,
        speed=given.speed,
        bench=given.hardware_in_the_loop,
    )


def _course(given: argparse.Namespace) -> str:
    """Return the course to follow; a file by its full path, for the controller.

    Raises:
        ValueError: on a course that cannot be read, or options that do not go with one.
    """
    if not given.course:
        if given.laps or given.speed:
            raise ValueError("--laps and --speed belong to --course")
        return ""
    if given.minutes:
        raise ValueError("--minutes does not go with --course: a course has an end")
    if not 0 <= given.laps <= courses.MOST_LAPS:
        raise ValueError(f"--laps is {given.laps}: choose 1 to {courses.MOST_LAPS}")
    if given.speed and not 1.0 <= given.speed <= courses.FASTEST:
        raise ValueError(f"--speed is {given.speed}: choose 1 to {courses.FASTEST:g} m/s")
    courses.load(given.course)
    if Path(given.course).suffix in courses.SUFFIXES:
        return str(Path(given.course).resolve())
    return str(given.course)


COURSE = {
    "simulator.scenario": "learned-speed",
    "simulator.start_speed": "3.0",
    "controller.policy": "lqr-pedal",
}
"""Parameters for a course: a scenario that has a pedal."""

ON_BENCH = {
    "simulator.plant": "whipple",
    "simulator.bicycle": "browser-rider",
    "simulator.sensors": "mpu6050-rtk",
    "simulator.pace": "lockstep",
    "controller.state": "estimated",
    "controller.policy": "lqr",
    "driver.clock": "board",
    "driver.arm_when_ready": "true",
}
"""Parameters for a ride through a simulated microcontroller."""

ALIKE = {
    **{f"driver.{name}": f"simulator.{name}" for name in ("bicycle", "scenario", "pace")},
    **{f"{node}.sensors": "simulator.sensors" for node in ("driver", "controller")},
    **{f"controller.start_{name}": f"simulator.start_{name}" for name in ("x", "y", "yaw")},
}
"""Parameters that are another node's, too."""


def _on_bench(parameters: list[str]) -> list[str]:
    """Return parameters of a ride through a microcontroller, whose nodes agree."""
    parameters = _suited(parameters, ON_BENCH)
    given = {name: value for name, _, value in (word.partition(":=") for word in parameters)}
    alike = {name: given[other] for name, other in ALIKE.items() if other in given}
    return _suited(parameters, alike)


def _suited(parameters: list[str], wanted: Mapping[str, str]) -> list[str]:
    """Return the given parameters, and the wanted ones that they do not name."""
    given = {word.partition(":=")[0] for word in parameters}
    return [
        *(f"{name}:={value}" for name, value in wanted.items() if name not in given),
        *parameters,
    ]


def _file(word: str) -> Path:
    path = Path(word)
    if path.suffix not in (".yaml", ".yml"):
        raise ValueError(f"unknown argument {word!r}")
    if not path.is_file():
        raise ValueError(f"there is no parameter file {word!r}")
    return path.resolve()


def _new_folder(asked: Path | None, workspace: Path) -> Path:
    """Create the run's folder: the requested one, or runs/<date>-<n>."""
    try:
        if asked is not None:
            asked.mkdir(parents=True)
            return asked.resolve()
        runs = workspace / "runs"
        runs.mkdir(exist_ok=True)
        day, number = time.strftime("%Y-%m-%d"), 1
        while True:
            folder = runs / f"{day}-{number}"
            try:
                folder.mkdir()
                return folder
            except FileExistsError:
                number += 1
    except FileExistsError:
        raise ValueError(f"{asked} exists: choose another --output, or remove it") from None
    except OSError as error:
        place = asked or workspace / "runs"
        raise ValueError(f"cannot make a folder in {place}: {error.strerror}") from None
