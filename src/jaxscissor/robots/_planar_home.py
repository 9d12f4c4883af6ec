"""Where a planar platform on three legs is at home: over the middle of the base, turned clear of singularities."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxscissor._engine.matrices import determinant
from jaxscissor._engine.numerics import Scalar, limit_margins, safe_divide, safe_sqrt
from jaxscissor._engine.vectors import Vec
from jaxscissor.robots._planar_triangle import Held

Reach = tuple[jax.Array, jax.Array]  # least and greatest length of each leg

_TURNS = np.radians(np.arange(-90, 91, 15))


def middle_pose(base: jax.Array, platform: jax.Array, held: Held, reach: Reach) -> jax.Array:
    """Pose ``(3,)`` (x, y, alpha) with the middle of the platform's joints over that of the anchors.

    Turns from -90 to 90 deg in steps of 15 deg, counted from where the first sides of base and platform are parallel,
    are compared: those with all legs within their reach come first, and of these the one of greatest det A
    [NAV19 eq. 6].

    Args:
      base: ``(3, 2)`` anchors.
      platform: ``(3, 2)`` joints in the platform frame.
      held: the actuated joint of each leg, "theta" or "rho".
      reach: least and greatest length of each leg, ``(3,)`` each.
    """
    turns = jnp.asarray(_TURNS, base.dtype) + (_direction(base) - _direction(platform))
    fixed = lax.stop_gradient((base, platform, reach))
    scores = jax.vmap(lambda turn: _score(fixed[0], fixed[1], held, fixed[2], turn))(turns)
    turn = turns[jnp.argmax(scores)]
    within = jnp.arctan2(jnp.sin(turn), jnp.cos(turn))
    return jnp.concatenate([_position(base, platform, turn), within[None]])


def _direction(points: jax.Array) -> Scalar:
    """Direction of the side from the first point to the second."""
    x, y = points[1] - points[0]
    return jnp.arctan2(y, x)


def _turned(points: jax.Array, turn: Scalar) -> jax.Array:
    cos, sin = jnp.cos(turn), jnp.sin(turn)
    x, y = jnp.moveaxis(points, -1, 0)
    return jnp.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def _position(base: jax.Array, platform: jax.Array, turn: Scalar) -> jax.Array:
    return jnp.mean(base, axis=0) - _turned(jnp.mean(platform, axis=0), turn)


def _score(base: jax.Array, platform: jax.Array, held: Held, reach: Reach, turn: Scalar) -> Scalar:
    scale = safe_sqrt(jnp.sum((base - jnp.mean(base, axis=0, keepdims=True)) ** 2))
    arms = _turned(platform, turn)
    bars = (_position(base, platform, turn)[None] + arms - base) / scale
    lengths = safe_sqrt(jnp.sum(bars**2, axis=1))
    rows = []
    for bar, length, arm, joint in zip(bars, lengths, arms / scale, held, strict=True):
        h = (Vec(-bar[1], bar[0]) if joint == "theta" else Vec(bar[0], bar[1])) * safe_divide(1, length)
        rows.append(jnp.stack([h.x, h.y, arm[0] * h.y - arm[1] * h.x]))
    room = jnp.stack(limit_margins(lengths, reach[0] / scale, reach[1] / scale, 1))
    short = jnp.minimum(jnp.min(room), 0)
    # rounded, so that of turns that are alike by symmetry the first is taken on every machine
    return jnp.where(short < 0, short - 1, jnp.round(jnp.abs(determinant([list(row) for row in rows])), 4))


def check_triangle(name: str, points: jax.Array) -> None:
    """Raise unless three points ``(3, 2)`` are finite and make a triangle.

    Raises:
      ValueError: naming the points.
    """
    corners = np.asarray(points, float)
    if not np.all(np.isfinite(corners)):
        raise ValueError(f"Got {name} = {corners.tolist()}; expected finite numbers.")
    p, q = corners[1] - corners[0], corners[2] - corners[0]
    if abs(p[0] * q[1] - p[1] * q[0]) <= 1e-6 * max(p @ p, q @ q):
        raise ValueError(
            f"Got {name} = {corners.tolist()}: two of the points coincide or all are on one line. Expected a triangle."
        )
