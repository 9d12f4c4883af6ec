"""Verdicts where rounding makes them: poses within 100 ulp of where the home mode ends."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor.robots._contract import joint_places
from tests.conftest import ALL, as_users, exhaustive

MORE = ("micabo", "tri_scott", "tse_clockwise")  # whose legs know all their roots, too
ROUNDING = 200 * np.finfo(float).eps  # of a margin whose pose is 100 ulp away


def poses_at_edges(robot, count, rng):
    """``(count, d)`` poses within 100 ulp of edges of the home mode, eight beside each other."""
    space, home = robot.space, np.asarray(robot.home()[0])
    scale = np.where(np.arange(len(home)) < space.translations, 0.8 * float(robot.length), 0.6)
    reached = as_users(jax.vmap(lambda pose: js.inverse_kinematics(robot, pose).converged))
    ends = home + scale * rng.uniform(-1, 1, (2, 2 * count, len(home)))
    first, last = map(np.asarray, map(reached, ends))
    first, last = ends[:, first != last]
    inside = np.asarray(reached(first))
    for _ in range(60):
        middle = (first + last) / 2
        same = (np.asarray(reached(middle)) == inside)[:, None]
        first, last = np.where(same, middle, first), np.where(same, last, middle)
    edges = np.resize(first, (count // 8, len(home))).repeat(8, axis=0)
    return edges + rng.integers(-100, 101, edges.shape) * np.spacing(edges)


@pytest.mark.parametrize("name", ["tse_prototype", *exhaustive("tri_scott_skewed", *MORE)])
def test_every_function_has_one_verdict_at_an_edge(name, rng):
    robot = ALL[name]()
    poses = poses_at_edges(robot, 100_000, rng)
    solved = as_users(jax.vmap(js.inverse_kinematics, (None, 0)))(robot, poses)
    judged = as_users(jax.vmap(js.feasibility, (None, 0)))(robot, poses)
    status = np.asarray(solved.status)
    assert 0.3 < np.mean(status == js.Status.CONVERGED) < 0.7
    assert not np.any(status == js.Status.MAX_STEPS), "undecided"
    np.testing.assert_array_equal(status, judged.status)
    assert not np.any((judged.margin >= 0) & (judged.status != js.Status.CONVERGED))

    plain = jax.jit(jax.vmap(js.feasibility, (None, 0)))(robot, poses)  # compiled without optimizations
    alone = [js.feasibility(robot, pose) for pose in poses[:1000]]
    for other in (plain, jax.tree.map(lambda *leaves: jnp.stack(leaves), *alone)):
        differ = np.flatnonzero(np.asarray(other.status) != status[: len(other.status)])
        assert len(differ) < 0.05 * len(other.status)
        edges = jax.vmap(partial(js.margins, robot))(poses[differ])[:, :, 0]
        assert np.abs(edges).min(axis=1).max(initial=0) < ROUNDING


@pytest.mark.parametrize("name", ["tri_scott_skewed", *exhaustive("tse_prototype", *MORE)])
def test_all_modes_have_the_home_mode_where_inverse_kinematics_has_it(name, rng):
    robot = ALL[name]()
    poses = poses_at_edges(robot, 20_000, rng)
    solved = as_users(jax.vmap(js.inverse_kinematics, (None, 0)))(robot, poses)
    modes = as_users(jax.vmap(js.inverse_kinematics_all, (None, 0)))(robot, poses)
    joints = np.asarray(solved.value)[:, joint_places(robot)][:, :, None]  # (n, legs, 1, joints of a leg)
    apart = np.abs(np.asarray(modes.values) - joints).max(axis=-1)
    has_home = np.any(modes.valid & (apart < 1e-9), axis=2).all(axis=1)
    assert np.all(has_home[np.asarray(solved.converged)])
    has_none = np.any(~np.any(modes.valid, axis=2), axis=1)
    np.testing.assert_array_equal(has_none, solved.status == js.Status.NO_SOLUTION)
