"""Poses as the functions of the library take them: stored, or computed on demand."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from jaxscissor._numerics import Scalar
from jaxscissor._pytree import as_floats, pytree, static
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


@pytree
class _EachPose:
    """The poses of a sample of sets of poses, one by one."""

    sample: Sample
    together: int = static()

    def __len__(self) -> int:
        return len(self.sample) * self.together

    def pose(self, index: Any) -> jax.Array:
        index = jnp.asarray(index, jnp.uint32)
        return self.sample.pose(index // self.together)[index % self.together]

    def poses(self, indices: jax.Array) -> jax.Array:
        return jax.vmap(self.pose)(indices)


def each_pose(sample: Any) -> Any:
    """The sample, or that of all poses of its sets if its region gives sets of poses."""
    shape = pose_shape(sample.region) if isinstance(sample, Sample) else ()
    if len(shape) < 2:
        return sample
    if len(sample) * shape[0] >= 2**31:
        raise ValueError(f"Got {len(sample)} times {shape[0]} poses; expected less than 2^31.")
    return _EachPose(sample, shape[0])


def checked_sample(robot: Mechanism, poses: Any) -> tuple[Any, Any]:
    """The robot as floats, and the poses behind the interface of a sample.

    Raises:
      ValueError: poses of the wrong shape, or none.
    """
    sample: Any = poses
    if not isinstance(poses, Sample):
        robot, array = as_floats(robot, jnp.asarray(poses))
        sample = Listed(array)
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


def without_size(sample: Any) -> Any:
    """The sample with its length taken out of the structure, so that another length does not recompile."""
    if isinstance(sample, Sample) and not sample.counts:
        return Sample(sample.region, sample.shift, (), 0)
    return sample
