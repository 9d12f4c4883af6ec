"""The component vector: points, directions and rotations as pytrees of scalars.

Under ``vmap`` every component is one contiguous array, which is several times faster than arrays with a
trailing axis of length three; unbatched code stays in vector notation.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp

from jaxscissor._engine.types import PyTree


@jax.tree_util.register_pytree_node_class
class Vec:
    """A point or direction with two or three scalar components, in any unit of length.

    Example:
      >>> a, b = Vec(1.0, 2.0, 0.0), Vec(0.0, 1.0, 0.0)
      >>> (a - 2.0 * b).dot(a)
      1.0
    """

    __array_ufunc__ = None  # so that numpy scalars hand multiplication over to __rmul__
    __slots__ = ("components",)

    def __init__(self, *components: Any):
        self.components = components

    @property
    def x(self) -> Any:
        """First component."""
        return self.components[0]

    @property
    def y(self) -> Any:
        """Second component."""
        return self.components[1]

    @property
    def z(self) -> Any:
        """Third component, of spatial vectors."""
        return self.components[2]

    def __add__(self, other: Vec) -> Vec:
        return Vec(*(a + b for a, b in _pairs(self, other)))

    def __sub__(self, other: Vec) -> Vec:
        return Vec(*(a - b for a, b in _pairs(self, other)))

    def __mul__(self, scale: PyTree) -> Vec:
        return Vec(*(a * scale for a in self.components))

    __rmul__ = __mul__

    def __neg__(self) -> Vec:
        return Vec(*(-a for a in self.components))

    def dot(self, other: Vec) -> Any:
        """Scalar product."""
        products = [a * b for a, b in _pairs(self, other)]
        return sum(products[1:], products[0])

    def cross(self, other: Vec) -> Vec:
        """Vector product of two spatial vectors."""
        (a, b, c), (d, e, f) = self.components, other.components
        return Vec(b * f - c * e, c * d - a * f, a * e - b * d)

    def array(self) -> jax.Array:
        """The components as an array, on a new last axis."""
        return jnp.stack(jnp.broadcast_arrays(*self.components), axis=-1)

    def __repr__(self) -> str:
        return f"Vec{self.components}"

    def tree_flatten(self):
        """Children of the pytree."""
        return self.components, None

    @classmethod
    def tree_unflatten(cls, aux: None, components: Sequence[Any]) -> Vec:
        """Rebuild from children."""
        return cls(*components)


def _pairs(one: Vec, other: Vec) -> Any:
    if len(one.components) != len(other.components):
        raise ValueError(
            f"Got vectors of {len(one.components)} and {len(other.components)} components; expected as many: two in "
            "the plane, three in space."
        )
    return zip(one.components, other.components, strict=True)


@jax.tree_util.register_pytree_node_class
class Rotation:
    """A rotation given by its columns, the platform's axes seen from the base.

    Example:
      >>> quarter = Rotation(Vec(0.0, 1.0), Vec(-1.0, 0.0))
      >>> quarter @ Vec(2.0, 0.0)
      Vec(0.0, 2.0)
    """

    __slots__ = ("columns",)

    def __init__(self, *columns: Vec):
        self.columns = columns

    def __matmul__(self, vector: Vec) -> Vec:
        if len(self.columns) != len(vector.components):
            raise ValueError(
                f"Got a vector of {len(vector.components)} components to turn; the rotation has {len(self.columns)}."
            )
        parts = [c * v for c, v in zip(self.columns, vector.components, strict=True)]
        return functools.reduce(Vec.__add__, parts)

    def array(self) -> jax.Array:
        """The rotation matrix."""
        return jnp.stack([column.array() for column in self.columns], axis=-1)

    def __repr__(self) -> str:
        return f"Rotation{self.columns}"

    def tree_flatten(self):
        """Children of the pytree."""
        return self.columns, None

    @classmethod
    def tree_unflatten(cls, aux: None, columns: Sequence[Vec]) -> Rotation:
        """Rebuild from children."""
        return cls(*columns)
