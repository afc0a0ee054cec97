"""Settings of hypothesis for machines with other work."""

from __future__ import annotations

from hypothesis import HealthCheck, settings

UNHURRIED = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
"""Without limits on wall-clock time, which a busy machine exceeds without a fault."""
