"""A leg of variable length."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp

from jaxscissor._engine.numerics import Scalar, limit_margins, safe_divide, safe_sqrt
from jaxscissor._engine.pytree import pytree
from jaxscissor._engine.vectors import Vec
from jaxscissor.robots._bodies import BASE, PLATFORM, Connection, Freedom, balled, pinned
from jaxscissor.robots._contract import Joints, Leg
from jaxscissor.robots._stewart_gough import TelescopicLeg
from jaxscissor.robots.chains._joints import Prismatic, Revolute, Universal, distance, unit


@pytree
class Telescope(Leg):
    """A leg whose length an actuator changes, between pins or balls, or between two universal joints that bind it.

    With universal joints at both ends the leg cannot twist. The inner axes, n1 = u1 x d and n2 = u2 x d with the outer
    axes u1 of the base and u2 of the platform and the leg d between them, keep their angle about d.

    Attributes:
      anchor: on the base.
      home: length at home.
      stroke: least and greatest extension from home.
      axis: unit vector of the base's outer axis, of a leg between universal joints.
      twist: sine and cosine of the angle of the inner axes about the leg.
      guide: unit vector of a pin on the base, which keeps the leg in the plane across it.
    """

    anchor: Vec
    home: Scalar
    stroke: tuple[Scalar, Scalar]
    axis: Vec | None = None
    twist: tuple[Scalar, Scalar] | None = None
    guide: Vec | None = None

    actuated = (True,)
    limits = ("shortest leg", "longest leg")

    @classmethod
    def between(cls, slide: Prismatic, anchor: Vec, end: Vec) -> Telescope:
        """The leg between two points at home."""
        return cls(anchor, distance(end, anchor), (slide.limits[0], slide.limits[1]))

    @classmethod
    def guided(cls, slide: Prismatic, pin: Revolute, end: Vec) -> Telescope:
        """The leg between a pin and a ball at home."""
        return dataclasses.replace(cls.between(slide, pin.at, end), guide=unit(Vec(*pin.axis)))

    @classmethod
    def untwisted(cls, slide: Prismatic, low: Universal, high: Universal) -> Telescope:
        """The leg between two universal joints at home."""
        free = cls.between(slide, low.at, high.at)
        axis = unit(Vec(*low.axis))
        sine, cosine = _turn(axis, unit(Vec(*high.second)), high.at - low.at)
        size = safe_sqrt(sine**2 + cosine**2)
        return cls(free.anchor, free.home, free.stroke, axis, (sine / size, cosine / size))

    def residual(self, joints: Joints, attachment: Any) -> Joints:
        """Squared distance less squared length, relative to both it and the length at home."""
        bar, length = _point(attachment) - self.anchor, self.home + joints[0]
        return ((bar.dot(bar) - length**2) / (self.home**2 + length**2),)

    def start(self, attachment: Any) -> tuple[Joints, Scalar]:
        """The solution itself; it exists everywhere."""
        length = distance(_point(attachment), self.anchor)
        return (length - self.home,), length / self.home

    def solutions(self, attachment: Any) -> tuple[Sequence[Joints], Sequence[Scalar]]:
        """One: a length is not negative."""
        joints, reach = self.start(attachment)
        return [joints], [reach >= 0]

    def constraints(self, joints: Joints, attachment: Any) -> Sequence[Scalar]:
        """The leg is in its plane, or the leg between universal joints has not twisted."""
        if self.guide is not None:
            return ((_point(attachment) - self.anchor).dot(self.guide) / self.home,)
        if self.axis is None or self.twist is None:
            return ()
        point, axis = attachment
        sine, cosine = _turn(self.axis, axis, point - self.anchor)
        size = safe_sqrt(sine**2 + cosine**2)
        return (safe_divide(sine * self.twist[1] - cosine * self.twist[0], size),)

    def margins(self, joints: Joints, attachment: Any) -> Sequence[Scalar]:
        """The extension within its limits, in lengths at home."""
        return limit_margins(joints[0], *self.stroke, self.home)

    def bars(self, joints: Joints, attachment: Any) -> Sequence[tuple[Vec, Vec]]:
        """Cylinder and rod."""
        point = _point(attachment)
        joint = (self.anchor + point) * 0.5
        return [(self.anchor, joint), (joint, point)]

    def rails(self, joints: Joints, attachment: Any) -> Sequence[tuple[Vec, Vec]]:
        """The joint on the base."""
        return [(self.anchor, self.anchor)]

    def connections(self, joints: Joints, attachment: Any) -> Sequence[Connection]:
        """A universal joint or the pin that guides it, a rod that slides in its cylinder, a ball; in the plane pins."""
        if self.axis is not None:
            return ()
        length, planar = self.home + joints[0], len(self.anchor.components) == 2
        if self.guide is None and not planar:
            free = TelescopicLeg(self.anchor, self.home, (0 * self.home, self.stroke[1]))
            return free.connections((length,), attachment)
        zero = jnp.zeros_like(self.home)
        pin, joint = self.guide or Vec(zero, zero, zero + 1), (self.anchor + attachment) * 0.5
        along = (attachment - self.anchor) * safe_divide(1, length)
        slide = Connection(0, 1, joint, (Freedom("slide", along, joints=(0,)),))
        held = pinned(1, PLATFORM, attachment, pin) if planar else balled(1, PLATFORM, attachment)
        return [pinned(BASE, 0, self.anchor, pin), slide, held]


def _point(attachment: Any) -> Vec:
    """What a leg between universal joints sees is a point and an axis."""
    return attachment if isinstance(attachment, Vec) else attachment[0]


def _turn(low: Vec, high: Vec, bar: Vec) -> tuple[Scalar, Scalar]:
    """Sine and cosine, to one factor, of the angle from low x bar to high x bar about the bar."""
    along = unit(bar)
    one, other = low.cross(along), high.cross(along)
    return one.cross(other).dot(along), one.dot(other)
