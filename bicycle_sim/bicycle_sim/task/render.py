"""A picture of one bicycle from behind, drawn with matplotlib and without a display.

The world's axes are x and y on the ground and z up, m. A point of the bicycle is given by how far
it lies ahead of the rear contact, to the left, and above the ground when upright.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from bicycle_sim.task.scene import Scene

WIDTH, HEIGHT, DPI = 640, 480, 100
"""Pixels across and down, and pixels per inch."""

FOCUS = 1.3
"""Focal length in heights of the picture."""

BEHIND, ASIDE, ABOVE = 4.2, 1.6, 1.9
"""m from the bicycle to the camera."""

NEAREST = 0.2
"""m: what is nearer to the camera is not drawn."""

TRAIL = 400
"""States that the trail goes back."""

SKY, GROUND, GRID, INK = "#dfe9f3", "#e9ede3", "#c6cdbb", "#1f2933"
FRAME, TYRE, RIDER, TRACK, GOAL = "#c0392b", "#1f2933", "#3a5ba0", "#7b8794", "#0b8457"

Point = tuple[float, float, float]
"""Ahead, to the left, up; m."""


@dataclass
class Renderer:
    """Draw scenes one after the other; the track behind the bicycle is remembered."""

    trail: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=TRAIL))

    def clear(self) -> None:
        """Forget the track, where an episode begins."""
        self.trail.clear()

    def draw(self, scene: Scene) -> np.ndarray:
        """Return the picture, (480, 640, 3) uint8."""
        self.trail.append(scene.rear)
        figure = Figure(figsize=(WIDTH / DPI, HEIGHT / DPI), dpi=DPI)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        half = 0.5 * WIDTH / HEIGHT
        axes.set(xlim=(-half, half), ylim=(-0.5, 0.5))
        axes.set_axis_off()
        view = _View.of(scene)
        _ground(axes, view)
        _goal(axes, view, scene)
        _line(axes, view, [(x, y, 0.0) for x, y in self.trail], TRACK, 2.0, 0)
        _bicycle(axes, view, scene)
        _caption(axes, half, scene)
        canvas.draw()  # type: ignore[no-untyped-call]
        pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        return pixels[:, :, :3].copy()


@dataclass(frozen=True)
class _View:
    """The camera, and the bicycle's axes."""

    eye: np.ndarray
    axes: np.ndarray
    """(3, 3) rows: right, up, into the picture."""
    origin: np.ndarray
    """Rear contact."""
    ahead: np.ndarray
    left: np.ndarray
    up: np.ndarray

    @classmethod
    def of(cls, scene: Scene) -> _View:
        """Look at the bicycle from behind, a little from its right."""
        rear, front = np.array([*scene.rear, 0.0]), np.array([*scene.front, 0.0])
        ahead = (front - rear) / max(float(np.linalg.norm(front - rear)), 1e-9)
        level, high = np.array([-ahead[1], ahead[0], 0.0]), np.array([0.0, 0.0, 1.0])
        lean = scene.lean_angle
        left = level * math.cos(lean) - high * math.sin(lean)
        up = high * math.cos(lean) + level * math.sin(lean)
        middle = 0.5 * (rear + front) + 0.75 * high
        eye = middle - BEHIND * ahead - ASIDE * level + (ABOVE - 0.75) * high
        into = (middle - eye) / np.linalg.norm(middle - eye)
        right = np.cross(into, high)
        right /= np.linalg.norm(right)
        return cls(eye, np.stack([right, np.cross(right, into), into]), rear, ahead, left, up)

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return places in the picture, (n, 2), and depths, (n,) m, of (n, 3) points."""
        seen = (points - self.eye) @ self.axes.T
        depth = np.maximum(seen[:, 2], NEAREST)
        return FOCUS * seen[:, :2] / depth[:, None], seen[:, 2]

    def body(self, points: Sequence[Point]) -> np.ndarray:
        """Return (n, 3) points of the world from points of the bicycle."""
        a = np.asarray(points, dtype=float)
        return self.origin + a[:, :1] * self.ahead + a[:, 1:2] * self.left + a[:, 2:] * self.up


def _line(
    axes: Axes,
    view: _View,
    points: Sequence[Point] | np.ndarray,
    colour: str,
    width: float,
    order: float,
) -> None:
    """Draw a line through points of the world, `width` px wide at 5 m; later orders lie above."""
    world = np.asarray(points, dtype=float)
    if len(world) < 2:
        return
    flat, depth = view.project(world)
    pieces = np.stack([flat[:-1], flat[1:]], axis=1)
    near = (depth[:-1] > NEAREST) & (depth[1:] > NEAREST)
    widths = np.clip(width * 5.0 / np.maximum(depth[:-1], NEAREST), 0.3, 14.0)
    lines = LineCollection(
        list(pieces[near]),
        colors=colour,
        linewidths=widths[near] * 72 / DPI,
        capstyle="round",
        zorder=10 + order,
    )
    axes.add_collection(lines)


def _ground(axes: Axes, view: _View) -> None:
    """Draw the sky, the ground, and a grid of 2 m around the bicycle."""
    pitch = math.asin(float(np.clip(view.axes[2, 2], -1.0, 1.0)))
    horizon = -FOCUS * math.tan(pitch)
    for low, high, colour in ((horizon, 1.0, SKY), (-1.0, horizon, GROUND)):
        axes.axhspan(low, high, color=colour, zorder=0)
    reach = np.linspace(-40.0, 40.0, 41)
    one, other = np.meshgrid(reach, reach, indexing="ij")
    middle = 2.0 * np.round(view.origin[:2] / 2.0)
    pieces = []
    for x, y in ((one, other), (other, one)):
        points = np.stack([x + middle[0], y + middle[1], np.zeros_like(x)], axis=-1)
        flat, depth = view.project(points.reshape(-1, 3))
        lines, far = flat.reshape(41, 41, 2), (depth > NEAREST).reshape(41, 41)
        segments = np.stack([lines[:, :-1], lines[:, 1:]], axis=2)
        pieces.append(segments[far[:, :-1] & far[:, 1:]])
    grid = LineCollection(list(np.concatenate(pieces)), colors=GRID, linewidths=0.8, zorder=5)
    axes.add_collection(grid)


def _goal(axes: Axes, view: _View, scene: Scene) -> None:
    """Draw the goal's circle on the ground, and a pole that is seen from afar."""
    angle = np.linspace(0.0, 2.0 * math.pi, 49)
    ring = np.zeros((49, 3))
    ring[:, 0] = scene.goal[0] + scene.goal_radius * np.cos(angle)
    ring[:, 1] = scene.goal[1] + scene.goal_radius * np.sin(angle)
    flat, depth = view.project(ring)
    if (depth > NEAREST).all():
        disc = PolyCollection([flat], facecolors=GOAL, alpha=0.25, zorder=6)
        axes.add_collection(disc)
    _line(axes, view, ring, GOAL, 3.0, -2)
    pole = [(*scene.goal, 0.0), (*scene.goal, 2.5)]
    _line(axes, view, pole, GOAL, 4.0, -1)


def _wheel(
    view: _View, hub: np.ndarray, along: np.ndarray, up: np.ndarray, radius: float
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the rim, (33, 3), and the spokes of a wheel."""
    angle = np.linspace(0.0, 2.0 * math.pi, 33)[:, None]
    rim = hub + radius * (np.cos(angle) * along + np.sin(angle) * up)
    return rim, [np.stack([hub, rim[index]]) for index in range(0, 32, 4)]


def _bicycle(axes: Axes, view: _View, scene: Scene) -> None:
    """Draw wheels, frame, fork and rider; what lies further ahead first."""
    base = float(np.hypot(scene.front[0] - scene.rear[0], scene.front[1] - scene.rear[1]))
    r = scene.wheel_radius
    turned = view.ahead * math.cos(scene.steer_angle) + view.left * math.sin(scene.steer_angle)
    side = view.left * math.cos(scene.steer_angle) - view.ahead * math.sin(scene.steer_angle)
    saddle, pedals, head = (0.22, 0.0, 0.98), (0.42, 0.0, 0.28), (base - 0.16, 0.0, 0.92)
    hips, shoulders, face = (0.24, 0.0, 1.06), (0.52, 0.0, 1.46), (0.60, 0.0, 1.66)
    hubs = view.body([(0.0, 0.0, r), (base, 0.0, r)])
    top = view.body([head])[0]
    grips = [top + 0.06 * turned + sign * 0.26 * side for sign in (-1.0, 1.0)]
    shadow = view.body([(0.0, 0.0, 0.0), saddle, shoulders, head, (base, 0.0, 0.0)])
    shadow[:, 2] = 0.0
    flat, _ = view.project(shadow)
    axes.add_collection(PolyCollection([flat], facecolors=INK, alpha=0.15, zorder=9))
    for order, hub, along in ((0, hubs[1], turned), (2, hubs[0], view.ahead)):
        rim, spokes = _wheel(view, hub, along, view.up, r)
        for spoke in spokes:
            _line(axes, view, spoke, TRACK, 0.8, order)
        _line(axes, view, rim, TYRE, 4.0, order)
    _line(axes, view, np.stack([hubs[1], top]), INK, 4.0, 1)
    _line(axes, view, np.stack([grips[0], top, grips[1]]), INK, 4.0, 1)
    tubes = ((saddle, head), (saddle, pedals), (pedals, head), (pedals, (0.0, 0.0, r)))
    for tube in (*tubes, (saddle, (0.0, 0.0, r))):
        _line(axes, view, view.body(tube), FRAME, 4.5, 3)
    for sign, crank in ((-1.0, 0.09), (1.0, -0.09)):
        foot = (pedals[0] + crank, sign * 0.12, pedals[2] + 0.04 + 0.5 * crank)
        knee = (0.58, sign * 0.10, 0.76 + 0.6 * crank)
        _line(axes, view, view.body([(hips[0], sign * 0.08, hips[2]), knee, foot]), RIDER, 9.0, 4)
        shoulder = view.body([(shoulders[0], sign * 0.18, shoulders[2])])[0]
        _line(axes, view, np.stack([shoulder, grips[int(sign > 0)]]), RIDER, 6.0, 4)
    wide = [(shoulders[0], -0.18, shoulders[2]), (shoulders[0], 0.18, shoulders[2])]
    _line(axes, view, view.body(wide), RIDER, 9.0, 5)
    _line(axes, view, view.body([hips, shoulders]), RIDER, 18.0, 5)
    _line(axes, view, view.body([face, (face[0], 0.0, face[2] + 0.02)]), "#e0b089", 20.0, 6)


def _caption(axes: Axes, half: float, scene: Scene) -> None:
    """Write speed, lean and what is left to the goal."""
    left = math.hypot(scene.goal[0] - scene.rear[0], scene.goal[1] - scene.rear[1])
    words = (
        f"{scene.speed:.1f} m/s   lean {math.degrees(scene.lean_angle):+.0f}°   "
        f"goal {left:.0f} m" + ("   fallen" if scene.fallen else "")
    )
    axes.text(-half + 0.02, 0.46, words, color=INK, fontsize=10, va="top", zorder=99)
