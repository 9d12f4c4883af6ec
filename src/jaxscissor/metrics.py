"""What a designer asks of a robot over a set of poses: the worst case, the mean, the strokes, the footprint."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._batching import CHUNK
from jaxscissor._fence import fence
from jaxscissor._legs import place
from jaxscissor._numerics import safe_sqrt
from jaxscissor._program import keyed
from jaxscissor._pytree import pytree
from jaxscissor._samples import checked_sample, each_pose
from jaxscissor.constraints import constrained_pose
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
      poses: ``(n, d)`` poses, or a sample of a region, whose poses are made chunk by chunk so that memory does
        not grow with their number; of an ``Oriented`` region, each with every orientation. They are held fixed.

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
    return _worst(quantity, *_checked(robot, poses))


@keyed
def _worst(quantity: Quantity, robot: Mechanism, sample: Any) -> WorstCase:
    shape = _value_shape(quantity, robot, sample)
    frozen = lax.stop_gradient(robot)

    def keep(turn, best):
        least, numbers = best
        values, here = _values(quantity, frozen, sample, turn)
        values = lax.stop_gradient(jnp.where(jnp.isnan(values), jnp.inf, values))
        lowest, at = jnp.min(values, axis=0), jnp.argmin(values, axis=0)
        return jnp.minimum(least, lowest), jnp.where(lowest < least, here[at], numbers)

    start = jnp.full(shape.shape, jnp.inf, shape.dtype), jnp.zeros(shape.shape, jnp.uint32)
    _, numbers = lax.fori_loop(0, _chunks(sample)[1], keep, start)
    if not shape.shape:
        pose = lax.stop_gradient(sample.pose(numbers))
        return WorstCase(quantity(robot, pose), pose)
    worst = lax.stop_gradient(sample.poses(numbers))
    values = jax.vmap(lambda pose, entry: quantity(robot, pose)[entry])(worst, jnp.arange(len(worst)))
    return WorstCase(values, worst)


def mean_case(quantity: Quantity, robot: Mechanism, poses: Any) -> jax.Array:
    """Mean of a quantity over the poses at which it is defined.

    Args:
      quantity: function of a robot and a pose, ``()`` or ``(k,)``; poses at which it is ``nan`` do not count.
      robot: the robot; every array in it is differentiable.
      poses: ``(n, d)`` poses, or a sample of a region, whose poses are made chunk by chunk so that memory does
        not grow with their number; of an ``Oriented`` region, each with every orientation. They are held fixed.

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
    return _mean(quantity, *_checked(robot, poses))


@keyed
def _mean(quantity: Quantity, robot: Mechanism, sample: Any) -> jax.Array:
    shape = _value_shape(quantity, robot, sample)

    @partial(jax.checkpoint, prevent_cse=False)
    def sums(robot, turn):
        values, _ = _values(quantity, robot, sample, turn)
        defined = ~jnp.isnan(values)
        return jnp.sum(jnp.where(defined, values, 0), axis=0), jnp.sum(defined, axis=0).astype(values.dtype)

    def add(turn, totals):
        return jax.tree.map(jnp.add, totals, sums(robot, turn))

    zero = jnp.zeros(shape.shape, shape.dtype)
    total, count = lax.fori_loop(0, _chunks(sample)[1], add, (zero, zero))
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
      poses: ``(n, d)`` poses, or a sample of a region, whose poses are made chunk by chunk so that memory does
        not grow with their number; of an ``Oriented`` region, each with every orientation. They are held fixed.

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
    """What must not be small at a pose, once its dependent coordinates are solved for."""
    margin, whole = reached_margin(robot, pose), constrained_pose(robot, pose)
    pose = jnp.where(whole.converged, whole.value, lax.stop_gradient(robot.home()[0]))
    solution = inverse_kinematics(robot, pose)
    measures = singularity(robot, pose)
    gears = gear_ratios(robot, pose).translation
    type1, reach = jnp.min(jnp.abs(measures.type1)), _horizontal_reach(robot, pose, solution.value)
    scalars = jnp.stack([gears[0] / gears[-1], type1, jnp.abs(measures.type2), -reach])
    found = jnp.concatenate([scalars, solution.value, -solution.value])
    return jnp.concatenate([margin[None], jnp.where(whole.converged & solution.converged, found, jnp.nan)])


def _horizontal_reach(robot: Mechanism, pose: jax.Array, joints: jax.Array) -> jax.Array:
    placed = place(robot, pose)
    legs = zip(placed.legs, split_joints(robot, joints), placed.attachments, strict=True)
    ends = [end for leg, values, attachment in legs for bar in leg.bars(values, attachment) for end in bar]
    return jnp.max(jnp.stack([safe_sqrt(end.x**2 + end.y**2) for end in ends])) if ends else jnp.zeros_like(pose[0])


def _checked(robot: Mechanism, poses: Any) -> tuple[Mechanism, Any]:
    robot, sample = checked_sample(robot, poses)
    return robot, lax.stop_gradient(each_pose(sample))


def _chunks(sample: Any) -> tuple[int, int]:
    """Size and number of the chunks in which a sample is worked, so that memory does not grow with it."""
    size = min(CHUNK, len(sample))
    return size, -(-len(sample) // size)


def _value_shape(quantity: Quantity, robot: Mechanism, sample: Any) -> jax.ShapeDtypeStruct:
    return jax.eval_shape(lambda: quantity(robot, sample.pose(0)))


def _values(quantity: Quantity, robot: Mechanism, sample: Any, turn: Any) -> tuple[jax.Array, jax.Array]:
    """Values of the poses of a chunk, and their numbers; ``nan`` for those that only fill the last chunk."""
    chunk, _ = _chunks(sample)
    numbers = jnp.asarray(turn).astype(jnp.uint32) * jnp.uint32(chunk) + jnp.arange(chunk, dtype=jnp.uint32)
    counted = numbers < len(sample)
    poses = fence(sample.poses(jnp.where(counted, numbers, 0)))
    return jax.vmap(lambda pose, there: jnp.where(there, quantity(robot, pose), jnp.nan))(poses, counted), numbers
