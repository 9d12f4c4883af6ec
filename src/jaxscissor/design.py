"""Design optimization: the best robot within bounds, by the gradient of any metric."""

from __future__ import annotations

import dataclasses
import enum
import functools
import os
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._checkpoint import qualified_name, restore, save, traced
from jaxscissor._descent import (
    ALLOWED,
    PERIOD,
    Descent,
    Evaluate,
    Seen,
    Step,
    adam,
    begun,
    between,
    drawn_units,
    joined,
    slacks_of,
    start_units,
    stepper,
)
from jaxscissor._prices import Prices, prices_of
from jaxscissor._progress import progress
from jaxscissor._pytree import as_floats, broadcast, pytree, static
from jaxscissor._scaling import Scale, first_scale, sampled_slopes
from jaxscissor._sqp import linearizer, sqp_begun, sqp_stepper
from jaxscissor.regions import Sample

if TYPE_CHECKING:
    import optax


_DRAWN, _TOGETHER = 64, 16  # random designs per start, and how many of them are evaluated together
_KEPT = 16  # optimizations whose programs are kept for another call


class DesignStatus(enum.IntEnum):
    """How an optimization ended."""

    IMPROVED = 0
    NOT_IMPROVED = 1
    INFEASIBLE = 2
    NONFINITE = 3
    IMPOSSIBLE = 4


class StopReason(enum.IntEnum):
    """Why an optimization took no further step."""

    STEPS = 0
    SETTLED = 1


@pytree
class Starts:
    """Best design of every start, on a leading axis: parameters, objective and largest violation.

    A violation counts in units of the median slope that the constraint's entries have at the first start, across
    the bounds.
    """

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
class Certificate:
    """Metric and least slack of the constraints, before and after, on poses that the tuning did not see."""

    before: jax.Array
    after: jax.Array
    slack_before: jax.Array
    slack_after: jax.Array

    @property
    def improvement(self) -> jax.Array:
        """By how much the metric fell."""
        return self.before - self.after


@pytree
class DesignResult:
    """Result of ``optimize_design``.

    Attributes:
      params: parameters of the best design.
      robot: what was built of them.
      initial: what was built of the parameters given.
      history: ``History`` of all starts.
      starts: ``Starts``, the best of each.
      prices: ``Prices``, which constraints and bounds hold the design back.
      status: ``IMPROVED``; ``NOT_IMPROVED`` on the parameters given; ``INFEASIBLE`` if no design kept the
        constraints; ``NONFINITE`` if no start had a finite objective with a finite gradient; ``IMPOSSIBLE`` if
        ``build`` refuses the best design.
      reason: ``STEPS`` if all were taken, ``SETTLED`` if the objective no longer fell.
      message: what is to be known besides, such as a gradient that is zero or not finite; or nothing.
    """

    params: Any
    robot: Any
    initial: Any
    history: History
    starts: Starts
    prices: Prices
    status: DesignStatus = static()
    reason: StopReason = static()
    message: str = static(default="")

    def certify(self, metric: Callable[[Any], Any], constraints: Sequence[Callable[[Any], Any]] = ()) -> Certificate:
        """Compare the robot with the initial one by a metric, a hard one on a dense sample of its own.

        Args:
          metric: of a robot, smaller is better.
          constraints: functions of a robot, satisfied where every entry is >= 0.

        Example:
          >>> result = optimize_design(lambda x: (x - 2.0) ** 2, 0.5, bounds=(0.0, 1.0), steps=50)
          >>> bool(result.certify(lambda x: abs(x - 2.0)).improvement > 0.4)
          True
        """
        values = [jnp.asarray(metric(robot)) for robot in (self.initial, self.robot)]
        slacks = [
            jnp.min(joined(slacks_of(constraints, robot)), initial=jnp.inf) for robot in (self.initial, self.robot)
        ]
        return Certificate(*values, *slacks)


def optimize_design(
    objective: Callable[..., Any],
    params: Any,
    *,
    bounds: tuple[Any, Any],
    steps: int,
    build: Callable[[Any], Any] = lambda params: params,
    optimizer: optax.GradientTransformation | None = None,
    constraints: Sequence[Callable[[Any], Any]] = (),
    starts: int = 1,
    seed: int = 0,
    poses: Any = None,
    batch_size: int | None = None,
    tolerance: float | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> DesignResult:
    """Minimize ``objective(build(params))`` within bounds and under constraints, by gradient.

    The parameters are scaled to their bounds, objective and constraints to their first slopes, so that no unit matters.
    By default each step is one of sequential quadratic programming,
    which follows the constraints that bind and ends on them within rounding after some tens of steps. An
    optimizer of optax is given the gradient of an augmented Lagrangian, and its steps are projected onto the
    bounds. All starts run in one vmapped program. As under ``jax.jit``, what the functions read besides their
    arguments is fixed at the first call; another optimization of the same functions, from other parameters, bounds
    or poses, compiles nothing.

    Args:
      objective: metric of a robot, a scalar; to maximize, give its negative.
      params: any pytree of numbers, or a robot. The first start.
      bounds: (low, high), two pytrees like ``params``, finite. Equal bounds keep a number fixed.
      steps: steps of the optimizer.
      build: makes the robot of the parameters.
      optimizer: of optax, acting on parameters scaled to [0, 1]; ``optax.lbfgs()`` will do. It is the better
        choice for hundreds of parameters, each of which costs the default a derivative of every constraint.
        With batches the default is Adam, with a learning rate that decays from 0.03 by a cosine.
      constraints: functions of a robot, satisfied where every entry is >= 0; all entries of one in the same unit. An
        entry that is ``nan``, of a pose that is not reached, counts as violated but does not pull: give the
        margin, too.
      starts: number of starts; those after the first are the best among random designs, 64 per start.
      seed: of the random designs.
      poses: ``(n, d)`` poses, or a sample of a region, for an ``objective(robot, poses)``.
      batch_size: poses of which each step sees that many, the next ones, round and round. Objectives of two
        steps then cannot be compared: each start's design is its latest that keeps the constraints, and in
        the end the starts are compared over all poses.
      tolerance: stop when over the last fifth of ``steps`` no start's best objective fell by more.
      checkpoint: path of an ``.npz`` file, replaced every ten steps. An optimization that was stopped goes on
        from there when called again, to the same result; a finished one is read.

    Returns:
      ``DesignResult`` with the best design that any step saw and that violates no constraint by more
      than a thousandth of the slope that it has at first across the bounds.

    Raises:
      ValueError: bounds that are not finite, out of order, or of another structure than ``params``;
        params outside them, or of which no robot can be built; an objective that is no number, a constraint that
        is no real numbers, an optimizer that is not optax's; fewer than one step or start; batches without
        poses, or larger than all of them, or with a tolerance; the checkpoint of another optimization.

    Example:
      >>> result = optimize_design(lambda x: (x - 2.0) ** 2, 0.5, bounds=(0.0, 1.0), steps=50)
      >>> round(float(result.params), 3), result.status.name, round(float(result.prices.high), 3)
      (1.0, 'IMPROVED', 2.0)
    """
    _check_counts(steps, starts, poses, batch_size, tolerance)
    if optimizer is not None and not hasattr(optimizer, "update"):
        raise ValueError(f"Got optimizer={optimizer!r}; expected one of optax, such as optax.adam(0.01), or None.")
    params, low, high = checked_bounds(params, bounds)
    initial = build(params)  # at once: it may refuse the parameters
    poses = poses if poses is None or isinstance(poses, Sample) else jnp.asarray(poses)
    programs = _programs(objective, build, tuple(constraints), optimizer, steps, batch_size)
    given = start_units(params, low, high)
    one = np.ones((), jax.tree.leaves(low)[0].dtype)
    plain = (low, high, poses, Scale(one, (one,) * len(constraints))), jnp.uint32(0)
    first = programs.slopes(given, (), plain)
    scale, sizes = first_scale(first)
    numbers = low, high, poses, scale
    units = _screened(programs, numbers, given, starts, seed)
    state = programs.begin(units, (), (numbers, jnp.uint32(0)))

    def step(state, number, raises):
        return programs.step(state, (), (numbers, jnp.uint32(number)), raises)

    job = {}
    if checkpoint is not None:
        job = {
            "parameters": (params, low, high),
            "poses": poses,
            "settings": str((steps, starts, seed, batch_size, tolerance)),
            "objective": (qualified_name(objective), qualified_name(build), _traced(programs, units, numbers)),
            "constraints": list(map(qualified_name, constraints)),
            "optimizer": optimizer and traced(step, state, 0, False),
        }
    unit, each = float(scale.objective), scale.of_entries(sizes)
    small = None if tolerance is None else tolerance / unit
    run = _run(step, state, steps, small, checkpoint, job, unit)
    best = jax.tree.map(jnp.asarray, run.state.best)
    started = run.log[0][0, 0], run.log[1][0, 0]
    if batch_size is not None:
        judged = jax.tree.map(lambda first, others: jnp.concatenate([first[:1], others]), units, best.units)
        over_all = programs.judge(judged, numbers)[0]
        best, started = dataclasses.replace(best, objective=over_all[1:]), (over_all[0], started[1])
    chosen, status = _chosen(best, started)
    all_params = jax.vmap(between, (0, None, None))(best.units, low, high)
    design = jax.tree.map(lambda leaf: leaf[chosen], all_params)
    refusal = _refusal(build, design)
    log = run.log[0] * unit, run.log[1], run.log[2] * (unit / each)
    return DesignResult(
        params=design,
        robot=programs.build(design),  # which refuses nothing, so that a design that is no robot is returned, too
        initial=initial,
        history=History(*map(jnp.asarray, log)),
        starts=Starts(all_params, best.objective * unit, best.violation),
        prices=prices_of(*_last(programs, step, run.state, numbers), chosen, (low, high), unit, each),
        status=DesignStatus.IMPOSSIBLE if refusal and status <= DesignStatus.NOT_IMPROVED else status,
        reason=run.reason,
        message=" ".join(filter(None, [refusal, *_hints(first, given)])),
    )


class _Programs(NamedTuple):
    """The compiled functions of an optimization; bounds and poses are their arguments."""

    evaluate: Evaluate
    slopes: Callable[..., Any]  # (units, own, shared) -> ((slopes, rows), ...) of all starts
    step: Step
    begin: Callable[..., Any]  # (units, own, shared) -> the state before the first step
    screen: Callable[..., Any]  # (units, numbers) -> objectives over the first batch, violations
    judge: Callable[..., Any]  # the same over all poses, one by one
    build: Callable[[Any], Any]


@functools.lru_cache(maxsize=_KEPT)
def _programs(
    objective: Any, build: Any, constraints: tuple[Any, ...], optimizer: Any, steps: int, batch_size: int | None
) -> _Programs:
    """The programs of these functions; a second optimization of the same ones compiles nothing."""

    def measured(unit, _, shared, size=batch_size):
        (low, high, poses), number = shared
        robot = build(between(unit, low, high))
        return _number(objective(robot, *_batch(poses, size, number))), slacks_of(constraints, robot)

    def evaluate(unit, own, shared, size=batch_size):
        (*numbers, scale), number = shared
        value, slacks = measured(unit, own, (numbers, number), size)
        return value / scale.objective, tuple(slack / one for slack, one in zip(slacks, scale.slacks, strict=True))

    def screen(units: Any, numbers: Any, size: int | None = batch_size, together: int | None = _TOGETHER):
        def one(unit):
            objective, slacks = evaluate(unit, (), (numbers, jnp.uint32(0)), size)
            slack = joined(slacks)
            short = jnp.max(jnp.maximum(-jnp.where(jnp.isnan(slack), -jnp.inf, slack), 0), initial=ALLOWED)
            return objective, jnp.where(jnp.isfinite(objective), short, jnp.inf)

        return jax.lax.map(one, units, batch_size=together)

    if optimizer is None and batch_size is None:
        slopes = linearizer(evaluate)
        step, begin = sqp_stepper(slopes), partial(sqp_begun, evaluate=evaluate)
    else:
        slopes = sampled_slopes(evaluate)
        optimizer = optimizer or adam(steps)
        step = stepper(evaluate, optimizer, comparable=batch_size is None)
        begin = partial(begun, optimizer=optimizer, evaluate=evaluate)
    judge = jax.jit(partial(screen, size=None, together=None))
    return _Programs(evaluate, slopes, step, begin, jax.jit(screen), judge, jax.jit(build))


def _last(programs: _Programs, step: Callable[..., Any], state: Any, numbers: Any) -> tuple[Any, Any, Any]:
    """The best designs, what a step sees there, and objectives and slacks with their slopes if all are known."""
    units = state.best.units
    sight = step(dataclasses.replace(state, units=units), 0, False)[1]
    (slopes, rows), (_, slacks) = programs.slopes(units, (), (numbers, jnp.uint32(0)))
    slack = np.concatenate([np.asarray(s, float) for s in slacks] or [np.zeros((len(slopes), 0))], axis=1)
    return units, sight, (slack, None if isinstance(state, Descent) else (slopes, rows))


def _number(value: Any) -> jax.Array:
    value = jnp.asarray(value)
    if value.shape or not jnp.issubdtype(value.dtype, jnp.floating):
        raise ValueError(f"Got an objective of shape {value.shape} and {value.dtype}; expected one real number.")
    return value


def _traced(programs: _Programs, units: Any, numbers: Any) -> Any:
    """What objective and constraints compute."""
    unit = jax.tree.map(lambda leaf: leaf[0], units)
    return traced(programs.evaluate, unit, (), (numbers, jnp.uint32(0)))


def _screened(programs: _Programs, numbers: Any, given: Any, starts: int, seed: int) -> Any:
    """The given design and the best of many random ones, in the unit cube."""
    if starts == 1:
        return given
    drawn = drawn_units(given, _DRAWN * starts, np.random.default_rng(seed))
    objective, violation = programs.screen(drawn, numbers)
    order = jnp.lexsort([objective, violation])[: starts - 1]
    return jax.tree.map(lambda first, others: jnp.concatenate([first, others[order]]), given, drawn)


class _Run(NamedTuple):
    """The state after the last step, and what all steps saw: objectives, violations, multipliers."""

    state: Descent
    log: tuple[np.ndarray, ...]
    reason: StopReason


def _run(
    step: Callable[..., Any],
    state: Descent,
    steps: int,
    tolerance: Any,
    checkpoint: Any,
    job: dict[str, Any],
    unit: float,
) -> _Run:
    """All steps, or those that a checkpoint lacks."""
    log = _empty_log(steps + 1, state)
    done, path = 0, None if checkpoint is None else os.fspath(checkpoint)
    if path is not None:
        done, (state, saved) = restore(path, job, (state, log))
        log = tuple(np.array(column) for column in saved)
    numbers = range(done, steps + 1)
    for number in progress(numbers, "design", "step", lambda i: f"objective {unit * np.nanmin(log[0][i]):.5f}"):
        if tolerance is not None and _settled(log, number, max(steps // 5, PERIOD), tolerance):
            return _Run(state, tuple(column[:number] for column in log), StopReason.SETTLED)
        log[2][number] = state.multipliers
        state, sight = step(state, number, number % PERIOD == PERIOD - 1)
        log[0][number], log[1][number] = sight.objective, sight.violation
        if path is not None and (number % PERIOD == PERIOD - 1 or number == steps):
            save(path, job, number + 1, (state, log))
    return _Run(state, log, StopReason.STEPS)


def _empty_log(rows: int, state: Descent) -> tuple[np.ndarray, ...]:
    columns = state.best.objective, state.best.violation, state.multipliers
    return tuple(np.full((rows, *column.shape), np.nan, column.dtype) for column in columns)


def _settled(log: tuple[np.ndarray, ...], number: int, window: int, tolerance: float) -> bool:
    """Whether every start has a design that keeps the constraints, and none a better one since the window began."""
    if number <= window:
        return False
    allowed = np.where(log[1][:number] <= ALLOWED, log[0][:number], np.inf)
    before = np.min(allowed[:-window], axis=0)
    return bool(np.all(before < np.inf) and np.all(np.min(allowed, axis=0) >= before - tolerance))


def _batch(poses: Any, size: int | None, number: jax.Array) -> tuple[Any, ...]:
    """What the objective is given besides the robot."""
    if poses is None:
        return ()
    if size is None:
        return (poses,)
    numbers = (number * jnp.uint32(size) + jnp.arange(size, dtype=jnp.uint32)) % jnp.uint32(len(poses))
    return (poses.poses(numbers) if isinstance(poses, Sample) else poses[numbers],)


def _check_counts(steps: int, starts: int, poses: Any, batch_size: int | None, tolerance: Any) -> None:
    if steps < 1 or starts < 1:
        raise ValueError(f"Got steps={steps} and starts={starts}; expected at least one of each.")
    if batch_size is None:
        return
    if poses is None or not 1 <= batch_size <= len(poses):
        raise ValueError(f"Got batch_size={batch_size}; expected poses, and from 1 to all of them in a batch.")
    if tolerance is not None:
        raise ValueError("Got a tolerance and a batch_size; objectives of different batches cannot be compared.")


def checked_bounds(params: Any, bounds: tuple[Any, Any]) -> tuple[Any, Any, Any]:
    """Parameters and their bounds as arrays of one structure, shape and dtype.

    Raises:
      ValueError: other structures, bounds that are not finite or out of order, parameters outside them.
    """
    low, high = bounds
    structures = {str(jax.tree.structure(tree)) for tree in (params, low, high)}
    if len(structures) > 1:
        raise ValueError(f"Got params and bounds of different structure: {sorted(structures)}.")
    params, low, high = as_floats(params, low, high)
    low, high = (jax.tree_util.tree_map_with_path(_spread_out, params, bound) for bound in (low, high))
    names = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(params)]
    leaves = zip(names, *(jax.tree.leaves(tree) for tree in (params, low, high)), strict=True)
    for name, value, a, b in leaves:
        own = f" of {name}" if name else ""
        if not np.all(np.isfinite(a) & np.isfinite(b) & (np.asarray(a) <= np.asarray(b))):
            raise ValueError(f"Got bounds {a} and {b}{own}; expected finite numbers, low <= high.")
        if not np.all((np.asarray(a) <= np.asarray(value)) & (np.asarray(value) <= np.asarray(b))):
            raise ValueError(f"Got params {value}{own} outside their bounds {a} to {b}.")
    return params, low, high


def _spread_out(path: Any, value: jax.Array, bound: jax.Array) -> jax.Array:
    return broadcast(f"bounds {jax.tree_util.keystr(path)}".rstrip(), bound, value.shape)


def _chosen(best: Seen, started: tuple[Any, Any]) -> tuple[int, DesignStatus]:
    """Which start has the best design, and what that is worth; ``started`` is objective and violation at first."""
    value, kept = best.objective, (best.violation <= ALLOWED) & jnp.isfinite(best.objective)
    if not bool(jnp.any(jnp.isfinite(value))):
        return 0, DesignStatus.NONFINITE
    if not bool(jnp.any(kept)):
        return int(jnp.argmin(best.violation)), DesignStatus.INFEASIBLE
    chosen = int(jnp.argmin(jnp.where(kept, value, jnp.inf)))
    improved = not (started[1] <= ALLOWED) or bool(value[chosen] < started[0])
    return chosen, DesignStatus.IMPROVED if improved else DesignStatus.NOT_IMPROVED


def _refusal(build: Callable[[Any], Any], design: Any) -> str:
    """Why no robot can be built of a design; nothing if one can."""
    try:
        build(design)
    except ValueError as error:
        return f"The best design describes no robot: {error}"
    return ""


def _hints(first: Any, given: Any) -> Iterator[str]:
    """What the first slopes say about an optimization that cannot go on as it should."""
    (slope, rows), (value, slacks) = jax.tree.map(lambda leaf: np.asarray(leaf[0]), first)
    leaves = jax.tree_util.tree_leaves_with_path(given)
    parts = np.split(np.vstack([slope, *rows]), np.cumsum([leaf[0].size for _, leaf in leaves])[:-1], axis=1)
    names = [jax.tree_util.keystr(path) or "the parameter" for path, _ in leaves]
    broken = [name for name, part in zip(names, parts, strict=True) if not np.isfinite(part[0]).all()]
    still = [name for name, part in zip(names, parts, strict=True) if not part.any()]
    if broken and np.isfinite(value):
        yield f"The objective is finite at the start, but its derivative is not: by {', '.join(broken)}."
    if not slope.any():
        yield (
            "The derivative of the objective is zero at the start: a stationary point, or an objective that has none, "
            "such as a count of poses (workspace_fraction), for which soft_workspace_fraction and "
            "exact_workspace_fraction stand in."
        )
    elif still:
        yield f"Neither the objective nor a constraint depends on {', '.join(still)} at the start."
    for number, slack in enumerate(slacks):
        if slack.size and np.isnan(slack).all():
            yield f"Constraint {number} is nan at the start, in every entry."
