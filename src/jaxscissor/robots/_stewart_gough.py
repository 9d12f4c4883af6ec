"""The Gough-Stewart platform: six telescopic legs, the robot that the papers compare with."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.numerics import Scalar, limit_margins, safe_divide, safe_sqrt
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_arrays, is_concrete, pytree, quantity
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._bodies import BASE, PLATFORM, Connection, Freedom, balled
from jaxscissor.robots._contract import Joints, Leg, Mechanism
from jaxscissor.robots._spaces import SE3
from jaxscissor.robots._topology import Topology
from jaxscissor.robots._upright import alignment, normal_of


@pytree
class TelescopicLeg(Leg):
    """A leg of variable length between two ball joints.

    Attributes:
      anchor: on the base.
      scale: the robot's length.
      stroke: least and greatest length.
    """

    anchor: Vec
    scale: Scalar
    stroke: tuple[Scalar, Scalar]

    actuated = (True,)
    limits = ("shortest leg", "longest leg")

    def residual(self, joints: Joints, attachment: Vec) -> Joints:
        """Squared distance of the joints less the squared length, relative to both it and the robot's length."""
        bar, length2 = attachment - self.anchor, joints[0] ** 2
        return ((bar.dot(bar) - length2) / (self.scale**2 + length2),)

    def start(self, attachment: Vec) -> tuple[Joints, Scalar]:
        """The solution itself; it exists everywhere."""
        bar = attachment - self.anchor
        length = safe_sqrt(bar.dot(bar))
        return (length,), length / self.scale

    def solutions(self, attachment: Vec) -> tuple[Sequence[Joints], Sequence[Scalar]]:
        """One: a length is not negative."""
        joints, reach = self.start(attachment)
        return [joints], [reach >= 0]

    def margins(self, joints: Joints, attachment: Vec) -> Sequence[Scalar]:
        """Length within its stroke."""
        return limit_margins(joints[0], *self.stroke, self.scale)

    def bars(self, joints: Joints, attachment: Vec) -> Sequence[tuple[Vec, Vec]]:
        """Cylinder, of the least length where that is known, and rod."""
        bar = attachment - self.anchor
        share = jnp.clip(safe_divide(self.stroke[0], joints[0]), 0, 1)
        joint = self.anchor + bar * jnp.where(share > 0, share, 0.5)
        return [(self.anchor, joint), (joint, attachment)]

    def connections(self, joints: Joints, attachment: Vec) -> Sequence[Connection]:
        """A universal joint on the base, the rod that slides in the cylinder, a ball joint on the platform."""
        (_, joint), *_ = self.bars(joints, attachment)
        bar = attachment - self.anchor
        along = bar * safe_divide(1, safe_sqrt(bar.dot(bar)))
        # level, unless the leg is nearly so
        side = Vec(-along.y, along.x, jnp.zeros_like(along.z))
        side = _where(jnp.abs(along.z) < 0.99, side, Vec(jnp.zeros_like(along.x), -along.z, along.y))
        side = side * safe_divide(1, safe_sqrt(side.dot(side)))
        universal = (Freedom("turn", side), Freedom("turn", along.cross(side)))
        return [
            Connection(BASE, 0, self.anchor, universal),
            Connection(0, 1, joint, (Freedom("slide", along, joints=(0,)),)),
            balled(1, PLATFORM, attachment),
        ]

    def rails(self, joints: Joints, attachment: Vec) -> Sequence[tuple[Vec, Vec]]:
        """The ball joint on the base."""
        return [(self.anchor, self.anchor)]


@pytree
class StewartGough(Mechanism):
    """Six-degree-of-freedom platform on six telescopic legs; joints are their lengths.

    Args:
      base: ``(6, 3)`` ball joints in the base frame.
      platform: ``(6, 3)`` ball joints in the platform frame.
      stroke: least and greatest length of the legs.

    Raises:
      ValueError: wrong shapes, joints of base or platform on one line, a stroke that no pose along the base and over
        its middle meets. A base and a platform that leave the platform loose at every pose are warned of.

    Example:
      >>> robot = StewartGough.prototype()
      >>> pose, joints = robot.home()
      >>> joints.shape
      (6,)
    """

    base: Any = quantity("m")
    platform: Any = quantity("m")
    stroke: Any = quantity("m", default=(0.0, math.inf))

    space = SE3
    topology: ClassVar[Topology] = Topology(links=14, freedoms=(2,) * 6 + (1,) * 6 + (3,) * 6)
    """Base, platform, cylinders and rods; universal joints below, prismatic ones between, ball joints above."""

    def __post_init__(self):
        arrays = as_arrays(self.base, self.platform, self.stroke)
        shapes = {"base": (6, 3), "platform": (6, 3), "stroke": (2,)}
        for (name, shape), array in zip(shapes.items(), arrays, strict=True):
            object.__setattr__(self, name, array)
            if array.shape != shape:
                raise ValueError(f"Got {name} of shape {array.shape}; expected {shape}.")
        if is_concrete(arrays):
            _check(self)

    @classmethod
    def prototype(cls) -> StewartGough:
        """Pairs of joints on circles of 1 m and 0.6 m, base and platform turned by 60 deg, legs of 1 to 2 m."""
        third, half = 2 * math.pi / 3, math.radians(12)
        base = [third * (i // 2) + (half if i % 2 else -half) for i in range(6)]
        top = [third * (i // 2) + (third / 2 - half if i % 2 else half - third / 2) for i in range(6)]
        circles = (1.0, base), (0.6, top)
        points = [[[r * math.cos(a), r * math.sin(a), 0.0] for a in angles] for r, angles in circles]
        return cls(points[0], points[1], (1.0, 2.0))

    @property
    def length(self) -> Scalar:
        """Root mean square distance of the base's joints from their middle, times sqrt(2)."""
        return safe_sqrt(jnp.sum((self.base - jnp.mean(self.base, axis=0, keepdims=True)) ** 2) / 3)

    def legs(self) -> TelescopicLeg:
        """The six legs, with all their dimensions leg by leg."""

        def each(value: jax.Array):
            return jnp.broadcast_to(value, (6,))

        return TelescopicLeg(Vec(*self.base.T), each(self.length), (each(self.stroke[0]), each(self.stroke[1])))

    def attachments(self, position: Vec, rotation: Rotation) -> list[Vec]:
        """The platform's ball joints in the base frame."""
        return [position + rotation @ Vec(*corner) for corner in self.platform]

    @one_pose()
    def home(self) -> tuple[jax.Array, jax.Array]:
        """Over the middle of the base, turned so that the platform's joints are nearest to the base's.

        The mean of the squared lengths is that of the middle of the stroke.
        """
        up, rotation = normal_of(self.base), alignment(self.platform, self.base)
        turned = (rotation @ Vec(*self.platform.T)).array()
        level = turned - self.base
        level = level - jnp.mean(level, axis=0, keepdims=True)
        low, high = self.stroke
        ends = jnp.isfinite(high)
        middle = jnp.where(ends, (low + jnp.where(ends, high, 0)) / 2, low + 1.5 * self.length)
        rise = up * safe_sqrt(middle**2 - jnp.mean(jnp.sum(level**2, axis=1)))
        lengths = safe_sqrt(jnp.sum((level + rise.array()[None]) ** 2, axis=1))
        position = Vec(*(jnp.mean(self.base, axis=0) - jnp.mean(turned, axis=0))) + rise
        return jnp.stack(self.space.coordinates(position, rotation)), lengths


def _where(condition: Scalar, one: Vec, other: Vec) -> Vec:
    return Vec(*(jnp.where(condition, a, b) for a, b in zip(one.components, other.components, strict=True)))


def _check(robot: StewartGough) -> None:
    """Raise for geometry that describes no robot; every message says what was got and what to do."""
    for name in ("base", "platform"):
        points = np.asarray(getattr(robot, name), float)
        if not np.all(np.isfinite(points)):
            raise ValueError(f"Got {name} = {points.tolist()}; expected finite numbers.")
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[1] <= 1e-6 * spread[0] or spread[0] == 0:
            raise ValueError(f"Got {name} = {points.tolist()}: all joints on one line. Expected a body they can hold.")
    low, high = np.asarray(robot.stroke).tolist()
    if not 0 <= low < high:
        raise ValueError(f"Got stroke = ({low}, {high}); expected 0 <= least < greatest.")
    joints = np.asarray(robot.home()[1])
    if not np.all((joints > 0) & (joints >= low) & (joints <= high)):
        raise ValueError(
            f"No pose along the base and over its middle has all legs within the stroke ({low}, {high}): the best has "
            f"lengths {joints.tolist()}. Widen the stroke, or bring base and platform into agreement with it."
        )
    if _is_loose(robot):
        warnings.warn(
            "Got a base and a platform whose six legs are linearly dependent at every pose, as those of two similar "
            "hexagons are: the platform is loose whatever the lengths, and no pose follows from them. Bring the joints "
            "together in pairs, or turn the platform's against the base's.",
            stacklevel=4,
        )


def _is_loose(robot: StewartGough) -> bool:
    """Whether the lines of the legs are linearly dependent at three poses of no symmetry, and so at all."""
    base, platform = (np.asarray(x, float) for x in (robot.base, robot.platform))
    base, platform = base - base.mean(axis=0), platform - platform.mean(axis=0)
    length = np.linalg.norm(base)
    least = []
    for number in range(3):
        turn, move = np.random.default_rng(number).uniform(-1, 1, (2, 3))
        skew = np.cross(np.eye(3), turn / 2)
        arms = platform @ np.linalg.solve(np.eye(3) - skew, np.eye(3) + skew)  # Cayley's rotation
        bars = arms + 3 * length * move - base
        lines = np.hstack([bars, np.cross(arms, bars) / length])
        sizes = np.linalg.svd(lines / np.linalg.norm(lines, axis=1, keepdims=True), compute_uv=False)
        least.append(sizes[-1])
    return max(least) < 1e3 * float(np.finfo(robot.base.dtype).eps)
