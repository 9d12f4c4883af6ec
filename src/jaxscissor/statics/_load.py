"""What a robot carries besides a wrench: the masses of platform and payload, and gravity."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.pytree import as_arrays, is_concrete, pytree, quantity
from jaxscissor._engine.vectors import Rotation, Vec

_ORIGIN, _DOWN = (0.0, 0.0, 0.0), (0.0, 0.0, -9.81)


@pytree
class Load:
    """Masses on the platform, and gravity, in any consistent units.

    Args:
      payload: mass that the platform carries, such as the paper's 11.34 kg [ICRA16 V].
      payload_center: ``(3,)`` its center, in the platform frame; of planar robots with a height of zero.
      platform_mass: of the platform itself.
      platform_center: ``(3,)`` its center, in the platform frame.
      gravity: ``(3,)`` acceleration, in the base frame; a planar robot feels its first two entries.

    Raises:
      ValueError: a wrong shape, or a negative mass.

    Example:
      >>> float(Load(payload=11.34).platform_mass)
      0.0
    """

    payload: Any = quantity("kg", default=0.0)
    payload_center: Any = quantity("m", default=_ORIGIN)
    platform_mass: Any = quantity("kg", default=0.0)
    platform_center: Any = quantity("m", default=_ORIGIN)
    gravity: Any = quantity("m/s^2", default=_DOWN)

    def __post_init__(self):
        names = ("payload", "payload_center", "platform_mass", "platform_center", "gravity")
        arrays = as_arrays(*(getattr(self, name) for name in names))
        for name, array in zip(names, arrays, strict=True):
            object.__setattr__(self, name, array)
            shape = () if name in ("payload", "platform_mass") else (3,)
            if array.shape != shape:
                raise ValueError(f"Got {name} of shape {array.shape}; expected {shape}.")
            if not shape and is_concrete(array) and not np.asarray(array) >= 0:
                raise ValueError(f"Got {name} = {array}; expected a mass >= 0.")

    def potential(self, position: Vec, rotation: Rotation) -> Scalar:
        """Potential energy of platform and payload, zero at the origin."""
        payload = self.payload_potential(position, rotation) * self.payload
        return payload + _potential(self.gravity, position, rotation, self.platform_center) * self.platform_mass

    def payload_potential(self, position: Vec, rotation: Rotation) -> Scalar:
        """The same of a payload of mass one alone."""
        return _potential(self.gravity, position, rotation, self.payload_center)


def _potential(gravity: jax.Array, position: Vec, rotation: Rotation, center: jax.Array) -> Scalar:
    size = len(position.components)  # in the plane a center has two coordinates
    return -Vec(*gravity[:size]).dot(position + rotation @ Vec(*center[:size]))
