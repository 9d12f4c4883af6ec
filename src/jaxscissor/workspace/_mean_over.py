"""The mean of a quantity over poses."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.programs import keyed
from jaxscissor._engine.types import PyTree
from jaxscissor.regions._samples import AnySample, PosesLike
from jaxscissor.robots._contract import Mechanism
from jaxscissor.workspace._chunked import Quantity, checked, chunks, value_shape, values_of


def mean_over(robot: Mechanism, quantity: Quantity, poses: PosesLike) -> jax.Array:
    """Mean of a quantity over the poses at which it is defined.

    Args:
      robot: the robot; every array in it is differentiable.
      quantity: function of a robot and a pose, ``()`` or ``(k,)``; poses at which it is ``nan`` do not count.
      poses: ``(n, d)`` poses, or a sample of a region, whose poses are made chunk by chunk so that memory does
        not grow with their number; of a ``workspace.Dexterous``
        region, each with every orientation. They are held fixed.

    Returns:
      ``()`` or ``(k,)``; ``nan`` where the quantity is defined at no pose. Poses that become defined as the
      robot changes are no part of the derivative. A quantity that multiplies a ``nan`` by a dimension has a ``nan``
      derivative at such poses: multiply the mean instead. Poses beyond a limit count, unless the quantity is made
      ``nan`` there by ``jnp.where(js.feasibility(robot, pose).feasible, ..., jnp.nan)``.

    Raises:
      ValueError: poses of the wrong shape, or none.

    Example:
      >>> import jax.numpy as jnp, jaxscissor as js
      >>> robot = js.NavaroII.prototype()
      >>> task = jnp.array([[45.0, 26.0, 0.1], [45.0, 30.0, 0.2]])
      >>> bool(js.workspace.mean_over(robot, lambda robot, pose: js.feasibility(robot, pose).margin, task) > 0)
      True
    """
    return _mean(quantity, *checked(robot, poses))


@keyed
def _mean(quantity: Quantity, robot: Mechanism, sample: AnySample) -> jax.Array:
    shape = value_shape(quantity, robot, sample)

    @partial(jax.checkpoint, prevent_cse=False)
    def sums(robot: Mechanism, turn: jax.Array):
        values, _ = values_of(quantity, robot, sample, turn)
        defined = ~jnp.isnan(values)
        return jnp.sum(jnp.where(defined, values, 0), axis=0), jnp.sum(defined, axis=0).astype(values.dtype)

    def add(turn: jax.Array, totals: PyTree):
        return jax.tree.map(jnp.add, totals, sums(robot, turn))

    zero = jnp.zeros(shape.shape, shape.dtype)
    total, count = lax.fori_loop(0, chunks(sample)[1], add, (zero, zero))
    return jnp.where(count > 0, total / jnp.maximum(count, 1), jnp.nan)
