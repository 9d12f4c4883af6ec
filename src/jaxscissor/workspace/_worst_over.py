"""The least value of a quantity over poses, and over a whole region by a search."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.programs import keyed
from jaxscissor._engine.pytree import as_floats, pytree
from jaxscissor._engine.types import PyTree
from jaxscissor.regions._regions import Region, Sample
from jaxscissor.regions._samples import AnySample, PosesLike
from jaxscissor.robots._contract import Mechanism
from jaxscissor.workspace._chunked import Quantity, checked, chunks, value_shape, values_of
from jaxscissor.workspace._reached import check_region

_PROBES = 32  # points around the best one, in every step
_SHRINK = 0.7  # of their distance, when none is better


@pytree
class Worst:
    """Least values of a quantity, ``()`` or ``(k,)``, and the poses ``(d,)`` or ``(k, d)`` that have them."""

    value: jax.Array
    pose: jax.Array


def worst_over(
    robot: Mechanism,
    quantity: Quantity,
    poses: PosesLike | Region,
    *,
    samples: int = 2048,
    starts: int = 8,
    steps: int = 200,
) -> Worst:
    """Least value of a quantity over poses or over a whole region, each entry of it for itself, and where it is taken.

    Over a region the best of its samples are followed by a random search that narrows down to rounding and walks along
    the region's edge. The quantity need not be smooth, so margins, singular values and absolute values will do. A
    minimum narrower than the samples' distance can be missed.

    Only the poses found are differentiated, at a fixed place, which is the derivative of the least value (Danskin): it
    costs no more for many poses than for one.

    Args:
      robot: the robot; every array in it is differentiable.
      quantity: function of a robot and a pose, ``()`` or ``(k,)``; poses at which it is ``nan`` do not count.
      poses: ``(n, d)`` poses, or a sample of a region, whose poses are made chunk by chunk so that memory does
        not grow with their number, of a ``workspace.Dexterous`` region each with every orientation; both are held
        fixed. Or a region of poses, which is searched.
      samples: poses of a region at which the search looks first.
      starts: how many of them, the best, are followed.
      steps: of each search.

    Returns:
      ``workspace.Worst``; ``nan`` where the quantity is defined at no pose.

    Raises:
      ValueError: poses of the wrong shape, or none; fewer samples than starts.

    Example:
      >>> import jax.numpy as jnp, jaxscissor as js
      >>> robot = js.NavaroII.prototype()
      >>> task = jnp.array([[45.0, 26.0, 0.1], [45.0, 30.0, 0.2]])
      >>> margin = lambda robot, pose: js.feasibility(robot, pose).margin
      >>> bool(js.workspace.worst_over(robot, margin, task).value >= 0)  # the robot covers the task
      True

      The least height of a region is on its floor:

      >>> region = js.Box([40.0, 20.0, -0.1], [50.0, 30.0, 0.1])
      >>> float(js.workspace.worst_over(robot, lambda robot, pose: pose[1], region).value)
      20.0
    """
    if not isinstance(poses, Region):
        return _worst(quantity, *checked(robot, poses))
    if not 1 <= starts <= samples:
        raise ValueError(f"Got samples={samples} and starts={starts}; expected 1 <= starts <= samples.")
    robot, region = as_floats(robot, poses)
    check_region(robot, region)
    return searched(quantity, robot, region, samples=samples, starts=starts, steps=steps)


@keyed
def _worst(quantity: Quantity, robot: Mechanism, sample: AnySample) -> Worst:
    shape = value_shape(quantity, robot, sample)
    frozen = lax.stop_gradient(robot)

    def keep(turn: jax.Array, best: jax.Array):
        least, numbers = best
        values, here = values_of(quantity, frozen, sample, turn)
        values = lax.stop_gradient(jnp.where(jnp.isnan(values), jnp.inf, values))
        lowest, at = jnp.min(values, axis=0), jnp.argmin(values, axis=0)
        return jnp.minimum(least, lowest), jnp.where(lowest < least, here[at], numbers)

    start = jnp.full(shape.shape, jnp.inf, shape.dtype), jnp.zeros(shape.shape, jnp.uint32)
    _, numbers = lax.fori_loop(0, chunks(sample)[1], keep, start)
    if not shape.shape:
        pose = lax.stop_gradient(sample.pose(numbers))
        return Worst(quantity(robot, pose), pose)
    worst = lax.stop_gradient(sample.poses(numbers))
    values = jax.vmap(lambda pose, entry: quantity(robot, pose)[entry])(worst, jnp.arange(len(worst)))
    return Worst(values, worst)


@keyed
def searched(quantity: Quantity, robot: Mechanism, region: Region, **settings: int) -> Worst:
    """The least of each entry by a search of its own."""
    shape = jax.eval_shape(lambda: quantity(robot, region.from_unit(jnp.full(region.unit_dimension, 0.5)))).shape
    if not shape:
        return _search(quantity, robot, region, **settings)

    def of_entry(entry: jax.Array):
        return _search(lambda robot, pose: quantity(robot, pose)[entry], robot, region, **settings)

    return lax.map(of_entry, jnp.arange(*shape))


def _search(quantity: Any, robot: Mechanism, region: Region, *, samples: int, starts: int, steps: int) -> Worst:
    def value(unit: PyTree):
        found = quantity(robot, region.from_unit(unit))
        return jnp.where(jnp.isnan(found), jnp.inf, found)

    sample = Sample(region, jnp.zeros(region.unit_dimension, jnp.uint32), (), samples)
    units = jax.vmap(sample.unit)(jnp.arange(samples))
    # the place of the minimum stays fixed under differentiation: the search has no derivative
    search, constants = jax.closure_convert(value, units[0])
    constants = lax.stop_gradient(constants)

    def frozen(unit: PyTree):
        return search(unit, *constants)

    first = jax.vmap(frozen)(units)
    best = jnp.argsort(first)[:starts]
    width = jnp.asarray(samples, units.dtype) ** (-1 / units.shape[1])
    ends, values = jax.vmap(lambda unit, least: _narrow(frozen, unit, least, width, steps))(units[best], first[best])
    pose = region.from_unit(ends[jnp.argmin(values)])
    return Worst(quantity(robot, pose), pose)


def _narrow(value: Callable[[jax.Array], jax.Array], unit: PyTree, least: jax.Array, width: Scalar, steps: int):
    """Random search about the best point, in a cube that shrinks whenever it holds nothing better."""

    def step(number: jax.Array, state: PyTree):
        unit, least, width = state
        key = jax.random.fold_in(jax.random.key(0), number)
        probes = unit[None] + width * jax.random.uniform(key, (_PROBES, unit.shape[0]), unit.dtype, -1, 1)
        probes = jnp.clip(probes, 0, 1)
        values = jax.vmap(value)(probes)
        better = jnp.min(values) < least
        unit = jnp.where(better, probes[jnp.argmin(values)], unit)
        return unit, jnp.minimum(jnp.min(values), least), jnp.where(better, width, width * _SHRINK)

    return lax.fori_loop(0, steps, step, (unit, least, width))[:2]
