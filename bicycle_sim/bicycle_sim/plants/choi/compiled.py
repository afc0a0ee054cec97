"""Numbers of the paper's bicycle for its compiled step, `step.h`."""

from __future__ import annotations

import ctypes

from bicycle_sim.plants.choi.parameters import Physics

NAMES = (
    *("time_step", "pedal", "mass_height", "tyre_radius", "tyre_spin", "wheelbase"),
    *("mass_offset", "tyres", "turning", "gravity", "lean_inertia", "coupling"),
    *("steer_inertia", "steer_stop", "drift"),
)
SWITCHES = ("chord_follows_steering", "stop_absorbs_steering")


class Numbers(ctypes.Structure):
    """`Numbers` of step.h."""

    _fields_ = (
        *((name, ctypes.c_double) for name in NAMES),
        *((name, ctypes.c_int64) for name in SWITCHES),
    )


def numbers(physics: Physics) -> Numbers:
    """Return the numbers, computed as in `dynamics`."""
    k = physics.constants
    gyroscopic = physics.gyroscopic_correction
    return Numbers(
        time_step=k.time_step,
        pedal=k.pedal_gain / k.driven_mass,
        mass_height=k.mass_height,
        tyre_radius=k.tyre_radius,
        tyre_spin=k.tyre_spin_inertia,
        wheelbase=k.wheelbase,
        mass_offset=k.wheelbase - k.front_to_mass,
        tyres=k.tyre_mass * k.tyre_radius,
        turning=k.mass * k.mass_height,
        gravity=k.mass * k.mass_height * k.gravity,
        lean_inertia=k.lean_inertia,
        coupling=k.tyre_spin_inertia if gyroscopic else -k.tyre_lean_inertia,
        steer_inertia=k.tyre_steer_inertia,
        steer_stop=k.steer_stop,
        drift=k.wheelbase_tolerance,
        chord_follows_steering=physics.chord_follows_steering,
        stop_absorbs_steering=physics.stop_absorbs_steering,
    )
