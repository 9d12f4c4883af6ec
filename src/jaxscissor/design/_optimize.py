"""Design optimization: the best robot within bounds, by the gradient of any metric."""

from __future__ import annotations

import dataclasses
import functools
import os
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.checkpoint import qualified_name, traced
from jaxscissor._engine.pytree import as_floats, broadcast
from jaxscissor._engine.types import PyTree
from jaxscissor.design._methods import SQP, AugmentedLagrangian, Method, checked_method
from jaxscissor.design._multipliers import multipliers_at
from jaxscissor.design._problem import (
    FEASIBLE,
    Evaluate,
    Incumbent,
    Solver,
    concatenated,
    constraint_values,
    from_unit,
    random_units,
    to_units,
)
from jaxscissor.design._result import DesignResult, History, Starts
from jaxscissor.design._run import Clock, run
from jaxscissor.design._scaling import Scale, first_scale
from jaxscissor.design._throughout import Throughout, exchanged
from jaxscissor.kinematics._solution import Status
from jaxscissor.regions._regions import Sample
from jaxscissor.regions._samples import PosesLike

_DRAWN, _TOGETHER = 64, 16  # random designs per start, and how many of them are evaluated together
_KEPT = 16  # optimizations whose programs are kept for another call


def optimize(
    objective: Callable[..., Any],
    params: PyTree,
    *,
    bounds: tuple[Any, Any],
    steps: int,
    build: Callable[[Any], Any] = lambda params: params,
    method: Method | None = None,
    constraints: Sequence[Callable[[Any], Any]] = (),
    starts: int = 1,
    seed: int = 0,
    poses: PosesLike | None = None,
    batch_size: int | None = None,
    tolerance: float | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> DesignResult:
    """Minimize ``objective(build(params))`` within bounds and under constraints, by gradient.

    The parameters are scaled to their bounds, objective and constraints to their first slopes, so that no unit matters.
    All starts run in one vmapped program. As under ``jax.jit``, what the functions read besides their
    arguments is fixed at the first call; another optimization of the same functions, from other parameters, bounds
    or poses, compiles nothing.

    Args:
      objective: metric of a robot, a scalar; to maximize, give its negative.
      params: any pytree of numbers, or a robot. The first start.
      bounds: (low, high), two pytrees like ``params``, finite. Equal bounds keep a number fixed.
      steps: steps of the optimizer.
      build: makes the robot of the parameters.
      method: ``design.SQP()``, the default, or ``design.AugmentedLagrangian(optimizer)`` with an optimizer of optax,
        the better choice for hundreds of parameters, and the default with batches.
      constraints: functions of a robot, satisfied where every entry is >= 0; all entries of one in the same unit. An
        entry that is ``nan``, of a pose that is not reached, counts as violated but does not pull: give the
        margin, too. A ``design.Throughout`` is kept all over a region.
      starts: number of starts; those after the first are the best among random designs, 64 per start.
      seed: of the random designs.
      poses: ``(n, d)`` poses, or a sample of a region, for an ``objective(robot, poses)``.
      batch_size: poses of which each step sees that many, the next ones, round and round. Objectives of two
        steps then cannot be compared: each start's design is its latest that keeps the constraints, and in
        the end the starts are compared over all poses.
      tolerance: stop when over the last fifth of ``steps`` no start's best objective fell by more.
      checkpoint: path of an ``.npz`` file, replaced every ten steps. An optimization that was stopped goes on
        from there when called again, to the same result; a finished one is read, or continued if more steps are
        asked for, unless the learning rate depends on their number, as the default one of
        ``AugmentedLagrangian`` does.

    Returns:
      ``design.DesignResult`` with the best design that any step found and that violates no constraint by more
      than a thousandth of the slope that it has at first across the bounds; by SQP, than a millionth if there is one.
      Ctrl-C ends the steps and returns the best design so far. ``print`` shows the result in some ten lines.

    Raises:
      ValueError: bounds that are not finite, out of order, or of another structure than ``params``;
        params outside them, or of which no robot can be built; an objective that is no number, a constraint that
        is no real numbers, an unknown method; fewer than one step or start; batches without
        poses, or larger than all of them, or with a tolerance; the checkpoint of another optimization.

    Example:
      >>> result = optimize(lambda x: (x - 2.0) ** 2, 0.5, bounds=(0.0, 1.0), steps=50)
      >>> round(float(result.params), 3), result.status.name, round(float(result.multipliers.high), 3)
      (1.0, 'IMPROVED', 2.0)
    """
    limits = [constraint for constraint in constraints if isinstance(constraint, Throughout)]
    if limits and checkpoint is not None:
        raise ValueError("Got a checkpoint and a Throughout, which takes several optimizations; leave one of them out.")
    problem = _Problem(
        objective,
        bounds,
        steps,
        build,
        method,
        tuple(constraints),
        starts,
        seed,
        poses,
        batch_size,
        tolerance,
        checkpoint,
    )
    return exchanged(partial(_optimized, problem), params, limits) if limits else _optimized(problem, params, ())


class _Problem(NamedTuple):
    """What is optimized and how, but for the first start."""

    objective: Callable[..., Any]
    bounds: tuple[Any, Any]
    steps: int
    build: Callable[[Any], Any]
    method: Method | None
    constraints: tuple[Any, ...]
    starts: int
    seed: int
    poses: PosesLike | None
    batch_size: int | None
    tolerance: float | None
    checkpoint: str | os.PathLike[str] | None


def _optimized(problem: _Problem, params: PyTree, at: tuple[jax.Array, ...]) -> DesignResult:
    """One optimization, with constraints throughout regions at the poses ``at`` of each."""
    objective, bounds, steps, build, method, constraints, starts, seed, poses, batch_size, tolerance, checkpoint = (
        problem
    )
    clock = Clock()
    stored = poses if poses is None or isinstance(poses, Sample) else jnp.asarray(poses)
    _check_counts(steps, starts, stored, batch_size, tolerance)
    method = checked_method(method, SQP() if batch_size is None else AugmentedLagrangian())
    if batch_size is not None and isinstance(method, SQP):
        raise ValueError("Got batches and SQP, whose steps must see one objective; pass AugmentedLagrangian().")
    params, low, high = checked_bounds(params, bounds)
    initial = build(params)  # at once: it may refuse the parameters
    programs = _programs(objective, build, constraints, method, steps, batch_size)
    given = to_units(params, low, high)
    one = np.ones((), jax.tree.leaves(low)[0].dtype)
    plain = (low, high, stored, Scale(one, (one,) * len(constraints)), at), jnp.uint32(0)
    first = programs.solver.linearize(given, (), plain)
    scale, sizes = first_scale(first)
    numbers = low, high, stored, scale, at
    units = _screened(programs, numbers, given, starts, seed)
    state = programs.solver.init(units, (), (numbers, jnp.uint32(0)))

    def step(state: PyTree, number: jax.Array, update: bool | jax.Array):
        return programs.solver.step(state, (), (numbers, jnp.uint32(number)), update)

    job = {}
    if checkpoint is not None:
        job = {
            "parameters": (params, low, high),
            "poses": stored,
            "settings": str((starts, seed, batch_size)),
            "objective": (qualified_name(objective), qualified_name(build), _traced(programs, units, numbers)),
            "constraints": list(map(qualified_name, constraints)),
            "method": _traced_method(method, step, state),
        }
    unit, each = float(scale.objective), scale.of_entries(sizes)
    small = None if tolerance is None else tolerance / unit
    done = run(step, state, steps, small, checkpoint, job, unit, clock)
    best = jax.tree.map(jnp.asarray, done.state.best)
    started = done.log[0][0, 0], done.log[1][0, 0]
    if batch_size is not None:
        judged = jax.tree.map(lambda first, others: jnp.concatenate([first[:1], others]), units, best.units)
        over_all = programs.judge(judged, numbers)[0]
        best, started = dataclasses.replace(best, objective=over_all[1:]), (over_all[0], started[1])
    chosen, status = _chosen(best, started)
    all_params = jax.vmap(from_unit, (0, None, None))(best.units, low, high)
    design = jax.tree.map(lambda leaf: leaf[chosen], all_params)
    refusal = _refusal(build, design)
    if status in (Status.IMPROVED, Status.NOT_IMPROVED):
        status = Status.IMPOSSIBLE if refusal else Status.INTERRUPTED if done.interrupted else status
    log = done.log[0] * unit, done.log[1], done.log[2] * (unit / each)
    return DesignResult(
        params=design,
        robot=programs.build(design),  # which refuses nothing, so that a design that is no robot is returned, too
        initial=initial,
        history=History(*map(jnp.asarray, log)),
        starts=Starts(all_params, best.objective * unit, best.violation),
        multipliers=multipliers_at(
            *_at_best(programs, method, step, done.state, numbers), chosen, (low, high), unit, each
        ),
        objective=(jnp.asarray(started[0] * unit), best.objective[chosen] * unit),
        worst=(),
        status=status,
        settled=done.settled,
        seconds=done.seconds,
        entries=tuple(zip(map(_name, constraints, range(len(constraints))), sizes, strict=True)),
        message=" ".join(filter(None, [refusal, *_hints(first, given)])),
    )


class _Programs(NamedTuple):
    """The compiled functions of an optimization; bounds and poses are their arguments."""

    evaluate: Evaluate
    solver: Solver
    screen: Callable[..., Any]  # (units, numbers) -> objectives over the first batch, violations
    judge: Callable[..., Any]  # the same over all poses, one by one
    build: Callable[[Any], Any]


@functools.lru_cache(maxsize=_KEPT)
def _programs(
    objective: Callable[..., Any],
    build: Callable[..., Any],
    constraints: tuple[Any, ...],
    method: Method,
    steps: int,
    batch_size: int | None,
) -> _Programs:
    """The programs of these functions; a second optimization of the same ones compiles nothing."""

    def evaluate(unit: PyTree, _: object, shared_args: PyTree, size: int | None = batch_size):
        (low, high, poses, scale, at), number = shared_args
        robot = build(from_unit(unit, low, high))
        value = _number(objective(robot, *_batch(poses, size, number)))
        values = zip(constraint_values(constraints, robot, at), scale.constraints, strict=True)
        return value / scale.objective, tuple(entries / one for entries, one in values)

    def screen(units: PyTree, numbers: PyTree, size: int | None = batch_size, together: int | None = _TOGETHER):
        def one(unit: PyTree):
            objective, constraints = evaluate(unit, (), (numbers, jnp.uint32(0)), size)
            c = concatenated(constraints)
            violation = jnp.max(jnp.maximum(-jnp.where(jnp.isnan(c), -jnp.inf, c), 0), initial=FEASIBLE)
            return objective, jnp.where(jnp.isfinite(objective), violation, jnp.inf)

        return jax.lax.map(one, units, batch_size=together)

    solver = method.solver(evaluate, steps, batch_size is None)
    judge = jax.jit(partial(screen, size=None, together=None))
    return _Programs(evaluate, solver, jax.jit(screen), judge, jax.jit(build))


def _at_best(
    programs: _Programs, method: Method, step: Callable[..., Any], state: PyTree, numbers: PyTree
) -> tuple[Any, Any, Any, Any]:
    """The best designs, what a step finds there, the constraints, and the derivatives if those of each are known."""
    units = state.best.units
    info = step(dataclasses.replace(state, units=units), 0, False)[1]
    derivatives, (_, constraints) = programs.solver.linearize(units, (), (numbers, jnp.uint32(0)))
    empty = np.zeros((len(derivatives[0]), 0))
    values = np.concatenate([empty, *(np.asarray(entries, float) for entries in constraints)], axis=1)
    return units, info, values, derivatives if isinstance(method, SQP) else None


def _number(value: Any) -> jax.Array:
    value = jnp.asarray(value)
    if value.shape or not jnp.issubdtype(value.dtype, jnp.floating):
        raise ValueError(f"Got an objective of shape {value.shape} and {value.dtype}; expected one real number.")
    return value


def _traced_method(method: Method, step: Callable[..., Any], state: PyTree) -> Any:
    """What identifies the method: of an optimizer of optax, what a step computes."""
    return "SQP" if isinstance(method, SQP) else traced(step, state, 0, False)


def _traced(programs: _Programs, units: PyTree, numbers: PyTree) -> Any:
    """What objective and constraints compute."""
    unit = jax.tree.map(lambda leaf: leaf[0], units)
    return traced(programs.evaluate, unit, (), (numbers, jnp.uint32(0)))


def _screened(programs: _Programs, numbers: PyTree, given: PyTree, starts: int, seed: int) -> Any:
    """The given design and the best of many random ones, in the unit cube."""
    if starts == 1:
        return given
    drawn = random_units(given, _DRAWN * starts, np.random.default_rng(seed))
    objective, violation = programs.screen(drawn, numbers)
    order = jnp.lexsort([objective, violation])[: starts - 1]
    return jax.tree.map(lambda first, others: jnp.concatenate([first, others[order]]), given, drawn)


def _batch(poses: Sample | jax.Array | None, size: int | None, number: jax.Array) -> tuple[Any, ...]:
    """What the objective is given besides the robot."""
    if poses is None:
        return ()
    if size is None:
        return (poses,)
    numbers = (number * jnp.uint32(size) + jnp.arange(size, dtype=jnp.uint32)) % jnp.uint32(len(poses))
    return (poses.poses(numbers) if isinstance(poses, Sample) else poses[numbers],)


def _check_counts(
    steps: int, starts: int, poses: Sample | jax.Array | None, batch_size: int | None, tolerance: float | None
) -> None:
    if steps < 1 or starts < 1:
        raise ValueError(f"Got steps={steps} and starts={starts}; expected at least one of each.")
    if batch_size is None:
        return
    if poses is None or not 1 <= batch_size <= len(poses):
        raise ValueError(f"Got batch_size={batch_size}; expected poses, and from 1 to all of them in a batch.")
    if tolerance is not None:
        raise ValueError("Got a tolerance and a batch_size; objectives of different batches cannot be compared.")


def checked_bounds(params: PyTree, bounds: tuple[Any, Any]) -> tuple[Any, Any, Any]:
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


def _spread_out(path: PyTree, value: jax.Array, bound: jax.Array) -> jax.Array:
    return broadcast(f"bounds {jax.tree_util.keystr(path)}".rstrip(), bound, value.shape)


def _chosen(best: Incumbent, started: tuple[Any, Any]) -> tuple[int, Status]:
    """Which start has the best design, and what that is worth; ``started`` is objective and violation at first."""
    value, kept = best.objective, (best.violation <= FEASIBLE) & jnp.isfinite(best.objective)
    if not bool(jnp.any(jnp.isfinite(value))):
        return 0, Status.NONFINITE
    if not bool(jnp.any(kept)):
        return int(jnp.argmin(best.violation)), Status.INFEASIBLE
    chosen = int(jnp.argmin(jnp.where(kept, value, jnp.inf)))
    improved = not (started[1] <= FEASIBLE) or bool(value[chosen] < started[0])
    return chosen, Status.IMPROVED if improved else Status.NOT_IMPROVED


def _name(constraint: Callable[..., Any], number: int) -> str:
    """What a constraint is called: as its function, or if that has no name by its number."""
    name = qualified_name(getattr(constraint, "quantity", constraint)).split(".")[-1]
    return f"constraint {number}" if name == "<lambda>" else name


def _refusal(build: Callable[[Any], Any], design: PyTree) -> str:
    """Why no robot can be built of a design; nothing if one can."""
    try:
        build(design)
    except ValueError as error:
        return f"The best design describes no robot: {error}"
    return ""


def _hints(first: PyTree, given: PyTree) -> Iterator[str]:
    """What the first slopes say about an optimization that cannot go on as it should."""
    (slope, rows), (value, constraints) = jax.tree.map(lambda leaf: np.asarray(leaf[0]), first)
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
            "such as a count of poses (workspace.fraction), for which workspace.soft_fraction and "
            "workspace.ray_fraction stand in."
        )
    elif still:
        yield f"Neither the objective nor a constraint depends on {', '.join(still)} at the start."
    for index, values in enumerate(constraints):
        if values.size and np.isnan(values).all():
            yield f"Constraint {index} is nan at the start, in every entry."
