"""Where joints are: on circles, and where two bars meet."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.numerics import Scalar, safe_sqrt
from jaxscissor._engine.pytree import as_arrays, is_concrete

THIRDS = (0.0, 2 * math.pi / 3, 4 * math.pi / 3)
"""Azimuths of three legs."""


def polar(radius: Scalar, angle: Any, height: Scalar | None = None) -> tuple[Scalar, ...]:
    """A point at an azimuth, with a height in space."""
    flat = radius * jnp.cos(angle), radius * jnp.sin(angle)
    return flat if height is None else (*flat, height)


def meeting(
    one: Sequence[Scalar], first: Scalar, other: Sequence[Scalar], second: Scalar, *, side: int
) -> tuple[Scalar, Scalar]:
    """Where bars from two points of the plane meet, on the left (-1) or right (1) of the way; ``nan`` if nowhere."""
    dx, dy = other[0] - one[0], other[1] - one[1]
    gap2 = dx * dx + dy * dy
    share = (gap2 + first**2 - second**2) / (2 * gap2)
    room = first**2 / gap2 - share**2
    height = side * jnp.where(room >= 0, safe_sqrt(room), jnp.nan)
    return one[0] + share * dx + height * dy, one[1] + share * dy - height * dx


def check_bars(robot: Any, gap: float, *bars: float) -> None:
    """Raise unless two bars of a robot meet over a gap.

    Raises:
      ValueError: naming the lengths.
    """
    first, second = bars
    if not abs(first - second) < gap < first + second:
        raise ValueError(
            f"Got a {type(robot).__name__} whose bars of {first:.4g} and {second:.4g} do not meet at home, with ends "
            f"{gap:.4g} apart. Expected a gap between their difference and their sum."
        )


def check_rod(robot: Any, gap: float, rod: float) -> None:
    """Raise unless a rod reaches over a horizontal gap, and leaves some of its length for the height.

    Raises:
      ValueError: naming both.
    """
    if not gap < rod:
        raise ValueError(
            f"Got a {type(robot).__name__} whose leg of {rod:.4g} does not reach over {gap:.4g} at home. "
            "Expected a longer leg, or joints of base and platform that are closer."
        )


def checked(robot: Any, **shapes: tuple[int, ...]) -> list[Any] | None:
    """Turn all fields of a robot into arrays, and refuse what is no robot; its numbers, where they can be looked at.

    Args:
      robot: its numbers are positive lengths unless a shape is given.
      **shapes: of other fields.

    Raises:
      ValueError: a wrong shape, or a length that is not positive.
    """
    names = [field.name for field in dataclasses.fields(robot) if not field.metadata.get("static")]
    for name, array in zip(names, as_arrays(*(getattr(robot, name) for name in names)), strict=True):
        object.__setattr__(robot, name, array)
        shape = shapes.get(name, ())
        if array.shape != shape:
            raise ValueError(f"Got {name} of shape {array.shape}; expected {shape}.")
        if name not in shapes and is_concrete(array) and not np.asarray(array) > 0:
            raise ValueError(f"Got {name} = {array}; expected a positive number.")
    fields = [getattr(robot, name) for name in names]
    return [np.asarray(field, float) for field in fields] if is_concrete(fields) else None
