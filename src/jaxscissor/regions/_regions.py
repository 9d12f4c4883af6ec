"""Sets of poses, and samples of them that are computed on demand and never stored whole."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.pytree import as_arrays, float_dtype, is_concrete, pytree, static
from jaxscissor._engine.types import Number, PyTree


class Region:
    """A set of poses as the image of a unit cube. Subclasses are pytrees.

    A point of the cube may stand for several poses, of which ``require`` says whether all or any must be reached.
    """

    require: ClassVar[Literal["all", "any"]] = "all"

    @property
    def unit_dimension(self) -> int:
        """Number of coordinates of the unit cube."""
        raise NotImplementedError

    def from_unit(self, unit: PyTree) -> jax.Array:
        """Pose ``(d,)``, or poses ``(m, d)``, of a point ``(unit_dimension,)`` of the unit cube."""
        raise NotImplementedError

    @property
    def volume(self) -> jax.Array:
        """Product of the extents that are not zero, in units of the pose coordinates: lengths and radians.

        Times ``workspace.ray_fraction``, or any other fraction, it is the volume that a robot reaches.

        Raises:
          ValueError: a region whose measure is not that of the pose coordinates.

        Example:
          >>> print(f"{float(Disc([0.0, 0.0], 2.0, 0.0, 0.0).volume / math.pi):.6f}")  # an area: the angle is fixed
          4.000000
        """
        raise ValueError(f"Got the volume of a {type(self).__name__}, which has none.")

    def grid(self, shape: Sequence[int]) -> Sample:
        """Centres of equal cells, ``shape`` many along each axis of the unit cube, the last one fastest.

        Raises:
          ValueError: ``shape`` does not have one positive entry per axis.
        """
        counts = tuple(int(n) for n in shape)
        if len(counts) != self.unit_dimension or min(counts) < 1:
            raise ValueError(f"Got shape {counts}; expected {self.unit_dimension} positive counts.")
        return Sample(self, jnp.zeros(self.unit_dimension, jnp.uint32), counts, math.prod(counts))

    def quasi_random(self, n: int, seed: int = 0) -> Sample:
        """``n`` points of an additive recurrence, which fills the region evenly; ``seed`` shifts it.

        Raises:
          ValueError: ``n`` is not between 1 and 2^31 - 1.
        """
        if not 1 <= n < 2**31:
            raise ValueError(f"Got n = {n}; expected 1 to 2^31 - 1 points.")
        shift = np.random.default_rng(seed).integers(0, 2**32, self.unit_dimension, dtype=np.uint32)
        return Sample(self, jnp.asarray(shift), (), int(n))


def pose_shape(region: Region) -> tuple[int, ...]:
    """Shape of what ``from_unit`` returns."""
    unit = jax.ShapeDtypeStruct((region.unit_dimension,), float_dtype(region))
    return jax.eval_shape(region.from_unit, unit).shape


@pytree
class Sample:
    """Poses of a region, computed on demand: ``len``, slices ``(m, d)``, ``jnp.asarray(sample)``.

    Example:
      >>> sample = Cylinder(0.5, 1.0).quasi_random(1000)
      >>> len(sample), sample[:10].shape
      (1000, (10, 6))
    """

    region: Any
    shift: jax.Array
    counts: tuple[int, ...] = static()
    size: int = static()

    def __len__(self) -> int:
        return self.size

    def pose(self, index: Number) -> jax.Array:
        """Pose ``(d,)`` number ``index``, which may be traced."""
        return self.region.from_unit(self.unit(index))

    def unit(self, index: Number) -> jax.Array:
        """The point of the unit cube of which pose number ``index`` is the image."""
        index = jnp.asarray(index, jnp.uint32)
        if self.counts:
            cells = jnp.unravel_index(index.astype(jnp.int32), self.counts)
            dtype = float_dtype(self.region)
            unit = [(cell.astype(dtype) + 0.5) / count for cell, count in zip(cells, self.counts, strict=True)]
        else:
            unit = self._recurrence(index)
        return jnp.stack(unit) if unit else jnp.zeros(0, float_dtype(self.region))

    def poses(self, indices: jax.Array) -> jax.Array:
        """Poses ``(m, d)`` with these numbers."""
        return fence(jax.vmap(self.pose)(indices))  # whatever takes coordinates would evaluate the digits anew

    def __getitem__(self, key: slice) -> jax.Array:
        if not isinstance(key, slice):
            raise TypeError(f"Got index {key!r}; a sample takes slices, or use sample.pose(index).")
        return self.poses(jnp.arange(*key.indices(self.size)))

    def __jax_array__(self) -> jax.Array:
        return self[:]

    def __array__(self, dtype: np.typing.DTypeLike | None = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self[:], dtype)

    def _recurrence(self, index: jax.Array) -> list[jax.Array]:
        """Fractions of 32 bits: integer multiples wrap around exactly, whatever the float precision."""
        dtype = float_dtype(self.region)
        steps = _recurrence_steps(self.region.unit_dimension)
        words = [index * jnp.uint32(step) + shift for step, shift in zip(steps, self.shift, strict=True)]
        # the upper 24 bits are exact in every float type, half a unit keeps clear of 0 and 1
        return [(w >> 8).astype(dtype) * 2.0**-24 + (w & 255).astype(dtype) * 2.0**-32 for w in words]


def _recurrence_steps(dimension: int) -> list[int]:
    """Powers of 1/x with x^(d+1) = x + 1, which generalises the golden ratio (Roberts 2018), times 2^32."""
    x = 1.5
    for _ in range(60):
        x = (1 + x) ** (1 / (dimension + 1))
    return [round(2**32 * (x ** -(j + 1) % 1)) % 2**32 for j in range(dimension)]


@pytree
class Cylinder(Region):
    """Positions in an upright cylinder on the base plane, with one orientation or a range of them.

    Args:
      radius: of the cylinder, positive.
      height: of the cylinder, positive.
      orientation: ``(3,)`` roll, pitch, yaw in radians, or a pair of those, low and high.
      measure: ``"paper"`` is uniform in radius, angle and height, as [RAL17 IV-A], so that points crowd
        at the axis; ``"volume"`` is uniform in space.

    Raises:
      ValueError: a size that is not positive, an unknown measure, a wrong shape.

    Example:
      >>> Cylinder(0.5, 1.0, orientation=([-0.1] * 3, [0.1] * 3)).unit_dimension
      6
    """

    radius: Any
    height: Any
    orientation: Any = (0.0, 0.0, 0.0)
    measure: Literal["paper", "volume"] = static(default="paper")

    def __post_init__(self):
        radius, height, orientation = as_arrays(self.radius, self.height, self.orientation)
        if orientation.shape not in ((3,), (2, 3)):
            raise ValueError(f"Got orientation of shape {orientation.shape}; expected (3,) or (low, high) = (2, 3).")
        if self.measure not in ("paper", "volume"):
            raise ValueError(f"Got measure={self.measure!r}; expected 'paper' or 'volume'.")
        if is_concrete((radius, height)) and not (float(radius) > 0 and float(height) > 0):
            raise ValueError(f"Got radius {radius} and height {height}; expected positive lengths.")
        for name, value in (("radius", radius), ("height", height), ("orientation", orientation)):
            object.__setattr__(self, name, value)

    @property
    def unit_dimension(self) -> int:
        """3 for one orientation, 6 for a range."""
        return 3 if self.orientation.ndim == 1 else 6

    @property
    def volume(self) -> jax.Array:
        """Of the cylinder, times the ranges of orientation, in radians, that are not zero."""
        if self.measure != "volume":
            raise ValueError(
                "Got the volume of a cylinder with measure='paper', which is not that of its volume: a fraction times "
                "this is no volume. Pass measure='volume'."
            )
        turns = _extent(*self.orientation) if self.orientation.ndim == 2 else 1
        return math.pi * self.radius**2 * self.height * turns

    def from_unit(self, unit: jax.Array) -> jax.Array:
        """Pose (x, y, z, roll, pitch, yaw) of a point (radius, angle, height, ...) of the unit cube."""
        radius = self.radius * (unit[0] if self.measure == "paper" else jnp.sqrt(unit[0]))
        angle = 2 * math.pi * unit[1]
        position = jnp.stack([radius * jnp.cos(angle), radius * jnp.sin(angle), self.height * unit[2]])
        if self.orientation.ndim == 1:
            return jnp.concatenate([position, self.orientation])
        low, high = self.orientation
        return jnp.concatenate([position, low + (high - low) * unit[3:]])


@pytree
class Box(Region):
    """All poses between two, coordinate by coordinate, for any robot.

    Args:
      low, high: ``(d,)`` poses, low <= high.

    Raises:
      ValueError: different shapes, or low above high.

    Example:
      >>> Box([-0.1, -0.1, 0.5], [0.1, 0.1, 0.9]).grid((2, 2, 1))[:].shape
      (4, 3)
    """

    low: Any
    high: Any

    def __post_init__(self):
        low, high = as_arrays(self.low, self.high)
        if low.ndim != 1 or low.shape != high.shape:
            raise ValueError(f"Got low {low.shape} and high {high.shape}; expected two poses of one shape (d,).")
        if is_concrete((low, high)) and not np.all(np.asarray(low) <= np.asarray(high)):
            raise ValueError(f"Got low {low} above high {high}; exchange the entries where it is.")
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)

    @property
    def unit_dimension(self) -> int:
        """The dimension of the poses."""
        return self.low.shape[0]

    @property
    def volume(self) -> jax.Array:
        """Product of the extents that are not zero."""
        return _extent(self.low, self.high)

    def from_unit(self, unit: jax.Array) -> jax.Array:
        """Pose between low and high."""
        return self.low + (self.high - self.low) * unit


@pytree
class Disc(Region):
    """Planar poses (x, y, alpha): positions in a disc, uniform in area, angles in a range.

    Args:
      center: ``(2,)``.
      radius: of the disc, positive.
      low_angle, high_angle: range of alpha, radians.

    Raises:
      ValueError: wrong shape, a radius that is not positive, angles out of order.

    Example:
      >>> Disc([0.0, 0.0], 25.0, -1.5, 1.5).quasi_random(4)[:].shape
      (4, 3)
    """

    center: Any
    radius: Any
    low_angle: Any
    high_angle: Any

    def __post_init__(self):
        center, radius, low, high = as_arrays(self.center, self.radius, self.low_angle, self.high_angle)
        if center.shape != (2,):
            raise ValueError(f"Got center of shape {center.shape}; expected (2,).")
        if is_concrete((radius, low, high)) and not (float(radius) > 0 and float(low) <= float(high)):
            raise ValueError(f"Got radius {radius} and angles {low} to {high}; expected radius > 0 and low <= high.")
        for name, value in (("center", center), ("radius", radius), ("low_angle", low), ("high_angle", high)):
            object.__setattr__(self, name, value)

    @property
    def unit_dimension(self) -> int:
        """Radius, direction, angle."""
        return 3

    @property
    def volume(self) -> jax.Array:
        """Area of the disc, times the range of the angle, in radians, if that is not zero."""
        return math.pi * self.radius**2 * _extent(self.low_angle, self.high_angle)

    def from_unit(self, unit: jax.Array) -> jax.Array:
        """Pose (x, y, alpha) of a point (radius, direction, angle) of the unit cube."""
        radius, angle = self.radius * jnp.sqrt(unit[0]), 2 * math.pi * unit[1]
        offset = jnp.stack([radius * jnp.cos(angle), radius * jnp.sin(angle)])
        alpha = self.low_angle + (self.high_angle - self.low_angle) * unit[2]
        return jnp.concatenate([self.center + offset, alpha[None]])


def _extent(low: jax.Array, high: jax.Array) -> jax.Array:
    """Product of the differences that are not zero."""
    return jnp.prod(jnp.where(high == low, 1, high - low))
