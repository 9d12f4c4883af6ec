"""The legs of a robot, stacked on the leading axis of every leaf: one program for all, or one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import jax
from jax import lax

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.types import PyTree


def over_legs(function: Callable[..., Any], legs: Any, *seen: PyTree) -> Any:
    """Apply a function to each leg and what belongs to it; the results, stacked.

    The legs run one after another through one program, which has a leg's numbers as scalars and the lanes
    side by side: a third of the program to compile, and the speed of legs unrolled.
    """
    # fenced, as each array of results would evaluate the whole function
    return lax.map(lambda case: fence(function(*case)), (legs, *seen))


def one_by_one(*stacked: PyTree) -> Iterator[tuple[Any, ...]]:
    """Each leg and what belongs to it; unrolled in Python they run faster than under ``vmap``."""
    for i in range(jax.tree.leaves(stacked)[0].shape[0]):
        parts = jax.tree.map(lambda leaf, i=i: leaf[i], stacked)
        yield tuple(part.alone(i) if hasattr(part, "alone") else part for part in parts)
