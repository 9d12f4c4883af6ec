"""A leg of any joints, solved from home by Newton's method."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp

from jaxscissor._engine.numerics import Scalar, limit_margins, safe_divide
from jaxscissor._engine.pytree import pytree, static
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._contract import Joints, Leg


@pytree
class SerialLeg(Leg):
    """Pins and slides one after the other, as many as the equations of what the platform sees of them.

    The end is where a product of exponentials carries it from home [Lynch and Park, Modern Robotics, section 4.1]. A
    leg that ends in a ball, or a pin in the plane, sees the platform's point; another one its frame too.

    Attributes:
      axes: unit vectors, in the plane of the slides alone; at home, in the base frame.
      points: on the axes.
      end: the platform's point at home.
      frame: the platform's rotation at home, where the leg holds it.
      scale: a length, which makes the equations dimensionless.
      strokes: least and greatest coordinate of each joint.
      kinds: ``"R"`` or ``"P"`` for each joint.
      moved: which of them actuators move.
    """

    axes: tuple[Any, ...]
    points: tuple[Vec, ...]
    end: Vec
    frame: Rotation | None
    scale: Scalar
    strokes: tuple[tuple[Scalar, Scalar], ...]
    kinds: tuple[str, ...] = static()
    moved: tuple[bool, ...] = static()

    @property
    def actuated(self) -> tuple[bool, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Which joints actuators move."""
        return self.moved

    @property
    def angular(self) -> tuple[bool, ...] | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The pins."""
        return tuple(kind == "R" for kind in self.kinds)

    @property
    def limits(self) -> tuple[str, ...] | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Both ends of every joint."""
        names = [f"joint {i + 1}" for i in range(len(self.kinds))]
        return tuple(f"{end} of {name}" for name in names for end in ("least", "greatest"))

    def placed(self, joints: Joints) -> tuple[Vec, list[Vec], list[Vec]]:
        """The end, the columns of the frame if it is held, and the joints' points, last first."""
        end, columns, points = self.end, [] if self.frame is None else [*self.frame.columns], []
        for kind, axis, point, q in reversed(list(zip(self.kinds, self.axes, self.points, joints, strict=True))):
            points.append(point)
            if kind == "P":
                end, points = end + axis * q, [p + axis * q for p in points]
                continue
            sine, cosine = jnp.sin(q), jnp.cos(q)
            end = point + _turned(end - point, axis, sine, cosine)
            columns = [_turned(column, axis, sine, cosine) for column in columns]
            points = [point + _turned(p - point, axis, sine, cosine) for p in points]
        return end, columns, points

    def residual(self, joints: Joints, attachment: Any) -> Joints:
        """The end is at the platform's point, and turned as the platform is where the leg holds its frame."""
        end, columns, _ = self.placed(joints)
        if not columns:
            return ((end - attachment) * (1 / self.scale)).components
        point, held = attachment
        return (*((end - point) * (1 / self.scale)).components, *_half_turn(columns, held))

    def start(self, attachment: Any) -> tuple[Joints, None]:
        """Home, from where Newton's method goes on."""
        return tuple(jnp.zeros_like(self.scale) for _ in self.kinds), None

    def margins(self, joints: Joints, attachment: Any) -> Sequence[Scalar]:
        """Every joint within its limits, slides in units of the scale."""
        units = [1 if kind == "R" else self.scale for kind in self.kinds]
        pairs = [limit_margins(q, *ends, u) for q, ends, u in zip(joints, self.strokes, units, strict=True)]
        return [margin for pair in pairs for margin in pair]

    def bars(self, joints: Joints, attachment: Any) -> Sequence[tuple[Vec, Vec]]:
        """From joint to joint."""
        end, _, points = self.placed(joints)
        path = [*reversed(points), end]
        return list(itertools.pairwise(path))

    def rails(self, joints: Joints, attachment: Any) -> Sequence[tuple[Vec, Vec]]:
        """The first joint."""
        return [(self.points[0], self.points[0])]


def _turned(vector: Vec, axis: Any, sine: Scalar, cosine: Scalar) -> Vec:
    """The vector turned about a unit axis (Rodrigues), in the plane about its normal."""
    if len(vector.components) == 2:
        return Vec(cosine * vector.x - sine * vector.y, sine * vector.x + cosine * vector.y)
    along = axis * axis.dot(vector)
    return along + (vector - along) * cosine + axis.cross(vector) * sine


def _half_turn(columns: Sequence[Vec], held: Sequence[Vec]) -> tuple[Scalar, ...]:
    """Axis times the tangent of half the angle between two frames: zero only where they are the same."""
    pairs = list(zip(columns, held, strict=True))
    if len(columns) == 2:
        (a, b), *_ = pairs
        return (safe_divide(a.x * b.y - a.y * b.x, 1 + a.dot(b)),)
    cross = sum((a.cross(b) for a, b in pairs[1:]), pairs[0][0].cross(pairs[0][1]))
    return (cross * safe_divide(1, 1 + sum(a.dot(b) for a, b in pairs))).components
