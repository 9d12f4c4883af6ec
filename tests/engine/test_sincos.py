"""Sine and cosine of an angle against those of NumPy and their own derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxscissor._engine.cpu.sincos import sine_cosine

EPS = np.finfo(float).eps
both = jax.jit(sine_cosine)


@given(st.floats(-1e6, 1e6) | st.floats(-10, 10) | st.integers(-1000, 1000).map(lambda k: k * np.pi / 4))
def test_both_are_those_of_numpy_to_the_last_bit(angle):
    sine, cosine = both(jnp.float64(angle))
    assert abs(sine - np.sin(angle)) <= EPS and abs(cosine - np.cos(angle)) <= EPS
    assert float(both(jnp.float64(-angle))[0]) == -float(sine)


def test_a_dense_grid_is_right_in_both_precisions():
    angles = np.linspace(-20, 20, 400_001)
    for dtype in (np.float32, np.float64):
        found = jnp.stack(both(jnp.asarray(angles, dtype)))
        exact = np.stack([np.sin(angles.astype(dtype), dtype=float), np.cos(angles.astype(dtype), dtype=float)])
        assert found.dtype == dtype and np.abs(np.asarray(found, float) - exact).max() <= np.finfo(dtype).eps
    small = np.logspace(-300, -8, 100)
    assert np.abs(both(jnp.asarray(small))[0] / np.sin(small) - 1).max() <= EPS


@pytest.mark.parametrize("angle", [1e8, -3e12, 1e18, 1e300])
def test_huge_angles_lose_no_more_digits_than_they_have_and_stay_bounded(angle):
    found = np.stack(both(jnp.float64(angle)))
    exact = np.array([np.sin(angle), np.cos(angle)])
    assert np.abs(found - exact).max() <= min(2, 2 * EPS * abs(angle))


def test_no_angle_has_neither():
    assert np.isnan(np.stack([both(jnp.float64(x)) for x in (np.nan, np.inf, -np.inf)])).all()


def test_derivatives_of_every_order_are_each_other():
    for order in range(4):
        sine = lambda x: sine_cosine(x)[0]  # noqa: E731
        for _ in range(order):
            sine = jax.grad(sine)
        assert float(sine(jnp.float64(0.7))) == pytest.approx(np.sin(0.7 + order * np.pi / 2), abs=2 * EPS)
