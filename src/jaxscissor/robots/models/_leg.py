"""A leg with bodies, joints and loops of its own, solved from home by Newton's method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp

from jaxscissor._engine.numerics import Scalar, limit_margins, safe_divide
from jaxscissor._engine.pytree import pytree, static
from jaxscissor._engine.vectors import Vec
from jaxscissor.robots._contract import Joints, Leg
from jaxscissor.robots.models._plan import BASE, PLATFORM, ClosurePlan, JointPlan, LegPlan

Frame = tuple[jax.Array, jax.Array]  # a body's point, and how it is turned from home


@pytree
class ModelLeg(Leg):
    """Bodies that hang as a tree from base and platform, and the closures of the loops between them.

    At home no body is turned. A ball's coordinates are those of Gibbs: the axis times the tangent of half the angle.

    Attributes:
      bodies: ``(bodies, 3)`` from the point of what a body hangs from to its own.
      axes, points: ``(joints, 3)`` of each joint its axis, and its place from the body's point.
      values: ``(joints,)`` coordinate of each joint at home.
      strokes: ``(joints, 2)`` least and greatest coordinate.
      anchors: ``(closures, 2, 3)`` from the points of both bodies to where they are held together.
      scale: a length, which makes the equations dimensionless.
      plan: how all this hangs together.
    """

    bodies: jax.Array
    axes: jax.Array
    points: jax.Array
    values: jax.Array
    strokes: jax.Array
    anchors: jax.Array
    scale: Scalar
    plan: LegPlan = static()

    @property
    def actuated(self) -> tuple[bool, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """As the model's user says."""
        return tuple(joint.actuated for joint in self.plan.coordinates())

    @property
    def angular(self) -> tuple[bool, ...] | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """All but the slides."""
        return tuple(joint.kind != "P" for joint in self.plan.coordinates())

    @property
    def limits(self) -> tuple[str, ...] | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Both ends of every pin and slide, in turn."""
        count = sum(joint.kind != "B" for joint in self.plan.coordinates())
        return tuple(f"{end} of joint {i + 1}" for i in range(count) for end in ("least", "greatest"))

    def frames(self, joints: Joints, attachment: Any) -> list[Frame]:
        """Where each body is, one after the other along the tree."""
        eye = jnp.eye(3, dtype=self.bodies.dtype)
        place, turn = attachment[0].array(), jnp.stack([column.array() for column in attachment[1]], axis=1)
        roots = {BASE: (0 * place, eye), PLATFORM: (place, turn)}
        frames: list[Frame] = []
        coordinates, number = iter(joints), 0
        for i, body in enumerate(self.plan.bodies):
            origin, turned = roots[body.parent] if body.parent < 0 else frames[body.parent]
            point = origin + turned @ self.bodies[i]
            for joint in body.joints:
                own = [next(coordinates) for _ in joint.coordinates]
                point, turned = self._moved(number, joint, own, point, turned)
                number += 1
            frames.append((point, turned))
        return frames

    def _moved(self, number: int, joint: JointPlan, own: list[Scalar], point: jax.Array, turned: jax.Array) -> Frame:
        """A body moved by one of its joints."""
        if not own:
            return point, turned
        if joint.kind == "P":
            return point + turned @ self.axes[number] * (own[0] - self.values[number]), turned
        if joint.kind == "R":
            motion = _about(self.axes[number], own[0] - self.values[number])
        else:
            gibbs = jnp.zeros(3, self.axes.dtype).at[jnp.array(joint.coordinates)].set(jnp.stack(own))
            motion = _half_turned(gibbs)
        arm = self.points[number]
        return point + turned @ (arm - motion @ arm), turned @ motion

    def gaps(self, joints: Joints, attachment: Any) -> jax.Array:
        """All equations of the closures, those that follow from others too."""
        frames = self.frames(joints, attachment)
        place, turn = attachment[0].array(), jnp.stack([column.array() for column in attachment[1]], axis=1)
        sides = [*frames, (place, turn), (0 * place, jnp.eye(3, dtype=place.dtype))]  # -2 is the platform, -1 the base
        return jnp.concatenate([self._gap(i, c, joints, sides) for i, c in enumerate(self.plan.closures)])

    def _gap(self, number: int, closure: ClosurePlan, joints: Joints, sides: list[Frame]) -> jax.Array:
        if closure.kind == "gear":
            return self._off_gear(closure, joints).reshape(1)
        (p, r), (q, s) = sides[closure.first], sides[closure.second]
        apart = (p + r @ self.anchors[number, 0] - q - s @ self.anchors[number, 1]) / self.scale
        return apart if closure.kind == "point" else jnp.concatenate([apart, _half_turn(r @ s.T)])

    def _off_gear(self, closure: ClosurePlan, joints: Joints) -> Scalar:
        """How far a joint is from what a polynomial of another, from home to home, says."""
        plans = self.plan.coordinates()
        moved = [q - home for q, home in zip(joints, self._homes(), strict=True)]
        other = moved[closure.second] if closure.second >= 0 else 0.0
        off = moved[closure.first] - sum(c * other**k for k, c in enumerate(closure.polynomial))
        return off / self.scale if plans[closure.first].kind == "P" else off

    def _homes(self) -> Joints:
        """Every coordinate at home; a ball's are zero there."""
        joints = [joint for body in self.plan.bodies for joint in body.joints]
        zero = jnp.zeros_like(self.scale)
        return tuple(
            zero if joint.kind == "B" else self.values[i] for i, joint in enumerate(joints) for _ in joint.coordinates
        )

    def residual(self, joints: Joints, attachment: Any) -> Joints:
        """Those of the equations that the joints solve."""
        return tuple(self.gaps(joints, attachment)[jnp.array(self.plan.solve)])

    def constraints(self, joints: Joints, attachment: Any) -> Sequence[Scalar]:
        """Those that bind the platform."""
        return tuple(self.gaps(joints, attachment)[jnp.array(self.plan.bind)]) if self.plan.bind else ()

    def start(self, attachment: Any) -> tuple[Joints, None]:
        """Home, from where Newton's method goes on."""
        return self._homes(), None

    def margins(self, joints: Joints, attachment: Any) -> Sequence[Scalar]:
        """Pins and slides within their limits, slides in units of the scale."""
        every = [joint for body in self.plan.bodies for joint in body.joints]
        numbers = [i for i, joint in enumerate(every) for _ in joint.coordinates]
        pairs = [
            limit_margins(q, self.strokes[i, 0], self.strokes[i, 1], self.scale if every[i].kind == "P" else 1)
            for q, i in zip(joints, numbers, strict=True)
            if every[i].kind != "B"
        ]
        return [margin for pair in pairs for margin in pair]

    def bars(self, joints: Joints, attachment: Any) -> Sequence[tuple[Vec, Vec]]:
        """From the point of each body to that of the body that it hangs from, and to where loops are closed."""
        frames = self.frames(joints, attachment)
        bars = [(frames[b.parent][0], frames[i][0]) for i, b in enumerate(self.plan.bodies) if b.parent >= 0]
        for i, closure in enumerate(self.plan.closures):
            for side, body in enumerate((closure.first, closure.second)):
                if closure.kind != "gear" and body >= 0:
                    point, turned = frames[body]
                    bars.append((point, point + turned @ self.anchors[i, side]))
        return [(Vec(*start), Vec(*end)) for start, end in bars]

    def rails(self, joints: Joints, attachment: Any) -> Sequence[tuple[Vec, Vec]]:
        """The bodies' points on the base, and where loops are closed there."""
        feet = [self.bodies[i] for i, body in enumerate(self.plan.bodies) if body.parent == BASE]
        for i, closure in enumerate(self.plan.closures):
            sides = () if closure.kind == "gear" else (closure.first, closure.second)
            feet += [self.anchors[i, side] for side, body in enumerate(sides) if body == BASE]
        return [(Vec(*foot), Vec(*foot)) for foot in feet]


def _cross(vector: jax.Array) -> jax.Array:
    """Matrix of the vector product with a vector."""
    x, y, z = vector
    zero = jnp.zeros_like(x)
    return jnp.stack([zero, -z, y, z, zero, -x, -y, x, zero]).reshape(3, 3)


def _about(axis: jax.Array, angle: Scalar) -> jax.Array:
    """Rotation matrix about an axis of any length (Rodrigues)."""
    along = axis / jnp.sqrt(jnp.sum(axis**2))
    kept = jnp.outer(along, along)
    return kept + (jnp.eye(3, dtype=kept.dtype) - kept) * jnp.cos(angle) + _cross(along) * jnp.sin(angle)


def _half_turned(gibbs: jax.Array) -> jax.Array:
    """Rotation matrix of Gibbs coordinates."""
    cross = _cross(gibbs)
    return jnp.eye(3, dtype=gibbs.dtype) + (cross + cross @ cross) * (2 / (1 + jnp.sum(gibbs**2)))


def _half_turn(turn: jax.Array) -> jax.Array:
    """Gibbs coordinates of a rotation matrix."""
    skew = turn - turn.T
    return jnp.stack([skew[2, 1], skew[0, 2], skew[1, 0]]) * safe_divide(1, 1 + jnp.trace(turn))
