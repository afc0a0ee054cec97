"""Constants of the bicycle (Table 1 of the paper) and its optional corrections.

Row numbers refer to the project's errata table, `docs/errata.md`.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, field, fields

from bicycle_common import json_input
from bicycle_common.validation import nearest, reject_unknown

MODES = ("faithful", "corrected")
"""Modes of the physics: as the paper's authors ran it, and with all corrections."""


@dataclass(frozen=True)
class Constants:
    """Table 1, in SI units, with values that the table omits (rows 11, 16, 17, 22).

    Raises:
        ValueError: if a constant is not a finite number above zero, or the handlebar could turn
            to an angle where a radius is zero.
    """

    gravity: float = 9.82
    """m/s^2 (g)."""
    front_to_mass: float = 0.66
    """Horizontal distance from the front contact to the common centre of mass, m (c)."""
    rider_above_mass: float = 0.30
    """Vertical distance between the bicycle's and the cyclist's centres of mass, m (d_CM)."""
    mass_height: float = 0.94
    """Height of the common centre of mass above the ground, m (h)."""
    wheelbase: float = 1.11
    """Distance between the two contacts, m (l)."""
    bicycle_mass: float = 15.0
    """kg (M_c)."""
    tyre_mass: float = 1.7
    """kg (M_d)."""
    cyclist_mass: float = 60.0
    """kg (M_p)."""
    tyre_radius: float = 0.34
    """m (r)."""
    time_step: float = 0.025
    """s (dt); 0.01 in Randlov & Alstrom (row 19)."""
    steer_stop: float = 1.3963
    """Angle at which the handlebar stops, rad, 80 degrees (row 22)."""
    wheelbase_tolerance: float = 0.01
    """Drift of the contacts, m, beyond which the rear one is corrected (row 4)."""
    pedal_crank: float = 0.136
    """m (R_1, row 16)."""
    chain_wheel: float = 0.068
    """m (R_2, row 16)."""
    sprocket: float = 0.034
    """m (R_3, row 16)."""
    drive_wheel: float = 0.34
    """m (R_4, row 16)."""

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not (isinstance(value, (int, float)) and math.isfinite(value) and value > 0):
                raise ValueError(f"{item.name} must be a finite number above zero, not {value!r}")
        if self.steer_stop >= math.pi / 2:
            raise ValueError(f"steer_stop must be below pi/2 rad, not {self.steer_stop!r}")

    @property
    def mass(self) -> float:
        """Mass of bicycle and cyclist, kg (M = M_c + M_p, row 11)."""
        return self.bicycle_mass + self.cyclist_mass

    @property
    def driven_mass(self) -> float:
        """Mass that the pedal accelerates, kg (denominator of eq. 12, row 17)."""
        return self.bicycle_mass + self.tyre_mass + self.cyclist_mass

    @property
    def lean_inertia(self) -> float:
        """kg m^2 about the ground line (I_bicycle, eq. 8 as printed, row 14)."""
        rider_height = self.mass_height + self.rider_above_mass
        frame = 13.0 / 3.0 * self.bicycle_mass * self.mass_height**2
        return frame + self.cyclist_mass * rider_height**2

    @property
    def tyre_spin_inertia(self) -> float:
        """kg m^2 of a tyre about its axle (I_dc)."""
        return self.tyre_mass * self.tyre_radius**2

    @property
    def tyre_lean_inertia(self) -> float:
        """kg m^2 (I_dv = 3/2 M_d r^2, row 12)."""
        return 1.5 * self.tyre_mass * self.tyre_radius**2

    @property
    def tyre_steer_inertia(self) -> float:
        """kg m^2 (I_dl = 1/2 M_d r^2)."""
        return 0.5 * self.tyre_mass * self.tyre_radius**2

    @property
    def pedal_gain(self) -> float:
        """Tyre force per pedal force (F_4 / F_1 = R_1 R_3 / (R_2 R_4), eq. 11)."""
        return self.pedal_crank * self.sprocket / (self.chain_wheel * self.drive_wheel)


@dataclass(frozen=True)
class Physics:
    """Simulated bicycle: the constants and the corrections, all off by default.

    Raises:
        ValueError: on a displacement noise that is negative or not finite, or an option that is
            neither true nor false.
    """

    constants: Constants = field(default_factory=Constants)
    chord_follows_steering: bool = False
    """Row 5: the chord's half angle takes the sign of the steering, not of the heading."""
    gyroscopic_correction: bool = False
    """Row 13: steering feels +I_dc sigma_dot omega_dot, which does no work, instead of -I_dv."""
    stop_absorbs_steering: bool = False
    """Row 22: the steering rate becomes zero at the stop instead of growing."""
    displacement_noise: float = 0.0
    """m, half width of uniform noise on the displacement (row 21; 0.02 in Randlov & Alstrom)."""

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(item.default, bool) and not isinstance(value, bool):
                raise ValueError(f"{item.name} must be true or false, not {value!r}")
        if not (math.isfinite(self.displacement_noise) and self.displacement_noise >= 0):
            raise ValueError(
                f"displacement_noise must be zero or more metres, not {self.displacement_noise!r}"
            )

    @classmethod
    def named(cls, mode: str) -> Physics:
        """Return the `faithful` mode (what the paper's authors ran) or the `corrected` one.

        Raises:
            ValueError: on any other name.
        """
        if mode == "faithful":
            return cls()
        if mode == "corrected":
            return cls(
                chord_follows_steering=True,
                gyroscopic_correction=True,
                stop_absorbs_steering=True,
            )
        hint = nearest(mode, MODES)
        raise ValueError(f"unknown physics {mode!r}{hint}: choose {' or '.join(MODES)}")

    def to_json(self) -> str:
        """Return everything as JSON; floats keep every bit."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Physics:
        """Return the physics that `to_json` wrote.

        Raises:
            ValueError: on other text, or on an unknown field.
        """
        data = json_input.parse(text)
        reject_unknown(cls, data)
        constants = data.pop("constants", {})
        reject_unknown(Constants, constants)
        return cls(constants=Constants(**constants), **data)
