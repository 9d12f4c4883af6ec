"""Poses of robots whose platform cannot move freely: the dependent coordinates from the others."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from jaxscissor._engine.newton import implicit, newton
from jaxscissor._engine.numerics import Scalar, default_tol
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.types import PoseLike, PyTree
from jaxscissor.kinematics._solution import Solution, Status
from jaxscissor.robots._contract import Joints, Mechanism, checked_pose, constraints_on


@one_pose()
def constrained_pose(robot: Mechanism, pose: PoseLike) -> Solution:
    """The pose that meets the robot's constraints, with the independent coordinates of a given one.

    The coordinates that the robot names as ``dependent`` are solved for by Newton's method, starting from
    the given ones: the parasitic motion of a robot of lower mobility. Workspace functions and pictures do
    this to every pose of theirs.

    Args:
      robot: the robot; every array in it is differentiable.
      pose: ``(d,)`` in the base frame.

    Returns:
      ``Solution`` whose ``value`` is the pose ``(d,)``; ``CONVERGED``, ``MAX_STEPS`` or ``NONFINITE``. A robot
      without dependent coordinates gives the pose back.

    Raises:
      ValueError: wrong shape of the pose, a dependent coordinate that the pose has not, or not as many
        constraints as dependent coordinates.

    Example:
      A robot without dependent coordinates; ``examples/02_your_own_robot.ipynb`` has one with three:

      >>> import jaxscissor as js
      >>> js.constrained_pose(js.NavaroII.prototype(), [45.0, 26.0, 0.1]).value.round(3).tolist()
      [45.0, 26.0, 0.1]
    """
    robot, pose = checked_pose(robot, pose)
    if not set(robot.dependent) <= set(robot.space.names):
        raise ValueError(f"Got dependent = {robot.dependent}; expected some of {robot.space.names}.")
    places = tuple(robot.space.names.index(name) for name in robot.dependent)
    equations = len(jax.eval_shape(lambda: constraints_on(robot, *robot.space.place(pose))))
    if places and equations != len(places):
        raise ValueError(
            f"Got {equations} constraints for the dependent coordinates {robot.dependent}; expected as many. Name in "
            f"{type(robot).__name__}.dependent the coordinates that its constraints determine."
        )
    return _constrained_pose(robot, pose, places)


def _residual(unknowns: Joints, args: PyTree) -> Joints:
    robot, pose, scales = args
    for name, value, scale in zip(robot.dependent, unknowns, scales, strict=True):
        pose = pose.at[robot.space.names.index(name)].set(value * scale)
    return constraints_on(robot, *robot.space.place(pose))


def _constrained_pose(robot: Mechanism, pose: jax.Array, places: tuple[int, ...]) -> Solution:
    finite = jnp.all(jnp.isfinite(pose))
    safe = jnp.where(finite, pose, robot.home()[0])
    scales = [robot.length if i < robot.space.translations else jnp.ones_like(robot.length) for i in places]
    start = tuple(safe[i] / scale for i, scale in zip(places, scales, strict=True))
    args, tol = (robot, safe, scales), default_tol(pose.dtype)
    error: Scalar = jnp.zeros_like(safe[0])
    steps: Scalar = jnp.int32(0)
    value = safe
    if places:
        root, error, steps = newton(_residual, start, args, tol=tol, max_steps=30)
        root = implicit(_residual, root, error <= tol, args)
        for i, unknown, scale in zip(places, root, scales, strict=True):
            value = value.at[i].set(unknown * scale)
    status = jnp.where(error <= tol, Status.CONVERGED, Status.MAX_STEPS)
    return Solution(
        value=jnp.where(finite, value, jnp.nan),
        status=jnp.where(finite, status, Status.NONFINITE).astype(jnp.int32),
        residual_norm=error,
        num_steps=steps,
    )
