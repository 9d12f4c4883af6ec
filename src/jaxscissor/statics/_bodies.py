"""The bars of a robot as rigid bodies: their masses, where their centers are, and their weight's potential."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxscissor._engine.numerics import Scalar, safe_divide, safe_sqrt
from jaxscissor._engine.vectors import Vec
from jaxscissor.robots._bodies import Connection
from jaxscissor.robots._contract import Attachment, Joints, Leg, Mechanism, joints_by_leg, seen_by_legs
from jaxscissor.robots._over_legs import over_legs
from jaxscissor.statics._materials import Section


class Bodies(NamedTuple):
    """The bars of one leg, or of every leg, stacked.

    Masses, and how far along each bar its center is from its fixed point, ``(bars,)`` each.
    """

    masses: jax.Array
    centers: jax.Array


def bodies_of(robot: Mechanism, section: Section) -> Bodies:
    """The bars of every leg, stacked, with the lengths that they have at home; of legs that draw none, none.

    Raises:
      ValueError: legs of different kinds, whose bars are not known to be rigid.
    """
    if robot.legs().each is not None:
        raise ValueError(
            f"Got a section for a {type(robot).__name__} with legs of different kinds, which do not say how their bars "
            "hang together; expected no section: their bars weigh nothing."
        )
    pose, joints = robot.home()

    def of_leg(leg: Leg, *case: Any) -> Bodies:
        if not _count(leg, *case):
            return Bodies(jnp.zeros(0, joints.dtype), jnp.zeros(0, joints.dtype))
        starts, ends = bar_ends(leg, *case)
        lengths, along = _lengths_and_directions(starts, ends)
        centers = jnp.zeros_like(lengths)
        if _telescopic(leg, *case):
            centers = jnp.sum(((starts + ends) / 2 - _fixed_points(leg, *case)) * along, axis=1)
        return Bodies(section.mass_per_length * lengths, centers)

    seen = seen_by_legs(robot, *robot.space.place(pose))
    return over_legs(of_leg, robot.legs(), joints_by_leg(robot, joints), seen)


def bar_ends(leg: Leg, joints: Joints, attachment: Attachment) -> jax.Array:
    """Where the bars start and end, in the base frame ``(2, bars, 3)``; those of the plane have a height of zero."""
    bars = leg.bars(joints, attachment)
    return jnp.stack([jnp.stack([in_space(bar[side]) for bar in bars]) for side in (0, 1)])


def centers_of(leg: Leg, joints: Joints, attachment: Attachment, bodies: Bodies) -> jax.Array:
    """Where the bars' centers are ``(bars, 3)``."""
    starts, ends = bar_ends(leg, joints, attachment)
    if not _telescopic(leg, joints, attachment):
        return (starts + ends) / 2
    _, along = _lengths_and_directions(starts, ends)
    return _fixed_points(leg, joints, attachment) + along * bodies.centers[:, None]


def weight_potential(leg: Leg, joints: Joints, attachment: Attachment, bodies: Bodies, gravity: jax.Array) -> Scalar:
    """Potential energy of the bars of one leg."""
    if not _count(leg, joints, attachment):
        return jnp.zeros_like(joints[0])
    return -jnp.sum(bodies.masses[:, None] * centers_of(leg, joints, attachment, bodies) * gravity[None])


def in_space(vector: Vec) -> jax.Array:
    """Three components; a vector of the plane has a height of zero."""
    values = vector.array()
    return values if values.shape[0] == 3 else jnp.concatenate([values, jnp.zeros_like(values[:1])])


def _fixed_points(leg: Leg, joints: Joints, attachment: Attachment) -> jax.Array:
    """Of every bar a point fixed on it ``(bars, 3)``: where it is held without a slide, or its middle."""
    points = jnp.mean(bar_ends(leg, joints, attachment), axis=0)
    for connection in reversed(leg.connections(joints, attachment)):  # so that the first one of a bar counts
        for bar in {connection.first, connection.second}:
            if bar >= 0 and not _slides(connection):
                points = points.at[bar].set(in_space(connection.point))
    return points


def _count(leg: Leg, joints: Joints, attachment: Attachment) -> int:
    return len(jax.eval_shape(lambda leg, *at: tuple(leg.bars(*at)), leg, joints, attachment))


def _telescopic(leg: Leg, joints: Joints, attachment: Attachment) -> bool:
    """Whether a bar slides on another, so that one may be drawn longer as the leg stretches."""
    found = jax.eval_shape(lambda leg, *at: tuple(leg.connections(*at)), leg, joints, attachment)
    return any(min(connection.first, connection.second) >= 0 and _slides(connection) for connection in found)


def _slides(connection: Connection) -> bool:
    return any(freedom.kind == "slide" for freedom in connection.freedoms)


def _lengths_and_directions(starts: jax.Array, ends: jax.Array) -> tuple[jax.Array, jax.Array]:
    lengths = safe_sqrt(jnp.sum((ends - starts) ** 2, axis=1))
    return lengths, (ends - starts) * safe_divide(1, lengths)[:, None]
