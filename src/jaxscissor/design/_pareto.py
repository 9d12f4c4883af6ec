"""Several metrics at once, and several kinds of robot: Pareto fronts and the choice among layouts."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.progress import progress
from jaxscissor._engine.pytree import pytree
from jaxscissor._engine.types import PyTree
from jaxscissor.design._methods import AugmentedLagrangian
from jaxscissor.design._optimize import checked_bounds, optimize
from jaxscissor.design._problem import (
    FEASIBLE,
    PERIOD,
    Solver,
    concatenated,
    constraint_values,
    from_unit,
    random_units,
    to_units,
)
from jaxscissor.design._result import DesignResult

_ROUNDS = 3
_KEPT = 8  # fronts whose programs are kept for another call
_TILT = 0.01  # augmentation weight of the Chebyshev scalarization; excludes weakly dominated designs


@pytree
class ParetoFront:
    """Designs none of which is better than another in all metrics, in the order of the first metric.

    Attributes:
      values: ``(n, metrics)``.
      params: their parameters, on a leading axis ``n``.
      violation: ``(n,)`` largest violation of a constraint, at most 1e-3.
    """

    values: jax.Array
    params: Any
    violation: jax.Array


def pareto_front(
    objectives: Sequence[Callable[[Any], Any]],
    params: PyTree,
    *,
    bounds: tuple[Any, Any],
    steps: int,
    build: Callable[[Any], Any] = lambda params: params,
    method: AugmentedLagrangian | None = None,
    constraints: Sequence[Callable[[Any], Any]] = (),
    designs: int = 100,
    seed: int = 0,
) -> ParetoFront:
    """Best compromises between metrics, by gradient, all designs in one vmapped program.

    Every design minimizes the largest of the metrics, each with a weight of the design's own and scaled to
    the range that the designs span (Chebyshev's scalarization, which finds the hollow parts of a front too).
    That is done in three rounds. In each, every design starts from the one among all found that suits its weights
    best, and the metrics are scaled anew; the first round starts from random designs.

    Args:
      objectives: metrics of a robot, two or more, all to be minimized.
      params, bounds, build, constraints: see ``design.optimize``.
      steps: steps of the optimizer in each round.
      method: the augmented Lagrangian, with an optimizer of optax. Default: with Adam.
      designs: number of weights, and of random designs to start from.
      seed: of the random designs.

    Returns:
      ``design.ParetoFront`` of what is not dominated among the designs found; none if no design kept the constraints.

    Raises:
      ValueError: fewer than two objectives or designs; bounds and params: see ``design.optimize``.

    Example:
      The points between 0 and 1 are the compromises between being near the one and near the other:

      >>> front = pareto_front([lambda x: x**2, lambda x: (x - 1.0) ** 2], 0.3, bounds=(-2.0, 2.0), steps=50)
      >>> bool(front.params.min() > -0.01), bool(front.params.max() < 1.01), len(front.values) > 50
      (True, True, True)
    """
    if len(objectives) < 2 or designs < 2 or steps < 1:
        raise ValueError(
            f"Got {len(objectives)} objectives, designs={designs}, steps={steps}; expected at least 2, 2 and 1."
        )
    params, low, high = checked_bounds(params, bounds)
    programs = _programs(tuple(objectives), build, tuple(constraints), method or AugmentedLagrangian(), steps)
    given = to_units(params, low, high)
    drawn = random_units(given, designs - 1, np.random.default_rng(seed))
    units = jax.tree.map(lambda first, others: jnp.concatenate([first, others]), given, drawn)
    dtype = jnp.result_type(jax.tree.leaves(params)[0])
    weights = jnp.asarray(_weights(len(objectives), designs), dtype)

    def begin(archive: PyTree):
        found, values, constraints = archive
        spread = _spread(values, constraints)
        suited = jnp.argmin(_cost(values, constraints, weights, spread), axis=1)
        chosen = jax.tree.map(lambda leaf: leaf[suited], found)
        shared = (low, high), spread
        return shared, programs.solver.init(chosen, weights, shared)

    archive = units, *programs.judge(units, (low, high))
    shared, state = begin(archive)
    for number in progress(range(1, _ROUNDS * steps + 1), "front", "step"):
        state, _ = programs.solver.step(state, weights, shared, number % PERIOD == 0)
        if number % steps == 0:
            found = state.best.units, *programs.judge(state.best.units, (low, high))
            archive = jax.tree.map(lambda old, new: jnp.concatenate([old, new]), archive, found)
            shared, state = begin(archive)
    archive = jax.tree.map(lambda leaf: leaf[-designs:], archive)  # those of the last round
    front = _efficient(*archive[1:])
    best = jax.tree.map(lambda leaf: leaf[front], archive[0])
    return ParetoFront(
        archive[1][front], jax.vmap(from_unit, (0, None, None))(best, low, high), _violation(archive[2][front])
    )


class _Programs(NamedTuple):
    """The compiled functions of a front; bounds, weights and spread are their arguments."""

    solver: Solver
    judge: Callable[..., Any]  # (units, bounds) -> all metrics and constraints


@functools.lru_cache(maxsize=_KEPT)
def _programs(
    objectives: tuple[Any, ...],
    build: Callable[..., Any],
    constraints: tuple[Any, ...],
    method: AugmentedLagrangian,
    steps: int,
) -> _Programs:
    """The programs of these functions; a second front of the same ones compiles nothing."""

    def measured(unit: PyTree, bounds: PyTree):
        robot = build(from_unit(unit, *bounds))
        metrics = jnp.stack([jnp.asarray(objective(robot)) for objective in objectives])
        return metrics, constraint_values(constraints, robot)

    def evaluate(unit: PyTree, weight: jax.Array, shared: PyTree):
        bounds, spread = shared
        values, entries = measured(unit, bounds)
        return _scalar(values, weight, spread), entries

    def judged(unit: PyTree, bounds: PyTree):
        values, entries = measured(unit, bounds)
        return values, concatenated(entries)

    return _Programs(method.solver(evaluate, steps, True), jax.jit(jax.vmap(judged, (0, None))))


def optimize_variants(
    objective: Callable[..., Any], variants: Mapping[str, Mapping[str, Any]], **options: Any
) -> dict[str, DesignResult]:
    """Optimize each of several kinds of robot, for what is not a number: a layout, a mode, a count.

    Args:
      objective: metric of a robot; see ``design.optimize``.
      variants: by name, the arguments of ``design.optimize`` that are the variant's own (``params``,
        ``bounds``, ``build``, ...).
      options: the arguments that all have in common.

    Returns:
      The ``design.DesignResult`` of every variant, by name, the best first; those without a valid design come last.

    Raises:
      ValueError: no variants; and as ``design.optimize``.

    Example:
      >>> variants = {str(n): {"params": 0.0, "build": lambda x, n=n: (x - n) ** 2 + n} for n in (2, 1)}
      >>> results = optimize_variants(lambda robot: robot, variants, bounds=(-3.0, 3.0), steps=60)
      >>> list(results)
      ['1', '2']
    """
    if not variants:
        raise ValueError("Got no variants; expected at least one.")
    results = {name: optimize(objective, **{**options, **own}) for name, own in variants.items()}

    def rank(result: DesignResult) -> tuple[bool, float]:
        kept = jnp.where(result.starts.violation <= FEASIBLE, result.starts.objective, jnp.inf)
        return not result.ok, float(jnp.min(kept))

    return dict(sorted(results.items(), key=lambda item: rank(item[1])))


def _weights(metrics: int, designs: int) -> np.ndarray:
    """Evenly spread weights ``(designs, metrics)`` that add up to one; among them those of a single metric."""
    if metrics == 2:
        first = np.linspace(0, 1, designs)
        return np.stack([first, 1 - first], axis=1)
    steps = 0.5 ** (np.arange(1, metrics + 1) / metrics)  # an additive recurrence
    parts = -np.log((0.5 + np.arange(1, designs + 1)[:, None] * steps) % 1 + 1e-9)
    return np.concatenate([np.eye(metrics), parts / parts.sum(axis=1, keepdims=True)])[:designs]


def _scalar(values: jax.Array, weight: jax.Array, spread: tuple[jax.Array, jax.Array]) -> jax.Array:
    low, width = spread
    parts = (values - low) / width
    return jnp.max(jnp.where(weight > 0, weight * parts, -jnp.inf)) + _TILT * jnp.sum(parts)


def _violation(constraints: jax.Array) -> jax.Array:
    return jnp.max(jnp.maximum(-constraints, 0), axis=1, initial=0)


def _cost(
    values: jax.Array, constraints: jax.Array, weights: jax.Array, spread: tuple[jax.Array, jax.Array]
) -> jax.Array:
    """How little each design suits each weight ``(weights, designs)``; any violation outweighs the metrics."""
    cost = jax.vmap(jax.vmap(_scalar, (0, None, None)), (None, 0, None))(values, weights, spread)
    short = jnp.maximum(_violation(constraints) - FEASIBLE, 0)
    cost = cost + jnp.where(short > 0, 1e3 * (1 + short), 0)[None]
    return jnp.where(jnp.isfinite(cost), cost, jnp.inf)


def _spread(values: jax.Array, constraints: jax.Array) -> tuple[jax.Array, jax.Array]:
    """A point a little better than all that is efficient in every metric, and the range of the efficient designs."""
    front = values[_efficient(values, constraints)]
    front = front if len(front) else values
    low, high = jnp.nanmin(front, axis=0), jnp.nanmax(front, axis=0)
    width = jnp.where(high > low, high - low, 1)
    return low - 0.05 * width, width


def _efficient(values: jax.Array, constraints: jax.Array) -> np.ndarray:
    """Numbers of the designs that keep the constraints and that no other such design dominates, by the first metric."""
    kept = np.flatnonzero(np.all(np.isfinite(values), axis=1) & (np.asarray(_violation(constraints)) <= FEASIBLE))
    points = np.asarray(values)[kept]
    no_worse = np.all(points[:, None] <= points[None], axis=2)
    same = no_worse & no_worse.T
    dominated = np.any(no_worse & ~same, axis=0)
    repeated = np.any(np.triu(same, 1), axis=0)
    chosen = kept[~dominated & ~repeated]
    return chosen[np.lexsort(np.asarray(values)[chosen].T[::-1])]
