"""Robots whose legs have dimensions of their own, for every robot."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor.robots._contract import joint_places
from tests.kinematics.test_contract import close, shaken_joints


@jax.jit
def everything(robot, pose, joints):
    """What every robot can do, in one program for all tests of a robot."""
    inverse, forward = js.inverse_kinematics(robot, pose), js.forward_kinematics(robot, joints)
    home = robot.home()
    return {
        "home": home,
        "closed": js.residual(robot, home[0], joints=home[1]),
        "inverse": inverse.value,
        "forward": forward.value,
        "jacobian": js.inverse_jacobian(robot, pose, rates="twist"),
        "margin": js.feasibility(robot, pose).margin,
        "statuses": (inverse.status, forward.status),
    }


def reached(robot, rng):
    """A pose, and the actuated joints that take the robot there."""
    joints = shaken_joints(robot, rng)[0]
    return everything(robot, robot.home()[0], joints)["forward"], joints


def test_equal_legs_make_the_robot_itself(robot_of_a_kind, rng):
    robot = robot_of_a_kind
    at = reached(robot, rng)
    ours, theirs = everything(js.per_leg(robot), *at), everything(robot, *at)
    assert ours.pop("statuses") == theirs.pop("statuses") == (js.Status.CONVERGED,) * 2
    for one, other in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        assert close(one, other, 1e-11)


def test_a_leg_of_other_dimensions_moves_its_own_joints_alone(robot_of_a_kind, rng):
    robot = robot_of_a_kind
    at, equal = reached(robot, rng), js.per_leg(robot)
    longer = js.robots.PerLeg(jax.tree.map(lambda leaf: leaf.at[1].mul(1.001), equal.copies))
    before, after = (everything(one, *at)["inverse"] for one in (equal, longer))
    for leg, own in enumerate(joint_places(robot)):
        moved = np.abs(np.asarray(after - before))[list(own)]
        assert (moved == 0).all() if leg != 1 else moved.max() > 1e-6


def test_home_closes_legs_of_different_dimensions(robot_of_a_kind, rng):
    robot = robot_of_a_kind
    at, equal = reached(robot, rng), js.per_leg(robot)
    shaken = jax.tree.map(lambda leaf: leaf * (1 + 1e-3 * rng.uniform(-1, 1, leaf.shape)), equal.copies)
    crooked = everything(js.robots.PerLeg(shaken), *at)
    assert np.abs(crooked["closed"]).max() < 1e-12
    assert 1e-6 < np.abs(crooked["home"][1] - robot.home()[1]).max() < 0.1 * float(robot.length)


def test_the_derivative_of_a_shared_dimension_is_the_sum_over_the_legs(prototype):
    pose = prototype.home()[0] + jnp.array([0.05, -0.03, 0.1, 0.1, -0.2, 0.1])

    def joints(robot):
        return jnp.sum(jnp.sin(js.inverse_kinematics(robot, pose).value))

    shared, own = jax.grad(joints)(prototype), jax.grad(joints)(js.per_leg(prototype)).copies
    for whole, parts in zip(jax.tree.leaves(shared), jax.tree.leaves(own), strict=True):
        assert close(jnp.sum(parts, axis=0), whole, 1e-11)


def test_named_dimensions_are_replaced_leg_by_leg(prototype):
    radii = jnp.array([0.2, 0.21, 0.22])
    robot = js.per_leg(prototype, top_radius=radii, link_lengths=prototype.link_lengths * 1.01)
    assert (robot.copies.top_radius == radii).all()
    assert (robot.copies.link_lengths == 1.01 * prototype.link_lengths[None]).all()
    tips = [tip.array() for tip in robot.attachments(*robot.space.place(jnp.zeros(6)))]
    assert close(jnp.linalg.norm(jnp.stack(tips), axis=1), radii, 1e-15)
    text = repr(robot)
    assert text.startswith("PerLeg TripleScissorExtender")
    assert all(field.name in text for field in dataclasses.fields(prototype))
    mode = js.per_leg(js.NavaroII.prototype(6))
    assert mode.copies.mode == 6 and mode.actuation() == js.NavaroII.prototype(6).actuation()
    with pytest.raises(ValueError, match=r"Got 'k3'.*top_radius"):
        js.per_leg(prototype, k3=0.1)
    with pytest.raises(ValueError, match=r"top_radius of shape \(2,\).*\(3,\)"):
        js.per_leg(prototype, top_radius=[0.1, 0.2])


def test_pictures_show_each_leg_as_it_is(prototype):
    crooked = js.per_leg(prototype, azimuths=prototype.azimuths[None] + jnp.array([[0.0], [0.3], [0.0]]))
    ax = js.plot.robot(crooked)
    assert len(ax.lines) + len(ax.collections) > 0
