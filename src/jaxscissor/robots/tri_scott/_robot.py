"""Tri-Scott and MICABO: a platform on three Scott linkages, each on a mast of its own [TRI]."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.numerics import Scalar, safe_sqrt
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_arrays, is_concrete, pytree, quantity, unchecked
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._contract import Joints, Mechanism, joints_by_leg, joints_together, seen_by_legs
from jaxscissor.robots._planar_home import check_triangle, middle_pose
from jaxscissor.robots._planar_triangle import held_triangles
from jaxscissor.robots._scott import Scott
from jaxscissor.robots._spaces import SE3, fit_triangle
from jaxscissor.robots._topology import Topology
from jaxscissor.robots.tri_scott._leg import MicaboLeg, ScottLeg

_LENGTHS = ("rho", "rho", "rho")
_OPEN = ((0.0, math.inf), (0.0, math.inf))


@pytree
class TriScott(Mechanism):
    """Six-degree-of-freedom platform whose height and tilt are driven apart from its planar motion [TRI].

    Joints are (rho1 .. rho6): rho1..rho3 the heights of the lower sliders, rho4..rho6 the distances of the
    upper sliders above them. The variant by Kazuya, which [TRI] only mentions, is not modelled.

    Args:
      masts: ``(3, 2)`` where the masts stand, in the plane z = 0.
      link_lengths: ``(3,)`` L of each link, from the upper slider to the platform.
      platform: ``(3, 2)`` the platform's joints in its own plane, about the reference point.
      stroke: ``(2, 2)`` least and greatest rho1..rho3, least and greatest rho4..rho6.
      crank_lengths: ``(3,)`` of each crank. Default: L/2, with which the platform's joint stays level with
        the lower slider.
      crank_pins: ``(3,)`` distance along each link from the upper slider to the crank. Default: L/2.

    Raises:
      ValueError: masts that coincide or stand on one line, a platform that is no triangle, lengths that are
        not positive, links or strokes with which the platform fits nowhere over the middle of the masts.

    Example:
      >>> robot = TriScott.prototype()
      >>> pose, joints = robot.home()
      >>> bool((joints[:3] == pose[2]).all())
      True
    """

    masts: Any = quantity("m")
    link_lengths: Any = quantity("m")
    platform: Any = quantity("m")
    stroke: Any = quantity("m", default=_OPEN)
    crank_lengths: Any = quantity("m", default=None)
    crank_pins: Any = quantity("m", default=None)

    space = SE3
    joint_order = (0, 3, 1, 4, 2, 5)
    topology: ClassVar[Topology] = Topology(links=14, freedoms=(1,) * 9 + (3,) * 9)
    """Base, platform, per leg two sliders, crank and link; six prismatic, three turning, nine ball joints."""
    _leg: ClassVar[type[ScottLeg]] = ScottLeg
    _moves_with_height: ClassVar[tuple[int, int]] = (1, 0)  # how a leg's joints change as the level platform rises

    def __post_init__(self):
        links = as_arrays(self.link_lengths)[0]
        half = (np.asarray(links) if is_concrete(links) else links) / 2
        cranks, pins = (half if value is None else value for value in (self.crank_lengths, self.crank_pins))
        arrays = as_arrays(self.masts, self.link_lengths, self.platform, self.stroke, cranks, pins)
        shapes = ((3, 2), (3,), (3, 2), (2, 2), (3,), (3,))
        names = ("masts", "link_lengths", "platform", "stroke", "crank_lengths", "crank_pins")
        for name, shape, array in zip(names, shapes, arrays, strict=True):
            object.__setattr__(self, name, array)
            if array.shape != shape:
                raise ValueError(f"Got {name} of shape {array.shape}; expected {shape}.")
        Scott(*(getattr(self, name) for name in ("link_lengths", "crank_lengths", "crank_pins")))
        if is_concrete(arrays):
            _check(self)

    @classmethod
    def prototype(cls):
        """Round numbers, since [TRI] prints none: masts 1 m apart, links of 0.8 m, a platform of side 0.3 m."""
        masts, platform = _regular(1.0), _regular(0.3)
        return cls(masts, [0.8] * 3, platform, cls._strokes())

    @classmethod
    def _strokes(cls):
        return ((0.0, 1.5), (0.1, 0.75))

    @property
    def length(self) -> Scalar:
        """Root mean square distance of the masts from their middle times sqrt(3): the side of a regular base."""
        return safe_sqrt(jnp.sum((self.masts - jnp.mean(self.masts, axis=0, keepdims=True)) ** 2))

    @property
    def linkage(self) -> Scott:
        """The three Scott linkages, stacked."""
        return unchecked(Scott, link=self.link_lengths, crank=self.crank_lengths, pin=self.crank_pins)

    def legs(self) -> ScottLeg:
        """The three legs, with all their dimensions leg by leg."""

        def each(value: jax.Array):
            return jnp.broadcast_to(value, (3,))

        low, high = ((each(limits[0]), each(limits[1])) for limits in self.stroke)
        return self._leg(Vec(self.masts[:, 0], self.masts[:, 1]), self.linkage, each(self.length), low, high)

    def attachments(self, position: Vec, rotation: Rotation) -> list[Vec]:
        """The platform's joints 4i in the base frame."""
        return [position + rotation @ corner for corner in self._corners()]

    @one_pose()
    def home(self) -> tuple[jax.Array, jax.Array]:
        """Level over the middle of the masts, turned clear of singularities, in the middle of the strokes."""
        planar = middle_pose(self.masts, self.platform, _LENGTHS, self._radii())
        zero = jnp.zeros_like(planar[0])
        flat = jnp.stack([planar[0], planar[1], zero, zero, zero, planar[2]])
        tips = seen_by_legs(self, *self.space.place(flat))
        grounded = jax.vmap(lambda leg, tip: leg.start(tip)[0])(self.legs(), tips)
        height = self._level(grounded)
        lifted = tuple(q + height * moves for q, moves in zip(grounded, self._moves_with_height, strict=True))
        return flat.at[2].set(height), joints_together(self, lifted)

    @one_pose()
    def _home_room(self) -> Scalar:
        """Least distance, at home, from the edge of the home mode and the limits of the strokes."""
        pose, joints = self.home()
        tips = seen_by_legs(self, *self.space.place(pose))

        def room(leg: ScottLeg, q: Joints, tip: Vec):
            return jnp.min(jnp.stack([leg.start(tip)[1], *leg.margins(q, tip)]))

        return jnp.min(jax.vmap(room)(self.legs(), joints_by_leg(self, joints), tips))

    def assemblies(self, joints: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Up to 12 poses, 6 of them upside down: the joints give heights and radii of a planar 3-RPR [TRI 5]."""
        radii, heights = self.legs().end(joints_by_leg(self, joints))
        scale, corners = self.length, self._corners()
        edges = [(corners[i] - corners[j], heights[i] - heights[j]) for i, j in ((0, 1), (1, 2), (2, 0))]
        squares = [edge.dot(edge) - rise**2 for edge, rise in edges]  # [TRI eqs. 11-13]
        side, along = safe_sqrt(squares[0]), (squares[0] + squares[2] - squares[1]) / 2
        x = along / jnp.where(side > 0, side, 1)
        y2 = squares[2] - x**2
        anchors = [Vec(*mast) for mast in self.masts / scale]
        found = []
        for y in (safe_sqrt(y2), -safe_sqrt(y2)):  # the platform's own sense of rotation, and upside down
            shadow = [Vec(0 * x, 0 * x), Vec(side, 0 * x) * (1 / scale), Vec(x, y) * (1 / scale)]
            poses, valid = held_triangles(anchors, shadow, _LENGTHS, [*(radii / scale)])
            lift = jax.vmap(lambda pose, shadow=shadow: self._lifted(pose, shadow, heights))
            found.append((lift(poses), valid & (side > 0) & (y2 >= 0)))
        return tuple(jnp.concatenate(parts) for parts in zip(*found, strict=True))  # type: ignore[return-value]

    def _lifted(self, planar: jax.Array, shadow: list[Vec], heights: jax.Array) -> jax.Array:
        """Spatial pose of a planar one, with the platform's joints at their heights."""
        cos, sin = jnp.cos(planar[2]), jnp.sin(planar[2])
        turn = Rotation(Vec(cos, sin), Vec(-sin, cos))
        flat = [(Vec(planar[0], planar[1]) + turn @ corner) * self.length for corner in shadow]
        points = [Vec(p.x, p.y, height) for p, height in zip(flat, heights, strict=True)]
        return jnp.stack(self.space.coordinates(*fit_triangle(self._corners(), points)))

    def _corners(self) -> list[Vec]:
        return [Vec(x, y, jnp.zeros_like(x)) for x, y in self.platform]

    def _radii(self) -> tuple[jax.Array, jax.Array]:
        """Least and greatest distance of the platform's joints from the masts."""
        linkage = self.linkage
        ratio = linkage.pin / linkage.link
        longest = jnp.minimum(linkage.link, linkage.crank / ratio)
        low, high = self._spreads()
        nearest = jnp.where(jnp.isfinite(high), linkage.end(jnp.where(jnp.isfinite(high), high, 1))[0], 0)
        farthest = jnp.where(low > 0, linkage.end(jnp.where(low > 0, low, 1))[0], longest)
        return nearest, jnp.minimum(farthest, longest)

    def _spreads(self) -> tuple[Scalar, Scalar]:
        return self.stroke[1, 0], self.stroke[1, 1]

    def _level(self, grounded: Joints) -> Scalar:
        """Height in the middle of what the strokes leave, or a length of the robot from the only end, or from zero."""
        low, high = -jnp.inf, jnp.inf
        for values, limits, moves in zip(grounded, self.stroke, self._moves_with_height, strict=True):
            if moves:
                low = jnp.maximum(low, limits[0] - jnp.min(values))
                high = jnp.minimum(high, limits[1] - jnp.max(values))
        ends = [jnp.where(jnp.isfinite(end), end, 0) for end in (low, high)]
        open_below = jnp.where(jnp.isfinite(high), ends[1] - self.length, self.length)
        open_above = jnp.where(jnp.isfinite(high), sum(ends) / 2, ends[0] + self.length)
        return jnp.where(jnp.isfinite(low), open_above, open_below)


@pytree
class Micabo(TriScott):
    """Tri-Scott's legs with every actuator on the base: rho4..rho6 are the heights of the upper sliders [TRI 3].

    Lifting the platform takes all six actuators; the fields are those of ``TriScott``.

    Example:
      >>> robot = Micabo.prototype()
      >>> robot.home()[1].shape
      (6,)
    """

    _leg = MicaboLeg
    _moves_with_height = (1, 1)

    @classmethod
    def _strokes(cls):
        return ((0.0, 1.5), (0.1, 2.25))

    def _spreads(self) -> tuple[Scalar, Scalar]:
        return jnp.zeros_like(self.stroke[1, 0]), jnp.full_like(self.stroke[1, 1], jnp.inf)


def _regular(side: float) -> list[list[float]]:
    radius = side / math.sqrt(3)
    return [[radius * math.cos(a), radius * math.sin(a)] for a in (0, 2 * math.pi / 3, 4 * math.pi / 3)]


def _check(robot: TriScott) -> None:
    """Raise for geometry that describes no robot; every message says what was got and what to do."""
    check_triangle("masts", robot.masts)
    check_triangle("platform", robot.platform)
    stroke = np.asarray(robot.stroke)
    if not np.all(stroke[:, 0] < stroke[:, 1]):
        raise ValueError(f"Got stroke = {stroke.tolist()}; expected least < greatest in both rows.")
    pose, joints = robot.home()
    if not float(robot._home_room()) >= -1e-6:
        raise ValueError(
            f"No level pose over the middle of the masts: the best, {pose.tolist()}, needs rho1..rho6 = "
            f"{joints.tolist()}. Lengthen links that are shorter than the distance they must bridge, or widen the "
            "stroke."
        )
