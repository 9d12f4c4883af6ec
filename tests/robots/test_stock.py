"""The stock of robots: closed forms in NumPy beside them, and numbers from the literature."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxscissor as js
from jaxscissor.robots import stock
from tests.conftest import exhaustive

THIRDS = 2 * np.pi / 3 * np.arange(3)
RADIAL = np.stack([np.cos(THIRDS), np.sin(THIRDS), 0 * THIRDS], axis=1)
UP = np.array([0.0, 0.0, 1.0])


def crank(anchor, along, across, length, rod, point, elbow):
    """Angle of a crank from ``along`` towards ``across``: polar angle and the law of cosines; nan out of reach."""
    arm = np.asarray(point) - anchor
    a, b = arm @ along, arm @ across
    flat = math.hypot(a, b)
    rest2 = rod**2 - (arm @ arm - flat**2)
    cosine = (length**2 + flat**2 - rest2) / (2 * length * flat)
    return math.atan2(b, a) + elbow * math.acos(cosine) if rest2 >= 0 and abs(cosine) <= 1 else math.nan


def slide(foot, direction, rod, point, side):
    """Place of a carriage: Pythagoras."""
    arm = np.asarray(point) - foot
    along = arm @ direction
    rest2 = rod**2 - (arm @ arm - along**2)
    return along + side * math.sqrt(rest2) if rest2 >= 0 else math.nan


def turned(pose):
    return Rotation.from_euler("XYZ", pose[3:6]).as_matrix()


def four_bar(r, pose):
    end = r["rocker"] * np.array([math.cos(pose[0]), math.sin(pose[0])])
    return [crank(np.array([-r["ground"], 0]), *np.eye(2), r["crank"], r["coupler"], end, 1)]


def five_bar(r, pose):
    return [crank(np.array([s * r["half"], 0]), *np.eye(2), r["crank"], r["rod"], pose, -s) for s in (-1, 1)]


def planar_3rrr(r, pose):
    found = []
    for angle in (-np.pi / 2, np.pi / 6, 5 * np.pi / 6):
        end = pose[:2] + r["platform"] * np.array([math.cos(angle + pose[2]), math.sin(angle + pose[2])])
        motor = r["base"] * np.array([math.cos(angle), math.sin(angle)])
        found.append(crank(motor, *np.eye(2), r["crank"], r["rod"], end, 1))
    return found


def planar_3rpr(r, pose):
    c, s = math.cos(pose[2]), math.sin(pose[2])
    ends = pose[:2] + r["platform"] @ np.array([[c, s], [-s, c]])
    return np.linalg.norm(ends - r["base"], axis=1)


def rotary_delta(r, pose):
    ends = pose + r["platform"] * RADIAL
    return [crank(r["base"] * e, e, -UP, r["arm"], r["rod"], end, -1) for e, end in zip(RADIAL, ends, strict=True)]


def linear_delta(r, pose):
    ends = pose + r["platform"] * RADIAL
    return [slide(r["base"] * e, UP, r["rod"], end, 1) for e, end in zip(RADIAL, ends, strict=True)]


def rotary_hexapod(r, pose):
    found, rotation = [], turned(pose)
    for i in range(6):
        side, middle = (1 if i % 2 else -1), 2 * np.pi / 3 * (i // 2)
        low, high = middle + side * r["base_angle"], middle + side * r["platform_angle"]
        hip = r["base"] * np.array([math.cos(low), math.sin(low), 0])
        along = side * np.array([-math.sin(low), math.cos(low), 0])
        end = pose[:3] + rotation @ (r["platform"] * np.array([math.cos(high), math.sin(high), 0]))
        found.append(crank(hip, along, -UP, r["crank"], r["rod"], end, 1))
    return found


def hexaglide(r, pose):
    ends = pose[:3] + r["platform"] @ turned(pose).T
    feet = np.column_stack([np.zeros(6), r["rails"]])
    sides = [1 if i % 2 else -1 for i in range(6)]
    return [slide(f, np.eye(3)[0], r["rod"], e, s) for f, e, s in zip(feet, ends, sides, strict=True)]


def three_prs(r, pose):
    ends = pose[:3] + r["platform"] * RADIAL @ turned(pose).T
    return [slide(0 * e, e, r["rod"], end, 1) for e, end in zip(RADIAL, ends, strict=True)]


def three_upu(r, pose):
    ends = pose[:3] + r["platform"] * RADIAL @ turned(pose).T
    return np.linalg.norm(ends - r["base"] * RADIAL, axis=1)


def agile_eye(r, pose):
    """With arcs of 90 deg the middle axis is at right angles to both others."""
    rotation, found = Rotation.from_euler("XYZ", pose).as_matrix(), []
    for i in range(3):
        axis, beside, across = (np.eye(3)[(i + k) % 3] for k in range(3))
        middle = np.cross(axis, rotation @ -across)
        found.append(math.atan2(middle @ across, middle @ beside))
    return found


def scissor_lift(r, pose):
    share = 1 - (pose[0] / (2 * r["link_lengths"].sum() - r["link_lengths"][[0, -1]].sum())) ** 2
    return [2 * r["link_lengths"][0] * math.sqrt(share) if share >= 0 else math.nan]


def scissor_hexapod(r, pose):
    found, tall = [], 2 * r["link_lengths"].sum() - r["link_lengths"][0]
    for i in range(6):
        side, middle = (1 if i % 2 else -1), 2 * np.pi / 3 * (i // 2)
        low, high = middle + side * r["base_angle"], middle + side * r["platform_angle"]
        foot = r["base"] * np.array([math.cos(low), math.sin(low), 0])
        end = pose[:3] + turned(pose) @ (r["platform"] * np.array([math.cos(high), math.sin(high), 0]))
        share = 1 - np.sum((end - foot) ** 2) / tall**2
        found.append(2 * r["link_lengths"][0] * math.sqrt(share) if share >= 0 else math.nan)
    return found


# robot, closed form of its joints, spread of the poses about home
CASES = {
    "FiveBar": (five_bar, [0.35, 0.3]),
    "RotaryHexapod": (rotary_hexapod, [0.06, 0.06, 0.05, 0.4, 0.4, 0.4]),
}
MORE = {
    "ThreePRS": (three_prs, [0, 0, 0.2, 0.6, 0.6, 0]),
    "AgileEye": (agile_eye, [0.7, 0.7, 0.7]),
    "FourBar": (four_bar, [1.2]),
    "Planar3RRR": (planar_3rrr, [0.2, 0.2, 0.8]),
    "Planar3RPR": (planar_3rpr, [0.5, 0.5, 1.0]),
    "RotaryDelta": (rotary_delta, [0.6, 0.6, 0.3]),
    "LinearDelta": (linear_delta, [0.4, 0.4, 0.2]),
    "Hexaglide": (hexaglide, [0.3, 0.3, 0.2, 0.5, 0.5, 0.5]),
    "ThreeUPU": (three_upu, [0.4, 0.4, 0.3, 0, 0, 0]),
    "ScissorLift": (scissor_lift, [0.8]),
    "ScissorHexapod": (scissor_hexapod, [0.3, 0.3, 0.3, 0.4, 0.4, 0.4]),
}
names = pytest.mark.parametrize("name", [*CASES, *exhaustive(*MORE)])


def of(name):
    """The robot, its closed form, a spread of poses."""
    robot = getattr(stock, name).prototype()
    form, spread = (CASES | MORE)[name]
    numbers = {field: np.asarray(value) for field, value in vars(robot).items()}
    return robot, lambda pose: np.array(form(numbers, np.asarray(pose, float))), np.array(spread)


def around(angle):
    return np.arctan2(np.sin(angle), np.cos(angle))


def test_every_robot_of_the_stock_stands_here():
    assert {*CASES, *MORE} == {name for name in stock.__all__ if name != "ScissorLeg"}


@pytest.mark.parametrize("name", ["FiveBar", *exhaustive(*(name for name in CASES | MORE if name != "FiveBar"))])
def test_it_keeps_the_contract(name):
    js.check_robot(of(name)[0], poses=64)


@names
def test_joints_and_verdicts_are_those_of_the_closed_form(name, rng):
    """400 poses: the joints from home's, those in reach and no others, and back."""
    robot, form, spread = of(name)
    home, joints = robot.home()
    poses = np.asarray(home) + spread * rng.uniform(-1, 1, (400, len(home)))
    poses = jax.jit(jax.vmap(lambda pose: js.constrained_pose(robot, pose).value))(poses)
    found = jax.jit(jax.vmap(js.inverse_kinematics, (None, 0)))(robot, poses)
    expected = np.array([form(pose) for pose in np.asarray(poses)]) - form(home) + np.asarray(joints)
    reached = np.isfinite(expected).all(axis=1)
    assert 20 < reached.sum()
    assert np.array_equal(np.asarray(found.converged), reached)
    off = np.asarray(found.value)[reached] - expected[reached]
    assert np.abs(around(off) if robot.legs().angular else off).max() < 1e-9


@names
def test_forward_kinematics_gives_the_pose_back(name, rng):
    robot, _, spread = of(name)
    home = np.asarray(robot.home()[0])
    poses = home + 0.2 * spread * rng.uniform(-1, 1, (8, len(home)))
    poses = jax.vmap(lambda pose: js.constrained_pose(robot, pose).value)(poses)
    there = jax.vmap(js.inverse_kinematics, (None, 0))(robot, poses)
    assert bool(there.converged.all())
    back = jax.jit(jax.vmap(js.forward_kinematics, (None, 0)))(robot, there.value)
    assert bool(back.converged.all())
    np.testing.assert_allclose(back.value, poses, atol=1e-9)


def test_every_dimension_has_its_derivative():
    """Of the joints by the dimensions that are typed in, through the chains, against differences."""
    for robot, pose in (
        (js.robots.RotaryHexapod.prototype(), [0.01, -0.02, 0.2, 0.05, 0.1, -0.05]),
        (js.robots.AgileEye.prototype(), [0.1, 0.2, -0.1]),
    ):
        leaves, tree = jax.tree.flatten(robot)

        def joints(numbers, tree=tree, pose=pose):
            return js.inverse_kinematics(jax.tree.unflatten(tree, list(numbers)), pose).value

        at = jnp.stack(leaves)
        slope = jax.jacfwd(joints)(at)
        for i in range(len(leaves)):
            step = 1e-6 * jnp.eye(len(leaves))[i]
            difference = (joints(at + step) - joints(at - step)) / 2e-6
            np.testing.assert_allclose(slope[:, i], difference, atol=1e-7 * max(1, np.abs(difference).max()))


# --- numbers of the literature


def test_the_delta_of_williams_has_his_angles_and_heights():
    """The IRB 360 [Williams, The Delta Parallel Robot: Kinematics Solutions, 2016]: degrees from level, meters.

    His x axis lies along a side of the base, his first leg points to -y; angles are printed to 0.1 deg.
    """
    base, platform = math.sqrt(3) / 6 * 0.567, math.sqrt(3) / 3 * 0.076
    robot = js.robots.RotaryDelta(base, platform, 0.524, 1.244)
    droop = 20.0  # of our home
    for (x, y, z), degrees in (((0, 0, -0.9), (-20.5, -20.5, -20.5)), ((0.3, 0.5, -1.1), (47.5, -11.6, 21.4))):
        found = js.inverse_kinematics(robot, [-y, x, z])
        np.testing.assert_allclose(np.degrees(found.value) + droop, degrees, atol=0.06)
    level = js.forward_kinematics(robot, np.radians([-droop] * 3))
    np.testing.assert_allclose(level.value, [0, 0, -1.065], atol=6e-4)


def test_the_agile_eye_has_eight_working_modes_and_four_assembly_modes_beside_the_trivial_ones():
    """[Bonev, Chablat and Wenger, Working and Assembly Modes of the Agile Eye, ICRA 2006]

    In the four trivial ones, [Gosselin, Sefrioui and Richard, 1994], the legs move by themselves.
    """
    robot = js.robots.AgileEye.prototype()
    modes = js.inverse_kinematics_all(robot, [0.3, -0.2, 0.4])
    assert np.asarray(modes.valid).sum(axis=1).prod() == 8
    joints = js.inverse_kinematics(robot, [0.3, -0.2, 0.4]).value
    found = js.forward_kinematics_all(robot, joints, starts=256)
    poses, configurations = (x[found.valid] for x in (found.values, found.joints))
    measured = jax.vmap(lambda pose, q: js.singularities.measures(robot, pose, joints=q))(poses, configurations)
    trivial = np.abs(measured.type1).min(axis=1) < 1e-6
    assert (~trivial).sum() == 4 and trivial.sum() == 4


def test_a_3_upu_is_loose_on_a_circle():
    """Where x^2 + y^2 = (2 (base - platform))^2 its constraints depend on each other, whatever its height."""
    robot = js.robots.ThreeUPU.prototype()
    radius = 2 * float(robot.base - robot.platform)
    for angle in (0.3, 2.0):
        place = radius * np.array([math.cos(angle), math.sin(angle)])
        at, beside = ([*(share * place), 0.8, 0, 0, 0] for share in (1.0, 0.98))
        assert float(js.singularities.measures(robot, at).constraint) < 1e-7
        assert float(js.singularities.measures(robot, beside).constraint) > 1e-3


def test_the_parasitic_motion_of_a_3_prs_is_that_of_its_closed_form():
    """tan yaw = -sin a sin b / (cos a + cos b) [Carretero, Podhorodecki, Nahon and Gosselin, 2000]; x and y follow."""
    robot = js.robots.ThreePRS.prototype()
    roll, pitch = 0.2, -0.3
    pose = np.asarray(js.constrained_pose(robot, [0, 0, 0.5, roll, pitch, 0]).value)
    yaw = math.atan(-math.sin(roll) * math.sin(pitch) / (math.cos(roll) + math.cos(pitch)))
    matrix = Rotation.from_euler("XYZ", [roll, pitch, yaw]).as_matrix()
    radius = float(robot.platform)
    x, y = radius / 2 * (matrix[0, 0] - matrix[1, 1]), -radius * matrix[1, 0]
    np.testing.assert_allclose(pose, [x, y, 0.5, roll, pitch, yaw], atol=1e-12)


def test_a_3_rpr_with_six_assembly_modes_has_six():
    """[Innocenti and Parenti-Castelli]: base (0, 0), (15.91, 0), (0, 10), platform of sides 17.04, 16.54, 20.84."""
    sides, lengths = (17.04, 16.54, 20.84), np.array([14.98, 15.38, 12.00])
    x = (sides[0] ** 2 + sides[2] ** 2 - sides[1] ** 2) / (2 * sides[0])
    platform = [[0, 0], [sides[0], 0], [x, math.sqrt(sides[2] ** 2 - x**2)]]
    robot = js.robots.Planar3RPR([[0, 0], [15.91, 0], [0, 10]], platform, [5.0, 5.0, 0.3])
    numbers = {"platform": np.array(platform), "base": np.asarray(robot.base)}
    reach = lengths - planar_3rpr(numbers, np.array([5.0, 5.0, 0.3]))
    found = js.forward_kinematics_all(robot, reach, starts=512)
    assert int(found.count) == 6


def test_a_four_bar_keeps_the_equation_of_freudenstein():
    """k1 cos o - k2 cos i + k3 = cos(i - o) with k = (d/a, d/c, (a^2 - b^2 + c^2 + d^2) / 2ac) [Freudenstein 1955]."""
    robot = js.robots.FourBar.prototype()
    d, a, b, c = (float(getattr(robot, name)) for name in ("ground", "crank", "coupler", "rocker"))
    home = float(robot.home()[0][0])
    for output in (home, home - 0.3, home + 0.2):
        i = float(js.inverse_kinematics(robot, [output]).value[0]) + math.pi / 2  # home points up
        k1, k2, k3 = d / a, d / c, (a * a - b * b + c * c + d * d) / (2 * a * c)
        assert k1 * math.cos(output) - k2 * math.cos(i) + k3 == pytest.approx(math.cos(i - output), abs=1e-12)


def test_a_five_bar_in_its_plane_has_two_assembly_modes_and_four_working_modes():
    """Bound in SE2 instead it had four: a platform that nothing turns counted both ways around."""
    robot = js.robots.FiveBar.prototype()
    assert int(js.forward_kinematics_all(robot, [0.1, -0.2], starts=64).count) == 2
    assert np.asarray(js.inverse_kinematics_all(robot, [0.05, 0.35]).valid).sum(axis=1).prod() == 4
    nearest = js.singularities.distance(robot, [0.05, 0.35], directions=64)
    assert np.isfinite(nearest.distance) and nearest.pose.shape == (2,)


@pytest.mark.exhaustive
def test_a_robot_that_only_turns_has_metrics_of_a_task():
    robot = js.robots.AgileEye.prototype()
    ratios = js.gear_ratios(robot, [0.3, -0.2, 0.4]).rotation
    found = js.design.task_metrics(robot, [[0.3, -0.2, 0.4]])
    assert float(found.conditioning) == pytest.approx(float(ratios[0] / ratios[-1]), rel=1e-9)


@pytest.mark.parametrize(
    ("build", "said"),
    [
        (lambda: js.robots.FiveBar(0.1, 0.2, -0.3), "rod = -0.3; expected a positive number"),
        (lambda: js.robots.Planar3RRR(1.0, 0.1, 0.2, 0.2), "do not meet at home"),
        (lambda: js.robots.RotaryDelta(0.9, 0.1, 0.3, 0.5), "does not reach"),
        (lambda: js.robots.Planar3RPR(np.eye(2), np.eye(2), np.zeros(3)), "base of shape"),
        (lambda: js.robots.ScissorLift([0.5, 0.5], (0.3, 1.2)), "least < greatest"),
        (lambda: js.robots.AgileEye(1.5, 3.5), "less than pi"),
    ],
)
def test_dimensions_that_make_no_robot_are_refused(build, said):
    with pytest.raises(ValueError, match=said):
        build()
