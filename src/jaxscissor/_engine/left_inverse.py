"""The left inverse of matrices too large to be unrolled."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.types import PyTree


@jax.custom_jvp
def left_inverse(matrix: jax.Array) -> jax.Array:
    """G ``(n, m)`` with G A = 1 of a matrix A ``(m, n)``, ``m >= n``; zero where the columns depend on each other.

    If A x = b has a solution, it is G b. Gauss and Jordan's elimination, in a loop: LAPACK's calls may wait for ever
    under ``vmap`` (see matrices.py), and an elimination that is unrolled takes long to compile. Rows and
    columns must be of one size each; pivots below the rounding of so many terms count as zero.
    """
    rows, columns = matrix.shape
    table = jnp.concatenate([matrix, jnp.eye(rows, dtype=matrix.dtype)], axis=1)
    least = 16 * rows * float(jnp.finfo(matrix.dtype).eps)

    def clear(k: jax.Array, carry: PyTree):
        table, regular = carry
        size = jnp.where(jnp.arange(rows) >= k, jnp.abs(jnp.take(table, k, axis=1)), -1)
        best = jnp.argmax(size)
        regular = regular & (size[best] > least)
        pivot, top = table[best], table[k]
        table = table.at[best].set(top).at[k].set(pivot)
        pivot = pivot / jnp.where(size[best] > least, pivot[k], 1)
        factors = jnp.where(jnp.arange(rows) == k, 0, jnp.take(table, k, axis=1))
        return table.at[k].set(pivot) - factors[:, None] * pivot[None], regular

    table, regular = lax.fori_loop(0, columns, clear, (table, jnp.asarray(True)))
    return jnp.where(regular, table[:columns, columns:], 0)


@left_inverse.defjvp
def _left_inverse_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]):
    """The rows that were pivots stay so: dG A + G dA = 0 on them."""
    inverse = left_inverse(*primals)
    return inverse, -inverse @ tangents[0] @ inverse
