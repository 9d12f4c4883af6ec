"""Sums over many cases in chunks: on one device or all of a mesh, shown, saved and resumed."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.core import Tracer
from jax.flatten_util import ravel_pytree
from jax.sharding import Mesh, PartitionSpec

from jaxscissor._batching import CHUNK
from jaxscissor._checkpoint import restore, save, traced
from jaxscissor._progress import progress

_BLOCK = 64  # chunks of each device between two steps of the progress bar


class Plan(NamedTuple):
    """How a sum over ``size`` cases is worked: ``chunk`` of them together, on which devices, saved where."""

    size: int
    chunk: int
    mesh: Mesh | None
    checkpoint: str | None


def planned(size: int, chunk_size: int | None, mesh: Mesh | None, checkpoint: Any) -> Plan:
    """The plan, by default with chunks that fit the cache and give every device some."""
    if mesh and mesh.abstract_mesh != jax.sharding.get_abstract_mesh():
        mesh = Mesh(mesh.devices, mesh.axis_names)  # no result is to have a type that binds it to these axes
    chunk = min(chunk_size or CHUNK, -(-size // (mesh.size if mesh else 1)))
    return Plan(size, chunk, mesh, None if checkpoint is None else os.fspath(checkpoint))


def add_up(add: Callable[..., Any], settings: Any, plan: Plan, totals: Any, job: dict[str, Any]) -> Any:
    """Totals to which ``add(settings, totals, numbers, counted, **job)`` has added chunk after chunk.

    Args:
      add: function of a module, not one made on the spot: it is part of the key of the compiled program.
        It adds the cases ``numbers`` to the totals, except those not ``counted``, which fill the last chunk.
      settings: hashable; what the program depends on besides.
      plan: size, chunks, devices and checkpoint. Another size is the same program.
      totals: zeros, all of one dtype.
      job: arrays that ``add`` needs; a checkpoint is resumed only with the same.

    Raises:
      ValueError: a checkpoint of another job, or a checkpoint under a transformation.
    """
    size, chunks = jnp.uint32(plan.size), -(-plan.size // plan.chunk)
    block = partial(_block, add, settings, plan.chunk, plan.mesh, totals, job, size)
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(job)):
        if plan.checkpoint is not None:
            raise ValueError("Got a checkpoint inside jit or vmap; only a call with numbers can be saved and resumed.")
        return block(jnp.int32(0), jnp.int32(chunks))
    first, identity = 0, {}
    if plan.checkpoint is not None:
        numbers = jnp.zeros(plan.chunk, jnp.uint32)
        program = traced(partial(add, settings), totals, numbers, numbers == 0, **job)
        identity = job | {"function": (program, str(settings)), "size": size, "chunk": plan.chunk}
        first, totals = restore(plan.checkpoint, identity, totals)
    step = _BLOCK * (plan.mesh.size if plan.mesh else 1)
    for start in progress(range(first, chunks, step), "workspace", "block"):
        stop = min(start + step, chunks)
        sums = jax.block_until_ready(block(jnp.int32(start), jnp.int32(stop)))
        totals = jax.tree.map(jnp.add, totals, sums)
        if plan.checkpoint is not None:
            save(plan.checkpoint, identity, stop, totals)
    return totals


@partial(jax.jit, static_argnums=(0, 1, 2, 3))
def _block(add, settings, chunk: int, mesh: Mesh | None, zeros, job, size, first, last):
    """Sums over the chunks from ``first`` to before ``last``, every device taking its share of them."""

    def share(zeros, job, size, first, last, device: Any = 0, devices: int = 1):
        def step(turn, sums):
            numbers = (first + device + turn * devices).astype(jnp.uint32) * jnp.uint32(chunk)
            numbers = numbers + jnp.arange(chunk, dtype=jnp.uint32)
            counted = numbers < size
            return add(settings, sums, jnp.where(counted, numbers, 0), counted, **job)

        turns = (last - first - device + devices - 1) // devices
        return lax.fori_loop(0, turns, step, zeros)

    work = share if mesh is None else _on_all(mesh, share)
    return work(zeros, job, size, first, last)


def _on_all(mesh: Mesh, share: Callable[..., Any]) -> Callable[..., Any]:
    """The sum of every device's share, by one reduction of all totals together."""

    def work(*args):
        mine = share(*args, device=lax.axis_index(mesh.axis_names), devices=mesh.size)
        flat, unravel = ravel_pytree(mine)
        return unravel(lax.psum(flat, mesh.axis_names))

    everywhere = PartitionSpec()
    return jax.shard_map(work, mesh=mesh, in_specs=everywhere, out_specs=everywhere, check_vma=False)
