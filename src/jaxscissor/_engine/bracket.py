"""A change of sign between two points, narrowed down to rounding."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.numerics import safe_divide
from jaxscissor._engine.types import PyTree


def last_inside(
    function: Callable[[jax.Array], jax.Array],
    low: jax.Array,
    high: jax.Array,
    at_low: jax.Array,
    at_high: jax.Array,
    used: jax.Array,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Points on both sides of a change of sign, the one that is not negative first, and the value at that.

    So near that one Newton step from the first, which has no kink before it, gives the root to rounding.
    Interpolate, truncate, project [Oliveira and Takahashi, ACM TOMS 47, 2020]: nearly as fast as secants on
    smooth functions and, one step aside, never slower than bisection on others. A step goes so:

    1. Interpolate: the root of the secant through both ends.
    2. Truncate: move it towards the middle by 0.2 (high - low)^2 / (first width), so that it falls beyond the root.
    3. Project: no farther from the middle than the steps that bisection would have left allow.
    4. Evaluate there, and replace the end on the same side of zero.
    """
    width = float(jnp.finfo(low.dtype).eps) ** 0.75
    first = jnp.where(used, high - low, 1)
    steps = jnp.ceil(jnp.log2(jnp.max(first) / width)).astype(jnp.int32) + 1

    def unfinished(state: PyTree):
        count, low, high, *_ = state
        return jnp.any(used & (high - low > width)) & (count <= steps)

    def step(state: PyTree):
        count, low, high, at_low, at_high = state
        middle, half = (low + high) / 2, (high - low) / 2
        secant = low + (high - low) * safe_divide(at_low, at_low - at_high)
        secant = jnp.where(jnp.isfinite(secant), secant, middle)
        off = jnp.abs(middle - secant)
        aside = jnp.maximum(0.2 / first * (high - low) ** 2, width / 2)
        room = jnp.maximum(width / 2 * 2.0 ** (steps - count).astype(low.dtype) - half, 0)
        point = middle - jnp.sign(middle - secant) * jnp.minimum(jnp.maximum(off - aside, 0), room)
        value = function(point)
        as_low = (value >= 0) == (at_low >= 0)
        low, at_low = jnp.where(as_low, point, low), jnp.where(as_low, value, at_low)
        high, at_high = jnp.where(as_low, high, point), jnp.where(as_low, at_high, value)
        return count + 1, low, high, at_low, at_high

    _, low, high, at_low, at_high = lax.while_loop(unfinished, step, (jnp.int32(0), low, high, at_low, at_high))
    inside = at_low >= 0
    first, last = jnp.where(inside, low, high), jnp.where(inside, high, low)
    return jnp.where(used, first, 0.5), jnp.where(used, last, 0.5), jnp.where(inside, at_low, at_high)
