"""Design optimization: the best robot within bounds, by the gradient of any metric."""

from __future__ import annotations

import enum
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._pytree import as_floats, pytree, static

if TYPE_CHECKING:
    import optax

_PENALTY = 20.0  # weight of a squared violation, for objectives and constraints of order one
_PERIOD = 10  # steps between two updates of the multipliers
_ALLOWED = 1e-3  # violation that the best design may have


class DesignStatus(enum.IntEnum):
    """How an optimization ended."""

    IMPROVED = 0
    NOT_IMPROVED = 1
    INFEASIBLE = 2
    NONFINITE = 3


@pytree
class Starts:
    """Best design of every start, on a leading axis: parameters, objective and largest violation."""

    params: Any
    objective: jax.Array
    violation: jax.Array


@pytree
class History:
    """What every step saw, each ``(steps + 1, starts)``: objective, largest violation; and the multipliers.

    ``multipliers`` is ``(steps + 1, starts, constraints)``: how much the objective would fall if a
    constraint were loosened by one unit.
    """

    objective: jax.Array
    violation: jax.Array
    multipliers: jax.Array


@pytree
class DesignResult:
    """Result of ``optimize_design``.

    Attributes:
      params: parameters of the best design.
      robot: what was built of them.
      history: ``History`` of all starts.
      starts: ``Starts``, the best of each.
      status: ``IMPROVED``; ``NOT_IMPROVED`` on the parameters given; ``INFEASIBLE`` if no design kept the
        constraints; ``NONFINITE`` if no start had a finite objective.
    """

    params: Any
    robot: Any
    history: History
    starts: Starts
    status: DesignStatus = static()


def optimize_design(
    objective: Callable[[Any], Any],
    params: Any,
    *,
    bounds: tuple[Any, Any],
    steps: int,
    build: Callable[[Any], Any] = lambda params: params,
    optimizer: optax.GradientTransformation | None = None,
    constraints: Sequence[Callable[[Any], Any]] = (),
    starts: int = 1,
    seed: int = 0,
) -> DesignResult:
    """Minimize ``objective(build(params))`` within bounds and under constraints, by gradient.

    The parameters are scaled to their bounds and projected onto them after each step of the optimizer.
    Constraints enter by an augmented Lagrangian. All starts run in one vmapped program.

    Args:
      objective: metric of a robot, a scalar of order one; to maximize, give its negative.
      params: any pytree of numbers, or a robot. The first start.
      bounds: (low, high), two pytrees like ``params``, finite. Equal bounds keep a number fixed.
      steps: steps of the optimizer.
      build: makes the robot of the parameters.
      optimizer: of optax, acting on parameters scaled to [0, 1]. Default: Adam with a learning rate that
        decays from 0.03 by a cosine.
      constraints: functions of a robot, of order one, satisfied where every entry is >= 0.
      starts: number of starts; those after the first are random within the bounds.
      seed: of the random starts.

    Returns:
      ``DesignResult`` with the best design that any step saw and that violates no constraint by more
      than 1e-3.

    Raises:
      ValueError: bounds that are not finite, out of order, or of another structure than ``params``;
        params outside them; fewer than one step or start.

    Example:
      >>> result = optimize_design(lambda x: (x - 2.0) ** 2, 0.5, bounds=(0.0, 1.0), steps=50)
      >>> round(float(result.params), 3), result.status.name
      (1.0, 'IMPROVED')
    """
    import optax  # importing it with the package would cost a sixth of the time that JAX takes

    if steps < 1 or starts < 1:
        raise ValueError(f"Got steps={steps} and starts={starts}; expected at least one of each.")
    params, low, high = _checked(params, bounds)
    units = _start_units(params, low, high, starts, seed)
    optimizer = optimizer or optax.adam(optax.cosine_decay_schedule(0.03, steps, 0.02))

    def scaled(unit):
        return jax.tree.map(lambda u, a, b: a + (b - a) * u, unit, low, high)

    def slacks(robot):
        each = [jnp.ravel(jnp.asarray(constraint(robot))) for constraint in constraints]
        return jnp.concatenate(each) if each else jnp.zeros(0)

    def lagrangian(unit, multipliers):
        robot = build(scaled(unit))
        value, slack = objective(robot), slacks(robot)
        short = jnp.maximum(multipliers.astype(slack.dtype) / _PENALTY - slack, 0)
        return value + _PENALTY / 2 * jnp.sum(short**2).astype(value.dtype), (value, slack)

    @jax.jit
    @jax.vmap
    def step(unit, state, multipliers):
        (_, (value, slack)), gradient = jax.value_and_grad(lagrangian, has_aux=True)(unit, multipliers)
        finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(g)) for g in jax.tree.leaves(gradient)]))
        gradient = jax.tree.map(lambda g: jnp.where(finite, g, 0), gradient)
        with jax.numpy_dtype_promotion("standard"):  # optax relies on it
            updates, state = optimizer.update(gradient, state, unit)
            moved = jax.tree.map(lambda u: jnp.clip(u, 0, 1), optax.apply_updates(unit, updates))
        raised = jnp.maximum(multipliers - _PENALTY * slack.astype(multipliers.dtype), 0)
        return moved, state, value, slack, raised

    count = jax.eval_shape(lambda unit: slacks(build(scaled(unit))), jax.tree.map(lambda u: u[0], units)).shape[0]
    state, multipliers = jax.vmap(optimizer.init)(units), jnp.zeros((starts, count))
    best: Any = None
    log: list[Any] = []
    for number in _progress(steps + 1, log):
        moved, state, value, slack, raised = step(units, state, multipliers)
        violation = jnp.max(jnp.maximum(-slack, 0), axis=1, initial=0)
        best = _better(best, (units, value, violation))
        log.append((value, violation, multipliers))
        units = moved
        if number % _PERIOD == _PERIOD - 1:
            multipliers = raised
    return _result(log, best, jax.vmap(scaled)(best[0]), build)


def _checked(params: Any, bounds: tuple[Any, Any]) -> tuple[Any, Any, Any]:
    low, high = bounds
    structures = {str(jax.tree.structure(tree)) for tree in (params, low, high)}
    if len(structures) > 1:
        raise ValueError(f"Got params and bounds of different structure: {sorted(structures)}.")
    params, low, high = as_floats(params, low, high)
    low, high = (jax.tree.map(lambda b, p: jnp.broadcast_to(b, p.shape), bound, params) for bound in (low, high))
    leaves = zip(*(jax.tree.leaves(tree) for tree in (params, low, high)), strict=True)
    for value, a, b in leaves:
        if not np.all(np.isfinite(a) & np.isfinite(b) & (np.asarray(a) <= np.asarray(b))):
            raise ValueError(f"Got bounds {a} and {b}; expected finite numbers, low <= high.")
        if not np.all((np.asarray(a) <= np.asarray(value)) & (np.asarray(value) <= np.asarray(b))):
            raise ValueError(f"Got params {value} outside their bounds {a} to {b}.")
    return params, low, high


def _start_units(params: Any, low: Any, high: Any, starts: int, seed: int) -> Any:
    """Starts scaled to the unit box: the given one, then random ones."""
    generator = np.random.default_rng(seed)

    def leaf(value, a, b):
        wide = b > a
        first = jnp.where(wide, (value - a) / jnp.where(wide, b - a, 1), 0)
        others = jnp.asarray(generator.random((starts - 1, *value.shape)), value.dtype)
        return jnp.concatenate([first[None], others])

    return jax.tree.map(leaf, params, low, high)


def _better(best: Any, new: Any) -> Any:
    """Per start the better of two (unit, objective, violation): kept constraints first, then the objective."""
    if best is None:
        return new
    (_, old_value, old_violation), (_, value, violation) = best, new
    old_short, short = (jnp.maximum(v - _ALLOWED, 0) for v in (old_violation, violation))
    wins = (short < old_short) | ((short == old_short) & (value < old_value)) | ~jnp.isfinite(old_value)
    wins = wins & jnp.isfinite(value)
    return jax.tree.map(lambda n, o: jnp.where(wins.reshape((-1,) + (1,) * (n.ndim - 1)), n, o), new, best)


def _result(log: list[Any], best: Any, all_params: Any, build: Callable[[Any], Any]) -> DesignResult:
    _, value, violation = best
    kept = (violation <= _ALLOWED) & jnp.isfinite(value)
    chosen = int(jnp.argmin(jnp.where(kept, value, jnp.inf)))
    if not bool(jnp.any(jnp.isfinite(value))):
        status = DesignStatus.NONFINITE
    elif not bool(jnp.any(kept)):
        status = DesignStatus.INFEASIBLE
        chosen = int(jnp.argmin(violation))
    else:
        first_value, first_violation, _ = log[0]
        started = bool(first_violation[0] <= _ALLOWED) and not bool(value[chosen] < first_value[0])
        status = DesignStatus.NOT_IMPROVED if started else DesignStatus.IMPROVED
    params = jax.tree.map(lambda leaf: leaf[chosen], all_params)
    history = History(*(jnp.stack(column) for column in zip(*log, strict=True)))
    return DesignResult(params, build(params), history, Starts(all_params, value, violation), status)


def _progress(steps: int, log: list[Any]) -> Iterable[int]:
    """Step numbers, with a progress line that shows the best objective so far, if tqdm is installed."""
    try:
        from tqdm import tqdm
    except ImportError:
        yield from range(steps)
        return
    with tqdm(total=steps, desc="design", unit="step", disable=None) as bar:
        for number in range(steps):
            yield number
            if not bar.disable:
                bar.set_postfix(objective=f"{float(jnp.min(log[-1][0])):.5f}")
            bar.update()
