"""Stiffness and sag against a plain equilibrium in NumPy, and the laws that they obey."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxscissor as js
from jaxscissor.robots._contract import angular_joints, constraints_on
from jaxscissor.statics import Load
from tests.conftest import ALL, exhaustive, scaled
from tests.statics.test_balance import poses_near_home, slanted
from tests.toys import LinearDelta


def tilted_platform(name):
    """A robot of straight legs: feet and corners of the legs, for a reference that knows nothing else."""
    if name == "stewart_gough":
        robot = js.StewartGough.prototype()
        feet, corners = np.asarray(robot.base), np.asarray(robot.platform)
        return robot, robot.home()[0] + jnp.array([0.1, -0.05, 0.08, 0.1, 0.2, -0.1]), feet, corners
    robot = js.NavaroII.prototype(mode=8)
    feet, corners = (np.pad(np.asarray(points), [(0, 0), (0, 1)]) for points in (robot.base, robot.platform))
    return robot, jnp.array([46.0, 27.0, 0.3]), feet, corners


def needed(feet, corners, springs, rest, tensions, position, rotation, load):
    """The wrench that holds a platform on straight legs with springs, stretched from lengths with tensions."""
    arms = corners @ rotation.T
    legs = position + arms - feet
    lengths = np.linalg.norm(legs, axis=1)
    pushes = (tensions - springs * (lengths - rest))[:, None] * legs / lengths[:, None]
    wrench = -np.concatenate([pushes.sum(axis=0), np.cross(arms, pushes).sum(axis=0)])
    weight = float(load.payload) * np.asarray(load.gravity)
    arm = rotation @ np.asarray(load.payload_center)
    return wrench - np.concatenate([weight, np.cross(arm, weight)])


@pytest.mark.parametrize("name", ["navaro_mode_8", *exhaustive("stewart_gough")])
def test_stiffness_is_the_slope_of_a_plain_equilibrium_under_load(name, rng):
    robot, pose, feet, corners = tilted_platform(name)
    planar = name.startswith("navaro")
    rows = [0, 1, 5] if planar else [*range(6)]
    scale = float(robot.length)
    springs = rng.uniform(300, 500, len(feet))
    center = np.array([0.1, 0.2, 0.0 if planar else 0.3]) * scale
    load = Load(11.34, center, gravity=[1.0, -8.0, -3.0 if not planar else 0.0])
    wrench = jnp.asarray(30 * np.where(np.array(rows) < 3, 1, scale) * rng.normal(size=len(rows)))

    @jax.jit
    def all_of(pose, wrench, load):
        found = js.statics.stiffness(robot, pose, actuator_stiffness=springs, wrench=wrench, load=load)
        return found, js.statics.actuator_forces(robot, pose, wrench=wrench, load=load).value

    found, tensions = all_of(pose, wrench, load)
    place, turn = (np.asarray(part.array()) for part in robot.space.place(pose))
    if planar:
        place, turn = np.append(place, 0), np.block([[turn, np.zeros((2, 1))], [np.zeros((1, 2)), np.eye(1)]])
    rest = np.linalg.norm(place + corners @ turn.T - feet, axis=1)

    def wrench_at(step):
        moved = Rotation.from_rotvec(step[3:]).as_matrix() @ turn
        return needed(feet, corners, springs, rest, np.asarray(tensions), place + step[:3], moved, load)[rows]

    np.testing.assert_allclose(wrench_at(np.zeros(6)), wrench, rtol=1e-9, atol=1e-9 * float(jnp.abs(wrench).max()))
    unit = np.where(np.arange(6) < 3, scale, 1)
    steps = (1e-5 * np.diag(unit))[rows]
    slopes = np.stack([(wrench_at(s) - wrench_at(-s)) / 2e-5 for s in steps], axis=1)  # per unit
    sizes = unit[rows]
    slopes, matrix = slopes * sizes[:, None], np.asarray(found.matrix) * np.outer(sizes, sizes)
    np.testing.assert_allclose(matrix, slopes, atol=1e-7 * np.abs(slopes).max())
    plain = np.asarray(js.inverse_jacobian(robot, pose, rates="twist"))
    elastic = plain.T @ np.diag(springs) @ plain * np.outer(sizes, sizes)
    assert np.abs(slopes - elastic).max() > 1e-4 * np.abs(slopes).max(), "the geometric part counts"
    np.testing.assert_allclose(found.compliance @ found.matrix, np.eye(len(rows)), atol=1e-9 * scale**2)
    # a moment has no potential: of all loads, it alone makes the matrix lose its symmetry, by half its cross product
    if not planar:
        x, y, z = wrench[3:]
        cross = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
        skew = np.zeros((6, 6))
        skew[3:, 3:] = cross
        np.testing.assert_allclose(found.matrix - found.matrix.T, skew, atol=1e-7)
    still, _ = all_of(pose, 0 * wrench, dataclasses.replace(load, payload=jnp.zeros(())))
    np.testing.assert_allclose(still.matrix, still.matrix.T, atol=1e-10 * np.abs(matrix).max())
    np.testing.assert_allclose(still.matrix * np.outer(sizes, sizes), elastic, atol=1e-10 * np.abs(elastic).max())


@pytest.mark.parametrize("name", ["linear_delta", *exhaustive("three_prs", "tse_prototype", "navaro_mode_6")])
def test_a_sagging_platform_comes_to_rest_where_springs_and_load_balance(name, rng):
    """There the actuators hold the load by what they gave way; at first this is the compliance times the load."""
    robot = (ALL | {"navaro_mode_6": partial(js.NavaroII.prototype, 6)})[name]()
    pose, wrench = poses_near_home(robot, 1, rng)[0], jnp.asarray(20 * rng.normal(size=robot.space.dimension))
    turning = np.asarray(robot.actuated(np.array(angular_joints(robot))))
    lever = np.where(turning, float(robot.length), 1.0)  # softer ones let a tall scissor or a long crank collapse
    springs, load = 3e4 * lever**2 * rng.uniform(1, 2, len(lever)), slanted()

    @jax.jit
    def all_of(pose, wrench, load, springs):
        return js.statics.sag(robot, pose, actuator_stiffness=springs, wrench=wrench, load=load)

    found = all_of(pose, wrench, load, springs)
    assert found.status == js.Status.CONVERGED
    held = js.statics.actuator_forces(robot, found.pose, wrench=wrench, load=load)
    before, after = (robot.actuated(js.inverse_kinematics(robot, p).value) for p in (pose, found.pose))
    size = float(jnp.abs(held.value).max())
    np.testing.assert_allclose(held.value, springs * (before - after), rtol=1e-8, atol=1e-9 * size)
    assert held.status == js.Status.CONVERGED, "constraints are kept"
    where = robot.space.between(robot.space.place(pose), robot.space.place(found.pose))
    np.testing.assert_allclose(found.twist, where, rtol=1e-6, atol=1e-12)
    part = 1e-4
    little = dataclasses.replace(load, gravity=load.gravity * part)
    some = all_of(pose, part * wrench, little, springs)
    stiff = js.statics.stiffness(robot, pose, actuator_stiffness=springs)
    position, rotation = robot.space.place(pose)
    weight = jax.grad(lambda t: load.potential(*robot.space.nudge(position, rotation, tuple(t))))(jnp.zeros_like(pose))
    first = stiff.compliance @ (wrench - weight)
    np.testing.assert_allclose(some.twist / part, first, atol=1e-2 * float(jnp.abs(first).max()))
    if name == "three_prs":
        bound = jax.jacfwd(lambda t: jnp.stack(constraints_on(robot, *robot.space.nudge(position, rotation, tuple(t)))))
        rows = np.asarray(bound(jnp.zeros(6)))
        np.testing.assert_allclose(rows @ stiff.compliance, 0, atol=1e-12)
        allowed = np.eye(6) - np.linalg.pinv(rows) @ rows
        np.testing.assert_allclose(stiff.compliance @ stiff.matrix @ allowed, allowed, atol=1e-9)
    heavy = all_of(pose, -1e6 * jnp.abs(wrench), load, springs)
    if name == "navaro_mode_6":  # its legs reach any pose: there is an equilibrium, and it is one
        held = js.statics.actuator_forces(robot, heavy.pose, wrench=-1e6 * jnp.abs(wrench), load=load)
        after = robot.actuated(js.inverse_kinematics(robot, heavy.pose).value)
        size = float(jnp.abs(held.value).max())
        away = (held.value - springs * (before - after)) / springs
        turns = away[turning] / (2 * np.pi)  # a crank may have gone round
        assert heavy.status == js.Status.CONVERGED and size > 1e3
        np.testing.assert_allclose(away[~turning], 0, atol=1e-8 * float(robot.length))
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-8)
        return
    assert heavy.status != js.Status.CONVERGED and jnp.isnan(heavy.twist).all()


def test_derivatives_of_sag_and_stiffness_are_differences(rng):
    robot, load = LinearDelta.example(), Load(payload=5.0, gravity=[2.0, 1.0, -9.0])
    pose = robot.home()[0] + jnp.array([0.1, -0.05, 0.0])

    def numbers(radius, rod, springs):
        robot = LinearDelta(radius, rod)
        give = js.statics.sag(robot, pose, actuator_stiffness=springs, load=load)
        stiff = js.statics.stiffness(robot, pose, actuator_stiffness=springs, load=load)
        return jnp.concatenate([give.twist, give.pose, stiff.matrix.ravel(), 1e3 * stiff.compliance.ravel()])

    at, way = (0.5, 1.0, 2000.0), (0.3, -0.2, 500.0)

    @jax.jit
    def along(step):
        return jax.jvp(lambda s: numbers(*(x + s * d for x, d in zip(at, way, strict=True))), (step,), (1.0,))

    slope, difference = along(0.0)[1], (along(1e-5)[0] - along(-1e-5)[0]) / 2e-5
    np.testing.assert_allclose(slope, difference, rtol=1e-5, atol=1e-7 * float(jnp.abs(difference).max()))
    assert float(jnp.abs(slope[:3]).min()) > 0


def test_the_stiffness_of_a_bound_platform_does_not_know_the_unit_of_length():
    """Which wrenches count as those of the constraints alone depended on what a turn by one radian is as a length."""
    matrices = []
    for unit in (1.0, 1000.0):  # meters and millimeters; forces and so newtons per meter as they were
        robot = scaled(ALL["three_prs"](), unit)
        pose = robot.home()[0] + jnp.array([0, 0, 0.01 * unit, 0.05, -0.1, 0])
        pose = js.constrained_pose(robot, pose).value
        found = js.statics.stiffness(robot, pose, actuator_stiffness=1e3 / unit)
        per = np.array([unit] * 3 + [1.0] * 3)  # a displacement is so many units
        matrices.append(np.asarray(found.matrix) * per[:, None] * per[None] / unit)
    np.testing.assert_allclose(matrices[1], matrices[0], atol=1e-9 * np.abs(matrices[0]).max())
