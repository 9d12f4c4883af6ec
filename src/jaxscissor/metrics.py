"""What a designer asks of a robot over a set of poses: the worst case, the mean, the strokes, the footprint."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._batching import CHUNK
from jaxscissor._legs import place
from jaxscissor._numerics import safe_sqrt
from jaxscissor._pytree import as_floats, pytree
from jaxscissor.dexterity import gear_ratios
from jaxscissor.feasibility import reached_margin
from jaxscissor.kinematics import inverse_kinematics
from jaxscissor.mechanisms._contract import Mechanism, split_joints
from jaxscissor.singularity import singularity

Quantity = Callable[[Mechanism, jax.Array], jax.Array]  # (robot, pose) -> () or (k,), nan where it is not defined


@pytree
class WorstCase:
    """Least values of a quantity, ``()`` or ``(k,)``, and the poses ``(d,)`` or ``(k, d)`` that have them."""

    value: jax.Array
    pose: jax.Array


def worst_case(quantity: Quantity, robot: Mechanism, poses: Any) -> WorstCase:
    """Least value of a quantity over poses, each entry of it for itself, and where it is taken.

    Only the poses found are differentiated, which is the derivative of the least value: it costs no more for
    many poses than for one.

    Args:
      quantity: function of a robot and a pose, ``()`` or ``(k,)``; poses at which it is ``nan`` do not count.
      robot: the robot; every array in it is differentiable.
      poses: ``(n, d)`` poses, or a sample of a region; they are held fixed.

    Returns:
      ``WorstCase``; ``nan`` where the quantity is defined at no pose.

    Raises:
      ValueError: poses of the wrong shape, or none.

    Example:
      >>> import jax.numpy as jnp, jaxscissor as js
      >>> robot = js.NavaroII.prototype()
      >>> task = jnp.array([[45.0, 26.0, 0.1], [45.0, 30.0, 0.2]])
      >>> worst = js.worst_case(lambda robot, pose: js.feasibility(robot, pose).margin, robot, task)
      >>> bool(worst.value >= 0)  # the robot covers the task
      True
    """
    robot, poses = _checked(robot, poses)
    values = lax.map(lambda pose: quantity(lax.stop_gradient(robot), pose), poses, batch_size=CHUNK)
    least = jnp.argmin(jnp.where(jnp.isnan(values), jnp.inf, values), axis=0)
    if values.ndim == 1:
        return WorstCase(quantity(robot, poses[least]), poses[least])
    entries = jnp.arange(values.shape[1])
    worst = jax.vmap(lambda pose, entry: quantity(robot, pose)[entry])(poses[least], entries)
    return WorstCase(worst, poses[least])


def mean_case(quantity: Quantity, robot: Mechanism, poses: Any) -> jax.Array:
    """Mean of a quantity over the poses at which it is defined.

    Args:
      quantity: function of a robot and a pose, ``()`` or ``(k,)``; poses at which it is ``nan`` do not count.
      robot: the robot; every array in it is differentiable.
      poses: ``(n, d)`` poses, or a sample of a region; they are held fixed.

    Returns:
      ``()`` or ``(k,)``; ``nan`` where the quantity is defined at no pose. Poses that become defined as the
      robot changes are no part of the derivative.

    Raises:
      ValueError: poses of the wrong shape, or none.

    Example:
      >>> import jax.numpy as jnp, jaxscissor as js
      >>> robot = js.NavaroII.prototype()
      >>> task = jnp.array([[45.0, 26.0, 0.1], [45.0, 30.0, 0.2]])
      >>> bool(js.mean_case(lambda robot, pose: js.feasibility(robot, pose).margin, robot, task) > 0)
      True
    """
    robot, poses = _checked(robot, poses)
    values = lax.map(jax.checkpoint(lambda pose: quantity(robot, pose)), poses, batch_size=CHUNK)
    defined = ~jnp.isnan(values)
    count = jnp.sum(defined, axis=0).astype(values.dtype)
    total = jnp.sum(jnp.where(defined, values, 0), axis=0)
    return jnp.where(count > 0, total / jnp.maximum(count, 1), jnp.nan)


@pytree
class TaskMetrics:
    """A robot at its worst over the poses of a task; all but the margin over those that the home mode reaches.

    Attributes:
      margin: least feasibility margin; the task is covered where it is >= 0.
      conditioning: least ratio of the smallest to the largest translational gear ratio, between 0 and 1.
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


def task_metrics(robot: Mechanism, poses: Any) -> TaskMetrics:
    """The usual worst cases over the poses of a task, all differentiable by the robot.

    Args:
      robot: the robot; every array in it is differentiable.
      poses: ``(n, d)`` poses, or a sample of a region; they are held fixed.

    Returns:
      ``TaskMetrics``; ``nan``, but for the margin, where the home mode reaches no pose. For other
      quantities, and for the poses at fault, see ``worst_case``.

    Raises:
      ValueError: poses of the wrong shape, or none.

    Example:
      >>> import jax.numpy as jnp, jaxscissor as js
      >>> metrics = js.task_metrics(js.NavaroII.prototype(), jnp.array([[45.0, 26.0, 0.5], [45.0, 30.0, 0.6]]))
      >>> bool(metrics.margin > 0), metrics.greatest_joints.shape
      (True, (6,))
    """
    worst = worst_case(_all_measures, robot, poses).value
    joints = (worst.shape[0] - 5) // 2
    margin, conditioning, type1, type2, reach = worst[:5]
    least, greatest = worst[5 : 5 + joints], -worst[5 + joints :]
    return TaskMetrics(margin, conditioning, type1, type2, least, greatest, -reach)


def _all_measures(robot: Mechanism, pose: jax.Array) -> jax.Array:
    """What must not be small at a pose."""
    solution = inverse_kinematics(robot, pose)
    joints = jnp.where(solution.converged, solution.value, jnp.nan)
    measures = singularity(robot, pose)
    gears = gear_ratios(robot, pose).translation
    reach = jnp.where(solution.converged, _horizontal_reach(robot, pose, solution.value), jnp.nan)
    type1 = jnp.min(jnp.abs(measures.type1))
    scalars = [reached_margin(robot, pose), gears[0] / gears[-1], type1, jnp.abs(measures.type2), -reach]
    return jnp.concatenate([jnp.stack(scalars), joints, -joints])


def _horizontal_reach(robot: Mechanism, pose: jax.Array, joints: jax.Array) -> jax.Array:
    placed = place(robot, pose)
    legs = zip(placed.legs, split_joints(robot, joints), placed.attachments, strict=True)
    ends = [end for leg, values, attachment in legs for bar in leg.bars(values, attachment) for end in bar]
    return jnp.max(jnp.stack([safe_sqrt(end.x**2 + end.y**2) for end in ends])) if ends else jnp.zeros_like(pose[0])


def _checked(robot: Mechanism, poses: Any) -> tuple[Mechanism, jax.Array]:
    robot, poses = as_floats(robot, jnp.asarray(poses))
    if poses.ndim != 2 or not len(poses) or poses.shape[1] != robot.space.dimension:
        raise ValueError(
            f"Got poses of shape {poses.shape}; {type(robot).__name__} expects (n, {robot.space.dimension}) = n times "
            f"({', '.join(robot.space.names)}), at least one."
        )
    return robot, lax.stop_gradient(poses)
