"""Whether a robot reaches the poses of a sample, by which margin, and that they are poses of this robot."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.pytree import as_floats
from jaxscissor.kinematics._feasibility import reached_margin
from jaxscissor.regions._regions import Region, Sample, pose_shape
from jaxscissor.regions._samples import AnySample, Listed, PosesLike
from jaxscissor.robots._contract import Mechanism


def sample_margin(robot: Mechanism, sample: AnySample, pose: jax.Array) -> Scalar:
    """Margin of what a sample gives, a pose or poses that stand for each other: >= 0 where it counts as reached."""
    return region_margin(robot, sample.region, pose) if isinstance(sample, Sample) else reached_margin(robot, pose)


def region_margin(robot: Mechanism, region: Region, pose: jax.Array) -> Scalar:
    """The same of what a region gives."""
    return reached_margin(robot, pose) if pose.ndim == 1 else _decisive(region.require, robot, pose)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _decisive(require: str, robot: Mechanism, poses: jax.Array) -> jax.Array:
    """Margin of the pose that decides."""
    margins = lax.map(partial(reached_margin, robot), poses)
    return jnp.min(margins) if require == "all" else jnp.max(margins)


@_decisive.defjvp
def _decisive_jvp(require: jax.Array, primals: tuple[Any, ...], tangents: tuple[Any, ...]):
    """Only the pose that decides is differentiated."""
    (robot, poses), (changed, moved) = primals, tangents
    margins = lax.map(partial(reached_margin, robot), poses)
    decisive = jnp.argmin(margins) if require == "all" else jnp.argmax(margins)
    return jax.jvp(reached_margin, (robot, poses[decisive]), (changed, moved[decisive]))


def checked_sample(robot: Mechanism, poses: PosesLike) -> tuple[Any, Any]:
    """The robot as floats, and the poses behind the interface of a sample.

    Raises:
      ValueError: poses of the wrong shape, or none.
    """
    if isinstance(poses, Region):
        raise ValueError(f"Got a {type(poses).__name__}; give a sample of it, such as region.quasi_random(n).")
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
    if isinstance(sample, Sample):
        check_region(robot, sample.region)
    if not len(sample):
        raise ValueError("Got no poses; nothing is defined over an empty sample.")
    return as_floats(robot)[0], sample


def check_region(robot: Mechanism, region: Region) -> None:
    """Raise unless the poses of a region are of this robot, and the orientations of a set too.

    Raises:
      ValueError: naming the shapes.
    """
    space, shape = robot.space, pose_shape(region)
    turns = space.dimension - space.translations
    orientations = getattr(region, "orientations", None)
    if orientations is not None and orientations.shape[1] != turns:
        raise ValueError(
            f"Got orientations {orientations.shape}; {type(robot).__name__} expects (m, {turns}) = m times "
            f"({', '.join(space.names[space.translations :])})."
        )
    if shape[-1] != space.dimension:
        raise ValueError(
            f"Got a region of poses {shape}; {type(robot).__name__} expects ({space.dimension},) = "
            f"({', '.join(space.names)})."
        )
