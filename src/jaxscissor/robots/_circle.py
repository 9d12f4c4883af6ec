"""Where the point that a leg holds can be while its actuated joints stand still."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from jaxscissor._engine.numerics import Scalar, safe_divide, safe_sqrt
from jaxscissor._engine.vectors import Vec


class Circle(NamedTuple):
    """Points ``center + first cos(angle) + second sin(angle)`` in the base frame, in the robot's unit of length.

    Attributes:
      center: its middle.
      first, second: orthogonal vectors as long as its radius.

    Example:
      >>> import jaxscissor as js
      >>> circle = Circle(js.Vec(0.0, 0.0, 1.0), js.Vec(2.0, 0.0, 0.0), js.Vec(0.0, 2.0, 0.0))
      >>> circle.at(0.0).array().tolist()
      [2.0, 0.0, 1.0]
    """

    center: Vec
    first: Vec
    second: Vec

    def at(self, angle: Scalar) -> Vec:
        """The point at an angle."""
        return self.toward(jnp.cos(angle), jnp.sin(angle))

    def toward(self, cosine: Scalar, sine: Scalar) -> Vec:
        """The point at the angle with this cosine and sine."""
        return self.center + self.first * cosine + self.second * sine

    def nearest(self, point: Vec) -> tuple[Scalar, Scalar]:
        """Cosine and sine of the angle of the nearest point; both zero on the circle's axis."""
        away = point - self.center
        x, y = away.dot(self.first), away.dot(self.second)
        scale = safe_divide(1, safe_sqrt(x * x + y * y))
        return x * scale, y * scale
