"""Descent in the unit cube under constraints: an augmented Lagrangian, and many starts in one program."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._pytree import pytree

PERIOD = 10  # steps between two updates of the multipliers
ALLOWED = 1e-3  # violation that the best design may have
_PENALTY = 20.0  # weight of a squared violation, for objectives and constraints of order one

Slacks = tuple[jax.Array, ...]  # one vector per constraint
Evaluate = Callable[[Any, Any, Any], tuple[jax.Array, Slacks]]  # (unit, own, shared) -> objective, slacks


@pytree
class Seen:
    """A design of every start: where in the unit cube, its objective and largest violation."""

    units: Any
    objective: Any
    violation: Any


@pytree
class Descent:
    """State of all starts between two steps."""

    units: Any
    memory: Any  # the optimizer's
    multipliers: jax.Array
    best: Seen


class Sight(NamedTuple):
    """What a step sees before it moves, per start."""

    objective: Any
    violation: Any
    multipliers: Any  # as the slacks suggest them
    gradient: Any  # of the Lagrangian in the unit cube


Step = Callable[[Any, Any, Any, Any], tuple[Any, Sight]]  # (state, own, shared, raises) -> state, what was seen


def stepper(evaluate: Evaluate, optimizer: Any, *, comparable: bool = True) -> Step:
    """The compiled program ``step(descent, own, shared, raises)`` of one step of all starts.

    Args:
      evaluate: objective and slacks (satisfied where >= 0) of a point, given what belongs to its start
        and what is shared by all.
      optimizer: of optax, line searches included.
      comparable: whether objectives of two steps can be compared; else the latest design counts as best.
    """
    import optax  # importing it with the package would cost a sixth of the time that JAX takes

    optimizer = optax.with_extra_args_support(optimizer)

    def lagrangian(unit, multipliers, own, shared):
        value, slacks = evaluate(unit, own, shared)
        slack = joined(slacks)
        slack = jnp.where(jnp.isnan(slack), -jnp.inf, slack)
        pulls = jnp.where(slack > -jnp.inf, slack, jnp.inf)
        short = jnp.maximum(multipliers.astype(slack.dtype) / _PENALTY - pulls, 0)
        return value + _PENALTY / 2 * jnp.sum(short**2).astype(value.dtype), (value, slack)

    @jax.jit
    @partial(of_each_start, in_axes=(0, 0, None, None))
    def step(descent, own, shared, raises):
        unit, multipliers = descent.units, descent.multipliers
        merit = partial(lagrangian, multipliers=multipliers, own=own, shared=shared)
        (level, (value, slack)), gradient = jax.value_and_grad(merit, has_aux=True)(unit)
        finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(g)) for g in jax.tree.leaves(gradient)]))
        free = jax.tree.map(lambda g, u: jnp.where(finite & ~_held(g, u), g, 0), gradient, unit)
        with jax.numpy_dtype_promotion("standard"):  # optax relies on it
            updates, memory = optimizer.update(
                free, descent.memory, unit, value=level, grad=free, value_fn=lambda u: merit(_clipped(u))[0]
            )
            moved = _clipped(optax.apply_updates(unit, updates))
        violation = jnp.max(jnp.maximum(-slack, 0), initial=0)
        raised = jnp.maximum(multipliers - _PENALTY * slack.astype(multipliers.dtype), 0)
        raised = jnp.where(slack > -jnp.inf, raised, multipliers)
        best = _better(descent.best, Seen(unit, value, violation), comparable)
        moved = Descent(moved, memory, jnp.where(raises, raised, multipliers), best)
        return moved, Sight(value, violation, raised, gradient)

    return step


def of_each_start(function: Callable[..., Any], in_axes: tuple[int | None, ...]) -> Callable[..., Any]:
    """As ``jax.vmap``, but a single start is not batched: that would be one more level of tracing."""

    def call(*args: Any) -> Any:
        pairs = list(zip(args, in_axes, strict=True))
        if {leaf.shape[0] for arg, axis in pairs if axis == 0 for leaf in jax.tree.leaves(arg)} != {1}:
            return jax.vmap(function, in_axes)(*args)
        alone = [jax.tree.map(lambda leaf: leaf[0], arg) if axis == 0 else arg for arg, axis in pairs]
        return jax.tree.map(lambda leaf: leaf[None], function(*alone))

    return call


def begun(units: Any, own: Any, shared: Any, *, optimizer: Any, evaluate: Evaluate) -> Descent:
    """All starts before their first step."""
    first = jax.tree.map(lambda leaf: leaf[0], (units, own))
    value, slack = jax.eval_shape(lambda *args: _with_joined(evaluate(*args)), *first, shared)
    starts = jax.tree.leaves(units)[0].shape[0]
    unseen = jnp.full(starts, jnp.inf, value.dtype), jnp.full(starts, jnp.inf, slack.dtype)
    multipliers = jnp.zeros((starts, *slack.shape), slack.dtype)
    return Descent(units, jax.vmap(optimizer.init)(units), multipliers, Seen(units, *unseen))


def adam(steps: int) -> Any:
    """The optimizer for so many steps where none is given."""
    import optax

    return optax.adam(optax.cosine_decay_schedule(0.03, steps, 0.02))


def between(unit: Any, low: Any, high: Any) -> Any:
    """Parameters of a point in the unit cube, never beyond the bounds by rounding."""

    def leaf(u, a, b):
        value = a + (b - a) * u
        return value + jax.lax.stop_gradient(jnp.clip(value, a, b) - value)  # a clipped number would have half a slope

    return jax.tree.map(leaf, unit, low, high)


def start_units(params: Any, low: Any, high: Any) -> Any:
    """A design scaled to the unit cube, on a leading axis of length one."""

    def leaf(value, a, b):
        wide = b > a
        return jnp.where(wide, (value - a) / jnp.where(wide, b - a, 1), 0)[None]

    return jax.tree.map(leaf, params, low, high)


def drawn_units(like: Any, count: int, generator: np.random.Generator) -> Any:
    """Random designs in the unit cube, on a leading axis."""
    return jax.tree.map(lambda leaf: jnp.asarray(generator.random((count, *leaf.shape[1:])), leaf.dtype), like)


def slacks_of(constraints: Sequence[Callable[[Any], Any]], robot: Any) -> Slacks:
    """The entries of every constraint.

    Raises:
      ValueError: a constraint that gives no real numbers.
    """
    found = []
    for number, constraint in enumerate(constraints):
        slack = jnp.ravel(jnp.asarray(constraint(robot)))
        if not jnp.issubdtype(slack.dtype, jnp.floating):
            raise ValueError(
                f"Got constraint {number} of dtype {slack.dtype}; expected real numbers that are >= 0 where it is "
                "kept: a margin, not whether there is one."
            )
        found.append(slack)
    return tuple(found)


def joined(slacks: Slacks) -> jax.Array:
    """All entries of all constraints."""
    return jnp.concatenate(slacks) if slacks else jnp.zeros(0)


def _with_joined(found: tuple[jax.Array, Slacks]) -> tuple[jax.Array, jax.Array]:
    return found[0], joined(found[1])


def _held(slope: jax.Array, unit: jax.Array) -> jax.Array:
    """Whether descent would leave the unit cube."""
    return ((unit <= 0) & (slope > 0)) | ((unit >= 1) & (slope < 0))


def held_back(gradient: Any, units: Any) -> Any:
    """The slopes that point out of the unit cube, and zero for the others."""
    return jax.tree.map(lambda g, u: jnp.where(_held(g, u), g, 0), gradient, units)


def _clipped(unit: Any) -> Any:
    return jax.tree.map(lambda u: jnp.clip(u, 0, 1), unit)


def _better(old: Seen, new: Seen, comparable: bool) -> Seen:
    """The better of two designs: kept constraints first, then the objective or, if that says nothing, the later."""
    old_short, short = (jnp.maximum(seen.violation - ALLOWED, 0) for seen in (old, new))
    even = (new.objective < old.objective) if comparable else True
    wins = jnp.isfinite(new.objective) & ((short < old_short) | ((short == old_short) & even))
    wins = wins | (jnp.isfinite(new.objective) & ~jnp.isfinite(old.objective))
    return jax.tree.map(lambda n, o: jnp.where(wins, n, o), new, old)
