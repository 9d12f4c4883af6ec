"""Which way is up for a robot: the plane of its base, wherever it is placed in the world."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.matrices import null_vector
from jaxscissor._engine.numerics import safe_sqrt
from jaxscissor._engine.vectors import Rotation, Vec

_EVEN = 0.05  # below this component, a direction counts as level, and the next axis decides on its sign


def normal_of(points: jax.Array) -> Vec:
    """Unit normal of the plane nearest to points ``(n, 3)``: upward, or if it is level along y, or along x.

    It has no derivative: it names a direction, nothing is measured by it.
    """
    points = lax.stop_gradient(points)
    normal = null_vector(points - jnp.mean(points, axis=0, keepdims=True))
    x, y, z = normal
    leading = jnp.where(jnp.abs(z) > _EVEN, z, jnp.where(jnp.abs(y) > _EVEN, y, x))
    return Vec(*(normal * jnp.where(leading < 0, -1, 1)))


def alignment(points: jax.Array, targets: jax.Array) -> Rotation:
    """The rotation of points ``(n, 3)`` that brings them nearest to as many targets, about the middles of both.

    Its quaternion is the eigenvector of the greatest eigenvalue of a 4 x 4 matrix [Horn, JOSA A 4, 1987]. It has no
    derivative.
    """
    p, q = (x - jnp.mean(x, axis=0, keepdims=True) for x in lax.stop_gradient((points, targets)))
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = p.T @ q
    rows = [
        [xx + yy + zz, yz - zy, zx - xz, xy - yx],
        [yz - zy, xx - yy - zz, xy + yx, zx + xz],
        [zx - xz, xy + yx, yy - xx - zz, yz + zy],
        [xy - yx, zx + xz, yz + zy, zz - xx - yy],
    ]
    matrix = jnp.stack([jnp.stack(row) for row in rows])
    above = safe_sqrt(jnp.sum(matrix**2)) * jnp.eye(4, dtype=matrix.dtype)  # at least the greatest eigenvalue
    w, x, y, z = null_vector(above - matrix)
    return Rotation(
        Vec(1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
        Vec(2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
        Vec(2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
    )
