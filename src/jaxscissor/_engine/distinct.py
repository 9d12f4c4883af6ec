"""Which of many solutions differ, collected into a list of fixed length."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.types import PyTree


def distinct(points: jax.Array, valid: jax.Array, tol: Scalar, capacity: int) -> tuple[jax.Array, jax.Array]:
    """Indices ``(capacity,)`` of points ``(n, m)`` that are valid and farther than ``tol`` from each other.

    The first of several equal points is taken, in their order.

    Returns:
      The indices, padded with zeros, and how many there are; the count goes on beyond the capacity.

    Example:
      >>> points = jnp.array([[0.0], [1.0], [1.0], [5.0]])
      >>> indices, count = distinct(points, jnp.array([True, True, True, False]), 0.1, 3)
      >>> indices.tolist(), int(count)
      ([0, 1, 0], 2)
    """
    slots = jnp.arange(capacity)

    def insert(carry: PyTree, item: PyTree):
        kept, indices, count = carry
        point, ok, index = item
        known = jnp.any((slots < count) & (jnp.max(jnp.abs(kept - point[None]), axis=1) <= tol))
        here = (slots == count) & ok & ~known
        kept = jnp.where(here[:, None], point[None], kept)
        return (kept, jnp.where(here, index, indices), count + jnp.where(ok & ~known, 1, 0)), None

    start = (jnp.zeros((capacity, points.shape[1]), points.dtype), jnp.zeros(capacity, jnp.int32), jnp.asarray(0))
    numbers = jnp.arange(points.shape[0], dtype=jnp.int32)
    (_, indices, count), _ = lax.scan(insert, start, (points, valid, numbers))
    return indices, count
