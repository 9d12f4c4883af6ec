"""The hard workspace measure along rays: against closed forms, differences, and counts of poses."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from tests.conftest import ALL, exhaustive
from tests.toys import LinearDelta

RAYS = 4096


def ring(low, high):
    """Base and platform alike and not turned against each other: all legs have the length |(x, y)|."""
    corners = [[np.cos(a), np.sin(a)] for a in (0, 2 * np.pi / 3, 4 * np.pi / 3)]
    triangle = 0.8025 / np.sqrt(2) * np.array(corners)
    return js.NavaroII(triangle, triangle, (low, high))


def ring_along_the_same_rays(stroke, box):
    """Each line parallel to x meets the ring in a chord of the outer circle less one of the inner."""
    u = js.Box([0.0, 0.0], [1.0, 1.0]).quasi_random(RAYS)[:][:, 0]
    y = box.low[1] + (box.high[1] - box.low[1]) * u
    inner, outer = (js.safe_sqrt(r**2 - y**2) for r in stroke)
    lengths = [jnp.clip(half, box.low[0], box.high[0]) for half in (outer, -outer, inner, -inner)]
    return jnp.mean(lengths[0] - lengths[1] - lengths[2] + lengths[3]) / (box.high[0] - box.low[0])


@pytest.mark.parametrize("stroke", [(0.4, 1.0), (0.8, 0.805)], ids=["wide", "a seventh of a cell"])
def test_a_ring_has_two_components_a_hole_and_a_known_measure(stroke):
    robot, box = ring(*stroke), js.Box([-0.9, -1.1, 0.0], [1.2, 1.0, 0.0])
    value, (by_robot, by_box) = jax.value_and_grad(js.workspace.ray_fraction, (0, 1))(robot, box, rays=RAYS)
    known, (by_stroke, by_edges) = jax.value_and_grad(ring_along_the_same_rays, (0, 1))(robot.stroke, box)
    assert abs(value - known) < 1e-13
    np.testing.assert_allclose(by_robot.stroke, by_stroke, rtol=1e-6)
    largest = float(jnp.max(jnp.abs(by_stroke)))
    np.testing.assert_allclose(by_box.low[:2], by_edges.low[:2], atol=1e-6 * largest)
    np.testing.assert_allclose(by_box.high[:2], by_edges.high[:2], atol=1e-6 * largest)
    assert abs(by_robot.base.sum(axis=0)[0] + by_box.low[0] + by_box.high[0]) < 1e-6  # all moved: nothing moved


@pytest.mark.exhaustive
def test_rays_converge_to_the_area_of_the_ring_and_its_circumferences():
    robot, box = ring(0.4, 1.0), js.Box([-1.1, -1.2, 0.0], [1.2, 1.1, 0.0])
    errors = []
    for rays in (4096, 65_536):
        value, gradient = jax.value_and_grad(js.workspace.ray_fraction)(robot, box, rays=rays, axes=(0, 1))
        known = np.pi / 2.3**2 * np.array([1.0**2 - 0.4**2, -2 * 0.4, 2 * 1.0])
        errors.append(np.abs(np.array([value, *gradient.stroke]) - known))
    assert (errors[0] < [1e-4, 1e-3, 1e-3]).all() and (errors[1] < [5e-6, 5e-5, 5e-5]).all()


def test_forward_and_reverse_mode_agree():
    robot, box = ring(0.4, 1.0), js.Box([-0.9, -1.1, 0.0], [1.2, 1.0, 0.0])
    forward = jax.jacfwd(js.workspace.ray_fraction)(robot, box, rays=RAYS)
    reverse = jax.grad(js.workspace.ray_fraction)(robot, box, rays=RAYS)
    for a, b in zip(jax.tree.leaves(forward), jax.tree.leaves(reverse), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)


def test_folds_without_a_closed_form_are_crossed_and_moved():
    """A linear delta reaches as far as its rods over all three feet, and below as its slides go down."""
    robot, box = LinearDelta.example(), js.Box([-1.0, -1.0, -0.6], [1.0, 1.0, 0.6])

    def known(robot):
        u = js.Box([0.0, 0.0], [1.0, 1.0]).quasi_random(RAYS)[:]
        y, z = 2 * u[:, 0] - 1, 1.2 * u[:, 1] - 0.6
        low, high = jnp.full(RAYS, -1.0), jnp.full(RAYS, 1.0)
        for angle in (0.0, 2 * np.pi / 3, 4 * np.pi / 3):
            foot = robot.radius * np.cos(angle), robot.radius * np.sin(angle)
            half2 = robot.rod**2 - jnp.minimum(z, 0) ** 2 - (y - foot[1]) ** 2
            half = jnp.where(half2 > 0, js.safe_sqrt(half2), -jnp.inf)
            low, high = jnp.maximum(low, foot[0] - half), jnp.minimum(high, foot[0] + half)
        return jnp.mean(jnp.where(high > low, high - low, 0)) / 2, jnp.min(jnp.abs(high - low))

    value, gradient = jax.value_and_grad(js.workspace.ray_fraction)(robot, box, rays=RAYS)
    (expected, narrowest), by_robot = jax.value_and_grad(known, has_aux=True)(robot)
    assert narrowest > 1e-3, "nothing that rays need not see"
    assert abs(value - expected) < 1e-12
    assert float(gradient.rod) == pytest.approx(float(by_robot.rod), rel=1e-6)
    assert float(gradient.radius) == pytest.approx(float(by_robot.radius), rel=1e-6)


REGIONS = {
    "tse_prototype": (js.Cylinder(1.727 / 2, 1.727), 0),
    "stewart_gough": (None, 0),
    "tri_scott_skewed": (None, 0),
    "three_prs": (None, 2),
}


def region_of(name, robot):
    if REGIONS[name][0] is not None:
        return REGIONS[name][0]
    home, turns = np.asarray(robot.home()[0]), robot.space.dimension - robot.space.translations
    reach = np.array([0.45 * float(robot.length)] * robot.space.translations + [0.3] * turns)
    return js.Box(home - 0.93 * reach, home + reach)


@pytest.mark.exhaustive
def test_designs_measured_together_and_each_alone_agree():
    region = js.Box([-1.0, -1.0, -0.6], [1.0, 1.0, 0.6])
    measure = partial(js.workspace.ray_fraction, region=region, rays=256, axes=(2,), cells=48)
    designs = jax.tree.map(lambda leaf: leaf * jnp.linspace(0.99, 1.01, 5), LinearDelta.example())
    alone = [measure(jax.tree.map(lambda leaf, i=i: leaf[i], designs)) for i in range(5)]
    np.testing.assert_allclose(jax.vmap(measure)(designs), alone, rtol=1e-13)


@pytest.mark.parametrize("name", exhaustive("tse_prototype", "three_prs", "stewart_gough", "tri_scott_skewed"))
def test_derivatives_agree_with_differences_of_a_batch_of_designs(name, rng):
    robot, axis = ALL[name](), REGIONS[name][1]
    region = region_of(name, robot)
    way = jax.tree.map(lambda leaf: jnp.where(jnp.isfinite(leaf), leaf, 0) * rng.normal(size=leaf.shape), robot)
    steps = 2e-6 * jnp.array([0.0, 1.0, -1.0, 0.5, -0.5])
    designs = jax.vmap(lambda step: jax.tree.map(lambda leaf, d: leaf + step * d, robot, way))(steps)
    tuned = jax.vmap(
        jax.value_and_grad(lambda r: js.workspace.ray_fraction(r, region, rays=256, axes=(axis,), cells=48))
    )
    values, gradients = tuned(designs)
    wide, narrow = (values[1] - values[2]) / 4e-6, (values[3] - values[4]) / 2e-6
    products = jax.tree.map(lambda g, d: jnp.sum(g[0] * d), gradients, way)
    assert 0.05 < values[0] < 0.95
    assert float(sum(jax.tree.leaves(products))) == pytest.approx(float(4 * narrow - wide) / 3, rel=1e-6)
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(gradients))


@pytest.mark.exhaustive
def test_the_prototype_reaches_the_same_part_whichever_way_the_rays_run(prototype):
    cylinder = js.Cylinder(prototype.length / 2, prototype.length)
    hard = float(js.workspace.fraction(prototype, cylinder.quasi_random(200_000, seed=1)))
    for axis in (0, 2):
        assert js.workspace.ray_fraction(prototype, cylinder, rays=4000, axes=(axis,)) == pytest.approx(hard, abs=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"region": js.Disc([0.0, 0.0], 1.0, 0.0, 1.0)}, "region of poses"),
        ({"axes": (3,)}, "axes 0 to 2"),
        ({"axes": ()}, "axes 0 to 2"),
        ({"region": js.Box([0, 0, 0.8, 0, 0, 0], [0.1, 0.1, 0.8, 0, 0, 0]), "axes": (0, 2)}, r"no extent along \[2\]"),
        ({"rays": 0}, "at least one"),
        ({"cells": 0}, "at least one"),
    ],
)
def test_what_cannot_be_measured_is_refused(change, message, prototype):
    arguments = {"region": js.Cylinder(1.0, 1.0), **change}
    with pytest.raises(ValueError, match=message):
        js.workspace.ray_fraction(prototype, **arguments)
