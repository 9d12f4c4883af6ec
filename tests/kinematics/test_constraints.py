"""Poses of robots whose platform cannot move freely, on the 3-PRS, whose parasitic motion has a closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from tests.toys import LinearDelta, ThreePRS


@pytest.fixture(scope="module")
def prs():
    return ThreePRS.example()


@pytest.fixture(scope="module")
def solve():
    return jax.jit(jax.vmap(js.constrained_pose, (None, 0)))


@pytest.fixture
def poses(rng):
    """Tilts to 30 deg; x, y and yaw are off by up to 0.05."""
    off, tilt = rng.uniform(-0.05, 0.05, (100, 3)), rng.uniform(-np.pi / 6, np.pi / 6, (100, 2))
    return np.column_stack([off[:, :2], rng.uniform(0.5, 1.0, 100), tilt, off[:, 2]])


def rotation(pose):
    """Rx(roll) Ry(pitch) Rz(yaw), as matrices."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(pose[3:]), np.sin(pose[3:])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    return about_x @ about_y @ np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])


def test_every_ball_joint_ends_in_the_plane_of_its_leg(prs, solve, poses):
    solution = solve(prs, poses)
    assert solution.converged.all() and solution.residual_norm.max() < 1e-13
    kept = [2, 3, 4]
    assert np.array_equal(solution.value[:, kept], poses[:, kept]), "height and tilt are the caller's"
    angles = 2 * np.pi * np.arange(3) / 3
    corners = 0.3 * np.stack([np.cos(angles), np.sin(angles), 0 * angles])
    normals = np.stack([-np.sin(angles), np.cos(angles), 0 * angles])
    for pose in np.asarray(solution.value):
        points = pose[:3, None] + rotation(pose) @ corners
        assert np.abs((points * normals).sum(axis=0)).max() < 1e-13
        # The planes y = 0 and y = +-sqrt(3) x in terms of R: R21 = R12, and the shifts that go with it.
        turn = rotation(pose)
        assert turn[1, 0] == pytest.approx(turn[0, 1], abs=1e-13)
        assert pose[0] == pytest.approx(0.3 / 2 * (turn[0, 0] - turn[1, 1]), abs=1e-13)
        assert pose[1] == pytest.approx(-0.3 * turn[1, 0], abs=1e-13)


def test_a_consistent_pose_stays(prs, solve, poses):
    once = solve(prs, poses).value
    again = solve(prs, once)
    assert np.abs(again.value - once).max() < 1e-15 and again.num_steps.max() <= 1
    level = np.array([[0.0, 0.0, 0.8, 0.0, 0.0, 0.0]] * 100)
    assert np.array_equal(solve(prs, level).value, level)
    delta = LinearDelta.example()
    free = js.constrained_pose(delta, [0.1, 0.2, 0.3])
    assert bool(free.converged) and np.array_equal(free.value, [0.1, 0.2, 0.3])


def test_derivatives_are_differences(prs, solve, poses):
    by_pose = jax.jit(jax.vmap(jax.jacfwd(lambda pose: js.constrained_pose(prs, pose).value)))(poses)
    step = 1e-5
    for i in range(6):
        shift = step * np.eye(6)[i]
        differences = (solve(prs, poses + shift).value - solve(prs, poses - shift).value) / (2 * step)
        assert np.abs(by_pose[:, :, i] - differences).max() < 1e-8
    assert np.abs(by_pose[:, :, [0, 1, 5]]).max() == 0, "the guess is forgotten"

    def shifts(robot, pose):
        return jnp.sum(js.constrained_pose(robot, pose).value[:2])

    gradient = jax.jit(jax.vmap(jax.grad(shifts), (None, 0)))(prs, poses)
    solved = np.asarray(solve(prs, poses).value)
    closed = 1e-12  # the solve ends at a residual of 256 eps
    assert np.abs(gradient.top_radius - solved[:, :2].sum(axis=1) / 0.3).max() < closed, "both grow with the radius"
    assert np.abs(gradient.rod).max() < closed


def test_what_cannot_be_met_says_so(prs, solve):
    poses = np.tile([0.0, 0.0, 0.8, 0.1, 0.2, 0.0], (100, 1))
    poses[0, 3], poses[1, 0] = np.nan, np.inf
    solution = solve(prs, poses)
    assert (solution.status[:2] == js.Status.NONFINITE).all() and np.isnan(solution.value[:2]).all()
    assert solution.converged[2:].all()
    with pytest.raises(ValueError, match=r"expects \(6,\)"):
        js.constrained_pose(prs, np.zeros(3))


def test_constraints_must_be_as_many_as_dependent_coordinates(prs):
    class Fewer(ThreePRS):
        dependent = ("x", "yaw")

    class Misnamed(ThreePRS):
        dependent = ("x", "y", "gamma")

    cases = [(Fewer, r"Got 3 constraints .*\('x', 'yaw'\); expected as many. Name in Fewer"), (Misnamed, "some of")]
    for kind, message in cases:
        with pytest.raises(ValueError, match=message):
            js.constrained_pose(js.pytree(kind)(prs.rod, prs.top_radius), [0.0, 0.0, 0.8, 0.1, 0.2, 0.0])
