"""Poses from positions and orientations as people have them, against SciPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxscissor as js
from tests.toys import LinearDelta

ANGLES = np.array([0.3, -0.4, 0.5])


@pytest.mark.parametrize("sequence", ["zyx", "ZYX", "XYZ", "zxz"])
def test_one_rotation_in_three_ways_is_one_pose(prototype, sequence):
    place, rotation = [0.1, 0.2, 1.0], Rotation.from_euler(sequence, ANGLES)
    pose = js.pose(prototype, place, euler=(sequence, ANGLES))
    np.testing.assert_allclose(pose, js.pose(prototype, place, matrix=rotation.as_matrix()), atol=1e-14)
    np.testing.assert_allclose(pose, js.pose(prototype, place, quaternion=3 * rotation.as_quat()), atol=1e-14)
    frame = js.frame(prototype, pose)
    np.testing.assert_allclose(frame.position, place, atol=1e-15)
    np.testing.assert_allclose(frame.matrix, rotation.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(Rotation.from_quat(frame.quaternion).as_matrix(), rotation.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(frame.euler("zyx"), rotation.as_euler("zyx"), atol=1e-14)


def test_the_angles_of_a_pose_are_turns_about_the_platforms_own_axes(prototype):
    np.testing.assert_allclose(js.pose(prototype, [0, 0, 1.0], euler=("XYZ", ANGLES))[3:], ANGLES, atol=1e-15)
    np.testing.assert_allclose(js.pose(prototype, [0, 0, 1.0])[3:], 0)


def test_planar_robots_have_poses_too():
    robot = js.NavaroII.prototype()
    for given in ({"euler": ("z", [0.5])}, {"quaternion": [0, 0, np.sin(0.25), np.cos(0.25)]}):
        np.testing.assert_allclose(js.pose(robot, [45.0, 26.0], **given), [45, 26, 0.5], atol=1e-15)
    np.testing.assert_allclose(js.frame(robot, [45.0, 26.0, 0.5]).euler("zyx"), [0.5, 0, 0], atol=1e-15)


def test_a_pose_that_the_space_has_not_is_nan(prototype):
    delta = LinearDelta.example()
    assert np.isfinite(js.pose(delta, [0.1, 0.0, 0.3])).all()
    assert np.isnan(js.pose(delta, [0.1, 0.0, 0.3], euler=("x", [0.1]))).all()
    assert np.isnan(js.pose(js.NavaroII.prototype(), [45.0, 26.0], euler=("x", [0.1]))).all()
    assert np.isnan(js.pose(prototype, [0, 0, 1.0], matrix=2 * np.eye(3))).all()


def test_poses_are_mapped_differentiated_and_keep_their_precision(prototype):
    def pose(quaternion):
        return js.pose(prototype, jnp.array([0.1, 0.2, 1.0]), quaternion=quaternion)

    at = jnp.array([0.1, 0.2, 0.3, 0.9])
    assert jax.vmap(pose)(jnp.stack([at, 2 * at])).shape == (2, 6)
    slope = jax.jacrev(pose)(at)
    difference = (pose(at + 1e-6 * jnp.eye(4)[1]) - pose(at - 1e-6 * jnp.eye(4)[1])) / 2e-6
    np.testing.assert_allclose(slope[:, 1], difference, atol=1e-8)
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), prototype)
    given = np.array([0, 0, 1], np.float32), np.array([0, 0, 0.5], np.float32)
    found = js.pose(single, given[0], euler=("XYZ", given[1]))
    assert found.dtype == js.frame(single, found).quaternion.dtype == jnp.float32


def test_wrong_shapes_are_told(prototype):
    for given, said in (
        ({"matrix": np.eye(2)}, "matrix of shape"),
        ({"quaternion": [1.0, 0, 0]}, "quaternion of shape"),
        ({"euler": ("zyx", [0.1])}, "one for each letter"),
        ({"matrix": np.eye(3), "quaternion": [0, 0, 0, 1.0]}, "expected one of them"),
    ):
        with pytest.raises(ValueError, match=said):
            js.pose(prototype, [0, 0, 1.0], **given)
    with pytest.raises(ValueError, match="position of shape"):
        js.pose(prototype, [0, 1.0])
