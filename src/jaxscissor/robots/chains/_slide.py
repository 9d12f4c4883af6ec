"""A slide and a rod."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.numerics import Scalar, limit_margins, safe_sqrt
from jaxscissor._engine.pytree import pytree
from jaxscissor._engine.vectors import Vec
from jaxscissor.robots._bodies import BASE, PLATFORM, Connection, Freedom, balled, pinned
from jaxscissor.robots._contract import Joints, Leg
from jaxscissor.robots.chains._joints import Prismatic, distance, unit, universal


@pytree
class SlideAndRod(Leg):
    """A carriage that an actuator moves along a line, and a rod from it to a point of the platform.

    Attributes:
      foot: the rod's joint on the carriage, at home.
      direction: unit vector of the slide.
      rod: length.
      side: 1 or -1, which of the two solutions home is.
      axis: unit vector about which a guided rod turns, which binds the platform's point to the plane across it.
      stroke: least and greatest displacement from home.
    """

    foot: Vec
    direction: Vec
    rod: Scalar
    side: Scalar
    axis: Vec | None
    stroke: tuple[Scalar, Scalar]

    actuated = (True,)
    limits = ("least displacement", "greatest displacement")

    @classmethod
    def between(cls, slide: Prismatic, knee: Vec, end: Vec, *, axis: Vec | None) -> SlideAndRod:
        """The leg of a slide, the rod's joint on its carriage and the platform's, at home."""
        direction = unit(Vec(*slide.axis))
        ahead = (end - knee).dot(direction)
        side = lax.stop_gradient(jnp.where(ahead > 0, 1.0, -1.0)).astype(jnp.result_type(ahead))
        guide = None if axis is None else unit(axis)
        return cls(knee, direction, distance(end, knee), side, guide, (slide.limits[0], slide.limits[1]))

    def residual(self, joints: Joints, attachment: Vec) -> Joints:
        """The rod has its length."""
        rod = attachment - self.foot - self.direction * joints[0]
        return (rod.dot(rod) / self.rod**2 - 1,)

    def _both(self, point: Vec) -> tuple[Scalar, Scalar, Scalar]:
        """The point's place along the slide, how far the rod reaches along it, and the room left."""
        bar = point - self.foot
        along = bar.dot(self.direction)
        across = bar - self.direction * along
        room = 1 - across.dot(across) / self.rod**2
        return along, self.rod * safe_sqrt(room), room

    def start(self, attachment: Vec) -> tuple[Joints, Scalar]:
        """The solution on home's side of the point."""
        along, reach, room = self._both(attachment)
        return (along - self.side * reach,), room

    def solutions(self, attachment: Vec) -> tuple[Sequence[Joints], Sequence[Scalar]]:
        """Both sides."""
        along, reach, room = self._both(attachment)
        return [(along - sign * reach,) for sign in (self.side, -self.side)], [room >= 0] * 2

    def constraints(self, joints: Joints, attachment: Vec) -> Sequence[Scalar]:
        """The point stays in the plane of the rod, if that is guided."""
        return ((attachment - self.foot).dot(self.axis) / self.rod,) if self.axis is not None else ()

    def margins(self, joints: Joints, attachment: Vec) -> Sequence[Scalar]:
        """The displacement within its limits, in lengths of the rod."""
        return limit_margins(joints[0], *self.stroke, self.rod)

    def bars(self, joints: Joints, attachment: Vec) -> Sequence[tuple[Vec, Vec]]:
        """The rod."""
        return [(self.foot + self.direction * joints[0], attachment)]

    def rails(self, joints: Joints, attachment: Vec) -> Sequence[tuple[Vec, Vec]]:
        """The slide between its limits, where there are none as far as a rod from home."""
        low, high = self.stroke
        ends = jnp.where(jnp.isfinite(low), low, -self.rod), jnp.where(jnp.isfinite(high), high, self.rod)
        return [(self.foot + self.direction * ends[0], self.foot + self.direction * ends[1])]

    def connections(self, joints: Joints, attachment: Vec) -> Sequence[Connection]:
        """A slide with a universal joint on it, or a pin if the rod is guided, and a ball; in the plane two pins."""
        carriage = self.foot + self.direction * joints[0]
        slide = Freedom("slide", self.direction, joints=(0,))
        if len(self.foot.components) == 2:
            zero = jnp.zeros_like(self.rod)
            up = Vec(zero, zero, zero + 1)
            foot = Connection(BASE, 0, carriage, (slide, Freedom("turn", up)))
            return [foot, pinned(0, PLATFORM, attachment, up)]
        rod = attachment - carriage
        turns = universal(unit(self.direction.cross(rod)), rod) if self.axis is None else (Freedom("turn", self.axis),)
        return [Connection(BASE, 0, carriage, (slide, *turns)), balled(0, PLATFORM, attachment)]
