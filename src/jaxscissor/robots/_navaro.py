"""NaVARo II: a planar platform on three scissors, of which each turns or stretches [NAV19]."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.numerics import Scalar, limit_margins, safe_divide, safe_sqrt
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_arrays, is_concrete, pytree, quantity, static, unchecked
from jaxscissor._engine.types import JointsLike
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._bodies import BASE, PLATFORM, Connection, Freedom, pinned, scissor_pins
from jaxscissor.robots._contract import Joints, Leg, Mechanism, joints_by_leg, joints_together, seen_by_legs
from jaxscissor.robots._planar_home import check_triangle, middle_pose
from jaxscissor.robots._planar_triangle import Held, held_triangles
from jaxscissor.robots._scissor import Scissor
from jaxscissor.robots._spaces import SE2

ACTUATION_MODES: dict[int, Held] = {
    1: ("theta", "theta", "theta"),
    2: ("theta", "theta", "rho"),
    3: ("theta", "rho", "theta"),
    4: ("rho", "theta", "theta"),
    5: ("theta", "rho", "rho"),
    6: ("rho", "rho", "theta"),
    7: ("rho", "theta", "rho"),
    8: ("rho", "rho", "rho"),
}
"""The actuated joint of each leg in the eight actuation modes [NAV19 table 1]."""


@pytree
class NavaroLeg(Leg):
    """A scissor that turns about its anchor by theta and stretches to rho, in the plane of motion.

    Attributes:
      anchor: A, in the base frame.
      scale: the robot's length.
      stroke: least and greatest rho.
      crosses: number of crosses of the scissor, which only the picture shows.
    """

    anchor: Vec
    scale: Scalar
    stroke: tuple[Scalar, Scalar]
    crosses: int = static()

    actuated = (False, True)  # the robot's actuation mode decides
    angular = (True, False)
    limits = ("shortest leg", "longest leg")

    def residual(self, joints: Joints, attachment: Vec) -> Joints:
        """A + rho (cos theta, sin theta) - B, in units of the robot's length [NAV19 eqs. 7-12]."""
        theta, rho = joints
        tip = self.anchor + Vec(jnp.cos(theta), jnp.sin(theta)) * rho
        return ((tip - attachment) * (1 / self.scale)).components

    def start(self, attachment: Vec) -> tuple[Joints, Scalar]:
        """The solution itself; it exists everywhere but at rho = 0, where theta is arbitrary."""
        bar = attachment - self.anchor
        rho = safe_sqrt(bar.dot(bar))
        theta = jnp.arctan2(*lax.stop_gradient((bar.y, bar.x)))
        return (theta, rho), rho / self.scale

    def margins(self, joints: Joints, attachment: Vec) -> Sequence[Scalar]:
        """rho within its stroke [NAV19 eqs. 13-15]."""
        return limit_margins(joints[1], *self.stroke, self.scale)

    def solutions(self, attachment: Vec) -> tuple[Sequence[Joints], Sequence[Scalar]]:
        """One: rho is a length, so that (theta + pi, -rho) is none."""
        joints, reach = self.start(attachment)
        bar = attachment - self.anchor
        theta = jnp.arctan2(jnp.where(reach > 0, bar.y, 0), jnp.where(reach > 0, bar.x, 1))
        return [(theta, joints[1])], [reach >= 0]

    def bars(self, joints: Joints, attachment: Vec) -> Sequence[tuple[Vec, Vec]]:
        """The scissor's bars, in the vertical plane through the leg, and the screw and the guide at its open ends."""
        bar = attachment - self.anchor
        along = fence(bar * safe_divide(1, safe_sqrt(bar.dot(bar))))  # else every end would evaluate it anew
        low, high = self.stroke
        full = jnp.where(jnp.isfinite(high), safe_sqrt(low**2 + high**2), 2 * joints[1])
        scissor = _equal_scissor(full / self.crosses, self.crosses)

        def place(point: jax.Array):
            foot = self.anchor + along * point[1]
            return Vec(foot.x, foot.y, point[0])

        bars = scissor.bars(fence(scissor.width(joints[1])))
        (first, last), (first_mirrored, last_mirrored) = (bars[0][0], bars[-1][1]), (bars[1][0], bars[-2][1])
        bars += [(first, first_mirrored), (last, last_mirrored)]
        return [(place(p), place(q)) for p, q in bars]

    def connections(self, joints: Joints, attachment: Vec) -> Sequence[Connection]:
        """The screw turns on the base, its two nuts carry the scissor, whose upper ends slide on the guide.

        The guide turns on the platform. The screw's threads are left and right, so that the nuts move alike.
        """
        bars = self.bars(joints, attachment)
        screw, guide = len(bars) - 2, len(bars) - 1
        (low, high), (end, end_mirrored) = bars[screw], bars[guide]
        zero = jnp.zeros_like(joints[0])
        up = Vec(zero, zero, zero + 1)
        bar = attachment - self.anchor
        normal = Vec(-bar.y, bar.x, zero) * safe_divide(1, safe_sqrt(bar.dot(bar)))
        crossings = [(p + q) * 0.5 for p, q in bars[: 2 * self.crosses : 2]]
        nuts = [
            Connection(screw, i, point, (Freedom("slide", axis, geared=0), Freedom("turn", normal)))
            for i, (point, axis) in enumerate([(low, -up), (high, up)])
        ]
        sliders = [
            Connection(i, guide, point, (Freedom("turn", normal), Freedom("slide", up)))
            for i, point in [(screw - 1, end), (screw - 2, end_mirrored)]
        ]
        return [
            Connection(BASE, screw, Vec(*self.anchor.components, zero), (Freedom("turn", up, joints=(0,)),)),
            *nuts,
            *scissor_pins(bars[:screw], crossings, normal),
            *sliders,
            pinned(guide, PLATFORM, Vec(*attachment.components, zero), up),
        ]

    def rails(self, joints: Joints, attachment: Vec) -> Sequence[tuple[Vec, Vec]]:
        """The anchor, and where the leg's end can go as the scissor stretches."""
        bar = attachment - self.anchor
        along = bar * safe_divide(1, safe_sqrt(bar.dot(bar)))
        low, high = self.stroke
        end = jnp.where(jnp.isfinite(high), high, joints[1])
        return [(self.anchor, self.anchor), (self.anchor + along * low, self.anchor + along * end)]


@pytree
class NavaroII(Mechanism):
    """Planar robot (x, y, alpha) whose motors each turn a leg or stretch its scissor [NAV19].

    All joints are (theta1, rho1, theta2, rho2, theta3, rho3); the actuation mode says which three are
    actuated, the others are passive.

    Args:
      base: ``(3, 2)`` anchors A of the legs, in the base frame.
      platform: ``(3, 2)`` joints B of the legs, in the platform frame, about the reference point P.
      stroke: least and greatest rho, 0 <= least.
      mode: actuation mode 1 to 8 [NAV19 table 1].
      crosses: number of crosses of each leg's scissor.

    Raises:
      ValueError: an unknown mode, base or platform points on one line, a stroke that is none or in which
        the platform fits nowhere over the middle of the base.

    Example:
      >>> robot = NavaroII.prototype(mode=6)
      >>> pose, joints = robot.home()
      >>> robot.actuated(joints).shape
      (3,)
    """

    base: Any = quantity("")
    platform: Any = quantity("")
    stroke: Any = quantity("", default=(0.0, math.inf))
    mode: int = static(default=8)
    crosses: int = static(default=4)

    space = SE2

    def __post_init__(self):
        if self.mode not in ACTUATION_MODES:
            raise ValueError(f"Got mode={self.mode!r}; expected an actuation mode 1 to 8 [NAV19 table 1].")
        if not (isinstance(self.crosses, int) and self.crosses >= 1):
            raise ValueError(f"Got crosses={self.crosses!r}; expected a whole number of at least 1.")
        arrays = as_arrays(self.base, self.platform, self.stroke)
        shapes = {"base": (3, 2), "platform": (3, 2), "stroke": (2,)}
        for (name, shape), array in zip(shapes.items(), arrays, strict=True):
            object.__setattr__(self, name, array)
            if array.shape != shape:
                raise ValueError(f"Got {name} of shape {array.shape}; expected {shape}.")
        if is_concrete(arrays):
            _check(self)

    @classmethod
    def prototype(cls, mode: int = 8) -> NavaroII:
        """The robot of [NAV19 2]: base of side 90, platform of side 30, stroke 9 to 80 (eq. 30); unit unspecified."""
        root = math.sqrt(3)
        base = [[0.0, 0.0], [90.0, 0.0], [45.0, 45 * root]]
        platform = [[-15.0, -5 * root], [15.0, -5 * root], [0.0, 10 * root]]
        return cls(base, platform, (9.0, 80.0), mode)

    @property
    def length(self) -> Scalar:
        """Of a regular base the side: root of the summed squared distances of the anchors from their middle."""
        return safe_sqrt(jnp.sum((self.base - jnp.mean(self.base, axis=0, keepdims=True)) ** 2))

    @property
    def scissor(self) -> Scissor:
        """The scissor of each leg, of n crosses and bars of length l = sqrt(r_min^2 + r_max^2) / n [NAV19 eqs. 27-28].

        ``scissor.width`` is the position mu of the screw at an extension rho, ``scissor.height`` the inverse.

        Raises:
          ValueError: a stroke without end, or bars of l <= 3 h [NAV19 eq. 29].
        """
        low, high = self.stroke
        if is_concrete(self.stroke):
            if not bool(jnp.isfinite(high)):
                raise ValueError("Got a stroke without end; a scissor needs a greatest length.")
            if bool(high**2 <= 8 * low**2):
                raise ValueError(
                    f"Got stroke = {self.stroke}; bars of length l > 3 h stretch by more than sqrt(8). "
                    "Take a shorter least length [NAV19 eqs. 27-29]."
                )
        return _equal_scissor(safe_sqrt(low**2 + high**2) / self.crosses, self.crosses)

    @property
    def bar_height(self) -> Scalar:
        """h, the height of a bar: r_min = n h [NAV19 eq. 27]."""
        return self.stroke[0] / self.crosses

    def actuation(self) -> tuple[tuple[bool, ...], ...]:
        """The mode's joints [NAV19 table 1]."""
        return tuple((joint == "theta", joint == "rho") for joint in ACTUATION_MODES[self.mode])

    def legs(self) -> NavaroLeg:
        """The three legs, with all their dimensions leg by leg."""

        def each(value: jax.Array):
            return jnp.broadcast_to(value, (3,))

        anchor = Vec(self.base[:, 0], self.base[:, 1])
        return NavaroLeg(anchor, each(self.length), (each(self.stroke[0]), each(self.stroke[1])), self.crosses)

    def attachments(self, position: Vec, rotation: Rotation) -> list[Vec]:
        """The platform's joints B in the base frame."""
        return [position + rotation @ corner for corner in _points(self.platform)]

    @one_pose()
    def home(self) -> tuple[jax.Array, jax.Array]:
        """Platform over the middle of the base, turned by what keeps it farthest from a singularity of the mode.

        Turns from -90 to 90 deg in steps of 15 deg are compared, those within the stroke first.
        """
        reach = jnp.broadcast_to(self.stroke[0], (3,)), jnp.broadcast_to(self.stroke[1], (3,))
        pose = middle_pose(self.base, self.platform, ACTUATION_MODES[self.mode], reach)
        bars = seen_by_legs(self, *self.space.place(pose)) - Vec(*self.base.T)
        return pose, joints_together(self, (jnp.arctan2(bars.y, bars.x), safe_sqrt(bars.dot(bars))))

    def assemblies(self, joints: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Up to 6 poses: 6 with at most one direction given, 4 with two, 2 with three."""
        held, scale = ACTUATION_MODES[self.mode], self.length
        values = [q if h == "theta" else q / scale for q, h in zip(joints, held, strict=True)]
        poses, valid = held_triangles(_points(self.base / scale), _points(self.platform / scale), held, values)
        return poses * jnp.stack([scale, scale, jnp.ones_like(scale)])[None], valid

    def sensed_pose(self, joints: JointsLike) -> tuple[jax.Array, jax.Array]:
        """Pose that fits all six sensors best, in closed form, and how well [NAV19 2].

        Args:
          joints: ``(6,)`` all joints, as measured.

        Returns:
          The pose ``(3,)`` of least squared distance between the legs' ends and the platform's joints, and
          that distance, root mean square, zero for consistent sensors.
        """
        (joints,) = as_arrays(joints)
        theta, rho = joints_by_leg(self, joints)
        ends, corners = self.base + jnp.stack([jnp.cos(theta) * rho, jnp.sin(theta) * rho], axis=1), self.platform
        center, middle = jnp.mean(ends, axis=0), jnp.mean(corners, axis=0)
        p, q = corners - middle[None], ends - center[None]
        alpha = jnp.arctan2(jnp.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]), jnp.sum(p * q))
        cos, sin = jnp.cos(alpha), jnp.sin(alpha)
        turn = jnp.stack([jnp.stack([cos, -sin]), jnp.stack([sin, cos])])
        misfit = safe_sqrt(jnp.mean(jnp.sum((p @ turn.T - q) ** 2, axis=1)))
        return jnp.concatenate([center - turn @ middle, alpha[None]]), misfit


def _points(array: jax.Array) -> list[Vec]:
    return [Vec(array[i, 0], array[i, 1]) for i in range(3)]


def _equal_scissor(bar: Scalar, crosses: int) -> Scissor:
    """The open scissor of equal bars of a length, crossing in their middles."""
    return unchecked(Scissor, link_lengths=jnp.full(crosses + 1, 0.5, jnp.result_type(bar)) * bar, end="open")


def _check(robot: NavaroII) -> None:
    """Raise for geometry that describes no robot; every message says what was got and what to do."""
    check_triangle("base", robot.base)
    check_triangle("platform", robot.platform)
    low, high = np.asarray(robot.stroke).tolist()
    if not 0 <= low < high:
        raise ValueError(f"Got stroke = ({low}, {high}); expected 0 <= least < greatest.")
    lengths = np.asarray(robot.home()[1])[1::2]
    slack = 1e-6 * lengths.max()
    if not np.all((lengths > slack) & (lengths >= low - slack) & (lengths <= high + slack)):
        raise ValueError(
            f"No pose over the middle of the base has all legs within the stroke ({low}, {high}): the best has "
            f"lengths {lengths.tolist()}. Widen the stroke, or bring base and platform into agreement with it."
        )
