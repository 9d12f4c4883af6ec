"""Real roots of a quartic, in closed form, for batches."""

from __future__ import annotations

import jax.numpy as jnp

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.numerics import Scalar, safe_divide, safe_sqrt


def quartic_roots(a3: Scalar, a2: Scalar, a1: Scalar, a0: Scalar) -> tuple[list[Scalar], list[Scalar]]:
    """Roots of t^4 + a3 t^3 + a2 t^2 + a1 t + a0, and which of them are real (Ferrari).

    A complex pair is given by its real part, with ``False``. Not polished: about half the digits at
    double roots, nearly all elsewhere.

    Example:
      >>> roots, real = quartic_roots(*(jnp.float32(c) for c in (-10.0, 35.0, -50.0, 24.0)))
      >>> sorted(round(float(t), 3) for t in roots)
      [1.0, 2.0, 3.0, 4.0]
    """
    shift = a3 / 4
    p = a2 - 6 * shift**2
    q = a1 - 2 * shift * a2 + 8 * shift**3
    r = a0 - shift * a1 + shift**2 * a2 - 3 * shift**4
    # fenced: without, all modes of the TSE have a quarter more instructions
    z = fence(jnp.maximum(_largest_cubic_root(2 * p, p**2 - 4 * r, -(q**2)), 0))
    root = safe_sqrt(z)
    middle = (p + z) / 2
    split = jnp.where(q < 0, -1, 1) * safe_sqrt(middle**2 - r)
    roots, real = [], []
    for sign in (1, -1):
        discriminant = z / 4 - (middle - sign * split)
        half = safe_sqrt(discriminant)
        for side in (1, -1):
            roots.append(-sign * root / 2 + side * half - shift)
            real.append(discriminant >= 0)
    return roots, real


def _largest_cubic_root(a2: Scalar, a1: Scalar, a0: Scalar) -> Scalar:
    """Largest real root of z^3 + a2 z^2 + a1 z + a0, with one Newton step on top."""
    shift = a2 / 3
    p = a1 / 3 - shift**2
    q = shift**3 - shift * a1 / 2 + a0 / 2
    discriminant = q**2 + p**3
    three = discriminant < 0
    magnitude = safe_sqrt(-p)
    cosine = jnp.clip(safe_divide(-q, magnitude**3), -1, 1)
    trigonometric = 2 * magnitude * jnp.cos(jnp.arccos(cosine) / 3)
    cardano = jnp.cbrt(jnp.abs(q) + safe_sqrt(discriminant))
    single = jnp.where(q > 0, -1, 1) * (cardano - safe_divide(p, cardano))
    z = jnp.where(three, trigonometric, single) - shift
    value, slope = ((z + a2) * z + a1) * z + a0, (3 * z + 2 * a2) * z + a1
    step = safe_divide(value, slope)
    return jnp.where(jnp.abs(step) < 1e-3 * jnp.maximum(jnp.abs(z), jnp.abs(shift)), z - step, z)
