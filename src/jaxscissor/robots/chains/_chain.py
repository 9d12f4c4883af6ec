"""A chain of joints from the base to the platform, and the leg that it is."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, Literal

import jax.numpy as jnp

from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.pytree import is_concrete, pytree
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._contract import Attachment, Leg
from jaxscissor.robots._spaces import Space, position_size
from jaxscissor.robots.chains._arc import Arc
from jaxscissor.robots.chains._crank import CrankAndRod
from jaxscissor.robots.chains._joints import Joint, Prismatic, Revolute, Universal, distance, unit
from jaxscissor.robots.chains._serial import SerialLeg
from jaxscissor.robots.chains._slide import SlideAndRod
from jaxscissor.robots.chains._telescope import Telescope

Sees = Literal["point", "axis", "point and axis", "frame"]
_FREE_ENDS = ("US", "SS", "SU")  # of a rod; where both are balls it may spin, which moves nothing


@pytree
class Chain:
    """Joints one after the other, from the base to the platform, where they are when the robot is at home.

    The last joint holds the platform. All joint coordinates are zero at home. What the chain is follows from its kinds
    of joints, ``*`` the actuated one: ``R*US`` is a crank and a rod, ``P*US`` a slide and a rod, ``UP*S`` a telescope,
    each also with balls for universal joints; ``R*RS``, ``P*RS`` and ``RP*S`` the same guided by pins; ``UP*U`` a
    telescope that cannot twist; in the plane there are ``R*RR``, ``P*RR`` and ``RP*R``, and ``R*RR`` on a sphere. These
    are solved in closed form for the actuated joint alone, any other chain by Newton's method from home for all.

    Args:
      joints: ``Revolute``, ``Prismatic``, ``Universal`` and ``Spherical``, in a tuple or list.

    Raises:
      ValueError: something else than joints, or none; a pin that does not guide a rod in the plane of its motor.

    Example:
      >>> import jaxscissor as js
      >>> motor = js.Revolute(axis=(0.0, 1.0, 0.0), point=(0.2, 0.0, 0.0), actuated=True)
      >>> crank = js.Chain([motor, js.Spherical((0.5, 0.0, 0.0)), js.Spherical((0.05, 0.0, 0.8))])
      >>> crank.letters
      'R*SS'
    """

    joints: Sequence[Any]

    def __post_init__(self):
        if not self.joints or not all(isinstance(joint, Joint) for joint in self.joints):
            raise ValueError(
                f"Got the joints {self.joints}; expected Revolute, Prismatic, Universal or Spherical ones."
            )
        object.__setattr__(self, "joints", tuple(self.joints))
        if self.letters in ("R*RS", "P*RS", "RP*S") and self.joints[0].axis is not None and is_concrete(self.joints):
            _check_guide(*sorted(self.joints[:2], key=lambda joint: not joint.actuated))

    @property
    def letters(self) -> str:
        """The kinds of joints, with a star after what is actuated."""
        return "".join(joint.letter + "*" * joint.actuated for joint in self.joints)

    @property
    def end(self) -> Vec:
        """The point where it holds the platform at home."""
        return self.joints[-1].at

    @property
    def reach(self) -> Scalar:
        """Sum of the distances from joint to joint."""
        return sum(distance(a.at, b.at) for a, b in itertools.pairwise(self.joints))

    def sees(self, space: Space) -> Sees:
        """What the chain holds of the platform."""
        planar = position_size(space) == 2
        if not (space.translations or planar):
            return "axis"
        if self.letters == "UP*U":
            return "point and axis"
        free = "R" if planar else "S"
        turns = space.translations < space.dimension
        return "frame" if turns and self.letters[-1] != free and not self._is_rod else "point"

    def seen(self, space: Space, home: tuple[Vec, Rotation], position: Vec, rotation: Rotation) -> Attachment:
        """What the chain sees of the platform at a position and rotation, which at home are ``home``."""
        origin, axes = home

        def carried(direction: Vec) -> Vec:
            return rotation @ Vec(*(axis.dot(direction) for axis in axes.columns))

        kind = self.sees(space)
        if kind == "axis":
            return carried(unit(Vec(*self.joints[-1].axis)))
        point = position + carried(self.end - origin)
        if kind == "point and axis":
            return point, carried(unit(Vec(*self.joints[-1].second)))
        return point if kind == "point" else (point, rotation.columns)

    def leg(self, space: Space, home: tuple[Vec, Rotation], scale: Scalar) -> Leg:
        """The leg, in closed form where the chain has one.

        Raises:
          ValueError: as many joints as cannot follow the platform.
        """
        first, *rest = self.joints
        letters, planar = self.letters, position_size(space) == 2
        if self.sees(space) == "axis" and letters == "R*RR":
            return Arc.between(*self.joints)
        if (letters[:2] == "R*" and self._is_rod) or (planar and letters == "R*RR"):
            return CrankAndRod.between(first, rest[0].at, self.end, guided=False)
        if (letters[:2] == "P*" and self._is_rod) or (planar and letters == "P*RR"):
            return SlideAndRod.between(first, rest[0].at, self.end, axis=None)
        if letters in ("UP*S", "SP*S", "SP*U") or (planar and letters == "RP*R"):
            return Telescope.between(rest[0], first.at, self.end)
        if letters == "RP*S" and not planar:
            return Telescope.guided(rest[0], first, self.end)
        if letters == "UP*U":
            return Telescope.untwisted(rest[0], first, rest[1])
        if letters == "R*RS":
            return CrankAndRod.between(first, rest[0].at, self.end, guided=True)
        if letters == "P*RS":
            return SlideAndRod.between(first, rest[0].at, self.end, axis=Vec(*rest[0].axis))
        return self._serial(space, home, scale)

    @property
    def _is_rod(self) -> bool:
        return len(self.joints) == 3 and self.letters[-2:] in _FREE_ENDS

    def _serial(self, space: Space, home: tuple[Vec, Rotation], scale: Scalar) -> SerialLeg:
        """Pins and slides; the last ball, or pin in the plane, moves nothing of what the leg sees."""
        planar = position_size(space) == 2
        kind = self.sees(space)
        joints = self.joints[:-1] if kind == "point" and self.letters[-1] in "SR" else self.joints
        pins = [pin for joint in joints for pin in _pins(joint)]
        needed = (2 if planar else 3) + {"point": 0, "frame": 1 if planar else 3}.get(kind, 0)
        if len(pins) > needed or not pins or kind not in ("point", "frame"):
            raise ValueError(
                f"Got the chain {self.letters}, whose {len(pins)} joint coordinates face {needed} equations of the "
                f"platform's {kind}; expected at most as many, and one at least. With more, a pose would not say where "
                "the joints are."
            )
        axes = tuple(None if planar and letter == "R" else unit(Vec(*axis)) for letter, axis, *_ in pins)
        leg = SerialLeg(
            axes=axes,
            points=tuple(point for _, _, point, *_ in pins),
            end=self.end,
            frame=home[1] if kind == "frame" else None,
            scale=scale,
            strokes=tuple((limits[0], limits[1]) for *_, limits, _ in pins),
            kinds=tuple(letter for letter, *_ in pins),
            moved=tuple(actuated for *_, actuated in pins),
        )
        return leg.with_guides()


def _pins(joint: Any) -> list[tuple[str, Any, Vec, Any, bool]]:
    """A joint as pins and slides: letter, axis, point, limits, whether actuated.

    Raises:
      ValueError: a ball between other joints.
    """
    endless = (-jnp.inf, jnp.inf)
    if isinstance(joint, Universal):
        return [("R", axis, joint.at, endless, False) for axis in (joint.axis, joint.second)]
    if isinstance(joint, (Revolute, Prismatic)):
        return [(joint.letter, joint.axis, joint.at, joint.limits, joint.actuated)]
    raise ValueError("Got a Spherical joint within a chain that has no closed form; expected it at the end.")


def _check_guide(motor: Revolute | Prismatic, pin: Revolute) -> None:
    """Raise unless the pin lets the rod turn in the plane in which its motor moves it."""
    cosine = float(unit(Vec(*motor.axis)).dot(unit(Vec(*pin.axis))))
    if abs(abs(cosine) - (motor.letter == "R")) > 1e-6:
        expected = "parallel to the motor's" if motor.letter == "R" else "at right angles to the slide"
        raise ValueError(
            f"Got a rod on a pin along {pin.axis}, moved along or about {motor.axis}; expected {expected}."
        )
