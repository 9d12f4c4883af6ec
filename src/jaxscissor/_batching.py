"""How a batch is evaluated: leg after leg, and in chunks that stay in the cache."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap

from jaxscissor._fence import fence

_REGISTER = 8  # lanes; loops over chunks of an odd length take twice as long
CHUNK = 32768  # lanes evaluated together: their intermediate results stay in the cache


def chunked(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, with a batching rule of its own: ``jax.vmap`` runs many lanes chunk by chunk.

    Reverse-mode derivatives do not pass: stop the gradient of what goes in.
    """
    mapped = custom_vmap(function)

    @mapped.def_vmap
    def rule(size, batched, *args):
        leaves, structure = jax.tree.flatten(args)
        flags = jax.tree.leaves(batched)

        def part(chosen):
            rest = iter(chosen)
            whole = [next(rest) if flag else leaf for leaf, flag in zip(leaves, flags, strict=True)]
            return jax.vmap(function, _axes(batched))(*jax.tree.unflatten(structure, whole))

        out = _in_chunks(part, [leaf for leaf, flag in zip(leaves, flags, strict=True) if flag], size)
        return out, jax.tree.map(lambda _: True, out)

    return functools.wraps(function)(mapped)


def over_legs(function: Callable[[Any, Any], Any], legs: Any, seen: Sequence[Any]) -> list[Any]:
    """Apply a function to each of the stacked legs and what it sees; a list with one result per leg.

    The legs run one after another through one program, which has a leg's numbers as scalars and the lanes
    side by side: a third of the program to compile, and the speed of legs unrolled.
    """
    stacked = fence(jax.tree.map(lambda *leaves: jnp.stack(leaves), *seen))
    out = lax.map(lambda case: fence(function(*case)), (legs, stacked))
    return [jax.tree.map(lambda leaf, i=i: leaf[i], out) for i in range(len(seen))]


def _axes(batched: Any) -> Any:
    return jax.tree.map(lambda flag: 0 if flag else None, tuple(batched))


def _in_chunks(function: Callable[[Any], Any], lanes: Any, size: int) -> Any:
    """Apply a function of lanes to equal chunks of whole registers, the last one filled up if need be."""
    least = math.ceil(size / CHUNK) if isinstance(size, int) else 1  # exported programs may leave the size open
    if least <= 1:  # none at all included
        return function(lanes)
    count = next((k for k in range(least, 2 * least) if size % (k * _REGISTER) == 0), least)
    chunk = _REGISTER * math.ceil(size / (count * _REGISTER))

    def split(x):
        filled = jnp.pad(x, [(0, count * chunk - size)] + [(0, 0)] * (x.ndim - 1), mode="edge")
        return filled.reshape(count, chunk, *x.shape[1:])

    out = lax.map(function, jax.tree.map(split, lanes))
    return jax.tree.map(lambda x: x.reshape(count * chunk, *x.shape[2:])[:size], out)
