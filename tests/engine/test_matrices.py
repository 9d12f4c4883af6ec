"""Small matrices against NumPy's, their derivatives included."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor._engine import matrices
from tests.conftest import exhaustive
from tests.toys import ThreePRS

SHAPES = [(1, 1), (2, 1), (2, 2), (3, 2), (6, 3), (4, 4), (6, 6), (9, 9)]


def rows_of(matrix):
    return [list(row) for row in matrix]


def of_rank(rng, shape, rank):
    return rng.normal(size=(shape[0], rank)) @ rng.normal(size=(rank, shape[1]))


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 6, 7])
def test_systems_are_those_of_numpy(size, rng):
    matrix, rhs = rng.normal(size=(2, size, size))
    np.fill_diagonal(matrix, matrix.diagonal() if size == 1 else 0)  # no pivot where it would be looked for first
    solution = np.stack(jax.jit(matrices.solve)(rows_of(matrix), list(rhs[0])))
    scale = np.linalg.cond(matrix) * np.abs(solution).max()
    assert np.abs(solution - np.linalg.solve(matrix, rhs[0])).max() < 1e-14 * scale
    inverse = jax.jit(matrices.inverse)(matrix)
    assert np.abs(inverse @ matrix - np.eye(size)).max() < 1e-14 * np.linalg.cond(matrix)
    det = jax.jit(matrices.determinant)(rows_of(matrix))
    assert float(det) == pytest.approx(np.linalg.det(matrix), rel=1e-12)


@pytest.mark.parametrize("size", [2, 3, 4, 6, 7])
def test_what_is_singular_to_rounding_gives_zero_whatever_the_unit(size, rng):
    solve = jax.jit(jax.vmap(lambda rows, rhs: matrices.solve_regular(rows_of(rows), list(rhs), True)))
    regular, rhs = rng.normal(size=(5000, size, size)), rng.normal(size=(5000, size))
    left, right = (np.linalg.qr(rng.normal(size=(5000, size, size)))[0] for _ in range(2))
    sizes = np.append(rng.uniform(0.5, 1, size - 1), 0)  # else well conditioned, so that rounding is all that is left
    singular = left * sizes @ right
    rows, columns = 10 ** rng.uniform(-6, 6, (5000, size, 1)), 10 ** rng.uniform(-6, 6, (5000, 1, size))
    assert not np.asarray(solve(rows * singular * columns, rhs)[1]).any()
    assert np.asarray(solve(rows * regular * columns, rhs)[1]).all()
    exact = np.linalg.solve(regular, rhs[..., None])[..., 0]
    bound = 64 * np.finfo(float).eps * np.linalg.cond(regular) * np.linalg.norm(exact, axis=1)
    for unit in (1e-9, 1.0, 1e9):
        solution, ok = solve(unit * singular, rhs)
        assert not np.asarray(ok).any()
        assert not np.stack(solution, axis=1).any()
        solution, ok = solve(unit * regular, rhs)
        assert np.asarray(ok).all()
        assert (np.linalg.norm(unit * np.stack(solution, axis=1) - exact, axis=1) <= bound).all()


@pytest.mark.parametrize("size", [2, 3, 4, 6, 7])
def test_derivative_of_a_determinant_is_the_adjugate_at_any_rank(size, rng):
    slope = jax.jit(jax.grad(lambda matrix: matrices.determinant(rows_of(matrix))))
    for rank in range(size + 1):
        matrix = of_rank(rng, (size, size), rank)
        minors = [[np.linalg.det(np.delete(np.delete(matrix, i, 0), j, 1)) for j in range(size)] for i in range(size)]
        signs = (-1.0) ** np.add.outer(np.arange(size), np.arange(size))
        assert np.abs(slope(matrix) - signs * minors).max() < 1e-12 * max(1, np.abs(minors).max())


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_singular_values_are_those_of_numpy(shape, dtype, rng):
    repeated = np.linalg.qr(rng.normal(size=shape))[0]
    graded = rng.normal(size=shape) * 10.0 ** -np.arange(shape[1])
    low = [of_rank(rng, shape, rank) for rank in range(shape[1] + 1)]
    stack = np.stack([*rng.normal(size=(200, *shape)), *low, repeated, graded]).astype(dtype)
    values = np.asarray(jax.jit(jax.vmap(matrices.singular_values))(stack), float)
    expected = np.linalg.svd(stack.astype(float), compute_uv=False)
    eps = np.finfo(dtype).eps
    assert np.abs(values - expected).max(axis=1).max() < 16 * eps * expected.max()
    null = np.asarray(jax.jit(jax.vmap(matrices.null_vector))(stack), float)
    assert np.abs(np.linalg.norm(null, axis=1) - 1).max() < 16 * eps
    left = np.linalg.norm(np.einsum("bij,bj->bi", stack.astype(float), null), axis=1)
    assert np.abs(left - expected[:, -1]).max() < 16 * eps * expected.max()


def test_singular_values_keep_their_digits_in_badly_scaled_columns(rng):
    matrix = rng.normal(size=(6, 3))
    scaled = matrix * np.array([1.0, 1e-7, 1e-14])
    product = np.prod(matrices.singular_values(scaled))
    assert product == pytest.approx(np.prod(np.linalg.svd(matrix, compute_uv=False)) * 1e-21, rel=1e-12)


@pytest.mark.parametrize("shape", [(2, 1), (3, 3), (6, 3)], ids=str)
def test_derivatives_of_singular_values_agree(shape, rng):
    matrix, toward = rng.normal(size=(2, *shape))
    forward = jax.jvp(matrices.singular_values, (matrix,), (toward,))[1]
    reverse = np.einsum("kij,ij->k", jax.jacrev(matrices.singular_values)(jnp.asarray(matrix)), toward)
    up, down = (np.linalg.svd(matrix + h * toward, compute_uv=False) for h in (1e-6, -1e-6))
    assert np.abs(forward - reverse).max() < 1e-14
    assert np.abs(forward - (up - down) / 2e-6).max() < 1e-8


@pytest.mark.parametrize(
    "build", [js.NavaroII.prototype, *exhaustive(js.TripleScissorExtender.prototype, ThreePRS.example)]
)
def test_no_batched_program_calls_lapack(build):
    robot = build()
    pose, joints = robot.home()
    for function, *args in (
        (js.forward_kinematics, robot.actuated(joints)),
        (js.singularities.measures, pose),
        (js.inverse_jacobian, pose),
        (js.gear_ratios, pose),
        (js.design.pose_sensitivity, pose),
    ):
        program = jax.jit(jax.vmap(partial(function, robot))).lower(*(jnp.stack([x, x]) for x in args))
        assert "lapack" not in program.as_text(), function.__name__


def test_large_systems_are_solved_in_loops_as_by_numpy(rng):
    table, right = rng.normal(size=(20, 12, 12)), rng.normal(size=(20, 12))
    table[0, :, 3], table[1] = table[0, :, 5], 0
    solve = jax.jit(jax.vmap(lambda a, b: matrices.solve_regular(list(map(list, a)), list(b))))
    found, regular = solve(jnp.asarray(table), jnp.asarray(right))
    assert regular.tolist() == [False, False, *[True] * 18]
    expected = np.linalg.solve(table[2:], right[2:, :, None])[..., 0]
    np.testing.assert_allclose(np.stack(found, 1)[2:], expected, rtol=1e-9)
    assert not np.stack(found, 1)[:2].any()
    signs = jax.jit(jax.vmap(lambda a: matrices.determinant_sign(list(map(list, a)))))(jnp.asarray(table))
    np.testing.assert_array_equal(signs, [0, 0, *np.linalg.slogdet(table[2:])[0]])
    one, b = jnp.asarray(table[3]), jnp.asarray(right[3])
    by_right = jax.grad(lambda b: sum(matrices.solve_regular(list(map(list, one)), list(b))[0]))(b)
    np.testing.assert_allclose(by_right, np.linalg.solve(table[3].T, np.ones(12)), rtol=1e-9)
