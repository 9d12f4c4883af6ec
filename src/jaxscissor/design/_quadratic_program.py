"""A quadratic program in a box with penalized constraints, by a primal-dual interior-point method, in NumPy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_ITERATIONS = 40  # of Newton's method, at most
_GAP = 1e-11  # complementarity that counts as solved
_INTERIOR = 1e-14  # least value of a slack or multiplier
_CENTERING = 0.1  # sigma, the part of the present complementarity that a step aims at
_TO_BOUNDARY = 0.99  # part of the way to the nearest slack or multiplier of zero


class Linearization(NamedTuple):
    """Objective and constraints of all starts at a point each, and their derivatives."""

    value: np.ndarray  # (starts,)
    gradient: np.ndarray  # (starts, n)
    constraints: np.ndarray  # (starts, m), satisfied where >= 0
    jacobian: np.ndarray  # (starts, m, n)

    def total_violation(self) -> np.ndarray:
        """Sum of the violations, the penalty term of the merit."""
        return np.maximum(-self.constraints, 0).sum(axis=1)


def quadratic_program(
    at: Linearization, hessian: np.ndarray, low: np.ndarray, high: np.ndarray, penalty: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Minimize the quadratic model of the exact-penalty merit over steps d in a box, for every start.

        minimize  g.d + d.H d / 2 + penalty * sum t   subject to  c + J d + t >= 0,  t >= 0,  low <= d <= high

    [Nocedal and Wright, section 18.5; the method is that of their section 16.6].

    1. Slacks s = c + J d + t and t, distances to both sides of the box, and the multipliers m, penalty - m, below
       and above that belong to them all stay positive.
    2. Each iteration solves m s = (penalty - m) t = below (d - low) = above (high - d) = target, the perturbed
       conditions, to first order. With s, t and the bounds' multipliers eliminated, that is one system in d.
    3. It goes 0.99 of the way to the first number that would vanish, with one length for all.
    4. A start is done when the largest product is below ``_GAP``.

    Args:
      at: objective, constraints and derivatives.
      hessian: ``(starts, n, n)``, positive definite.
      low, high: ``(starts, n)``.
      penalty: ``(starts,)``, cost of a unit of violation.

    Returns:
      The steps ``(starts, n)``, the multipliers ``(starts, m)``, and by the model the change of the objective plus the
      cost of the violation after it ``(starts,)``.
    """
    low, high = low - 1e-9, high + 1e-9  # a number that is held fixed has an inside too
    c, gradient, jacobian, weight = at.constraints, at.gradient, at.jacobian, penalty[:, None]
    transposed, diagonal = jacobian.transpose(0, 2, 1), np.arange(gradient.shape[1])

    d = (low + high) / 2
    t = np.maximum(-c - _times(jacobian, d), 0) + 1
    m, below, above = np.zeros_like(t) + weight / 2, np.ones_like(d), np.ones_like(d)
    for _ in range(_ITERATIONS):
        s, rest = np.maximum(c + _times(jacobian, d) + t, _INTERIOR), np.maximum(weight - m, _INTERIOR)
        to_low, to_high = np.maximum(d - low, _INTERIOR), np.maximum(high - d, _INTERIOR)
        products = np.concatenate([m * s, rest * t, below * to_low, above * to_high], axis=1)
        target = _CENTERING * products.mean(axis=1, keepdims=True)
        unsolved = products.max(axis=1, keepdims=True) > _GAP
        if not unsolved.any():
            break
        scaling = 1 / (s + m * t / rest)
        matrix = hessian + transposed @ ((scaling * m)[..., None] * jacobian)
        matrix[:, diagonal, diagonal] += below / to_low + above / to_high
        shift = scaling * (target - m * s - m * (target / rest - t))
        residual = _times(hessian, d) + gradient - _times(transposed, m + shift) - target / to_low + target / to_high
        dd = np.linalg.solve(matrix, -residual[..., None])[..., 0]
        dm = shift - scaling * m * _times(jacobian, dd)
        dt = (target + t * dm) / rest - t
        dbelow = target / to_low - below - below / to_low * dd
        dabove = target / to_high - above + above / to_high * dd
        values = np.concatenate([s, t, m, rest, to_low, to_high, below, above], axis=1)
        changes = np.concatenate([_times(jacobian, dd) + dt, dt, dm, -dm, dd, -dd, dbelow, dabove], axis=1)
        fastest = np.max(-changes / values, axis=1, keepdims=True)
        length = unsolved * _TO_BOUNDARY / np.maximum(fastest, _TO_BOUNDARY)
        d, t, m = d + length * dd, t + length * dt, m + length * dm
        below, above = below + length * dbelow, above + length * dabove
    violation = np.maximum(-c - _times(jacobian, d), 0).sum(axis=1)
    return d, m, (d * (gradient + _times(hessian, d) / 2)).sum(axis=1) + penalty * violation


def _times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """The product of every start."""
    return (matrix @ vector[..., None])[..., 0]
