"""Worst cases over regions and the strokes that tasks need, against closed forms and dense sampling."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js

RIGHT = np.pi / 2


def test_stroke_of_the_papers_regular_workspace():
    """[NAV19 eqs. 13-26]: r_min = 20 sqrt 3 - 25 and r_max = 25 + 10 sqrt 30."""
    disc = js.Disc([45.0, 15 * np.sqrt(3)], 25.0, -RIGHT, RIGHT)
    needed = js.workspace.joint_range(js.NavaroII.prototype(), disc)
    assert np.abs(needed.low[1::2] - (20 * np.sqrt(3) - 25)).max() < 1e-10
    assert np.abs(needed.high[1::2] - (25 + 10 * np.sqrt(30))).max() < 1e-10


def random_robots(rng, n):
    """Bases and platforms of any shape, not similar to each other."""
    base = np.array([[0, 0], [90, 0], [45, 78]]) + rng.uniform(-15, 15, (n, 3, 2))
    platform = rng.uniform(6, 20, (n, 3, 1)) * np.stack(
        [np.stack([np.cos(a), np.sin(a)], -1) for a in np.array([3.7, 5.7, 1.6]) + rng.uniform(-0.5, 0.5, (n, 3))]
    )
    robots = [js.NavaroII(a, b) for a, b in zip(base, platform, strict=True)]
    return base, platform, jax.tree.map(lambda *leaves: jnp.stack(leaves), *robots)


@pytest.mark.exhaustive
def test_strokes_of_ten_robots_of_any_shape_against_dense_sampling(rng):
    base, platform, robots = random_robots(rng, 10)
    center, radius, turn = np.mean(base, axis=1), rng.uniform(5, 20, 10), rng.uniform(0.3, 1.5, 10)
    discs = [js.Disc(*one) for one in zip(center, radius, -turn, turn, strict=True)]
    needed = jax.vmap(js.workspace.joint_range)(robots, jax.tree.map(lambda *leaves: jnp.stack(leaves), *discs))
    for i in range(10):
        alpha = np.linspace(-turn[i], turn[i], 201)[:, None, None]
        angle, r = np.linspace(0, 2 * np.pi, 361)[:, None], radius[i] * np.linspace(0, 1, 21)
        position = center[i] + np.stack([r * np.cos(angle), r * np.sin(angle)], axis=-1)
        for leg in range(3):
            x, y = platform[i, leg]
            corner = np.stack([np.cos(alpha) * x - np.sin(alpha) * y, np.sin(alpha) * x + np.cos(alpha) * y], axis=-1)
            rho = np.linalg.norm(position + corner - base[i, leg], axis=-1)
            low, high = needed.low[i, 1 + 2 * leg], needed.high[i, 1 + 2 * leg]
            spacing = 2 * np.pi / 360 * radius[i] + radius[i] / 20 + turn[i] / 100 * np.hypot(x, y)
            assert rho.min() - spacing < low < rho.min() + 1e-9
            assert rho.max() - 1e-9 < high < rho.max() + 0.01


def test_a_joint_range_differentiates_as_its_differences():
    robot, center = js.NavaroII.prototype(), [45.0, 15 * np.sqrt(3)]

    def greatest(numbers):
        return js.workspace.joint_range(robot, js.Disc(center, numbers[0], -RIGHT, numbers[1])).high[1]

    at, step = jnp.array([25.0, 0.4]), 1e-4
    differences = [(greatest(at + step * e) - greatest(at - step * e)) / (2 * step) for e in jnp.eye(2)]
    forward, reverse = jax.jacfwd(greatest)(at), jax.jacrev(greatest)(at)
    assert np.abs(forward - reverse).max() < 1e-12
    assert np.abs(reverse - np.array(differences)).max() < 1e-6


def test_angles_are_unwrapped_about_home():
    """Leg 1 of NaVARo II's disc turns about 30 deg, leg 2 about 150 deg, leg 3 about -90 deg."""
    robot = js.NavaroII.prototype()
    needed = js.workspace.joint_range(robot, js.Disc([45.0, 15 * np.sqrt(3)], 10.0, -0.1, 0.1))
    middle = np.degrees((needed.low + needed.high)[::2] / 2)
    assert np.abs(np.mod(middle - [30, 150, -90] + 180, 360) - 180).max() < 20
    assert np.degrees((needed.high - needed.low)[::2]).max() < 60


@pytest.mark.parametrize("kink", [(0.3, -0.2, 0.1), (2.0, 0.0, -2.0)])
def test_minimum_of_a_function_with_an_edge(kink):
    """The distance from a point, in the region or beside it, has no derivative at its least."""
    robot, region = js.NavaroII.prototype(), js.Box([-1.0, -1.0, -1.0], [1.0, 1.0, 1.0])
    found = js.workspace.worst_over(robot, lambda robot, pose: jnp.sum(jnp.abs(pose - jnp.array(kink))), region)
    nearest = np.clip(kink, -1, 1)
    assert np.abs(found.pose - nearest).max() < 1e-7
    assert abs(float(found.value) - np.abs(nearest - np.array(kink)).sum()) < 1e-7


def test_nan_is_never_the_least_and_each_entry_has_a_search_of_its_own():
    region = js.Box([-1.0, -1.0, -1.0], [1.0, 1.0, 1.0])

    def quantity(robot, pose):
        return jnp.stack([jnp.where(pose[0] < 0.25, jnp.nan, pose[0]), robot.length * pose[1] - pose[2]])

    def least(robot):
        return js.workspace.worst_over(robot, quantity, region)

    robot = js.NavaroII.prototype()
    found = least(robot)
    assert 0.25 <= float(found.value[0]) < 0.25 + 1e-9
    assert float(found.value[1]) == pytest.approx(-91, abs=1e-9) and found.pose.shape == (2, 3)
    np.testing.assert_allclose(found.pose[1, 1:], [-1, 1], atol=1e-9)
    slopes = jax.grad(lambda robot: least(robot).value[1])(robot)  # that of the quantity where it is least
    expected = jax.grad(lambda robot: -robot.length)(robot)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-9), slopes, expected)


def test_counts_that_make_no_search_are_refused():
    with pytest.raises(ValueError, match="1 <= starts <= samples"):
        js.workspace.worst_over(
            js.NavaroII.prototype(),
            lambda robot, pose: pose[0],
            js.Disc([0.0, 0.0], 1.0, 0.0, 0.0),
            samples=4,
            starts=5,
        )
    with pytest.raises(ValueError, match="1 <= starts <= samples"):
        js.workspace.joint_range(js.NavaroII.prototype(), js.Disc([0.0, 0.0], 1.0, 0.0, 0.0), starts=0)
