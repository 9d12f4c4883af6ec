"""How much of a region a robot reaches, softened at the boundary, for tuning by gradient."""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.map_reduce import Execution, differentiable_sum, map_reduce, planned
from jaxscissor._engine.numerics import safe_sqrt
from jaxscissor._engine.pytree import float_dtype, pytree
from jaxscissor._engine.types import Number, PyTree
from jaxscissor.regions._samples import AnySample, PosesLike, without_size
from jaxscissor.robots._contract import Mechanism
from jaxscissor.workspace._reached import checked_sample, sample_margin


def soft_fraction(
    robot: Mechanism,
    poses: PosesLike,
    *,
    sharpness: Number = 200.0,
    execution: Execution = Execution(),
) -> jax.Array:
    """Differentiable fraction: the mean of sigmoid(sharpness * margin) over the poses.

    Its gradient approaches that of the hard fraction as the sharpness grows, with a bias that falls as
    the boundary layer, 1 / sharpness wide, gets thin against the workspace, and a variance that grows as
    fewer poses lie in the layer: of n poses about n / sharpness speak. The default suits 10^5 poses and
    more; the bias then is about two per cent of a derivative, more of small ones (measured: see the README).

    The gradient is accumulated chunk by chunk, so memory does not grow with the number of poses. The
    poses themselves are held fixed. ``workspace.soft_gradient`` tells how far a gradient from so many poses can
    be trusted.

    Args:
      robot: the robot; every array in it is differentiable, twice in forward over reverse mode.
      poses: ``(n, d)`` poses, or a sample of a region.
      sharpness: inverse width of the boundary layer in units of the margin, dimensionless.
      execution: see ``workspace.fraction``. The checkpoint of a gradient is another job than that of the value.

    Returns:
      A scalar between 0 and 1.

    Raises:
      ValueError: see ``workspace.fraction``.

    Example:
      >>> import jax, jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> sample = js.Cylinder(robot.length / 2, robot.length).quasi_random(4096)
      >>> gradient = jax.grad(js.workspace.soft_fraction)(robot, sample)
      >>> bool(gradient.link_lengths[0] > 0)  # a longer lowest bar widens the workspace
      True
    """
    robot, sample = checked_sample(robot, poses)
    plan = planned(len(sample), execution)
    sharpness = lax.stop_gradient(jnp.asarray(sharpness, float_dtype(robot)))
    inputs = lax.stop_gradient({"sample": without_size(sample), "sharpness": sharpness})
    return differentiable_sum(_add_soft, _add_soft_gradient, None, plan, robot, inputs) / plan.size


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


def soft_gradient(
    robot: Mechanism,
    poses: PosesLike,
    *,
    sharpness: Number = 200.0,
    execution: Execution = Execution(),
) -> SoftGradient:
    """Gradient of ``workspace.soft_fraction`` by the robot, with its standard error from the sample itself.

    The gradient is a mean over the poses, and its error is the standard error of that mean, sqrt(variance / n).
    It tells what other poses of the same number would change, not the bias of the finite sharpness.

    Args:
      robot, poses, sharpness, execution: see ``workspace.soft_fraction``.

    Returns:
      ``SoftGradient``. The error holds for independent poses; of a quasi-random sample it is an upper estimate,
      and ``nan`` of a single pose.

    Raises:
      ValueError: see ``workspace.soft_fraction``.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> region = js.Cylinder(robot.length / 2, robot.length)
      >>> for poses in (1_000, 100_000):
      ...     found = js.workspace.soft_gradient(robot, region.quasi_random(poses))
      ...     print(f"{float(found.gradient.link_lengths[0]):.2f} +- {float(found.error.link_lengths[0]):.2f}")
      0.41 +- 0.22
      1.14 +- 0.05
    """
    robot, sample = checked_sample(robot, poses)
    plan = planned(len(sample), execution)
    zero = jnp.zeros((), float_dtype(robot))
    nothing = jax.tree.map(jnp.zeros_like, robot)
    inputs = {"design": robot, "sample": without_size(sample), "sharpness": zero + sharpness}
    value, total, squares = map_reduce(_add_soft_moments, None, plan, (zero, nothing, nothing), inputs)
    n = plan.size

    def error(total: PyTree, squares: jax.Array):
        variance = jnp.maximum(squares / n - (total / n) ** 2, 0)
        return safe_sqrt(variance / (n - 1)) if n > 1 else jnp.full_like(total, jnp.nan)

    return SoftGradient(value / n, jax.tree.map(lambda g: g / n, total), jax.tree.map(error, total, squares))


def _add_soft(_: object, total: PyTree, *case, design: PyTree, sample: AnySample, sharpness: jax.Array) -> jax.Array:
    return total + _soft_sum(design, sample, sharpness, *case)


def _add_soft_gradient(_: object, totals: PyTree, *case, design: PyTree, sample: AnySample, sharpness: jax.Array):
    return jax.tree.map(jnp.add, totals, jax.value_and_grad(_soft_sum)(design, sample, sharpness, *case))


def _add_soft_moments(
    _: object,
    totals: PyTree,
    indices: jax.Array,
    counted: jax.Array,
    *,
    design: PyTree,
    sample: AnySample,
    sharpness: jax.Array,
):
    """Add the values, the gradients of single poses and the squares of these."""

    def of_pose(robot: Mechanism, pose: jax.Array):
        return _smooth_step(sharpness * sample_margin(robot, sample, pose))

    poses = sample.poses(indices)
    values, gradients = jax.vmap(jax.value_and_grad(of_pose), (None, 0))(design, poses)
    both = values, gradients, jax.tree.map(jnp.square, gradients)

    def add(total: PyTree, found: PyTree):
        there = counted.reshape(counted.shape + (1,) * (found.ndim - 1))
        return total + jnp.sum(jnp.where(there, found, 0), axis=0)

    return jax.tree.map(add, totals, both)


def _soft_sum(
    robot: Mechanism, sample: AnySample, sharpness: jax.Array, indices: jax.Array, counted: jax.Array
) -> jax.Array:
    poses = sample.poses(indices)
    # fenced, as the step and its derivative would each evaluate the margins
    margins = fence(jax.vmap(lambda pose: sample_margin(robot, sample, pose))(poses))
    soft = _smooth_step(sharpness * margins)
    return jnp.sum(jnp.where(counted, soft, 0))


def _smooth_step(x: jax.Array) -> jax.Array:
    """Logistic step whose slope has no second moment, so that a curved boundary is not displaced by it."""
    s = jax.nn.sigmoid(x)
    return s - math.pi**2 / 6 * s * (1 - s) * (1 - 2 * s)
