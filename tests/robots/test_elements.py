"""Small building blocks: scissor, spaces, vectors, quartic, Newton, fence."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation as ScipyRotation

import jaxscissor as js
from jaxscissor._engine import newton, numerics
from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.quartic import quartic_roots

angle = st.floats(-1.4, 1.4)
length = st.floats(0.1, 10.0)


@given(st.lists(length, min_size=1, max_size=5), st.floats(0.05, 1.5))
def test_bars_of_a_scissor_keep_their_lengths_and_reach_its_height(lengths, alpha):
    scissor = js.Scissor(jnp.array(lengths))
    width = 2 * lengths[0] * np.cos(alpha)
    assert float(scissor.height(width)) == pytest.approx(float(scissor.length) * np.sin(alpha), rel=1e-9)
    assert float(scissor.width(scissor.height(width))) == pytest.approx(width, rel=1e-6)
    ends = [*lengths, 0.0]
    bars = scissor.bars(width)
    for i, expected in enumerate(np.add(ends[:-1], ends[1:])):
        for a, b in bars[2 * i : 2 * i + 2]:
            assert float(jnp.linalg.norm(a - b)) == pytest.approx(expected, rel=1e-9)
    top = scissor.bars(width)[-1][1]
    assert np.abs(top - np.array([0, float(scissor.height(width))])).max() < 1e-9 * sum(lengths)


@given(st.integers(1, 6), length, st.floats(0.1, 1.4))
def test_an_open_scissor_of_equal_bars_extends_by_n_crosses(crosses, bar, alpha):
    """[NAV19 eqs. 27-28]: rho = n sqrt(l^2 - h^2) at width h."""
    scissor = js.Scissor(jnp.full(crosses + 1, bar / 2), end="open")
    width = bar * np.cos(alpha)
    assert float(scissor.height(width)) == pytest.approx(crosses * np.sqrt(bar**2 - width**2), rel=1e-9)
    left, axis = scissor.nodes(width)
    assert len(axis) == crosses and float(left[-1, 1]) == pytest.approx(float(scissor.height(width)), rel=1e-9)


def test_gain_is_the_derivative_of_the_height():
    scissor = js.Scissor([18.0, 14.0, 11.0])
    for width in (5.0, 20.0, 30.0):
        assert float(scissor.gain(width)) == pytest.approx(float(jax.grad(scissor.height)(width)), rel=1e-12)
    assert float(scissor.gain(36.0)) == 0.0 and float(jax.grad(scissor.height)(36.0)) == 0.0
    with pytest.raises(ValueError, match="'apex' or 'open'"):
        js.Scissor([1.0, 1.0], end="closed")
    with pytest.raises(ValueError, match="at least 2"):
        js.Scissor([1.0], end="open")


@given(angle, angle, angle)
def test_roll_pitch_yaw_is_that_of_scipy_and_comes_back(roll, pitch, yaw):
    pose = jnp.array([0.1, 0.2, 0.3, roll, pitch, yaw])
    position, rotation = js.SE3.place(pose)
    expected = ScipyRotation.from_euler("XYZ", [roll, pitch, yaw]).as_matrix()
    assert np.abs(rotation.array() - expected).max() < 1e-14
    assert np.abs(jnp.stack(js.SE3.coordinates(position, rotation)) - pose).max() < 1e-12


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_the_locked_pitch_gives_a_finite_pose_of_the_same_rotation(pitch):
    position, rotation = js.SE3.place(jnp.array([0, 0, 0, 0.4, pitch, 0.3]))
    again = jnp.stack(js.SE3.coordinates(position, rotation))
    assert np.abs(js.SE3.place(again)[1].array() - rotation.array()).max() < 1e-12


@given(st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6))
def test_retraction_is_the_exponential_and_its_rates_are_the_twist(twist):
    pose = jnp.array([0.1, 0.2, 0.3, 0.4, -0.5, 0.6])
    position, rotation = js.SE3.place(pose)
    moved, turned = js.SE3.retract(position, rotation, list(jnp.array(twist)))
    expected = ScipyRotation.from_rotvec(twist[3:]).as_matrix() @ np.asarray(rotation.array())
    assert np.abs(turned.array() - expected).max() < 1e-13
    assert np.abs(moved.array() - position.array() - jnp.array(twist[:3])).max() < 1e-15

    def step(t):
        return jnp.stack(js.SE3.coordinates(*js.SE3.retract(position, rotation, list(t * jnp.array(twist)))))

    rates = jax.jacfwd(step)(jnp.zeros(()))
    assert np.abs(js.SE3.rates_to_twist(pose) @ rates - jnp.array(twist)).max() < 1e-12


def test_guards_are_finite_with_their_derivatives_at_the_singular_value():
    for dtype in (jnp.float32, jnp.float64):
        zero = jnp.zeros((), dtype)
        assert jax.grad(numerics.safe_sqrt)(zero) == 0 and numerics.safe_sqrt(-zero - 1) == 0
        assert jax.grad(lambda x: numerics.safe_divide(x, x))(zero) == 0
    low, high = numerics.limit_margins(jnp.float64(0.3), 0.0, jnp.inf, 2.0)
    assert low == 0.15 and high == jnp.inf
    slope = jax.grad(lambda s: numerics.smallest(numerics.limit_margins(0.3, 0.0, jnp.inf, s)))(2.0)
    assert slope == pytest.approx(-0.075)


@given(st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=4))
def test_quartics_with_real_roots(roots):
    roots = np.sort(roots)
    coefficients = np.poly(roots)[1:]
    found, real = quartic_roots(*(jnp.float64(c) for c in coefficients))
    apart = np.diff(roots).min()
    if apart > 1e-2:
        assert all(bool(r) for r in real)
        assert np.abs(np.sort(np.stack(found)) - roots).max() < 1e-8 / apart**2


@given(st.floats(-2, 2), st.floats(0.05, 2), st.floats(-2, 2), st.floats(0.05, 2))
def test_quartics_without_real_roots(a, b, c, d):
    coefficients = np.poly([a + 1j * b, a - 1j * b, c + 1j * d, c - 1j * d]).real[1:]
    _, real = quartic_roots(*(jnp.float64(v) for v in coefficients))
    assert not any(bool(r) for r in real)


def circle(unknowns, args):
    x, y = unknowns
    radius, slope = args
    return x**2 + y**2 - radius**2, y - slope * x


def test_newton_and_its_implicit_derivatives_of_every_order():
    def root(args):
        start = (jnp.float64(2.0), jnp.float64(1.0))
        state, error, _ = newton.newton(circle, start, args, tol=1e-14, max_steps=30)
        return newton.implicit(circle, state, error <= 1e-14, args)[0]

    args = (jnp.float64(1.5), jnp.float64(0.5))

    def exact(a):
        return a[0] / jnp.sqrt(1 + a[1] ** 2)

    assert abs(root(args) - exact(args)) < 1e-14
    for transform in (jax.grad, jax.jacfwd, jax.jacrev, jax.hessian, lambda f: jax.jacrev(jax.grad(f))):
        ours, truth = jax.tree.leaves(transform(root)(args)), jax.tree.leaves(transform(exact)(args))
        assert all(abs(a - b) < 1e-12 for a, b in zip(ours, truth, strict=True))


def test_lanes_do_not_disturb_each_other():
    def solve(radius):
        state, error, steps = newton.newton(circle, (1.0, 1.0), (radius, 0.5), tol=1e-14, max_steps=30)
        return state[0], steps, error

    alone = solve(jnp.float64(1.5))
    together = jax.vmap(solve)(jnp.array([1.5, jnp.nan, 40.0]))
    assert together[0][0] == alone[0] and together[1][0] == alone[1]
    assert jnp.isnan(together[2][1]) and together[1][1] == 0


def test_least_squares_finds_the_closest_and_fold_distance_the_margin():
    def parabola(unknowns, level):
        return (unknowns[0] ** 2 - level,)

    (closest,) = newton.least_squares(parabola, (jnp.float64(1.0),), jnp.float64(-0.3))
    assert abs(closest) < 1e-4
    for level in (0.5, 0.01, 1e-6):
        distance = newton.fold_distance(parabola, (jnp.sqrt(jnp.float64(level)),), jnp.float64(level))
        assert float(distance) == pytest.approx(level, rel=1e-9), "exact for a parabola"


def test_the_fence_is_the_identity_in_every_derivative():
    def f(x):
        return jnp.sum(fence(jnp.sin(x)) * x)

    def g(x):
        return jnp.sum(jnp.sin(x) * x)

    x = jnp.array([0.3, jnp.inf, -2.0])[::2]
    for transform in (lambda h: h, jax.grad, jax.jacfwd, jax.hessian, lambda h: jax.jacrev(jax.jacrev(h))):
        assert np.abs(transform(f)(x) - transform(g)(x)).max() < 1e-15
        assert np.abs(jax.jit(jax.vmap(transform(f)))(x[None])[0] - transform(g)(x)).max() < 1e-15
    infinite = jnp.array([jnp.inf, 1.0])
    assert (jax.jit(fence)(infinite) == infinite).all(), "the loop ends"
    lowered = jax.jit(jax.vmap(lambda v: fence(jnp.sin(v)) * 2)).lower(jnp.ones(1000)).compile().as_text()
    assert " while(" in lowered, "the compiler has not seen through it"
