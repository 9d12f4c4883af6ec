"""Deltas, whose platform does not turn: with rotary motors, with slides."""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp

from jaxscissor._engine.numerics import Scalar, safe_sqrt
from jaxscissor._engine.pytree import pytree, quantity
from jaxscissor.robots._subspaces import R3
from jaxscissor.robots.chains import Chain, Linkage, Prismatic, Revolute, Spherical
from jaxscissor.robots.stock._places import THIRDS, check_rod, checked, polar

_DROOP = math.radians(20)  # of the arms at home


@pytree
class RotaryDelta(Linkage):
    """Clavel's Delta, hanging: arms that motors turn, and rods in pairs that keep the platform from turning.

    A pair of rods is one rod between balls. At home the arms hang by 20 deg; angles grow downwards.

    Args:
      base: radius at which the motors are.
      platform: radius at which the rods hold the platform.
      arm, rod: lengths.

    Raises:
      ValueError: lengths that are not positive, or rods that do not reach the platform at home.

    Example:
      >>> robot = RotaryDelta.prototype()
      >>> [round(float(x), 3) for x in robot.home()[0]]
      [0.0, 0.0, -0.773]
    """

    base: Any = quantity("m")
    platform: Any = quantity("m")
    arm: Any = quantity("m")
    rod: Any = quantity("m")

    space = R3

    def __post_init__(self):
        if numbers := checked(self):
            base, platform, arm, rod = numbers
            check_rod(self, abs(base + arm * math.cos(_DROOP) - platform), rod)

    @classmethod
    def prototype(cls) -> RotaryDelta:
        """Motors at 0.2 m, arms of 0.3 m, rods of 0.8 m."""
        return cls(0.2, 0.045, 0.3, 0.8)

    def _knee(self) -> tuple[Scalar, Scalar]:
        return self.base + self.arm * math.cos(_DROOP), -self.arm * math.sin(_DROOP)

    def home_pose(self) -> jax.Array:
        """Under the middle of the base."""
        radius, height = self._knee()
        across = radius - self.platform
        return jnp.stack([0 * self.base, 0 * self.base, height - safe_sqrt(self.rod**2 - across**2)])

    def chains(self) -> list[Chain]:
        """Motor, ball at the elbow, ball at the platform."""
        (radius, height), bottom, found = self._knee(), self.home_pose()[2], []
        for angle in THIRDS:
            across = (-math.sin(angle), math.cos(angle), 0.0)  # turning about it moves what is outside down
            motor = Revolute(across, polar(self.base, angle, 0 * self.base), actuated=True)
            elbow, end = polar(radius, angle, height), polar(self.platform, angle, bottom)
            found.append(Chain([motor, Spherical(elbow), Spherical(end)]))
        return found


@pytree
class LinearDelta(Linkage):
    """A Delta whose carriages run on vertical columns; rods in pairs keep the platform from turning.

    A pair of rods is one rod between balls. At home the platform is at the origin, under the carriages.

    Args:
      base: radius at which the columns are.
      platform: radius at which the rods hold the platform.
      rod: length.

    Raises:
      ValueError: lengths that are not positive, or rods that do not reach the platform.

    Example:
      >>> LinearDelta.prototype().home()[0].tolist()
      [0.0, 0.0, 0.0]
    """

    base: Any = quantity("m")
    platform: Any = quantity("m")
    rod: Any = quantity("m")

    space = R3

    def __post_init__(self):
        if numbers := checked(self):
            base, platform, rod = numbers
            check_rod(self, abs(base - platform), rod)

    @classmethod
    def prototype(cls) -> LinearDelta:
        """Columns at 0.35 m, rods of 0.5 m."""
        return cls(0.35, 0.05, 0.5)

    def home_pose(self) -> jax.Array:
        """The origin."""
        return jnp.stack([0 * self.base] * 3)

    def chains(self) -> list[Chain]:
        """Carriage, ball on it, ball at the platform."""
        height = safe_sqrt(self.rod**2 - (self.base - self.platform) ** 2)
        found = []
        for angle in THIRDS:
            top, end = polar(self.base, angle, height), polar(self.platform, angle, 0 * height)
            found.append(Chain([Prismatic((0.0, 0.0, 1.0), top, actuated=True), Spherical(top), Spherical(end)]))
        return found
