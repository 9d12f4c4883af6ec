"""Legs from joints: those without a closed form, what binds the platform, and what is refused."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxscissor as js
from tests.conftest import exhaustive

THIRDS = 2 * np.pi / 3 * np.arange(3)


def planar(actuated):
    """A 3-RRR of which another joint than the motors on the base may be actuated."""
    chains = []
    for angle in THIRDS:
        out, side = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
        end = 0.12 * np.array([math.cos(angle + 0.6), math.sin(angle + 0.6)])  # else the lines of force meet
        points = 0.5 * out, 0.3 * out + 0.15 * side, end
        chains.append(js.Chain([js.Revolute(None, p, actuated=i == actuated) for i, p in enumerate(points)]))
    return js.robots.linkage(chains, [0.0, 0.0, 0.0], space=js.SE2)


def carried():
    """Planar legs that hold the platform by a slide on it: what they see is its frame."""
    chains = []
    for angle in THIRDS:
        out, side = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
        motor, elbow = js.Revolute(None, 0.5 * out, actuated=True), js.Revolute(None, 0.3 * out + 0.15 * side)
        chains.append(js.Chain([motor, elbow, js.Prismatic(side, 0.12 * out)]))
    return js.robots.linkage(chains, [0.0, 0.0, 0.0], space=js.SE2)


def spatial():
    """Six legs of three pins and a ball."""
    chains = []
    for i in range(6):
        low, high = (THIRDS[i // 2] + (half if i % 2 else -half) for half in (0.3, 0.75))
        hip, end = (
            np.array([math.cos(low), math.sin(low), 0]) * 0.3,
            np.array([math.cos(high), math.sin(high), 2]) * 0.2,
        )
        radial = np.array([math.cos(low), math.sin(low), 0])
        knee = 0.5 * (hip + end) + 0.1 * radial
        pins = [js.Revolute(radial, hip), js.Revolute(np.cross([0, 0, 1.0], radial), hip, actuated=True)]
        chains.append(js.Chain([*pins, js.Revolute(np.cross(end - knee, radial), knee), js.Spherical(end)]))
    return js.robots.linkage(chains, [0, 0, 0.4, 0, 0, 0])


def three_rrs():
    """Cranks whose rods are guided: a robot like the 3-PRS."""
    chains = []
    for angle in THIRDS:
        out, across = np.array([math.cos(angle), math.sin(angle), 0]), np.array([-math.sin(angle), math.cos(angle), 0])
        hip, knee, end = 0.4 * out, 0.55 * out + [0, 0, 0.1], 0.2 * out + [0, 0, 0.5]
        chains.append(js.Chain([js.Revolute(across, hip, actuated=True), js.Revolute(across, knee), js.Spherical(end)]))
    return js.robots.linkage(chains, [0, 0, 0.5, 0, 0, 0], dependent=("x", "y", "yaw"))


def universal(skew):
    """A 3-UPU whose outer axes are turned out of the base's plane, those of the platform otherwise than those below."""
    chains = []
    for angle in THIRDS:
        out, along = np.array([math.cos(angle), math.sin(angle), 0]), np.array([-math.sin(angle), math.cos(angle), 0])
        low, high = 0.5 * out, 0.25 * out + [0, 0, 0.8]
        outer = [along + skew * out, along + 2 * skew * np.eye(3)[2]]
        inner = [np.cross(axis, high - low) for axis in outer]
        joints = js.Universal(outer[0], inner[0], low), js.Prismatic(high - low, low, actuated=True)
        chains.append(js.Chain([*joints, js.Universal(inner[1], outer[1], high)]))
    return js.robots.linkage(chains, [0, 0, 0.8, 0, 0, 0], dependent=("roll", "pitch", "yaw"))


ROBOTS = {
    "RR*R": lambda: planar(1),
    "R*RP": carried,
    "RR*RS": spatial,
    "R*RS": three_rrs,
    "UP*U": lambda: universal(0.2),
}


@pytest.mark.parametrize("name", exhaustive(*ROBOTS))
def test_a_robot_of_chains_keeps_the_contract(name):
    robot = ROBOTS[name]()
    assert robot.chains()[0].letters == name
    js.check_robot(robot, poses=64)


def test_a_chain_without_a_closed_form_has_the_joints_of_one_that_has():
    """The elbow's angle, and the passive one at the base, from the law of cosines of the leg with its motor there."""
    serial, closed = planar(1), planar(0)
    pose = jnp.array([0.03, -0.02, 0.1])
    whole = js.inverse_kinematics(serial, pose)
    assert whole.converged
    np.testing.assert_allclose(whole.value[::2], js.inverse_kinematics(closed, pose).value, atol=1e-12)
    up = js.forward_kinematics(serial, serial.actuated(whole.value))
    np.testing.assert_allclose(up.value, pose, atol=1e-12)


def test_ends_are_where_a_product_of_rotations_carries_them(rng):
    robot = spatial()
    home = np.array([0, 0, 0.4, 0, 0, 0])
    pose = home + rng.uniform(-0.02, 0.02, 6)
    found = js.inverse_kinematics(robot, pose)
    assert found.converged
    seen = robot.attachments(*robot.space.place(jnp.asarray(pose)))
    for chain, q, point in zip(robot.chains(), np.asarray(found.value).reshape(6, 3), seen, strict=True):
        end = np.asarray(chain.joints[-1].point)
        for pin, angle in reversed(list(zip(chain.joints, q, strict=False))):
            axis, at = np.asarray(pin.axis) / np.linalg.norm(pin.axis), np.asarray(pin.point)
            end = at + Rotation.from_rotvec(angle * axis).apply(end - at)
        np.testing.assert_allclose(end, np.asarray(point.array()), atol=1e-12)


def test_universal_joints_keep_the_twist_of_their_legs():
    """The inner axes, at right angles to their outer ones and to the leg, keep their angle about it."""
    robot = universal(0.2)
    pose = js.constrained_pose(robot, [0.05, -0.04, 0.85, 0.0, 0.0, 0.0])
    assert pose.converged and np.abs(np.asarray(pose.value)[3:]).max() > 1e-3  # it turns as it moves
    turned = Rotation.from_euler("XYZ", np.array(pose.value)[3:])

    def twist(low, high, bar):
        one, other = np.cross(low, bar), np.cross(high, bar)
        return math.atan2(np.cross(one, other) @ bar / np.linalg.norm(bar), one @ other)

    for chain in robot.chains():
        low, high = (np.array(joint.point) for joint in chain.joints[::2])
        axes = np.array(chain.joints[0].axis), np.array(chain.joints[2].second)
        there = np.asarray(pose.value)[:3] + turned.apply(high - [0, 0, 0.8])
        assert twist(axes[0], turned.apply(axes[1]), there - low) == pytest.approx(twist(*axes, high - low), abs=1e-12)


def test_points_and_axes_are_dimensions():
    """The derivative by the point of a joint through a leg without a closed form, against differences."""
    robot, pose = planar(1), jnp.array([0.03, -0.02, 0.1])
    leaves, tree = jax.tree.flatten(robot)

    def joints(x):
        moved = [leaves[0].at[0].set(x), *leaves[1:]]
        return js.inverse_kinematics(jax.tree.unflatten(tree, moved), pose).value

    at = leaves[0][0]
    slope, difference = jax.jacfwd(joints)(at), (joints(at + 1e-6) - joints(at - 1e-6)) / 2e-6
    np.testing.assert_allclose(slope, difference, atol=1e-7)
    assert np.abs(difference).max() > 0.1


def test_limits_of_joints_are_margins():
    motor = js.Revolute(None, (0.0, 0.0), actuated=True, limits=(-0.5, 0.25))
    chains = [js.Chain([motor, js.Revolute(None, (0.0, 0.2)), js.Revolute(None, (0.1, 0.4))])] * 2
    robot = js.robots.linkage(chains, [0.1, 0.4], space=js.robots.R2)
    np.testing.assert_allclose(js.margins(robot, [0.1, 0.4])[0, 1:], [0.5, 0.25])
    assert robot.legs().limits == ("least angle", "greatest angle")


PIN, BALL = js.Revolute((1.0, 0, 0), (0.0, 0, 1)), js.Spherical((0.0, 0, 2))


@pytest.mark.parametrize(
    ("joints", "said"),
    [
        ([], "expected Revolute"),
        ([1.0], "expected Revolute"),
        ([js.Prismatic((1.0, 0, 0), (0.0, 0, 1), actuated=True), PIN, BALL], "right angles"),
        ([js.Revolute((0, 1.0, 0), (0.0, 0, 0), actuated=True), PIN, BALL], "parallel"),
    ],
)
def test_chains_that_are_none_are_refused(joints, said):
    with pytest.raises(ValueError, match=said):
        js.Chain(joints)


def test_robots_that_are_none_are_refused():
    motor, ball = js.Revolute((0, 1.0, 0), (0.0, 0, 0), actuated=True), js.Spherical((0.2, 0, 1.0))
    rod = js.Chain([motor, js.Spherical((0.2, 0, 0.1)), ball])
    more = js.Chain([motor, motor, motor, motor, ball])
    with pytest.raises(ValueError, match="4 joint coordinates face 3 equations"):
        js.robots.linkage([more] * 6, [0, 0, 1.0, 0, 0, 0])
    with pytest.raises(ValueError, match="pose of shape"):
        js.robots.linkage([rod] * 6, [0, 0, 1.0])
    with pytest.raises(ValueError, match="axis is zero"):
        js.Revolute((0.0, 0, 0), (0.0, 0, 0))
    with pytest.raises(ValueError, match="point of shape"):
        js.Spherical((0.0,))
