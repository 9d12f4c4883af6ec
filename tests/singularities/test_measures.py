"""Singularity measures against the papers' determinants, and against places where roots of the closure meet."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from tests.conftest import exhaustive
from tests.oracles import apices

RATIOS = (0.2647, np.pi / 6, 0.0186, 0.11765)


def paper_determinant(ratios, apex, joints):
    """a11 a22 - a12 a21 of [RAL17 eqs. 16-17] with the corrected factor (1/4)(1 - (L/l0)^2)."""
    k1, eta = ratios[:2]
    (x, y, _), (a, b) = apex, joints
    factor = (1 - 1 / k1**2) / 4
    a11 = -a + x * np.cos(eta) + y * np.sin(eta)
    a12 = b + x * np.cos(eta) - y * np.sin(eta)
    a21 = a11 + factor * (a + b * np.cos(2 * eta))
    a22 = factor * (b + a * np.cos(2 * eta))
    return a11 * a22 - a12 * a21


@pytest.mark.exhaustive
def test_type_1_measure_has_the_sign_of_the_papers_determinant_in_every_working_mode(rng):
    robot = js.TripleScissorExtender.from_ratios(*RATIOS)
    poses = js.Cylinder(0.4, 0.9).quasi_random(300)[:]
    modes = jax.jit(jax.vmap(js.inverse_kinematics_all, (None, 0)))(robot, poses)
    measure = jax.jit(jax.vmap(lambda pose, q: js.singularities.measures(robot, pose, joints=q).type1))
    locals_ = apices(RATIOS, poses)
    signs = []
    for mode in range(4):
        ok = np.asarray(modes.valid[:, :, mode])
        type1 = np.asarray(measure(poses, modes.values[:, :, mode].reshape(-1, 6)))
        for leg in range(3):
            theirs = paper_determinant(RATIOS, locals_[leg], np.asarray(modes.values[:, leg, mode]).T)
            signs += list(np.sign(theirs * type1[:, leg])[ok[:, leg]])
    assert len(signs) > 2000 and len(set(signs)) == 1


def quartic(ratios, apex):
    """Coefficients of a leg's quartic in u = p - 2 y sin(eta), highest first."""
    k1, eta = ratios[:2]
    x, y, z = apex
    c, s, k = np.cos(eta), np.sin(eta), 1 / (4 * k1**2)
    a, b = 2 * y * s, 2 * x * c
    p2, m2 = s * s / 4 + k * c * c, c * c / 4 + k * s * s
    constant = x * x + y * y + z * z - 1 + (p2 - 0.5) * a**2 + (m2 - 0.5) * b**2
    return np.array([p2, (2 * p2 - 0.5) * a, constant, (2 * m2 - 0.5) * a * b**2, m2 * a**2 * b**2]), a, b


def discriminant(coefficients):
    a, b, c, d, e = coefficients
    first, second = (
        12 * a * e - 3 * b * d + c * c,
        72 * a * c * e + 9 * b * c * d - 27 * (a * d * d + e * b * b) - 2 * c**3,
    )
    return (4 * first**3 - second**2) / 27


def type_1_points(count, rng):
    """Paths ``pose + t way`` and the t, with the joints of leg 1, where two roots of its quartic meet."""
    points = []
    while len(points) < count:
        pose = np.concatenate([rng.uniform(-0.4, 0.4, 2), rng.uniform(0.2, 0.9, 1), rng.uniform(-0.5, 0.5, 3)])
        way = np.concatenate([rng.normal(size=3), np.zeros(3)])
        way /= np.linalg.norm(way)

        def local(t, pose=pose, way=way):
            return np.array(apices(RATIOS, (pose + t * way)[None])[0])[:, 0]

        low, high = 0.0, 0.3
        sign = np.sign(discriminant(quartic(RATIOS, local(low))[0]))
        if sign == np.sign(discriminant(quartic(RATIOS, local(high))[0])):
            continue
        for _ in range(60):
            middle = (low + high) / 2
            same = np.sign(discriminant(quartic(RATIOS, local(middle))[0])) == sign
            low, high = (middle, high) if same else (low, middle)
        coefficients, a, b = quartic(RATIOS, local(low))
        turning = np.roots(np.polyder(coefficients))
        turning = turning[np.abs(turning.imag) < 1e-9].real
        if not len(turning):
            continue
        u = turning[np.argmin(np.abs(np.polyval(coefficients, turning)))]
        if abs(np.polyval(coefficients, u)) > 1e-9 or abs(u) < 1e-3:
            continue  # a complex pair met, or the elimination degenerates
        p, m = u + a, b + a * b / u
        points.append((pose, way, low, (p + m) / 2, (p - m) / 2))
    return [np.array(column) for column in zip(*points, strict=True)]


def type_1_distance(count, rng):
    """How far along the paths the library's own locus lies from where the roots meet."""
    robot = js.TripleScissorExtender.from_ratios(*RATIOS)
    rest = robot.home()[1]

    def system(unknowns, pose, way):
        joints, there = rest.at[:2].set(unknowns[:2]), pose + unknowns[2] * way
        measure = js.singularities.measures(robot, there, joints=joints).type1[:1]
        return jnp.concatenate([js.residual(robot, there, joints=joints)[:2], measure])

    def solve(unknowns, pose, way):
        for _ in range(5):
            jacobian = jax.jacfwd(system)(unknowns, pose, way)
            unknowns = unknowns - jnp.linalg.solve(jacobian, system(unknowns, pose, way))
        return unknowns[2]

    pose, way, t, a, b = type_1_points(count, rng)
    found = jax.jit(jax.vmap(solve))(np.stack([a, b, t], axis=1), pose, way)
    return np.abs(found - t)


@pytest.mark.exhaustive
def test_type_1_vanishes_where_two_working_modes_meet(rng):
    assert type_1_distance(100, rng).max() < 1e-8


def planar_lines(mode, joints, alpha):
    """Linear conditions n.v = k on the first held corner, of the prototype at turns alpha: numpy alone."""
    robot, held = prototype(mode)
    base, platform = robot
    order = sorted(range(3), key=lambda i: held[i] == "theta")
    c, s = np.cos(alpha), np.sin(alpha)
    lines = []
    for i in order if held[order[0]] == "theta" else order[1:]:
        d = platform[i] - platform[order[0]]
        shift = np.array([c * d[0] - s * d[1], s * d[0] + c * d[1]]) - (base[i] - base[order[0]])[:, None]
        if held[i] == "theta":
            n = np.array([-np.sin(joints[i]), np.cos(joints[i])])[:, None] + 0 * shift
            lines.append((n, -np.sum(n * shift, axis=0)))
        else:
            lines.append((shift, (joints[i] ** 2 - joints[order[0]] ** 2 - np.sum(shift**2, axis=0)) / 2))
    return lines, order


@functools.cache
def prototype(mode):
    robot = js.NavaroII.prototype(mode)
    return (np.asarray(robot.base), np.asarray(robot.platform)), js.navaro.ACTUATION_MODES[mode]


def cross(m, n):
    return m[0] * n[1] - m[1] * n[0]


def corner(lines):
    (m, b), (n, c) = lines[:2]
    return np.array([(b * n[1] - c * m[1]) / cross(m, n), (c * m[0] - b * n[0]) / cross(m, n)])


def planar_spectrum(mode, joints):
    """Fourier coefficients of the resultant in alpha, lowest first."""
    degree = {0: 3, 1: 3, 2: 2, 3: 1}[prototype(mode)[1].count("theta")]
    count = 4 * degree
    alpha = 2 * np.pi * np.arange(count) / count
    lines, order = planar_lines(mode, joints, alpha)
    if len(lines) == 3:
        (k, a), (m, b), (n, c) = lines
        values = a * cross(m, n) + b * cross(n, k) + c * cross(k, m)
    else:
        (m, b), (n, c) = lines
        v = np.array([b * n[1] - c * m[1], c * m[0] - b * n[0]])
        values = np.sum(v**2, axis=0) - (joints[order[0]] * cross(m, n)) ** 2
    spectrum = np.fft.fft(values) / count
    return np.concatenate([spectrum[-degree:], spectrum[: degree + 1]])


def double_root(mode, start, way):
    """t, alpha at which two real roots of the resultant meet on the line ``start + t way`` of the joints, or None."""

    def real_roots(t):
        roots = np.roots(planar_spectrum(mode, start + t * way)[::-1])
        return np.angle(roots[np.abs(np.abs(roots) - 1) < 1e-7]), roots

    low, high = 0.0, 1.0
    count = len(real_roots(low)[0])
    if count == len(real_roots(high)[0]):
        return None
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (middle, high) if len(real_roots(middle)[0]) == count else (low, middle)
    roots = real_roots((low + high) / 2)[1]
    near = roots[np.abs(np.abs(roots) - 1) < 1e-2]
    gaps = np.abs(near[:, None] - near[None]) + 9 * np.eye(len(near))
    alpha, t = np.angle(near[np.unravel_index(np.argmin(gaps), gaps.shape)[0]]), (low + high) / 2

    def system(t, alpha):
        spectrum = planar_spectrum(mode, start + t * way)
        k = np.arange(len(spectrum)) - len(spectrum) // 2
        waves = spectrum * np.exp(1j * k * alpha) / np.abs(spectrum).max()
        return np.array([waves.sum().real, (1j * k * waves).sum().real]), (-(k**2) * waves).sum().real

    for _ in range(12):
        value, curvature = system(t, alpha)
        by_t = (system(t + 1e-6, alpha)[0] - system(t - 1e-6, alpha)[0]) / 2e-6
        step = np.linalg.solve(np.array([[by_t[0], value[1]], [by_t[1], curvature]]), value)
        t, alpha = t - step[0], alpha - step[1]
    return (t, alpha) if np.abs(step).max() < 1e-10 and 0 < t < 1 else None


def type_2_points(mode, count, rng):
    """Poses of the prototype at which two assembly modes meet."""
    (base, platform), held = prototype(mode)
    robot, poses = js.NavaroII.prototype(mode), []
    low, high = np.array([10.0, -10.0, -np.pi]), np.array([80.0, 70.0, np.pi])
    while len(poses) < count:
        start = np.asarray(robot.actuated(js.inverse_kinematics(robot, rng.uniform(low, high)).value))
        way = rng.uniform(-1, 1, 3) * [np.pi if joint == "theta" else 60.0 for joint in held]
        root = double_root(mode, start, way)
        if root is None:
            continue
        joints = start + root[0] * way
        lines, order = planar_lines(mode, joints, np.array([root[1]]))
        if abs(cross(lines[0][0], lines[1][0])[0]) < 1e-4 * 90**2:
            continue
        c, s = np.cos(root[1]), np.sin(root[1])
        arm = platform[order[0]]
        position = base[order[0]] + corner(lines)[:, 0] - [c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]]
        pose = np.array([*position, root[1]])
        rays = js.inverse_kinematics(robot, pose).value
        if np.abs(np.exp(1j * (np.asarray(robot.actuated(rays)) - joints)) - 1).max() > 1e-6:
            continue  # a direction met from behind: rho < 0
        poses.append(pose)
    return np.array(poses)


def type_2_distance(mode, count, rng):
    """How far the library's locus is from such poses, in lengths of the robot and radians, to first order."""
    robot = js.NavaroII.prototype(mode)

    def step(pose):
        slope = jax.grad(lambda p: js.singularities.measures(robot, p).type2)(pose) * jnp.array([90.0, 90.0, 1.0])
        return jnp.abs(js.singularities.measures(robot, pose).type2) / jnp.sqrt(jnp.sum(slope**2))

    return np.asarray(jax.jit(jax.vmap(step))(type_2_points(mode, count, rng)))


@pytest.mark.parametrize("mode", [8, *exhaustive(1, 3, 6)])
def test_type_2_vanishes_where_two_assembly_modes_meet(mode, rng):
    assert type_2_distance(mode, 25, rng).max() < 1e-8


def test_null_vectors_are_the_motions_that_cost_nothing():
    robot = js.NavaroII.prototype(8)
    loose = js.singularities.measures(robot, [45.0, 26.0, 0.0])  # similar triangles: all three legs meet in one point
    pose, slip = np.array([45.0, 26.0, 0.0]), np.asarray(loose.platform_motion)
    before, after = (robot.actuated(js.inverse_kinematics(robot, p).value) for p in (pose, pose + 1e-4 * slip))
    assert np.abs(after - before).max() < 1e-6
    scissor = js.TripleScissorExtender.from_ratios(*RATIOS)
    motion = np.asarray(js.singularities.measures(scissor, scissor.home()[0]).joint_motion)
    assert np.linalg.norm(motion, axis=1) == pytest.approx(1)


def test_measures_of_what_cannot_be_solved_carry_the_status(prototype):
    measures = js.singularities.measures(prototype, [0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
    assert measures.status == js.Status.NO_SOLUTION and bool(jnp.isnan(measures.type2))
    assert js.singularities.measures(prototype, np.full(6, np.nan)).status == js.Status.NONFINITE


def hexagon(radius):
    angles = np.radians(np.arange(0, 360, 60))
    return np.stack([radius * np.cos(angles), radius * np.sin(angles), 0 * angles], axis=1)


def loose_hexapod():
    with pytest.warns(UserWarning, match="loose whatever the lengths"):
        return js.StewartGough(hexagon(0.12), hexagon(0.1), (0.15, 0.25))


LOOSE = {
    "Gough-Stewart yawed by 90 deg": (js.StewartGough.prototype, lambda home: home.at[5].set(np.pi / 2)),
    "NaVARo II, mode 8, not turned": (lambda: js.NavaroII.prototype(8), lambda home: jnp.array([45.0, 26.0, 0.0])),
    "similar hexagons": (
        lambda: loose_hexapod(),
        lambda home: home + jnp.array([0.01, -0.02, 0.01, 0.1, -0.2, 0.1]),
    ),
}


LOOSEST = "NaVARo II, mode 8, not turned"


@pytest.mark.parametrize("case", [LOOSEST, *exhaustive(*(case for case in LOOSE if case != LOOSEST))])
def test_a_derivative_that_does_not_exist_is_zero(case):
    """The platform moves while the actuators rest; the derivative of forward kinematics was 1e15 and more."""
    build, moved = LOOSE[case]
    robot = build()
    pose = moved(robot.home()[0])
    actuated = robot.actuated(js.inverse_kinematics(robot, pose).value)

    def placed(q):
        solution = js.forward_kinematics(robot, q, guess=pose)
        return solution.value, solution.status

    slope, status = jax.jacfwd(placed, has_aux=True)(actuated)
    assert not np.asarray(slope).any()
    assert status == js.Status.SINGULAR


def test_a_robot_that_is_loose_everywhere_says_so_from_any_guess():
    robot = loose_hexapod()
    pose = robot.home()[0] + jnp.array([0.01, -0.02, 0.01, 0.1, -0.2, 0.1])
    actuated = js.inverse_kinematics(robot, pose).value
    for away in (1e-3, 1e-1):
        solution = js.forward_kinematics(robot, actuated, guess=pose + away * jnp.array([0.1, 0, 0, 0, 0, 1]))
        assert solution.status == js.Status.SINGULAR
        assert "loose" in js.Status(int(solution.status)).message
