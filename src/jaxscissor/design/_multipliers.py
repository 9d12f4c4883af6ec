"""What holds a design back: the Lagrange multipliers of the constraints and bounds that bind."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from jaxscissor._engine.pytree import pytree
from jaxscissor._engine.types import PyTree
from jaxscissor.design._problem import FEASIBLE, StepInfo, leaves_cube


@pytree
class Multipliers:
    """Lagrange multipliers: by how much the objective would fall per unit of everything that binds it.

    Attributes:
      constraints: ``(constraints,)`` per unit by which a constraint is loosened, one for every entry.
      low, high: like the parameters, per unit by which a bound is moved outward; zero where it is not reached.
      stationarity: largest slope, per width of the bounds, that no constraint and no bound explains; zero at a
        minimum, so it says how far the multipliers can be trusted.
    """

    constraints: jax.Array
    low: Any
    high: Any
    stationarity: jax.Array


def multipliers_at(
    units: PyTree,
    info: StepInfo,
    values: np.ndarray,
    derivatives: Any,
    chosen: int,
    bounds: tuple[Any, Any],
    scale: float,
    scales: np.ndarray,
) -> Multipliers:
    """The multipliers at the chosen one of some designs.

    Args:
      units: the designs in the unit cube.
      info: what a step finds there.
      values: ``(starts, constraints)`` there.
      derivatives: ``(gradients, jacobians)`` if they are known, else ``None``.
      chosen: index of the design.
      bounds: low and high.
      scale: unit of the objective.
      scales: unit of every entry of the constraints.
    """
    unit, rebuild = ravel_pytree(jax.tree.map(lambda leaf: jnp.asarray(leaf[chosen]), units))
    values = values[chosen]
    if derivatives is None:  # those of the augmented Lagrangian, whose last step may not have been the last
        of_constraints = np.where(values <= FEASIBLE, info.multipliers[chosen], 0)
        gradient = np.asarray(ravel_pytree(jax.tree.map(lambda leaf: jnp.asarray(leaf[chosen]), info.gradient))[0])
        held = np.where(leaves_cube(gradient, unit), gradient, 0)
        of_low, of_high, rest = np.maximum(held, 0), np.maximum(-held, 0), gradient - held
    else:
        gradient, jacobian = (np.asarray(part[chosen], float) for part in derivatives)
        of_constraints, of_low, of_high, rest = _least_squares(gradient, values, jacobian, np.asarray(unit, float))
    low, high = (ravel_pytree(bound)[0] for bound in bounds)
    width = np.asarray(jnp.where(high > low, high - low, jnp.inf))
    return Multipliers(
        constraints=jnp.asarray(of_constraints * scale / scales, unit.dtype),
        low=rebuild(jnp.asarray(of_low * scale / width, unit.dtype)),
        high=rebuild(jnp.asarray(of_high * scale / width, unit.dtype)),
        stationarity=jnp.asarray(np.abs(rest).max(initial=0) * scale, unit.dtype),
    )


def _least_squares(
    gradient: np.ndarray, values: np.ndarray, jacobian: np.ndarray, unit: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Multipliers of the constraints and of both bounds, and the gradient that they leave unexplained.

    Nonnegative least squares over what is active: the gradient is a combination of the gradients of the constraints
    that bind and of the bounds that are reached; the others have the multiplier zero (complementary slackness).
    """
    from scipy.optimize import nnls

    active = np.flatnonzero(np.isfinite(values) & np.isfinite(jacobian).all(axis=1) & (values <= FEASIBLE))
    low, high = np.flatnonzero(unit <= 0), np.flatnonzero(unit >= 1)
    sides = np.eye(len(unit))
    columns = np.concatenate([jacobian[active], sides[low], -sides[high]]).T
    known = np.where(np.isfinite(gradient), gradient, 0)
    found, _ = nnls(columns, known) if columns.shape[1] else (np.zeros(0), 0.0)
    parts = np.split(found, np.cumsum([len(active), len(low)]))
    multipliers = np.zeros(len(values)), np.zeros(len(unit)), np.zeros(len(unit))
    for whole, places, part in zip(multipliers, (active, low, high), parts, strict=True):
        whole[places] = part
    return *multipliers, gradient - columns @ found
