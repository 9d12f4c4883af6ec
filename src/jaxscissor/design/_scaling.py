"""Units in which objective and constraints have a slope of one at first, so that an optimizer knows none of theirs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from jaxscissor._engine.types import PyTree
from jaxscissor.design._problem import Evaluate


class Scale(NamedTuple):
    """Units of the objective and of the constraints: the lengths of their first slopes, of many the median."""

    objective: Any  # ()
    constraints: tuple[Any, ...]  # one per constraint

    def of_entries(self, sizes: Sequence[int]) -> np.ndarray:
        """The unit of every entry, for constraints of so many."""
        return np.repeat(np.asarray(self.constraints, float), sizes)


def sampled_slopes(evaluate: Evaluate) -> Callable[..., Any]:
    """As ``linearizer``, but all rows of a constraint are alike: their root mean square, estimated.

    It is that of a sum of the entries with random signs, which costs one derivative a constraint, not one an entry.
    """

    def one(unit: PyTree, shared: PyTree):
        def projected(unit: PyTree):
            value, constraints = evaluate(unit, (), shared)
            signs = [jax.random.rademacher(jax.random.key(i), s.shape, s.dtype) for i, s in enumerate(constraints)]
            sums = [jnp.sum(jnp.where(jnp.isnan(s), 0, s) * sign) for s, sign in zip(constraints, signs, strict=True)]
            return (value, sums), (value, constraints)

        (slope, rows), (value, constraints) = jax.jacrev(projected, has_aux=True)(unit)
        slope, *rows = (ravel_pytree(row)[0] for row in (slope, *rows))
        each = [jnp.tile(row / np.sqrt(max(s.size, 1)), (s.size, 1)) for row, s in zip(rows, constraints, strict=True)]
        return (slope, jnp.concatenate(each) if each else jnp.zeros((0, len(slope)))), (value, constraints)

    return jax.jit(lambda units, _, shared: jax.vmap(one, (0, None))(units, shared))


def first_scale(seen: PyTree) -> tuple[Scale, list[int]]:
    """The units that follow from the first start, and how many entries each constraint has.

    Args:
      seen: ``((slopes, rows), (objectives, constraints))`` of ``linearizer``, in units of one. A slope that is zero
        or not finite leaves the unit as it is.
    """
    (slope, rows), (value, constraints) = seen
    sizes = [values.shape[1] for values in constraints]
    lengths = np.sqrt(np.sum(np.asarray(rows[0], float) ** 2, axis=1))
    parts = np.split(lengths, np.cumsum(sizes)[:-1]) if sizes else []
    # the median, for at a kink one entry of many may be as steep as rounding makes it
    usual = [np.median(part[np.isfinite(part) & (part > 0)]) if np.any(part > 0) else 0 for part in parts]
    steep = float(np.sqrt(np.sum(np.asarray(slope[0], float) ** 2)))

    def one(size: float, like: PyTree):
        return np.asarray(size if np.isfinite(size) and size > 0 else 1, like.dtype)

    return Scale(one(steep, value), tuple(one(g, s) for g, s in zip(usual, constraints, strict=True))), sizes
