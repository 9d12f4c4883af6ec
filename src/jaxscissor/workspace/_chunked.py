"""Quantities of a robot over poses, evaluated in chunks so that memory does not grow with their number."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.cpu.chunks import lanes_together
from jaxscissor.regions._samples import AnySample, PosesLike, each_pose
from jaxscissor.robots._contract import Mechanism
from jaxscissor.workspace._reached import checked_sample

Quantity = Callable[[Mechanism, jax.Array], jax.Array]  # (robot, pose) -> () or (k,), nan where it is not defined


def checked(robot: Mechanism, poses: PosesLike) -> tuple[Mechanism, Any]:
    """Robot and sample, of whose sets of poses each one, held fixed."""
    robot, sample = checked_sample(robot, poses)
    return robot, lax.stop_gradient(each_pose(sample))


def chunks(sample: AnySample) -> tuple[int, int]:
    """Size and number of the chunks in which a sample is worked, so that memory does not grow with it."""
    size = min(lanes_together(), len(sample))
    return size, -(-len(sample) // size)


def value_shape(quantity: Quantity, robot: Mechanism, sample: AnySample) -> jax.ShapeDtypeStruct:
    """Shape and dtype of a quantity."""
    return jax.eval_shape(lambda: quantity(robot, sample.pose(0)))


def values_of(quantity: Quantity, robot: Mechanism, sample: AnySample, turn: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Values of the poses of a chunk, and their numbers; ``nan`` for those that only fill the last chunk."""
    chunk, _ = chunks(sample)
    numbers = jnp.asarray(turn).astype(jnp.uint32) * jnp.uint32(chunk) + jnp.arange(chunk, dtype=jnp.uint32)
    counted = numbers < len(sample)
    poses = sample.poses(jnp.where(counted, numbers, 0))
    return jax.vmap(lambda pose, there: jnp.where(there, quantity(robot, pose), jnp.nan))(poses, counted), numbers
