"""The Triple Scissor Extender: six slides, three scissors, one plate [RAL17, ICRA16]."""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.numerics import Scalar, safe_divide, safe_sqrt
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_arrays, is_concrete, pytree, quantity, unchecked
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._circle import Circle
from jaxscissor.robots._contract import Mechanism, joints_by_leg
from jaxscissor.robots._over_legs import one_by_one
from jaxscissor.robots._scissor import Scissor
from jaxscissor.robots._spaces import SE3, fit_triangle
from jaxscissor.robots.triple_scissor._leg import ScissorLeg
from jaxscissor.robots.triple_scissor._octahedron import inscribed_triangles

SLIDE_ANGLES = {
    "delta": math.pi / 6,
    "triangle": 0.0,
    "star": math.pi / 3,
    "hexagonal": -math.pi / 6,
}
"""Slide angles eta, in radians, of the four layouts named in [RAL17 fig. 3, below eq. 8]."""

_INCH = 0.0254


@pytree
class TripleScissorExtender(Mechanism):
    """Six-degree-of-freedom platform on three scissors, each standing on two slides [RAL17].

    Leg i has azimuth 0, 120 or 240 deg. Its slides start at ``actuator_radius`` outward from the
    centre and run at ``actuator_angle`` from the tangent, A towards the clockwise side:
    A = s_A (cos eta, sin eta) and B = s_B (-cos eta, sin eta) with the local y axis outward [RAL17 eq. 8].
    Joints are (s_A1, s_B1, s_A2, s_B2, s_A3, s_B3) [eq. 2], the pose is (x, y, z, roll, pitch, yaw) with
    R = Rx Ry Rz [eq. 1, ICRA16 eq. 1], in the base frame. [ICRA16] gives half the distance d between
    adjacent parallel slides, at eta = 30 deg: ``actuator_radius = 2 d / sqrt(3)``; it numbers the legs
    clockwise, which ``azimuths = (0, -2 pi / 3, 2 pi / 3)`` reproduces [ICRA16 eq. 4].

    Args:
      link_lengths: ``(n+1,)`` half-bars l0..ln; L = l0 + 2 (l1 + ... + ln).
      actuator_angle: eta, between -pi/2 and pi/2; ``SLIDE_ANGLES`` has the four named layouts.
      actuator_radius: distance from the centre to where a leg's slides meet, >= 0.
      top_radius: distance from the plate's centre to its ball joints.
      top_offset: height of the platform's reference point above its ball joints.
      base_offset: height of the slides' ball joints above the base plane.
      stroke: least and greatest slide coordinate, 0 <= least.
      scissor_angle: least and greatest inclination alpha of the bars, within 0 and pi/2.
      azimuths: ``(3,)`` directions of the legs.

    Raises:
      ValueError: if the numbers, when they are concrete, describe no robot.

    Example:
      >>> robot = TripleScissorExtender.from_ratios(0.2647, math.pi / 6, 0.0186, 0.11765, length=1.727)
      >>> pose, joints = robot.home()
      >>> pose.shape, joints.shape
      ((6,), (6,))
    """

    link_lengths: Any = quantity("m")
    actuator_angle: Any = quantity("rad")
    actuator_radius: Any = quantity("m")
    top_radius: Any = quantity("m")
    top_offset: Any = quantity("m", default=0.0)
    base_offset: Any = quantity("m", default=0.0)
    stroke: Any = quantity("m", default=(0.0, math.inf))
    scissor_angle: Any = quantity("rad", default=(0.0, math.pi / 2))
    azimuths: Any = quantity("rad", default=(0.0, 2 * math.pi / 3, 4 * math.pi / 3))

    space = SE3

    def __post_init__(self):
        shapes = {"stroke": (2,), "scissor_angle": (2,), "azimuths": (3,)}
        names = list(self.__dataclass_fields__)  # type: ignore[attr-defined]
        arrays = as_arrays(*(getattr(self, name) for name in names))
        for name, array in zip(names, arrays, strict=True):
            object.__setattr__(self, name, array)
            expected = array.shape if name == "link_lengths" else shapes.get(name, ())
            if array.shape != expected:
                raise ValueError(f"Got {name} of shape {array.shape}; expected {expected}.")
        Scissor(self.link_lengths)
        if is_concrete(arrays):
            _check(self)

    @classmethod
    def from_ratios(
        cls, k1: Any, k2: Any, k3: Any, k4: Any, length: Scalar = 1.0, **limits: Any
    ) -> TripleScissorExtender:
        """Robot with k1 = l0/L, k2 = eta, k3 = actuator_radius/L, k4 = top_radius/L [RAL17 IV-B].

        Args:
          k1, k2, k3, k4: the ratios; k2 in radians, 0 < k1 <= 1.
          length: L.
          **limits: further fields, such as ``stroke`` and ``scissor_angle``.

        Raises:
          ValueError: as the class, and if k1 > 1, which makes l0 > L.

        Example:
          >>> robot = TripleScissorExtender.from_ratios(0.3, 0.4, 0.05, 0.1, length=2.0)
          >>> [round(float(k), 6) for k in robot.ratios]
          [0.3, 0.4, 0.05, 0.1]
        """
        numbers = as_arrays(k1, k2, k3, k4, length)
        concrete = is_concrete(numbers)
        k1, k2, k3, k4, length = map(np.asarray, numbers) if concrete else numbers
        if concrete and not (0 < float(k1) <= 1 and float(length) > 0):
            raise ValueError(f"Got k1 = l0/L = {k1} and L = {length}; expected 0 < k1 <= 1 (l0 <= L) and L > 0.")
        lower, upper = k1 * length, (1 - k1) * length / 2
        rows = [lower] if concrete and float(k1) == 1 else [lower, upper]
        bars = np.stack(rows) if concrete else jnp.stack(rows)
        return cls(bars, k2, k3 * length, k4 * length, **limits)

    @classmethod
    def prototype(cls) -> TripleScissorExtender:
        """The prototype of [RAL17 V]: L = 1.727 m, heights 0.324 to 1.619 m by mechanical stops.

        The paper gives l0 but not the other bars; they are in the proportion of the laboratory robot.
        """
        length, k1, k3, k4 = 1.727, 0.2647, 0.0186, 0.11765
        upper = (1 - k1) * length / 2
        return cls(
            np.array([k1 * length, upper * 14 / 25, upper * 11 / 25]),
            SLIDE_ANGLES["delta"],
            k3 * length,
            k4 * length,
            scissor_angle=(math.asin(0.324 / length), math.asin(1.619 / length)),
        )

    @classmethod
    def laboratory(cls) -> TripleScissorExtender:
        """The authors' laboratory robot, from their public code of 2016, with its 12 in of travel; metres."""
        return cls(
            np.array([18.0, 14.0, 11.0]) * _INCH,
            SLIDE_ANGLES["delta"],
            1.2648 * _INCH,
            8.0 * _INCH,
            top_offset=2.125 * _INCH,
            base_offset=3.5231 * _INCH,
            stroke=(8.6 * _INCH, 20.6 * _INCH),
        )

    @property
    def scissor(self) -> Scissor:
        """The scissor of each leg."""
        return unchecked(Scissor, link_lengths=self.link_lengths, end="apex")

    @property
    def length(self) -> Scalar:
        """L, the height of a fully extended scissor [RAL17 eq. 6]."""
        return self.scissor.length

    @property
    def ratios(self) -> jax.Array:
        """The four design parameters (k1, k2, k3, k4), k2 in radians [RAL17 IV-B]."""
        scissor = self.scissor
        lengths = jnp.stack([scissor.base_link, self.actuator_radius, self.top_radius]) / scissor.length
        return jnp.stack([lengths[0], self.actuator_angle, lengths[1], lengths[2]])

    def legs(self) -> ScissorLeg:
        """The three legs, with all their dimensions leg by leg."""
        sine, cosine = jnp.sin(self.azimuths), jnp.cos(self.azimuths)
        level = jnp.zeros_like(sine)
        outward, tangent = Vec(cosine, sine, level), Vec(sine, -cosine, level)
        along, across = jnp.cos(self.actuator_angle), jnp.sin(self.actuator_angle)
        upper, scissor = self.link_lengths[1:], self.scissor

        def each(value: jax.Array):
            return jnp.broadcast_to(value, (3, *value.shape))

        return ScissorLeg(
            base_link=each(scissor.base_link),
            length=each(scissor.length),
            shares=each(upper * safe_divide(1, jnp.sum(upper))) if len(upper) else jnp.zeros((3, 0), upper.dtype),
            origin=outward * self.actuator_radius + Vec(level, level, level + self.base_offset),
            slide_a=tangent * along + outward * across,
            slide_b=tangent * -along + outward * across,
            stroke=(each(self.stroke[0]), each(self.stroke[1])),
            lowest=each(scissor.length * jnp.sin(self.scissor_angle[0])),
            narrowest=each(self._widths()[0]),
        )

    def attachments(self, position: Vec, rotation: Rotation) -> list[Vec]:
        """The three apices, in the base frame [RAL17 eq. 3]."""
        return [position + rotation @ corner for corner in self._corners()]

    def _corners(self) -> list[Vec]:
        """The ball joints in the platform frame."""
        radius, azimuths = self.top_radius, self.azimuths
        x, y = radius * jnp.cos(azimuths), radius * jnp.sin(azimuths)
        return [Vec(x[i], y[i], -self.top_offset) for i in range(3)]

    def assemblies(self, joints: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Up to 16 poses: with the slides held, every apex runs on a circle about the line of its feet."""
        corners, scale = self._corners(), self.length
        legs = fence(self.legs())  # else every circle would evaluate the slides' directions anew
        circles = [leg.circle(q) for leg, q in one_by_one(legs, joints_by_leg(self, joints))]
        circles = [Circle(*(part * (1 / scale) for part in circle)) for circle in circles]
        pairs = zip(corners, [*corners[1:], corners[0]], strict=True)
        sides = [safe_sqrt((a - b).dot(a - b)) / scale for a, b in pairs]
        angles, valid = inscribed_triangles(circles, tuple(sides))

        def pose(angles: Scalar):
            points = [circle.at(angle) * scale for circle, angle in zip(circles, angles, strict=True)]
            return jnp.stack(self.space.coordinates(*fit_triangle(corners, points)))

        return jax.vmap(pose)(angles), valid

    @one_pose()
    def home(self) -> tuple[jax.Array, jax.Array]:
        """Level on the axis, slides in the middle of what stroke, stops and the home mode allow."""
        low, high, height2 = self._home()
        slide = (low + high) / 4
        height = safe_sqrt(height2) + self.base_offset + self.top_offset
        zero = jnp.zeros_like(height)
        return jnp.stack([zero, zero, height, zero, zero, zero]), jnp.stack([slide] * 6)

    def _widths(self) -> tuple[Scalar, Scalar]:
        full = 2 * self.link_lengths[0]
        return full * jnp.cos(self.scissor_angle[1]), full * jnp.cos(self.scissor_angle[0])

    @one_pose()
    def _home(self) -> tuple[Scalar, Scalar, Scalar]:
        """Limits of s_A + s_B on the axis, and the apex's squared height above the slides in their middle."""
        along, across = jnp.cos(self.actuator_angle), jnp.sin(self.actuator_angle)
        reach = self.top_radius - self.actuator_radius
        narrow, wide = self._widths()
        low = jnp.maximum(jnp.maximum(2 * self.stroke[0], narrow / along), 2 * reach * across)
        high = jnp.minimum(2 * self.stroke[1], wide / along)
        middle = (low + high) / 2
        height2 = self.scissor.height(middle * along) ** 2 - (reach - middle * across / 2) ** 2
        return low, high, height2


def _check(robot: TripleScissorExtender) -> None:
    """Raise for geometry that describes no robot; every message says what was got and what to do."""

    def require(holds: Any, message: str) -> None:
        if not bool(holds):
            raise ValueError(message)

    eta, stroke, stops = (np.asarray(x) for x in (robot.actuator_angle, robot.stroke, robot.scissor_angle))
    for name in ("actuator_radius", "top_radius", "top_offset", "base_offset", "azimuths"):
        value = getattr(robot, name)
        require(np.all(np.isfinite(value)), f"Got {name} = {value}; expected finite numbers.")
    directions = np.exp(1j * np.asarray(robot.azimuths, float))
    require(
        np.abs(directions - np.roll(directions, 1)).min() > 1e-6,
        f"Got azimuths = {robot.azimuths} rad; expected three different directions: with two legs in one, the platform "
        "could turn about the line of its joints.",
    )
    require(float(robot.top_radius) > 0, f"Got top_radius = {robot.top_radius}; expected a positive length.")
    require(
        float(robot.actuator_radius) >= 0, f"Got actuator_radius = {robot.actuator_radius}; expected a length >= 0."
    )
    require(
        np.abs(eta) < math.pi / 2,
        f"Got actuator_angle = {eta} rad; expected |eta| < pi/2 (90 deg). Angles are in radians.",
    )
    require(
        (stroke[0] >= 0) & (stroke[0] < stroke[1]),
        f"Got stroke = {stroke}; expected 0 <= least < greatest: slides are counted outward from where they meet.",
    )
    require(
        (stops[0] >= 0) & (stops[0] < stops[1]) & (stops[1] <= stops.dtype.type(math.pi / 2)),
        f"Got scissor_angle = {stops} rad; expected 0 <= least < greatest <= pi/2. Angles are in radians.",
    )
    low, high, height2 = map(float, robot._home())
    require(
        (low < high) & (height2 > 0),
        f"No level pose on the axis: s_A + s_B would have to lie between {low} and {high} and the squared height "
        f"there is {height2}. Bring stroke, scissor_angle and link_lengths into agreement, or the difference of "
        "top_radius and actuator_radius closer to zero.",
    )
