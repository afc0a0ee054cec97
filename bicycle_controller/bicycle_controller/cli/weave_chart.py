"""Chart of an identification: the weave over speed, before and after, beside what was measured."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from bicycle_common.plot_style import FAINT, INK
from bicycle_controller.identification.identify import Identified
from bicycle_controller.identification.ride_model import matrices, weave
from bicycle_controller.reproduce.style import STYLE

POINTS = 121
FOUND, HELD = "#3a5ba0", "#e08e0b"


def draw(found: Identified, path: Path) -> None:
    """Write the chart.

    The curves are under the logs' law where they follow one, else of a free handlebar.

    Raises:
        ValueError: on a suffix that matplotlib does not support.
    """
    laws = [law for law in found.laws if law is not None]
    slope, constant = 0.0, 0.0
    if len(laws) == len(found.laws):
        seen = [mode for mode in found.modes if mode.gain]
        speeds = np.array([mode.speed for mode in seen])
        gains = np.array([mode.gain for mode in seen])
        if np.ptp(speeds) > 0.3:
            slope, constant = (float(value) for value in np.polyfit(speeds, gains, 1))
        else:
            constant, slope = (float(value) for value in np.mean(laws, axis=0))
    held = [one for one, _ in found.held_out_modes]
    points = [mode.speed for mode in found.modes] + [one.speed for one in held]
    axis = np.linspace(max(0.5, 0.8 * min(points)), 1.1 * max(points), POINTS)
    before = found.fit.unknowns.parameters(np.zeros(len(found.fit.x)))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7.0, 5.2), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True)
        for p, colour, style, label in (
            (before, FAINT, "--", "before"),
            (found.parameters, FOUND, "-", "identified"),
        ):
            m = matrices(p)
            modes = np.array([weave(p, m, v, constant + slope * v) for v in axis])
            upper.plot(axis, modes.imag, style, color=colour, label=label)
            lower.plot(axis, modes.real, style, color=colour, label=label)
        for several, colour, label in (
            (found.measured, FOUND, "after pushes, fitted"),
            (held, HELD, "after pushes, held out"),
        ):
            if not several or not laws:
                continue
            speed, omega, sigma, omega_error, sigma_error = (
                [getattr(one, key) for one in several]
                for key in ("speed", "omega", "sigma", "omega_error", "sigma_error")
            )
            upper.errorbar(speed, omega, omega_error, fmt="o", color=colour, label=label)
            lower.errorbar(speed, sigma, sigma_error, fmt="o", color=colour, label=label)
        lower.axhline(0.0, color=INK, linewidth=0.8)
        upper.set_ylabel("weave, rad/s")
        lower.set_ylabel("real part, 1/s")
        lower.set_xlabel("speed, m/s")
        upper.legend()
        figure.savefig(path, dpi=120)
