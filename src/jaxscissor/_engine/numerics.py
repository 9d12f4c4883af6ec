"""Numerical building blocks: tolerances and guarded functions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp

from jaxscissor._engine.types import PyTree

Scalar = Any  # a zero-dimensional array, a tracer or a Python number


def default_tol(dtype: jax.typing.DTypeLike) -> float:
    """Largest closure residual, dimensionless, that counts as zero in a dtype."""
    return 256 * float(jnp.finfo(dtype).eps)


def tiny(value: Scalar) -> float:
    """A positive number whose square is negligible beside one and whose cube does not vanish."""
    return float(jnp.finfo(jnp.result_type(value, float)).eps) ** 2


def safe_sqrt(x: Scalar) -> Scalar:
    """Square root that is zero, with zero derivative, where ``x <= 0``.

    The argument is replaced before the root is taken: a ``where`` after it would still send
    ``0 * inf = nan`` through the derivative. What replaces it is next to nothing: the compiler may evaluate
    x twice, rounded differently, and so be of two minds about its sign.

    Example:
      >>> import jax
      >>> float(safe_sqrt(4.0)), float(jax.grad(safe_sqrt)(0.0))
      (2.0, 0.0)
    """
    positive = x > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, x, tiny(x))), 0)


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
    """Distances of a value from its two limits, in units of ``scale``; an infinite limit is infinitely far.

    Example:
      >>> [float(margin) for margin in limit_margins(3.0, 1.0, jnp.inf, 2.0)]
      [1.0, inf]
    """

    def distance(sign: PyTree, limit: PyTree):
        finite = jnp.isfinite(limit)
        return jnp.where(finite, sign * (value - jnp.where(finite, limit, 0)) / scale, jnp.inf)

    return distance(1, low), distance(-1, high)
