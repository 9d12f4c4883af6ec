"""Numerical building blocks: tolerances, guarded functions, small linear systems."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._vectors import Vec

Scalar = Any  # a zero-dimensional array, a tracer or a Python number


def default_tol(dtype: Any) -> float:
    """Largest closure residual, dimensionless, that counts as zero in a dtype."""
    return 256 * float(jnp.finfo(dtype).eps)


def tiny(value: Scalar) -> float:
    """A positive number whose square is negligible beside one and whose cube does not vanish."""
    return float(jnp.finfo(jnp.result_type(value)).eps) ** 2


def safe_sqrt(x: Scalar) -> Scalar:
    """Square root that is zero, with zero derivative, where ``x <= 0``.

    The argument is replaced before the root is taken: a ``where`` after it would still send
    ``0 * inf = nan`` through the derivative.
    """
    positive = x > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, x, 1)), 0)


def safe_divide(numerator: Scalar, denominator: Scalar) -> Scalar:
    """Quotient that is zero, with zero derivative, where the denominator is zero."""
    nonzero = denominator != 0
    return jnp.where(nonzero, numerator / jnp.where(nonzero, denominator, 1), 0)


def smallest(values: Sequence[Scalar]) -> Scalar:
    """Minimum of scalars by selection, so that an infinite entry never meets a zero derivative."""
    least = values[0]
    for value in values[1:]:
        least = jnp.where(value < least, value, least)
    return least


def limit_margins(value: Scalar, low: Scalar, high: Scalar, scale: Scalar) -> tuple[Scalar, Scalar]:
    """Distances of a value from its two limits, in units of ``scale``; an infinite limit is infinitely far."""

    def distance(sign, limit):
        finite = jnp.isfinite(limit)
        return jnp.where(finite, sign * (value - jnp.where(finite, limit, 0)) / scale, jnp.inf)

    return distance(1, low), distance(-1, high)


def determinant(rows: Sequence[Sequence[Scalar]]) -> Scalar:
    """Determinant of a small matrix given by rows of scalars."""
    if len(rows) == 1:
        return rows[0][0]
    if len(rows) == 2:
        (a, b), (c, d) = rows
        return a * d - b * c
    if len(rows) == 3:
        a, b, c = (Vec(*row) for row in rows)
        return a.dot(b.cross(c))
    if len(rows) <= 6:
        return _laplace(rows)
    return jnp.linalg.det(_matrix(rows))


def regular(rows: Sequence[Sequence[Scalar]]) -> Scalar:
    """Whether a small matrix can be inverted: its determinant is more than the rounding of its terms.

    Compared with zero alone, a determinant may pass here and round to zero in ``solve``.
    """
    det = determinant(rows)
    if len(rows) > 3:
        return det != 0
    bound = math.prod(sum(jnp.abs(e) for e in row) for row in rows)
    return jnp.abs(det) > 4 * float(jnp.finfo(jnp.result_type(det)).eps) * bound


@jax.custom_jvp
def _laplace(rows: Sequence[Sequence[Scalar]]) -> Scalar:
    """Expansion along the upper half of the rows, a polynomial: thirty times faster under ``vmap`` than LU."""
    size, half = len(rows), len(rows) // 2
    total: Scalar = 0 * rows[0][0]
    for columns in itertools.combinations(range(size), half):
        rest = [j for j in range(size) if j not in columns]
        upper = determinant([[row[j] for j in columns] for row in rows[:half]])
        lower = determinant([[row[j] for j in rest] for row in rows[half:]])
        total = total + (-1) ** (sum(columns) - half * (half - 1) // 2) * upper * lower
    return total


@_laplace.defjvp
def _laplace_jvp(primals, tangents):
    """By the same expansion over arrays: the derivatives of a thousand scalars take a minute to compile.

    Not by ``jnp.linalg.det``: in a large program its calls of LAPACK were seen to wait for each other for ever.
    """
    return _laplace(*primals), jax.jvp(_laplace_of_array, (_matrix(*primals),), (_matrix(*tangents),))[1]


def _laplace_of_array(matrix: jax.Array) -> Scalar:
    """The expansion with all minors of a half side by side, their columns picked by products with zeros and ones."""
    size, half = len(matrix), len(matrix) // 2
    chosen = list(itertools.combinations(range(size), half))
    rest = [[j for j in range(size) if j not in columns] for columns in chosen]
    signs = [(-1) ** (sum(columns) - half * (half - 1) // 2) for columns in chosen]

    def minors(rows, columns):
        picks = np.eye(size)[:, np.array(columns).T]
        picked = jnp.einsum("ij,jkc->ikc", rows, jnp.asarray(picks, matrix.dtype))
        return determinant([list(row) for row in picked])

    return jnp.sum(jnp.asarray(signs, matrix.dtype) * minors(matrix[:half], chosen) * minors(matrix[half:], rest))


def solve(rows: Sequence[Sequence[Scalar]], rhs: Sequence[Scalar]) -> tuple[Scalar, ...]:
    """Solve a small linear system: in closed form up to 3 x 3, by LU above.

    A singular matrix gives ``inf`` or ``nan``; callers mask it beforehand where that can happen.
    """
    if len(rows) == 1:
        return (rhs[0] / rows[0][0],)
    if len(rows) == 2:
        (a, b), (c, d) = rows
        scale = 1 / (a * d - b * c)
        return (d * rhs[0] - b * rhs[1]) * scale, (a * rhs[1] - c * rhs[0]) * scale
    if len(rows) == 3:
        a, b, c = (Vec(*row) for row in rows)
        bc, ca, ab = b.cross(c), c.cross(a), a.cross(b)
        scale = 1 / a.dot(bc)
        return ((bc * rhs[0] + ca * rhs[1] + ab * rhs[2]) * scale).components
    solution = jnp.linalg.solve(_matrix(rows), jnp.stack(jnp.broadcast_arrays(*rhs)))
    return tuple(solution[i] for i in range(len(rows)))


def _matrix(rows: Sequence[Sequence[Scalar]]) -> jax.Array:
    return jnp.stack([jnp.stack(jnp.broadcast_arrays(*row)) for row in rows])
