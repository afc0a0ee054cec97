"""Comparison of a trained policy with the classical controller, on the training's starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bicycle_controller.config.run import RunConfig
from bicycle_controller.evaluation.score import Score, score

WORSE_SHARE = 0.01
"""Share of the rides by which goals may be fewer, or falls more, without a warning."""
SLOWER = 1.1
"""Ratio to the classical controller's median time above which a warning is given."""


def lqr_score(config: RunConfig) -> Score | None:
    """Score the LQR that uses the scenario's actions on a run's fixed starts.

    Args:
        config: the run's configuration.

    Returns:
        Its score over far goals; None if there is no LQR for that bicycle.
    """
    # Imported here: it needs scipy, which training does not.
    from bicycle_controller.control.lqr import fitting

    fixed = replace(config.evaluation, near_episodes=0, shake=0.0)
    try:
        controller = fitting(config.scenario.action_limits, config.physics)
        return score(controller, config.scenario, config.physics, fixed)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError):
        return None


def warning(best: Score, lqr: Score | None) -> str:
    """Return one line if a policy is clearly worse than the LQR; else an empty text.

    Args:
        best: score of the policy that a run has kept.
        lqr: score over the same starts; None without one.
    """
    if lqr is None or lqr.median_time_s is None:
        return ""
    slow = best.median_time_s is None or best.median_time_s > SLOWER * lqr.median_time_s
    fewer = best.reach_rate < lqr.reach_rate - WORSE_SHARE
    falls = best.fall_rate > lqr.fall_rate + WORSE_SHARE
    if not (slow or fewer or falls):
        return ""
    return (
        f"over the same starts the LQR reaches {_shown(lqr)}, this policy {_shown(best)}: "
        "train longer, or try another --seed"
    )


def _shown(found: Score) -> str:
    time = "" if found.median_time_s is None else f" in {found.median_time_s:.1f} s (median)"
    return f"{found.reach_rate:.1%} of its goals{time}, with {found.fall_rate:.1%} falls"
