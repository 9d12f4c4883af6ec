"""A design problem in the unit cube: what every optimizer is given, and what it reports of a step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.pytree import pytree
from jaxscissor._engine.types import PyTree
from jaxscissor.robots._contract import Mechanism

FEASIBLE = 1e-3  # violation that the best design may have
PERIOD = 10  # steps between two updates of an augmented Lagrangian's multipliers, and between two checkpoints

Constraints = tuple[jax.Array, ...]  # values, one vector per constraint, satisfied where >= 0
Evaluate = Callable[[Any, Any, Any], tuple[jax.Array, Constraints]]
"""(unit, start_args, shared_args) -> objective and constraints at a point of the unit cube."""


@pytree
class Incumbent:
    """The best design of every start so far: where in the unit cube, its objective and largest violation."""

    units: Any
    objective: Any
    violation: Any


class StepInfo(NamedTuple):
    """What a step finds where it begins, per start."""

    objective: Any
    violation: Any
    multipliers: Any  # as the constraints suggest them
    gradient: Any  # of the Lagrangian in the unit cube


Step = Callable[[Any, Any, Any, Any], tuple[Any, StepInfo]]
"""(state, start_args, shared_args, update) -> state and info; ``update`` sets an augmented Lagrangian's multipliers."""


class Solver(NamedTuple):
    """An optimizer for one problem: all starts together, their state on a leading axis."""

    linearize: Callable[..., Any]  # (units, start_args, shared_args) -> ((slopes, rows), (objectives, constraints))
    init: Callable[..., Any]  # (units, start_args, shared_args) -> the state before the first step
    step: Step


def per_start(function: Callable[..., Any], in_axes: tuple[int | None, ...]) -> Callable[..., Any]:
    """As ``jax.vmap``, but a single start is not batched: that would be one more level of tracing."""

    def call(*args: Any) -> Any:
        pairs = list(zip(args, in_axes, strict=True))
        if {leaf.shape[0] for arg, axis in pairs if axis == 0 for leaf in jax.tree.leaves(arg)} != {1}:
            return jax.vmap(function, in_axes)(*args)
        alone = [jax.tree.map(lambda leaf: leaf[0], arg) if axis == 0 else arg for arg, axis in pairs]
        return jax.tree.map(lambda leaf: leaf[None], function(*alone))

    return call


def from_unit(unit: PyTree, low: PyTree, high: PyTree) -> Any:
    """Parameters of a point in the unit cube, never beyond the bounds by rounding."""

    def leaf(u: jax.Array, a: jax.Array, b: jax.Array) -> jax.Array:
        value = a + (b - a) * u
        return value + jax.lax.stop_gradient(jnp.clip(value, a, b) - value)  # a clipped number would have half a slope

    return jax.tree.map(leaf, unit, low, high)


def to_units(params: PyTree, low: PyTree, high: PyTree) -> Any:
    """A design scaled to the unit cube, on a leading axis of length one."""

    def leaf(value: jax.Array, a: jax.Array, b: jax.Array) -> jax.Array:
        wide = b > a
        return jnp.where(wide, (value - a) / jnp.where(wide, b - a, 1), 0)[None]

    return jax.tree.map(leaf, params, low, high)


def random_units(like: PyTree, count: int, generator: np.random.Generator) -> Any:
    """Random designs in the unit cube, on a leading axis."""
    return jax.tree.map(lambda leaf: jnp.asarray(generator.random((count, *leaf.shape[1:])), leaf.dtype), like)


def constraint_values(
    constraints: Sequence[Callable[[Any], Any]], robot: Mechanism, at: Sequence[jax.Array] = ()
) -> Constraints:
    """The entries of every constraint, of those throughout a region at the poses ``at`` of each.

    Raises:
      ValueError: a constraint that gives no real numbers.
    """
    found, poses = [], iter(at)
    for index, constraint in enumerate(constraints):
        throughout: Any = getattr(constraint, "at", None)
        if throughout and len(at) == 0:
            raise ValueError("Got a Throughout, which only design.optimize can keep; expected functions of a robot.")
        value = throughout(robot, next(poses)) if throughout else constraint(robot)
        values = jnp.ravel(jnp.asarray(value))
        if not jnp.issubdtype(values.dtype, jnp.floating):
            raise ValueError(
                f"Got constraint {index} of dtype {values.dtype}; expected real numbers that are >= 0 where it is "
                "kept: a margin, not whether there is one."
            )
        found.append(values)
    return tuple(found)


def concatenated(constraints: Constraints) -> jax.Array:
    """All entries of all constraints."""
    return jnp.concatenate(constraints) if constraints else jnp.zeros(0)


def leaves_cube(gradient: Any, unit: PyTree) -> Any:
    """Whether descent along a gradient would leave the unit cube, entry by entry."""
    return ((unit <= 0) & (gradient > 0)) | ((unit >= 1) & (gradient < 0))
