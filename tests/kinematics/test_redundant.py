"""Robots with more actuated joints than freedoms: a planar 4-RPR with four lengths for three coordinates."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from tests.bound_robots import LengthLeg

CORNERS = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])


@js.pytree
class FourRPR(js.Mechanism):
    """The platform's corners are turned by a quarter against the base's, which makes it stiff in turning."""

    base: jax.Array
    top: jax.Array
    space = js.SE2

    @property
    def length(self):
        return self.base

    def legs(self):
        x, y = CORNERS.T.astype(self.base.dtype)
        return LengthLeg(js.Vec(x * self.base, y * self.base), jnp.broadcast_to(self.base, (4,)))

    def attachments(self, position, rotation):
        return [position + rotation @ (js.Vec(float(y), float(-x)) * self.top) for x, y in CORNERS]

    def home(self):
        lengths = jnp.hypot(self.base + self.top, self.base - self.top)
        return jnp.zeros(3, self.base.dtype), jnp.stack([lengths] * 4)


@pytest.fixture
def robot():
    return FourRPR(jnp.asarray(0.5), jnp.asarray(0.1))


def poses(rng, count):
    return jnp.asarray(rng.uniform([-0.3, -0.3, -0.5], [0.3, 0.3, 0.5], (count, 3)))


def test_forward_kinematics_gives_the_pose_back_and_says_when_lengths_disagree(robot, rng):
    js.check_robot(robot, poses=64)
    sample = poses(rng, 50)
    joints = jax.vmap(js.inverse_kinematics, (None, 0))(robot, sample).value
    forward = jax.vmap(js.forward_kinematics, (None, 0))
    found = forward(robot, joints)
    assert bool(found.converged.all())
    np.testing.assert_allclose(found.value, sample, atol=1e-12)
    wrong = forward(robot, joints.at[:, 0].add(0.01))
    assert set(np.asarray(wrong.status).tolist()) == {int(js.Status.CONTRADICTION)}
    assert (np.asarray(wrong.residual_norm) > 1e-4).all()


@pytest.mark.exhaustive
def test_its_derivative_inverts_that_of_inverse_kinematics(robot, rng):
    pose = poses(rng, 1)[0]
    joints = js.inverse_kinematics(robot, pose).value
    down = js.inverse_jacobian(robot, pose)
    up = jax.jacfwd(lambda q: js.forward_kinematics(robot, q).value)(joints)
    np.testing.assert_allclose(up @ down, np.eye(3), atol=1e-12)
    by_design = jax.grad(lambda robot: js.forward_kinematics(robot, joints).value[2])
    moved = jax.grad(lambda top: js.forward_kinematics(FourRPR(robot.base, top), joints).value[2])(0.1)
    assert float(by_design(robot).top) == pytest.approx(float(moved))


def test_type_2_is_the_share_of_gram_determinants_and_zero_where_the_lines_meet(robot):
    """With its own corners a square is loose when it is not turned: all legs point to one place."""
    pose = jnp.array([0.1, -0.05, 0.2])
    down = np.asarray(js.inverse_jacobian(robot, pose)) / np.array([1, 1, 0.5])  # radians at the robot's length
    expected = np.sqrt(np.linalg.det(down.T @ down) / np.linalg.det(np.eye(3) + down.T @ down))
    assert float(js.singularities.measures(robot, pose).type2) == pytest.approx(expected, rel=1e-9)
    loose = [js.singularities.measures(robot, jnp.array([0.0, 0.0, np.pi / 2 + off])).type2 for off in (0.0, 1e-3)]
    assert float(loose[0]) < 1e-7 < float(loose[1]) < 1e-2
    there = js.robots.mounted(robot, [0.0, 0.0, 0.0])
    assert float(js.singularities.measures(there, pose).type2) == pytest.approx(expected, rel=1e-9)


def test_actuator_forces_are_the_least_that_hold_the_load(robot):
    pose, wrench = jnp.array([0.1, -0.05, 0.2]), np.array([3.0, -20.0, 0.4])
    down = np.asarray(js.inverse_jacobian(robot, pose, rates="twist"))
    found = js.statics.actuator_forces(robot, pose, wrench=wrench)
    np.testing.assert_allclose(down.T @ found.value, -wrench, atol=1e-9)
    np.testing.assert_allclose(found.value, -np.linalg.pinv(down.T) @ wrench, atol=1e-9)


def test_too_few_actuated_joints_are_counted(robot):
    @js.pytree
    class TwoLegs(FourRPR):
        def legs(self):
            legs = FourRPR(self.base, self.top).legs()
            return jax.tree.map(lambda leaf: leaf[:2], legs)

        def attachments(self, position, rotation):
            return FourRPR(self.base, self.top).attachments(position, rotation)[:2]

        def home(self):
            pose, joints = FourRPR(self.base, self.top).home()
            return pose, joints[:2]

    two = TwoLegs(robot.base, robot.top)
    with pytest.raises(ValueError, match=r"2 actuated joints for 3 freedoms.*at least as many"):
        js.forward_kinematics(two, two.home()[1])
