"""Robots of three legs that bind the platform: 3-PRS, 3-UPU, and the agile eye."""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp

from jaxscissor._engine.numerics import Scalar, safe_sqrt
from jaxscissor._engine.pytree import pytree, quantity
from jaxscissor._engine.vectors import Vec
from jaxscissor.robots._spaces import SE3
from jaxscissor.robots._subspaces import SO3
from jaxscissor.robots.chains import Chain, Linkage, Prismatic, Revolute, Spherical, Universal
from jaxscissor.robots.stock._places import THIRDS, check_rod, checked, polar


@pytree
class ThreePRS(Linkage):
    """Three radial slides, rods on pins, balls at the platform: it rises and tilts, with parasitic motion.

    Args:
      base: radius of the carriages at home.
      platform: radius of the platform's balls.
      rod: length.

    Raises:
      ValueError: lengths that are not positive, or rods that do not reach the platform.

    Example:
      >>> robot = ThreePRS.prototype()
      >>> robot.dependent
      ('x', 'y', 'yaw')
    """

    base: Any = quantity("m")
    platform: Any = quantity("m")
    rod: Any = quantity("m")

    space = SE3
    dependent = ("x", "y", "yaw")

    def __post_init__(self):
        if numbers := checked(self):
            base, platform, rod = numbers
            check_rod(self, abs(base - platform), rod)

    @classmethod
    def prototype(cls) -> ThreePRS:
        """Carriages at 0.525 m, balls at 0.2 m, rods of 0.6 m."""
        return cls(0.525, 0.2, 0.6)

    def home_pose(self) -> jax.Array:
        """Level."""
        zero = 0 * self.rod
        return jnp.stack([zero, zero, safe_sqrt(self.rod**2 - (self.base - self.platform) ** 2), zero, zero, zero])

    def chains(self) -> list[Chain]:
        """Slide, pin across it, ball."""
        height, found = self.home_pose()[2], []
        for angle in THIRDS:
            foot, end = polar(self.base, angle, 0 * height), polar(self.platform, angle, height)
            slide = Prismatic((math.cos(angle), math.sin(angle), 0.0), foot, actuated=True)
            found.append(Chain([slide, Revolute((-math.sin(angle), math.cos(angle), 0.0), foot), Spherical(end)]))
        return found


@pytree
class ThreeUPU(Linkage):
    """Three telescopes between universal joints, whose outer axes lie along the circles: it translates.

    It is loose under its constraints where x^2 + y^2 = 4 (base - platform)^2, whatever the actuators do.

    Args:
      base, platform: radii of the universal joints.
      height: of the platform at home.

    Raises:
      ValueError: lengths that are not positive.

    Example:
      >>> import jaxscissor as js
      >>> robot = ThreeUPU.prototype()
      >>> [bool(js.inverse_kinematics(robot, [0.1, 0, 0.7, roll, 0, 0]).converged) for roll in (0.0, 0.1)]
      [True, False]
    """

    base: Any = quantity("m")
    platform: Any = quantity("m")
    height: Any = quantity("m")

    space = SE3
    dependent = ("roll", "pitch", "yaw")

    def __post_init__(self):
        checked(self)

    @classmethod
    def prototype(cls) -> ThreeUPU:
        """Radii of 0.5 m and 0.25 m, 0.8 m high."""
        return cls(0.5, 0.25, 0.8)

    def home_pose(self) -> jax.Array:
        """Over the middle, not turned."""
        zero = 0 * self.height
        return jnp.stack([zero, zero, self.height, zero, zero, zero])

    def chains(self) -> list[Chain]:
        """Universal joint, slide along the leg, universal joint."""
        found = []
        for angle in THIRDS:
            low, high = polar(self.base, angle, 0 * self.height), polar(self.platform, angle, self.height)
            along = (-math.sin(angle), math.cos(angle), 0.0)
            leg = Vec(*high) - Vec(*low)
            inner = Vec(*along).cross(leg).components
            slide = Prismatic(leg.components, low, actuated=True)
            found.append(Chain([Universal(along, inner, low), slide, Universal(inner, along, high)]))
        return found


@pytree
class AgileEye(Linkage):
    """Three legs of two arcs each that turn a platform about a point (Gosselin and Hamel).

    The motors' axes are x, y and z. At home the middle axes lie next to y, z and x.

    Args:
      inner, outer: arcs from the motors to the middle axes and from there to the platform's.

    Raises:
      ValueError: arcs that are not between 0 and 180 deg.

    Example:
      >>> AgileEye.prototype().home()[0].tolist()
      [0.0, 0.0, 0.0]
    """

    inner: Any = quantity("rad")
    outer: Any = quantity("rad")

    space = SO3

    def __post_init__(self):
        if (numbers := checked(self)) and max(numbers) >= math.pi:
            raise ValueError(f"Got arcs of {numbers} rad; expected less than pi.")

    @classmethod
    def prototype(cls) -> AgileEye:
        """Arcs of 90 deg."""
        return cls(math.pi / 2, math.pi / 2)

    @property
    def length(self) -> Scalar:
        """One: nothing of it is a length."""
        return jnp.ones_like(self.inner)

    def home_pose(self) -> jax.Array:
        """Not turned."""
        return jnp.stack([0 * self.inner] * 3)

    def chains(self) -> list[Chain]:
        """Three pins whose axes meet in the origin."""
        found, origin = [], (0.0, 0.0, 0.0)
        for i in range(3):
            axis, beside, across = (Vec(*(float((i + k) % 3 == j) for j in range(3))) for k in range(3))
            middle = jnp.cos(self.inner) * axis + jnp.sin(self.inner) * beside
            last = jnp.cos(self.outer) * middle - jnp.sin(self.outer) * across
            motor = Revolute(axis.components, origin, actuated=True)
            found.append(Chain([motor, *(Revolute(pin.components, origin) for pin in (middle, last))]))
        return found
