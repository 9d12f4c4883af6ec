"""Hexapods with rotary motors (6-RUS) and with carriages on parallel rails (6-PUS)."""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.numerics import Scalar, safe_sqrt
from jaxscissor._engine.pytree import pytree, quantity
from jaxscissor.robots._spaces import SE3
from jaxscissor.robots.chains import Chain, Linkage, Prismatic, Revolute, Spherical
from jaxscissor.robots.stock._places import check_rod, checked, polar


@pytree
class RotaryHexapod(Linkage):
    """A hexapod with rotary motors, 6-RUS, in three pairs 120 deg apart.

    The cranks turn in vertical planes along the circle of the base; at home they are level and point away from the
    other one of their pair. Angles grow downwards.

    Args:
      base, platform: radii of the circles of motors and of the platform's balls.
      base_angle, platform_angle: half the angle between the two of a pair, seen from the middle.
      crank, rod: lengths.

    Raises:
      ValueError: numbers that are not positive, or rods that do not reach the platform.

    Example:
      >>> robot = RotaryHexapod.prototype()
      >>> [round(float(x), 3) for x in robot.home()[0]]
      [0.0, 0.0, 0.191, 0.0, 0.0, 0.0]
    """

    base: Any = quantity("m")
    platform: Any = quantity("m")
    base_angle: Any = quantity("rad")
    platform_angle: Any = quantity("rad")
    crank: Any = quantity("m")
    rod: Any = quantity("m")

    space = SE3

    def __post_init__(self):
        if numbers := checked(self):
            *_, rod = numbers
            check_rod(self, _level_gap(*numbers[:5]), rod)

    @classmethod
    def prototype(cls) -> RotaryHexapod:
        """A desktop motion platform: circles of 0.15 m and 0.1 m, cranks of 0.05 m, rods of 0.2 m."""
        return cls(0.15, 0.10, math.radians(20), math.radians(45), 0.05, 0.20)

    def home_pose(self) -> jax.Array:
        """Over the middle of the base, not turned."""
        gap = _level_gap(self.base, self.platform, self.base_angle, self.platform_angle, self.crank)
        zero = 0 * self.base
        return jnp.stack([zero, zero, safe_sqrt(self.rod**2 - gap**2), zero, zero, zero])

    def chains(self) -> list[Chain]:
        """Motor, joint on the crank, ball at the platform."""
        height, found = self.home_pose()[2], []
        for i in range(6):
            side = 1 if i % 2 else -1
            middle = 2 * math.pi / 3 * (i // 2)
            angle = middle + side * self.base_angle
            hip = polar(self.base, angle, 0 * self.base)
            along = side * -jnp.sin(angle), side * jnp.cos(angle)  # of the crank, at home
            knee = hip[0] + self.crank * along[0], hip[1] + self.crank * along[1], hip[2]
            end = polar(self.platform, middle + side * self.platform_angle, height)
            axis = -along[1], along[0], 0 * self.base
            found.append(Chain([Revolute(axis, hip, actuated=True), Spherical(knee), Spherical(end)]))
        return found


def _level_gap(base: Scalar, platform: Scalar, base_angle: Scalar, platform_angle: Scalar, crank: Scalar) -> Scalar:
    """Horizontal distance of a platform's ball from the end of its level crank."""
    plain = np if isinstance(base, np.ndarray) else jnp
    apart = platform_angle - base_angle
    radial, around = platform * plain.cos(apart) - base, platform * plain.sin(apart) - crank
    return plain.hypot(radial, around)


@pytree
class Hexaglide(Linkage):
    """A hexapod whose six carriages run on parallel rails along x, 6-PUS.

    Args:
      rails: ``(6, 2)`` places (y, z) of the rails.
      platform: ``(6, 3)`` the platform's balls, in its frame.
      rod: length; at home those of even number come from behind, the others from ahead.
      height: of the platform at home, over the origin.

    Raises:
      ValueError: wrong shapes, numbers that are not positive, rods that do not reach the platform at home.

    Example:
      >>> robot = Hexaglide.prototype()
      >>> robot.home()[0].tolist()[2] > 0
      True
    """

    rails: Any = quantity("m")
    platform: Any = quantity("m")
    rod: Any = quantity("m")
    height: Any = quantity("m")

    space = SE3

    def __post_init__(self):
        if numbers := checked(self, rails=(6, 2), platform=(6, 3)):
            rails, platform, rod, height = numbers
            for rail, corner in zip(rails, platform, strict=True):
                check_rod(self, math.hypot(corner[1] - rail[0], corner[2] + height - rail[1]), rod)

    @classmethod
    def prototype(cls) -> Hexaglide:
        """Three pairs of rails, 0.45 m and 0.35 m apart, rods of 0.7 m."""
        rails = [[y, 0.0] for y in (-0.35, 0.1, 0.45) for _ in range(2)]
        corners = [[sign * x, y, 0.0] for x, y in ((0.02, -0.18), (-0.2, 0.18), (0.2, -0.03)) for sign in (1, -1)]
        return cls(rails, corners, 0.7, 0.35)

    def home_pose(self) -> jax.Array:
        """Over the origin, not turned."""
        zero = 0 * self.rod
        return jnp.stack([zero, zero, self.height, zero, zero, zero])

    def chains(self) -> list[Chain]:
        """Carriage, joint on it, ball at the platform."""
        found = []
        for i, (rail, corner) in enumerate(zip(self.rails, self.platform, strict=True)):
            end = corner[0], corner[1], corner[2] + self.height
            across2 = (end[1] - rail[0]) ** 2 + (end[2] - rail[1]) ** 2
            carriage = end[0] + (1 if i % 2 else -1) * safe_sqrt(self.rod**2 - across2), rail[0], rail[1]
            slide = Prismatic((1.0, 0.0, 0.0), carriage, actuated=True)
            found.append(Chain([slide, Spherical(carriage), Spherical(end)]))
        return found
