"""A Scott-Russell linkage that slides and turns on a vertical mast: the leg of Tri-Scott and MICABO."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import jax.numpy as jnp

from jaxscissor._engine.numerics import Scalar, limit_margins, safe_divide, safe_sqrt, smallest
from jaxscissor._engine.pytree import pytree
from jaxscissor._engine.vectors import Vec
from jaxscissor.robots._bodies import BASE, PLATFORM, Connection, Freedom, balled, pinned
from jaxscissor.robots._contract import Joints, Leg
from jaxscissor.robots._scott import Scott


@pytree
class ScottLeg(Leg):
    """Both sliders run on one mast; joints are the lower one's height and its distance to the upper one.

    The home mode has the upper slider above the platform's joint and the crank rising from the lower one.

    Attributes:
      mast: where the mast stands, in the plane z = 0.
      linkage: crank on the lower slider, link on the upper one.
      scale: the robot's length.
      low_stroke, high_stroke: least and greatest value of the first and of the second joint.
    """

    mast: Vec
    linkage: Scott
    scale: Scalar
    low_stroke: tuple[Scalar, Scalar]
    high_stroke: tuple[Scalar, Scalar]

    actuated = (True, True)
    limits = ("least rho1..3", "greatest rho1..3", "least rho4..6", "greatest rho4..6")
    _upper: ClassVar[tuple[int, ...]] = (0, 1)  # the joints whose sum is the upper slider's height

    def spread(self, joints: Joints) -> Scalar:
        """Height of the upper slider over the lower one."""
        return joints[1]

    def joints_of(self, height: Scalar, spread: Scalar) -> Joints:
        """The joints with the lower slider at a height."""
        return height, spread

    def residual(self, joints: Joints, attachment: Vec) -> Joints:
        """Link and crank of their lengths [TRI eqs. 2-3]."""
        return self.linkage.residual(self._radius2(attachment), self.spread(joints), attachment.z - joints[0])

    def start(self, attachment: Vec) -> tuple[Joints, Scalar]:
        """The solution itself [TRI eqs. 2-6], and the squared height that the link has left."""
        radius = safe_sqrt(self._radius2(attachment))
        spread, height = self.linkage.sliders(radius)[0]
        reach = smallest(self.linkage.room(radius)) / self.linkage.link**2
        return self.joints_of(attachment.z - height, spread), reach

    def solutions(self, attachment: Vec) -> tuple[Sequence[Joints], Sequence[Scalar]]:
        """All four working modes: link above or below the platform's joint, crank rising or falling."""
        radius = safe_sqrt(self._radius2(attachment))
        reached = smallest(self.linkage.room(radius)) >= 0
        ways = self.linkage.sliders(radius)
        return [self.joints_of(attachment.z - height, spread) for spread, height in ways], [reached] * 4

    def mode(self, joints: Joints, attachment: Vec) -> Scalar:
        """Home is 0; 1 is added if the link rises to the platform's joint, 2 if the crank falls."""
        spread = self.spread(joints)
        drop = spread - (attachment.z - joints[0])
        pinned = spread - drop * self.linkage.pin / self.linkage.link
        return jnp.where(drop >= 0, 0, 1) + jnp.where(pinned >= 0, 0, 2)

    def margins(self, joints: Joints, attachment: Vec) -> Sequence[Scalar]:
        """Both joints within their strokes."""
        return (
            *limit_margins(joints[0], *self.low_stroke, self.scale),
            *limit_margins(joints[1], *self.high_stroke, self.scale),
        )

    def bars(self, joints: Joints, attachment: Vec) -> Sequence[tuple[Vec, Vec]]:
        """Link and crank."""
        lower, upper = self._on_mast(joints[0]), self._on_mast(joints[0] + self.spread(joints))
        pin = upper + (attachment - upper) * (self.linkage.pin / self.linkage.link)
        return [(upper, attachment), (lower, pin)]

    def connections(self, joints: Joints, attachment: Vec) -> Sequence[Connection]:
        """Both sliders with ball joints on them, the pin between link and crank, the platform's ball joint."""
        (upper, _), (lower, pin) = self.bars(joints, attachment)
        zero = jnp.zeros_like(joints[0])
        up = Vec(zero, zero, zero + 1)
        radius = Vec(attachment.x - self.mast.x, attachment.y - self.mast.y, zero)
        normal = up.cross(radius) * safe_divide(1, safe_sqrt(radius.dot(radius)))
        return [
            Connection(BASE, 1, lower, (Freedom("slide", up, joints=(0,)), Freedom("ball"))),
            Connection(BASE, 0, upper, (Freedom("slide", up, joints=self._upper), Freedom("ball"))),
            pinned(1, 0, pin, normal),
            balled(0, PLATFORM, attachment),
        ]

    def rails(self, joints: Joints, attachment: Vec) -> Sequence[tuple[Vec, Vec]]:
        """The mast, from the ground to above the upper slider."""
        top = jnp.maximum(joints[0] + self.spread(joints), attachment.z) + 0.1 * self.scale
        return [(self._on_mast(jnp.minimum(0, joints[0])), self._on_mast(top))]

    def end(self, joints: Joints) -> tuple[Scalar, Scalar]:
        """Distance from the mast and height of the platform's joint [TRI eqs. 7-10]."""
        radius, height = self.linkage.end(self.spread(joints))
        return radius, joints[0] + height

    def _radius2(self, attachment: Vec) -> Scalar:
        return (attachment.x - self.mast.x) ** 2 + (attachment.y - self.mast.y) ** 2

    def _on_mast(self, height: Scalar) -> Vec:
        return Vec(self.mast.x, self.mast.y, height)


@pytree
class MicaboLeg(ScottLeg):
    """The same leg with both actuators on the base: joints are the heights of the two sliders."""

    _upper = (1,)

    def spread(self, joints: Joints) -> Scalar:
        """Height of the upper slider over the lower one."""
        return joints[1] - joints[0]

    def joints_of(self, height: Scalar, spread: Scalar) -> Joints:
        """The joints with the lower slider at a height."""
        return height, height + spread
