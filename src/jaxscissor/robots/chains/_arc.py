"""Two arcs on a sphere."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.numerics import Scalar, limit_margins
from jaxscissor._engine.pytree import pytree
from jaxscissor._engine.vectors import Vec
from jaxscissor.robots._contract import Joints, Leg
from jaxscissor.robots.chains._joints import Revolute, around, swing, unit


@pytree
class Arc(Leg):
    """Three pins whose axes meet in the origin, the first turned by a motor; the leg sees the last one's axis.

    Attributes:
      axis: unit vector of the motor.
      along, across: unit vectors across it, where the middle axis is at home and where it moves.
      inner: sine and cosine of the arc from the motor's axis to the middle one.
      outer: cosine of the arc from the middle axis to the platform's.
      elbow: 1 or -1, which of the two solutions home is.
      stroke: least and greatest angle from home.
    """

    axis: Vec
    along: Vec
    across: Vec
    inner: tuple[Scalar, Scalar]
    outer: Scalar
    elbow: Scalar
    stroke: tuple[Scalar, Scalar]

    actuated = (True,)
    angular = (True,)
    limits = ("least angle", "greatest angle")

    @classmethod
    def between(cls, motor: Revolute, middle: Revolute, last: Revolute) -> Arc:
        """The leg of three pins at home."""
        axis, knee, end = (unit(Vec(*pin.axis)) for pin in (motor, middle, last))
        cosine = knee.dot(axis)
        along = unit(knee - axis * cosine)
        across = axis.cross(along)
        elbow = lax.stop_gradient(jnp.where(end.dot(across) > 0, -1.0, 1.0)).astype(jnp.result_type(cosine))
        limits = motor.limits[0], motor.limits[1]
        return cls(axis, along, across, (knee.dot(along), cosine), knee.dot(end), elbow, limits)

    def _middle(self, angle: Scalar) -> Vec:
        sine, cosine = self.inner
        return self.axis * cosine + (self.along * jnp.cos(angle) + self.across * jnp.sin(angle)) * sine

    def residual(self, joints: Joints, attachment: Vec) -> Joints:
        """The outer arc has its angle."""
        return (self._middle(joints[0]).dot(attachment) - self.outer,)

    def _both(self, end: Vec) -> tuple[Scalar, Scalar, Scalar]:
        """Angle towards the platform's axis, angle between it and the middle axis, and the room left."""
        sine, cosine = self.inner
        a, b = end.dot(self.along) * sine, end.dot(self.across) * sine
        c = self.outer - end.dot(self.axis) * cosine
        return swing(a, b, c)

    def start(self, attachment: Vec) -> tuple[Joints, Scalar]:
        """The solution on home's side, within half a turn of home."""
        towards, between, room = self._both(attachment)
        return (around(towards + self.elbow * between),), room

    def solutions(self, attachment: Vec) -> tuple[Sequence[Joints], Sequence[Scalar]]:
        """Both sides."""
        towards, between, room = self._both(attachment)
        return [(around(towards + sign * between),) for sign in (self.elbow, -self.elbow)], [room >= 0] * 2

    def margins(self, joints: Joints, attachment: Vec) -> Sequence[Scalar]:
        """The angle within its limits, in radians."""
        return limit_margins(joints[0], *self.stroke, 1)

    def bars(self, joints: Joints, attachment: Vec) -> Sequence[tuple[Vec, Vec]]:
        """Both arcs as chords on the unit sphere."""
        middle = self._middle(joints[0])
        return [(self.axis, middle), (middle, attachment)]

    def rails(self, joints: Joints, attachment: Vec) -> Sequence[tuple[Vec, Vec]]:
        """The motor."""
        return [(self.axis, self.axis)]
