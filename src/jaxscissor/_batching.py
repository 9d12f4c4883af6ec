"""How a batch is laid out: leg by leg, lanes last, and in chunks that stay in the cache.

Both tools leave a function unbatched and give it a batching rule of its own, so that ``jax.vmap`` from outside
meets the fast layout. Derivatives do not pass through either: stop the gradient of what goes in.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap

from jaxscissor._fence import fence

CHUNK = 16384  # lanes evaluated together: their intermediate results stay in the cache


def chunked(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, which maps many lanes chunk by chunk."""
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


def legwise(function: Callable[[Any, Any, Any], Any]) -> Callable[..., Any]:
    """The function of one leg, mapped over legs: ``(stacked legs, list of what each leg sees, shared) -> list``.

    Lanes that are mapped from outside come last, in arrays of shape ``(legs, lanes)``, not first, where
    every number of a leg would be spread over three neighbours.
    """

    def over_legs(legs, seen, shared):
        return jax.vmap(function, (0, 0, None))(legs, fence(_stack(seen)), shared)

    @custom_vmap
    def mapped(legs, seen, shared):
        return _unstack(over_legs(legs, seen, shared), len(seen))

    @mapped.def_vmap
    def rule(size, batched, legs, seen, shared):
        if any(jax.tree.leaves((batched[0], batched[2]))):
            stacked = jax.vmap(over_legs, _axes(batched), 1)(legs, seen, shared)
        else:
            lanes = jax.tree.map(lambda x, b: x if b else jnp.broadcast_to(x, (size, *x.shape)), seen, batched[1])
            over_lanes = jax.vmap(function, (None, 0, None))
            stacked = jax.vmap(over_lanes, (0, 0, None))(legs, fence(_stack(lanes)), shared)
        out = _unstack(stacked, len(seen))
        return out, jax.tree.map(lambda _: True, out)

    return functools.wraps(function)(mapped)


def _axes(batched: Any) -> Any:
    return jax.tree.map(lambda flag: 0 if flag else None, tuple(batched))


def _stack(trees: Any) -> Any:
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *trees)


def _unstack(tree: Any, count: int) -> list[Any]:
    return [jax.tree.map(lambda leaf, i=i: leaf[i], tree) for i in range(count)]


def _in_chunks(function: Callable[[Any], Any], lanes: Any, size: int) -> Any:
    """Apply a function of lanes to equal chunks of them, the last one filled up."""
    count = math.ceil(size / CHUNK)
    if count == 1:
        return function(lanes)
    chunk = math.ceil(size / count)

    def split(x):
        filled = jnp.pad(x, [(0, count * chunk - size)] + [(0, 0)] * (x.ndim - 1), mode="edge")
        return filled.reshape(count, chunk, *x.shape[1:])

    out = lax.map(function, jax.tree.map(split, lanes))
    return jax.tree.map(lambda x: x.reshape(count * chunk, *x.shape[2:])[:size], out)
