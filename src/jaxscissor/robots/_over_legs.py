"""One program for all legs of a robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.cpu.fence import fence


def over_legs(function: Callable[[Any, Any], Any], legs: Any, seen: Sequence[Any]) -> list[Any]:
    """Apply a function to each of the stacked legs and what it sees; a list with one result per leg.

    The legs run one after another through one program, which has a leg's numbers as scalars and the lanes
    side by side: a third of the program to compile, and the speed of legs unrolled.
    """
    stacked = fence(jax.tree.map(lambda *leaves: jnp.stack(leaves), *seen))
    out = lax.map(lambda case: fence(function(*case)), (legs, stacked))
    return [jax.tree.map(lambda leaf, i=i: leaf[i], out) for i in range(len(seen))]
