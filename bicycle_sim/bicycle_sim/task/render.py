"""A picture of one bicycle from behind, drawn with matplotlib and without a display.

Camera, colours and shapes are those of the cockpit's 3D page, which needs a browser: a bicycle
with spokes, a rider who pedals by the way that was ridden, a flag at the goal, a fading trail.

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

FOCUS = 0.5 / math.tan(math.radians(23.0))
"""Focal length in heights of the picture: a camera of 46 degrees."""

BEHIND, ASIDE, ABOVE = 3.6, -0.9, 1.85
"""m from the middle of the bicycle to the camera, to its right, and above the ground."""

AHEAD, HIGH = 1.1, 0.85
"""m ahead of the middle and above the ground: what it looks at."""

NEAREST = 0.2
"""Distance from the camera (m) below which nothing is drawn."""

TRAIL = 400
"""States that the trail goes back."""

SKY, GROUND, GRID, EDGE, INK = "#dfe9f1", "#cfd3c4", "#bec3b2", "#9fa693", "#1d2126"
FRAME, METAL, TYRE, RIM, DARK = "#b3261e", "#b9bec4", "#1b1d20", "#3b4046", "#22262b"
JERSEY, SHORTS, SKIN, SHOE, HELMET = "#2563a8", "#2a2f36", "#c98f6b", "#e8e8e4", "#f2f2ee"
TRACK, GOAL, POST = "#2563a8", "#1b7f4b", "#d8d8d4"
"""Colours of the cockpit's page, in daylight."""

CRANK = 0.17
"""m, length of a crank."""
RATIO = 0.5
"""Turns of the crank in one of the rear wheel."""
THIGH, SHANK, UPPER_ARM, FOREARM = 0.43, 0.45, 0.31, 0.29
"""m, lengths of the rider's limbs."""

Point = tuple[float, float, float]
"""Ahead, to the left, up; m."""


@dataclass
class Renderer:
    """Draw scenes one after the other; the track behind the bicycle is remembered."""

    trail: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=TRAIL))
    way: float = 0.0
    """m ridden, by which wheels and crank have turned."""

    def clear(self) -> None:
        """Forget the track, where an episode begins."""
        self.trail.clear()
        self.way = 0.0

    def draw(self, scene: Scene) -> np.ndarray:
        """Return the picture, (480, 640, 3) uint8."""
        if self.trail:
            self.way += math.dist(self.trail[-1], scene.rear)
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
        _line(axes, view, [(x, y, 0.0) for x, y in self.trail], TRACK, 0.09, 0, fades=True)
        _bicycle(axes, view, scene, self.way)
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
        """Look at the bicycle from behind, a little from its left."""
        rear, front = np.array([*scene.rear, 0.0]), np.array([*scene.front, 0.0])
        ahead = (front - rear) / max(float(np.linalg.norm(front - rear)), 1e-9)
        level, high = np.array([-ahead[1], ahead[0], 0.0]), np.array([0.0, 0.0, 1.0])
        lean = scene.lean_angle
        left = level * math.cos(lean) - high * math.sin(lean)
        up = high * math.cos(lean) + level * math.sin(lean)
        middle = 0.5 * (rear + front)
        eye = middle - BEHIND * ahead - ASIDE * level + ABOVE * high
        aim = middle + AHEAD * ahead + HIGH * high
        into = (aim - eye) / np.linalg.norm(aim - eye)
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
    fades: bool = False,
) -> None:
    """Draw a line through points of the world.

    Args:
        axes: the picture's axes.
        view: the camera.
        points: of the world, m.
        colour: the line's colour.
        width: m.
        order: later ones lie above.
        fades: whether it is fainter towards its first point.
    """
    world = np.asarray(points, dtype=float)
    if len(world) < 2:
        return
    flat, depth = view.project(world)
    pieces = np.stack([flat[:-1], flat[1:]], axis=1)
    near = (depth[:-1] > NEAREST) & (depth[1:] > NEAREST)
    middle = 0.5 * (depth[:-1] + depth[1:])
    widths = np.maximum(HEIGHT * FOCUS * width / np.maximum(middle, NEAREST), 0.4)
    lines = LineCollection(
        list(pieces[near]),
        colors=colour,
        linewidths=widths[near] * 72 / DPI,
        capstyle="butt" if fades else "round",
        zorder=10 + order,
        alpha=list(np.linspace(0.05, 0.9, len(near))[near]) if fades else None,
    )
    axes.add_collection(lines)


def _ground(axes: Axes, view: _View) -> None:
    """Draw the sky, the ground, and a grid of 1 m around the bicycle, each tenth line darker."""
    pitch = math.asin(float(np.clip(view.axes[2, 2], -1.0, 1.0)))
    horizon = -FOCUS * math.tan(pitch)
    for low, high, colour in ((horizon, 1.0, SKY), (-1.0, horizon, GROUND)):
        axes.axhspan(low, high, color=colour, zorder=0)
    reach = np.arange(-30.0, 31.0)
    middle = np.round(view.origin[:2])
    for across in (0, 1):
        along = 1 - across
        ends = np.zeros((61, 61, 3))
        ends[..., across] = (reach + middle[across])[:, None]
        ends[..., along] = (reach + middle[along])[None, :]
        flat, depth = view.project(ends.reshape(-1, 3))
        lines, seen = flat.reshape(61, 61, 2), (depth > NEAREST).reshape(61, 61)
        both = seen[:, :-1] & seen[:, 1:]
        pieces = np.stack([lines[:, :-1], lines[:, 1:]], axis=2)
        dark = np.isclose((reach + middle[across]) % 10.0, 0.0)
        for which, colour, width in ((~dark, GRID, 0.7), (dark, EDGE, 1.1)):
            chosen = pieces[which][both[which]]
            grid = LineCollection(list(chosen), colors=colour, linewidths=width, zorder=5)
            axes.add_collection(grid)


def _goal(axes: Axes, view: _View, scene: Scene) -> None:
    """Draw the goal's circle on the ground, and a post with a flag."""
    angle = np.linspace(0.0, 2.0 * math.pi, 49)
    ring = np.zeros((49, 3))
    ring[:, 0] = scene.goal[0] + scene.goal_radius * np.cos(angle)
    ring[:, 1] = scene.goal[1] + scene.goal_radius * np.sin(angle)
    flat, depth = view.project(ring)
    if (depth > NEAREST).all():
        axes.add_collection(PolyCollection([flat], facecolors=GOAL, alpha=0.16, zorder=6))
    _line(axes, view, ring, GOAL, 0.08, -2)
    x, y = scene.goal
    _line(axes, view, [(x, y, 0.0), (x, y, 2.2)], POST, 0.04, -1)
    flag = np.array([(x, y, 2.18), (x + 0.6, y, 2.18), (x + 0.6, y, 1.82), (x, y, 1.82)])
    flat, depth = view.project(flag)
    if (depth > NEAREST).all():
        axes.add_collection(PolyCollection([flat], facecolors=GOAL, zorder=9))


def _wheel(
    axes: Axes,
    view: _View,
    hub: np.ndarray,
    along: np.ndarray,
    radius: float,
    turn: float,
    order: float,
) -> None:
    """Draw a wheel: spokes, rim and tyre."""
    angle = np.linspace(0.0, 2.0 * math.pi, 49)[:, None] - turn
    circle = np.cos(angle) * along + np.sin(angle) * view.up
    for index in range(0, 48, 3):
        _line(
            axes, view, np.stack([hub, hub + 0.92 * radius * circle[index]]), METAL, 0.004, order
        )
    _line(axes, view, hub + (radius - 0.045) * circle, RIM, 0.02, order + 0.1)
    _line(axes, view, hub + (radius - 0.02) * circle, TYRE, 0.04, order + 0.2)
    axle = np.stack([hub - 0.02 * along, hub + 0.02 * along])
    _line(axes, view, axle, METAL, 0.06, order + 0.3)


def _joint(
    start: np.ndarray, end: np.ndarray, first: float, second: float, way: np.ndarray
) -> np.ndarray:
    """Return where two limbs of some lengths (m) meet, bent towards `way`."""
    line = end - start
    far = min(float(np.linalg.norm(line)), 0.999 * (first + second))
    along = line / max(float(np.linalg.norm(line)), 1e-9)
    share = (first**2 - second**2 + far**2) / (2.0 * far)
    out = way - np.dot(way, along) * along
    out = out / max(float(np.linalg.norm(out)), 1e-9)
    joint: np.ndarray = start + share * along + math.sqrt(max(first**2 - share**2, 0.0)) * out
    return joint


def _bicycle(axes: Axes, view: _View, scene: Scene, way: float) -> None:
    """Draw wheels, frame, fork and rider; what lies further ahead first."""
    base = float(np.hypot(scene.front[0] - scene.rear[0], scene.front[1] - scene.rear[1]))
    r = scene.wheel_radius
    turned = view.ahead * math.cos(scene.steer_angle) + view.left * math.sin(scene.steer_angle)
    side = view.left * math.cos(scene.steer_angle) - view.ahead * math.sin(scene.steer_angle)
    bracket = (min(0.44, 0.42 * base), 0.0, 0.82 * r)
    seat = (bracket[0] - 0.2, 0.0, bracket[2] + 0.66)
    high, low = (base - 0.19, 0.0, seat[2] - 0.05), (base - 0.12, 0.0, seat[2] - 0.2)
    hubs = view.body([(0.0, 0.0, r), (base, 0.0, r)])
    top = view.body([(base - 0.21, 0.0, seat[2] + 0.04)])[0]
    grips = [top - 0.08 * turned + sign * 0.29 * side for sign in (-1.0, 1.0)]
    _shadow(axes, view, base, seat)
    turn = way / r
    _wheel(axes, view, hubs[1], turned, r, turn, 0)
    crown = view.body([low])[0]
    for sign in (-0.05, 0.05):
        _line(axes, view, np.stack([hubs[1] + sign * side, crown + sign * side]), FRAME, 0.026, 1)
    _line(axes, view, np.stack([crown, top]), METAL, 0.03, 1)
    _line(axes, view, np.stack([grips[0], top, grips[1]]), METAL, 0.024, 1)
    for grip, sign in zip(grips, (-1.0, 1.0), strict=True):
        _line(axes, view, np.stack([grip, grip - sign * 0.12 * side]), DARK, 0.034, 1.5)
    _wheel(axes, view, hubs[0], view.ahead, r, turn, 2)
    tubes = ((bracket, high), (bracket, low), (high, low), ((0.0, 0.0, r), bracket))
    for tube in (*tubes, ((bracket[0] - 0.16, 0.0, bracket[2] + 0.52), (0.0, 0.0, r))):
        _line(axes, view, view.body(tube), FRAME, 0.036, 3)
    _line(
        axes, view, view.body([(bracket[0] - 0.16, 0.0, bracket[2] + 0.52), high]), FRAME, 0.036, 3
    )
    _line(axes, view, view.body([bracket, seat]), FRAME, 0.034, 3)
    saddle = [(seat[0] - 0.1, 0.0, seat[2]), (seat[0] + 0.12, 0.0, seat[2])]
    _line(axes, view, view.body(saddle), DARK, 0.07, 3.5)
    _rider(axes, view, (bracket, seat), grips, RATIO * turn)


def _shadow(axes: Axes, view: _View, base: float, seat: Point) -> None:
    """Draw the bicycle's shadow on the ground."""
    angle = np.linspace(0.0, 2.0 * math.pi, 33)
    body = view.body([(0.5 * base, 0.0, seat[2] + 0.2)])[0]
    spot = np.zeros((33, 3))
    middle = 0.5 * (body + view.body([(0.5 * base, 0.0, 0.0)])[0])
    long, wide = (0.5 * base + 0.4) * np.cos(angle), 0.2 * np.sin(angle)
    spot[:, :2] = middle[:2] + long[:, None] * view.ahead[:2]
    spot[:, :2] += wide[:, None] * np.array([-view.ahead[1], view.ahead[0]])
    flat, _ = view.project(spot)
    axes.add_collection(PolyCollection([flat], facecolors=INK, alpha=0.16, zorder=8))


def _rider(
    axes: Axes,
    view: _View,
    places: tuple[Point, Point],
    grips: Sequence[np.ndarray],
    crank: float,
) -> None:
    """Draw legs on the pedals, body, arms on the grips, and a head with a helmet.

    Args:
        axes: the picture's axes.
        view: the camera, and the bicycle's axes.
        places: bottom bracket and seat, on the bicycle.
        grips: right and left one, in the world.
        crank: its turn, rad.
    """
    bracket, seat = places
    hips, chest = (seat[0] - 0.02, 0.0, seat[2] + 0.09), (seat[0] + 0.28, 0.0, seat[2] + 0.49)
    skull = (chest[0] + 0.13, 0.0, chest[2] + 0.24)
    hip, top = view.body([hips])[0], view.body([chest])[0]
    for sign in (-1.0, 1.0):
        across = sign * CRANK * math.cos(crank), -sign * CRANK * math.sin(crank)
        pedal = (bracket[0] + across[0], sign * 0.115, bracket[2] + across[1])
        arm = [(bracket[0], sign * 0.06, bracket[2]), (pedal[0], sign * 0.07, pedal[2])]
        _line(axes, view, view.body(arm), METAL, 0.022, 3.6)
        foot = view.body([pedal])[0]
        ankle = foot - 0.07 * view.ahead + 0.1 * view.up
        start = hip + sign * 0.09 * view.left
        bend = view.ahead + 0.25 * sign * view.left + 0.2 * view.up
        knee = _joint(start, ankle, THIGH, SHANK, bend)
        _line(
            axes,
            view,
            np.stack([foot - 0.05 * view.ahead, foot + 0.1 * view.ahead]),
            SHOE,
            0.08,
            4,
        )
        _line(axes, view, np.stack([knee, ankle]), SKIN, 0.095, 4.1)
        _line(axes, view, np.stack([start, knee]), SHORTS, 0.145, 4.2)
    for sign, grip in zip((-1.0, 1.0), grips, strict=True):
        shoulder = top + sign * 0.19 * view.left
        bend = -0.2 * view.ahead + 0.8 * sign * view.left - 0.6 * view.up
        elbow = _joint(shoulder, grip, UPPER_ARM, FOREARM, bend)
        _line(axes, view, np.stack([elbow, grip]), SKIN, 0.075, 4.3)
        _line(axes, view, np.stack([shoulder, elbow]), JERSEY, 0.1, 4.4)
    _line(axes, view, np.stack([top, view.body([skull])[0]]), SKIN, 0.1, 4.5)
    head = view.body([skull])[0]
    _line(axes, view, np.stack([head, head + 0.05 * view.up]), SKIN, 0.19, 4.6)
    crown = head + 0.075 * view.up
    _line(
        axes,
        view,
        np.stack([crown - 0.03 * view.ahead, crown + 0.04 * view.ahead]),
        HELMET,
        0.225,
        4.7,
    )
    wide = np.stack([top - 0.15 * view.left, top + 0.15 * view.left])
    _line(axes, view, wide, JERSEY, 0.19, 5)
    _line(axes, view, np.stack([hip, top]), JERSEY, 0.29, 5.1)
    _line(
        axes, view, np.stack([hip - 0.06 * view.left, hip + 0.06 * view.left]), SHORTS, 0.24, 5.2
    )


def _caption(axes: Axes, half: float, scene: Scene) -> None:
    """Write speed, lean and the distance left to the goal."""
    left = math.hypot(scene.goal[0] - scene.rear[0], scene.goal[1] - scene.rear[1])
    words = (
        f"{scene.speed:.1f} m/s   lean {math.degrees(scene.lean_angle):+.0f}°   "
        f"goal {left:.0f} m" + ("   fallen" if scene.fallen else "")
    )
    axes.text(-half + 0.02, 0.46, words, color=INK, fontsize=10, va="top", zorder=99)
