"""Regions as tasks state them: sets of orientations, paths, volumes, against closed forms on the same rays."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from tests.toys import LinearDelta
from tests.workspace.test_ray_fraction import ring

BOX = js.Box([-0.9, -1.1, 0.0], [1.2, 1.0, 0.0])
ANGLES = np.array([[-0.3], [0.1], [0.5]])
RAYS = 1024


def aside():
    """The ring's reference point off the middle of the platform, so that a turn moves the ring."""
    robot = ring(0.4, 1.0)
    return dataclasses.replace(robot, platform=robot.platform + jnp.array([[0.3, 0.1]]))


def same_rays(robot, angles, box, need):
    """Each leg's foot, seen from the platform, is a center of two circles: chords on lines parallel to x."""
    u = js.Box([0.0, 0.0], [1.0, 1.0]).quasi_random(RAYS)[:][:, 0]
    y = (box.low[1] + (box.high[1] - box.low[1]) * u)[:, None, None]
    cos, sin = jnp.cos(angles), jnp.sin(angles)
    (p, b) = (points.T[:, None] for points in (robot.platform, robot.base))  # (2, 1, 3)
    center = jnp.stack([b[0] - cos * p[0] + sin * p[1], b[1] - sin * p[0] - cos * p[1]])[:, None]  # (2, 1, m, 3)
    half = [js.safe_sqrt(r**2 - (y - center[1]) ** 2) for r in robot.stroke]
    ends = jnp.concatenate([center[0] + sign * h for h in half for sign in (-1, 1)], axis=1).reshape(RAYS, -1)
    edges = jnp.broadcast_to(jnp.stack([box.low[0], box.high[0]]), (RAYS, 2))
    ends = jnp.sort(jnp.clip(jnp.concatenate([ends, edges], axis=1), box.low[0], box.high[0]), axis=1)
    middle = ((ends[:, 1:] + ends[:, :-1]) / 2)[:, :, None, None]
    length = jnp.hypot(middle - center[0][:, None], y[:, None] - center[1][:, None])
    held = jnp.all((length >= robot.stroke[0]) & (length <= robot.stroke[1]), axis=-1)
    inside = {"all": jnp.all, "any": jnp.any}[need](held, axis=-1)
    return jnp.mean(jnp.sum(jnp.where(inside, ends[:, 1:] - ends[:, :-1], 0), axis=1)) / (box.high[0] - box.low[0])


@pytest.mark.parametrize("need", ["all", "any"])
def test_a_planar_robot_with_a_set_of_angles_meets_rings_intersected_or_united(need):
    robot = aside()

    def found(robot, angles, box):
        return js.workspace.ray_fraction(robot, js.workspace.Dexterous(box, angles, need), rays=RAYS, cells=256)

    value, gradient = jax.value_and_grad(found, (0, 1, 2))(robot, jnp.asarray(ANGLES), BOX)
    known, expected = jax.value_and_grad(same_rays, (0, 1, 2))(robot, jnp.asarray(ANGLES), BOX, need)
    assert float(value) == pytest.approx(float(known), abs=1e-9)
    assert jnp.any(jnp.abs(expected[1]) > 1e-3)
    np.testing.assert_allclose(gradient[0].stroke, expected[0].stroke, rtol=1e-6)
    np.testing.assert_allclose(gradient[0].platform, expected[0].platform, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(gradient[1], expected[1], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(gradient[2].high[:2], expected[2].high[:2], rtol=1e-5, atol=1e-6)


MEASURES = {
    "hard": lambda robot, region: js.workspace.fraction(robot, region.quasi_random(20_000)),
    "soft": lambda robot, region: js.workspace.soft_fraction(robot, region.quasi_random(20_000)),
}


@pytest.mark.parametrize("name", MEASURES)
def test_one_orientation_is_the_constant_one_and_more_are_ordered(name):
    robot, measure = aside(), MEASURES[name]
    constant = measure(robot, js.Box(BOX.low.at[2].set(0.1), BOX.high.at[2].set(0.1)))
    single = measure(robot, js.workspace.Dexterous(BOX, ANGLES[1:2]))
    assert float(single) == pytest.approx(float(constant), abs=1e-14)
    with_all, with_any = (measure(robot, js.workspace.Dexterous(BOX, ANGLES, need)) for need in ("all", "any"))
    assert with_all + 0.02 < constant < with_any - 0.02


def test_a_position_counts_if_its_every_pose_is_reached(prototype):
    cylinder = js.Cylinder(prototype.length / 2, prototype.length)
    tilts = jnp.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.3, 0.1]])
    sample = js.workspace.Dexterous(cylinder, tilts).quasi_random(3000)
    margins = jax.vmap(jax.vmap(js.feasibility, (None, 0)), (None, 0))(prototype, sample[:]).margin
    assert margins.shape == (3000, 3)
    assert int((margins >= 0).all(axis=1).sum()) / 3000 == js.workspace.fraction(prototype, sample)


def test_derivatives_of_the_soft_fraction_with_a_set_agree_with_differences():
    def value(scale):
        robot = jax.tree.map(lambda leaf: leaf * scale, aside())
        return js.workspace.soft_fraction(robot, js.workspace.Dexterous(BOX, ANGLES).quasi_random(3000), sharpness=30.0)

    step = 1e-6
    values, slopes = jax.vmap(jax.value_and_grad(value))(1 + step * jnp.array([0.0, 1.0, -1.0]))
    assert float(slopes[0]) == pytest.approx(float(values[1] - values[2]) / (2 * step), rel=1e-6)


@pytest.mark.exhaustive
def test_a_path_is_reached_where_it_runs_in_the_ring():
    """Three legs of a path, crossing the ring's hole, its outside and its edge."""
    robot = ring(0.4, 1.0)
    corners = jnp.array([[-0.7, 0.1, 0.0], [0.8, 0.1, 0.0], [0.8, 1.5, 0.0], [0.0, 0.7, 0.0]])

    def known(stroke, corners):
        total = 0.0
        for a, b in zip(corners[:-1, :2], corners[1:, :2], strict=True):
            d = b - a
            half = [js.safe_sqrt((a @ d) ** 2 - (d @ d) * (a @ a - r**2)) / (d @ d) for r in stroke]
            low, high = ([jnp.clip(-(a @ d) / (d @ d) + s * h, 0, 1) for h in half] for s in (-1, 1))
            total += (high[1] - low[1]) - (high[0] - low[0])
        return total / 3

    def found(robot, corners):
        return js.workspace.ray_fraction(robot, js.workspace.PosePath(corners), cells=60)

    value, (by_robot, by_corners) = jax.value_and_grad(found, (0, 1))(robot, corners)
    expected, (by_stroke, by_places) = jax.value_and_grad(known, (0, 1))(robot.stroke, corners)
    assert float(value) == pytest.approx(float(expected), abs=1e-12) and 0.1 < value < 0.9
    np.testing.assert_allclose(by_robot.stroke, by_stroke, rtol=1e-7)
    np.testing.assert_allclose(by_corners[:, :2], by_places[:, :2], rtol=1e-6, atol=1e-7)
    sample = js.workspace.PosePath(corners).quasi_random(40_000)
    assert float(js.workspace.fraction(robot, sample)) == pytest.approx(float(expected), abs=1e-4)
    np.testing.assert_allclose(js.workspace.PosePath(corners).from_unit(jnp.ones(1)), corners[-1], rtol=1e-15)


@pytest.mark.exhaustive
def test_the_volume_of_the_ring_is_its_area_and_that_of_a_delta_needs_no_angle():
    robot = ring(0.4, 1.0)

    def area(stroke, side):
        box = js.Box(jnp.stack([-side, -side, 0.0]), jnp.stack([side, 1.1 * side, 0.0]))
        changed = dataclasses.replace(robot, stroke=stroke)
        return box.volume * js.workspace.ray_fraction(changed, box, rays=8192, axes=(0, 1))

    value, (by_stroke, by_side) = jax.value_and_grad(area, (0, 1))(robot.stroke, jnp.asarray(1.15))
    assert float(value) == pytest.approx(np.pi * (1 - 0.4**2), rel=2e-4)
    np.testing.assert_allclose(by_stroke, [-2 * np.pi * 0.4, 2 * np.pi], rtol=2e-3)
    assert abs(by_side) < 1e-3, "a larger box holds the same ring"
    whole = js.Box([-0.1] * 3, [0.2] * 3)
    assert float(whole.volume * js.workspace.ray_fraction(LinearDelta.example(), whole, rays=8)) == pytest.approx(
        0.3**3, rel=1e-12
    )


def test_volumes_are_products_of_the_extents_that_are_not_zero():
    turned = js.Cylinder(2.0, 3.0, ([0.0, -0.1, 0.0], [0.0, 0.1, 0.5]), measure="volume")
    assert float(turned.volume) == pytest.approx(12 * np.pi * 0.2 * 0.5)
    assert float(js.workspace.Dexterous(turned, [[0.1, 0.0, 0.0]]).volume) == float(turned.volume)
    assert float(js.Disc([1.0, 2.0], 2.0, -0.5, 1.0).volume) == pytest.approx(6 * np.pi)
    slope = jax.grad(lambda r: js.Cylinder(r, 3.0, measure="volume").volume)(2.0)
    assert float(slope) == pytest.approx(12 * np.pi)
    slopes = jax.grad(lambda box: box.volume)(js.Box([0.0, 1.0, 2.0], [2.0, 4.0, 2.0]))
    np.testing.assert_allclose(slopes.high, [3.0, 2.0, 0.0])
    with pytest.raises(ValueError, match="Pass measure='volume'"):
        _ = js.Cylinder(2.0, 3.0).volume
    with pytest.raises(ValueError, match="volume of a PosePath"):
        _ = js.workspace.PosePath(np.zeros((2, 3))).volume


CYLINDER = js.Cylinder(1.0, 1.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: js.workspace.Dexterous(CYLINDER, [0.0, 0.0, 0.0]), "Got orientations"),
        (lambda: js.workspace.Dexterous(CYLINDER, np.zeros((0, 3))), "at least one"),
        (lambda: js.workspace.Dexterous(CYLINDER, np.zeros((2, 6))), "k < 6"),
        (lambda: js.workspace.Dexterous(CYLINDER, np.zeros((2, 3)), require="most"), "require='most'"),
        (lambda: js.workspace.PosePath(np.zeros((1, 6))), "two or more"),
        (lambda: js.workspace.PosePath([np.zeros(6), np.zeros(3)]), "of one shape"),
        (
            lambda: js.workspace.fraction(ring(0.4, 1.0), js.workspace.Dexterous(BOX, [[0.0, 0.0]]).quasi_random(9)),
            "alpha",
        ),
        (lambda: js.workspace.fraction(ring(0.4, 1.0), np.zeros((2, 2, 3))), "Got poses of shape"),
        (lambda: js.workspace.fraction(ring(0.4, 1.0), BOX), "give a sample of it"),
        (lambda: js.workspace.ray_fraction(ring(0.4, 1.0), js.workspace.PosePath(np.zeros((2, 6)))), "region of poses"),
    ],
)
def test_impossible_tasks_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
