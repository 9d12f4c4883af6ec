"""Sums over many cases in chunks: on one device or all of a mesh, shown, saved and resumed, with their gradient."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.core import Tracer
from jax.flatten_util import ravel_pytree
from jax.sharding import Mesh, PartitionSpec

from jaxscissor._engine.checkpoint import restore, save, traced
from jaxscissor._engine.cpu.chunks import lanes_together
from jaxscissor._engine.progress import progress
from jaxscissor._engine.types import PyTree

_BLOCK = 64  # chunks of each device between two steps of the progress bar


@dataclasses.dataclass(frozen=True)
class Execution:
    """How work over many poses is executed.

    Args:
      mesh: each device of it works through its own chunks, on many hosts too; one all-reduce follows every 64 chunks.
        All processes call with the same arguments. Stored poses are copied to every device.
      chunk_size: cases evaluated together. Default: as many as stay in the cache. For a batch of robots (``vmap``)
        divide it by their number.
      checkpoint: path of an ``.npz`` file, replaced after every block of 64 chunks per device. A job that was stopped
        goes on from there when called again; a finished one is read.
      progress: whether a bar is shown, if tqdm is installed and the work takes more than one block.

    Raises:
      ValueError: a chunk size below one.

    Example:
      >>> Execution(chunk_size=4096).checkpoint is None
      True
    """

    mesh: Mesh | None = None
    chunk_size: int | None = None
    checkpoint: str | os.PathLike[str] | None = None
    progress: bool = True

    def __post_init__(self):
        if self.chunk_size is not None and self.chunk_size < 1:
            raise ValueError(f"Got chunk_size={self.chunk_size}; expected at least one case.")


@dataclasses.dataclass(frozen=True)
class Plan:
    """How a sum over ``size`` cases is worked, ``chunk`` of them together."""

    size: int
    chunk: int
    execution: Execution


def planned(size: int, execution: Execution) -> Plan:
    """The plan, by default with chunks that fit the cache and give every device some."""
    mesh = execution.mesh
    if mesh and mesh.abstract_mesh != jax.sharding.get_abstract_mesh():
        mesh = Mesh(mesh.devices, mesh.axis_names)  # no result is to have a type that binds it to these axes
        execution = dataclasses.replace(execution, mesh=mesh)
    chunk = min(execution.chunk_size or lanes_together(), -(-size // (mesh.size if mesh else 1)))
    return Plan(size, chunk, execution)


def map_reduce(update: Callable[..., Any], static: PyTree, plan: Plan, init: PyTree, inputs: dict[str, Any]) -> Any:
    """The totals to which ``update(static, totals, indices, counted, **inputs)`` has added chunk after chunk.

    1. Under a transformation, or in the caller's own program, all chunks are one loop.
    2. Else they are blocks of chunks, each a call of one program, between which progress is shown and the totals are
       saved; a checkpoint of the same job is where the first block begins.

    Args:
      update: function of a module, not one made on the spot: it is part of the key of the compiled program.
        It adds the cases ``indices`` to the totals, except those not ``counted``, which fill the last chunk.
      static: hashable; what the program depends on besides.
      plan: size, chunks, devices and checkpoint. Another size is the same program.
      init: zeros, all of one dtype.
      inputs: arrays that ``update`` needs; a checkpoint is resumed only with the same.

    Raises:
      ValueError: a checkpoint of another job, or a checkpoint under a transformation.
    """
    size, chunks = jnp.uint32(plan.size), -(-plan.size // plan.chunk)
    mesh, path = plan.execution.mesh, plan.execution.checkpoint
    block = partial(_block, update, static, plan.chunk, mesh, init, inputs, size)
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(inputs)):
        if path is not None:
            raise ValueError("Got a checkpoint inside jit or vmap; only a call with numbers can be saved and resumed.")
        return block(jnp.int32(0), jnp.int32(chunks))
    first, totals, identity = 0, init, {}
    if path is not None:
        indices = jnp.zeros(plan.chunk, jnp.uint32)
        program = traced(partial(update, static), totals, indices, indices == 0, **inputs)
        identity = inputs | {"function": (program, str(static)), "size": size, "chunk": plan.chunk}
        first, totals = restore(os.fspath(path), identity, totals)
    step = _BLOCK * (mesh.size if mesh else 1)
    starts = range(first, chunks, step)
    for start in progress(starts, "workspace", "block") if plan.execution.progress else starts:
        stop = min(start + step, chunks)
        sums = jax.block_until_ready(block(jnp.int32(start), jnp.int32(stop)))
        totals = jax.tree.map(jnp.add, totals, sums)
        if path is not None:
            save(os.fspath(path), identity, stop, totals)
    return totals


@partial(jax.custom_jvp, nondiff_argnums=(0, 1, 2, 3))
def differentiable_sum(
    update: Callable[..., Any],
    update_with_gradient: Callable[..., Any],
    static: PyTree,
    plan: Plan,
    design: PyTree,
    inputs: dict[str, Any],
) -> jax.Array:
    """A scalar total of ``map_reduce``, whose gradient is summed chunk by chunk too: nothing is kept between chunks.

    Args:
      update: see ``map_reduce``, given the keyword ``design`` besides the inputs.
      update_with_gradient: the same of the totals (value, gradient by the design).
      static, plan: see ``map_reduce``.
      design: what the total is differentiated by.
      inputs: the other arrays, held fixed.
    """
    zero = jnp.zeros((), jax.tree.leaves(design)[0].dtype)
    return map_reduce(update, static, plan, zero, inputs | {"design": design})


@differentiable_sum.defjvp
def _differentiable_sum_jvp(
    update: Callable[..., Any],
    update_with_gradient: Callable[..., Any],
    static: PyTree,
    plan: PyTree,
    primals: tuple[Any, ...],
    tangents: tuple[Any, ...],
):
    design, inputs = primals
    init = jnp.zeros((), jax.tree.leaves(design)[0].dtype), jax.tree.map(jnp.zeros_like, design)
    value, gradient = map_reduce(update_with_gradient, static, plan, init, inputs | {"design": design})
    return value, _along(gradient, tangents[0])


@jax.jit
def _along(gradient: PyTree, tangent: PyTree) -> jax.Array:
    """Derivative along a tangent: one program, where every leaf would compile two."""
    products = jax.tree.leaves(jax.tree.map(lambda g, t: jnp.sum(g * t), gradient, tangent))
    return jnp.sum(jnp.stack(products))


@partial(jax.jit, static_argnums=(0, 1, 2, 3))
def _block(
    update: Callable[..., Any],
    static: PyTree,
    chunk: int,
    mesh: Mesh | None,
    zeros: PyTree,
    inputs: PyTree,
    size: jax.Array,
    first: PyTree,
    last: PyTree,
):
    """Sums over the chunks from ``first`` to before ``last``, every device taking its share of them."""

    def share(
        zeros: PyTree, inputs: PyTree, size: jax.Array, first: PyTree, last: PyTree, device: Any = 0, devices: int = 1
    ):
        def step(turn: jax.Array, sums: PyTree):
            indices = (first + device + turn * devices).astype(jnp.uint32) * jnp.uint32(chunk)
            indices = indices + jnp.arange(chunk, dtype=jnp.uint32)
            counted = indices < size
            return update(static, sums, jnp.where(counted, indices, 0), counted, **inputs)

        turns = (last - first - device + devices - 1) // devices
        return lax.fori_loop(0, turns, step, zeros)

    work = share if mesh is None else _on_all(mesh, share)
    return work(zeros, inputs, size, first, last)


def _on_all(mesh: Mesh, share: Callable[..., Any]) -> Callable[..., Any]:
    """The sum of every device's share, by one reduction of all totals together."""

    def work(*args):
        mine = share(*args, device=lax.axis_index(mesh.axis_names), devices=mesh.size)
        flat, unravel = ravel_pytree(mine)
        return unravel(lax.psum(flat, mesh.axis_names))

    everywhere = PartitionSpec()
    return jax.shard_map(work, mesh=mesh, in_specs=everywhere, out_specs=everywhere, check_vma=False)
