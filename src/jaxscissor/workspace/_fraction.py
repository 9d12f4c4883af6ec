"""How much of a region a robot reaches: a count, for reporting."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from jaxscissor._engine.map_reduce import Execution, map_reduce, planned
from jaxscissor._engine.pytree import float_dtype
from jaxscissor._engine.types import PyTree
from jaxscissor.regions._samples import AnySample, PosesLike, without_size
from jaxscissor.robots._contract import Mechanism
from jaxscissor.workspace._reached import checked_sample, sample_margin


def fraction(
    robot: Mechanism,
    poses: PosesLike,
    *,
    execution: Execution = Execution(),
) -> jax.Array:
    """Fraction of poses that the robot reaches in its home mode within all limits.

    Args:
      robot: the robot. The fraction is a count, so its derivative is zero: see
        ``workspace.soft_fraction``.
      poses: ``(n, d)`` poses, or a sample of a region, whose poses are made chunk by chunk so that memory
        does not grow with their number; of a ``workspace.Dexterous`` region, positions are counted.
      execution: in which chunks, on which devices, saved where.

    Returns:
      The fraction, a scalar. Poses that are not finite count as not reached.

    Raises:
      ValueError: poses of the wrong shape, or none; a checkpoint of another robot, sample or chunk size, or
        one under ``jit`` or ``vmap``.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> sample = js.Cylinder(robot.length / 2, robot.length).quasi_random(20_000)
      >>> round(float(js.workspace.fraction(robot, sample)), 2)
      0.29
    """
    robot, sample = checked_sample(robot, poses)
    plan = planned(len(sample), execution)
    reached = map_reduce(_count, None, plan, jnp.uint32(0), {"robot": robot, "sample": without_size(sample)})
    return reached.astype(float_dtype(robot)) / len(sample)


def _count(
    _: object, total: PyTree, indices: jax.Array, counted: jax.Array, robot: Mechanism, sample: AnySample
) -> jax.Array:
    reached = jax.vmap(lambda pose: sample_margin(robot, sample, pose) >= 0)(sample.poses(indices))
    return total + jnp.sum(reached & counted, dtype=jnp.uint32)
