"""An augmented Lagrangian, minimized in the unit cube by any optimizer of optax [Nocedal and Wright, 17.4]."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from jaxscissor._engine.pytree import pytree
from jaxscissor._engine.types import PyTree
from jaxscissor.design._problem import (
    FEASIBLE,
    Evaluate,
    Incumbent,
    Step,
    StepInfo,
    concatenated,
    leaves_cube,
    per_start,
)

_PENALTY = 20.0  # mu, for objectives and constraints of order one


@pytree
class LagrangianState:
    """State of all starts between two steps."""

    units: Any
    optimizer: Any  # its own state
    multipliers: jax.Array
    best: Incumbent


def lagrangian_step(evaluate: Evaluate, optimizer: PyTree, *, comparable: bool = True) -> Step:
    """The compiled program of one step of all starts.

    With constraints c(x) >= 0 and multipliers m it descends along the gradient of

        f(x) + mu / 2 sum max(m / mu - c(x), 0)^2,

    projected onto the bounds, and now and then sets m = max(m - mu c(x), 0) [Nocedal and Wright, section 17.4,
    in the form that eliminates the slacks]. A constraint that is ``nan`` counts as violated but has no gradient.
    A step:

    1. The augmented function, the constraints and the gradient at the design.
    2. The optimizer's update along the gradient, without what would leave the unit cube, clipped to it.
    3. The multipliers' estimate, taken over if this step is to update them.
    4. The best design so far, by violation first and the objective next.

    Args:
      evaluate: objective and constraints of a point, given what belongs to its start and what is shared by all.
      optimizer: of optax, line searches included.
      comparable: whether objectives of two steps can be compared; else the latest design counts as best.
    """
    import optax  # importing it with the package would cost a sixth of the time that JAX takes

    optimizer = optax.with_extra_args_support(optimizer)

    def augmented(unit: PyTree, multipliers: jax.Array, start_args: PyTree, shared_args: PyTree):
        value, constraints = evaluate(unit, start_args, shared_args)
        c = concatenated(constraints)
        c = jnp.where(jnp.isnan(c), -jnp.inf, c)
        differentiable = jnp.where(c > -jnp.inf, c, jnp.inf)
        shifted = jnp.maximum(multipliers.astype(c.dtype) / _PENALTY - differentiable, 0)
        return value + _PENALTY / 2 * jnp.sum(shifted**2).astype(value.dtype), (value, c)

    @jax.jit
    @partial(per_start, in_axes=(0, 0, None, None))
    def step(state: PyTree, start_args: PyTree, shared_args: PyTree, update: bool | jax.Array):
        unit, multipliers = state.units, state.multipliers
        merit = partial(augmented, multipliers=multipliers, start_args=start_args, shared_args=shared_args)
        (level, (value, c)), gradient = jax.value_and_grad(merit, has_aux=True)(unit)
        finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(g)) for g in jax.tree.leaves(gradient)]))
        projected = jax.tree.map(lambda g, u: jnp.where(finite & ~leaves_cube(g, u), g, 0), gradient, unit)
        with jax.numpy_dtype_promotion("standard"):  # optax relies on it
            updates, own = optimizer.update(
                projected,
                state.optimizer,
                unit,
                value=level,
                grad=projected,
                value_fn=lambda u: merit(_clipped(u))[0],
            )
            moved = _clipped(optax.apply_updates(unit, updates))
        violation = jnp.max(jnp.maximum(-c, 0), initial=0)
        estimate = jnp.maximum(multipliers - _PENALTY * c.astype(multipliers.dtype), 0)
        estimate = jnp.where(c > -jnp.inf, estimate, multipliers)
        best = _better(state.best, Incumbent(unit, value, violation), comparable)
        moved = LagrangianState(moved, own, jnp.where(update, estimate, multipliers), best)
        return moved, StepInfo(value, violation, estimate, gradient)

    return step


def lagrangian_init(
    units: PyTree, start_args: PyTree, shared_args: PyTree, *, optimizer: PyTree, evaluate: Evaluate
) -> LagrangianState:
    """All starts before their first step."""

    def shapes(*args):
        value, constraints = evaluate(*args)
        return value, concatenated(constraints)

    value, c = jax.eval_shape(shapes, *jax.tree.map(lambda leaf: leaf[0], (units, start_args)), shared_args)
    starts = jax.tree.leaves(units)[0].shape[0]
    unseen = jnp.full(starts, jnp.inf, value.dtype), jnp.full(starts, jnp.inf, c.dtype)
    multipliers = jnp.zeros((starts, *c.shape), c.dtype)
    return LagrangianState(units, jax.vmap(optimizer.init)(units), multipliers, Incumbent(units, *unseen))


def _clipped(unit: PyTree) -> Any:
    return jax.tree.map(lambda u: jnp.clip(u, 0, 1), unit)


def _better(old: Incumbent, new: Incumbent, comparable: bool) -> Incumbent:
    """The better of two designs: feasibility first, then the objective or, if that says nothing, the later."""
    old_excess, excess = (jnp.maximum(design.violation - FEASIBLE, 0) for design in (old, new))
    lower = (new.objective < old.objective) if comparable else True
    wins = jnp.isfinite(new.objective) & ((excess < old_excess) | ((excess == old_excess) & lower))
    wins = wins | (jnp.isfinite(new.objective) & ~jnp.isfinite(old.objective))
    return jax.tree.map(lambda n, o: jnp.where(wins, n, o), new, old)
