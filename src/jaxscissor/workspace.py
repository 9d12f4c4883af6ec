"""How much of a region a robot reaches: hard, for reporting, and softened, for tuning."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.core import Tracer

from jaxscissor._batching import CHUNK
from jaxscissor._fence import fence
from jaxscissor._pytree import as_floats, float_dtype, pytree
from jaxscissor.feasibility import reached_margin
from jaxscissor.mechanisms._contract import Mechanism
from jaxscissor.regions import Sample

_BLOCK = 64  # chunks between two steps of the progress bar


@pytree
class _Listed:
    """Poses that are stored, behind the interface of a sample."""

    array: jax.Array

    def __len__(self) -> int:
        return self.array.shape[0]

    def poses(self, indices: jax.Array) -> jax.Array:
        return self.array[indices]


def workspace_fraction(robot: Mechanism, poses: Any, *, chunk_size: int | None = None) -> jax.Array:
    """Fraction of poses that the robot reaches in its home mode within all limits.

    Args:
      robot: the robot. The fraction is a count, so its derivative is zero: see
        ``soft_workspace_fraction``.
      poses: ``(n, d)`` poses, or a sample of a region, whose poses are made chunk by chunk so that memory
        does not grow with their number.
      chunk_size: poses evaluated together.

    Returns:
      The fraction, a scalar. Poses that are not finite count as not reached.

    Raises:
      ValueError: poses of the wrong shape, or none.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> sample = js.Cylinder(robot.length / 2, robot.length).quasi_random(20_000)
      >>> round(float(js.workspace_fraction(robot, sample)), 2)
      0.29
    """
    robot, sample = _checked(robot, poses)
    chunk = min(chunk_size or CHUNK, len(sample))
    chunks = math.ceil(len(sample) / chunk)
    blocks = [(0, chunks)] if _is_traced(robot, sample) else _blocks(chunks)
    size, reached, sizeless = jnp.uint32(len(sample)), jnp.uint32(0), _without_size(sample)
    for first, last in _progress(blocks):
        reached = reached + _count(robot, sizeless, size, jnp.uint32(first), jnp.uint32(last), chunk)
    return reached.astype(float_dtype(robot)) / len(sample)


def soft_workspace_fraction(
    robot: Mechanism, poses: Any, *, sharpness: Any = 200.0, chunk_size: int | None = None
) -> jax.Array:
    """Differentiable fraction: the mean of sigmoid(sharpness * margin) over the poses.

    Its gradient approaches that of the hard fraction as the sharpness grows, with a bias that falls as
    the boundary layer, 1 / sharpness wide, gets thin against the workspace, and a variance that grows as
    fewer poses lie in the layer: of n poses about n / sharpness speak. The default suits 10^5 poses and
    more; the bias then is about two per cent of a derivative, more of small ones (measured: see the README).

    The gradient is accumulated chunk by chunk, so memory does not grow with the number of poses. The
    poses themselves are held fixed.

    Args:
      robot: the robot; every array in it is differentiable, twice in forward over reverse mode.
      poses: ``(n, d)`` poses, or a sample of a region.
      sharpness: inverse width of the boundary layer in units of the margin, dimensionless.
      chunk_size: poses evaluated together.

    Returns:
      A scalar between 0 and 1.

    Raises:
      ValueError: poses of the wrong shape, or none.

    Example:
      >>> import jax, jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> sample = js.Cylinder(robot.length / 2, robot.length).quasi_random(4096)
      >>> gradient = jax.grad(js.soft_workspace_fraction)(robot, sample)
      >>> bool(gradient.link_lengths[0] > 0)  # a longer lowest bar widens the workspace
      True
    """
    robot, sample = _checked(robot, poses)
    chunk = min(chunk_size or CHUNK, len(sample))
    size = jnp.uint32(len(sample))
    sharpness = jnp.asarray(sharpness, float_dtype(robot))
    return _soft(chunk, robot, lax.stop_gradient(_without_size(sample)), size, lax.stop_gradient(sharpness))


def _checked(robot: Mechanism, poses: Any) -> tuple[Any, Any]:
    sample = poses if isinstance(poses, Sample) else _Listed(jnp.asarray(poses))
    if not len(sample):
        raise ValueError("Got no poses; the fraction of an empty sample is not defined.")
    shape = jax.eval_shape(sample.poses, jax.ShapeDtypeStruct((1,), jnp.uint32)).shape
    if shape[1:] != (robot.space.dimension,):
        raise ValueError(
            f"Got poses of shape {shape[1:]}; {type(robot).__name__} expects (n, {robot.space.dimension}) = "
            f"n times ({', '.join(robot.space.names)})."
        )
    return as_floats(robot)[0], sample


def _without_size(sample: Any) -> Any:
    """The sample with its length taken out of the structure, so that another length does not recompile."""
    if isinstance(sample, Sample) and not sample.counts:
        return Sample(sample.region, sample.shift, (), 0)
    return sample


def _is_traced(*trees: Any) -> bool:
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(trees))


def _blocks(chunks: int) -> list[tuple[int, int]]:
    return [(first, min(first + _BLOCK, chunks)) for first in range(0, chunks, _BLOCK)]


def _progress(blocks: list[Any]) -> Iterable[Any]:
    """The blocks, with a progress bar if there are several and tqdm is installed."""
    if len(blocks) == 1:
        return blocks
    try:
        from tqdm import tqdm
    except ImportError:
        return blocks
    return tqdm(blocks, desc="workspace", unit="block", disable=None)


def _chunk_poses(sample: Any, index: jax.Array, chunk: int, size: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Poses of chunk number ``index`` and which of them count, the last chunk being filled up."""
    numbers = index * jnp.uint32(chunk) + jnp.arange(chunk, dtype=jnp.uint32)
    counted = numbers < size
    return fence(sample.poses(jnp.where(counted, numbers, 0))), counted


@partial(jax.jit, static_argnums=5)
def _count(robot, sample, size, first, last, chunk: int) -> jax.Array:
    def step(index, total):
        poses, counted = _chunk_poses(sample, index, chunk, size)
        reached = jax.vmap(lambda pose: reached_margin(robot, pose) >= 0)(poses)
        return total + jnp.sum(reached & counted, dtype=jnp.uint32)

    return lax.fori_loop(first, last, step, jnp.uint32(0))


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _soft(chunk: int, robot, sample, size, sharpness) -> jax.Array:
    return _soft_value(chunk, robot, sample, size, sharpness)


@partial(jax.jit, static_argnums=0)
def _soft_value(chunk: int, robot, sample, size, sharpness) -> jax.Array:
    def step(index, total):
        return total + _soft_chunk(robot, sample, size, sharpness, index, chunk)

    return lax.fori_loop(0, _chunk_count(size, chunk), step, jnp.zeros_like(sharpness)) / size.astype(sharpness.dtype)


@_soft.defjvp
def _soft_jvp(chunk, primals, tangents):
    value, gradient = _soft_gradient(chunk, *primals)
    products = jax.tree.map(lambda g, t: jnp.sum(g * t), gradient, tangents[0])
    return value, sum(jax.tree.leaves(products))


@partial(jax.jit, static_argnums=0)
def _soft_gradient(chunk: int, robot, sample, size, sharpness):
    """Value and gradient with the reverse pass inside each chunk: nothing is kept between chunks."""

    def step(index, totals):
        part = jax.value_and_grad(_soft_chunk)(robot, sample, size, sharpness, index, chunk)
        return jax.tree.map(jnp.add, totals, part)

    start = (jnp.zeros_like(sharpness), jax.tree.map(jnp.zeros_like, robot))
    totals = lax.fori_loop(0, _chunk_count(size, chunk), step, start)
    return jax.tree.map(lambda total: total / size.astype(total.dtype), totals)


def _chunk_count(size: jax.Array, chunk: int) -> jax.Array:
    return ((size + jnp.uint32(chunk - 1)) // jnp.uint32(chunk)).astype(jnp.int32)


def _soft_chunk(robot, sample, size, sharpness, index, chunk: int) -> jax.Array:
    poses, counted = _chunk_poses(sample, index.astype(jnp.uint32), chunk, size)
    soft = jax.vmap(lambda pose: _smooth_step(sharpness * reached_margin(robot, pose)))(poses)
    return jnp.sum(jnp.where(counted, soft, 0))


def _smooth_step(x: jax.Array) -> jax.Array:
    """Logistic step whose slope has no second moment, so that a curved boundary is not displaced by it."""
    s = jax.nn.sigmoid(x)
    return s - math.pi**2 / 6 * s * (1 - s) * (1 - 2 * s)
