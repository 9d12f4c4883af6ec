"""All assembly modes and all working modes, against independent searches and published robots."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from tests.conftest import exhaustive
from tests.kinematics.test_contract import matrix_of

INCH = 0.0254
all_modes = jax.jit(jax.vmap(js.forward_kinematics_all, (None, 0)))
inverse_batch = jax.jit(jax.vmap(js.inverse_kinematics, (None, 0)))


def published_hexapod():
    """Dietmaier's platform of 1998, whose 40 assembly modes are all real, and its lengths."""
    base = [
        (0, 0, 0),
        (1.107915, 0, 0),
        (0.549094, 0.756063, 0),
        (0.735077, -0.223935, 0.525991),
        (0.514188, -0.526063, -0.368418),
        (0.590473, 0.094733, -0.205018),
    ]
    platform = [
        (0, 0, 0),
        (0.542805, 0, 0),
        (0.956919, -0.528915, 0),
        (0.665885, -0.353482, 1.402538),
        (0.478359, 1.158742, 0.107672),
        (-0.137087, -0.235121, 0.353913),
    ]
    squares = [1, 0.416379826, 1.180012929, 2.260328827, 1.643352216, 0.594550487]
    return js.StewartGough(np.array(base, float), np.array(platform, float)), np.sqrt(squares)


def reached(robot, rng, n):
    """Poses of the paper's cylinder with tilts to 30 deg that the home mode reaches, and their joints."""
    length = float(robot.length)
    tilt = np.full(3, np.pi / 6)
    region = js.Cylinder(length / 2, length, orientation=(-tilt, tilt))
    poses = region.quasi_random(4 * n, seed=int(rng.integers(1000)))[:]
    solution = inverse_batch(robot, poses)
    picked = np.flatnonzero(np.asarray(solution.converged))[:n]
    assert len(picked) == n
    return poses[picked], solution.value[picked]


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "ratios", [(0.2647, np.pi / 6, 0.0186, 0.11765), *exhaustive((0.45, 0.9, 0.15, 0.1), (0.3, -0.3, 0.2, 0.1))]
)
def test_scissor_extender_is_assembled_as_a_dense_search_finds(ratios, rng):
    robot = js.TripleScissorExtender.from_ratios(*ratios)
    poses, joints = reached(robot, rng, 100)
    modes = all_modes(robot, joints)
    for i, pose in enumerate(poses):
        found = np.stack([matrix_of(robot, value) for value in modes.values[i][modes.valid[i]]])
        assert np.abs(found - matrix_of(robot, pose)).max(axis=1).min() < 1e-8
    for i in range(20):
        above = np.asarray(modes.values[i][modes.valid[i]])
        apices = np.array([sum(bool(a.z > 0) for a in robot.attachments(*js.SE3.place(jnp.asarray(p)))) for p in above])
        assert np.sum(apices == 3) == dense_count(ratios, np.asarray(joints[i]))


def ends(function, edges):
    """Last points, to rounding, at which a function that is nan elsewhere has a value, between any two edges."""
    valid, found = np.isfinite(function(edges)), []
    for cell in np.flatnonzero(valid[:-1] != valid[1:]):
        inside, outside = (edges[cell], edges[cell + 1]) if valid[cell] else (edges[cell + 1], edges[cell])
        for _ in range(60):
            middle = (inside + outside) / 2
            inside, outside = (middle, outside) if np.isfinite(function(np.array(middle))) else (inside, middle)
        found.append(inside)
    return found


def dense_count(ratios, joints, cells=4000):
    """Triangles with all corners above the base, by a scan over the first corner's angle: numpy alone."""
    k1, eta, k3, k4 = ratios
    side = k4 * np.sqrt(3)
    circles = []
    for azimuth, (a, b) in zip(2 * np.pi * np.arange(3) / 3, joints.reshape(3, 2), strict=True):
        out, tangent = np.array([np.cos(azimuth), np.sin(azimuth), 0]), np.array([np.sin(azimuth), -np.cos(azimuth), 0])
        foot_a = k3 * out + a * (np.cos(eta) * tangent + np.sin(eta) * out)
        foot_b = k3 * out + b * (-np.cos(eta) * tangent + np.sin(eta) * out)
        base = foot_a - foot_b
        width = np.linalg.norm(base)
        height = np.sqrt(1 - (width / (2 * k1)) ** 2)
        flat = np.cross(base / width, [0, 0, 1])
        circles.append(((foot_a + foot_b) / 2, height * flat, height * np.array([0, 0, 1.0])))

    def corner(i, angle):
        center, flat, up = circles[i]
        return center + np.multiply.outer(np.cos(angle), flat) + np.multiply.outer(np.sin(angle), up)

    def partners(i, point):
        """Angles at which circle i is at the side's distance from points: two branches, nan where none."""
        center, flat, up = circles[i]
        gap = center - point
        constant = np.sum(gap**2, axis=-1) + flat @ flat - side**2
        x, y = 2 * gap @ flat, 2 * gap @ up
        middle = np.arctan2(y, x)
        with np.errstate(invalid="ignore"):
            half = np.arccos(-constant / np.hypot(x, y))
        return middle + half, middle - half

    def branches(angle):
        first = corner(0, angle)
        return [(v, w) for v in partners(1, first) for w in partners(2, first)]

    def gaps(angle):
        return [np.sum((corner(1, v) - corner(2, w)) ** 2, axis=-1) - side**2 for v, w in branches(angle)]

    even = np.linspace(0, np.pi, cells + 1)  # above the base
    limits = [ends(lambda angle, i=i: partners(i, corner(0, angle))[0], even) for i in (1, 2)]
    edges = np.sort(np.concatenate([even, *limits]))
    values, count = gaps(edges), 0
    for number, value in enumerate(values):
        for left in np.flatnonzero(value[:-1] * value[1:] < 0):
            low, high = edges[left], edges[left + 1]
            for _ in range(60):
                middle = (low + high) / 2
                low, high = (middle, high) if gaps(np.array(middle))[number] * value[left] > 0 else (low, middle)
            v, w = branches(np.array(low))[number]
            count += bool(np.sin(v) > 0 and np.sin(w) > 0)
    return count


def test_laboratory_home_has_sixteen_modes_eight_of_them_above_the_base():
    robot = js.TripleScissorExtender(
        np.array([18.0, 14.0, 11.0]) * INCH, np.pi / 6, actuator_radius=16 * INCH, top_radius=8 * INCH
    )
    modes = js.forward_kinematics_all(robot, np.full(6, 15.53072495 * INCH))
    assert modes.complete and int(modes.count) == 16
    assert int(np.sum(modes.values[:, 2] > 0)) == 8


@functools.cache
def planar_known():
    side, far, third = 17.04, 20.84, 16.54
    x = (side**2 + far**2 - third**2) / (2 * side)
    platform = [[0, 0], [side, 0], [x, np.sqrt(far**2 - x**2)]]
    return js.NavaroII([[0, 0], [15.91, 0], [0, 10]], platform, mode=8)


@pytest.mark.exhaustive
def test_roots_crowded_on_a_short_arc_are_all_found():
    """Nearly flat platforms: the corners can move on one to ten per cent of their circles only."""
    robot = js.TripleScissorExtender.from_ratios(0.45, 0.9, 0.15, 0.1)
    poses = [
        [-0.48739175, -0.03168942, 0.00354369, 0.11602366, -0.08652309, 0.39983443],
        [-0.19871807, -0.20430299, 0.31167929, -0.47315203, 0.17982457, 0.33649647],
        [-0.37932257, -0.13665643, 0.02245018, -0.09640821, -0.05728827, 0.29730255],
    ]
    for pose, count in zip(poses, (4, 8, 8), strict=True):
        modes = js.forward_kinematics_all(robot, js.inverse_kinematics(robot, pose).value)
        found = np.stack([matrix_of(robot, value) for value in modes.values[modes.valid]])
        assert np.abs(found - matrix_of(robot, pose)).max(axis=1).min() < 1e-8
        assert int(modes.count) == count


def test_planar_platform_has_its_six_published_modes():
    modes = js.forward_kinematics_all(planar_known(), [14.98, 15.38, 12.0])
    assert int(modes.count) == 6
    turned = np.array(modes.values)[np.asarray(modes.valid)]
    assert np.abs(np.diff(np.sort(turned[:, 2]))).min() > 0.1


def test_tri_scott_has_twelve_modes_where_the_planar_one_has_six_both_ways():
    robot = js.TriScott(
        [[0.51, 0.95], [0.14, 0.95], [0.31, 0.42]], [2.0] * 3, [[0.39, -0.11], [0.06, -0.57], [0.3, 0.05]]
    )
    joints = [0.58687774, 0.5873839, 0.54241696, 1.96441376, 1.91363308, 1.92858162]
    modes = js.forward_kinematics_all(robot, joints)
    assert int(modes.count) == 12
    up = np.array([js.SE3.place(pose)[1].columns[2].z for pose in modes.values])
    assert (up > 0).sum() == 6 and (up < 0).sum() == 6


@pytest.mark.exhaustive
def test_published_hexapod_has_forty_modes():
    robot, lengths = published_hexapod()
    modes = js.forward_kinematics_all(robot, lengths)
    assert int(modes.count) == 40 and not modes.complete
    residuals = jax.vmap(lambda pose: jnp.abs(js.residual(robot, pose, joints=lengths)).max())(modes.values)
    assert float(residuals.max()) < 1e-10


@pytest.mark.exhaustive
def test_too_few_places_are_admitted_by_the_count():
    robot, lengths = published_hexapod()
    modes = js.forward_kinematics_all(robot, lengths, modes=10)
    assert modes.values.shape == (10, 6) and int(modes.count) > 10


def test_assembly_modes_have_the_implicit_derivative():
    robot = js.NavaroII.prototype(mode=6)
    joints = robot.actuated(robot.home()[1]) + 0.3

    def poses(joints):
        modes = js.forward_kinematics_all(robot, joints)
        return jnp.where(modes.valid[:, None], modes.values, 0)

    slope = jax.jit(jax.jacfwd(poses))(joints)
    step = 1e-5
    for i, unit in enumerate(step * np.eye(3)):
        difference = (poses(joints + unit) - poses(joints - unit)) / (2 * step)
        assert np.abs(slope[..., i] - difference).max() < 1e-6


def test_joints_wider_than_the_scissor_have_no_assembly(prototype):
    wide = jnp.full(6, 1.1 * float(prototype.link_lengths[0]) / np.cos(np.pi / 6))
    assert int(js.forward_kinematics_all(prototype, wide).count) == 0


def test_forward_kinematics_says_whether_it_kept_the_assembly_mode_of_its_guess(rng):
    """Between singularities a mode is named by the sign of the type-2 measure."""
    robot = js.NavaroII.prototype(8)
    low, high = np.array([-20.0, -40.0, -3.0]), np.array([110.0, 90.0, 3.0])
    poses, guesses = (jnp.asarray(rng.uniform(low, high, (300, 3))) for _ in range(2))
    lengths = inverse_batch(robot, poses).value[:, 1::2]
    found = jax.jit(jax.vmap(lambda q, guess: js.forward_kinematics(robot, q, guess=guess)))(lengths, guesses)
    ended, begun = (
        jax.vmap(lambda pose: js.singularities.measures(robot, pose).type2)(each) for each in (found.value, guesses)
    )
    closed = np.asarray(found.residual_norm < 1e-12)
    same = np.sign(ended) == np.sign(begun)
    assert closed.sum() > 150 and same[closed].sum() > 50 and (~same)[closed].sum() > 50
    expected = np.where(same, js.Status.CONVERGED, js.Status.OTHER_MODE)
    assert (np.asarray(found.status) == expected)[closed].all()
