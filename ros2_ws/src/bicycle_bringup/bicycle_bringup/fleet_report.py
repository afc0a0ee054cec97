"""Result of a fleet's ride: each bicycle's goals, the least distances, and the punctuality."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bicycle_common.origin import origin


@dataclass
class FleetMember:
    """Record of one bicycle of a fleet.

    Attributes:
        lateness: s after which steps began that were due.
        latency: s from publishing a state to receiving its command.
        late: steps that began later than half a period.
        dropped: whole periods that were skipped.
        track: when each state was sent, s by the machine's clock, and the rear contact then, m.
            A state that is read late is no later state.
    """

    name: str
    outcome: str = "not ended"
    finished: bool = False
    rms: float = math.nan
    largest: float = math.nan
    late: int = 0
    dropped: int = 0
    lateness: list[float] = field(default_factory=list)
    latency: list[float] = field(default_factory=list)
    track: list[tuple[float, float, float]] = field(default_factory=list)

    def facts(self) -> dict[str, Any]:
        """Return the keys of one bicycle in `fleet.json`."""
        return {
            "finished": self.finished,
            "outcome": self.outcome,
            "rms_m": _plain(self.rms),
            "largest_m": _plain(self.largest),
            "steps": len(self.lateness),
            "lateness_p99_ms": _p99(self.lateness),
            "latency_p99_ms": _p99(self.latency),
            "late_steps": self.late,
            "dropped_steps": self.dropped,
        }


def least_distance(one: FleetMember, other: FleetMember) -> float:
    """Return how near two bicycles came, m; infinite if they did not ride at the same time."""
    a, b = np.array(one.track).reshape(-1, 3), np.array(other.track).reshape(-1, 3)
    if not (len(a) and len(b)):
        return math.inf
    times = np.union1d(a[:, 0], b[:, 0])
    times = times[(times >= max(a[0, 0], b[0, 0])) & (times <= min(a[-1, 0], b[-1, 0]))]
    apart = [np.interp(times, *a[:, [0, i]].T) - np.interp(times, *b[:, [0, i]].T) for i in (1, 2)]
    return float(np.hypot(*apart).min(initial=math.inf))


def facts(riders: Sequence[FleetMember]) -> dict[str, Any]:
    """Return the content of `fleet.json`."""
    nearest = {
        (one.name, other.name): least_distance(one, other)
        for one, other in itertools.combinations(riders, 2)
    }
    pair = min(nearest, key=lambda key: nearest[key], default=None)
    every = [value for one in riders for value in one.lateness]
    answers = [value for one in riders for value in one.latency]
    return {
        **origin(),
        "bicycles": {one.name: one.facts() for one in riders},
        "finished": sum(one.finished for one in riders),
        "nearest_m": None if pair is None else _plain(nearest[pair]),
        "nearest_pair": None if pair is None else list(pair),
        "lateness_p99_ms": _p99(every),
        "latency_p99_ms": _p99(answers),
        "dropped_steps": sum(one.dropped for one in riders),
    }


def as_text(found: Mapping[str, Any]) -> str:
    """Return a table, one bicycle a line, and a line about all."""
    lines = [f"{'':6} {'off its route':>22} {'late p99':>10} {'answer p99':>11}  end"]
    for name, one in found["bicycles"].items():
        off = f"{_shown(one['rms_m'], 2)} rms, {_shown(one['largest_m'], 2)} m"
        lines.append(
            f"{name:6} {off:>22} {_shown(one['lateness_p99_ms'], 1):>7} ms "
            f"{_shown(one['latency_p99_ms'], 1):>8} ms  {one['outcome']}"
        )
    total = len(found["bicycles"])
    near = _shown(found["nearest_m"], 2)
    pair = " and ".join(found["nearest_pair"] or ())
    lines.append(
        f"{found['finished']} of {total} rode their routes to the end; nearest {near} m ({pair}); "
        f"steps late by {_shown(found['lateness_p99_ms'], 1)} ms (p99), answered after "
        f"{_shown(found['latency_p99_ms'], 1)} ms (p99), {found['dropped_steps']} dropped"
    )
    return "\n".join(lines)


def _p99(values: Sequence[float]) -> float | None:
    """Return the 99th percentile in ms; None without values."""
    good = [value for value in values if math.isfinite(value)]
    return 1e3 * float(np.quantile(good, 0.99)) if good else None


def _plain(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _shown(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"
