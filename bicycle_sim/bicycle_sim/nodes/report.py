"""Diagnostics as REP-107 wants them: `node: subject`, a level, one line, named values."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


def status(
    name: str, level: bytes, message: str, values: Mapping[str, object]
) -> DiagnosticStatus:
    """One entry of a DiagnosticArray; floats are shown with six digits."""
    return DiagnosticStatus(
        level=level,
        name=name,
        message=message,
        hardware_id="simulated bicycle",
        values=[KeyValue(key=str(key), value=_shown(value)) for key, value in values.items()],
    )


def percentiles(samples: list[float], name: str) -> dict[str, float]:
    """Median and 99th percentile of samples in s, under `name`, in ms; nothing without any."""
    finite = [value for value in samples if np.isfinite(value)]
    if not finite:
        return {}
    p50, p99 = np.percentile(finite, (50, 99)) * 1e3
    return {f"{name} p50 (ms)": float(p50), f"{name} p99 (ms)": float(p99)}


def _shown(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
