"""Following poses and tracking joints: pose by pose, there and back, stopped before what stops them."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from tests.bound_robots import FiveBar
from tests.conftest import exhaustive, scaled
from tests.motion.oracles import drop, position, slides
from tests.toys import LinearDelta, ThreePRS

N = 30


def delta_path():
    """Within the limits of the linear delta."""
    s = np.linspace(0, 1, N)
    return np.stack([0.25 * np.cos(3 * s), 0.25 * np.sin(3 * s), 0.1 + 0.4 * s], axis=1)


def name(found):
    return js.Status(int(found.reason)).name


def test_the_delta_is_followed_and_tracked_by_its_closed_forms():
    robot, path = LinearDelta.example(), delta_path()
    found = js.motion.follow(robot, path)
    np.testing.assert_allclose(found.joints, slides(path), atol=1e-13)
    np.testing.assert_allclose(found.margin, np.minimum(slides(path), 2 - slides(path)).min(axis=1), atol=1e-13)
    assert found.ok.all() and int(found.covered) == N and name(found) == "CONVERGED"
    back = js.motion.track(robot, slides(path), guess=path[0])
    np.testing.assert_allclose(back.poses, path, atol=1e-13)
    np.testing.assert_allclose(back.poses, [position(row) for row in slides(path)], atol=1e-12)
    for field in ("joints", "margin", "type1", "type2"):
        np.testing.assert_allclose(getattr(back, field), getattr(found, field), atol=1e-12)


PATHS = {
    "navaro": (partial(js.NavaroII.prototype, 8), [[45.0, 26.0, 0.3], [52.0, 30.0, 0.6], [40.0, 33.0, 0.2]]),
    "tse": (
        js.TripleScissorExtender.laboratory,
        [[0.0, 0.0, 1.17, 0.0, 0.0, 0.0], [0.05, 0.02, 1.2, 0.05, 0.1, -0.1], [-0.05, 0.05, 1.1, 0.1, 0.0, 0.1]],
    ),
}


@pytest.mark.parametrize("robot", ["navaro", *exhaustive("tse")])
def test_follow_is_inverse_kinematics_pose_by_pose_and_track_gives_the_poses_back(robot):
    make, via = PATHS[robot]
    robot = make()
    path = js.motion.via_points(robot, via, samples=21)
    found = js.motion.follow(robot, path)
    for pose, joints in zip(path, found.joints, strict=True):
        np.testing.assert_allclose(joints, js.inverse_kinematics(robot, pose).value, atol=1e-10 * float(robot.length))
    back = js.motion.track(robot, robot.actuated(found.joints), guess=path[0])
    assert back.ok.all()
    np.testing.assert_allclose(back.poses, path, atol=1e-10 * float(robot.length))
    np.testing.assert_allclose(back.joints, found.joints, atol=1e-10 * float(robot.length))


def test_both_stop_before_a_limit_and_lose_nothing():
    robot = LinearDelta.example()
    path = np.stack([np.full(N, 0.1), np.zeros(N), np.linspace(0.5, 1.9, N)], axis=1)
    top = int((slides(path).max(axis=1) <= 2).sum())
    lower = int((slides(path).max(axis=1) <= 1.7).sum())
    assert 3 < lower < top < N
    found = js.motion.follow(robot, path)
    back = js.motion.track(robot, slides(path), guess=path[0])
    for either in (found, back):
        assert int(either.covered) == top and name(either) == "OUT_OF_REACH"
        np.testing.assert_allclose(either.poses[:top], path[:top], atol=1e-13)
        np.testing.assert_allclose(either.joints[:top], slides(path[:top]), atol=1e-13)
        assert jnp.isnan(either.poses[top:]).all() and jnp.isnan(either.joints[top:]).all()
        assert (either.status[top:] == either.reason).all()
    assert int(js.motion.follow(robot, path, min_margin=0.3).covered) == lower
    free = js.motion.follow(robot, path, min_margin=-np.inf)
    assert free.ok.all() and float(free.margin[-1]) < 0


def test_follow_stops_before_a_platform_comes_loose():
    """NaVARo II in mode 8 is loose where the triangles are parallel, alpha = 0 [NAV19 eq. 38]."""
    robot = js.NavaroII.prototype(mode=8)
    alpha = np.linspace(0.5, -0.45, 21)  # zero lies between two samples
    path = np.stack([np.full(21, 45.0), np.full(21, 26.0), alpha], axis=1)
    found = js.motion.follow(robot, path)
    assert int(found.covered) == (alpha > 0).sum() and name(found) == "SINGULAR"
    assert int(js.motion.follow(robot, path, min_type2=-1.0).covered) == int(found.covered), "whatever is allowed"
    away = js.motion.follow(robot, path, min_type2=0.1)
    type2 = jnp.abs(found.type2)
    assert int(away.covered) == int((type2 >= 0.1).sum()) < int(found.covered) and name(away) == "SINGULAR"
    clear = js.motion.follow(robot, path, min_type1=0.999 * float(jnp.nanmin(jnp.abs(found.type1[:3]))))
    assert name(clear) == "SINGULAR" and int(clear.covered) >= 3


def test_follow_stops_where_the_working_mode_ends():
    """A rod of the delta is level where the platform is a rod's length from its slide; there is no pose beyond."""
    robot = LinearDelta.example()
    path = np.stack([-np.linspace(0.0, 0.7, N), np.zeros(N), np.full(N, 0.5)], axis=1)
    found = js.motion.follow(robot, path)
    inside = int((path[:, 0] + 0.5 > 0).sum() + (np.abs(path[:, 0] - 0.5) < 1).sum()) - int((path[:, 0] > -0.5).sum())
    assert int(found.covered) == inside and name(found) in ("MAX_STEPS", "OTHER_MODE")
    # the measure is the sine of the rod's slope over the root of 1 + sine^2 + ...: it vanishes with the drop
    away = js.motion.follow(robot, path, min_type1=0.2)
    assert name(away) == "SINGULAR" and int(away.covered) < inside
    assert drop(path[int(away.covered) - 1]).min() > drop(path[inside - 1]).min()


def test_track_stops_before_the_platform_comes_loose():
    """With the triangles of NaVARo II concentric and parallel its lengths are least: shorter ones close nowhere."""
    robot, middle = js.NavaroII.prototype(mode=8), [45.0, 15 * np.sqrt(3)]
    ends = [robot.actuated(js.inverse_kinematics(robot, [*middle, alpha]).value) for alpha in (0.5, 0.0)]
    share = np.linspace(0.0, 1.3, 21)[:, None]
    rows = np.asarray(ends[0]) * (1 - share) + np.asarray(ends[1]) * share
    found = js.motion.track(robot, rows, guess=[*middle, 0.5])
    assert int(found.covered) == (share < 1).sum() and name(found) in ("SINGULAR", "MAX_STEPS")
    away = js.motion.track(robot, rows, guess=[*middle, 0.5], min_type2=0.1)
    sizes = np.abs(found.type2)
    assert int(away.covered) == (sizes >= 0.1).sum() < int(found.covered) and name(away) == "SINGULAR"


def test_track_stops_before_a_rod_is_level():
    robot, start = LinearDelta.example(), np.array([0.0, 0.0, 1.0])
    rows = np.tile(slides(start), (N, 1))
    rows[:, 0] -= np.linspace(0.0, 1.9, N)
    tracked = np.stack([position(row) for row in rows[:20]])
    above = (rows[:20] > tracked[:, 2:]).all(axis=1)
    found = js.motion.track(robot, rows, guess=start, min_margin=-np.inf)
    assert 3 < above.sum() < 20 and int(found.covered) == above.sum() and name(found) == "SINGULAR"
    np.testing.assert_allclose(found.poses[: above.sum()], tracked[above], atol=1e-12)


def test_track_stops_before_a_jump_to_another_assembly_mode():
    robot = LinearDelta.example()
    up = np.array([0.0, 0.0, 1.0])
    rows = np.tile(slides(up), (N, 1))
    rows[5:] -= 1.8  # slides below the platform: the nearest way to close is above them
    found = js.motion.track(robot, rows, guess=up, min_margin=-np.inf)
    assert int(found.covered) == 5 and name(found) == "OTHER_MODE"
    np.testing.assert_allclose(found.poses[:5], np.tile(up, (5, 1)), atol=1e-12)


def test_another_unit_of_length_changes_nothing():
    robot, path, by = LinearDelta.example(), delta_path() + np.outer(np.linspace(0, 1, N), [0, 0, 1]), 1e3
    changed, rows = scaled(robot, by), slides(path)
    for plain, other in (
        (js.motion.follow(robot, path), js.motion.follow(changed, by * path)),
        (
            js.motion.track(robot, rows, guess=path[0]),
            js.motion.track(changed, by * rows, guess=by * path[0]),
        ),
    ):
        assert 0 < int(plain.covered) < N
        np.testing.assert_array_equal(plain.status, other.status)
        np.testing.assert_allclose(by * plain.poses, other.poses, rtol=1e-11, atol=1e-9)
        np.testing.assert_allclose(by * plain.joints, other.joints, rtol=1e-11)
        for field in ("margin", "type1", "type2"):
            np.testing.assert_allclose(getattr(plain, field), getattr(other, field), rtol=1e-9)


def test_another_working_mode_than_homes_is_kept():
    robot = LinearDelta.example()
    path = delta_path() + np.array([0.0, 0.0, 0.9])
    below = path[:, 2:] - drop(path)
    found = js.motion.follow(robot, path, guess=below[0])
    np.testing.assert_allclose(found.joints, below, atol=1e-13)


@pytest.mark.parametrize("make", exhaustive(partial(FiveBar, 1.0), ThreePRS.example))
def test_dependent_coordinates_are_completed(make):
    robot = make()
    home = robot.home()[0]
    step = jnp.array([0.0 if name in robot.dependent else 0.02 for name in robot.space.names])
    path = home[None] + jnp.linspace(0.0, 1.0, 8)[:, None] * step[None]
    off = path + jnp.array([0.1 if name in robot.dependent else 0.0 for name in robot.space.names])[None]
    found = js.motion.follow(robot, off)
    whole = jax.vmap(lambda pose: js.constrained_pose(robot, pose).value)(path)
    assert found.ok.all()
    np.testing.assert_allclose(found.poses, whole, atol=1e-12)
    back = js.motion.track(robot, robot.actuated(found.joints))
    np.testing.assert_allclose(back.poses, whole, atol=1e-10)


def test_the_derivative_of_the_end_by_a_dimension_is_that_of_differences():
    """Of a robot that is there and back: what it was built for, and what it became. Beyond the stop there is none."""
    robot, path = LinearDelta.example(), delta_path()
    rows = np.where(np.arange(N)[:, None] < 20, slides(path), np.nan)

    def end(rod):
        changed = dataclasses.replace(robot, rod=jnp.asarray(rod))
        tracked = js.motion.track(changed, rows, guess=path[0])
        followed = js.motion.follow(changed, path)
        return jnp.concatenate([tracked.poses[19], tracked.margin[19:20], followed.joints[-1]])

    reverse = jax.jit(jax.jacrev(end))(1.0)
    difference = (end(1 + 1e-5) - end(1 - 1e-5)) / 2e-5
    np.testing.assert_allclose(reverse, difference, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(reverse[4:], 1 / drop(path[-1]), rtol=1e-12)


def test_a_batch_is_a_loop_and_single_precision_stays_so(rng):
    robot = LinearDelta.example()
    single = jax.tree.map(lambda x: x.astype(jnp.float32), robot)
    paths = delta_path() + rng.normal(0, 0.05, (3, 1, 3))
    paths[1, 10] = np.inf
    paths[2, :, 2] += np.linspace(0, 1.5, N)
    rows = np.stack([slides(np.where(np.isfinite(path), path, 0)) for path in paths])
    rows[1, 10] = np.nan

    @jax.jit
    @jax.vmap
    def run(path, rows):
        return js.motion.follow(single, path), js.motion.track(single, rows, guess=path[0])

    followed, tracked = run(jnp.asarray(paths, jnp.float32), jnp.asarray(rows, jnp.float32))
    for i in range(3):
        one = js.motion.follow(robot, paths[i]), js.motion.track(robot, rows[i], guess=paths[i, 0])
        for ours, theirs in zip((followed, tracked), one, strict=True):
            np.testing.assert_array_equal(ours.status[i], theirs.status)
            np.testing.assert_allclose(ours.poses[i], theirs.poses, atol=3e-5)
            np.testing.assert_allclose(ours.joints[i], theirs.joints, atol=3e-5)
    assert followed.reason.tolist() == tracked.reason.tolist()
    assert followed.reason.tolist() == [js.Status.CONVERGED, js.Status.NONFINITE, js.Status.OUT_OF_REACH]
    assert followed.joints.dtype == tracked.poses.dtype == tracked.margin.dtype == jnp.float32


def test_wrong_arguments_are_refused():
    robot = LinearDelta.example()
    for shape in ((3,), (0, 3), (2, 6)):
        with pytest.raises(ValueError, match="Got poses of shape"):
            js.motion.follow(robot, np.zeros(shape))
        with pytest.raises(ValueError, match="Got actuated joints of shape"):
            js.motion.track(robot, np.zeros(shape))
    with pytest.raises(ValueError, match="Got joints of shape"):
        js.motion.follow(robot, delta_path(), guess=[0.0])
    with pytest.raises(ValueError, match="Got a pose of shape"):
        js.motion.track(robot, delta_path(), guess=[0.0])
