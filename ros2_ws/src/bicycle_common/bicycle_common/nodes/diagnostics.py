"""Diagnostics in REP-107's form: `node: subject`, a level, one line, named values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from statistics import quantiles

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


def status(
    name: str, level: bytes, message: str, values: Mapping[str, object]
) -> DiagnosticStatus:
    """Return one entry of a DiagnosticArray; floats are shown with six digits."""
    return DiagnosticStatus(
        level=level,
        name=name,
        message=message,
        hardware_id="simulated bicycle",
        values=[KeyValue(key=str(key), value=_shown(value)) for key, value in values.items()],
    )


def entries_of(namespace: str, array: DiagnosticArray) -> list[DiagnosticStatus]:
    """Return the entries of nodes in a namespace: all bicycles of a domain share the topic."""
    own = namespace.strip("/")
    return [
        entry
        for entry in array.status
        if entry.name.partition(": ")[0].rpartition("/")[0].lstrip("/") == own
    ]


def percentiles(samples: list[float], name: str) -> dict[str, float]:
    """Return median and 99th percentile of samples in s, under `name`, in ms; empty for none."""
    finite = [1e3 * value for value in samples if math.isfinite(value)]
    if not finite:
        return {}
    # Not numpy's: its first call loads masked arrays and blocks the loop for 0.1 s.
    cuts = quantiles(finite if len(finite) > 1 else 2 * finite, n=100, method="inclusive")
    return {f"{name} p50 (ms)": cuts[49], f"{name} p99 (ms)": cuts[98]}


def _shown(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
