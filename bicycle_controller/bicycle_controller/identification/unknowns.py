"""Numbers of a bicycle that are fitted, and how well each is known before the ride."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from bicycle_controller.identification.logs import Array
from bicycle_sim.plants.whipple.parameters import Bicycle, Motor, Parameters, Steering

RELATIVE = {
    "w": 0.01, "mR": 0.05, "mB": 0.05, "mH": 0.2, "mF": 0.05,
    "rR": 0.01, "rF": 0.01, "IRxx": 0.2, "IRyy": 0.15, "IFxx": 0.15, "IFyy": 0.15,
    "xB": 0.08, "zB": 0.08, "xH": 0.04, "zH": 0.08,
    "IBxx": 0.5, "IBzz": 0.5, "IHxx": 0.5, "IHzz": 0.5,
}  # fmt: skip
"""Standard deviations as a share of the value (of its logarithm); none becomes negative."""
ABSOLUTE = {"c": 0.01, "lam": 0.02}
"""m and rad."""
PRODUCTS = {"IBxz": ("IBxx", "IBzz"), "IHxz": ("IHxx", "IHzz")}
"""Products of inertia: a third of the geometric mean of the two moments."""
EXTRAS = {"damping": 0.3, "lag": 0.02, "delay": 0.02}
"""N m s/rad of the steering, s of the motor's lag, s until a command takes effect."""
MOST = {"damping": 5.0, "lag": 0.2, "delay": 0.2}
FIXED = ("IByy", "IHyy", "g")
"""No linear lateral motion depends on the first two."""


@dataclass(frozen=True)
class Unknowns:
    """A prior bicycle and the free numbers about it, each in units of its prior deviation."""

    prior: Parameters
    names: tuple[str, ...]
    deviation: dict[str, float]

    def parameters(self, x: Array) -> Parameters:
        """Return the bicycle at x (k,), zero being the prior one."""
        values = {f.name: float(getattr(self.prior.bicycle, f.name)) for f in fields(Bicycle)}
        extras = self.extras_before()
        for name, step in zip(self.names, x * self.steps, strict=True):
            if name in extras:
                extras[name] = float(np.clip(extras[name] + step, 0.0, MOST[name]))
            elif name in RELATIVE:
                values[name] *= float(np.exp(np.clip(step, -3.0, 3.0)))
            else:
                values[name] += float(step)
        values["lam"] = float(np.clip(values["lam"], -1.1, 1.1))
        for name, (one, other) in PRODUCTS.items():
            most = 0.999 * float(np.sqrt(values[one] * values[other]))
            values[name] = float(np.clip(values[name], -most, most))
        before = self.prior
        return replace(
            before,
            bicycle=Bicycle(**values),
            steering=replace(before.steering, damping=extras["damping"]),
            motor=replace(before.motor, lag=extras["lag"]),
            delay=extras["delay"],
        )

    @property
    def steps(self) -> Array:
        """(k,) prior deviations: of the logarithm where a value stays positive."""
        return np.array([self.deviation[name] for name in self.names])

    def extras_before(self) -> dict[str, float]:
        """Return the prior's damping, lag and delay."""
        p = self.prior
        steering: Steering = p.steering
        motor: Motor = p.motor
        return {
            "damping": float(steering.damping), "lag": float(motor.lag), "delay": float(p.delay)
        }  # fmt: skip

    def in_units(self, x: Array) -> Array:
        """Return (k,) physical size of one prior deviation at x."""
        p = self.parameters(x)
        sizes = []
        for name, step in zip(self.names, self.steps, strict=True):
            scale = abs(float(getattr(p.bicycle, name))) if name in RELATIVE else 1.0
            sizes.append(step * scale)
        return np.array(sizes)


def unknowns(prior: Parameters, trust: float = 1.0, extras: tuple[str, ...] = ()) -> Unknowns:
    """Return what to fit about a bicycle.

    Args:
        prior: the bicycle's file.
        trust: factor on how well its numbers are known; 4 is a bicycle that is only alike.
        extras: of EXTRAS, which to fit besides.
    """
    b = prior.bicycle
    deviation = {name: value * trust for name, value in RELATIVE.items()}
    deviation |= {name: value * trust for name, value in ABSOLUTE.items()}
    for name, (one, other) in PRODUCTS.items():
        deviation[name] = trust * float(np.sqrt(getattr(b, one) * getattr(b, other))) / 3.0
    deviation = {n: min(v, 1.0) if n in RELATIVE else v for n, v in deviation.items()}
    # A skate's wheels have neither radius nor spin; nothing can be scaled from zero.
    names = [
        name for name in deviation if name not in RELATIVE or abs(float(getattr(b, name))) > 0.0
    ]
    deviation |= {name: EXTRAS[name] for name in extras}
    return Unknowns(prior, (*names, *extras), deviation)
