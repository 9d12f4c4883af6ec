"""The closure residual of a robot at a pose and joints."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_floats
from jaxscissor._engine.types import JointsLike, PoseLike
from jaxscissor.robots._contract import (
    Mechanism,
    checked_joints,
    checked_pose,
    closure,
)


@one_pose()
def residual(robot: Mechanism, pose: PoseLike, *, joints: JointsLike) -> jax.Array:
    """Closure residual of all legs, and of the constraints on the pose after them; dimensionless.

    Args:
      robot: the robot.
      pose: ``(d,)`` in the base frame.
      joints: ``(n,)`` all joints.

    Returns:
      ``(n + constraints,)``, zero where the robot assembles.

    Raises:
      ValueError: wrong shapes.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> pose, joints = robot.home()
      >>> bool(abs(js.residual(robot, pose, joints=joints)).max() < 1e-6)
      True
    """
    robot, pose = checked_pose(robot, pose)
    joints = checked_joints(robot, joints)
    return flat_residual(*as_floats(robot, joints, pose))


def flat_residual(robot: Mechanism, joints: jax.Array, pose: jax.Array) -> jax.Array:
    """``residual`` of arrays whose shapes and dtypes are known to be right."""
    return jnp.stack(closure(robot, robot.legs(), joints, *robot.space.place(pose)))
