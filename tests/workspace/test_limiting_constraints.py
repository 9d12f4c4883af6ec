"""What keeps a robot out of poses, against the limits read off one by one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from tests.conftest import ALL, exhaustive


@pytest.mark.parametrize("name", ["tse_prototype", *exhaustive("three_prs", "navaro_mode_1", "tri_scott_skewed")])
def test_shares_add_up_to_what_is_out_of_reach(name):
    robot = ALL[name]()
    home = np.asarray(robot.home()[0])
    reach = np.where(np.arange(len(home)) < robot.space.translations, 0.5 * float(robot.length), 0.3)
    sample = js.Box(home - reach, home + reach).quasi_random(700)
    found = js.workspace.limiting_constraints(robot, sample, execution=js.workspace.Execution(chunk_size=128))
    missing = 1 - float(js.workspace.fraction(robot, sample))
    assert missing > 0.05
    assert float(found.share.sum() + found.other) == pytest.approx(missing, abs=1e-12)
    assert found.share.shape[1] == len(found.limits)
    poses = np.asarray(sample[:])
    out = ~np.asarray(jax.vmap(lambda pose: js.feasibility(robot, pose).feasible)(poses))
    if name != "three_prs":
        centers = np.nansum(np.asarray(found.center) * np.asarray(found.share)[..., None], axis=(0, 1))
        np.testing.assert_allclose(centers, poses[out].sum(axis=0) / len(poses), atol=1e-12)


def test_each_leg_of_navaro_is_judged_by_its_own_length():
    robot = js.NavaroII.prototype()
    poses = js.Box([0.0, -20.0, -1.0], [90.0, 90.0, 1.0]).quasi_random(2000)[:]
    found = js.workspace.limiting_constraints(robot, poses)
    x, y, alpha = np.asarray(poses).T[:, :, None]
    corners, feet = np.asarray(robot.platform).T[:, None], np.asarray(robot.base).T[:, None]
    across = x + np.cos(alpha) * corners[0] - np.sin(alpha) * corners[1] - feet[0]
    along = y + np.sin(alpha) * corners[0] + np.cos(alpha) * corners[1] - feet[1]
    lengths = np.hypot(across, along)
    low, high = np.asarray(robot.stroke)
    slack = np.stack([lengths - low, high - lengths], axis=2).reshape(len(poses), -1)
    worst, out = slack.argmin(axis=1), slack.min(axis=1) < 0
    expected = np.bincount(worst[out], minlength=6).reshape(3, 2) / len(poses)
    np.testing.assert_allclose(found.share[:, 1:], expected, atol=1e-12)
    assert found.limits == ("edge of the home mode", "shortest leg", "longest leg")
    leg, limit = np.unravel_index(expected.argmax(), expected.shape)
    mean = np.asarray(poses)[out & (worst == 2 * leg + limit)].mean(axis=0)
    np.testing.assert_allclose(found.center[leg, limit + 1], mean, atol=1e-9)
    assert f"leg {leg + 1}: {found.limits[limit + 1]}" in repr(found).splitlines()[1]


def test_poses_that_are_not_finite_are_counted_apart(prototype):
    home = prototype.home()[0]
    poses = jnp.stack([home, home * jnp.nan, home.at[2].set(1.7), home.at[2].set(0.01)])
    found = js.workspace.limiting_constraints(prototype, poses)
    assert float(found.other) == 0.25 and float(found.share.sum()) == 0.5
