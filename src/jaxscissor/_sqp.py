"""Sequential quadratic programming in the unit cube: few steps to a minimum at which constraints bind.

The robots are evaluated in one vmapped program; the small quadratic programs are solved beside it, in NumPy.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.flatten_util import ravel_pytree

from jaxscissor._descent import ALLOWED, Evaluate, Seen, Sight, Step, joined, of_each_start
from jaxscissor._pytree import pytree

_WEIGHT = 10.0  # of a violation in the merit at first; more than the price of any constraint
_RADIUS = 0.2  # of the first step, in widths of the bounds
_POINTS = 40  # steps of the interior-point method, at most
_GAP, _TINY = 1e-11, 1e-14  # complementarity that counts as solved, least distance from a bound
_CLOSE = 1e-3  # slack beyond the trust region below which a constraint is looked at
_NOISE = 1e-12  # promised fall of the merit, beside one, that rounding hides
_KEPT = 1e-6  # violation that asks for no greater weight


class Linear(NamedTuple):
    """Objective and slacks of all starts, and their derivatives."""

    value: np.ndarray  # (starts,)
    slope: np.ndarray  # (starts, n)
    slack: np.ndarray  # (starts, m)
    rows: np.ndarray  # (starts, m, n)

    def short(self) -> np.ndarray:
        """Sum of the violations."""
        return np.maximum(-self.slack, 0).sum(axis=1)


@pytree
class Program:
    """State of all starts between two steps."""

    units: Any  # to be seen next
    at: Any  # the best so far by merit, flat
    near: Linear  # what was seen there
    curvature: Any  # of the Lagrangian
    radius: Any  # of the trust region
    promised: Any  # fall of the merit from ``at`` to ``units``, by the model
    again: Any  # whether ``units`` is a step corrected for the curvature of the constraints
    weight: Any  # of the violations
    multipliers: Any
    best: Seen


def linearizer(evaluate: Evaluate) -> Callable[..., Any]:
    """The program that gives ``((slopes, rows), (objectives, slacks))`` of all starts."""

    @jax.jit
    def seen(units, own, shared):
        def one(unit, own):
            flat, rebuild = ravel_pytree(unit)

            def both(flat):
                value, slacks = evaluate(rebuild(flat), own, shared)
                return (value, joined(slacks)), (value, slacks)

            return jax.jacfwd(both, has_aux=True)(flat)

        return of_each_start(one, (0, 0))(units, own)

    return seen


def sqp_stepper(seen: Callable[..., Any]) -> Step:
    """The function ``step(state, own, shared, raises)`` of one step of all starts, as of ``stepper``.

    A trust region on the exact penalty, with second-order correction [Fletcher, Practical Methods of Optimization,
    14.4]: the model is the Lagrangian's quadratic, by damped BFGS, under linearized constraints.
    """

    def step(state: Program, own, shared, raises):
        (slope, rows), (value, slacks) = jax.tree.map(np.asarray, seen(state.units, own, shared))
        slack = np.concatenate(slacks, axis=1) if slacks else np.zeros((len(value), 0), value.dtype)
        near = Linear(value, slope, slack, rows)
        fall, near = _fall(state, near)
        flat = _flat(state.units)
        taken = fall > 0
        again = ~taken & (fall > -np.inf) & ~state.again
        radius = np.where(again & (flat != state.at).any(axis=1), state.radius, _resized(state, flat, fall))
        curvature = _learned(state, flat, near, fall > -np.inf)
        bent = near.slack - state.near.slack - np.einsum("smn,sn->sm", state.near.rows, flat - state.at)
        at, near = _where(taken, (flat, near), (state.at, state.near))
        weight = np.where(raises & (near.short() > _KEPT), 4 * state.weight, state.weight)
        model = near._replace(slack=near.slack + np.where(again[:, None], bent, 0))
        low, high = np.maximum(-at, -radius[:, None]), np.minimum(1 - at, radius[:, None])
        move, multipliers, change = _model_minimum(model, curvature, low, high, weight)
        violation = np.maximum(-np.where(np.isnan(slack), -np.inf, slack), 0).max(axis=1, initial=0)
        best = _better(state.best, Seen(state.units, value, violation))
        units = _unflat(np.clip(at + move, 0, 1), state.units)
        promised = weight * near.short() - change
        moved = Program(units, at, near, curvature, radius, promised, again, weight, multipliers, best)
        pull = _unflat(near.slope - np.einsum("sm,smn->sn", multipliers, near.rows), units)
        return moved, Sight(value, violation, multipliers, pull)

    return step


def sqp_begun(units: Any, own: Any, shared: Any, *, evaluate: Evaluate) -> Program:
    """All starts before their first step."""
    first = jax.tree.map(lambda leaf: leaf[0], (units, own))
    many = sum(slack.shape[0] for slack in jax.eval_shape(evaluate, *first, shared)[1])
    flat = _flat(units)
    starts, size = flat.shape
    unseen, zero, none = np.full(starts, np.inf), np.zeros(starts), np.zeros((starts, many))
    near = Linear(unseen, np.zeros((starts, size)), none, np.zeros((starts, many, size)))
    curvature = np.tile(np.eye(size), (starts, 1, 1))
    return Program(
        units=units,
        at=flat,
        near=near,
        curvature=curvature,
        radius=zero + _RADIUS,
        promised=zero,
        again=zero > 0,
        weight=zero + _WEIGHT,
        multipliers=none,
        best=Seen(units, unseen, unseen),
    )


def _model_minimum(near: Linear, curvature: np.ndarray, low: np.ndarray, high: np.ndarray, weight: np.ndarray):
    """As ``quadratic_program``, which is given only as many constraints as may bind within the box."""
    least = near.slack - (np.abs(near.rows) @ np.maximum(-low, high)[..., None])[..., 0]
    first = np.argsort(least, axis=1)[:, : (least < _CLOSE).sum(axis=1).max(initial=0)]
    slack, rows = np.take_along_axis(near.slack, first, 1), np.take_along_axis(near.rows, first[..., None], 1)
    move, some, change = quadratic_program(near._replace(slack=slack, rows=rows), curvature, low, high, weight)
    multipliers = np.zeros_like(near.slack)
    np.put_along_axis(multipliers, first, some, 1)
    return move, multipliers, change


def quadratic_program(
    near: Linear, curvature: np.ndarray, low: np.ndarray, high: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Minimize the model of the merit in a box, for every start, by an interior-point method.

    The slacks ``s = slack + rows @ d + t`` and their shortfalls ``t``, which cost ``weight`` each, stay
    positive; so do the multipliers ``m`` and ``weight - m`` of both.

    Returns:
      The step, the multipliers, and by the model the change of the objective and the cost of what is short after it.
    """
    low, high = low - 1e-9, high + 1e-9  # a number that is held fixed has an inside too
    slack, slope, rows, w = near.slack, near.slope, near.rows, weight[:, None]
    columns, diagonal = rows.transpose(0, 2, 1), np.arange(slope.shape[1])

    def by(matrix, vector):
        return (matrix @ vector[..., None])[..., 0]

    d = (low + high) / 2
    t = np.maximum(-slack - by(rows, d), 0) + 1
    m, below, above = np.zeros_like(t) + w / 2, np.ones_like(d), np.ones_like(d)
    for _ in range(_POINTS):
        s, rest = np.maximum(slack + by(rows, d) + t, _TINY), np.maximum(w - m, _TINY)
        down, up = np.maximum(d - low, _TINY), np.maximum(high - d, _TINY)
        gaps = np.concatenate([m * s, rest * t, below * down, above * up], axis=1)
        target = 0.1 * gaps.mean(axis=1, keepdims=True)
        unsolved = gaps.max(axis=1, keepdims=True) > _GAP
        if not unsolved.any():
            break
        soft = 1 / (s + m * t / rest)
        bend = curvature + columns @ ((soft * m)[..., None] * rows)
        bend[:, diagonal, diagonal] += below / down + above / up
        push = soft * (target - m * s - m * (target / rest - t))
        pull = by(curvature, d) + slope - by(columns, m + push) - target / down + target / up
        dd = np.linalg.solve(bend, -pull[..., None])[..., 0]
        dm = push - soft * m * by(rows, dd)
        dt = (target + t * dm) / rest - t
        dbelow, dabove = target / down - below - below / down * dd, target / up - above + above / up * dd
        values = np.concatenate([s, t, m, rest, down, up, below, above], axis=1)
        changes = np.concatenate([by(rows, dd) + dt, dt, dm, -dm, dd, -dd, dbelow, dabove], axis=1)
        part = np.max(-changes / values, axis=1, keepdims=True)
        size = unsolved * 0.99 / np.maximum(part, 0.99)
        d, t, m, below, above = (
            d + size * dd,
            t + size * dt,
            m + size * dm,
            below + size * dbelow,
            above + size * dabove,
        )
    left = np.maximum(-slack - by(rows, d), 0).sum(axis=1)
    return d, m, (d * (slope + by(curvature, d) / 2)).sum(axis=1) + weight * left


def _fall(state: Program, near: Linear) -> tuple[np.ndarray, Linear]:
    """By how much the merit is less than it was, ``-inf`` where it is not finite; and the same with finite slacks."""
    known = np.isfinite(near.slack)
    slack = np.nan_to_num(near.slack, nan=-1, posinf=1, neginf=-1)
    near = near._replace(slack=slack, rows=np.where(known[..., None], near.rows, 0))
    finite = np.isfinite(near.value) & np.isfinite(near.slope).all(axis=1) & np.isfinite(near.rows).all(axis=(1, 2))
    old = state.near.value + state.weight * state.near.short()
    new = np.where(finite, near.value, 0) + state.weight * near.short()
    return np.where(finite, old - new, -np.inf), near


def _resized(state: Program, flat: np.ndarray, fall: np.ndarray) -> np.ndarray:
    """The trust region after a step whose merit fell by so much; as at first after none, to see what binds."""
    length = np.abs(flat - state.at).max(axis=1)
    ratio = fall / np.maximum(state.promised, 1e-15)
    grown = np.where(length > 0.9 * state.radius, np.minimum(2 * state.radius, 1), state.radius)
    kept = np.where(ratio > 0.75, grown, np.where(ratio < 0.25, length / 4, state.radius))
    known = np.isfinite(state.near.value)
    noise = _NOISE * (1 + np.abs(np.where(known, state.near.value, 0)))
    radius = np.where(known & (state.promised > noise), kept, state.radius)
    return np.where(length > 0, radius, _RADIUS)


def _learned(state: Program, flat: np.ndarray, near: Linear, finite: np.ndarray) -> np.ndarray:
    """The curvature of the Lagrangian after a step, by BFGS with Powell's damping."""
    known = finite & np.isfinite(state.near.value)
    bends = np.einsum("sm,smn->sn", state.multipliers, near.rows - state.near.rows)
    step, change = flat - state.at, np.where(known[:, None], near.slope - state.near.slope - bends, 0)
    pushed = np.einsum("sij,sj->si", state.curvature, step)
    own, seen = (step * pushed).sum(axis=1), (step * change).sum(axis=1)
    known = known & (own > 0)
    own, seen = np.where(known, own, 1), np.where(known, seen, 1)
    share = np.where(seen < 0.2 * own, 0.8 * own / np.where(seen < own, own - seen, 1), 1)[:, None]
    change = np.where(known[:, None], share * change + (1 - share) * pushed, 1)
    length = np.where(known, (step * change).sum(axis=1), 1)
    update = change[:, :, None] * change[:, None] / length[:, None, None]
    update -= pushed[:, :, None] * pushed[:, None] / own[:, None, None]
    return state.curvature + np.where(known[:, None, None], update, 0)


def _better(old: Seen, new: Seen) -> Seen:
    """The better of two designs of every start: kept constraints first, then the objective."""
    old_short, short = (np.maximum(seen.violation - ALLOWED, 0) for seen in (old, new))
    wins = np.isfinite(new.objective) & ((short < old_short) | ((short == old_short) & (new.objective < old.objective)))
    return _where(wins, new, old)


def _where(chosen: np.ndarray, new: Any, old: Any) -> Any:
    """Of every start the one or the other."""
    return jax.tree.map(lambda a, b: np.where(chosen.reshape(-1, *[1] * (np.ndim(a) - 1)), a, b), new, old)


def _flat(units: Any) -> np.ndarray:
    """Units of all starts as vectors."""
    return np.concatenate([np.reshape(leaf, (len(leaf), -1)) for leaf in jax.tree.leaves(units)], axis=1).astype(float)


def _unflat(flat: np.ndarray, like: Any) -> Any:
    """The inverse of ``_flat``."""
    leaves, structure = jax.tree.flatten(like)
    ends = np.cumsum([np.size(leaf[0]) for leaf in leaves])
    parts = np.split(flat, ends[:-1], axis=1)
    return jax.tree.unflatten(
        structure, [part.reshape(leaf.shape).astype(leaf.dtype) for part, leaf in zip(parts, leaves, strict=True)]
    )
