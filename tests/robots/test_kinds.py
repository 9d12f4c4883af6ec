"""Legs of different kinds in one robot, and legs that bind the platform in a way that depends on their joints."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxscissor as js
from tests.conftest import as_users, exhaustive

THIRDS = 2 * np.pi / 3 * np.arange(3)
POSE = jnp.array([0.002, 0.001, 0.402, 0.015, -0.02, 0.03])


def around(radius, angle, height=0.0):
    return np.array([radius * math.cos(angle), radius * math.sin(angle), height])


def leg(i, kind):
    """One leg of a hexapod: a crank, a slide along the floor or a telescope."""
    low, high = (THIRDS[i // 2] + (half if i % 2 else -half) for half in (0.3, 0.7))
    out, across = around(1, THIRDS[i // 2]), np.cross([0, 0, 1.0], around(1, THIRDS[i // 2]))
    hip, end = around(0.3, low), around(0.2, high, 0.4)
    start = {
        "crank": [js.Revolute(across, hip, actuated=True), js.Spherical(hip + 0.2 * out)],
        "slide": [js.Prismatic(out, hip, actuated=True), js.Spherical(hip)],
        "telescope": [js.Universal([1.0, 0, 0], [0, 1.0, 0], hip), js.Prismatic(end - hip, hip, actuated=True)],
    }[kind]
    return js.Chain([*start, js.Spherical(end)])


def hexapod(*kinds):
    return js.robots.linkage([leg(i, kind) for i, kind in enumerate(kinds)], [0, 0, 0.4, 0, 0, 0])


MIXED = "crank", "slide", "telescope", "crank", "slide", "telescope"


PLANAR = "crank", "slide", "telescope"
PLACE = jnp.array([0.01, -0.02, 0.05])


def planar(*kinds):
    """A platform in the plane on three legs."""
    chains = []
    for angle, kind in zip(THIRDS, kinds, strict=True):
        out, side = around(1, angle)[:2], np.array([-math.sin(angle), math.cos(angle)])
        foot, end = 0.5 * out, around(0.12, angle + 0.6)[:2]
        start = {
            "crank": [js.Revolute(None, foot, actuated=True), js.Revolute(None, 0.3 * out + 0.15 * side)],
            "slide": [js.Prismatic(side, foot, actuated=True), js.Revolute(None, foot - 0.2 * side)],
            "telescope": [js.Revolute(None, foot), js.Prismatic(end - foot, foot, actuated=True)],
        }[kind]
        chains.append(js.Chain([*start, js.Revolute(None, end)]))
    return js.robots.linkage(chains, [0.0, 0.0, 0.0], space=js.SE2)


def tricept():
    """Neumann's robot: three telescopes, and a fourth leg without a motor that holds the platform at right angles."""
    legs = [
        js.Chain(
            [
                js.Universal([1.0, 0, 0], [0, 1.0, 0], low),
                js.Prismatic(high - low, low, actuated=True),
                js.Spherical(high),
            ]
        )
        for low, high in ((around(0.4, angle), around(0.15, angle, 0.6)) for angle in THIRDS)
    ]
    middle = js.Chain([js.Universal([1.0, 0, 0], [0, 1.0, 0], [0, 0, 0]), js.Prismatic([0, 0, 1.0], [0, 0, 0.6])])
    return js.robots.linkage([*legs, middle], [0, 0, 0.6, 0, 0, 0], dependent=("roll", "pitch", "yaw"))


def three_rps():
    """Hunt's robot: telescopes that pins on the base keep in their planes."""
    legs = [
        js.Chain(
            [
                js.Revolute(np.cross([0, 0, 1.0], around(1, angle)), low),
                js.Prismatic(high - low, low, actuated=True),
                js.Spherical(high),
            ]
        )
        for angle, low, high in ((a, around(0.4, a), around(0.2, a, 0.6)) for a in THIRDS)
    ]
    return js.robots.linkage(legs, [0, 0, 0.6, 0, 0, 0], dependent=("x", "y", "yaw"))


def arm():
    """Two telescopes in the plane, and a leg without a motor, a pin and a slide, along which the platform points."""
    lows, high = ([-0.3, 0.0], [0.4, 0.1]), [0.0, 0.5]
    legs = [
        js.Chain(
            [js.Revolute(None, low), js.Prismatic(np.subtract(high, low), low, actuated=True), js.Revolute(None, high)]
        )
        for low in lows
    ]
    middle = js.Chain([js.Revolute(None, [0.0, 0.0]), js.Prismatic([0.0, 1.0], high)])
    return js.robots.linkage([*legs, middle], [*high, 0.0], space=js.SE2, dependent=("alpha",))


@pytest.mark.parametrize("build", exhaustive(lambda: hexapod(*MIXED), three_rps, tricept, arm))
def test_such_a_robot_keeps_the_contract(build):
    js.check_robot(build(), poses=8)


def test_a_leg_among_others_does_what_it_does_among_its_own(rng):
    mixed, poses = planar(*PLANAR), jnp.asarray(rng.uniform(-0.1, 0.1, (200, 3)))
    solve = as_users(jax.vmap(js.inverse_kinematics, (None, 0)))
    found = solve(mixed, poses)
    assert found.converged.sum() > 100
    for i, kind in enumerate(PLANAR):
        alone = jax.jit(jax.vmap(js.inverse_kinematics, (None, 0)))(planar(*[kind] * 3), poses)
        np.testing.assert_allclose(found.value[:, i], alone.value[:, i], atol=1e-14)
    back = jax.jit(jax.vmap(js.forward_kinematics, (None, 0)))(mixed, found.value)
    same = np.asarray(found.converged & back.converged)
    assert same.sum() > 50
    np.testing.assert_allclose(back.value[same], poses[same], atol=1e-12)
    modes = js.inverse_kinematics_all(mixed, PLACE)
    assert modes.valid.sum(axis=1).tolist() == [2, 2, 1]  # a length is not negative
    each, names = js.margins(mixed, PLACE), mixed.legs().limits
    assert each.shape == (3, 7) and len(names) == 6 and "CrankAndRod: least angle" in names


def test_what_bars_of_mixed_legs_would_need_is_refused():
    section = js.statics.Section.rectangle(js.statics.Material.aluminum(), depth=0.02, width=0.01)
    with pytest.raises(ValueError, match="legs of different kinds"):
        js.statics.actuator_forces(planar(*PLANAR), PLACE, wrench=[1.0, 0.0, 0.0], section=section)
    with pytest.raises(ValueError, match="hang together"):
        js.export.to_mjcf(planar(*PLANAR))


def test_dimensions_of_mixed_legs_have_derivatives():
    mixed, step = planar(*PLANAR), 1e-6

    def joints(x, i, joint):
        points = mixed.given[i].joints[joint].point
        moved = jax.tree.map(lambda leaf: leaf + x * jnp.array([0.3, -0.5]) if leaf is points else leaf, mixed)
        return js.inverse_kinematics(moved, PLACE).value

    for i, joint in ((0, 1), (1, 1), (2, 0)):
        slope = jax.jit(jax.jacfwd(joints), static_argnums=(1, 2))(0.0, i, joint)
        ends = jnp.stack([joints(sign * step, i, joint) for sign in (1, -1)])
        np.testing.assert_allclose(slope, (ends[0] - ends[1]) / (2 * step), atol=1e-8)
        assert abs(slope[i]) > 1e-3 and np.abs(np.delete(slope, i)).max() == 0


@pytest.mark.exhaustive
def test_tricept_points_along_its_middle_leg(rng):
    robot = tricept()
    assert [len(leg) for leg in robot.actuation()] == [1, 1, 1, 3] and robot.home()[1].shape == (6,)
    given = jnp.asarray(
        np.column_stack([rng.uniform(-0.15, 0.15, (20, 2)), rng.uniform(0.5, 0.7, 20), np.zeros((20, 3))])
    )
    poses = jax.jit(jax.vmap(js.constrained_pose, (None, 0)))(robot, given).value
    x, y, z = np.asarray(given)[:, :3].T
    reach = np.sqrt(x**2 + y**2 + z**2)
    np.testing.assert_allclose(poses[:, 3:], np.stack([np.arctan2(-y, z), np.arcsin(x / reach), 0 * x], 1), atol=1e-9)
    found = jax.jit(jax.vmap(js.inverse_kinematics, (None, 0)))(robot, poses)
    assert found.converged.all()
    np.testing.assert_allclose(
        found.value[:, 3:], np.stack([np.arctan2(-y, z), np.arcsin(x / reach), reach - 0.6], 1), atol=1e-9
    )
    back = jax.jit(jax.vmap(js.forward_kinematics, (None, 0)))(robot, robot.actuated(found.value))
    assert back.converged.all()
    np.testing.assert_allclose(back.value, poses, atol=1e-9)


@pytest.mark.exhaustive
def test_platform_points_along_a_leg_without_a_motor(rng):
    """A constraint that depends on the joints, of a leg that has more of them than the others."""
    robot = arm()
    assert robot.actuation() == ((True,), (True,), (False, False))
    given = jnp.asarray(np.column_stack([rng.uniform(-0.2, 0.2, 20), rng.uniform(0.4, 0.6, 20), np.zeros(20)]))
    poses = jax.jit(jax.vmap(js.constrained_pose, (None, 0)))(robot, given).value
    x, y, alpha = np.asarray(poses).T
    np.testing.assert_allclose(alpha, np.arctan2(-x, y), atol=1e-12)
    found = jax.jit(jax.vmap(js.inverse_kinematics, (None, 0)))(robot, poses)
    assert found.converged.all()
    rods = [np.hypot(x - a, y - b) - np.hypot(a, 0.5 - b) for a, b in ((-0.3, 0.0), (0.4, 0.1))]
    np.testing.assert_allclose(found.value.T, [*rods, alpha, np.hypot(x, y) - 0.5], atol=1e-12)
    back = jax.jit(jax.vmap(js.forward_kinematics, (None, 0)))(robot, robot.actuated(found.value))
    np.testing.assert_allclose(back.value, poses, atol=1e-12)
    off = js.inverse_kinematics(robot, poses[0].at[2].add(0.1))
    assert off.status == js.Status.NO_SOLUTION


def test_three_rps_moves_as_hunt_says(rng):
    """Points in planes through the axis: R21 = R12, x = r (R11 - R22) / 2, y = -r R21."""
    robot = three_rps()
    given = jnp.asarray(
        np.column_stack([np.zeros((20, 2)), rng.uniform(0.5, 0.7, 20), rng.uniform(-0.4, 0.4, (20, 2)), np.zeros(20)])
    )
    poses = jax.jit(jax.vmap(js.constrained_pose, (None, 0)))(robot, given).value
    positions = np.asarray(poses[:, :3])
    turns = Rotation.from_euler("XYZ", poses[:, 3:]).as_matrix()
    np.testing.assert_allclose(turns[:, 1, 0], turns[:, 0, 1], atol=1e-12)
    np.testing.assert_allclose(positions[:, 0], 0.1 * (turns[:, 0, 0] - turns[:, 1, 1]), atol=1e-12)
    np.testing.assert_allclose(positions[:, 1], -0.2 * turns[:, 1, 0], atol=1e-12)
    found = jax.jit(jax.vmap(js.inverse_kinematics, (None, 0)))(robot, poses)
    ends = positions[:, None] + np.einsum("nij,kj->nki", turns, np.stack([around(0.2, a) for a in THIRDS]))
    lengths = np.linalg.norm(ends - np.stack([around(0.4, a) for a in THIRDS]), axis=-1)
    home = math.hypot(0.2, 0.6)
    np.testing.assert_allclose(robot.actuated(found.value), lengths - home, atol=1e-12)
    ratios = js.gear_ratios(robot, poses[0])
    assert np.isfinite(np.asarray(jax.tree.leaves(ratios)[0])).all()
