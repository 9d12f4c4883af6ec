"""Poses of which only some coordinates are free: lines, planes, turns about a point, a plane with its height."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._spaces import SE2, SE3


@dataclasses.dataclass(frozen=True)
class Subspace:
    """Poses of a space of which some coordinates are free and the others are zero.

    A coordinate that the legs hold whatever their joints is no freedom; were it one of the pose, every measure would
    see motions that do not exist. Where the coordinates that are not free change with the others (parasitic motion),
    give the robot ``constraints`` and name them ``dependent`` instead.

    Args:
      space: ``SE3`` or ``SE2``.
      free: names of its coordinates that are free: any translations, and none, one or all of its angles.

    Raises:
      ValueError: a name that the space has not, or two of three angles, which make no group of motions.

    Example:
      A platform that rises and turns about the vertical:

      >>> lift = Subspace(SE3, free=("z", "yaw"))
      >>> position, rotation = lift.place(jnp.array([0.5, 0.0]))
      >>> [float(x) for x in position.components], lift.dimension, lift.translations
      ([0.0, 0.0, 0.5], 2, 1)
    """

    space: type[SE3] | type[SE2]
    free: tuple[str, ...]

    def __post_init__(self):
        names = self.space.names
        angles = set(names[self.space.translations :])
        if not self.free or isinstance(self.free, str) or not set(self.free) <= set(names):
            raise ValueError(f"Got free = {self.free!r}; expected a tuple with some of {names}.")
        if len(angles & set(self.free)) not in (0, 1, len(angles)):
            raise ValueError(
                f"Got free = {self.free}: two angles without the third make no group of motions. Free all three, and "
                "bind one by constraints(position, rotation) of the robot."
            )
        object.__setattr__(self, "free", tuple(name for name in names if name in self.free))

    @property
    def names(self) -> tuple[str, ...]:
        """The free coordinates, in the order of the space."""
        return self.free

    @property
    def dimension(self) -> int:
        """Number of free coordinates."""
        return len(self.free)

    @property
    def translations(self) -> int:
        """Number of free translations."""
        return sum(place < self.space.translations for place in self._places)

    @property
    def _places(self) -> list[int]:
        return [self.space.names.index(name) for name in self.free]

    @property
    def _turns(self) -> bool:
        return self.translations < self.dimension

    def place(self, pose: jax.Array) -> tuple[Vec, Rotation]:
        """Position and rotation of a pose, in the space."""
        if self._turns:
            return self.space.place(jnp.stack(self._embedded(list(pose), jnp.zeros_like(pose[0]))))
        size = self.space.translations
        rotation = Rotation(*(Vec(*map(float, column)) for column in np.eye(size)))
        return Vec(*self._embedded(list(pose), jnp.zeros_like(pose[0]))[:size]), rotation

    def coordinates(self, position: Vec, rotation: Rotation) -> tuple[Scalar, ...]:
        """The free coordinates of a position and rotation."""
        every = (*position.components, *self._angles(position, rotation)) if self._turns else position.components
        return tuple(every[place] for place in self._places)

    def retract(self, position: Vec, rotation: Rotation, twist: Sequence[Scalar]) -> tuple[Vec, Rotation]:
        """Step along a twist, given by its free components."""
        whole = self._embedded(twist, 0.0)
        if self._turns:
            return self.space.retract(position, rotation, whole)
        return position + Vec(*whole[: self.space.translations]), rotation

    def nudge(self, position: Vec, rotation: Rotation, twist: Sequence[Scalar]) -> tuple[Vec, Rotation]:
        """``retract`` to first order, with the same derivative at rest and far fewer operations."""
        whole = self._embedded(twist, 0.0)
        if self._turns:
            return self.space.nudge(position, rotation, whole)
        return position + Vec(*whole[: self.space.translations]), rotation

    def between(self, start: tuple[Vec, Rotation], end: tuple[Vec, Rotation]) -> jax.Array:
        """The twist along which ``retract`` carries one position and rotation to another."""
        if self._turns:
            return self.space.between(start, end)[jnp.array(self._places)]
        shift = (end[0] - start[0]).components
        return jnp.stack([shift[place] for place in self._places])

    def rates_to_twist(self, pose: jax.Array) -> jax.Array:
        """Matrix from the rates of the free coordinates to the free components of the twist."""
        whole = self.space.rates_to_twist(jnp.stack(self._embedded(list(pose), jnp.zeros_like(pose[0]))))
        places = jnp.array(self._places)
        return whole[places][:, places]

    def _angles(self, position: Vec, rotation: Rotation) -> Sequence[Scalar]:
        """The angles of the space; one alone goes all the way around, which as one of three it would not."""
        size = self.space.translations
        if size < 3 or self.dimension - self.translations == 3:
            return self.space.coordinates(position, rotation)[size:]
        columns = [column.components for column in rotation.columns]
        return [jnp.arctan2(columns[(k + 1) % 3][(k + 2) % 3], columns[(k + 1) % 3][(k + 1) % 3]) for k in range(3)]

    def _embedded(self, values: Sequence[Scalar], zero: Scalar) -> list[Scalar]:
        """The values at the places of the free coordinates, zeros elsewhere."""
        given = dict(zip(self.free, values, strict=True))
        return [given.get(name, zero) for name in self.space.names]

    def __repr__(self) -> str:
        return f"Subspace({self.space.__name__}, free={self.free})"


R3 = Subspace(SE3, ("x", "y", "z"))
"""Positions (x, y, z) of a platform that does not turn."""
R2 = Subspace(SE2, ("x", "y"))
"""Positions (x, y) in the plane of a platform that does not turn."""
R1 = Subspace(SE3, ("z",))
"""Heights z of a platform that only rises."""
SO3 = Subspace(SE3, ("roll", "pitch", "yaw"))
"""Orientations (roll, pitch, yaw) of a platform that turns about a point, the origin."""
Schoenflies = Subspace(SE3, ("x", "y", "z", "yaw"))
"""Positions and turns about the vertical (x, y, z, yaw), the motions of Schoenflies, as of pick-and-place robots."""
