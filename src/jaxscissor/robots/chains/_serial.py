"""A leg of any joints, solved from home by Newton's method."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.matrices import complement
from jaxscissor._engine.numerics import Scalar, limit_margins, safe_divide
from jaxscissor._engine.pytree import pytree, static
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._contract import Joints, Leg


@pytree
class SerialLeg(Leg):
    """Pins and slides one after the other, at most as many as the equations of what the platform sees of them.

    The end is where a product of exponentials carries it from home [Lynch and Park, Modern Robotics, section 4.1]. A
    leg that ends in a ball, or a pin in the plane, sees the platform's point; another one its frame too. The joints of
    a leg with fewer of them solve the share of the equations that lies along their motions at home; what is left
    binds the platform, in a way that depends on the joints.

    Attributes:
      axes: unit vectors, in the plane of the slides alone; at home, in the base frame.
      points: on the axes.
      end: the platform's point at home.
      frame: the platform's rotation at home, where the leg holds it.
      scale: a length, which makes the equations dimensionless.
      strokes: least and greatest coordinate of each joint.
      along: of a leg with fewer joints than equations, how the equations grow with each joint at home.
      across: unit vectors at right angles to those and to each other.
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
    along: jax.Array | None = None
    across: jax.Array | None = None

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

    def with_guides(self) -> SerialLeg:
        """The leg that knows which of its equations bind the platform, if it has fewer joints than equations."""
        rows = jnp.stack([self._screw(*joint) for joint in zip(self.kinds, self.axes, self.points, strict=True)])
        if len(rows) == rows.shape[1]:
            return self
        along = fence(lax.stop_gradient(rows))
        return dataclasses.replace(self, along=along, across=fence(complement(along)))

    def _screw(self, kind: str, axis: Vec | None, point: Vec) -> jax.Array:
        """How the equations grow with a joint at home: the end's velocity, and half the angular velocity."""
        arm, planar = self.end - point, len(self.end.components) == 2
        if kind == "P":
            velocity, turn = axis.array(), jnp.zeros(1 if planar else 3, self.scale.dtype)  # type: ignore[union-attr]
        elif axis is None:
            velocity, turn = Vec(-arm.y, arm.x).array(), jnp.ones(1, self.scale.dtype)
        else:
            velocity, turn = axis.cross(arm).array(), axis.array()
        return velocity / self.scale if self.frame is None else jnp.concatenate([velocity / self.scale, turn / 2])

    def tip(self, joints: Joints) -> Vec:
        """Where the joints carry the end; number by number, which takes a third of the time of matrices."""
        end = self.end
        for kind, axis, point, q in self._backwards(joints):
            if kind == "P":
                end = end + axis * q
            else:
                end = point + _turned(end - point, axis, q)
        return end

    def carried(self, joints: Joints) -> jax.Array:
        """The end and the columns of the frame that the leg holds, as columns of one matrix."""
        vectors = _matrix(self.end, *self.frame.columns)  # type: ignore[union-attr]
        place = jnp.zeros_like(vectors[:1]).at[0, 0].set(1)  # of these only the end has one
        for joint in self._backwards(joints):
            vectors = _moved(vectors, place, *joint)
        return vectors

    def path(self, joints: Joints) -> jax.Array:
        """The joints' points and the end, one after the other in the columns of a matrix."""
        points = _matrix(self.end)
        for joint in self._backwards(joints):
            points = _moved(points, jnp.ones_like(points[:1]), *joint)
            points = jnp.concatenate([joint[2].array()[:, None], points], axis=1)
        return points

    def _backwards(self, joints: Joints) -> list[tuple[Any, ...]]:
        """Kind, axis, point and coordinate of each joint, the last one first."""
        return list(zip(self.kinds, self.axes, self.points, joints, strict=True))[::-1]

    def residual(self, joints: Joints, attachment: Any) -> Joints:
        """The end is at the platform's point, and turned as the platform is where the leg holds its frame."""
        return self._shares(self.along, joints, attachment)

    def constraints(self, joints: Joints, attachment: Any) -> Joints:
        """What of this the joints cannot solve."""
        return () if self.across is None else self._shares(self.across, joints, attachment)

    def _shares(self, directions: jax.Array | None, joints: Joints, attachment: Any) -> Joints:
        """The equations, or their shares along some directions."""
        equations = self._off(joints, attachment)
        return tuple(equations if directions is None else jnp.sum(directions * equations[None], axis=1))

    def _off(self, joints: Joints, attachment: Any) -> jax.Array:
        """How far the end is from the platform's point, and how far it is turned from its frame."""
        if self.frame is None:
            return ((self.tip(joints) - attachment) * (1 / self.scale)).array()
        carried, (point, held) = self.carried(joints), attachment
        apart = (carried[:, 0] - point.array()) / self.scale
        return jnp.concatenate([apart, _half_turn(carried[:, 1:], *held)])

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
        return list(itertools.pairwise(Vec(*point) for point in self.path(joints).T))

    def rails(self, joints: Joints, attachment: Any) -> Sequence[tuple[Vec, Vec]]:
        """The first joint."""
        return [(self.points[0], self.points[0])]


def _matrix(*vectors: Vec) -> jax.Array:
    """Vectors as the columns of a matrix."""
    return jnp.stack([vector.array() for vector in vectors], axis=1)


def _moved(vectors: jax.Array, place: jax.Array, kind: str, axis: Any, point: Vec, q: Scalar) -> jax.Array:
    """The columns of a matrix carried by a joint; ``place`` is one for points and zero for directions."""
    if kind == "P":
        return vectors + axis.array()[:, None] * place * q
    foot = point.array()[:, None] * place
    return foot + _rotation(axis, q) @ (vectors - foot)


def _turned(vector: Vec, axis: Vec | None, angle: Scalar) -> Vec:
    """The vector turned about a unit axis (Rodrigues), in the plane about its normal."""
    sine, cosine = jnp.sin(angle), jnp.cos(angle)
    if axis is None:
        return Vec(cosine * vector.x - sine * vector.y, sine * vector.x + cosine * vector.y)
    along = axis * axis.dot(vector)
    return along + (vector - along) * cosine + axis.cross(vector) * sine


def _rotation(axis: Vec | None, angle: Scalar) -> jax.Array:
    """Rotation matrix about a unit axis (Rodrigues), in the plane about its normal."""
    sine, cosine = jnp.sin(angle), jnp.cos(angle)
    if axis is None:
        return jnp.stack([cosine, -sine, sine, cosine]).reshape(2, 2)
    zero, along = jnp.zeros_like(axis.x), axis.array()
    across = jnp.stack([zero, -axis.z, axis.y, axis.z, zero, -axis.x, -axis.y, axis.x, zero]).reshape(3, 3)
    kept = along[:, None] * along[None]
    return kept + (jnp.eye(3, dtype=kept.dtype) - kept) * cosine + across * sine


def _half_turn(columns: jax.Array, *held: Vec) -> jax.Array:
    """Axis times the tangent of half the angle between two frames: zero only where they are the same."""
    turn = _matrix(*held) @ columns.T
    skew, size = turn - turn.T, len(turn)
    axis = [skew[1, 0]] if size == 2 else [skew[2, 1], skew[0, 2], skew[1, 0]]
    return jnp.stack(axis) * safe_divide(1, 4 - size + jnp.trace(turn))
