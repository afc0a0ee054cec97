"""A bicycle's 25 parameters as a model for MuJoCo.

MuJoCo's axes are x forward, y left, z up, those of the parameters x forward, y right, z down; so
places and inertias are turned about x. The wheels are thin ellipsoids: with cylinders or spheres
the weave is wrong by a factor. Contacts that give way over 2.5 ms instead of MuJoCo's 20 are
stiff enough for a knife-edged wheel: with 4 ms the weave at 6 m/s is 0.04 1/s off.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from bicycle_sim.plants.whipple.parameters import Parameters

STEP = 0.001
"""s, MuJoCo's own step."""
HALF_WIDTH = 0.005
"""m of a wheel; 1 to 20 mm make little difference."""
CONTACT = 0.0025
"""s, time constant of a contact."""
FRICTION = 1.0
"""Coefficient between tyre and road."""

STEER, DRIVE = 0, 1
"""Columns of MuJoCo's controls: torque on the steering, torque on the rear wheel, N m."""


def xml(p: Parameters) -> str:
    """Return the model of one bicycle as MJCF.

    Raises:
        ValueError: if it has what this plant does not simulate.
    """
    _require_plain(p)
    b, steering = p.bicycle, p.steering
    sine, cosine = math.sin(b.lam), math.cos(b.lam)
    return f"""
<mujoco model="bicycle">
  <compiler angle="radian" balanceinertia="true"/>
  <option timestep="{STEP!r}" gravity="0 0 {-b.g!r}" cone="elliptic" solver="Newton"/>
  <default>
    <geom contype="0" conaffinity="1" solref="{CONTACT!r} 1" friction="{FRICTION!r} 0 0"/>
  </default>
  <worldbody>
    <geom name="road" type="plane" size="0 0 1" contype="1" conaffinity="0"/>
    <body name="rear" pos="0 0 {b.rR!r}">
      <freejoint name="frame"/>
      {_inertial(b.mB, b.xB, -b.zB - b.rR, b.IBxx, b.IByy, b.IBzz, b.IBxz)}
      <body name="rear_wheel">
        <joint name="rear_wheel" type="hinge" axis="0 1 0"/>
        {_inertial(b.mR, 0.0, 0.0, b.IRxx, b.IRyy, b.IRxx, 0.0)}
        <geom type="ellipsoid" size="{b.rR!r} {HALF_WIDTH} {b.rR!r}"/>
      </body>
      <body name="front" pos="{b.w!r} 0 {b.rF - b.rR!r}">
        <joint name="steer" type="hinge" axis="{-sine!r} 0 {cosine!r}" pos="{b.c!r} 0 {-b.rF!r}"
          limited="true" range="{-steering.stop!r} {steering.stop!r}"
          damping="{steering.damping!r}" frictionloss="{steering.friction!r}"/>
        {_inertial(b.mH, b.xH - b.w, -b.zH - b.rF, b.IHxx, b.IHyy, b.IHzz, b.IHxz)}
        <body name="front_wheel">
          <joint name="front_wheel" type="hinge" axis="0 1 0"/>
          {_inertial(b.mF, 0.0, 0.0, b.IFxx, b.IFyy, b.IFxx, 0.0)}
          <geom type="ellipsoid" size="{b.rF!r} {HALF_WIDTH} {b.rF!r}"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="steer"/>
    <motor joint="rear_wheel"/>
  </actuator>
</mujoco>
"""


def compiled(p: Parameters) -> Any:
    """Return the `mujoco.MjModel` of a bicycle.

    Raises:
        ValueError: as `xml`, if MuJoCo is not installed, or does not accept these masses.
    """
    try:
        import mujoco
    except ImportError:
        raise ValueError(
            "the plant mujoco needs the package mujoco: pip install mujoco==4.0.0, or "
            "'./bicycle_sim[mujoco]'"
        ) from None
    try:
        return mujoco.MjModel.from_xml_string(xml(p))
    except ValueError as error:
        raise ValueError(f"MuJoCo refuses this bicycle: {' '.join(str(error).split())}") from None


def _inertial(mass: Any, x: Any, z: Any, xx: Any, yy: Any, zz: Any, xz: Any) -> str:
    """Return a body's mass, kg, its centre (x, 0, z), m, and its inertias, kg m^2."""
    turned = (xx, yy, zz, 0.0, -float(xz), 0.0)
    numbers = " ".join(repr(float(value)) for value in turned)
    start = f'<inertial mass="{float(mass)!r}" pos="{float(x)!r} 0 {float(z)!r}"'
    return f'{start} fullinertia="{numbers}"/>'


def _require_plain(p: Parameters) -> None:
    """Raise ValueError for parts of a bicycle that this plant does not have."""
    air, road, b = p.resistance, p.road, p.bicycle
    missing = {
        "several bicycles": p.count is not None,
        "a leaning rider": p.rider is not None,
        "air or rolling resistance": bool(np.any([air.drag_area, air.side_area, air.rolling])),
        "a slope or wind": bool(np.any([road.grade_x, road.grade_y, road.wind_x, road.wind_y])),
        "skates for wheels": not (np.all(b.rR > 0.0) and np.all(b.rF > 0.0)),
    }
    for what, there in missing.items():
        if there:
            raise ValueError(f"the plant mujoco has not {what}: choose the plant whipple")
