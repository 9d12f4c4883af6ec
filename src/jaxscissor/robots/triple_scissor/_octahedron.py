"""A triangle whose corners lie on three circles in space: the 6-3 octahedral problem of the TSE's apices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.distinct import distinct
from jaxscissor._engine.newton import newton
from jaxscissor._engine.numerics import Scalar, safe_sqrt
from jaxscissor._engine.trigonometric import near_roots
from jaxscissor._engine.types import PyTree
from jaxscissor.robots._circle import Circle

SOLUTIONS = 16  # complex ones, counted with multiplicity
_PER_ARC = 8


class _Bilinear(NamedTuple):
    """|p - q|^2 - d^2 for p and q on two circles: c + p.u + q.v + u.K v with u = (cos, sin) of each."""

    constant: Scalar
    by_first: tuple[Scalar, ...]
    by_second: tuple[Scalar, ...]
    mixed: tuple[tuple[Scalar, ...], ...]

    @classmethod
    def between(cls, one: Circle, two: Circle, side: Scalar) -> _Bilinear:
        gap = one.center - two.center
        radii = one.first.dot(one.first) + two.first.dot(two.first)
        axes = (one.first, one.second), (two.first, two.second)
        return cls(
            gap.dot(gap) + radii - side**2,
            tuple(2 * gap.dot(a) for a in axes[0]),
            tuple(-2 * gap.dot(b) for b in axes[1]),
            tuple(tuple(-2 * a.dot(b) for b in axes[1]) for a in axes[0]),
        )

    def line(self, u: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar, Scalar]:
        """The equation c + a cos + b sin = 0 that is left for the second circle."""
        return (
            self.constant + self.by_first[0] * u[0] + self.by_first[1] * u[1],
            self.by_second[0] + self.mixed[0][0] * u[0] + self.mixed[1][0] * u[1],
            self.by_second[1] + self.mixed[0][1] * u[0] + self.mixed[1][1] * u[1],
        )

    def value(self, u: tuple[Scalar, Scalar], v: tuple[Scalar, Scalar]) -> Scalar:
        c, a, b = self.line(u)
        return c + a * v[0] + b * v[1]


def inscribed_triangles(circles: list[Circle], sides: tuple[Scalar, Scalar, Scalar]) -> tuple[jax.Array, jax.Array]:
    """Angles ``(16, 3)`` on three circles of the corners of every triangle with given sides, and which are real.

    With the first angle fixed, the other corners follow in two ways each. The product of the third side's
    equation over these four branches, freed of denominators, is a trigonometric polynomial of degree 8 in the
    first angle. Lengths are expected to be of order one.

    Args:
      circles: the three circles.
      sides: lengths between corners 1-2, 2-3 and 3-1.
    """
    one, two, three = circles
    to_two = _Bilinear.between(one, two, sides[0])
    across = _Bilinear.between(two, three, sides[1])
    to_three = _Bilinear.between(one, three, sides[2])
    dtype = jnp.result_type(to_two.constant)

    complex_across = jax.tree.map(_complex, across)

    def resultant(angle: Scalar):
        u = (jnp.cos(angle), jnp.sin(angle))
        (n2, seconds), (n3, thirds) = _complex_branches(to_two.line(u)), _complex_branches(to_three.line(u))
        product = (n2 * n3) ** 2
        for v in seconds:
            for w in thirds:
                product = product * complex_across.value(v, w)
        return jnp.real(product)

    first = jnp.concatenate([near_roots(resultant, SOLUTIONS // 2, dtype), _across_arcs(to_two, to_three, dtype)])
    starts = jnp.concatenate(jax.vmap(lambda x: _real_branches(x, to_two, to_three))(first))

    def residual(angles: Scalar, equations: Sequence[_Bilinear]):
        u, v, w = ((jnp.cos(x), jnp.sin(x)) for x in angles)
        return equations[0].value(u, v), equations[1].value(v, w), equations[2].value(u, w)

    tol = 64 * float(jnp.finfo(dtype).eps)

    def polish(start: PyTree):
        args = (to_two, across, to_three)
        angles, error, _ = newton(residual, tuple(start), args, tol=0.1 * tol, max_steps=20)
        return jnp.stack(angles), error

    angles, errors = jax.vmap(polish)(starts)
    points = jnp.concatenate([jnp.cos(angles), jnp.sin(angles)], axis=1)
    apart = 64 * float(jnp.finfo(dtype).eps) ** 0.5
    best = jnp.argsort(errors)
    indices, count = distinct(points[best], errors[best] <= tol, apart, SOLUTIONS)
    return angles[best[indices]], jnp.arange(SOLUTIONS) < count


def _across_arcs(to_two: _Bilinear, to_three: _Bilinear, dtype: jax.typing.DTypeLike) -> jax.Array:
    """Angles ``(8 * _PER_ARC,)`` spread over each arc between two ends of the branches.

    Where the branches are real on a short arc only, all roots lie in it, too close to each other for the
    polynomial. The spread is that of Chebyshev's points, as the branches meet like square roots.
    """

    def discriminant(equation: _Bilinear):
        def at(angle: Scalar):
            c, a, b = equation.line((jnp.cos(angle), jnp.sin(angle)))
            return a * a + b * b - c * c

        return near_roots(at, 2, dtype)[:4]

    ends = jnp.sort(jnp.concatenate([discriminant(to_two), discriminant(to_three)]))
    arcs = jnp.append(ends[1:], ends[0] + 2 * jnp.pi) - ends
    spread = 0.5 - 0.5 * jnp.cos(jnp.pi * (jnp.arange(_PER_ARC, dtype=dtype) + 0.5) / _PER_ARC)
    return (ends[:, None] + arcs[:, None] * spread[None]).ravel()


def _complex_branches(line: tuple[Scalar, Scalar, Scalar]):
    """n = a^2 + b^2 and both solutions (cos, sin) of c + a cos + b sin = 0, complex where there is none."""
    c, a, b = (_complex(x) for x in line)
    n = a * a + b * b
    root = jnp.sqrt(n - c * c)
    return n, [((-c * a - s * b * root) / n, (-c * b + s * a * root) / n) for s in (1, -1)]


def _complex(x: Scalar) -> Scalar:
    return lax.complex(x, jnp.zeros_like(x))


def _real_branches(angle: Scalar, to_two: _Bilinear, to_three: _Bilinear) -> jax.Array:
    """Starts ``(4, 3)`` with the given first angle; where the others are complex, their real part."""
    u = (jnp.cos(angle), jnp.sin(angle))

    def both(line: tuple[Scalar, Scalar, Scalar]):
        c, a, b = line
        root = safe_sqrt(a * a + b * b - c * c)
        return [jnp.arctan2(-c * b + s * a * root, -c * a - s * b * root) for s in (1, -1)]

    return jnp.stack([jnp.stack([angle, v, w]) for v in both(to_two.line(u)) for w in both(to_three.line(u))])
