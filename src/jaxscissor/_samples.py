"""Poses as the functions of the library take them: stored, or computed on demand."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from jaxscissor._numerics import Scalar
from jaxscissor._pytree import as_floats, pytree
from jaxscissor.feasibility import reached_margin
from jaxscissor.mechanisms._contract import Mechanism
from jaxscissor.regions import Sample, pose_shape


@pytree
class Listed:
    """Poses that are stored, behind the interface of a sample."""

    array: jax.Array

    def __len__(self) -> int:
        return self.array.shape[0]

    def pose(self, index: jax.Array) -> jax.Array:
        """Pose ``(d,)`` number ``index``."""
        return self.array[index]

    def poses(self, indices: jax.Array) -> jax.Array:
        """Poses ``(m, d)`` with these numbers."""
        return self.array[indices]

    def margin(self, robot: Mechanism, pose: jax.Array) -> Scalar:
        """Margin of a robot at a pose."""
        return reached_margin(robot, pose)


def checked_sample(robot: Mechanism, poses: Any) -> tuple[Any, Any]:
    """The robot as floats, and the poses behind the interface of a sample.

    Raises:
      ValueError: poses of the wrong shape, or none.
    """
    sample = poses if isinstance(poses, Sample) else Listed(jnp.asarray(poses))
    shape = sample.array.shape if isinstance(sample, Listed) else (len(sample), *pose_shape(sample.region))
    malformed = isinstance(sample, Listed) and len(shape) != 2
    if malformed or shape[-1] != robot.space.dimension:
        raise ValueError(
            f"Got poses of shape {shape}; {type(robot).__name__} expects (n, {robot.space.dimension}) = n times "
            f"({', '.join(robot.space.names)})."
        )
    if not len(sample):
        raise ValueError("Got no poses; nothing is defined over an empty sample.")
    return as_floats(robot)[0], sample
