"""The fence: an identity that keeps the compiler from evaluating its inputs more than once.

XLA fuses, and every fused output recomputes its producers: the attachments of one pose would cost dozens of sines
instead of six. A loop that does not run, but that XLA cannot prove dead, forces its inputs to be stored. Measured with
jaxlib 0.10.2: of 3 shared sines with 4 consumers the optimized program holds 12, with ``lax.optimization_barrier``,
which is dropped before fusion, 12, with the fence 3; batches of inverse kinematics of the TSE run 3 times as fast;
``jacfwd`` of forward kinematics has a third of the instructions. Where a comparison decides control flow and is used
again, the fence also makes it one comparison: evaluated twice it may round to both sides. It can go when XLA for CPUs
keeps to ``optimization_barrier`` or to a limit on fusion (``fuse_limit`` of newer versions of JAX). On other platforms
it is the identity: a loop there stops the host.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from jaxscissor._engine.cpu import PLAIN
from jaxscissor._engine.types import PyTree


def fence(tree: PyTree) -> Any:
    """Identity that the compiler must evaluate once, in every derivative too."""
    if PLAIN:
        return tree
    leaves, structure = jax.tree.flatten(tree)
    return jax.tree.unflatten(structure, _fence_p.bind(*(jnp.asarray(leaf) for leaf in leaves))) if leaves else tree


def _stored(*leaves: jax.Array) -> list[jax.Array]:
    """A loop that no number starts: its first float, or first leaf, would have to be above all others and below them.

    The compiler does not prove that, nor that the body is the identity, which it is not: leaves change places with
    those of their kind, or their sign.
    """
    lead = next((i for i, leaf in enumerate(leaves) if jnp.issubdtype(leaf.dtype, jnp.floating)), 0)
    kinds: dict[Any, list[int]] = {}
    for i, leaf in enumerate(leaves):
        kinds.setdefault((leaf.shape, leaf.dtype), []).append(i)
    source = {i: places[n - 1] for places in kinds.values() for n, i in enumerate(places)}

    def entered(values: PyTree):
        first = values[lead].ravel()[:1]
        if not jnp.issubdtype(first.dtype, jnp.floating):
            first = first.real if jnp.iscomplexobj(first) else first.astype(jnp.float32)
        largest = float(jnp.finfo(first.dtype).max)
        return jnp.all((first > largest) & (first < -largest)) if first.size else jnp.asarray(False)

    def changed(values: PyTree):
        return [values[source[i]] if source[i] != i else _opposite(value) for i, value in enumerate(values)]

    return lax.while_loop(entered, changed, list(leaves))


def _opposite(value: jax.Array) -> jax.Array:
    return ~value if value.dtype == bool else -value


_fence_p = Primitive("fence")
_fence_p.multiple_results = True
_fence_p.def_impl(lambda *leaves: list(leaves))
_fence_p.def_abstract_eval(lambda *avals: list(avals))
mlir.register_lowering(_fence_p, lambda _, *leaves: leaves)
mlir.register_lowering(_fence_p, mlir.lower_fun(_stored, multiple_results=True), platform="cpu")
batching.primitive_batchers[_fence_p] = lambda leaves, axes: (_fence_p.bind(*leaves), axes)


def _fence_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]):
    moving = [not isinstance(t, ad.Zero) for t in tangents]
    moved = iter(_fence_p.bind(*(t for t, m in zip(tangents, moving, strict=True) if m)) if any(moving) else [])
    return _fence_p.bind(*primals), [next(moved) if m else t for t, m in zip(tangents, moving, strict=True)]


def _fence_transpose(cotangents: PyTree, *leaves):
    present = [not isinstance(c, ad.Zero) for c in cotangents]
    fenced = iter(_fence_p.bind(*(c for c, p in zip(cotangents, present, strict=True) if p)) if any(present) else [])
    return [next(fenced) if p else c for c, p in zip(cotangents, present, strict=True)]


ad.primitive_jvps[_fence_p] = _fence_jvp
ad.primitive_transposes[_fence_p] = _fence_transpose
