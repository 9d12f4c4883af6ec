"""Joints of a chain, where they are when the robot is at home."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import jax.numpy as jnp

from jaxscissor._engine.numerics import Scalar, safe_sqrt
from jaxscissor._engine.pytree import as_arrays, is_concrete, pytree, quantity, static
from jaxscissor._engine.vectors import Vec
from jaxscissor.robots._bodies import Freedom

_NO_LIMITS = (-math.inf, math.inf)


class Joint:
    """What all joints have: a letter for the kind, a point, and whether a motor moves it."""

    letter: ClassVar[str]
    point: Any
    actuated: bool
    limits: Any

    def __post_init__(self):
        names = [name for name in ("axis", "second", "point", "limits") if getattr(self, name, None) is not None]
        for name, array in zip(names, as_arrays(*(getattr(self, name) for name in names)), strict=True):
            object.__setattr__(self, name, array)
            shapes = ((2,),) if name == "limits" else ((2,), (3,))
            if array.shape not in shapes:
                raise ValueError(f"Got a {type(self).__name__} with {name} of shape {array.shape}; expected {shapes}.")
            if name in ("axis", "second") and is_concrete(array) and not jnp.any(array != 0):
                raise ValueError(f"Got a {type(self).__name__} whose {name} is zero; expected a direction.")

    @property
    def at(self) -> Vec:
        """The point as a vector."""
        return Vec(*self.point)


@pytree
class Revolute(Joint):
    """A pin that turns about an axis.

    Args:
      axis: ``(3,)`` that it turns about, of any length, in the base frame; ``None`` in the plane.
      point: ``(3,)`` on the axis, in the plane ``(2,)``.
      actuated: whether a motor turns it.
      limits: ``(2,)`` least and greatest angle from home.

    Raises:
      ValueError: wrong shapes, or an axis that is zero.
    """

    axis: Any
    point: Any = quantity("m")
    actuated: bool = static(default=False)
    limits: Any = quantity("rad", default=_NO_LIMITS)

    letter = "R"


@pytree
class Prismatic(Joint):
    """A slide along an axis.

    Args:
      axis: ``(3,)`` along which it moves, of any length, in the plane ``(2,)``; in the base frame.
      point: ``(3,)`` of what slides, in the plane ``(2,)``.
      actuated: whether an actuator moves it.
      limits: ``(2,)`` least and greatest displacement from home.

    Raises:
      ValueError: wrong shapes, or an axis that is zero.
    """

    axis: Any
    point: Any = quantity("m")
    actuated: bool = static(default=False)
    limits: Any = quantity("m", default=_NO_LIMITS)

    letter = "P"


@pytree
class Universal(Joint):
    """A universal joint, which turns about two axes through a point.

    Args:
      axis, second: ``(3,)`` the axes, that of what comes before it in the chain first; in the base frame.
      point: ``(3,)`` where they meet.

    Raises:
      ValueError: wrong shapes, or an axis that is zero.
    """

    axis: Any
    second: Any
    point: Any = quantity("m")

    letter, actuated, limits = "U", False, None


@pytree
class Spherical(Joint):
    """A ball joint that turns about a point.

    Args:
      point: ``(3,)`` its middle, in the base frame.

    Raises:
      ValueError: wrong shape.
    """

    point: Any = quantity("m")

    letter, actuated, limits = "S", False, None


def unit(vector: Vec) -> Vec:
    """The direction of a vector."""
    return vector * (1 / safe_sqrt(vector.dot(vector)))


def universal(axis: Vec, along: Vec) -> tuple[Freedom, Freedom]:
    """The freedoms of a universal joint at the end of a rod: turns about an axis and across it and the rod."""
    return Freedom("turn", axis), Freedom("turn", unit(along.cross(axis)))


def around(angle: Scalar) -> Scalar:
    """The angle within half a turn of zero."""
    return jnp.arctan2(jnp.sin(angle), jnp.cos(angle))


def swing(a: Scalar, b: Scalar, c: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Both angles x with a cos x + b sin x = c: their middle, half their distance, a^2 + b^2 - c^2, >= 0 if real."""
    room = a * a + b * b - c * c
    return jnp.arctan2(b, a), jnp.arctan2(safe_sqrt(room), c), room


def distance(one: Vec, other: Vec) -> Scalar:
    """Of two points."""
    gap = one - other
    return safe_sqrt(gap.dot(gap))
