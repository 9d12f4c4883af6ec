"""Sequential quadratic programming on the problems of Hock and Schittkowski, beside two methods of SciPy."""

import math
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import Bounds, NonlinearConstraint, minimize

import jaxscissor as js
from jaxscissor.design._quadratic_program import Linearization, quadratic_program


def rosen_suzuki(x):
    a, b, c, d = x
    return a**2 + b**2 + 2 * c**2 + d**2 - 5 * a - 5 * b - 21 * c + 7 * d


def rosen_suzuki_constraints(x):
    a, b, c, d = x
    return jnp.stack(
        [
            8 - a**2 - b**2 - c**2 - d**2 - a + b - c + d,
            10 - a**2 - 2 * b**2 - c**2 - 2 * d**2 + a + d,
            5 - 2 * a**2 - b**2 - c**2 - 2 * a + b + d,
        ]
    )


def seven(x):
    a, b, c, d, e, f, g = x
    value = (a - 10) ** 2 + 5 * (b - 12) ** 2 + c**4 + 3 * (d - 11) ** 2 + 10 * e**6 + 7 * f**2 + g**4
    return value - 4 * f * g - 10 * f - 8 * g


def seven_constraints(x):
    a, b, c, d, e, f, g = x
    return jnp.stack(
        [
            127 - 2 * a**2 - 3 * b**4 - c - 4 * d**2 - 5 * e,
            282 - 7 * a - 3 * b - 10 * c**2 - d + e,
            196 - 23 * a - b**2 - 6 * f**2 + 8 * g,
            -4 * a**2 - b**2 + 3 * a * b - 2 * c**2 - 5 * f + 11 * g,
        ]
    )


def quadratic(x):
    a, b, c, d = x
    return a**2 + b**2 / 2 + c**2 + d**2 / 2 - a * c + c * d - a - 3 * b + c - d


def quadratic_constraints(x):
    a, b, c, d = x
    return jnp.stack([5 - a - 2 * b - c - d, 4 - 3 * a - b - 2 * c + d, b + 4 * c - 1.5])


ROOT = math.sqrt(3)
# number -> objective, constraints, start, low, high, least value [Hock and Schittkowski 1981]
PROBLEMS = {
    12: (
        lambda x: x[0] ** 2 / 2 + x[1] ** 2 - x[0] * x[1] - 7 * x[0] - 7 * x[1],
        lambda x: (25 - 4 * x[0] ** 2 - x[1] ** 2)[None],
        [0.0, 0.0],
        -10.0,
        10.0,
        -30.0,
    ),
    24: (
        lambda x: ((x[0] - 3) ** 2 - 9) * x[1] ** 3 / (27 * ROOT),
        lambda x: jnp.stack([x[0] / ROOT - x[1], x[0] + ROOT * x[1], 6 - x[0] - ROOT * x[1]]),
        [1.0, 0.5],
        0.0,
        10.0,
        -1.0,
    ),
    35: (
        lambda x: (
            9 - 8 * x[0] - 6 * x[1] - 4 * x[2] + 2 * x[0] ** 2 + 2 * x[1] ** 2 + x[2] ** 2 + 2 * x[0] * (x[1] + x[2])
        ),
        lambda x: (3 - x[0] - x[1] - 2 * x[2])[None],
        [0.5, 0.5, 0.5],
        0.0,
        10.0,
        1 / 9,
    ),
    37: (
        lambda x: -x[0] * x[1] * x[2],
        lambda x: jnp.stack([72 - x[0] - 2 * x[1] - 2 * x[2], x[0] + 2 * x[1] + 2 * x[2]]),
        [10.0, 10.0, 10.0],
        0.0,
        42.0,
        -3456.0,
    ),
    43: (rosen_suzuki, rosen_suzuki_constraints, [0.0] * 4, -10.0, 10.0, -44.0),
    76: (quadratic, quadratic_constraints, [0.5] * 4, 0.0, 10.0, -4.681818181),
    100: (seven, seven_constraints, [1.0, 2.0, 0.0, 4.0, 0.0, 1.0, 1.0], -10.0, 10.0, 680.6300573),
}


@pytest.mark.parametrize("number", PROBLEMS)
def test_problems_of_hock_and_schittkowski(number):
    objective, constraints, start, low, high, least = PROBLEMS[number]
    n = len(start)
    result = js.design.optimize(
        objective, jnp.array(start), bounds=(jnp.full(n, low), jnp.full(n, high)), steps=60, constraints=[constraints]
    )
    f, c = jax.jit(jax.value_and_grad(objective)), jax.jit(constraints)
    jacobian = jax.jit(jax.jacfwd(constraints))
    there = minimize(
        f,
        start,
        jac=True,
        method="SLSQP",
        bounds=[(low, high)] * n,
        constraints={"type": "ineq", "fun": c, "jac": jacobian},
        options={"ftol": 1e-10, "maxiter": 200},
    )
    assert there.status in (0, 8)  # 8: its line search finds nothing better than the solution
    value = float(objective(result.params))
    assert value == pytest.approx(least, rel=1e-8, abs=1e-8)
    charged = np.sum(result.multipliers.constraints * np.maximum(-np.asarray(c(there.x)), 0))  # for what it violates
    assert value <= there.fun + charged + 1e-8 * abs(least)
    np.testing.assert_allclose(result.params, there.x, atol=2e-4)
    assert float(c(result.params).min()) > -1e-7 and float(result.multipliers.stationarity) < 1e-4 * abs(least)


@pytest.mark.parametrize("number", [43, 76, 100])
def test_multipliers_are_those_of_trust_constr(number):
    objective, constraints, start, low, high, _ = PROBLEMS[number]
    n = len(start)
    result = js.design.optimize(
        objective, jnp.array(start), bounds=(jnp.full(n, low), jnp.full(n, high)), steps=60, constraints=[constraints]
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a quasi-Newton update that it leaves out
        there = minimize(
            jax.jit(jax.value_and_grad(objective)),
            result.params + 1e-3,
            jac=True,
            method="trust-constr",
            bounds=Bounds(np.full(n, low), np.full(n, high)),
            constraints=NonlinearConstraint(jax.jit(constraints), 0, np.inf, jac=jax.jit(jax.jacfwd(constraints))),
            options={"gtol": 1e-9, "xtol": 1e-11, "maxiter": 1000},
        )
    np.testing.assert_allclose(result.multipliers.constraints, -there.v[0], atol=1e-4)


def test_quadratic_programs_fulfil_the_conditions_of_optimality(rng):
    """Of 50 random programs in one call, with violations that cannot be avoided among them."""
    starts, n, m = 50, 6, 9
    factor = rng.normal(size=(starts, n, n))
    hessian = factor @ factor.transpose(0, 2, 1) + 0.1 * np.eye(n)
    at = Linearization(
        np.zeros(starts), rng.normal(size=(starts, n)), rng.normal(size=(starts, m)), rng.normal(size=(starts, m, n))
    )
    low, high, penalty = np.full((starts, n), -1.0), np.full((starts, n), 1.0), np.full(starts, 5.0)
    d, multipliers, _ = quadratic_program(at, hessian, low, high, penalty)
    c = at.constraints + (at.jacobian @ d[..., None])[..., 0]
    gradient = at.gradient + (hessian @ d[..., None])[..., 0]
    gradient -= (multipliers[:, None] @ at.jacobian)[:, 0]
    assert (multipliers > -1e-9).all() and (multipliers < 5 + 1e-9).all() and (np.abs(d) < 1 + 1e-8).all()
    assert np.abs(multipliers * np.maximum(c, 0)).max() < 1e-8  # zero where there is slack
    assert np.abs((5 - multipliers) * np.maximum(-c, 0)).max() < 1e-8  # the penalty where it is violated
    assert (np.maximum(-c, 0).sum(axis=1) > 0.1).any() and (np.maximum(-c, 0).sum(axis=1) < 1e-8).any()
    inside = np.abs(d) < 1 - 1e-6
    assert np.abs(np.where(inside, gradient, 0)).max() < 1e-6
    assert (np.where(d > 1 - 1e-6, gradient, -1) < 1e-6).all() and (np.where(d < -1 + 1e-6, gradient, 1) > -1e-6).all()
