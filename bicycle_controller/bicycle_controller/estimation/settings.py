"""Settings of the filter, beside the sensors' own figures; those of earlier estimators, too."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FilterSettings:
    """Process noise, and what is believed at the start."""

    roll_noise: float = 0.1
    """rad/s^2 per root Hz: what the model does not know."""
    gust_force: float = 3.0
    """N, standard deviation of the wind's push from the side, at the height of the mass."""
    gust_time: float = 1.5
    """s that a gust lasts."""
    torque_noise: float = 0.15
    """N m per root Hz on the steering: friction, and torque that is not reported."""
    speed_noise: float = 0.7
    """m/s^2 per root Hz."""
    model_force: float = 0.4
    """m/s^2, standard deviation of the lateral force's model beside the sensor's noise."""
    model_turn: float = 0.02
    """rad/s, standard deviation of the yaw rate's model beside the gyro's noise."""
    rest_lean: float = 0.5
    """Degrees, how far from upright the bicycle may be held at rest (standard deviation)."""
    launch_lean: float = 1.5
    """Degrees, standard deviation of the additional lean when the bicycle is let go."""
    steer_offset: float = 0.01
    """rad, of the steer encoder's zero."""
    offset_walk: float = 1e-4
    """rad per root s, of that zero."""
    course_noise: float = 0.02
    """rad per root s, of the heading beside the yaw rate's."""
    rest_speed: float = 0.15
    """m/s of the wheel below which the bicycle may be at rest."""
    rest_turn: float = 0.15
    """Turn rate beyond the bias above which the bicycle is not at rest, rad/s."""
    gate: float = 5.0
    """Standard deviations beyond which a force or a fix is not believed."""
    ignores_stuck: bool = True
    """False believes readings of a sensor that is stuck: a stuck gyro fells a bicycle."""


ESTIMATOR = 3
"""Number of today's estimator, which a bag tells."""


def of_estimator(number: int) -> FilterSettings:
    """Return the settings that an estimator had.

    The first knew no wind, and took it for lean; the first two believed sensors that were stuck.

    Raises:
        ValueError: on an estimator that is not known.
    """
    if number == 1:
        return FilterSettings(gust_force=0.0, ignores_stuck=False)
    if number == 2:
        return FilterSettings(ignores_stuck=False)
    if number != ESTIMATOR:
        raise ValueError(f"estimator {number} is not known here: update the software")
    return FilterSettings()
