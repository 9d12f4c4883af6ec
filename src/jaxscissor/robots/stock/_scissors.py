"""Robots that stand on scissors: a lift, a hexapod."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.numerics import Scalar, limit_margins, safe_sqrt
from jaxscissor._engine.pytree import pytree, quantity
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._contract import Joints, Leg, Mechanism
from jaxscissor.robots._scissor import Scissor
from jaxscissor.robots._spaces import SE2, SE3
from jaxscissor.robots._subspaces import Subspace
from jaxscissor.robots.stock._places import check_rod, checked, polar


@pytree
class ScissorLeg(Leg):
    """A scissor between two points, whose width an actuator changes.

    Attributes:
      anchor: on the base.
      scissor: it reaches from there to the platform's point.
      stroke: least and greatest width.
    """

    anchor: Vec
    scissor: Scissor
    stroke: tuple[Scalar, Scalar]

    actuated = (True,)
    limits = ("narrowest", "widest")

    def _share(self, attachment: Vec) -> Scalar:
        """Square of the height as a share of the greatest."""
        bar = attachment - self.anchor
        return bar.dot(bar) / self.scissor.length**2

    def residual(self, joints: Joints, attachment: Vec) -> Joints:
        """Height and width on the scissor's ellipse [RAL17 eqs. 4-7]."""
        return (self._share(attachment) + (joints[0] / (2 * self.scissor.base_link)) ** 2 - 1,)

    def start(self, attachment: Vec) -> tuple[Joints, Scalar]:
        """The solution itself."""
        room = 1 - self._share(attachment)
        return (2 * self.scissor.base_link * safe_sqrt(room),), room

    def solutions(self, attachment: Vec) -> tuple[Sequence[Joints], Sequence[Scalar]]:
        """One: a width is not negative."""
        joints, room = self.start(attachment)
        return [joints], [room >= 0]

    def closes(self, joints: Joints) -> Scalar:
        """No wider than the lowest bars span."""
        return jnp.abs(joints[0]) <= 2 * self.scissor.base_link

    def margins(self, joints: Joints, attachment: Vec) -> Sequence[Scalar]:
        """The width within its stroke, in lengths of the lowest bars."""
        return limit_margins(joints[0], *self.stroke, 2 * self.scissor.base_link)

    def bars(self, joints: Joints, attachment: Vec) -> Sequence[tuple[Vec, Vec]]:
        """The scissor's, in a plane through the line from the anchor to the point."""
        bar = attachment - self.anchor
        along = bar * (1 / safe_sqrt(bar.dot(bar)))
        if len(along.components) == 2:
            side = Vec(along.y, -along.x)
        else:
            side = Vec(-along.y, along.x, 0 * along.z)
            level = safe_sqrt(side.dot(side))
            side = side * (1 / jnp.where(level > 0, level, 1)) + Vec(jnp.where(level > 0, 0.0, 1.0), 0.0, 0.0)
        place = [(self.anchor + side * p[0] + along * p[1]) for pair in self.scissor.bars(joints[0]) for p in pair]
        return list(zip(place[::2], place[1::2], strict=True))

    def rails(self, joints: Joints, attachment: Vec) -> Sequence[tuple[Vec, Vec]]:
        """The joint on the base."""
        return [(self.anchor, self.anchor)]


@pytree
class ScissorLift(Mechanism):
    """A scissor that stands upright on its slide and lifts a platform in the plane: one freedom, y.

    Args:
      link_lengths: ``(n+1,)`` half-bars from the base up; see ``Scissor`` with an open end.
      stroke: ``(2,)`` least and greatest width of the slide.

    Raises:
      ValueError: lengths that make no scissor, a stroke that is none.

    Example:
      >>> robot = ScissorLift.prototype()
      >>> pose, width = robot.home()
      >>> f"{float(pose[0]):.3f} {float(width[0]):.3f}"
      '2.318 0.635'
    """

    link_lengths: Any = quantity("m")
    stroke: Any = quantity("m")

    space = Subspace(SE2, ("y",))

    def __post_init__(self):
        scissor = Scissor(self.link_lengths, end="open")
        object.__setattr__(self, "link_lengths", scissor.link_lengths)
        numbers = checked(self, link_lengths=scissor.link_lengths.shape, stroke=(2,))
        if numbers:
            _check_stroke(*numbers)

    @classmethod
    def prototype(cls) -> ScissorLift:
        """Three pairs of bars of 1 m."""
        return cls([0.5, 0.5, 0.5, 0.5], (0.3, 0.97))

    @property
    def scissor(self) -> Scissor:
        """The element."""
        return Scissor(self.link_lengths, end="open")

    @property
    def length(self) -> Scalar:
        """Greatest height."""
        return self.scissor.length

    def legs(self) -> ScissorLeg:
        """The one."""
        leg = ScissorLeg(Vec(0 * self.length, 0 * self.length), self.scissor, (self.stroke[0], self.stroke[1]))
        return jax.tree.map(lambda leaf: leaf[None], leg)

    def attachments(self, position: Vec, rotation: Rotation) -> list[Vec]:
        """The platform's point."""
        return [position]

    def home(self) -> tuple[jax.Array, jax.Array]:
        """In the middle of the stroke."""
        width = (self.stroke[0] + self.stroke[1]) / 2
        return self.scissor.height(width)[None], width[None]


@pytree
class ScissorHexapod(Mechanism):
    """A hexapod whose legs are scissors between balls, in three pairs 120 deg apart; joints are the widths.

    Args:
      base, platform: radii of the circles of balls.
      base_angle, platform_angle: half the angle between the two of a pair, seen from the middle.
      link_lengths: ``(n+1,)`` half-bars of each leg; see ``Scissor`` with an apex.
      stroke: ``(2,)`` least and greatest width.

    Raises:
      ValueError: numbers that are not positive, scissors that do not reach the platform in the middle of the stroke.

    Example:
      >>> ScissorHexapod.prototype().home()[1].shape
      (6,)
    """

    base: Any = quantity("m")
    platform: Any = quantity("m")
    base_angle: Any = quantity("rad")
    platform_angle: Any = quantity("rad")
    link_lengths: Any = quantity("m")
    stroke: Any = quantity("m")

    space = SE3

    def __post_init__(self):
        scissor = Scissor(self.link_lengths)
        object.__setattr__(self, "link_lengths", scissor.link_lengths)
        numbers = checked(self, link_lengths=scissor.link_lengths.shape, stroke=(2,))
        if not numbers:
            return
        base, platform, low, high, links, stroke = numbers
        _check_stroke(links, stroke)
        gap = math.sqrt(base**2 + platform**2 - 2 * base * platform * math.cos(high - low))
        tall = (2 * links.sum() - links[0]) * math.sqrt(1 - (stroke.mean() / (2 * links[0])) ** 2)
        check_rod(self, gap, tall)

    @classmethod
    def prototype(cls) -> ScissorHexapod:
        """Circles of 0.5 m and 0.3 m, legs of three stages up to 1.6 m tall."""
        return cls(0.5, 0.3, math.radians(12), math.radians(48), [0.2, 0.35, 0.35], (0.05, 0.39))

    @property
    def length(self) -> Scalar:
        """Greatest height of a leg."""
        return Scissor(self.link_lengths).length

    def _corners(self, radius: Scalar, half: Scalar) -> list[tuple[Scalar, ...]]:
        middles = [2 * math.pi / 3 * (i // 2) for i in range(6)]
        return [polar(radius, m + (half if i % 2 else -half), 0 * radius) for i, m in enumerate(middles)]

    def legs(self) -> ScissorLeg:
        """The six."""
        feet = jnp.stack([jnp.stack(corner) for corner in self._corners(self.base, self.base_angle)])
        scissor, stroke = Scissor(self.link_lengths), (self.stroke[0], self.stroke[1])
        shared = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (6, *leaf.shape)), (scissor, stroke))
        return ScissorLeg(Vec(*feet.T), *shared)

    def attachments(self, position: Vec, rotation: Rotation) -> list[Vec]:
        """The platform's balls."""
        corners = self._corners(self.platform, self.platform_angle)
        return [position + rotation @ Vec(*corner) for corner in corners]

    def home(self) -> tuple[jax.Array, jax.Array]:
        """Level, in the middle of the stroke."""
        width = (self.stroke[0] + self.stroke[1]) / 2
        low, high = self._corners(self.base, self.base_angle)[0], self._corners(self.platform, self.platform_angle)[0]
        tall, zero = Scissor(self.link_lengths).height(width), 0 * width
        height = safe_sqrt(tall**2 - (high[0] - low[0]) ** 2 - (high[1] - low[1]) ** 2)
        return jnp.stack([zero, zero, height, zero, zero, zero]), jnp.stack([width] * 6)


def _check_stroke(links: np.ndarray, stroke: np.ndarray) -> None:
    if not 0 <= stroke[0] < stroke[1] <= 2 * links[0]:
        raise ValueError(
            f"Got stroke = {stroke.tolist()}; expected 0 <= least < greatest <= {2 * links[0]:.4g}, 2 l_0."
        )
