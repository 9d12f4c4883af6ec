"""Samples that are stored, and samples of sets of poses one by one."""

from __future__ import annotations

from typing import TypeAlias

import jax
import jax.numpy as jnp

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.pytree import pytree, static
from jaxscissor._engine.types import Number, Numbers
from jaxscissor.regions._regions import Sample, pose_shape


@pytree
class Listed:
    """Poses that are stored, behind the interface of a sample."""

    array: jax.Array

    def __len__(self) -> int:
        return self.array.shape[0]

    def pose(self, index: Number) -> jax.Array:
        """Pose ``(d,)`` number ``index``."""
        return self.array[index]

    def poses(self, indices: jax.Array) -> jax.Array:
        """Poses ``(m, d)`` with these numbers."""
        return fence(self.array[indices])  # whatever takes coordinates would pick them from the array anew


@pytree
class _EachPose:
    """The poses of a sample of sets of poses, one by one."""

    sample: Sample
    together: int = static()

    def __len__(self) -> int:
        return len(self.sample) * self.together

    def pose(self, index: Number) -> jax.Array:
        index = jnp.asarray(index, jnp.uint32)
        return self.sample.pose(index // self.together)[index % self.together]

    def poses(self, indices: jax.Array) -> jax.Array:
        return fence(jax.vmap(self.pose)(indices))


AnySample: TypeAlias = Sample | Listed | _EachPose
PosesLike: TypeAlias = Numbers | Sample
"""``(n, d)`` poses, or a sample of a region."""


def each_pose(sample: AnySample) -> AnySample:
    """The sample, or that of all poses of its sets if its region gives sets of poses."""
    if not isinstance(sample, Sample) or len(shape := pose_shape(sample.region)) < 2:
        return sample
    if len(sample) * shape[0] >= 2**31:
        raise ValueError(f"Got {len(sample)} times {shape[0]} poses; expected less than 2^31.")
    return _EachPose(sample, shape[0])


def without_size(sample: AnySample) -> AnySample:
    """The sample with its length taken out of the structure, so that another length does not recompile."""
    if isinstance(sample, Sample) and not sample.counts:
        return Sample(sample.region, sample.shift, (), 0)
    return sample
