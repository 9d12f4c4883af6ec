"""The strokes that a task needs: least and greatest joints over a region."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp

from jaxscissor._engine.programs import program
from jaxscissor._engine.pytree import pytree
from jaxscissor.kinematics._inverse import inverse_kinematics
from jaxscissor.regions._regions import Region
from jaxscissor.robots._contract import Mechanism, angular_joints
from jaxscissor.workspace._worst_over import worst_over


@pytree
class JointRange:
    """Least and greatest value of every joint, each ``(n,)``, and the poses ``(n, d)`` that need them."""

    low: jax.Array
    high: jax.Array
    low_poses: jax.Array
    high_poses: jax.Array


@program("samples", "starts")
def joint_range(robot: Mechanism, region: Region, *, samples: int = 2048, starts: int = 8) -> JointRange:
    """The values that every joint takes over a region: the stroke that a task needs.

    Joints are those of inverse kinematics, whatever the robot's present stroke; poses that the home mode
    does not reach are left out, so check first that the region is reached where that matters.

    Args:
      robot: the robot.
      region: of poses.
      samples: poses at which each search looks first.
      starts: how many of them are followed, per joint and side.

    Returns:
      ``JointRange``, differentiable in the robot and the region. Angles are unwrapped about those of home.

    Raises:
      ValueError: see ``workspace.worst_over``.

    Example:
      The stroke of NaVARo II for a disc of radius 25 with all angles to 90 deg [NAV19 eqs. 13-26]:

      >>> import jaxscissor as js, numpy as np
      >>> robot = js.NavaroII.prototype()
      >>> disc = js.Disc([45.0, 15 * np.sqrt(3)], 25.0, -np.pi / 2, np.pi / 2)
      >>> needed = js.workspace.joint_range(robot, disc)
      >>> print(f"{float(needed.low[1::2].min()):.4f} {float(needed.high[1::2].max()):.4f}")
      9.6410 79.7723
    """
    home = robot.home()[1]
    angular = jnp.array(angular_joints(robot))

    def joints(robot: Mechanism, pose: jax.Array):
        solution = inverse_kinematics(robot, pose)
        away = solution.value - home
        away = jnp.where(angular, away - 2 * math.pi * jnp.round(away / (2 * math.pi)), away)
        return jnp.where(solution.converged, home + away, jnp.nan)

    def least(direction: jax.Array):
        return worst_over(
            robot, lambda robot, pose: direction @ joints(robot, pose), region, samples=samples, starts=starts
        )

    axes = jnp.eye(home.shape[0], dtype=home.dtype)
    found = jax.vmap(least)(jnp.concatenate([axes, -axes]))
    (low, minus_high), (low_poses, high_poses) = (jnp.split(both, 2) for both in (found.value, found.pose))
    return JointRange(low, -minus_high, low_poses, high_poses)
