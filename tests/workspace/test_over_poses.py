"""Worst cases and means over the poses of a task, against plain loops and differences."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from tests.conftest import ALL, exhaustive
from tests.toys import Planar3RPR


@pytest.fixture
def robot():
    return js.NavaroII.prototype(mode=6)


@pytest.fixture
def task(robot):
    return js.Disc([45.0, 26.0], 24.0, -0.4, 0.6).quasi_random(300)[:]


def test_task_metrics_are_the_extremes_over_the_poses(robot, task):
    found = js.design.task_metrics(robot, task)
    x, y, alpha = np.asarray(task).T[:, :, None]
    corners, feet = np.asarray(robot.platform).T[:, None], np.asarray(robot.base).T[:, None]
    across = x + np.cos(alpha) * corners[0] - np.sin(alpha) * corners[1] - feet[0]
    along = y + np.sin(alpha) * corners[0] + np.cos(alpha) * corners[1] - feet[1]
    lengths = np.hypot(across, along)
    margin = min((lengths - 9.0).min(), (80.0 - lengths).min()) / float(robot.length)
    assert float(found.margin) == pytest.approx(margin, abs=1e-12)
    np.testing.assert_allclose(found.least_joints[1::2], lengths.min(axis=0), rtol=1e-12)
    np.testing.assert_allclose(found.greatest_joints[1::2], lengths.max(axis=0), rtol=1e-12)
    measures = jax.vmap(js.singularities.measures, (None, 0))(robot, task)
    assert float(found.type1) == pytest.approx(float(jnp.abs(measures.type1).min()), rel=1e-9)
    assert float(found.type2) == pytest.approx(float(jnp.abs(measures.type2).min()), rel=1e-9)
    gears = jax.vmap(js.gear_ratios, (None, 0))(robot, task).translation
    assert float(found.conditioning) == pytest.approx(float((gears[:, 0] / gears[:, -1]).min()), rel=1e-9)
    assert float(found.footprint) >= 90.0, "the farthest anchor"


def test_derivatives_of_the_worst_and_of_the_mean_agree_with_differences(robot, task):
    def size(robot, pose):
        return js.feasibility(robot, pose).margin ** 2

    def both(reach):
        changed = dataclasses.replace(robot, platform=robot.platform * reach)
        return js.workspace.worst_over(changed, size, task).value + 2 * js.workspace.mean_over(changed, size, task)

    tuned, step = jax.jit(jax.value_and_grad(both)), 1e-5
    difference = (tuned(1 + step)[0] - tuned(1 - step)[0]) / (2 * step)
    assert float(tuned(1.0)[1]) == pytest.approx(float(difference), rel=1e-6)


def test_poses_where_a_quantity_is_not_defined_do_not_count(prototype):
    home = prototype.home()[0]
    poses = jnp.stack([home.at[2].set(9.0), home, home.at[0].add(0.1)])

    def gear(robot, pose):
        return js.gear_ratios(robot, pose).vertical

    defined = jnp.stack([gear(prototype, pose) for pose in poses[1:]])
    worst = js.workspace.worst_over(prototype, gear, poses)
    assert float(worst.value) == pytest.approx(float(defined.min()), rel=1e-12) and worst.pose[2] == home[2]
    assert float(js.workspace.mean_over(prototype, gear, poses)) == pytest.approx(float(defined.mean()), rel=1e-12)
    assert jnp.isnan(js.workspace.worst_over(prototype, gear, poses[:1]).value)
    slopes = jax.grad(lambda r: js.workspace.mean_over(r, gear, poses))(prototype)
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(slopes))


def test_poses_of_another_robot_are_refused(robot):
    with pytest.raises(ValueError, match="Got poses of shape"):
        js.design.task_metrics(robot, np.zeros((2, 6)))


def margin_of(robot, pose):
    return js.feasibility(robot, pose).margin


def test_a_map_is_a_vmap_in_chunks(prototype):
    sample = js.Cylinder(0.5, 1.0).quasi_random(10_000)
    execution = js.workspace.Execution(chunk_size=777)
    found = js.workspace.map(js.inverse_kinematics, prototype, sample, execution=execution)
    plain = jax.vmap(js.inverse_kinematics, (None, 0))(prototype, sample[:])
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12), found, plain)

    def memory(function, *arguments):
        return jax.jit(function).lower(*arguments).compile().memory_analysis().temp_size_in_bytes

    poses = sample.region.quasi_random(100_000)[:]
    whole = memory(jax.vmap(js.inverse_jacobian, (None, 0)), prototype, poses)
    small = js.workspace.Execution(chunk_size=4096)
    parts = memory(lambda robot: js.workspace.map(js.inverse_jacobian, robot, poses, execution=small), prototype)
    results = 8 * 36 * 25 * 4096  # of whole chunks, from which those asked for are copied
    assert parts - results < 0.1 * whole
    with pytest.raises(ValueError, match="no sum to share"):
        js.workspace.map(js.inverse_jacobian, prototype, sample, execution=js.workspace.Execution(checkpoint="x.npz"))


@pytest.mark.parametrize("name", ["mean", "slope of the worst", *exhaustive("worst", "slope of the mean")])
def test_memory_does_not_grow_with_the_number_of_poses(name):
    robot, region = Planar3RPR.example(), js.Disc([0.45, 0.35], 0.8, -0.5, 0.5)
    programs = {
        "worst": lambda r, sample: js.workspace.worst_over(r, margin_of, sample).value,
        "mean": lambda r, sample: js.workspace.mean_over(r, margin_of, sample),
    }
    plain = programs[name.split()[-1]]
    program = jax.grad(plain) if name.startswith("slope") else plain

    def temporary(count):
        compiled = jax.jit(program).lower(robot, region.quasi_random(count)).compile()
        return compiled.memory_analysis().temp_size_in_bytes

    few, many = temporary(10**5), temporary(10**8)
    assert many < 1.02 * few, "the poses alone would need a thousand times as much"


@pytest.mark.exhaustive
def test_lazy_samples_stored_poses_and_orientations_give_the_same(robot):
    disc = js.Disc([45.0, 26.0], 24.0, -0.4, 0.6)
    lazy = disc.quasi_random(40_000)
    for number in (300, 40_000):
        found, stored = (
            js.workspace.worst_over(robot, margin_of, poses) for poses in (disc.quasi_random(number), lazy[:number])
        )
        assert found.value == stored.value and (found.pose == stored.pose).all()
    margins = jax.vmap(margin_of, (None, 0))(robot, lazy[:])
    assert stored.value == margins.min() and (stored.pose == lazy[:][margins.argmin()]).all()
    assert float(js.workspace.mean_over(robot, margin_of, lazy)) == pytest.approx(float(margins.mean()), rel=1e-12)
    turned = js.workspace.Dexterous(disc, [[0.3], [-0.2], [0.1]]).quasi_random(200)
    each = turned[:].reshape(-1, 3)
    worst = js.workspace.worst_over(robot, margin_of, turned)
    assert worst.value == js.workspace.worst_over(robot, margin_of, each).value and float(worst.pose[2]) in (
        0.3,
        -0.2,
        0.1,
    )
    means = [float(js.workspace.mean_over(robot, margin_of, poses)) for poses in (turned, each)]
    assert means[0] == pytest.approx(means[1], rel=1e-12)


def near_home(robot, count):
    """Poses about home, with the dependent coordinates as they come."""
    home, shifts = robot.home()[0], robot.space.translations
    reach = jnp.array([0.1 * float(robot.length)] * shifts + [0.1] * (robot.space.dimension - shifts))
    return js.Box(home - reach, home + reach).quasi_random(count)


@pytest.mark.parametrize(
    "name", exhaustive("linear_delta", "three_prs", "stewart_gough", "tse_prototype", "tri_scott", "micabo")
)
def test_metrics_of_every_robot_agree_with_plain_loops_and_differences(name, rng):
    # a little off symmetry, at which the extremes of several legs coincide and have kinks
    robot = jax.tree.map(lambda leaf: leaf * (1 + 0.01 * rng.normal(size=leaf.shape)), ALL[name]())
    sample = near_home(robot, 60)
    way = jax.tree.map(lambda leaf: jnp.where(jnp.isfinite(leaf), leaf, 0) * rng.normal(size=leaf.shape), robot)
    steps = 1e-6 * jnp.array([0.0, 1.0, -1.0])
    designs = jax.vmap(lambda step: jax.tree.map(lambda leaf, d: leaf + step * d, robot, way))(steps)

    def tuned(robot):
        found = js.design.task_metrics(robot, sample)
        mean = js.workspace.mean_over(robot, joints_of, sample)
        return jnp.concatenate([jnp.ravel(leaf) for leaf in (*jax.tree.leaves(found), mean)])

    values, slopes = jax.jit(jax.vmap(lambda robot, way: jax.jvp(tuned, (robot,), (way,)), (0, None)))(designs, way)
    differences = (values[1] - values[2]) / 2e-6
    np.testing.assert_allclose(slopes[0], differences, rtol=1e-5, atol=1e-5 * float(jnp.abs(differences).max()))

    @jax.jit
    @jax.vmap
    def plain(pose):
        whole = js.constrained_pose(robot, pose)
        solution, measures = js.inverse_kinematics(robot, whole.value), js.singularities.measures(robot, whole.value)
        gears = js.gear_ratios(robot, whole.value).translation
        return (
            js.feasibility(robot, whole.value).margin,
            gears[0] / gears[-1],
            jnp.abs(measures.type1).min(),
            jnp.abs(measures.type2),
            solution.value,
            whole.converged & solution.converged,
        )

    margins, *others, joints, reached = map(np.asarray, plain(sample[:]))
    joints = joints[reached]
    assert 5 < reached.sum() and (margins >= 0).any()
    least = [margins.min(), *(other[reached].min() for other in others), *joints.min(axis=0), *joints.max(axis=0)]
    np.testing.assert_allclose(values[0][: len(least)], least, rtol=1e-9)
    np.testing.assert_allclose(values[0][len(least) + 1 :], joints.mean(axis=0), rtol=1e-9)


def joints_of(robot, pose):
    whole = js.constrained_pose(robot, pose)
    solution = js.inverse_kinematics(robot, whole.value)
    return jnp.where(whole.converged & solution.converged, solution.value, jnp.nan)
