"""Laws of time against closed forms, and against a linear program."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import linprog

import jaxscissor as js
from tests.motion.oracles import slides

V, A = np.array([0.5, 0.6, 0.4]), np.array([1.0, 0.8, 1.2])


def curve(n=101):
    """Slides of the linear delta on three quarters of a circle with a rise: all joints turn back on the way."""
    s = np.linspace(0, 1, n)
    return slides(np.stack([0.3 * np.cos(4.5 * s), 0.3 * np.sin(4.5 * s), 0.2 * s**2], axis=1))


def derivatives(path):
    """Of the parabolas through three neighbors."""
    slope, bend = np.zeros_like(path), np.zeros_like(path)
    for i in range(len(path)):
        j = min(max(i, 1), len(path) - 2)
        c = np.polynomial.polynomial.polyfit([-1, 0, 1], path[j - 1 : j + 2], 2)
        slope[i], bend[i] = c[1] + 2 * c[2] * (i - j), 2 * c[2]
    return slope, bend


def both_sides(path, law):
    """Accelerations just before and just after every sample, from the speeds alone."""
    slope, bend = derivatives(path)
    squares = np.asarray(law.speed) ** 2
    push = np.diff(squares) / 2
    before = slope[1:] * push[:, None] + bend[1:] * squares[1:, None]
    after = slope[:-1] * push[:, None] + bend[:-1] * squares[:-1, None]
    return before, after


LAW = js.motion.time_parametrize


@pytest.mark.parametrize("way", [3.0, 0.5])
def test_a_straight_way_takes_a_trapezoid_or_a_triangle(way):
    path = np.outer(np.linspace(0, 1, 801), [way, -way / 2])
    law = LAW(path, max_velocity=1.0, max_acceleration=2.0)
    # v / a to full speed if there is way enough
    expected = way / 1.0 + 1.0 / 2.0 if way > 0.5 else 2 * np.sqrt(way / 2.0)
    assert float(law.times[-1]) == pytest.approx(expected, rel=2e-5)
    t = np.asarray(law.times)
    rise = np.minimum(t, t[-1] - t)
    np.testing.assert_allclose(law.velocities[:, 0], np.minimum(1.0, 2 * rise), atol=0.01)


def test_no_limit_is_exceeded_and_one_is_always_reached():
    path = curve()
    law = LAW(path, max_velocity=V, max_acceleration=A)
    before, after = both_sides(path, law)
    np.testing.assert_allclose(law.accelerations[:-1], after, atol=1e-12)
    np.testing.assert_allclose(law.accelerations[-1], before[-1], atol=1e-12)
    limits = [np.abs(law.velocities[1:-1]) / V, np.abs(before) / A, np.abs(after) / A]
    used = np.stack([limits[0].max(axis=1), limits[1][:-1].max(axis=1), limits[2][1:].max(axis=1)])
    assert max(limit.max() for limit in limits) < 1 + 1e-9
    # but at the samples where one limit hands over to another, a number that does not grow with that of the samples
    idle = used.max(axis=0) < 1 - 1e-9
    assert idle.sum() <= 6 and used.max(axis=0).min() > 0.9 and set(used.argmax(axis=0)) == {0, 1, 2}
    assert law.speed[0] == law.speed[-1] == 0 and (np.diff(law.times) > 0).all()


def test_the_joints_move_so_in_time():
    """Differences in time of the path give the velocities and the accelerations."""
    path = curve(801)
    law = LAW(path, max_velocity=V, max_acceleration=A)
    times = np.asarray(law.times)
    inner = slice(5, -5)
    mean = np.diff(path, axis=0) / np.diff(times)[:, None]
    np.testing.assert_allclose(mean, (law.velocities[1:] + law.velocities[:-1]) / 2, atol=2e-3)
    grown = np.diff(mean, axis=0) / ((times[2:] - times[:-2]) / 2)[:, None]
    assert (np.abs(grown[inner]) / A).max() < 1.02


def test_no_law_is_faster():
    """The greatest squares of the speed by a linear program; both end at the fastest as the samples close up."""
    path = curve()
    law = LAW(path, max_velocity=V, max_acceleration=A)
    n, (slope, bend) = len(path), derivatives(path)
    rows = []
    for i in range(n - 1):
        for j in (i, i + 1):
            row = np.zeros((3, n))
            row[:, i + 1] += slope[j] / 2
            row[:, i] -= slope[j] / 2
            row[:, j] += bend[j]
            rows += [row / A[:, None], -row / A[:, None]]
    tops = ((V / np.maximum(np.abs(slope), 1e-12)) ** 2).min(axis=1)
    tops[[0, -1]] = 0
    matrix = np.concatenate(rows)
    best = linprog(-np.ones(n), matrix, np.ones(len(matrix)), bounds=np.stack([np.zeros(n), tops], axis=1))
    speed = np.sqrt(best.x)
    assert float(law.times[-1]) == pytest.approx((2 / (speed[1:] + speed[:-1])).sum(), rel=1e-5)


def test_a_path_that_was_cut_off_ends_at_rest_before_it():
    path = curve()
    whole = LAW(path[:61], max_velocity=V, max_acceleration=A)
    cut = LAW(np.where(np.arange(101)[:, None] < 61, path, np.nan), max_velocity=V, max_acceleration=A)
    for ours, theirs in zip(jax.tree.leaves(cut), jax.tree.leaves(whole), strict=True):
        np.testing.assert_allclose(ours[:61], theirs, rtol=1e-12, atol=1e-12)
        assert np.isnan(ours[61:]).all()
    none = LAW(np.full((101, 3), np.nan), max_velocity=V, max_acceleration=A)
    assert np.isnan(none.times).all()


def test_pauses_and_other_units_change_nothing():
    path = curve()
    law = LAW(path, max_velocity=V, max_acceleration=A)
    minutes = LAW(1e3 * path, max_velocity=60e3 * V, max_acceleration=3600e3 * A)  # millimetres, minutes
    np.testing.assert_allclose(60 * minutes.times, law.times, rtol=1e-12)
    rest = LAW(np.tile(path[:1], (5, 1)), max_velocity=V, max_acceleration=A)
    assert np.isfinite(rest.times).all()
    np.testing.assert_array_equal(rest.velocities, 0.0)


def test_batches_derivatives_and_single_precision():
    path = curve(41)

    def time(scale):
        return LAW(path * jnp.stack([1.0, 1.0, scale])[None], max_velocity=V, max_acceleration=A).times[-1]

    slope, several = jax.jit(lambda scales: (jax.grad(time)(scales[1]), jax.vmap(time)(scales)))(
        jnp.array([1.1 - 1e-6, 1.1, 1.1 + 1e-6])
    )
    assert float(several[2] - several[0]) / 2e-6 == pytest.approx(float(slope), rel=1e-5)
    alone = LAW(path * np.array([1.0, 1.0, 1.1]), max_velocity=V, max_acceleration=A).times[-1]
    assert float(several[1]) == pytest.approx(float(alone), rel=1e-13)
    single = LAW(path.astype(np.float32), max_velocity=jnp.asarray(V, np.float32), max_acceleration=1.0)
    double = LAW(path, max_velocity=V, max_acceleration=1.0)
    assert single.times.dtype == np.float32
    assert float(single.times[-1]) == pytest.approx(float(double.times[-1]), rel=1e-2)


def test_wrong_arguments_are_refused():
    with pytest.raises(ValueError, match="Got joints of shape"):
        LAW(curve(2), max_velocity=V, max_acceleration=A)
    with pytest.raises(ValueError, match="Got max_acceleration of shape"):
        LAW(curve(), max_velocity=V, max_acceleration=A[:2])
