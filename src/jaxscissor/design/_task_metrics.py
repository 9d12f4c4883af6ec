"""The usual worst cases of a robot over the poses of a task."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.numerics import safe_sqrt
from jaxscissor._engine.pytree import pytree
from jaxscissor.kinematics._constraints import constrained_pose
from jaxscissor.kinematics._dexterity import gear_ratios
from jaxscissor.kinematics._feasibility import reached_margin
from jaxscissor.kinematics._inverse import inverse_kinematics
from jaxscissor.kinematics._legs import place
from jaxscissor.regions._samples import PosesLike
from jaxscissor.robots._contract import Mechanism, joints_by_leg
from jaxscissor.robots._over_legs import one_by_one
from jaxscissor.singularities._measures import measures
from jaxscissor.workspace._worst_over import worst_over


@pytree
class TaskMetrics:
    """A robot at its worst over the poses of a task; all but the margin over those that the home mode reaches.

    Attributes:
      margin: least feasibility margin; the task is covered where it is >= 0.
      conditioning: least ratio of the smallest to the largest translational gear ratio, between 0 and 1; of a robot
        that only turns, of the rotational ones.
      type1, type2: least sizes of the singularity measures.
      least_joints, greatest_joints: ``(n,)`` what the task needs of every joint.
      footprint: largest horizontal distance of a bar from the base frame's origin.
    """

    margin: jax.Array
    conditioning: jax.Array
    type1: jax.Array
    type2: jax.Array
    least_joints: jax.Array
    greatest_joints: jax.Array
    footprint: jax.Array


def task_metrics(robot: Mechanism, poses: PosesLike) -> TaskMetrics:
    """The usual worst cases over the poses of a task, all differentiable by the robot.

    Args:
      robot: the robot; every array in it is differentiable.
      poses: ``(n, d)`` poses, or a sample of a region, whose poses are made chunk by chunk so that memory does
        not grow with their number; of a ``workspace.Dexterous``
        region, each with every orientation. They are held fixed.

    Returns:
      ``design.TaskMetrics``; ``nan``, but for the margin, where the home mode reaches no pose. For other
      quantities, and for the poses at fault, see ``workspace.worst_over``.

    Raises:
      ValueError: poses of the wrong shape, or none.

    Example:
      >>> import jax.numpy as jnp, jaxscissor as js
      >>> metrics = js.design.task_metrics(js.NavaroII.prototype(), jnp.array([[45.0, 26.0, 0.5], [45.0, 30.0, 0.6]]))
      >>> bool(metrics.margin > 0), metrics.greatest_joints.shape
      (True, (6,))
    """
    worst = worst_over(robot, _all_measures, poses).value
    joints = (worst.shape[0] - 5) // 2
    margin, conditioning, type1, type2, reach = worst[:5]
    least, greatest = worst[5 : 5 + joints], -worst[5 + joints :]
    return TaskMetrics(margin, conditioning, type1, type2, least, greatest, -reach)


def _all_measures(robot: Mechanism, pose: jax.Array) -> jax.Array:
    """What must not be small at a pose, once its dependent coordinates are solved for."""
    margin, whole = reached_margin(robot, pose), constrained_pose(robot, pose)
    pose = jnp.where(whole.converged, whole.value, lax.stop_gradient(robot.home()[0]))
    solution = inverse_kinematics(robot, pose)
    singular = measures(robot, pose)
    ratios = gear_ratios(robot, pose)
    gears = ratios.translation if robot.space.translations else ratios.rotation
    type1, reach = jnp.min(jnp.abs(singular.type1)), _horizontal_reach(robot, pose, solution.value)
    scalars = jnp.stack([gears[0] / gears[-1], type1, jnp.abs(singular.type2), -reach])
    found = jnp.concatenate([scalars, solution.value, -solution.value])
    return jnp.concatenate([margin[None], jnp.where(whole.converged & solution.converged, found, jnp.nan)])


def _horizontal_reach(robot: Mechanism, pose: jax.Array, joints: jax.Array) -> jax.Array:
    placed = place(robot, pose)
    legs = one_by_one(placed.legs, joints_by_leg(robot, joints), placed.attachments)
    ends = [end for leg, q, seen in legs for bar in leg.bars(q, seen) for end in bar]
    return jnp.max(jnp.stack([safe_sqrt(end.x**2 + end.y**2) for end in ends])) if ends else jnp.zeros_like(pose[0])
