"""A triangle in the plane whose corners are held by lengths or directions from three anchors: the planar 3-RPR."""

from __future__ import annotations

import functools
from typing import Literal

import jax
import jax.numpy as jnp

from jaxscissor._engine.distinct import distinct
from jaxscissor._engine.newton import newton
from jaxscissor._engine.numerics import Scalar, safe_divide, safe_sqrt
from jaxscissor._engine.trigonometric import near_roots
from jaxscissor._engine.types import PyTree
from jaxscissor._engine.vectors import Rotation, Vec

Held = tuple[Literal["theta", "rho"], ...]

SOLUTIONS = 6  # at most; 4 with two directions, 2 with three


def held_triangles(
    anchors: list[Vec], corners: list[Vec], held: Held, values: list[Scalar]
) -> tuple[jax.Array, jax.Array]:
    """Poses ``(6, 3)`` (x, y, alpha) of a triangle with each corner at a length or in a direction from its anchor.

    With v from the first anchor of a given length (or any, if there is none) to its corner, every other
    condition is linear in v at a given alpha [TRI 5, after Gosselin, Sefrioui and Richard]; what remains is a
    trigonometric polynomial of degree 3 in alpha, 2 or 1 with two or three directions.

    Args:
      anchors: three points of the base.
      corners: three points in the platform frame.
      held: which of (theta, rho) is given, corner by corner. Directions are rays: rho > 0.
      values: the three given numbers. Lengths are expected to be of order one.

    Returns:
      The poses, padded, and which are real.
    """
    first = held.index("rho") if "rho" in held else 0
    order = [first, *(i for i in range(3) if i != first)]
    conditions = _Conditions(anchors, corners, held, values, order)
    degree = {0: 3, 1: 3, 2: 2, 3: 1}[held.count("theta")]
    dtype = jnp.result_type(values[0])
    angles = near_roots(conditions.resultant, degree, dtype)
    starts = jnp.concatenate(jax.vmap(conditions.starts)(angles))
    tol = 64 * float(jnp.finfo(dtype).eps)

    def polish(start: PyTree):
        unknowns, error, _ = newton(lambda u, _: conditions.residual(u), tuple(start), (), tol=0.1 * tol, max_steps=20)
        return jnp.stack(conditions.pose(unknowns)), jnp.where(conditions.on_rays(unknowns), error, jnp.inf)

    poses, errors = jax.vmap(polish)(starts)
    points = jnp.concatenate([poses[:, :2], jnp.cos(poses[:, 2:]), jnp.sin(poses[:, 2:])], axis=1)
    best = jnp.argsort(errors)
    apart = 64 * float(jnp.finfo(dtype).eps) ** 0.5
    indices, count = distinct(points[best], errors[best] <= tol, apart, SOLUTIONS)
    return poses[best[indices]], jnp.arange(SOLUTIONS) < count


class _Conditions:
    """The conditions on (v, alpha): one of them quadratic in v if a length is given, the others n.v = k."""

    def __init__(self, anchors: list[Vec], corners: list[Vec], held: Held, values: list[Scalar], order: list[int]):
        self.anchors, self.corners = [anchors[i] for i in order], [corners[i] for i in order]
        self.held, self.values = [held[i] for i in order], [values[i] for i in order]
        self.rays = [Vec(jnp.cos(value), jnp.sin(value)) for value in self.values]  # where a direction is given

    def _shift(self, i: int, cos: Scalar, sin: Scalar) -> Vec:
        """What corner i is farther from its anchor than the first."""
        turned = Rotation(Vec(cos, sin), Vec(-sin, cos)) @ (self.corners[i] - self.corners[0])
        return turned - (self.anchors[i] - self.anchors[0])

    def _line(self, i: int, cos: Scalar, sin: Scalar) -> tuple[Vec, Scalar]:
        """(n, k) of the linear condition n.v = k of corner i."""
        shift = self._shift(i, cos, sin)
        if self.held[i] == "theta":
            normal = _left(self.rays[i])
            return normal, -normal.dot(shift)
        return shift, (self.values[i] ** 2 - self.values[0] ** 2 - shift.dot(shift)) / 2

    def _lines(self, angle: Scalar) -> list[tuple[Vec, Scalar]]:
        cos, sin = jnp.cos(angle), jnp.sin(angle)
        return [self._line(i, cos, sin) for i in range(0 if self.held[0] == "theta" else 1, 3)]

    def resultant(self, angle: Scalar) -> Scalar:
        lines = self._lines(angle)
        if len(lines) == 3:
            (k, a), (m, b), (n, c) = lines
            return a * _cross(m, n) + b * _cross(n, k) + c * _cross(k, m)
        (m, b), (n, c) = lines
        meeting = _left(m) * c - _left(n) * b
        return meeting.dot(meeting) - (self.values[0] * _cross(m, n)) ** 2

    def starts(self, angle: Scalar) -> jax.Array:
        """Candidates ``(5 or 3, 3)`` for (v, alpha): where two lines meet, and each line and the circle."""
        lines = self._lines(angle)
        pairs = [(i, j) for i in range(len(lines)) for j in range(i)]
        points = [_meeting(lines[i], lines[j]) for i, j in pairs]
        if len(lines) == 2:
            points += [point for line in lines for point in _on_circle(line, self.values[0])]
        return jnp.stack([jnp.stack([v.x, v.y, angle]) for v in points])

    def residual(self, unknowns: PyTree):
        v = Vec(*unknowns[:2])
        quadratic = (v.dot(v) - self.values[0] ** 2,) if self.held[0] == "rho" else ()
        return *quadratic, *(n.dot(v) - k for n, k in self._lines(unknowns[2]))

    def on_rays(self, unknowns: PyTree) -> Scalar:
        cos, sin = jnp.cos(unknowns[2]), jnp.sin(unknowns[2])
        v, turned = Vec(*unknowns[:2]), [i for i, held in enumerate(self.held) if held == "theta"]
        ahead = [self.rays[i].dot(v + self._shift(i, cos, sin)) > 0 for i in turned]
        return functools.reduce(jnp.logical_and, ahead, jnp.asarray(True))

    def pose(self, unknowns: PyTree) -> tuple[Scalar, Scalar, Scalar]:
        cos, sin = jnp.cos(unknowns[2]), jnp.sin(unknowns[2])
        position = self.anchors[0] + Vec(*unknowns[:2]) - Rotation(Vec(cos, sin), Vec(-sin, cos)) @ self.corners[0]
        return position.x, position.y, jnp.arctan2(sin, cos)


def _left(v: Vec) -> Vec:
    """The vector turned by 90 deg to the left."""
    return Vec(-v.y, v.x)


def _cross(a: Vec, b: Vec) -> Scalar:
    return a.x * b.y - a.y * b.x


def _meeting(one: tuple[Vec, Scalar], two: tuple[Vec, Scalar]) -> Vec:
    (m, b), (n, c) = one, two
    return (_left(m) * c - _left(n) * b) * safe_divide(1, _cross(m, n))


def _on_circle(line: tuple[Vec, Scalar], radius: Scalar) -> list[Vec]:
    """Where a line n.v = k meets a circle about the origin, or comes closest to it."""
    n, k = line
    squared = n.dot(n)
    middle, along = n * safe_divide(k, squared), _left(n) * safe_divide(1, safe_sqrt(squared))
    half = safe_sqrt(radius**2 - middle.dot(middle))
    return [middle + along * half, middle - along * half]
