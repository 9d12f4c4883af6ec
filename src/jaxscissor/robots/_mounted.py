"""A robot on a base that stands anywhere in the world: on a cart, on a wall, on another robot's platform."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp

from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_floats, float_dtype, is_concrete, pytree, quantity, static
from jaxscissor._engine.types import Numbers
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._bodies import Connection, Freedom
from jaxscissor.robots._contract import Attachment, Joints, Leg, LegKind, Mechanism
from jaxscissor.robots._spaces import SE2, SE3, position_size

_WORLDS = {2: SE2, 3: SE3}  # by the size of a position


@pytree
class Base:
    """A frame in the world."""

    origin: Vec
    axes: Rotation

    def out(self, point: Vec) -> Vec:
        """A point of the base, in the world."""
        return self.origin + self.axes @ point

    def into(self, point: Vec) -> Vec:
        """A point of the world, in the base."""
        return self.unturned(point - self.origin)

    def unturned(self, direction: Vec) -> Vec:
        """A direction of the world, in the base."""
        return Vec(*(axis.dot(direction) for axis in self.axes.columns))


@pytree
class MountedLeg(Leg):
    """A leg that sees the platform in the world and knows its own place there.

    Attributes:
      leg: the leg, in the frame of its base.
      base: where that is.
      points: of every vector that the leg sees, whether it is a point; the others are directions.
    """

    leg: Any
    base: Base
    points: tuple[bool, ...] = static()

    @property
    def actuated(self) -> tuple[bool, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The leg's."""
        return self.leg.actuated

    @property
    def angular(self) -> tuple[bool, ...] | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The leg's."""
        return self.leg.angular

    @property
    def limits(self) -> tuple[str, ...] | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The leg's."""
        return self.leg.limits

    @property
    def each(self) -> tuple[LegKind, ...] | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The leg's."""
        return self.leg.each

    def alone(self, number: int) -> Leg:
        """The leg's."""
        return dataclasses.replace(self, leg=self.leg.alone(number))

    def residual(self, joints: Joints, attachment: Attachment) -> Joints:
        """The leg's, as are all that follow."""
        return self.leg.residual(joints, self._seen(attachment))

    def start(self, attachment: Attachment) -> tuple[Joints, Scalar | None]:
        """The leg's."""
        return self.leg.start(self._seen(attachment))

    def margins(self, joints: Joints, attachment: Attachment) -> Sequence[Scalar]:
        """The leg's."""
        return self.leg.margins(joints, self._seen(attachment))

    def mode(self, joints: Joints, attachment: Attachment) -> Scalar:
        """The leg's."""
        return self.leg.mode(joints, self._seen(attachment))

    def solutions(self, attachment: Attachment) -> tuple[Sequence[Joints], Sequence[Scalar]] | None:
        """The leg's."""
        return self.leg.solutions(self._seen(attachment))

    def assembles(self, attachment: Attachment) -> Scalar | None:
        """The leg's."""
        return self.leg.assembles(self._seen(attachment))

    def closes(self, joints: Joints) -> Scalar:
        """The leg's."""
        return self.leg.closes(joints)

    def constraints(self, joints: Joints, attachment: Attachment) -> Sequence[Scalar]:
        """The leg's."""
        return self.leg.constraints(joints, self._seen(attachment))

    def bars(self, joints: Joints, attachment: Attachment) -> Sequence[tuple[Vec, Vec]]:
        """The leg's, in the world."""
        return [self._out(bar) for bar in self.leg.bars(joints, self._seen(attachment))]

    def rails(self, joints: Joints, attachment: Attachment) -> Sequence[tuple[Vec, Vec]]:
        """The leg's, in the world."""
        return [self._out(rail) for rail in self.leg.rails(joints, self._seen(attachment))]

    def connections(self, joints: Joints, attachment: Attachment) -> Sequence[Connection]:
        """The leg's, in the world."""
        return [self._moved(one) for one in self.leg.connections(joints, self._seen(attachment))]

    def _seen(self, attachment: Attachment) -> Attachment:
        return _by_kind(attachment, self.points, self.base.into, self.base.unturned)

    def _out(self, segment: tuple[Vec, Vec]) -> tuple[Vec, Vec]:
        return self.base.out(segment[0]), self.base.out(segment[1])

    def _moved(self, one: Connection) -> Connection:
        freedoms = [
            Freedom(f.kind, None if f.axis is None else self.base.axes @ f.axis, f.joints, f.geared)
            for f in one.freedoms
        ]
        return Connection(one.first, one.second, self.base.out(one.point), tuple(freedoms))


@pytree
class Mounted(Mechanism):
    """A robot whose base stands at a pose in the world; its own poses are in the world too. See ``robots.mounted``.

    Attributes:
      robot: the robot.
      base: ``(6,)`` pose of its base frame (x, y, z, roll, pitch, yaw), of a planar robot ``(3,)``.
      points: see ``MountedLeg``.
    """

    robot: Any
    base: Any = quantity("m, rad")
    points: tuple[bool, ...] = static()

    @property
    def space(self) -> Any:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The robot's."""
        return self.robot.space

    @property
    def dependent(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The robot's."""
        return self.robot.dependent

    @property
    def joint_order(self) -> tuple[int, ...] | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The robot's."""
        return self.robot.joint_order

    @property
    def length(self) -> Scalar:
        """The robot's."""
        return self.robot.length

    def legs(self) -> MountedLeg:
        """The robot's legs, each on the base."""
        legs, base = self.robot.legs(), self._base()
        count = jax.tree.leaves(legs)[0].shape[0]
        return MountedLeg(legs, jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (count,)), base), self.points)

    def attachments(self, position: Vec, rotation: Rotation) -> list[Attachment]:
        """What the robot's legs see of the platform, in the world."""
        base = self._base()
        seen = self.robot.attachments(*self._in_base(position, rotation))
        return [_by_kind(one, self.points, base.out, base.axes.__matmul__) for one in seen]

    def actuation(self) -> tuple[tuple[bool, ...], ...]:
        """The robot's."""
        return self.robot.actuation()

    def constraints(self, position: Vec, rotation: Rotation) -> Sequence[Scalar]:
        """The robot's."""
        return self.robot.constraints(*self._in_base(position, rotation))

    @one_pose()
    def home(self) -> tuple[jax.Array, jax.Array]:
        """The robot's home, in the world."""
        pose, joints = self.robot.home()
        return self._in_world(pose), joints

    def assemblies(self, joints: jax.Array) -> tuple[jax.Array, jax.Array] | None:
        """The robot's, in the world."""
        known = self.robot.assemblies(joints)
        return None if known is None else (jax.vmap(self._in_world)(known[0]), known[1])

    def _base(self) -> Base:
        return Base(*_WORLDS[position_size(self.space)].place(self.base))

    def _in_base(self, position: Vec, rotation: Rotation) -> tuple[Vec, Rotation]:
        """Position and rotation seen from the base; a platform that does not turn is never turned against it."""
        base = self._base()
        if self.space.translations == self.space.dimension:
            return base.into(position), rotation
        return base.into(position), Rotation(*(base.unturned(column) for column in rotation.columns))

    def _in_world(self, pose: jax.Array) -> jax.Array:
        base, (position, rotation) = self._base(), self.space.place(pose)
        if self.space.translations < self.space.dimension:
            rotation = Rotation(*(base.axes @ column for column in rotation.columns))
        return jnp.stack(self.space.coordinates(base.out(position), rotation))

    def __repr__(self) -> str:
        """The robot's table, and where its base is."""
        return f"{self.robot!r}\n  base at {self.base}"


def mounted(robot: Mechanism, base: Numbers) -> Mounted:
    """The robot with its base at a pose in the world: on a cart, a wall, a ceiling, another robot's platform.

    Its poses, bars, rails and forces are in the world then. The base is differentiable as any dimension is: the best
    place for a robot is ``jax.grad`` or ``design.optimize`` by ``base``, and a robot on another one's platform has
    that one's pose as base.

    Args:
      robot: the robot, free in all translations of its space: one with SE3, SE2, R3 or R2, or with a platform that
        turns about one axis, on a base turned about the same (of a base that is traced, that is not checked).
      base: ``(6,)`` pose (x, y, z, roll, pitch, yaw) of the robot's base frame in the world, of a planar robot ``(3,)``
        (x, y, alpha).

    Returns:
      ``robots.Mounted``, with ``robot`` and ``base``.

    Raises:
      ValueError: wrong shape of the base; a robot that is not free in all translations; a turned base whose
        robot's motions are then no longer those of its space; legs that see something else than points and directions.

    Example:
      A hexapod that hangs from a ceiling 3 m up:

      >>> import math
      >>> import jaxscissor as js
      >>> robot = js.robots.mounted(js.StewartGough.prototype(), [0.0, 0.0, 3.0, math.pi, 0.0, 0.0])
      >>> robot.home()[0].round(3).tolist()[2] < 3.0
      True
    """
    (robot, base) = as_floats(robot, jnp.asarray(base))
    size, space = position_size(robot.space), robot.space
    world = _WORLDS[size]
    if base.shape != (world.dimension,):
        names = ", ".join(world.names)
        raise ValueError(f"Got a base of shape {base.shape}; a {type(robot).__name__} expects a pose ({names}).")
    if space.translations != size:
        raise ValueError(
            f"Got a {type(robot).__name__} with pose ({', '.join(space.names)}), which on a moved base is none of its "
            "space. Expected one that is free in all translations: give it SE3 or SE2 and constraints on the pose."
        )
    turns = space.dimension - space.translations
    if 0 < turns < world.dimension - size and is_concrete(base):
        stands = world.place(base)
        kept = space.place(jnp.stack(space.coordinates(*stands)))[1].array()
        if jnp.max(jnp.abs(kept - stands[1].array())) > 16 * jnp.finfo(base.dtype).eps:
            raise ValueError(
                f"Got a base turned by {base[size:]} for a robot whose platform turns by {space.names[-1]} alone; "
                "expected one turned about that axis alone. Give the robot SE3 and constraints on the pose."
            )
    return Mounted(robot, base, _points_seen(robot))


def _points_seen(robot: Mechanism) -> tuple[bool, ...]:
    """Of every vector in what a leg sees, whether it moves along with the platform, as a point does.

    Raises:
      ValueError: it does neither, as a number does, or a point measured from somewhere else than the base's origin.
    """
    size, dtype = position_size(robot.space), float_dtype(robot)
    with jax.ensure_compile_time_eval():
        if not is_concrete(robot):  # which vectors are points is the same for any numbers
            robot = jax.tree.map(lambda leaf: jnp.ones(leaf.shape, leaf.dtype), robot)
        rotation = Rotation(*(Vec(*column) for column in jnp.eye(size, dtype=dtype)))
        still, shifted = (robot.attachments(Vec(*jnp.full(size, by, dtype)), rotation)[0] for by in (0, 1))
    ends = [jax.tree.leaves(seen, is_leaf=_is_vector) for seen in (still, shifted)]
    moves = [_shifts(*pair) for pair in zip(*ends, strict=True)]
    if not all(move in ({0.0}, {1.0}) for move in moves):
        raise ValueError(
            f"The legs of a {type(robot).__name__} see something else of the platform than points and directions in "
            "the base frame. Expected vectors (Vec), so that they can be brought into the world."
        )
    return tuple(move == {1.0} for move in moves)


def _shifts(before: Any, after: Any) -> set[float]:
    """By how much the components of a vector grew, to rounding; nothing of what is no vector."""
    if not (_is_vector(before) and _is_vector(after)):
        return set()
    return {round(float(b) - float(a), 3) for a, b in zip(before.components, after.components, strict=True)}


def _by_kind(
    seen: Attachment, points: tuple[bool, ...], of_point: Callable[[Vec], Vec], of_direction: Callable[[Vec], Vec]
) -> Attachment:
    """Both functions applied to the vectors that they are for."""
    vectors, tree = jax.tree.flatten(seen, is_leaf=_is_vector)
    moved = [of_point(v) if point else of_direction(v) for v, point in zip(vectors, points, strict=True)]
    return jax.tree.unflatten(tree, moved)


def _is_vector(value: Any) -> bool:
    return isinstance(value, Vec)
