"""Regions as tasks state them: positions with a set of orientations, and a path through given poses."""

from __future__ import annotations

from typing import Any, Literal

import jax
import jax.numpy as jnp

from jaxscissor._engine.pytree import as_arrays, float_dtype, pytree, static
from jaxscissor.regions._regions import Region, pose_shape


@pytree
class Dexterous(Region):
    """Positions of a region, to be reached with all, or with any, of a set of orientations.

    With all it is the dexterous (total-orientation) workspace, with any the reachable workspace; the
    constant-orientation workspace needs no set. The fractions of it, hard, soft and exact, count a position
    where the least (all) or the greatest (any) margin of the set is >= 0. It is differentiable like its region,
    by the orientations too; where two orientations decide together, the derivative is that of one of them.

    Args:
      region: of poses; its own orientations are replaced.
      orientations: ``(m, k)`` orientation coordinates: three angles in space, one in the plane, in radians.
      require: ``"all"`` or ``"any"`` of them.

    Raises:
      ValueError: wrong shape of the orientations, more of their coordinates than of a pose, an unknown requirement.

    Example:
      The prototype loses a seventh of the level workspace if it must also tilt by 30 degrees either way:

      >>> import jaxscissor as js, numpy as np
      >>> robot = js.TripleScissorExtender.prototype()
      >>> level = js.Cylinder(robot.length / 2, robot.length)
      >>> tilted = js.workspace.Dexterous(level, np.deg2rad([[0, 0, 0], [0, 30, 0], [0, -30, 0]]))
      >>> for region in (level, tilted):
      ...     print(f"{float(js.workspace.fraction(robot, region.quasi_random(20_000))):.2f}")
      0.29
      0.25
    """

    region: Any
    orientations: Any
    require: Literal["all", "any"] = static(default="all")  # pyright: ignore[reportIncompatibleVariableOverride]

    def __post_init__(self):
        dtype = float_dtype(self.region)
        orientations = jnp.asarray(self.orientations, dtype)
        (size,) = pose_shape(self.region)
        if orientations.ndim != 2 or not orientations.shape[0] or not 0 < orientations.shape[1] < size:
            raise ValueError(
                f"Got orientations {orientations.shape}; expected (m, k), at least one of them, each of the k < {size} "
                "orientation coordinates of a pose."
            )
        if self.require not in ("all", "any"):
            raise ValueError(f"Got require={self.require!r}; expected 'all' or 'any'.")
        object.__setattr__(self, "orientations", orientations)

    @property
    def unit_dimension(self) -> int:
        """That of the region."""
        return self.region.unit_dimension

    @property
    def volume(self) -> jax.Array:
        """That of the region."""
        return self.region.volume

    def from_unit(self, unit: jax.Array) -> jax.Array:
        """The poses ``(m, d)`` of one position, one for each orientation."""
        pose = self.region.from_unit(unit)
        position = pose[: pose.shape[0] - self.orientations.shape[1]]
        return jax.vmap(lambda turn: jnp.concatenate([position, turn]))(self.orientations)


@pytree
class PosePath(Region):
    """A trajectory through given poses, straight in the pose coordinates, as long between any two of them.

    Its fraction is the part of the path that a robot reaches: exact, with derivative, by
    ``workspace.ray_fraction`` (give it a cell or more between neighbours: ``cells``), counted by
    ``workspace.fraction``.

    Args:
      poses: ``(m, d)``, two or more; differentiable.

    Raises:
      ValueError: wrong shape.

    Example:
      The prototype rises from the ground; its stops leave it three quarters of the way:

      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> ground = jnp.zeros(6)
      >>> rise = js.workspace.PosePath([ground, ground.at[2].set(robot.length)])
      >>> round(float(js.workspace.ray_fraction(robot, rise)), 2)
      0.76
    """

    poses: Any

    def __post_init__(self):
        rows = as_arrays(*self.poses)
        poses = jnp.stack(rows) if rows and len({row.shape for row in rows}) == 1 else None
        if poses is None or poses.ndim != 2 or len(poses) < 2:
            shapes = [row.shape for row in rows]
            raise ValueError(f"Got poses {shapes}; expected two or more, all of one shape (d,).")
        object.__setattr__(self, "poses", poses)

    @property
    def unit_dimension(self) -> int:
        """1: along the path."""
        return 1

    def from_unit(self, unit: jax.Array) -> jax.Array:
        """Pose ``(d,)`` on the path."""
        legs = self.poses.shape[0] - 1
        place = unit[0] * legs
        leg = jnp.clip(place.astype(jnp.int32), 0, legs - 1)
        first, last = self.poses[leg], self.poses[leg + 1]
        return first + (place - leg.astype(place.dtype)) * (last - first)
