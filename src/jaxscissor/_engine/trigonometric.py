"""Real roots of a trigonometric polynomial that is only known by its values."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.types import PyTree


def near_roots(function: Callable[[jax.Array], jax.Array], degree: int, dtype: jax.typing.DTypeLike) -> jax.Array:
    """Angles ``(6 * degree,)`` near which every real root of a trigonometric polynomial of a degree lies, best first.

    With z = exp(i x) it is an ordinary polynomial of twice the degree, whose roots come in pairs z, 1/conj(z)
    unless they lie on the unit circle, where x is real. Rounding may push two nearby real roots off the
    circle; each root is therefore given with its distance from the circle added to and taken from its angle,
    so that iterations start on both sides of the pair.

    Example:
      >>> angles = near_roots(lambda x: jnp.sin(x) - 0.5, 1, jnp.float32)
      >>> bool(abs(angles - jnp.pi / 6).min() < 1e-5)
      True
    """
    count = 4 * degree
    samples = jnp.arange(count, dtype=dtype) * (2 * jnp.pi / count)
    spectrum = jnp.fft.fft(jax.vmap(function)(samples)) / count
    coefficients = jnp.concatenate([spectrum[-degree:], spectrum[: degree + 1]])  # of z^0 .. z^(2 degree)
    roots = _polynomial_roots(coefficients / jnp.max(jnp.abs(coefficients)).astype(coefficients.dtype))
    angles, off = jnp.angle(roots), jnp.abs(jnp.abs(roots) - 1)
    angles = jnp.concatenate([angles, angles + off, angles - off])
    return jnp.where(jnp.isfinite(angles), angles, 0).astype(dtype)


def _polynomial_roots(coefficients: jax.Array, max_steps: int = 100) -> jax.Array:
    """All complex roots of a polynomial, lowest coefficient first, by Aberth's simultaneous iteration.

    1. Start near the unit circle, at places that share no symmetry with the roots.
    2. For every root the Newton step w = p / p', and the push of the others s = sum 1 / (z - z').
    3. Move by w / (1 - w s), until no root moves by more than rounding [Aberth, Math. Comp. 27, 1973].
    """
    degree = coefficients.shape[0] - 1
    real = jnp.real(coefficients).dtype
    numbers = jnp.arange(degree, dtype=real)
    spread = 2 * jnp.pi * numbers / degree + 0.4
    radius = 0.9 + 0.05 * jnp.cos(3 * numbers)
    start = lax.complex(radius * jnp.cos(spread), radius * jnp.sin(spread))
    apart = ~jnp.eye(degree, dtype=bool)

    def step(carry: PyTree):
        roots, _, count = carry
        newton = _newton_step(coefficients, roots)
        gaps = jnp.where(apart, roots[:, None] - roots[None, :], 1)
        push = jnp.sum(jnp.where(apart, 1 / jnp.where(gaps == 0, 1, gaps), 0), axis=1)
        move = newton / (1 - newton * push)
        move = jnp.where(jnp.isfinite(move), move, 0)
        return roots - move, jnp.max(jnp.abs(move) / jnp.maximum(jnp.abs(roots), 1)), count + 1

    def unfinished(carry: PyTree):
        _, change, count = carry
        return (change > 4 * jnp.finfo(real).eps) & (count < max_steps)

    carry = (start, jnp.ones((), real), jnp.zeros((), jnp.int32))
    return lax.while_loop(unfinished, step, carry)[0]


def _newton_step(coefficients: jax.Array, z: jax.Array) -> jax.Array:
    """p / p' at every z, from the reversed polynomial outside the unit circle, where powers would overflow."""
    degree = coefficients.shape[0] - 1
    outside = jnp.abs(z) > 1
    w = jnp.where(outside, 1 / jnp.where(z == 0, 1, z), z)
    value, slope = jnp.zeros_like(w), jnp.zeros_like(w)
    for low, high in zip(coefficients, reversed(coefficients), strict=True):
        slope = slope * w + value
        value = value * w + jnp.where(outside, low, high)
    value = jnp.where(value == 0, float(jnp.finfo(jnp.real(value).dtype).tiny), value)
    direct = value / slope
    return jnp.where(outside, z / (degree - w * slope / value), direct)
