"""A summary as one screen of text."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bicycle_tools.summary import Quantiles, RideSummary


def render(summary: RideSummary, events: Sequence[str] = ()) -> str:
    """Return the summary as text for the user, with the events of the processes."""
    lines = [*rows(summary), *(("event", event) for event in events)]
    width = max(len(name) for name, _ in lines)
    return "\n".join(f"  {name:<{width}}  {value}" for name, value in lines)


def rows(summary: RideSummary) -> list[tuple[str, str]]:
    """Return the summary as pairs of a name and a text."""
    return [*_ride_rows(summary), *_loop_rows(summary)]


def _ride_rows(summary: RideSummary) -> list[tuple[str, str]]:
    reached = f"{summary.reached} of {summary.goals} reached"
    others = {
        "missed": summary.missed,
        "given up": summary.given_up,
        "without an end in the bag": summary.open,
    }
    reached += "".join(f", {count} {name}" for name, count in others.items() if count)
    asked = [("goals", reached)] if summary.goals else []
    asked += [
        (f"course {one.name}".strip(), f"{one.status}: {one.message}") for one in summary.paths
    ]
    length = _known(summary.path_length, ".1f", " m")
    speed = _known(summary.mean_speed, ".2f", " m/s").replace("unknown", "an unknown speed")
    if math.isfinite(summary.path_ratio):
        length += f", {summary.path_ratio:.2f} × straight line"
    return [
        *(asked or [("goals", "none")]),
        ("falls", str(summary.falls)),
        ("time", f"{summary.ridden_time:.1f} s of simulated time at {speed}"),
        ("path", length),
        ("peak lean", _known(math.degrees(summary.peak_lean), ".1f", "°")),
        ("policy", ", ".join(summary.policies) or "none"),
    ]


def _loop_rows(summary: RideSummary) -> list[tuple[str, str]]:
    loop = summary.loop
    pace = "lock-step" if loop.lockstep else "real time"
    found = [("loop rate", f"{_number(loop.rate)} Hz, {pace}")]
    if not loop.lockstep:
        found.append(("jitter", _spread(loop.jitter)))
    found += [
        ("state to command", _spread(loop.latency)),
        (
            "steps",
            f"{loop.late_steps} late, {loop.dropped_steps} dropped, {loop.held_steps} under a "
            f"held command, {loop.zero_steps} without one",
        ),
        ("watchdog", _times(loop.watchdog_events)),
        ("bag", f"{summary.messages} messages, {loop.lost_steps} steps missing"),
    ]
    return found


def _spread(quantiles: Quantiles) -> str:
    if not math.isfinite(quantiles.p50):
        return "not measured"
    p50, p99, largest = (1e3 * x for x in (quantiles.p50, quantiles.p99, quantiles.largest))
    return f"p50 {p50:.2f} ms, p99 {p99:.2f} ms, largest {largest:.1f} ms"


def _known(value: float, form: str, unit: str) -> str:
    return f"{value:{form}}{unit}" if math.isfinite(value) else "unknown"


def _number(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "–"


def _times(count: int) -> str:
    return {0: "never", 1: "once"}.get(count, f"{count} times")
