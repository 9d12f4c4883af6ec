"""What holds a design back: the multipliers of the constraints and bounds that bind."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from jaxscissor._descent import ALLOWED, Sight, held_back
from jaxscissor._pytree import pytree


@pytree
class Prices:
    """What holds a design back: by how much its objective would fall per unit of everything that binds it.

    Attributes:
      constraints: ``(constraints,)`` per unit by which a constraint is loosened, one for every entry.
      low, high: like the parameters, per unit by which a bound is moved outward; zero where it is not reached.
      rest: largest slope, per width of the bounds, that no constraint and no bound explains; zero at a
        minimum, so it says how far the other prices can be trusted.
    """

    constraints: jax.Array
    low: Any
    high: Any
    rest: jax.Array


def prices_of(
    units: Any, sight: Sight, seen: Any, chosen: int, bounds: tuple[Any, Any], scale: float, each: np.ndarray
) -> Prices:
    """The prices at the chosen one of some designs.

    Args:
      units: the designs in the unit cube.
      sight: what a step sees there.
      seen: the slacks, and if they are known the slopes of objective and slacks, else ``None``.
      chosen: number of the design.
      bounds: low and high.
      scale: unit of the objective.
      each: unit of every slack.
    """
    unit, rebuild = ravel_pytree(jax.tree.map(lambda leaf: jnp.asarray(leaf[chosen]), units))
    slack, slopes = seen[0][chosen], seen[1]
    if slopes is None:  # those of the augmented Lagrangian, whose last step may not have been the last
        multipliers = np.where(slack <= ALLOWED, sight.multipliers[chosen], 0)
        pull = ravel_pytree(jax.tree.map(lambda leaf: jnp.asarray(leaf[chosen]), sight.gradient))[0]
        held = np.asarray(ravel_pytree(held_back(rebuild(pull), rebuild(unit)))[0])
        below, above, rest = np.maximum(held, 0), np.maximum(-held, 0), np.asarray(pull) - held
    else:
        slope, rows = (np.asarray(part[chosen], float) for part in slopes)
        multipliers, below, above, rest = _multipliers(slope, slack, rows, np.asarray(unit, float))
    low, high = (ravel_pytree(bound)[0] for bound in bounds)
    wide = np.asarray(jnp.where(high > low, high - low, jnp.inf))
    return Prices(
        constraints=jnp.asarray(multipliers * scale / each, unit.dtype),
        low=rebuild(jnp.asarray(below * scale / wide, unit.dtype)),
        high=rebuild(jnp.asarray(above * scale / wide, unit.dtype)),
        rest=jnp.asarray(np.abs(rest).max(initial=0) * scale, unit.dtype),
    )


def _multipliers(slope: np.ndarray, slack: np.ndarray, rows: np.ndarray, unit: np.ndarray) -> tuple[np.ndarray, ...]:
    """What explains the slope at a design: multipliers of the constraints, of both bounds, and the rest.

    Least squares with multipliers >= 0, of constraints that bind and of bounds that are reached alone.
    """
    from scipy.optimize import nnls

    binds = np.flatnonzero(np.isfinite(slack) & np.isfinite(rows).all(axis=1) & (slack <= ALLOWED))
    low, high = np.flatnonzero(unit <= 0), np.flatnonzero(unit >= 1)
    sides = np.eye(len(unit))
    columns = np.concatenate([rows[binds], sides[low], -sides[high]]).T
    known = np.where(np.isfinite(slope), slope, 0)
    found, _ = nnls(columns, known) if columns.shape[1] else (np.zeros(0), 0.0)
    prices = np.zeros(len(slack)), np.zeros(len(unit)), np.zeros(len(unit))
    for price, places, part in zip(
        prices, (binds, low, high), np.split(found, np.cumsum([len(binds), len(low)])), strict=True
    ):
        price[places] = part
    return *prices, slope - columns @ found
