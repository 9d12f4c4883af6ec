"""Worst cases and means over the poses of a task, against plain loops and differences."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js


@pytest.fixture
def robot():
    return js.NavaroII.prototype(mode=6)


@pytest.fixture
def task(robot):
    return js.Disc([45.0, 26.0], 24.0, -0.4, 0.6).quasi_random(300)[:]


def test_task_metrics_are_the_extremes_over_the_poses(robot, task):
    found = js.task_metrics(robot, task)
    x, y, alpha = np.asarray(task).T[:, :, None]
    corners, feet = np.asarray(robot.platform).T[:, None], np.asarray(robot.base).T[:, None]
    across = x + np.cos(alpha) * corners[0] - np.sin(alpha) * corners[1] - feet[0]
    along = y + np.sin(alpha) * corners[0] + np.cos(alpha) * corners[1] - feet[1]
    lengths = np.hypot(across, along)
    margin = min((lengths - 9.0).min(), (80.0 - lengths).min()) / float(robot.length)
    assert float(found.margin) == pytest.approx(margin, abs=1e-12)
    np.testing.assert_allclose(found.least_joints[1::2], lengths.min(axis=0), rtol=1e-12)
    np.testing.assert_allclose(found.greatest_joints[1::2], lengths.max(axis=0), rtol=1e-12)
    measures = jax.vmap(js.singularity, (None, 0))(robot, task)
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
        return js.worst_case(size, changed, task).value + 2 * js.mean_case(size, changed, task)

    tuned, step = jax.jit(jax.value_and_grad(both)), 1e-5
    difference = (tuned(1 + step)[0] - tuned(1 - step)[0]) / (2 * step)
    assert float(tuned(1.0)[1]) == pytest.approx(float(difference), rel=1e-6)


def test_poses_where_a_quantity_is_not_defined_do_not_count(prototype):
    home = prototype.home()[0]
    poses = jnp.stack([home.at[2].set(9.0), home, home.at[0].add(0.1)])

    def gear(robot, pose):
        return js.gear_ratios(robot, pose).vertical

    defined = jnp.stack([gear(prototype, pose) for pose in poses[1:]])
    worst = js.worst_case(gear, prototype, poses)
    assert worst.value == defined.min() and (worst.pose[2] == home[2])
    assert float(js.mean_case(gear, prototype, poses)) == pytest.approx(float(defined.mean()), rel=1e-12)
    assert jnp.isnan(js.worst_case(gear, prototype, poses[:1]).value)
    slopes = jax.grad(lambda r: js.mean_case(gear, r, poses))(prototype)
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(slopes))


def test_poses_of_another_robot_are_refused(robot):
    with pytest.raises(ValueError, match="Got poses of shape"):
        js.task_metrics(robot, np.zeros((2, 6)))
