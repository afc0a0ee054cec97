"""Routes of a fleet: half of the bicycles ride east, half north, and their routes cross.

Each route is a course file whose turns are drawn from a seed; see `bicycle_controller.control.
courses` for its keys.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bicycle_controller.control import courses

LANES = 18.0
"""m between neighbours that ride the same way."""
RUN_UP = 30.0
"""m that each rides before the first crossing."""


@dataclass(frozen=True)
class Route:
    """Start of one bicycle, and its course."""

    name: str
    """Namespace of the bicycle."""
    x: float
    """m, start."""
    y: float
    """m, start."""
    yaw: float
    """rad, at the start."""
    text: str
    """Course file, YAML."""

    def write(self, folder: Path, tightest: float = 0.0) -> Path:
        """Write the course file; return its path.

        Args:
            folder: exists.
            tightest: m, radius that the bicycle turns with; zero does not check.

        Raises:
            CourseError: if the route cannot be ridden.
        """
        file = folder / f"{self.name}.yaml"
        file.write_text(self.text)
        courses.load(str(file), tightest)
        return file


def routes(count: int, seed: int, speed: float = 3.0) -> list[Route]:
    """Return the routes of `count` bicycles, b1 and so on; `speed` in m/s."""
    rng = np.random.default_rng(seed)
    found = []
    for number in range(count):
        east, lane = number % 2 == 0, number // 2
        along, across = -RUN_UP - float(rng.uniform(0.0, 8.0)), LANES * lane
        x, y = (along, across) if east else (across, along)
        yaw = 0.0 if east else math.pi / 2
        length = 2.0 * RUN_UP + LANES * ((count + 1) // 2)
        text = _course(f"b{number + 1}", x, y, yaw, length, speed, rng)
        found.append(Route(f"b{number + 1}", x, y, yaw, text))
    return found


def _course(
    name: str,
    x: float,
    y: float,
    yaw: float,
    length: float,
    speed: float,
    rng: np.random.Generator,
) -> str:
    """Return a course file of straights, shifts and slaloms, about `length` m long."""
    lines = [
        f"about: route of {name}",
        f"start: [{x:.3f}, {y:.3f}, {math.degrees(yaw):.3f}]",
        f"speed: {speed:g}",
        "segments:",
    ]
    ridden, side = 0.0, 0.0
    while ridden < length:
        kind = rng.integers(3)
        if kind == 0:
            piece = float(rng.uniform(8.0, 20.0))
            lines.append(f"  - straight: {piece:.2f}")
        elif kind == 1:
            piece = float(rng.uniform(16.0, 24.0))
            across = float(rng.uniform(1.0, 2.5)) * (-1.0 if side > 0 else 1.0)
            side += across
            lines.append(f"  - shift: {{across: {across:.2f}, along: {piece:.2f}}}")
        else:
            wide = float(rng.uniform(-0.8, 0.8))
            piece = 40.0
            lines.append(f"  - slalom: {{amplitude: {wide:.2f}, period: 20, periods: 2}}")
        ridden += piece
    return "\n".join(lines) + "\n"
