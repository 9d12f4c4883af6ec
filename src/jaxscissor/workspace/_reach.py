"""How far a robot goes in a direction, and the heights of its platform retracted and extended."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.bracket import last_inside
from jaxscissor._engine.numerics import Scalar, safe_divide, safe_sqrt
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_floats
from jaxscissor._engine.types import Number, PoseLike, TwistLike
from jaxscissor.kinematics._feasibility import reached_margin
from jaxscissor.robots._contract import Mechanism, checked_pose

_TURN = 2 * math.pi


@one_pose("cells")
def reach_along(
    robot: Mechanism, pose: PoseLike, direction: TwistLike, *, max_distance: Number | None = None, cells: int = 128
) -> jax.Array:
    """How far the platform goes from a pose along a straight line of pose coordinates, within all limits.

    It is the first place at which the margin of ``feasibility`` becomes negative, located to rounding; it moves
    with robot, pose and direction by the implicit function theorem. The margin is sampled at the ends of equal
    cells: an interruption within one of them is missed.

    Args:
      robot: the robot; every array in it is differentiable.
      pose: ``(d,)`` in the base frame, where the line starts.
      direction: ``(d,)`` rates of the pose coordinates; its length is the unit of the result.
      max_distance: how far to look, in that unit; default: until it has moved by two lengths of the robot or turned
        by a full turn.
      cells: number of cells up to there.

    Returns:
      The distance, a scalar; ``inf`` if the robot reaches as far as that, ``nan`` if it does not reach the pose.

    Raises:
      ValueError: wrong shapes, or no cell.

    Example:
      NaVaRO II moves sideways until a leg is at its end:

      >>> import jaxscissor as js
      >>> robot = js.NavaroII.prototype()
      >>> round(float(js.workspace.reach_along(robot, [45.0, 26.0, 0.3], [1.0, 0.0, 0.0])), 3)
      45.659
    """
    robot, pose = checked_pose(robot, pose)
    robot, pose, direction = as_floats(robot, pose, jnp.asarray(direction))
    if direction.shape != pose.shape:
        raise ValueError(f"Got direction {direction.shape}; expected the shape of the pose, {pose.shape}.")
    if cells < 1:
        raise ValueError(f"Got cells={cells}; expected at least one.")
    far = _far(robot, direction) if max_distance is None else max_distance
    limit = lax.stop_gradient(jnp.asarray(far, pose.dtype))
    return _reach(cells, robot, pose, direction, limit)


@one_pose()
def height_range(robot: Mechanism) -> jax.Array:
    """Retracted and extended height: how far the platform goes straight down and up from its home pose.

    Args:
      robot: the robot; every array in it is differentiable.

    Returns:
      Heights ``(2,)`` of the platform's reference point over the base frame's origin; infinite where the
      robot reaches two of its lengths from home, ``nan`` if it does not reach its home pose.

    Raises:
      ValueError: a planar robot.

    Example:
      >>> import jaxscissor as js
      >>> print(js.workspace.height_range(js.TripleScissorExtender.prototype()).round(3))
      [0.312 1.617]
    """
    if "z" not in robot.space.names:
        raise ValueError(f"Got a {type(robot).__name__} with pose ({', '.join(robot.space.names)}); it has no height.")
    (robot,) = as_floats(robot)
    home = robot.home()[0]
    vertical = robot.space.names.index("z")
    up = jnp.zeros_like(home).at[vertical].set(1)
    ways = jax.vmap(partial(reach_along, robot, home))(jnp.stack([-up, up]))
    return home[vertical] + jnp.stack([-ways[0], ways[1]])


def _far(robot: Mechanism, direction: jax.Array) -> Scalar:
    """Where the first of two lengths and a full turn is reached; one if the direction leads nowhere."""
    moves, turns = (jnp.sum(part**2) for part in jnp.split(direction, [robot.space.translations]))
    ends = [
        jnp.where(rate > 0, far / safe_sqrt(rate), jnp.inf) for far, rate in ((2 * robot.length, moves), (_TURN, turns))
    ]
    nearest = jnp.minimum(*ends)
    return jnp.where(jnp.isfinite(nearest), nearest, 1)


def _reach(cells: int, robot: Mechanism, pose: jax.Array, direction: jax.Array, limit: Scalar) -> jax.Array:
    frozen = lax.stop_gradient((robot, pose, direction))
    points = jnp.arange(cells + 1, dtype=pose.dtype) * (limit / cells)
    margins = jax.vmap(partial(_margin, frozen))(points)
    ended = margins < 0
    cell = jnp.maximum(jnp.argmax(ended) - 1, 0)
    found = jnp.any(ended) & ~ended[0]
    margin, ends = partial(_margin, frozen), (points[cell], points[cell + 1], margins[cell], margins[cell + 1])
    point, beyond, left = last_inside(margin, *ends, found)
    share = jnp.clip(-safe_divide(left, jax.grad(margin)(point) * (beyond - point)), 0, 1)
    distance = _crossing((robot, pose, direction), point + share * (beyond - point))
    return jnp.where(ended[0], jnp.nan, jnp.where(found, distance, jnp.inf))


def _margin(line: tuple[Mechanism, jax.Array, jax.Array], point: jax.Array) -> Scalar:
    robot, pose, direction = line
    return reached_margin(robot, pose + point * direction)


@jax.custom_jvp
def _crossing(line: tuple[Mechanism, jax.Array, jax.Array], point: jax.Array) -> jax.Array:
    """A root of the margin along a line, with its derivative by the implicit function theorem."""
    return point


@_crossing.defjvp
def _crossing_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]):
    line, point = primals
    _, moved = jax.jvp(lambda way: _margin(way, point), (line,), (tangents[0],))
    _, slope = jax.jvp(partial(_margin, line), (point,), (jnp.ones_like(point),))
    return _crossing(line, point), -safe_divide(moved, slope)
