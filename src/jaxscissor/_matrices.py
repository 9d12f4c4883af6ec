"""Determinants, linear systems and singular values of small matrices, entry by entry.

Not by LAPACK: under ``vmap`` its calls in jaxlib 0.10 hold the threads on which they wait for their own work, and a
program in which as many run side by side as there are cores waits for ever.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxscissor._fence import fence
from jaxscissor._numerics import Scalar, safe_divide
from jaxscissor._vectors import Vec

_SWEEPS = 8  # convergence is quadratic: six were enough for every matrix up to 9 x 9 tried


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
    return _laplace_of_array(_matrix(rows))


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
    """By the same expansion over arrays: the derivatives of a thousand scalars take a minute to compile."""
    return _laplace(*primals), jax.jvp(_laplace_of_array, (_matrix(*primals),), (_matrix(*tangents),))[1]


def _laplace_of_array(matrix: jax.Array) -> Scalar:
    """The expansion with all minors of a half side by side, their columns picked by products with zeros and ones."""
    size, half = len(matrix), len(matrix) // 2
    chosen = list(itertools.combinations(range(size), half))
    rest = [[j for j in range(size) if j not in columns] for columns in chosen]
    signs = [(-1) ** (sum(columns) - half * (half - 1) // 2) for columns in chosen]

    def minors(rows, columns):
        picks = np.eye(size)[:, np.array(columns).T]
        picked = jnp.einsum("ij...,jkc->ikc...", rows, jnp.asarray(picks, matrix.dtype))
        return determinant([list(row) for row in picked])

    return jnp.tensordot(
        jnp.asarray(signs, matrix.dtype), minors(matrix[:half], chosen) * minors(matrix[half:], rest), 1
    )


def solve(rows: Sequence[Sequence[Scalar]], rhs: Sequence[Scalar]) -> tuple[Scalar, ...]:
    """Solve a small linear system: in closed form up to 3 x 3, by elimination above; arrays are several right sides.

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
    return _eliminated(rows, rhs)


def _eliminated(rows: Sequence[Sequence[Scalar]], rhs: Sequence[Scalar]) -> tuple[Scalar, ...]:
    """Gaussian elimination with row pivots; unfenced, every number of the solution would evaluate all rows anew."""
    size, table = len(rows), [[*row, right] for row, right in zip(fence(rows), fence(rhs), strict=True)]
    for k in range(size):
        for i in range(k + 1, size):
            larger = jnp.abs(table[i][k]) > jnp.abs(table[k][k])
            pairs = list(zip(table[k], table[i], strict=True))
            table[k] = [jnp.where(larger, y, x) for x, y in pairs]
            table[i] = [jnp.where(larger, x, y) for x, y in pairs]
        for i in range(k + 1, size):
            factor = table[i][k] / table[k][k]
            table[i] = [x - factor * y for x, y in zip(table[i], table[k], strict=True)]
    solution: list[Scalar] = []
    for k in reversed(range(size)):
        row = table[k]
        known = sum(a * x for a, x in zip(row[k + 1 : size], solution, strict=True))
        solution.insert(0, (row[size] - known) / row[k])
    return tuple(solution)


def inverse(matrix: jax.Array) -> jax.Array:
    """Inverse of a small matrix ``(n, n)``; ``inf`` or ``nan`` where there is none."""
    return jnp.stack(solve([list(row) for row in matrix], list(jnp.eye(len(matrix), dtype=matrix.dtype))))


@jax.custom_jvp
def singular_values(matrix: jax.Array) -> jax.Array:
    """Singular values of a small matrix ``(m, n)`` with ``m >= n``, largest first."""
    return _turned(matrix)[0]


@singular_values.defjvp
def _singular_values_jvp(primals, tangents):
    values, scaled, right = _turned(*primals)
    left = scaled * safe_divide(1, values)[None]
    return values, jnp.sum(left * (tangents[0] @ right), axis=0)


def null_vector(matrix: jax.Array) -> jax.Array:
    """Right singular vector ``(n,)`` of the least singular value of a small matrix ``(m, n)`` with ``m >= n``."""
    return _turned(matrix)[2][:, -1]


def _turned(matrix: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Singular values, the columns turned until they are orthogonal, and the turn, by one-sided Jacobi rotations.

    The pairs of columns come in the order of a round-robin tournament.
    """
    (m, n), dtype = matrix.shape, matrix.dtype
    stacked = jnp.concatenate([matrix, jnp.eye(n, dtype=dtype)])
    columns = [list(column) for column in stacked.T] + [[jnp.zeros((), dtype)] * (m + n)] * (n % 2)

    def play(_, columns):
        first, second = columns[: len(columns) // 2], columns[len(columns) // 2 :]
        turned = [_orthogonal(x, y, m) for x, y in zip(first, second, strict=True)]
        first, second = ([pair[side] for pair in turned] for side in (0, 1))
        return [first[0], *second[:1], *first[1:-1], *second[1:], *first[-1:]] if len(first) > 1 else first + second

    columns = lax.fori_loop(0, _SWEEPS * (len(columns) - 1), play, columns)[:n]
    turned = jnp.stack([jnp.stack(column) for column in columns], axis=1)
    values = jnp.sqrt(jnp.sum(turned[:m] ** 2, axis=0))
    order = jnp.argsort(values, descending=True)
    turned = turned[:, order]
    return values[order], turned[:m], turned[m:]


def _orthogonal(x: Sequence[Scalar], y: Sequence[Scalar], size: int) -> tuple[list[Scalar], list[Scalar]]:
    """Two columns turned into each other by the smaller angle that makes their first entries orthogonal."""
    difference = sum(b * b for b in y[:size]) - sum(a * a for a in x[:size])
    twice = 2 * sum(a * b for a, b in zip(x[:size], y[:size], strict=True))
    tangent = safe_divide(
        jnp.where(difference < 0, -twice, twice), jnp.abs(difference) + jnp.sqrt(difference**2 + twice**2)
    )
    cos = 1 / jnp.sqrt(1 + tangent**2)
    sin = cos * tangent
    first = [cos * a - sin * b for a, b in zip(x, y, strict=True)]
    return first, [sin * a + cos * b for a, b in zip(x, y, strict=True)]


def _matrix(rows: Sequence[Sequence[Scalar]]) -> jax.Array:
    return jnp.stack([jnp.stack(jnp.broadcast_arrays(*row)) for row in rows])
