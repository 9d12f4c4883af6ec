"""Determinants, linear systems and singular values of small matrices, entry by entry.

Not by LAPACK: under ``vmap`` its calls in jaxlib 0.10 hold the threads on which they wait for their own work, and a
program in which as many run side by side as there are cores waits for ever.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.numerics import Scalar, safe_divide
from jaxscissor._engine.types import PyTree
from jaxscissor._engine.vectors import Vec

_UNROLLED = 9  # rows of the largest matrix whose elimination is written out: of 18 it takes minutes to compile
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
def _laplace_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]):
    """By the same expansion over arrays: the derivatives of a thousand scalars take a minute to compile."""
    return _laplace(*primals), jax.jvp(_laplace_of_array, (_matrix(*primals),), (_matrix(*tangents),))[1]


def _laplace_of_array(matrix: jax.Array) -> Scalar:
    """The expansion with all minors of a half side by side, their columns picked by products with zeros and ones."""
    size, half = len(matrix), len(matrix) // 2
    chosen = list(itertools.combinations(range(size), half))
    rest = [[j for j in range(size) if j not in columns] for columns in chosen]
    signs = [(-1) ** (sum(columns) - half * (half - 1) // 2) for columns in chosen]

    def minors(rows: PyTree, columns: PyTree):
        picks = np.eye(size)[:, np.array(columns).T]
        picked = jnp.einsum("ij...,jkc->ikc...", rows, jnp.asarray(picks, matrix.dtype))
        return determinant([list(row) for row in picked])

    return jnp.tensordot(
        jnp.asarray(signs, matrix.dtype), minors(matrix[:half], chosen) * minors(matrix[half:], rest), 1
    )


def solve(rows: Sequence[Sequence[Scalar]], rhs: Sequence[Scalar]) -> tuple[Scalar, ...]:
    """Solve a small linear system: in closed form up to 3 x 3, by elimination above; arrays are several right sides.

    A singular matrix gives anything, ``nan`` included; for one that may be singular see ``solve_regular``.
    """
    if len(rows) > 3:
        return _eliminated(rows, rhs)[0]
    adjugate, det = _adjugate(rows)
    scale = 1 / det
    return tuple(sum(c * r for c, r in zip(row, rhs, strict=True)) * scale for row in adjugate)


def solve_regular(
    rows: Sequence[Sequence[Scalar]], rhs: Sequence[Scalar], ok: Scalar = True
) -> tuple[tuple[Scalar, ...], Scalar]:
    """Solution of a small linear system, zero where the matrix is singular to rounding or not ``ok``; and where not.

    Neither depends on the units of the unknowns. The matrix is replaced *before* the solve, so that no ``nan`` can
    leak into the neighbours of a failed lane, in a derivative either.
    """
    if len(rows) <= 3:
        ok = fence(jnp.asarray(ok) & is_regular(rows))  # else every entry would evaluate it anew
    if len(rows) > _UNROLLED:
        table, right = _matrix(rows), jnp.stack(rhs)
        identity = jnp.eye(len(rows), dtype=table.dtype)
        found = _eliminated_in_loops(jnp.where(ok, table, identity), jnp.where(ok, right, 0))
        regular = fence(found[1])
        return tuple(jnp.where(regular, jnp.stack(found[0]), 0)), regular & ok
    safe = [[jnp.where(ok, e, float(i == j)) for j, e in enumerate(row)] for i, row in enumerate(rows)]
    masked = [jnp.where(ok, r, 0) for r in rhs]
    if len(rows) <= 3:
        return solve(safe, masked), ok
    solution, regular, _ = _eliminated(safe, masked)
    regular = fence(regular)  # else every unknown would evaluate the verdict anew
    return tuple(jnp.where(regular, x, 0) for x in solution), regular & ok


def is_regular(rows: Sequence[Sequence[Scalar]]) -> Scalar:
    """Whether the determinant of a small matrix is more than the rounding of its terms, whatever the units.

    Above 3 x 3: whether the last pivot of an elimination is more than the rounding of all before it can make.
    """
    if len(rows) > 3:
        return _eliminated(rows, [0 * row[0] for row in rows])[1]
    _, det = _adjugate(rows)
    bound = _permanent([[jnp.abs(e) for e in row] for row in rows])
    return jnp.abs(det) > 4 * float(jnp.finfo(jnp.result_type(det)).eps) * bound


def determinant_sign(rows: Sequence[Sequence[Scalar]]) -> Scalar:
    """Sign of the determinant of a small matrix, zero where it is singular to rounding; by its pivots above 3 x 3."""
    if len(rows) > 3:
        _, regular, sign = _eliminated(rows, [0 * row[0] for row in rows])
    else:
        regular, sign = is_regular(rows), jnp.sign(determinant(rows))
    return jnp.where(regular, sign, 0)


def _permanent(rows: Sequence[Sequence[Scalar]]) -> Scalar:
    """The sum of the terms of a determinant without their signs."""
    if len(rows) == 1:
        return rows[0][0]
    rest = [[[e for k, e in enumerate(row) if k != j] for row in rows[1:]] for j in range(len(rows))]
    return sum(e * _permanent(minor) for e, minor in zip(rows[0], rest, strict=True))


def _adjugate(rows: Sequence[Sequence[Scalar]]) -> tuple[list[tuple[Scalar, ...]], Scalar]:
    """Adjugate and determinant of a matrix up to 3 x 3."""
    if len(rows) == 1:
        return [(jnp.ones_like(rows[0][0]),)], rows[0][0]
    if len(rows) == 2:
        (a, b), (c, d) = rows
        return [(d, -b), (-c, a)], a * d - b * c
    a, b, c = (Vec(*row) for row in rows)
    columns = b.cross(c), c.cross(a), a.cross(b)
    return list(zip(*(column.components for column in columns), strict=True)), a.dot(columns[0])


def _eliminated(rows: Sequence[Sequence[Scalar]], rhs: Sequence[Scalar]) -> tuple[tuple[Scalar, ...], Scalar, Scalar]:
    """Gaussian elimination with row pivots: solution, whether the matrix is regular, sign of its determinant.

    For every column k:

    1. Row k is exchanged for each row below whose entry in the column is larger; every exchange turns the sign.
    2. A pivot of zero makes the matrix singular and is replaced by 1.
    3. The multiple of row k that clears the column is subtracted from each row below, and kept in the cleared place.

    Then the unknowns follow from the last to the first. Choices, exchanged rows and multiples are fenced: each is
    used by a row of numbers, every one of which would evaluate all choices and quotients before it anew.
    """
    size = len(rows)
    if size > _UNROLLED:
        return _eliminated_in_loops(_matrix(rows), jnp.stack(rhs))
    table, right = [list(row) for row in rows], list(rhs)
    regular, sign = jnp.asarray(True), jnp.ones_like(table[0][0])
    for k in range(size):
        below = range(k + 1, size)
        larger, pivot = [], jnp.abs(table[k][k])
        for i in below:
            larger.append(jnp.abs(table[i][k]) > pivot)
            pivot = jnp.maximum(pivot, jnp.abs(table[i][k]))
        for i, swap in zip(below, fence(larger), strict=True):
            top, row = table[k], table[i]
            table[k] = [jnp.where(swap, y, x) for x, y in zip(top, row, strict=True)]
            table[i] = [jnp.where(swap, x, y) for x, y in zip(top, row, strict=True)]
            right[k], right[i] = jnp.where(swap, right[i], right[k]), jnp.where(swap, right[k], right[i])
            sign = jnp.where(swap, -sign, sign)
        table[k:], right[k:] = fence(table[k:]), fence(right[k:])
        regular, sign = regular & (table[k][k] != 0), sign * jnp.sign(table[k][k])
        table[k][k] = jnp.where(table[k][k] == 0, 1, table[k][k])
        factors = fence([table[i][k] / table[k][k] for i in below])
        for i, factor in zip(below, factors, strict=True):
            pairs = zip(table[i][k + 1 :], table[k][k + 1 :], strict=True)
            table[i] = [*table[i][:k], factor, *(x - factor * y for x, y in pairs)]
            right[i] = right[i] - factor * right[k]
    solution: list[Scalar] = []
    for k in reversed(range(size)):
        known = sum(a * x for a, x in zip(table[k][k + 1 :], solution, strict=True))
        solution.insert(0, (right[k] - known) / table[k][k])
    return tuple(solution), regular & _last_pivot_exceeds_rounding(table), sign


def _last_pivot_exceeds_rounding(table: Sequence[Sequence[Scalar]]) -> Scalar:
    """Whether the last pivot of an elimination is more than what the rounding of all entries can make of it.

    The factors L (its diagonal of ones left out) and U stand in one table. With w L = (0, ..., 0, 1) and
    U v = (0, ..., 0, u), where v ends in 1 and u is the last pivot, errors E of the matrix move u by w E v, and those
    of an elimination are at most ``size`` roundings of |L| |U| [Higham, Accuracy and Stability, theorem 9.3]. Neither
    side knows the units of rows or columns. An earlier pivot that is rounding makes w or v large.
    """
    size, eps = len(table), float(jnp.finfo(jnp.result_type(table[0][0])).eps)
    v: list[Scalar] = [1.0]
    w: list[Scalar] = [1.0]
    for k in reversed(range(size - 1)):
        v.insert(0, -sum(a * x for a, x in zip(table[k][k + 1 :], v, strict=True)) / table[k][k])
        w.insert(0, -sum(table[i][k] * x for i, x in zip(range(k + 1, size), w, strict=True)))
    v, w = [jnp.abs(x) for x in v], [jnp.abs(x) for x in w]
    bound: Scalar = 0.0
    for k in range(size - 1):
        by_row = sum(jnp.abs(a) * x for a, x in zip(table[k][k:], v[k:], strict=True))
        by_column = w[k] + sum(jnp.abs(table[i][k]) * w[i] for i in range(k + 1, size))
        bound = bound + by_column * by_row
    return jnp.abs(table[-1][-1]) > 16 * size * eps * bound


def _eliminated_in_loops(table: jax.Array, right: jax.Array) -> tuple[tuple[Scalar, ...], Scalar, Scalar]:
    """The same elimination over arrays, and the same verdict on its last pivot."""
    size, eps, places = len(table), float(jnp.finfo(table.dtype).eps), jnp.arange(len(table))
    shape, right = right.shape, right.reshape(size, -1)

    def column(k: Scalar, carry: PyTree):
        table, right, regular, sign = carry
        below = places > k
        best = jnp.argmax(jnp.where(places >= k, jnp.abs(table[:, k]), -1))
        order = jnp.where(places == k, best, jnp.where(places == best, k, places))
        table, right, pivot = table[order], right[order], table[best, k]
        regular, sign = regular & (pivot != 0), jnp.where(best == k, sign, -sign) * jnp.sign(pivot)
        pivot = jnp.where(pivot == 0, 1, pivot)
        factors = jnp.where(below, table[:, k] / pivot, 0)
        table = table - jnp.outer(factors, jnp.where(below, table[k], 0))
        own = jnp.where(below, factors, jnp.where(places == k, pivot, table[:, k]))
        return table.at[:, k].set(own), right - jnp.outer(factors, right[k]), regular, sign

    carry = table, right, jnp.asarray(True), jnp.ones((), table.dtype)
    table, right, regular, sign = lax.fori_loop(0, size, column, carry)
    last = jnp.where(places == size - 1, 1, 0).astype(table.dtype)

    def unknown(i: Scalar, carry: PyTree):
        x, v, w = carry
        k = size - 1 - i
        after = jnp.where(places > k, table[k], 0)
        x = x.at[k].set((right[k] - after @ x) / table[k, k])
        v = v.at[k].set(jnp.where(i == 0, 1, -(after @ v) / table[k, k]))
        w = w.at[k].set(jnp.where(i == 0, 1, -(jnp.where(places > k, table[:, k], 0) @ w)))
        return x, v, w

    x, v, w = lax.fori_loop(0, size, unknown, (jnp.zeros_like(right), last, last))
    v, w = jnp.abs(v), jnp.abs(w)
    upper, lower = jnp.abs(jnp.triu(table)), jnp.abs(jnp.tril(table, -1))
    bound = jnp.sum(jnp.where(places < size - 1, (w + lower.T @ w) * (upper @ v), 0))
    exceeds = jnp.abs(table[-1, -1]) > 16 * size * eps * bound
    return tuple(x.reshape(shape)), regular & exceeds, sign


def inverse(matrix: jax.Array) -> jax.Array:
    """Inverse of a small matrix ``(n, n)``; ``inf`` or ``nan`` where there is none."""
    return jnp.stack(solve([list(row) for row in matrix], list(jnp.eye(len(matrix), dtype=matrix.dtype))))


def complement(rows: jax.Array) -> jax.Array:
    """Unit vectors ``(n - k, n)`` at right angles to each other and to independent rows ``(k, n)``.

    Gram and Schmidt, twice for each vector. Among what is left of the unit vectors the longest is taken each time.
    """
    basis: list[jax.Array] = []

    def rest(vector: jax.Array) -> jax.Array:
        for _ in range(2):
            for unit in basis:
                vector = vector - jnp.outer(vector @ unit, unit).reshape(vector.shape)
        return vector

    for row in rows:
        left = rest(row)
        basis.append(left / jnp.sqrt(jnp.sum(left**2)))
    count, size = rows.shape
    for _ in range(size - count):
        left = rest(jnp.eye(size, dtype=rows.dtype))
        longest = left[jnp.argmax(jnp.sum(left**2, axis=1))]
        basis.append(longest / jnp.sqrt(jnp.sum(longest**2)))
    return jnp.stack(basis[count:])


@jax.custom_jvp
def singular_values(matrix: jax.Array) -> jax.Array:
    """Singular values of a small matrix ``(m, n)`` with ``m >= n``, largest first."""
    return _turned(matrix)[0]


@singular_values.defjvp
def _singular_values_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]):
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

    def play(_: object, columns: PyTree):
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
