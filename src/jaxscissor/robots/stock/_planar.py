"""Planar robots of pins and slides: four-bar, five-bar, 3-RRR, 3-RPR."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp

from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.pytree import pytree, quantity
from jaxscissor.robots._spaces import SE2
from jaxscissor.robots._subspaces import R2, Subspace
from jaxscissor.robots.chains import Chain, Linkage, Prismatic, Revolute
from jaxscissor.robots.stock._places import check_bars, checked, meeting, polar

_THIRDS = (-math.pi / 2, math.pi / 6, 5 * math.pi / 6)


@pytree
class FourBar(Linkage):
    """A crank, a coupler and a rocker: the pose is the rocker's angle, measured from the line of the fixed pins.

    The rocker turns about the origin; the crank's motor is at (-ground, 0). At home the crank points up.

    Args:
      ground: distance of the fixed pins.
      crank, coupler, rocker: lengths of the bars.

    Raises:
      ValueError: lengths that are not positive, or that do not meet at home.

    Example:
      >>> robot = FourBar.prototype()
      >>> [round(float(x), 3) for x in robot.home()[0]]
      [1.816]
    """

    ground: Any = quantity("m")
    crank: Any = quantity("m")
    coupler: Any = quantity("m")
    rocker: Any = quantity("m")

    space = Subspace(SE2, ("alpha",))

    def __post_init__(self):
        if numbers := checked(self):
            ground, crank, coupler, rocker = numbers
            check_bars(self, math.hypot(ground, crank), coupler, rocker)

    @classmethod
    def prototype(cls) -> FourBar:
        """A crank that turns all the way and a rocker that swings (Grashof)."""
        return cls(0.5, 0.15, 0.45, 0.3)

    def _knee(self) -> Sequence[Scalar]:
        return -self.ground, self.crank

    def home_pose(self) -> jax.Array:
        """Where the rocker meets the coupler, on the upper side."""
        zero = 0 * self.ground
        end = meeting(self._knee(), self.coupler, (zero, zero), self.rocker, side=-1)
        return jnp.stack([jnp.arctan2(end[1], end[0])])

    def chains(self) -> list[Chain]:
        """One, from the motor over the crank and the coupler to the rocker."""
        end = polar(self.rocker, self.home_pose()[0])
        motor = Revolute(None, (-self.ground, 0 * self.ground), actuated=True)
        return [Chain([motor, Revolute(None, self._knee()), Revolute(None, end)])]


@pytree
class FiveBar(Linkage):
    """Two cranks and two rods that meet in a pin, which moves in the plane (RRRRR).

    Args:
      half: half the distance of the motors, which are at (-half, 0) and (half, 0).
      crank, rod: lengths; at home both elbows point outwards.

    Raises:
      ValueError: lengths that are not positive, or that do not meet at home.

    Example:
      >>> robot = FiveBar.prototype()
      >>> [round(float(x), 3) for x in robot.home()[0]]
      [0.0, 0.375]
    """

    half: Any = quantity("m")
    crank: Any = quantity("m")
    rod: Any = quantity("m")

    space = R2

    def __post_init__(self):
        if numbers := checked(self):
            half, crank, rod = numbers
            check_bars(self, math.hypot(half, 0.75 * (crank + rod)), crank, rod)

    @classmethod
    def prototype(cls) -> FiveBar:
        """Motors 0.2 m apart, cranks of 0.2 m, rods of 0.3 m."""
        return cls(0.1, 0.2, 0.3)

    def home_pose(self) -> jax.Array:
        """In the middle, at three quarters of a stretched leg's length."""
        return jnp.stack([0 * self.half, 0.75 * (self.crank + self.rod)])

    def chains(self) -> list[Chain]:
        """Motor, elbow and the common pin, left and right."""
        end, found = tuple(self.home_pose()), []
        for side in (-1, 1):
            motor = (side * self.half, 0 * self.half)
            elbow = meeting(motor, self.crank, end, self.rod, side=side)
            found.append(Chain([Revolute(None, motor, actuated=True), Revolute(None, elbow), Revolute(None, end)]))
        return found


@pytree
class Planar3RRR(Linkage):
    """A platform on three cranks with rods, in the plane.

    Args:
      base, platform: radii of the triangles of motors and of the platform's pins, which have a corner below.
      crank, rod: lengths.

    Raises:
      ValueError: lengths that are not positive, or that do not meet at home.

    Example:
      >>> Planar3RRR.prototype().home()[0].tolist()
      [0.0, 0.0, 0.0]
    """

    base: Any = quantity("m")
    platform: Any = quantity("m")
    crank: Any = quantity("m")
    rod: Any = quantity("m")

    space = SE2

    def __post_init__(self):
        if numbers := checked(self):
            base, platform, crank, rod = numbers
            check_bars(self, abs(base - platform), crank, rod)

    @classmethod
    def prototype(cls) -> Planar3RRR:
        """Motors at 0.5 m, the platform's pins at 0.12 m, bars of 0.25 m."""
        return cls(0.5, 0.12, 0.25, 0.25)

    def home_pose(self) -> jax.Array:
        """In the middle, not turned."""
        return jnp.stack([0 * self.base] * 3)

    def chains(self) -> list[Chain]:
        """Motor, elbow to the left of the line to the platform, pin."""
        found = []
        for angle in _THIRDS:
            motor, end = polar(self.base, angle), polar(self.platform, angle)
            elbow = meeting(motor, self.crank, end, self.rod, side=-1)
            found.append(Chain([Revolute(None, motor, actuated=True), Revolute(None, elbow), Revolute(None, end)]))
        return found


@pytree
class Planar3RPR(Linkage):
    """A platform on three legs of variable length, in the plane.

    Args:
      base: ``(3, 2)`` pins of the base.
      platform: ``(3, 2)`` pins of the platform, in its frame.
      pose: ``(3,)`` home; joint coordinates are extensions from there.

    Raises:
      ValueError: wrong shapes.

    Example:
      >>> Planar3RPR.prototype().home()[1].tolist()
      [0.0, 0.0, 0.0]
    """

    base: Any = quantity("m")
    platform: Any = quantity("m")
    pose: Any = quantity("m, rad")

    space = SE2

    def __post_init__(self):
        checked(self, base=(3, 2), platform=(3, 2), pose=(3,))

    @classmethod
    def prototype(cls) -> Planar3RPR:
        """Triangles of 1 m and 0.4 m without symmetry."""
        return cls([[0.0, 0.0], [1.0, 0.1], [0.4, 0.9]], [[-0.2, -0.1], [0.2, -0.1], [0.0, 0.2]], [0.45, 0.35, 0.8])

    def home_pose(self) -> jax.Array:
        """As given."""
        return self.pose

    def chains(self) -> list[Chain]:
        """Pin, slide along the leg, pin."""
        turn = self.pose[2]
        rotation = jnp.stack([jnp.cos(turn), -jnp.sin(turn), jnp.sin(turn), jnp.cos(turn)]).reshape(2, 2)
        ends = self.pose[None, :2] + self.platform @ rotation.T
        return [
            Chain([Revolute(None, low), Prismatic(high - low, (low + high) / 2, actuated=True), Revolute(None, high)])
            for low, high in zip(self.base, ends, strict=True)
        ]
