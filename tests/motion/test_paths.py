"""Pose paths against SciPy's rotations and splines."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import jaxscissor as js

ROBOT = js.TripleScissorExtender.prototype()
VIA = np.array(
    [
        [0.1, 0.0, 1.0, 0.1, -0.2, 0.3],
        [0.2, 0.1, 1.1, 0.3, 0.1, -0.4],
        [0.0, 0.2, 1.2, -0.2, 0.2, 0.1],
        [-0.1, 0.0, 1.1, 0.0, 0.5, 0.2],
    ]
)


def turns(poses):
    """R = Rx Ry Rz [RAL17 eq. 1]."""
    return Rotation.from_euler("XYZ", np.asarray(poses)[..., 3:])


def test_a_straight_line_goes_evenly_along_one_screw_free_twist():
    path = js.motion.straight_line(ROBOT, VIA[0], VIA[1], samples=11)
    np.testing.assert_allclose(path[::10], VIA[:2], atol=1e-14)
    np.testing.assert_allclose(np.diff(path[:, :3], axis=0), np.tile((VIA[1] - VIA[0])[:3] / 10, (10, 1)), atol=1e-13)
    steps = (turns(path[1:]) * turns(path[:-1]).inv()).as_rotvec()
    whole = (turns(VIA[1]) * turns(VIA[0]).inv()).as_rotvec()
    np.testing.assert_allclose(steps, np.tile(whole / 10, (10, 1)), atol=1e-13)


def test_a_path_through_poses_is_the_natural_spline_of_their_twists_from_the_first():
    path = js.motion.via_points(ROBOT, VIA, samples=13)
    np.testing.assert_allclose(path[::4], VIA, atol=1e-14)
    twists = np.hstack([VIA[:, :3] - VIA[:1, :3], (turns(VIA) * turns(VIA[0]).inv()).as_rotvec()])
    spline = CubicSpline(np.arange(4), twists, bc_type="natural")(np.linspace(0, 3, 13))
    np.testing.assert_allclose(path[:, :3], VIA[0, :3] + spline[:, :3], atol=1e-14)
    apart = turns(path).inv() * (Rotation.from_rotvec(spline[:, 3:]) * turns(VIA[0]))
    assert apart.magnitude().max() < 1e-14


def test_paths_of_a_robot_turned_in_the_world_are_turned_with_it():
    world = Rotation.from_euler("XYZ", [0.4, -0.3, 0.7])

    def turned(poses):
        poses = np.array(poses)
        return np.hstack([world.apply(poses[:, :3]), (world * turns(poses)).as_euler("XYZ")])

    path, there = js.motion.via_points(ROBOT, VIA), js.motion.via_points(ROBOT, turned(VIA))
    np.testing.assert_allclose(there[:, :3], turned(path)[:, :3], atol=1e-12)
    assert (turns(there).inv() * turns(turned(path))).magnitude().max() < 1e-12


def test_paths_are_differentiable_batched_and_keep_their_precision():
    robot, via = js.NavaroII.prototype(), np.array([[45.0, 26.0, 0.3], [52.0, 30.0, 0.6], [40.0, 33.0, 0.2]])

    def middle(poses):
        return js.motion.via_points(robot, poses, samples=13)[4]

    step = 1e-6 * np.eye(9).reshape(9, 3, 3)

    @jax.jit
    def derivatives(poses):
        moved = jax.vmap(middle)(jnp.concatenate([poses[None] + step, poses[None] - step]))
        return jax.jacfwd(middle)(poses), jax.jacrev(middle)(poses), (moved[:9] - moved[9:]) / 2e-6

    forward, reverse, difference = derivatives(jnp.asarray(via))
    np.testing.assert_allclose(forward, reverse, atol=1e-13)
    np.testing.assert_allclose(np.moveaxis(forward, 0, -1).reshape(9, 3), difference, atol=1e-7)
    single = jax.tree.map(lambda x: x.astype(np.float32), ROBOT)
    assert js.motion.via_points(single, VIA.astype(np.float32)).dtype == np.float32


def test_wrong_arguments_are_refused():
    with pytest.raises(ValueError, match="Got poses of shape"):
        js.motion.via_points(ROBOT, VIA[:1])
    with pytest.raises(ValueError, match="Got samples=1"):
        js.motion.via_points(ROBOT, VIA, samples=1)
    with pytest.raises(ValueError, match="Got a pose of shape"):
        js.motion.straight_line(ROBOT, VIA[0, :3], VIA[1])
