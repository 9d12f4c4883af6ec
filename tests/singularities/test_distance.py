"""Distances to singularities: known ones, the nearest against any other way, and what surrounds a pose."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import jaxscissor as js
from tests.bound_robots import ThreeUPU
from tests.conftest import ALL, exhaustive
from tests.toys import ThreePRS

along = jax.jit(
    jax.vmap(lambda robot, pose, way: js.singularities.distance(robot, pose, direction=way), (None, None, 0))
)
measures = jax.jit(jax.vmap(js.singularities.measures, (None, 0)))


@pytest.mark.parametrize("scale", [1.0, 1e-3])
def test_similar_triangles_are_loose_where_they_are_not_turned(scale):
    robot = js.NavaroII.prototype(mode=8)
    robot = js.NavaroII(robot.base * scale, robot.platform * scale, robot.stroke * scale, mode=8)
    nearest = js.singularities.distance(robot, jnp.array([45.0 * scale, 26.0 * scale, 0.2]))
    assert nearest.kind == 2 and nearest.leg == -1
    np.testing.assert_allclose(nearest.rotation, 0.2, atol=1e-6)
    np.testing.assert_allclose(nearest.distance / robot.length, 0.2, atol=1e-6)
    np.testing.assert_allclose(nearest.pose[2], 0, atol=1e-6)


@pytest.mark.parametrize(
    ("alpha", "radius", "angle_length"), [(1.2, 40.0, 20.0), (1.2, 40.0, 90.0), (0.5, 97.0, 1000.0)]
)
def test_the_way_to_a_curved_locus_is_the_shortest(alpha, radius, angle_length):
    """Mode 8 is also singular on a circle about the middle of radius sqrt(3000 - 1800 cos(alpha)) [NAV19 eq. 38].

    The last pose is farther from the circle than this is wide, where turning all the way to the normal overshoots.
    """
    robot = dataclasses.replace(js.NavaroII.prototype(mode=8), stroke=(0.0, np.inf))
    pose = jnp.array([45.0 + radius * np.cos(0.4), 15 * np.sqrt(3) + radius * np.sin(0.4), alpha])
    turns = np.linspace(alpha - 0.4, alpha + 1, 2_000_001)
    expected = np.hypot(np.sqrt(3000 - 1800 * np.cos(turns)) - radius, angle_length * (turns - alpha)).min()
    nearest = js.singularities.distance(robot, pose, angle_length=angle_length)
    assert nearest.kind == 2
    np.testing.assert_allclose(nearest.distance, expected, rtol=1e-5)


def test_a_scott_linkage_reaches_as_far_as_its_link_is_long():
    robot = js.TriScott.prototype()
    pose, _ = robot.home()
    met = js.singularities.distance(robot, pose, direction=jnp.zeros(6).at[0].set(1.0))
    masts, links, corners, start = (np.asarray(x) for x in (robot.masts, robot.link_lengths, robot.platform, pose))
    cos, sin = np.cos(start[5]), np.sin(start[5])
    x, y = (corners @ np.array([[cos, sin], [-sin, cos]]) + start[:2] - masts).T
    stretched = np.sqrt(links**2 - y**2) - x
    assert met.kind == 1 and int(met.leg) == np.argmin(stretched)
    np.testing.assert_allclose(met.distance, stretched.min(), rtol=1e-7)


@pytest.fixture(scope="module", params=["navaro_mode_8", *exhaustive("tse_prototype")])
def case(request):
    robot = ALL[request.param]()
    pose = robot.home()[0]
    return robot, pose, js.singularities.distance(robot, pose)


def test_the_nearest_is_no_farther_than_any_other(case):
    robot, pose, nearest = case
    twists = np.random.default_rng(1).normal(size=(64, pose.shape[0]))
    twists[:, robot.space.translations :] /= float(robot.length)
    others = along(robot, pose, jnp.asarray(twists))
    assert np.isfinite(others.distance).sum() > 20
    assert (np.asarray(others.distance) >= float(nearest.distance) * (1 - 1e-6)).all()


def test_nothing_changes_sign_within_the_distance_and_something_ends_at_it(case):
    robot, pose, nearest = case
    rng = np.random.default_rng(2)
    steps = rng.normal(size=(256, pose.shape[0]))
    steps *= 0.98 * float(nearest.distance) / np.linalg.norm(steps, axis=1, keepdims=True)
    steps[:, robot.space.translations :] /= float(robot.length)
    move = jax.vmap(
        lambda step: jnp.stack(robot.space.coordinates(*robot.space.retract(*robot.space.place(pose), tuple(step))))
    )
    around, at_home = measures(robot, move(jnp.asarray(steps))), js.singularities.measures(robot, pose)
    assert (around.status == js.Status.CONVERGED).all()
    assert (np.sign(around.type2) == np.sign(at_home.type2)).all()
    assert (np.sign(around.type1) == np.sign(at_home.type1)).all()
    end = js.singularities.measures(robot, nearest.pose, joints=nearest.joints)
    size = abs(end.type2 / at_home.type2) if nearest.kind == 2 else abs(end.type1 / at_home.type1)[nearest.leg]
    assert size < 1e-3  # type 1 vanishes with the root of the distance


def test_turns_that_count_more_are_farther_away(case):
    robot, pose, nearest = case
    heavier = js.singularities.distance(robot, pose, angle_length=3 * robot.length)
    assert heavier.distance >= nearest.distance * (1 - 1e-6)
    weighted = jnp.hypot(heavier.translation, 3 * robot.length * heavier.rotation)
    np.testing.assert_allclose(heavier.distance, weighted, rtol=1e-12)


def test_a_screw_keeps_its_pitch():
    """Mode 8 is loose at alpha = 0, a fifth of this twist away; what a turn counts as changes the length alone."""
    robot, pose, twist = js.NavaroII.prototype(mode=8), jnp.array([45.0, 26.0, 0.2]), jnp.array([30.0, -10.0, -1.0])
    for angle_length in (10.0, 90.0):
        met = js.singularities.distance(robot, pose, direction=twist, angle_length=angle_length)
        assert met.kind == 2
        np.testing.assert_allclose(met.pose, pose + 0.2 * twist, atol=1e-6)
        np.testing.assert_allclose(met.distance, 0.2 * np.hypot(np.hypot(30, 10), angle_length), rtol=1e-6)


def test_unreachable_poses_and_short_reaches_are_told():
    robot = js.NavaroII.prototype(mode=8)
    away = js.singularities.distance(robot, jnp.array([45.0, jnp.nan, 0.2]), direction=jnp.array([0.0, 0.0, 1.0]))
    assert away.status == js.Status.NONFINITE and jnp.isnan(away.distance) and away.kind == 0
    pose = jnp.array([45.0, 26.0, 0.2])
    near = partial(js.singularities.distance, robot, pose, direction=jnp.array([0.0, 0.0, -1.0]))
    assert jnp.isinf(near(max_distance=10.0).distance) and near(max_distance=20.0).kind == 2
    still = js.singularities.distance(robot, pose, direction=jnp.zeros(3))
    assert jnp.isinf(still.distance)


def test_a_bound_platform_is_loose_where_its_constraints_end():
    """The 3-UPU's constraints depend on each other on a circle, which is the nearest of its singularities."""
    robot = ThreeUPU(0.5, 0.25)
    pose = jnp.array([0.3, 0.1, 0.8, 0.0, 0.0, 0.0])
    found = js.singularities.distance(robot, pose, directions=64)
    assert int(found.kind) == 2
    assert float(found.distance) == pytest.approx(0.5 - np.hypot(0.3, 0.1), rel=1e-6)
    assert np.hypot(*found.pose[:2]) == pytest.approx(0.5, rel=1e-6)


@pytest.mark.exhaustive
def test_the_circle_of_a_bound_platform_moves_with_its_radii():
    """The radius of the 3-UPU's circle is twice their difference."""
    robot, pose = ThreeUPU(0.5, 0.25), jnp.array([0.3, 0.1, 0.8, 0.0, 0.0, 0.0])

    def nearest(robot, pose):
        return js.singularities.distance(robot, pose, directions=64).distance

    by_robot, by_pose = jax.grad(nearest, (0, 1))(robot, pose)
    np.testing.assert_allclose([by_robot.base, by_robot.top], [2, -2], rtol=1e-6)
    np.testing.assert_allclose(by_pose, [*-pose[:2] / jnp.hypot(*pose[:2]), 0, 0, 0, 0], atol=1e-5)


@pytest.mark.parametrize(
    ("robot", "pose", "way"),
    [
        (js.NavaroII.prototype(mode=8), [45.0, 26.0, 1.2], [1.0, 0.2, 0.01]),  # of type 2
        pytest.param(  # of type 1
            js.TripleScissorExtender.prototype(), None, [0.1, 0.03, 1.0, 0.0, 0.1, 0.05], marks=pytest.mark.exhaustive
        ),
    ],
    ids=["navaro", "tse"],
)
def test_a_distance_has_the_derivative_of_its_differences(robot, pose, way, rng):
    pose = robot.home()[0] if pose is None else jnp.asarray(pose)
    units = robot, jnp.where(jnp.arange(len(pose)) < robot.space.translations, robot.length, 1.0)
    design = jax.tree.map(lambda x: jnp.where(jnp.isfinite(x), x, 0) * rng.normal(size=x.shape), units[0])
    moved = design, units[1] * rng.normal(size=len(pose))

    def far(share):
        changed = jax.tree.map(lambda x, d: x + share * d, (robot, pose), moved)
        return js.singularities.distance(*changed, direction=jnp.asarray(way)).distance

    step = 1e-5
    slope, ends = jax.jit(jax.jacfwd(far))(0.0), [far(s) for s in (-step, step)]
    assert abs(float(slope)) > 0.1 * float(robot.length)
    np.testing.assert_allclose(slope, (ends[1] - ends[0]) / (2 * step), rtol=2e-3)


@pytest.mark.exhaustive
def test_the_nearest_distance_has_its_envelope_as_derivative():
    """Mode 8 is loose where it is not turned: |alpha| times what a turn counts as, which by default is the length."""
    robot, pose = js.NavaroII.prototype(mode=8), jnp.array([45.0, 26.0, 0.2])
    by_robot, by_pose = jax.grad(lambda *case: js.singularities.distance(*case).distance, (0, 1))(robot, pose)
    np.testing.assert_allclose(by_pose, [0, 0, robot.length], atol=1e-6 * float(robot.length))
    both = zip(jax.tree.leaves(robot), jax.tree.leaves(by_robot), strict=True)
    total = sum(np.vdot(size, slope) for size, slope in both if np.isfinite(size).all())
    assert total == pytest.approx(0.2 * float(robot.length), rel=1e-6)  # in another unit it is another length (Euler)


@pytest.mark.exhaustive
def test_along_a_tilt_a_bound_platform_is_singular_where_its_measure_is_zero():
    robot = ThreePRS.example()
    pose, tilt = robot.home()[0], jnp.eye(6)[4]

    def measure(angle):
        there = js.constrained_pose(robot, pose + angle * tilt).value
        found = js.singularities.measures(robot, there)
        return np.array([*found.type1, found.type2])

    first = js.singularities.distance(robot, pose, direction=tilt)
    assert int(first.kind) in (1, 2)
    number = int(first.leg) if int(first.kind) == 1 else 3
    root = brentq(lambda angle: measure(angle)[number], 0.5 * float(first.rotation), 1.2 * float(first.rotation))
    assert float(first.rotation) == pytest.approx(root, rel=1e-6)
    signs = np.sign([measure(angle) for angle in np.linspace(0, 0.999 * root, 12)])
    assert (signs == signs[0]).all()  # none before


def test_wrong_shapes_and_constraints_without_names_are_refused():
    with pytest.raises(ValueError, match="names in dependent"):
        robot = ThreePRS.example()
        nameless = js.pytree(type("Nameless", (ThreePRS,), {"dependent": (), "__doc__": ""}))
        js.singularities.distance(nameless(robot.rod, robot.top_radius), robot.home()[0])
    with pytest.raises(ValueError, match="expected a twist"):
        js.singularities.distance(js.NavaroII.prototype(), jnp.zeros(3), direction=jnp.zeros(6))


def test_measures_have_finite_derivatives_up_to_the_locus_and_those_of_differences_before(case):
    robot, pose, _ = case
    sizes = jnp.where(jnp.arange(pose.shape[0]) < robot.space.translations, robot.length, 1)
    pose = pose + 0.01 * sizes * jnp.cos(jnp.arange(1.0, pose.shape[0] + 1))  # where no two gear ratios are alike
    end = js.singularities.distance(robot, pose, direction=jnp.eye(pose.shape[0])[2]).pose  # up, or turning

    def measures(pose):
        found, gears = js.singularities.measures(robot, pose), js.gear_ratios(robot, pose)
        return jnp.concatenate([found.type1, found.type2[None], gears.translation, gears.rotation])

    left = jnp.asarray([0.5, 1e-1, 1e-2, 1e-4, 1e-6])[:, None]
    poses = pose[None] + (1 - left) * (end - pose)[None]
    values, slopes = (jax.jit(jax.vmap(f)) for f in (measures, jax.jacfwd(measures)))
    assert jnp.isfinite(values(poses)).all() and jnp.isfinite(slopes(poses)).all()
    step = 1e-6 * sizes
    ahead, behind = (values(poses[:1] + sign * jnp.diag(step)) for sign in (1, -1))
    differences = ((ahead - behind) / (2 * step[:, None])).T
    np.testing.assert_allclose(slopes(poses[:1])[0], differences, rtol=1e-6, atol=1e-6 * np.abs(differences).max())
