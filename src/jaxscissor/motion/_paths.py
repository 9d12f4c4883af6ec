"""Pose paths: straight from one pose to another, and smooth through several."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_floats
from jaxscissor._engine.types import Numbers, PoseLike
from jaxscissor.motion._checks import checked_rows
from jaxscissor.robots._contract import Mechanism, checked_pose


@one_pose("samples")
def straight_line(robot: Mechanism, start: PoseLike, end: PoseLike, *, samples: int = 100) -> jax.Array:
    """Poses on the shortest way from one pose to another: the reference point straight, the turn about one axis.

    Args:
      robot: the robot, of which only the space of poses counts.
      start, end: ``(d,)`` poses in the base frame, turned against each other by less than half a turn.
      samples: how many poses, evenly spread, both ends included.

    Returns:
      ``(samples, d)``.

    Raises:
      ValueError: wrong shape of a pose, or less than two samples.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.NavaroII.prototype()
      >>> for pose in js.motion.straight_line(robot, [45.0, 26.0, 0.0], [45.0, 36.0, 0.5], samples=3):
      ...     print([f"{float(number):.2f}" for number in pose])
      ['45.00', '26.00', '0.00']
      ['45.00', '31.00', '0.25']
      ['45.00', '36.00', '0.50']
    """
    (robot, start), (_, end) = checked_pose(robot, start), checked_pose(robot, end)
    robot, ends = as_floats(robot, jnp.stack(as_floats(start, end)))
    return _through(robot, ends, samples)


@one_pose("samples")
def via_points(robot: Mechanism, poses: Numbers, *, samples: int = 100) -> jax.Array:
    """Poses on a smooth path through given ones, with continuous velocity and acceleration.

    The twists from the first pose to the others are interpolated by the natural cubic spline, with as much of the
    path's parameter between any two: put the poses about evenly, or the path swings out.

    Args:
      robot: the robot, of which only the space of poses counts.
      poses: ``(k, d)`` poses in the base frame, two or more, turned against the first by less than half a turn.
      samples: how many poses, evenly spread in the parameter, both ends included. With a multiple of ``k - 1``
        and one more, the given poses are among them.

    Returns:
      ``(samples, d)``.

    Raises:
      ValueError: wrong shape of the poses, less than two of them, or less than two samples.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.NavaroII.prototype()
      >>> corners = [[40.0, 26.0, 0.1], [45.0, 31.0, 0.1], [50.0, 26.0, 0.1]]
      >>> path = js.motion.via_points(robot, corners, samples=5)
      >>> [f"{float(y):.2f}" for y in path[:, 1]]
      ['26.00', '29.44', '31.00', '29.44', '26.00']
    """
    robot, poses = checked_rows(robot, poses, robot.space.dimension, "poses", robot.space.names, least=2)
    return _through(robot, poses, samples)


def _through(robot: Mechanism, poses: jax.Array, samples: int) -> jax.Array:
    """Samples of the spline in the twists from the first pose: constant weights, as the knots are evenly spread."""
    from scipy.interpolate import CubicSpline

    if samples < 2:
        raise ValueError(f"Got samples={samples}; expected two or more, both ends of the path included.")
    space, last = robot.space, len(poses) - 1
    spline = CubicSpline(np.arange(last + 1), np.eye(last + 1), bc_type="natural")
    weights = jnp.asarray(spline(np.linspace(0, last, samples)), poses.dtype)
    start = space.place(poses[0])
    twists = jax.vmap(lambda pose: space.between(start, space.place(pose)))(poses)

    def moved(weight: jax.Array) -> jax.Array:
        twist = jnp.sum(weight[:, None] * twists, axis=0)
        return jnp.stack(space.coordinates(*space.retract(*start, tuple(twist))))

    return jax.vmap(moved)(weights)
