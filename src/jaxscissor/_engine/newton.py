"""Newton's method on a small system, its implicit derivative, and the least residual. Knows no robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.matrices import determinant, solve, solve_regular
from jaxscissor._engine.numerics import Scalar, safe_divide, safe_sqrt
from jaxscissor._engine.types import PyTree

Unknowns = tuple[Scalar, ...]
Residual = Callable[[Any, Any], Unknowns]  # (state, args) -> one scalar per unknown
Retract = Callable[[Any, Unknowns], Any]


def add(state: Unknowns, step: Unknowns) -> Unknowns:
    """Step in a flat space."""
    return tuple(x + d for x, d in zip(state, step, strict=True))


def norm(values: Sequence[Scalar]) -> Scalar:
    """Euclidean norm, for which Newton's direction is one of descent; ``nan`` if any value is."""
    return jnp.sqrt(sum(value * value for value in values))


def value_and_jacobian(function: Callable[[Unknowns], Unknowns], at: Unknowns):
    """Values and rows of the Jacobian, by forward derivatives: unrolled where there are few, else mapped."""

    def push(basis: PyTree):
        return jax.jvp(function, (at,), (basis,))

    size = len(at)
    if size > 3:
        identity = jnp.eye(size, dtype=jnp.result_type(at[0]))
        values, rows = jax.vmap(push, out_axes=(None, 0))(tuple(identity))
        values, rows = fence((values, rows))  # as arrays: every number on its own would evaluate the whole derivative
        return values, [tuple(row[j] for j in range(size)) for row in rows]
    bases = [tuple(jnp.full_like(x, float(i == j)) for i, x in enumerate(at)) for j in range(size)]
    pushed = [push(basis) for basis in bases]
    return pushed[0][0], list(zip(*(column for _, column in pushed), strict=True))


def newton(
    residual: Residual,
    start: PyTree,
    args: PyTree,
    *,
    tol: Scalar,
    max_steps: Scalar,
    active: Scalar = True,
    retract: Retract = add,
    nudge: Retract | None = None,
    unknowns: int | None = None,
) -> tuple[Any, Scalar, Scalar]:
    """Solve ``residual(state, args) = 0`` by Newton steps, halved while they do not reduce the residual.

    1. The residual r and its Jacobian J by a step from the state; the Newton step is d = -J^-1 r, with fewer
       ``unknowns`` than equations that of Gauss and Newton, d = -(J^T J)^-1 J^T r.
    2. Try the state moved by a share of d, at first by all of it.
    3. If the residual is smaller there, go, and double the share up to one; if not, stay, and halve it.

    ``nudge`` steps like ``retract`` to first order, where that takes fewer operations.

    Lanes stop when they converge, and lanes that are not ``active`` never start. Derivatives do not pass:
    see ``implicit``.

    Returns:
      The state, the norm of the residual at it, and the number of steps.
    """
    start, args = lax.stop_gradient((start, args))
    first = residual(start, args)
    count = len(first) if unknowns is None else unknowns
    if count > len(first):
        raise ValueError(f"Got {len(first)} equations for {count} unknowns; Newton needs at least as many.")
    zero = (jnp.zeros_like(first[0]),) * count

    def unfinished(carry: PyTree):
        _, error, _, count = carry
        return active & (error > tol) & (count < max_steps)

    def step(carry: PyTree):
        state, error, damping, count = carry
        values, rows = value_and_jacobian(lambda d: residual((nudge or retract)(state, d), args), zero)
        trial = retract(state, tuple(-damping * d for d in solve(*normal_equations(rows, values))))
        trial_error = norm(residual(trial, args))
        better = trial_error < error
        pairs = (trial, trial_error), (state, error)
        state, error = jax.tree.map(lambda new, old: jnp.where(better, new, old), *pairs)
        return state, error, jnp.where(better, jnp.minimum(2 * damping, 1), damping / 2), count + 1

    error = norm(first)
    carry = (start, error, jnp.ones_like(error), jnp.zeros_like(error, dtype=jnp.int32))
    state, error, _, count = lax.while_loop(unfinished, step, carry)
    return state, error, count


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def implicit(residual: Residual, root: Unknowns, ok: Scalar, args: PyTree) -> Unknowns:
    """Give a root of ``residual(root, args) = 0`` its derivative by the implicit function theorem.

    Of more equations than unknowns it is the one of least squares. The rule calls itself, so forward, reverse and
    higher derivatives all work. Where ``ok`` is false, and where the Jacobian is singular to rounding, the derivative
    is zero.
    """
    return root


@implicit.defjvp
def _implicit_jvp(residual: PyTree, primals: tuple[Any, ...], tangents: tuple[Any, ...]):
    root, ok, args = primals
    root = implicit(residual, root, ok, args)
    _, rows = value_and_jacobian(lambda x: residual(x, args), root)
    _, moved = jax.jvp(lambda a: residual(root, a), (args,), (tangents[2],))
    # every entry of the adjugate would evaluate the Jacobian and the moved residual anew
    rows, moved = normal_equations(rows if len(rows) > 3 else fence(rows), fence(moved))
    tangent, _ = solve_regular(rows, [-m for m in moved], ok)
    return root, tangent


def normal_equations(
    rows: Sequence[Sequence[Scalar]], values: Sequence[Scalar]
) -> tuple[Sequence[Sequence[Scalar]], Sequence[Scalar]]:
    """J^T J and J^T r of a system with more equations than unknowns; one with as many as it is."""
    return (rows, values) if len(rows) == len(rows[0]) else _normal(rows, values)


def _normal(rows: Sequence[Sequence[Scalar]], values: Sequence[Scalar]) -> tuple[list[list[Scalar]], list[Scalar]]:
    columns = list(zip(*rows, strict=True))

    def product(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
        return sum(x * y for x, y in zip(a, b, strict=True))

    return [[product(a, b) for b in columns] for a in columns], [product(a, values) for a in columns]


def fold_distance(residual: Residual, root: Unknowns, args: PyTree) -> Scalar:
    """Size of the change of the residual that would make a regular root fold, to second order; >= 0.

    Moving the residual by a unit vector e moves the root by -J^-1 e, and det J with it: its square falls
    linearly, and is used up after det^2 / (2 |adj(J)^T grad det|).
    """

    def det(x: Scalar):
        _, rows = value_and_jacobian(lambda y: residual(y, args), x)
        return determinant(rows)

    _, rows = value_and_jacobian(lambda y: residual(y, args), root)
    _, (gradient,) = value_and_jacobian(lambda x: (det(x),), root)
    size = len(root)
    pull = []
    for i in range(size):
        # row i of adj(J)^T grad det: det J with column-wise Cramer's rule, free of a division by det
        replaced = [[gradient[k] if j == i else rows[j][k] for k in range(size)] for j in range(size)]
        pull.append(determinant(replaced))
    det2 = determinant(rows) ** 2
    return safe_divide(det2, 2 * safe_sqrt(sum(p * p for p in pull)))


def least_squares(residual: Residual, start: Unknowns, args: PyTree, *, max_steps: int = 40) -> Unknowns:
    """The unknowns of (locally) least squared residual, by Levenberg-Marquardt; derivatives do not pass.

    1. Solve (J^T J + damping trace(J^T J) I) d = J^T r [Nocedal and Wright, section 10.3].
    2. If the sum of squares is smaller at x - d, go there, and divide the damping by 8; if not, multiply it by 4.
    """
    start, args = lax.stop_gradient((start, args))

    def squares(values: PyTree):
        return sum(v * v for v in values)

    def step(_: object, carry: PyTree):
        state, cost, damping = carry
        values, rows = value_and_jacobian(lambda x: residual(x, args), state)
        normal, gradient = _normal(rows, values)
        size = sum(normal[i][i] for i in range(len(state)))
        normal = [[e + (damping * size if i == j else 0) for j, e in enumerate(row)] for i, row in enumerate(normal)]
        trial = tuple(x - d for x, d in zip(state, solve(normal, gradient), strict=True))
        trial_cost = squares(residual(trial, args))
        better = trial_cost < cost
        state, cost = jax.tree.map(lambda new, old: jnp.where(better, new, old), (trial, trial_cost), (state, cost))
        return state, cost, jnp.where(better, damping / 8, damping * 4)

    cost = squares(residual(start, args))
    damping = jnp.full_like(cost, 1e-2)
    return lax.fori_loop(0, max_steps, step, (start, cost, damping))[0]
