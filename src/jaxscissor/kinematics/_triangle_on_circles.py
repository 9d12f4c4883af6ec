"""A platform whose three corners swing on circles while the actuated joints are held.

Three angles are unknown instead of six coordinates of a pose, and three distances are the equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.matrices import determinant_sign, solve
from jaxscissor._engine.newton import implicit, norm
from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.types import PyTree
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._circle import Circle
from jaxscissor.robots._contract import Mechanism, actuated_mask, actuation, constraints_on, joints_by_leg
from jaxscissor.robots._over_legs import over_legs
from jaxscissor.robots._spaces import SE3

_PAIRS = (0, 1), (1, 2), (2, 0)
_FINER = 1 / 16  # share of a tolerance for closure equations to which distances are solved: a small platform turns more

Angle = tuple[Scalar, Scalar]  # cosine and sine of an angle


class TriangleOnCircles(NamedTuple):
    """Three circles in the base frame, and the corners of the platform in its own; lengths in those of the robot."""

    circles: tuple[Circle, ...]
    corners: tuple[Vec, ...]

    def points(self, angles: tuple[Angle, ...]) -> list[Vec]:
        """The points of the circles at some angles."""
        return [circle.toward(*angle) for circle, angle in zip(self.circles, angles, strict=True)]

    def residual(self, points: list[Vec]) -> tuple[Scalar, ...]:
        """What the squared sides of a triangle differ from those of the platform."""
        return tuple(p.dot(p) - a.dot(a) for p, a in zip(_sides(points), _sides(self.corners), strict=True))

    def residual_and_jacobian(self, angles: tuple[Angle, ...]) -> tuple[tuple[Scalar, ...], list[tuple[Scalar, ...]]]:
        """The residual, and its rows of derivatives by the angles."""
        tangents = [c.second * angle[0] - c.first * angle[1] for c, angle in zip(self.circles, angles, strict=True)]
        points = self.points(angles)
        sides = zip(_sides(points), _PAIRS, strict=True)
        (a, b), (c, d), (e, f) = ((2 * side.dot(tangents[i]), -2 * side.dot(tangents[j])) for side, (i, j) in sides)
        zero = jnp.zeros_like(a)
        return self.residual(points), [(a, b, zero), (zero, c, d), (f, zero, e)]


def _sides(points: Sequence[Vec]) -> list[Vec]:
    return [points[i] - points[j] for i, j in _PAIRS]


def triangle_on_circles(robot: Mechanism, actuated: jax.Array) -> TriangleOnCircles | None:
    """The circles of a free platform in space on three legs that know theirs; ``None`` of any other robot."""
    if robot.space != SE3 or not all(actuated_mask(robot)) or len(actuation(robot)) != 3:
        return None
    joints, legs = joints_by_leg(robot, actuated), robot.legs()
    leg, own = jax.tree.map(lambda leaf: leaf[0], (legs, joints))
    if jax.eval_shape(lambda leg, own: leg.circle(own), leg, own) is None:
        return None
    zero, one = jnp.zeros_like(actuated[0]), jnp.ones_like(actuated[0])
    origin, axes = Vec(zero, zero, zero), (Vec(one, zero, zero), Vec(zero, one, zero), Vec(zero, zero, one))
    if constraints_on(robot, origin, Rotation(*axes)):
        return None
    scale = 1 / robot.length
    circles = over_legs(lambda leg, own: Circle(*(part * scale for part in leg.circle(own))), legs, joints)
    circles = tuple(jax.tree.map(lambda leaf, i=i: leaf[i], circles) for i in range(3))
    return TriangleOnCircles(circles, tuple(corner * scale for corner in robot.attachments(origin, Rotation(*axes))))


def solved_corners(
    triangle: TriangleOnCircles, points: list[Vec], tol: Scalar, max_steps: Scalar
) -> tuple[list[Vec], Scalar]:
    """Corners at the platform's distances near some points on the circles, and the number of steps.

    Newton's method on the three angles; lengths are in those of the robot.

    1. Begin at the angles of the points of the circles that are nearest to the given ones.
    2. The residual r, whose entries are differences of squared distances, and its Jacobian J, two numbers in a row; the
       step is -J^-1 r.
    3. Try the angles moved by a share of it, at first by all. If the residual is smaller there, go, and double the
       share up to one; if not, stay, and halve it.
    """
    triangle = fence(triangle)

    def unfinished(carry: PyTree):
        _, error, _, count = carry
        return (error > _FINER * tol) & (count < max_steps)

    def step(carry: PyTree):
        angles, error, share, count = carry
        values, rows = triangle.residual_and_jacobian(angles)
        ahead = fence(solve(rows, values))  # every number of the state would solve anew
        trial = fence(_moved(angles, tuple(-share * d for d in ahead)))
        trial_error = fence(norm(triangle.residual(triangle.points(trial))))
        better = trial_error < error
        angles = jax.tree.map(lambda new, old: jnp.where(better, new, old), trial, angles)
        share = jnp.where(better, jnp.minimum(2 * share, 1), share / 2)
        return angles, jnp.where(better, trial_error, error), share, count + 1

    start = fence(_nearest_angles(triangle, points))
    error = norm(triangle.residual(triangle.points(start)))
    carry = (start, error, jnp.ones_like(error), jnp.zeros_like(error, dtype=jnp.int32))
    angles, _, _, steps = lax.while_loop(unfinished, step, carry)
    return triangle.points(angles), steps


def assembly_sign_by_angles(triangle: TriangleOnCircles, points: list[Vec]) -> Scalar:
    """Sign of the determinant of the three distances by the three angles, zero where it is singular to rounding.

    Between it and the determinant of all closure equations by the twist there are only factors that do not vanish while
    each leg holds its point to a circle and the corners are no line. Let G be the closure by the corners, T the corners
    by the twist, D the distances by the corners and C the circles' tangents, so that G C and D T are zero. With right
    inverses E of G and H of D, [T C] is [E C] [[G T, 0], [., 1]] and [T H] [[1, .], [0, D C]].
    """
    return determinant_sign(fence(triangle.residual_and_jacobian(fence(_nearest_angles(triangle, points)))[1]))


def differentiable_corners(triangle: TriangleOnCircles, points: list[Vec], ok: Scalar) -> list[Vec]:
    """The corners at a solution, with the implicit function's derivative where ok."""
    angles = lax.stop_gradient(fence(_nearest_angles(triangle, points)))
    zero = (jnp.zeros_like(angles[0][0]),) * 3
    return triangle.points(_moved(angles, implicit(_residual_by_steps, zero, ok, (triangle, angles))))


def _nearest_angles(triangle: TriangleOnCircles, points: list[Vec]) -> tuple[Angle, ...]:
    return tuple(circle.nearest(point) for circle, point in zip(triangle.circles, points, strict=True))


def _residual_by_steps(
    steps: tuple[Scalar, ...], args: tuple[TriangleOnCircles, tuple[Angle, ...]]
) -> tuple[Scalar, ...]:
    triangle, angles = args
    return triangle.residual(triangle.points(_moved(angles, steps)))


def _moved(angles: tuple[Angle, ...], steps: tuple[Scalar, ...]) -> tuple[Angle, ...]:
    """Further by the angle whose half has the tangent step / 2: the step to second order, without trigonometry."""

    def one(angle: Angle, step: Scalar) -> Angle:
        t = step / 2
        scale = 1 / (1 + t * t)
        c, s = (1 - t * t) * scale, 2 * t * scale
        return angle[0] * c - angle[1] * s, angle[1] * c + angle[0] * s

    return tuple(one(angle, step) for angle, step in zip(angles, steps, strict=True))
