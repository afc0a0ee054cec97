"""Settings of the filter, beside the sensors' own figures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FilterSettings:
    """Process noise, and what is believed at the start."""

    roll_noise: float = 0.1
    """rad/s^2 per root Hz: wind and what the model does not know."""
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
