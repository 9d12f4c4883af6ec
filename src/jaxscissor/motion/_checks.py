"""Lists of poses and of joints, as arrays of the right shape."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp

from jaxscissor._engine.pytree import as_floats
from jaxscissor._engine.types import Numbers
from jaxscissor.robots._contract import Mechanism


def checked_rows(
    robot: Mechanism, rows: Numbers, size: int, kind: str, names: Sequence[str] = (), *, least: int = 1
) -> tuple[Mechanism, jax.Array]:
    """Robot and rows ``(n, size)``, at least so many, in one floating dtype.

    Raises:
      ValueError: another shape, or too few rows.
    """
    array = jnp.asarray(rows)
    if jnp.iscomplexobj(array):
        raise ValueError(f"Got complex {kind}, {array.dtype}; expected real numbers.")
    if array.ndim != 2 or array.shape[1] != size or array.shape[0] < least:
        meaning = f" = n times ({', '.join(names)})" if names else ""
        raise ValueError(
            f"Got {kind} of shape {array.shape}; {type(robot).__name__} expects (n, {size}){meaning}, n at least "
            f"{least}. Map over a batch of trajectories with jax.vmap."
        )
    robot, array = as_floats(robot, array)
    return robot, array
