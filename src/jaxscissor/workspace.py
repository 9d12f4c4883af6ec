"""How much of a region a robot reaches: hard, for reporting, and softened, for tuning."""

from __future__ import annotations

import math
import os
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.sharding import Mesh

from jaxscissor._fence import fence
from jaxscissor._pytree import float_dtype, pytree
from jaxscissor._samples import checked_sample, without_size
from jaxscissor._sweep import Plan, add_up, planned
from jaxscissor.mechanisms._contract import Mechanism


def workspace_fraction(
    robot: Mechanism,
    poses: Any,
    *,
    chunk_size: int | None = None,
    mesh: Mesh | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> jax.Array:
    """Fraction of poses that the robot reaches in its home mode within all limits.

    Args:
      robot: the robot. The fraction is a count, so its derivative is zero: see
        ``soft_workspace_fraction``.
      poses: ``(n, d)`` poses, or a sample of a region, whose poses are made chunk by chunk so that memory
        does not grow with their number; of an ``Oriented`` region, positions are counted.
      chunk_size: poses evaluated together; for a batch of robots (``vmap``) divide it by their number.
      mesh: every device of it works chunks of its own, on many hosts too, and the counts are added up at
        the end. All processes call with the same arguments. Stored poses are copied to every device.
      checkpoint: path of an ``.npz`` file, replaced after every block of 64 chunks per device. A job that
        was stopped goes on from there when called again; a finished one is read.

    Returns:
      The fraction, a scalar. Poses that are not finite count as not reached.

    Raises:
      ValueError: poses of the wrong shape, or none; a checkpoint of another robot, sample or chunk size, or
        one under ``jit`` or ``vmap``.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> sample = js.Cylinder(robot.length / 2, robot.length).quasi_random(20_000)
      >>> round(float(js.workspace_fraction(robot, sample)), 2)
      0.29
    """
    robot, sample = checked_sample(robot, poses)
    plan = planned(len(sample), chunk_size, mesh, checkpoint)
    reached = add_up(_count, None, plan, jnp.uint32(0), {"robot": robot, "sample": without_size(sample)})
    return reached.astype(float_dtype(robot)) / len(sample)


def soft_workspace_fraction(
    robot: Mechanism,
    poses: Any,
    *,
    sharpness: Any = 200.0,
    chunk_size: int | None = None,
    mesh: Mesh | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> jax.Array:
    """Differentiable fraction: the mean of sigmoid(sharpness * margin) over the poses.

    Its gradient approaches that of the hard fraction as the sharpness grows, with a bias that falls as
    the boundary layer, 1 / sharpness wide, gets thin against the workspace, and a variance that grows as
    fewer poses lie in the layer: of n poses about n / sharpness speak. The default suits 10^5 poses and
    more; the bias then is about two per cent of a derivative, more of small ones (measured: see the README).

    The gradient is accumulated chunk by chunk, so memory does not grow with the number of poses. The
    poses themselves are held fixed. ``soft_workspace_gradient`` tells how far a gradient from so many poses can
    be trusted.

    Args:
      robot: the robot; every array in it is differentiable, twice in forward over reverse mode.
      poses: ``(n, d)`` poses, or a sample of a region.
      sharpness: inverse width of the boundary layer in units of the margin, dimensionless.
      chunk_size, mesh, checkpoint: as of ``workspace_fraction``. The checkpoint of a gradient is another
        job than that of the value.

    Returns:
      A scalar between 0 and 1.

    Raises:
      ValueError: as of ``workspace_fraction``.

    Example:
      >>> import jax, jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> sample = js.Cylinder(robot.length / 2, robot.length).quasi_random(4096)
      >>> gradient = jax.grad(js.soft_workspace_fraction)(robot, sample)
      >>> bool(gradient.link_lengths[0] > 0)  # a longer lowest bar widens the workspace
      True
    """
    robot, sample = checked_sample(robot, poses)
    plan = planned(len(sample), chunk_size, mesh, checkpoint)
    sharpness = jnp.asarray(sharpness, float_dtype(robot))
    return _soft(plan, robot, lax.stop_gradient(without_size(sample)), lax.stop_gradient(sharpness))


@pytree
class SoftGradient:
    """A soft fraction, its gradient, and how uncertain that is.

    Attributes:
      value: the fraction.
      gradient: a robot of derivatives, those that ``jax.grad`` gives.
      error: a robot of standard errors, each in the unit of its derivative.
    """

    value: jax.Array
    gradient: Any
    error: Any


def soft_workspace_gradient(
    robot: Mechanism,
    poses: Any,
    *,
    sharpness: Any = 200.0,
    chunk_size: int | None = None,
    mesh: Mesh | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> SoftGradient:
    """Gradient of ``soft_workspace_fraction`` by the robot, with its standard error from the sample itself.

    The gradient is a mean over the poses, and its error is the standard error of that mean, sqrt(variance / n).
    It tells what other poses of the same number would change, not the bias of the finite sharpness.

    Args:
      robot, poses, sharpness, chunk_size, mesh, checkpoint: as of ``soft_workspace_fraction``.

    Returns:
      ``SoftGradient``. The error holds for independent poses; of a quasi-random sample it is an upper estimate,
      and ``nan`` of a single pose.

    Raises:
      ValueError: as of ``soft_workspace_fraction``.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> region = js.Cylinder(robot.length / 2, robot.length)
      >>> for poses in (1_000, 100_000):
      ...     found = js.soft_workspace_gradient(robot, region.quasi_random(poses))
      ...     print(f"{float(found.gradient.link_lengths[0]):.2f} +- {float(found.error.link_lengths[0]):.2f}")
      0.41 +- 0.22
      1.14 +- 0.05
    """
    robot, sample = checked_sample(robot, poses)
    plan = planned(len(sample), chunk_size, mesh, checkpoint)
    zero = jnp.zeros((), float_dtype(robot))
    nothing = jax.tree.map(jnp.zeros_like, robot)
    job = {"robot": robot, "sample": without_size(sample), "sharpness": zero + sharpness}
    value, total, squares = add_up(_add_soft_moments, None, plan, (zero, nothing, nothing), job)
    n = plan.size

    def error(total, squares):
        variance = jnp.maximum(squares / n - (total / n) ** 2, 0)
        return jnp.sqrt(variance / (n - 1)) if n > 1 else jnp.full_like(total, jnp.nan)

    return SoftGradient(value / n, jax.tree.map(lambda g: g / n, total), jax.tree.map(error, total, squares))


def _count(_, total, numbers, counted, robot, sample) -> jax.Array:
    reached = jax.vmap(lambda pose: sample.margin(robot, pose) >= 0)(fence(sample.poses(numbers)))
    return total + jnp.sum(reached & counted, dtype=jnp.uint32)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _soft(plan: Plan, robot, sample, sharpness) -> jax.Array:
    job = {"robot": robot, "sample": sample, "sharpness": sharpness}
    return add_up(_add_soft, None, plan, jnp.zeros_like(sharpness), job) / plan.size


@_soft.defjvp
def _soft_jvp(plan, primals, tangents):
    """Value and derivative with the reverse pass inside each chunk: nothing is kept between chunks."""
    robot, sample, sharpness = primals
    start = (jnp.zeros_like(sharpness), jax.tree.map(jnp.zeros_like, robot))
    job = {"robot": robot, "sample": sample, "sharpness": sharpness}
    value, gradient = add_up(_add_soft_gradient, None, plan, start, job)
    products = jax.tree.map(lambda g, t: jnp.sum(g * t), gradient, tangents[0])
    return value / plan.size, sum(jax.tree.leaves(products)) / plan.size


def _add_soft(_, total, *case, robot, sample, sharpness) -> jax.Array:
    return total + _soft_sum(robot, sample, sharpness, *case)


def _add_soft_gradient(_, totals, *case, robot, sample, sharpness):
    return jax.tree.map(jnp.add, totals, jax.value_and_grad(_soft_sum)(robot, sample, sharpness, *case))


def _add_soft_moments(_, totals, numbers, counted, *, robot, sample, sharpness):
    """Add the values, the gradients of single poses and the squares of these."""

    def of_pose(robot, pose):
        return _smooth_step(sharpness * sample.margin(robot, pose))

    poses = fence(sample.poses(numbers))
    values, gradients = jax.vmap(jax.value_and_grad(of_pose), (None, 0))(robot, poses)
    both = values, gradients, jax.tree.map(jnp.square, gradients)

    def add(total, found):
        there = counted.reshape(counted.shape + (1,) * (found.ndim - 1))
        return total + jnp.sum(jnp.where(there, found, 0), axis=0)

    return jax.tree.map(add, totals, both)


def _soft_sum(robot, sample, sharpness, numbers, counted) -> jax.Array:
    poses = fence(sample.poses(numbers))
    margins = fence(jax.vmap(lambda pose: sample.margin(robot, pose))(poses))
    soft = _smooth_step(sharpness * margins)
    return jnp.sum(jnp.where(counted, soft, 0))


def _smooth_step(x: jax.Array) -> jax.Array:
    """Logistic step whose slope has no second moment, so that a curved boundary is not displaced by it."""
    s = jax.nn.sigmoid(x)
    return s - math.pi**2 / 6 * s * (1 - s) * (1 - 2 * s)
