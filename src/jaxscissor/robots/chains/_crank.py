"""A crank and a rod."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.numerics import Scalar, limit_margins
from jaxscissor._engine.pytree import pytree, static
from jaxscissor._engine.vectors import Vec
from jaxscissor.robots._bodies import BASE, PLATFORM, Connection, Freedom, balled, pinned
from jaxscissor.robots._contract import Joints, Leg
from jaxscissor.robots.chains._joints import Revolute, around, distance, swing, unit, universal


@pytree
class CrankAndRod(Leg):
    """A crank that a motor turns, and a rod from its end to a point of the platform; in space or in the plane.

    Attributes:
      anchor: on the axis of the crank.
      along, across: unit vectors from there to the crank's end at home, and where it moves as it turns.
      crank, rod: lengths.
      elbow: 1 or -1, which of the two solutions home is.
      axis: unit vector of the crank, of a robot in space.
      stroke: least and greatest angle from home.
      guided: whether the rod turns in the plane of the crank, which binds the platform's point to it.
    """

    anchor: Vec
    along: Vec
    across: Vec
    crank: Scalar
    rod: Scalar
    elbow: Scalar
    axis: Vec | None
    stroke: tuple[Scalar, Scalar]
    guided: bool = static(default=False)

    actuated = (True,)
    angular = (True,)
    limits = ("least angle", "greatest angle")

    @classmethod
    def between(cls, motor: Revolute, knee: Vec, end: Vec, *, guided: bool) -> CrankAndRod:
        """The leg of a motor, the rod's joint on its crank and the platform's, at home."""
        planar = len(knee.components) == 2
        axis = None if planar else unit(Vec(*motor.axis))
        arm = knee - motor.at
        foot = motor.at if axis is None else motor.at + axis * axis.dot(arm)  # in the plane in which the knee moves
        arm = knee - foot
        along = unit(arm)
        across = Vec(-along.y, along.x) if axis is None else axis.cross(along)
        bar = end - foot
        elbow = lax.stop_gradient(jnp.where(bar.dot(across) > 0, -1.0, 1.0)).astype(jnp.result_type(bar.x))
        limits = motor.limits[0], motor.limits[1]
        return cls(foot, along, across, distance(knee, foot), distance(end, knee), elbow, axis, limits, guided)

    def tip(self, angle: Scalar) -> Vec:
        """End of the crank."""
        return self.anchor + (self.along * jnp.cos(angle) + self.across * jnp.sin(angle)) * self.crank

    def residual(self, joints: Joints, attachment: Vec) -> Joints:
        """The rod has its length."""
        rod = attachment - self.tip(joints[0])
        return (rod.dot(rod) / self.rod**2 - 1,)

    def _both(self, point: Vec) -> tuple[Scalar, Scalar, Scalar]:
        """Angle towards the point, angle between it and the crank, and the room left, >= 0 where they meet."""
        bar = point - self.anchor
        a, b = bar.dot(self.along), bar.dot(self.across)
        c = (bar.dot(bar) + self.crank**2 - self.rod**2) / (2 * self.crank)
        towards, between, room = swing(a, b, c)
        return towards, between, room / (self.crank * self.rod)

    def start(self, attachment: Vec) -> tuple[Joints, Scalar]:
        """The solution on home's side of the line to the point, within half a turn of home."""
        towards, between, room = self._both(attachment)
        return (around(towards + self.elbow * between),), room

    def solutions(self, attachment: Vec) -> tuple[Sequence[Joints], Sequence[Scalar]]:
        """Both sides."""
        towards, between, room = self._both(attachment)
        return [(around(towards + sign * between),) for sign in (self.elbow, -self.elbow)], [room >= 0] * 2

    def constraints(self, joints: Joints, attachment: Vec) -> Sequence[Scalar]:
        """The point stays in the plane of the crank, if the rod does."""
        if not self.guided or self.axis is None:
            return ()
        return ((attachment - self.anchor).dot(self.axis) / self.rod,)

    def margins(self, joints: Joints, attachment: Vec) -> Sequence[Scalar]:
        """The angle within its limits, in radians."""
        return limit_margins(joints[0], *self.stroke, 1)

    def bars(self, joints: Joints, attachment: Vec) -> Sequence[tuple[Vec, Vec]]:
        """Crank and rod."""
        tip = self.tip(joints[0])
        return [(self.anchor, tip), (tip, attachment)]

    def rails(self, joints: Joints, attachment: Vec) -> Sequence[tuple[Vec, Vec]]:
        """The motor."""
        return [(self.anchor, self.anchor)]

    def connections(self, joints: Joints, attachment: Vec) -> Sequence[Connection]:
        """A motor, and a rod between a universal joint and a ball, or pins along the axis of the motor."""
        zero = jnp.zeros_like(self.crank)
        axis = Vec(zero, zero, zero + 1) if self.axis is None else self.axis
        tip = self.tip(joints[0])
        motor = Connection(BASE, 0, self.anchor, (Freedom("turn", axis, joints=(0,)),))
        pin = self.guided or self.axis is None
        knee = pinned(0, 1, tip, axis) if pin else Connection(0, 1, tip, universal(axis, attachment - tip))
        held = pinned(1, PLATFORM, attachment, axis) if self.axis is None else balled(1, PLATFORM, attachment)
        return [motor, knee, held]
