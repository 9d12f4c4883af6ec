"""Sequential quadratic programming in the unit cube: few steps to a minimum at which constraints bind.

The robots are evaluated in one vmapped program; the small quadratic programs are solved beside it, in NumPy.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jax.flatten_util import ravel_pytree

from jaxscissor._engine.pytree import pytree
from jaxscissor._engine.types import PyTree
from jaxscissor.design._problem import Evaluate, Incumbent, Step, StepInfo, concatenated, per_start
from jaxscissor.design._quadratic_program import Linearization, quadratic_program

_PENALTY, _LEAST_PENALTY = 10.0, 0.1  # weight of a violation at first, and at least
_MARGIN = 3.0  # of the penalty over the multipliers
_RADIUS = 0.2  # of the first trust region, in widths of the bounds
_NEAR = 1e-3  # a constraint whose linearization stays farther from zero in the trust region is left out
_NOISE = 1e-12  # predicted decrease of the merit, relative to it, below which rounding dominates
_SATISFIED = 1e-6  # violation below which a design counts as feasible, and the penalty may fall


@pytree
class SQPState:
    """State of all starts between two steps."""

    units: Any  # the trial points, evaluated next
    x: Any  # the current iterates, flat: the best by merit
    at_x: Linearization
    hessian: Any  # of the Lagrangian, by BFGS
    radius: Any  # of the trust region
    predicted_decrease: Any  # of the merit from ``x`` to ``units``, by the model
    is_corrected: Any  # whether ``units`` comes from a second-order correction
    penalty: Any  # weight of the violations in the merit
    multipliers: Any
    best: Incumbent


def linearizer(evaluate: Evaluate) -> Callable[..., Any]:
    """The program that gives ``((gradients, jacobians), (objectives, constraints))`` of all starts."""

    @jax.jit
    def linearize(units: PyTree, start_args: PyTree, shared_args: PyTree):
        def one(unit: PyTree, start_args: PyTree):
            flat, rebuild = ravel_pytree(unit)

            def both(flat: jax.Array):
                value, constraints = evaluate(rebuild(flat), start_args, shared_args)
                return (value, concatenated(constraints)), (value, constraints)

            return jax.jacfwd(both, has_aux=True)(flat)

        return per_start(one, (0, 0))(units, start_args)

    return linearize


def sqp_step(linearize: Callable[..., Any]) -> Step:
    """The function of one step of all starts: S l1 QP in a trust region [Nocedal and Wright, section 18.5].

    The merit is f(x) + penalty * sum max(-c(x), 0). One step:

    1. Evaluate objective, constraints and derivatives at the trial point.
    2. Accept it if the merit decreased. If not, and it was not corrected yet, try once more from the same iterate with
       the constraints' curvature along the step, c(x + d) - c(x) - J d, added to their linearization.
       Without that a step along a curved constraint may never be accepted (the Maratos effect, section 15.6 there).
    3. Update the trust region by the ratio of the actual to the predicted decrease, and the Hessian by damped BFGS.
    4. Adapt the penalty to the multipliers.
    5. Minimize the model in the intersection of trust region and unit cube: the next trial point.
    """

    def step(
        state: SQPState, start_args: PyTree, shared_args: PyTree, update: bool | jax.Array
    ) -> tuple[SQPState, StepInfo]:
        trial, values = _linearization(linearize(state.units, start_args, shared_args))
        decrease, trial = _actual_decrease(state, trial)
        x_trial = _flat(state.units)
        accepted = decrease > 0
        moved = (x_trial != state.x).any(axis=1)
        corrected = ~accepted & (decrease > -np.inf) & ~state.is_corrected
        radius = np.where(corrected & moved, state.radius, _updated_radius(state, x_trial, decrease))
        hessian = _updated_hessian(state, x_trial, trial, decrease > -np.inf)
        curvature = trial.constraints - state.at_x.constraints
        curvature = curvature - np.einsum("smn,sn->sm", state.at_x.jacobian, x_trial - state.x)
        x, at_x = _select(accepted, (x_trial, trial), (state.x, state.at_x))
        penalty = _updated_penalty(state, at_x)
        model = at_x._replace(constraints=at_x.constraints + np.where(corrected[:, None], curvature, 0))
        low, high = np.maximum(-x, -radius[:, None]), np.minimum(1 - x, radius[:, None])
        d, multipliers, change = _model_minimum(model, hessian, low, high, penalty)
        units = _unflat(np.clip(x + d, 0, 1), state.units)
        violation = np.maximum(-np.where(np.isnan(values), -np.inf, values), 0).max(axis=1, initial=0)
        weight = np.maximum(state.penalty, 2 * state.multipliers.sum(axis=1))
        best = _better(state.best, Incumbent(state.units, trial.value, violation), weight)
        predicted = penalty * at_x.total_violation() - change
        after = SQPState(units, x, at_x, hessian, radius, predicted, corrected, penalty, multipliers, best)
        gradient = at_x.gradient - np.einsum("sm,smn->sn", multipliers, at_x.jacobian)
        return after, StepInfo(trial.value, violation, multipliers, _unflat(gradient, units))

    return step


def sqp_init(units: PyTree, start_args: PyTree, shared_args: PyTree, *, evaluate: Evaluate) -> SQPState:
    """All starts before their first step."""
    first = jax.tree.map(lambda leaf: leaf[0], (units, start_args))
    many = sum(values.shape[0] for values in jax.eval_shape(evaluate, *first, shared_args)[1])
    x = _flat(units)
    starts, size = x.shape
    unseen, zero, no_constraints = np.full(starts, np.inf), np.zeros(starts), np.zeros((starts, many))
    return SQPState(
        units=units,
        x=x,
        at_x=Linearization(unseen, np.zeros((starts, size)), no_constraints, np.zeros((starts, many, size))),
        hessian=np.tile(np.eye(size), (starts, 1, 1)),
        radius=zero + _RADIUS,
        predicted_decrease=zero,
        is_corrected=zero > 0,
        penalty=zero + _PENALTY,
        multipliers=no_constraints,
        best=Incumbent(units, unseen, unseen),
    )


def _linearization(found: PyTree) -> tuple[Linearization, np.ndarray]:
    """What the compiled program gave, in NumPy, and the values of all constraints, ``nan`` included."""
    (gradient, jacobian), (value, constraints) = jax.tree.map(np.asarray, found)
    values = np.concatenate(constraints, axis=1) if constraints else np.zeros((len(value), 0), value.dtype)
    return Linearization(value, gradient, values, jacobian), values


def _model_minimum(
    model: Linearization, hessian: np.ndarray, low: np.ndarray, high: np.ndarray, penalty: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As ``quadratic_program``, which is given only as many constraints as may bind within the box."""
    least = model.constraints - (np.abs(model.jacobian) @ np.maximum(-low, high)[..., None])[..., 0]
    first = np.argsort(least, axis=1)[:, : (least < _NEAR).sum(axis=1).max(initial=0)]
    near = model._replace(
        constraints=np.take_along_axis(model.constraints, first, 1),
        jacobian=np.take_along_axis(model.jacobian, first[..., None], 1),
    )
    d, of_near, change = quadratic_program(near, hessian, low, high, penalty)
    multipliers = np.zeros_like(model.constraints)
    np.put_along_axis(multipliers, first, of_near, 1)
    return d, multipliers, change


def _actual_decrease(state: SQPState, trial: Linearization) -> tuple[np.ndarray, Linearization]:
    """Decrease of the merit, ``-inf`` where the trial is not finite; and the trial with finite constraints."""
    known = np.isfinite(trial.constraints)
    constraints = np.nan_to_num(trial.constraints, nan=-1, posinf=1, neginf=-1)
    jacobian = np.where(known[..., None], trial.jacobian, 0)
    trial = trial._replace(constraints=constraints, jacobian=jacobian)
    finite = np.isfinite(trial.value) & np.isfinite(trial.gradient).all(axis=1) & np.isfinite(jacobian).all(axis=(1, 2))
    old = state.at_x.value + state.penalty * state.at_x.total_violation()
    new = np.where(finite, trial.value, 0) + state.penalty * trial.total_violation()
    return np.where(finite, old - new, -np.inf), trial


def _updated_penalty(state: SQPState, at_x: Linearization) -> np.ndarray:
    """Penalty for the next step: three times the largest multiplier of the last model, reached by factors of four.

    It must exceed every multiplier for the merit to have its minimum where the constraints are kept, but one that is
    much greater lets only short steps along a curved constraint lower the merit. It does not fall while the iterate
    violates a constraint.
    """
    largest = state.multipliers.max(axis=1, initial=0)
    wanted = np.where(largest > 0.9 * state.penalty, 4 * state.penalty, _MARGIN * largest)
    wanted = np.clip(wanted, state.penalty / 4, 4 * state.penalty)
    violated = at_x.total_violation() > _SATISFIED
    return np.clip(np.where(violated, np.maximum(wanted, state.penalty), wanted), _LEAST_PENALTY, None)


def _updated_radius(state: SQPState, x_trial: np.ndarray, decrease: np.ndarray) -> np.ndarray:
    """Trust-region radius after a step with this decrease [Nocedal and Wright, algorithm 4.1].

    It is reset after a step of length zero, so that newly active constraints are found, and kept where the predicted
    decrease is rounding.
    """
    length = np.abs(x_trial - state.x).max(axis=1)
    ratio = decrease / np.maximum(state.predicted_decrease, 1e-15)
    grown = np.where(length > 0.9 * state.radius, np.minimum(2 * state.radius, 1), state.radius)
    updated = np.where(ratio > 0.75, grown, np.where(ratio < 0.25, length / 4, state.radius))
    known = np.isfinite(state.at_x.value)
    noise = _NOISE * (1 + np.abs(np.where(known, state.at_x.value, 0)))
    radius = np.where(known & (state.predicted_decrease > noise), updated, state.radius)
    return np.where(length > 0, radius, _RADIUS)


def _updated_hessian(state: SQPState, x_trial: np.ndarray, trial: Linearization, finite: np.ndarray) -> np.ndarray:
    """Hessian of the Lagrangian after a step s, by BFGS with Powell's damping [Nocedal and Wright, procedure 18.2].

    With y the change of the Lagrangian's gradient, r = theta y + (1 - theta) B s takes its place, theta such that
    s.r >= 0.2 s.B s, and B becomes B - B s (B s)^T / (s.B s) + r r^T / (s.r).
    """
    known = finite & np.isfinite(state.at_x.value)
    of_constraints = np.einsum("sm,smn->sn", state.multipliers, trial.jacobian - state.at_x.jacobian)
    s = x_trial - state.x
    y = np.where(known[:, None], trial.gradient - state.at_x.gradient - of_constraints, 0)
    bs = np.einsum("sij,sj->si", state.hessian, s)
    s_bs, s_y = (s * bs).sum(axis=1), (s * y).sum(axis=1)
    known = known & (s_bs > 0)
    s_bs, s_y = np.where(known, s_bs, 1), np.where(known, s_y, 1)
    theta = np.where(s_y < 0.2 * s_bs, 0.8 * s_bs / np.where(s_y < s_bs, s_bs - s_y, 1), 1)[:, None]
    r = np.where(known[:, None], theta * y + (1 - theta) * bs, 1)
    s_r = np.where(known, (s * r).sum(axis=1), 1)
    update = r[:, :, None] * r[:, None] / s_r[:, None, None] - bs[:, :, None] * bs[:, None] / s_bs[:, None, None]
    return state.hessian + np.where(known[:, None, None], update, 0)


def _better(old: Incumbent, new: Incumbent, weight: np.ndarray) -> Incumbent:
    """The better of two designs of every start: feasibility first, then the objective.

    Feasible is what rounding and the interior-point method leave, and a violation within that is charged for: else the
    design that violates most would win.
    """
    old_excess, excess = (np.maximum(design.violation - _SATISFIED, 0) for design in (old, new))
    with np.errstate(invalid="ignore"):
        lower = new.objective + weight * new.violation < old.objective + weight * old.violation
    wins = (excess < old_excess) | ((excess == old_excess) & lower) | ~np.isfinite(old.objective)
    wins = np.isfinite(new.objective) & wins
    return _select(wins, new, old)


def _select(chosen: np.ndarray, new: Any, old: Any) -> Any:
    """``new`` for the chosen starts, ``old`` for the others, leaf by leaf."""
    return jax.tree.map(lambda a, b: np.where(chosen.reshape(-1, *[1] * (np.ndim(a) - 1)), a, b), new, old)


def _flat(units: PyTree) -> np.ndarray:
    """Points of all starts as vectors ``(starts, n)``."""
    return np.concatenate([np.reshape(leaf, (len(leaf), -1)) for leaf in jax.tree.leaves(units)], axis=1).astype(float)


def _unflat(flat: np.ndarray, like: PyTree) -> Any:
    """The inverse of ``_flat``."""
    leaves, structure = jax.tree.flatten(like)
    ends = np.cumsum([np.size(leaf[0]) for leaf in leaves])
    parts = np.split(flat, ends[:-1], axis=1)
    return jax.tree.unflatten(
        structure, [part.reshape(leaf.shape).astype(leaf.dtype) for part, leaf in zip(parts, leaves, strict=True)]
    )
