"""The fence: an identity that keeps the compiler from evaluating its inputs more than once."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir


def fence(tree: Any) -> Any:
    """Identity that the compiler must evaluate once, in every derivative too.

    XLA fuses, and every fused output recomputes its producers: the attachments of one pose would cost
    dozens of sines instead of six. A loop that does not run, but that XLA cannot prove dead, forces its
    inputs to be stored. (``lax.optimization_barrier`` is dropped before fusion.)
    """
    leaves, structure = jax.tree.flatten(tree)
    return jax.tree.unflatten(structure, _fence_p.bind(*(jnp.asarray(leaf) for leaf in leaves))) if leaves else tree


def _stored(*leaves: jax.Array) -> list[jax.Array]:
    """The loop runs once where the first element is infinite, and adds its counter, then zero.

    A body that is plainly the identity would be seen through.
    """
    largest = float(jnp.finfo(leaves[0].dtype).max)

    def entered(carry):
        count, values = carry
        return (values[0].ravel()[0] > largest) & (count < 1) if values[0].size else count < 0

    def unchanged(carry):
        count, values = carry
        return count + 1, [value + count.astype(value.dtype) for value in values]

    return lax.while_loop(entered, unchanged, (jnp.int32(0), list(leaves)))[1]


_fence_p = Primitive("fence")
_fence_p.multiple_results = True
_fence_p.def_impl(lambda *leaves: list(leaves))
_fence_p.def_abstract_eval(lambda *avals: list(avals))
mlir.register_lowering(_fence_p, mlir.lower_fun(_stored, multiple_results=True))
batching.primitive_batchers[_fence_p] = lambda leaves, axes: (_fence_p.bind(*leaves), axes)


def _fence_jvp(primals, tangents):
    moving = [not isinstance(t, ad.Zero) for t in tangents]
    moved = iter(_fence_p.bind(*(t for t, m in zip(tangents, moving, strict=True) if m)) if any(moving) else [])
    return _fence_p.bind(*primals), [next(moved) if m else t for t, m in zip(tangents, moving, strict=True)]


def _fence_transpose(cotangents, *leaves):
    present = [not isinstance(c, ad.Zero) for c in cotangents]
    fenced = iter(_fence_p.bind(*(c for c, p in zip(cotangents, present, strict=True) if p)) if any(present) else [])
    return [next(fenced) if p else c for c, p in zip(cotangents, present, strict=True)]


ad.primitive_jvps[_fence_p] = _fence_jvp
ad.primitive_transposes[_fence_p] = _fence_transpose
