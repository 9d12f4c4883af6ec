"""Pose spaces: what the pose coordinates mean, how to step on the group, rates against twists."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Protocol

import jax
import jax.numpy as jnp

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.cpu.sincos import sine_cosine
from jaxscissor._engine.numerics import Scalar, safe_divide, safe_sqrt
from jaxscissor._engine.vectors import Rotation, Vec


class Space(Protocol):
    """A space of platform poses; twists are (velocity of the reference point, angular velocity) in the base frame."""

    @property
    def dimension(self) -> int:
        """Number of coordinates of a pose."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates, translations first."""
        ...

    @property
    def translations(self) -> int:
        """How many of them are lengths."""
        ...

    def place(self, pose: jax.Array) -> tuple[Vec, Rotation]:
        """Position and rotation of a pose, the only place where its sines and cosines are taken."""
        ...

    def coordinates(self, position: Vec, rotation: Rotation) -> tuple[Scalar, ...]:
        """Pose coordinates of a position and rotation."""
        ...

    def retract(self, position: Vec, rotation: Rotation, twist: Sequence[Scalar]) -> tuple[Vec, Rotation]:
        """Step along a twist: translate, and rotate by the group's exponential from the left."""
        ...

    def nudge(self, position: Vec, rotation: Rotation, twist: Sequence[Scalar]) -> tuple[Vec, Rotation]:
        """``retract`` to first order, with the same derivative at rest and far fewer operations."""
        ...

    def between(self, start: tuple[Vec, Rotation], end: tuple[Vec, Rotation]) -> jax.Array:
        """The twist along which ``retract`` carries one position and rotation to another."""
        ...

    def rates_to_twist(self, pose: jax.Array) -> jax.Array:
        """Matrix from the rates of the pose coordinates to the twist."""
        ...


class SE3:
    """Spatial poses (x, y, z, roll, pitch, yaw), R = Rx(roll) Ry(pitch) Rz(yaw) [RAL17 eq. 1, ICRA16 eq. 1]."""

    dimension: ClassVar[int] = 6
    names: ClassVar[tuple[str, ...]] = ("x", "y", "z", "roll", "pitch", "yaw")
    translations: ClassVar[int] = 3

    @staticmethod
    def place(pose: jax.Array) -> tuple[Vec, Rotation]:
        """Position and rotation of a pose ``(6,)``."""
        (sr, cr), (sp, cp), (sy, cy) = (sine_cosine(pose[i]) for i in (3, 4, 5))
        rotation = Rotation(
            Vec(cp * cy, cr * sy + sr * sp * cy, sr * sy - cr * sp * cy),
            Vec(-cp * sy, cr * cy - sr * sp * sy, sr * cy + cr * sp * sy),
            Vec(sp, -sr * cp, cr * cp),
        )
        return Vec(pose[0], pose[1], pose[2]), rotation

    @staticmethod
    def coordinates(position: Vec, rotation: Rotation) -> tuple[Scalar, ...]:
        """Pose coordinates with pitch in [-90, 90] deg; where roll and yaw coincide, yaw is zero."""
        n, t, b = rotation.columns
        cos_pitch = safe_sqrt(n.x**2 + t.x**2)
        locked = cos_pitch <= 8 * jnp.finfo(jnp.result_type(b.x)).eps
        pitch = jnp.arctan2(b.x, cos_pitch)
        roll = jnp.arctan2(jnp.where(locked, t.z, -b.y), jnp.where(locked, t.y, b.z))
        yaw = jnp.arctan2(jnp.where(locked, 0, -t.x), jnp.where(locked, 1, n.x))
        return (*position.components, roll, pitch, yaw)

    @staticmethod
    def retract(position: Vec, rotation: Rotation, twist: Sequence[Scalar]) -> tuple[Vec, Rotation]:
        """Step along a twist (v, omega)."""
        axis = Vec(*twist[3:])
        angle2 = axis.dot(axis)
        angle = safe_sqrt(angle2)
        # the quotients tend to 1 and 1/2; below the threshold the limits are exact to rounding
        small = angle2 < jnp.finfo(jnp.result_type(angle2)).eps
        first = jnp.where(small, 1 - angle2 / 6, safe_divide(jnp.sin(angle), angle))
        second = jnp.where(small, 0.5, 0.5 * safe_divide(jnp.sin(angle / 2), angle / 2) ** 2)

        def turn(column: Vec) -> Vec:
            once = axis.cross(column)
            return column + once * first + axis.cross(once) * second

        return position + Vec(*twist[:3]), Rotation(*(turn(c) for c in rotation.columns))

    @staticmethod
    def nudge(position: Vec, rotation: Rotation, twist: Sequence[Scalar]) -> tuple[Vec, Rotation]:
        """``retract`` to first order, with the same derivative at rest and far fewer operations."""
        axis = Vec(*twist[3:])
        return position + Vec(*twist[:3]), Rotation(*(c + axis.cross(c) for c in rotation.columns))

    @staticmethod
    def between(start: tuple[Vec, Rotation], end: tuple[Vec, Rotation]) -> jax.Array:
        """The twist ``(6,)`` from one position and rotation to another, apart by less than half a turn."""
        columns = list(zip(start[1].columns, end[1].columns, strict=True))
        axis = sum((a.cross(b) for a, b in columns[1:]), columns[0][0].cross(columns[0][1])) * 0.5
        sine, cosine = safe_sqrt(axis.dot(axis)), (sum(a.dot(b) for a, b in columns) - 1) / 2
        small = (sine**2 < jnp.finfo(jnp.result_type(sine)).eps) & (cosine > 0)
        turn = axis * jnp.where(small, 1 + sine**2 / 6, safe_divide(jnp.arctan2(sine, cosine), sine))
        return jnp.stack([*(end[0] - start[0]).components, *turn.components])

    @staticmethod
    def rates_to_twist(pose: jax.Array) -> jax.Array:
        """Matrix ``(6, 6)`` from (velocity, roll, pitch and yaw rates) to (velocity, angular velocity)."""
        sr, cr, sp, cp = jnp.sin(pose[3]), jnp.cos(pose[3]), jnp.sin(pose[4]), jnp.cos(pose[4])
        zero, one = jnp.zeros_like(sr), jnp.ones_like(sr)
        angular = jnp.stack([one, zero, sp, zero, cr, -sr * cp, zero, sr, cr * cp]).reshape(3, 3)
        return jnp.eye(6, dtype=angular.dtype).at[3:, 3:].set(angular)


class SE2:
    """Planar poses (x, y, alpha)."""

    dimension: ClassVar[int] = 3
    names: ClassVar[tuple[str, ...]] = ("x", "y", "alpha")
    translations: ClassVar[int] = 2

    @staticmethod
    def place(pose: jax.Array) -> tuple[Vec, Rotation]:
        """Position and rotation of a pose ``(3,)``."""
        s, c = sine_cosine(pose[2])
        return Vec(pose[0], pose[1]), Rotation(Vec(c, s), Vec(-s, c))

    @staticmethod
    def coordinates(position: Vec, rotation: Rotation) -> tuple[Scalar, ...]:
        """Pose coordinates with alpha in (-180, 180] deg."""
        n = rotation.columns[0]
        return (*position.components, jnp.arctan2(n.y, n.x))

    @staticmethod
    def retract(position: Vec, rotation: Rotation, twist: Sequence[Scalar]) -> tuple[Vec, Rotation]:
        """Step along a twist (v_x, v_y, omega)."""
        s, c = jnp.sin(twist[2]), jnp.cos(twist[2])
        turned = (Vec(c * v.x - s * v.y, s * v.x + c * v.y) for v in rotation.columns)
        return position + Vec(*twist[:2]), Rotation(*turned)

    @staticmethod
    def nudge(position: Vec, rotation: Rotation, twist: Sequence[Scalar]) -> tuple[Vec, Rotation]:
        """``retract`` to first order, with the same derivative at rest and far fewer operations."""
        turned = (c + Vec(-c.y, c.x) * twist[2] for c in rotation.columns)
        return position + Vec(*twist[:2]), Rotation(*turned)

    @staticmethod
    def between(start: tuple[Vec, Rotation], end: tuple[Vec, Rotation]) -> jax.Array:
        """The twist ``(3,)`` from one position and rotation to another."""
        a, b = start[1].columns[0], end[1].columns[0]
        turn = jnp.arctan2(a.x * b.y - a.y * b.x, a.dot(b))
        return jnp.stack([*(end[0] - start[0]).components, turn])

    @staticmethod
    def rates_to_twist(pose: jax.Array) -> jax.Array:
        """Identity: the rates of a planar pose are its twist."""
        return jnp.eye(3, dtype=pose.dtype)


def position_size(space: Space) -> int:
    """Number of coordinates of a position, free or not: two in the plane, three in space."""
    pose = jax.ShapeDtypeStruct((space.dimension,), jnp.zeros(()).dtype)
    return len(jax.eval_shape(space.place, pose)[0].components)


def fit_triangle(corners: Sequence[Vec], points: Sequence[Vec]) -> tuple[Vec, Rotation]:
    """Position and rotation that carry a triangle's corners (platform frame) to points at the same distances."""

    def frame(p: Vec, q: Vec, r: Vec) -> list[Vec]:
        along = q - p
        normal = along.cross(r - p)
        first, third = (v * safe_divide(1, safe_sqrt(v.dot(v))) for v in (along, normal))
        return [first, third.cross(first), third]

    body, world = fence((frame(*corners), frame(*points)))  # every axis would evaluate both anew
    axes = (tuple(f.components[i] for f in body) for i in range(3))
    rotation = Rotation(*(world[0] * a + world[1] * b + world[2] * c for a, b, c in axes))
    return points[0] - rotation @ corners[0], rotation
