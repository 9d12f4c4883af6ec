"""Measures of robots whose platform is bound: over the motions that exist, and zero where they end."""

import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor.robots._contract import angular_joints, constraints_on
from jaxscissor.singularities._measures import _about_its_end, closure_matrix
from tests.bound_robots import AgileEye, FiveBar, ThreeUPU
from tests.toys import ThreePRS


@pytest.mark.parametrize("mode", [1, 3, 8])
def test_gear_ratios_count_a_motor_that_turns_as_the_length_of_the_robot_per_radian(mode):
    robot = js.NavaroII.prototype(mode)
    pose = robot.home()[0] + jnp.array([4.0, -3.0, 0.1])
    turns = np.array(robot.actuation())[:, 0]
    jacobian = np.asarray(js.inverse_jacobian(robot, pose)) * np.where(turns, 90.0, 1.0)[:, None]
    found = js.gear_ratios(robot, pose)
    sizes = 1 / np.linalg.svd(jacobian[:, :2], compute_uv=False)
    np.testing.assert_allclose(found.translation, sizes, rtol=1e-12)
    np.testing.assert_allclose(found.rotation, 1 / np.linalg.norm(jacobian[:, 2:]), rtol=1e-12)


@pytest.mark.parametrize("build", [ThreePRS.example, lambda: ThreeUPU(0.5, 0.25), lambda: FiveBar(0.1)])
def test_gear_ratios_are_those_of_differences_along_the_constraints(build):
    robot, step = build(), 1e-6
    home, free = np.asarray(robot.home()[0]), [i for i, n in enumerate(robot.space.names) if n not in robot.dependent]
    numbers = np.arange(len(home))
    start = home + 0.03 * float(robot.length) * np.isin(numbers, free) * (numbers - 1.5)

    def moved(by):
        pose = js.constrained_pose(robot, start + by).value
        return pose, np.where(angular_joints(robot), robot.length, 1) * js.inverse_kinematics(robot, pose).value

    pose = moved(0 * home)[0]
    ends = [[moved(sign * step * np.eye(len(home))[i]) for sign in (1, -1)] for i in free]
    rates, joints = (np.stack([np.asarray(a[k] - b[k]) for a, b in ends], axis=1) / (2 * step) for k in (0, 1))
    twist = np.asarray(robot.space.rates_to_twist(pose)) @ rates @ np.linalg.inv(joints)
    found, linear = js.gear_ratios(robot, pose), robot.space.translations
    for block, ratios in ((twist[:linear], found.translation), (twist[linear:], found.rotation)):
        sizes = np.zeros(len(block))
        some = np.linalg.svd(block, compute_uv=False)
        sizes[: len(some)] = some
        np.testing.assert_allclose(ratios, sizes[::-1], atol=1e-7 * twist.max())
    if linear == 3:
        assert float(found.vertical) == pytest.approx(np.linalg.norm(twist[2]), rel=1e-7)


def test_type_2_goes_to_zero_where_the_constraints_leave_the_platform_loose():
    """It jumped from one value to its negative there, both rows vanishing from numerator and denominator."""
    robot = ThreeUPU(0.5, 0.25)

    def measure(x):
        return js.singularities.measures(robot, jnp.array([x, 0.0, 0.8, 0.0, 0.0, 0.0])).type2

    values = np.array([float(measure(0.5 + d)) for d in (-1e-2, -1e-4, -1e-6, 0.0, 1e-6, 1e-4, 1e-2)])
    assert abs(values[3]) < 1e-15 and (values[:3] > 0).all() and (values[4:] < 0).all()
    slopes = values[[0, 1, 2, 4, 5, 6]] / np.array([-1e-2, -1e-4, -1e-6, 1e-6, 1e-4, 1e-2])
    np.testing.assert_allclose(slopes, slopes[2], rtol=0.05)
    assert float(jax.grad(measure)(0.5 - 1e-6)) == pytest.approx(slopes[2], rel=1e-3)


def test_type_1_of_a_leg_on_a_sphere_goes_to_zero_where_it_is_stretched():
    """Translations alone stood in its denominator, of which such a leg has none: it was +-1 everywhere."""
    robot = AgileEye(1.2)
    for away in (1e-2, 1e-4, 1e-6):
        pose = np.array([0.0, 0.0, 0.0, 0.0, 1.2 - away, 0.0])
        fastest = np.abs(js.inverse_jacobian(robot, pose)).max()
        type1 = np.abs(js.singularities.measures(robot, pose).type1).min()
        assert type1 * fastest == pytest.approx(1, rel=0.05)  # the one goes to zero as the other grows


@pytest.mark.parametrize("build", [js.TripleScissorExtender.prototype, js.NavaroII.prototype])
def test_rotations_that_a_leg_allows_do_not_count_in_its_type_1(build):
    """The legs of the TSE and of NaVARo II hold a point: translations say it all."""
    robot = build()
    home, joints = robot.home()
    matrix = np.asarray(closure_matrix(robot, *robot.space.place(home), joints))
    d, linear, size = robot.space.dimension, robot.space.translations, len(robot.actuation()[0])
    for i, type1 in enumerate(np.asarray(js.singularities.measures(robot, home).type1)):
        rows = matrix[i * size : (i + 1) * size]
        own, moved = rows[:, d + i * size : d + (i + 1) * size], rows[:, :linear]
        whole = np.linalg.det(own @ own.T + moved @ moved.T)
        assert type1 == pytest.approx(np.linalg.det(own) / np.sqrt(whole), rel=1e-9)


def test_the_loosest_motion_is_one_that_exists():
    pose = np.array([0.1, 0.3, 0.0])
    motion = np.asarray(js.singularities.measures(FiveBar(0.1), pose).platform_motion)
    assert motion[2] == 0 and np.linalg.norm(motion[:2]) == pytest.approx(0.1)  # in units of the robot's length
    tilted = js.constrained_pose(ThreePRS.example(), np.array([0.0, 0.0, 0.8, 0.2, 0.1, 0.0])).value
    robot, step = ThreePRS.example(), 1e-6
    motion = np.asarray(js.singularities.measures(robot, tilted).platform_motion)
    position, rotation = robot.space.place(tilted)
    ends = [constraints_on(robot, *robot.space.retract(position, rotation, sign * step * motion)) for sign in (1, -1)]
    assert np.abs(np.subtract(*ends)).max() / (2 * step) < 1e-9


class Lifted:
    """Positions in space and a turn about the vertical: a space with fewer rotations than space has."""

    dimension, names, translations = 4, ("x", "y", "z", "yaw"), 3

    @staticmethod
    def nudge(position, rotation, twist):
        return js.SE3.nudge(position, rotation, (*twist[:3], 0 * twist[3], 0 * twist[3], twist[3]))


def test_the_leg_end_is_found_in_a_space_of_ones_own():
    """A rotation about the point that a leg holds moves nothing of the leg, whatever rotations the space has."""
    robot = js.TripleScissorExtender.prototype()
    home, joints = robot.home()
    position, rotation = robot.space.place(home)
    seen = robot.attachments(position, rotation)
    by_twist = np.asarray(closure_matrix(robot, position, rotation, joints))[:2, :6]
    lifted = types.SimpleNamespace(space=Lifted, length=robot.length)
    for one, columns in ((robot, range(6)), (lifted, [0, 1, 2, 5])):
        about = _about_its_end(one, jnp.asarray(by_twist[:, list(columns)]), position, rotation, seen[0])
        assert np.abs(about[:, 3:]).max() < 1e-15


def test_a_constraint_singularity_has_a_measure_of_its_own():
    """Of the 3-UPU it is zero on the circle of its radius and grows as the distance from it; it knows no actuators."""
    robot = ThreeUPU(0.5, 0.25)

    def measure(x, y, robot=robot):
        return js.singularities.measures(robot, jnp.array([x, y, 0.8, 0.0, 0.0, 0.0])).constraint

    for angle in (0.0, 1.0, 2.5):
        values = [float(measure(r * np.cos(angle), r * np.sin(angle))) for r in (0.5, 0.5 + 1e-4, 0.5 - 1e-4, 0.1)]
        assert values[0] < 1e-7 and values[3] > 0.1
        assert values[1] == pytest.approx(values[2], rel=1e-3) and 1e-5 < values[1] < 1e-3
    assert float(js.singularities.measures(js.NavaroII.prototype(), [45.0, 26.0, 0.1]).constraint) == 1
    free = js.singularities.measures(FiveBar(0.1), np.array([0.1, 0.3, 0.0]))
    assert float(free.constraint) == pytest.approx(1)
