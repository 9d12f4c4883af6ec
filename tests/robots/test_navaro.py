"""NaVARo II against the formulas of its paper, written out here, and against its closed forms."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor.robots._contract import actuated_mask
from tests.conftest import exhaustive

ROOT3 = np.sqrt(3)
MODES = sorted(js.navaro.ACTUATION_MODES)


def polynomial(mode, x, y, alpha):
    """[NAV19 eqs. 31-38]; 2 and 5 are misprinted there and stand here as det A of eq. 6 gives them."""
    c, s, r = np.cos(alpha), np.sin(alpha), ROOT3
    q = x**2 + y**2
    if mode == 1:
        return -3 * (-30 * r * y + q + 1800 * c - 90 * x - 300) * (c - 1 / 3)
    if mode == 3:
        return (
            (
                -160 * y * (x + 45) * c**2
                + ((80 * x**2 - 80 * y**2 + 7200 * x - 648000) * s - 4 * y * (q - 180 * x - 600)) * c
                + (4 * x**3 + 4 * x * y**2 - 720 * x**2 + 30000 * x + 108000) * s
                + 80 * y * (x - 90)
            )
            * r
            + (-240 * x**2 + 240 * y**2 + 21600 * x) * c**2
            + (-480 * y * (x - 45) * s - 4 * (x - 90) * (q - 180 * x - 600)) * c
            - 4 * y * (q - 180 * x + 7500) * s
            + 120 * x**2
            - 120 * y**2
            - 21600 * x
            + 972000
        )
    if mode == 4:
        return (
            (
                -160 * y * (x - 135) * c**2
                + ((80 * x**2 - 80 * y**2 - 21600 * x + 648000) * s + 4 * x**2 * y + 4 * y**3 - 34800 * y) * c
                + (-4 * x**3 + 360 * x**2 + (-4 * y**2 + 2400) * x + 360 * y**2 - 108000) * s
                + 80 * x * y
            )
            * r
            + (240 * x**2 - 240 * y**2 - 21600 * x) * c**2
            + (480 * y * (x - 45) * s - 4 * x**3 - 4 * x * y**2 + 34800 * x) * c
            + (-4 * x**2 * y - 4 * y**3 + 2400 * y) * s
            - 120 * x**2
            + 120 * y**2
        )
    if mode == 6:
        return (
            (
                (80 * x**2 - 80 * y**2 - 7200 * x + 324000) * c**2
                + (160 * y * (x - 45) * s + 360 * y**2 - 54000) * c
                - 360 * y * (x - 45) * s
                - 60 * x**2
                + 20 * y**2
                + 5400 * x
                - 156000
            )
            * r
            - 4 * y * (q - 90 * x + 8100) * c
            + 4 * (x - 45) * (q - 90 * x) * s
            + 5400 * y
        )
    if mode == 7:
        return (
            (
                480 * y * (x - 45) * c**2
                + ((-240 * x**2 + 240 * y**2 + 21600 * x) * s + 4 * y * (q - 180 * x + 8100)) * c
                - 4 * (x - 90) * (q - 180 * x) * s
                - 240 * y * (x - 45)
            )
            * r
            + (1944000 - 240 * x**2 + 240 * y**2 - 21600 * x) * c**2
            + (-480 * y * (x + 45) * s - 324000 - 12 * x**3 + 2160 * x**2 + (-12 * y**2 - 97200) * x) * c
            - 12 * y * (q - 180 * x) * s
            - 240 * y**2
            + 32400 * x
            - 936000
        )
    if mode == 8:
        return -s * (30 * r * y - q - 1800 * c + 90 * x + 300)
    return corrected(mode, x, y, c, s)


def corrected(mode, x, y, c, s):
    """det A of eq. 6 for modes 2 and 5, expanded; compare with the misprinted eqs. 32 and 35."""
    r = ROOT3
    if mode == 2:
        return (
            x**3 * c
            + x**2 * y * s
            + x * y**2 * c
            + y**3 * s
            - x**2 * c * (135 + 20 * r * s)
            + x * y * (40 * r * c**2 - 90 * r * c - 90 * s - 20 * r)
            + y**2 * (20 * r * c * s - 45 * c - 90 * r * s)
            + x * (1800 * r * c * s + 3450 * c + 2700)
            + y * (-1800 * r * c**2 + 4050 * r * c + 7500 * s + 900 * r)
            - 81000 * r * c * s
            + 27000 * c
            + 13500 * r * s
            - 121500
        )
    return (
        (x**3 + x * y**2) * (r * c - s)
        + (x**2 * y + y**3) * (c + r * s)
        + x**2 * (-20 * r * c**2 - 90 * r * c + 60 * c * s)
        + x * y * (60 - 120 * c**2 - 40 * r * c * s)
        + y**2 * (20 * r * c**2 - 90 * r * c - 60 * c * s - 20 * r)
        + x * (5400 * r * c**2 - 5400 * c * s + 8100 * s - 2700 * r)
        + y * (5400 * c**2 + 5400 * r * c * s - 8100 * r * s - 2700)
        - 162000 * r * c**2
        - 27000 * r * c
        + 165000 * r
    )


def determinant_a(robot, pose):
    """det A of [NAV19 eqs. 3-6] by numpy, h not normalised."""
    x, y, alpha = pose
    turn = np.array([[np.cos(alpha), -np.sin(alpha)], [np.sin(alpha), np.cos(alpha)]])
    quarter = np.array([[0, -1], [1, 0]])
    rows = []
    for corner, anchor, joint in zip(robot.platform, robot.base, js.navaro.ACTUATION_MODES[robot.mode], strict=True):
        arm = turn @ np.asarray(corner)
        bar = np.array([x, y]) + arm - np.asarray(anchor)
        h = quarter @ bar if joint == "theta" else bar
        rows.append([*h, -h @ quarter @ -arm])
    return np.linalg.det(rows)


def random_poses(rng, n):
    return np.column_stack([rng.uniform(-50, 140, (n, 2)), rng.uniform(-np.pi, np.pi, n)])


@pytest.mark.parametrize("mode", [1, 8, *exhaustive(2, 3, 4, 5, 6, 7)])
def test_type_2_measure_has_the_sign_of_det_a_and_of_the_papers_polynomial(mode, rng):
    robot, poses = js.NavaroII.prototype(mode), random_poses(rng, 10_000)
    type2 = np.asarray(jax.jit(jax.vmap(lambda pose: js.singularities.measures(robot, pose).type2))(poses))
    ours = np.array([determinant_a(robot, pose) for pose in poses])
    assert len(set(np.sign(type2 * ours))) == 1
    theirs = polynomial(mode, *poses.T)
    assert np.ptp(theirs / ours) < 1e-6 * abs(np.mean(theirs / ours)), "not the same up to a factor"
    assert len(set(np.sign(type2 * theirs))) == 1


@pytest.mark.parametrize("mode", [1, 8, *exhaustive(2, 3, 4, 5, 6, 7)])
def test_loops_close_as_the_paper_writes_them(mode, rng):
    robot = js.NavaroII.prototype(mode)
    x, y, alpha = pose = random_poses(rng, 1)[0]
    t1, r1, t2, r2, t3, r3 = np.asarray(js.inverse_kinematics(robot, pose).value)
    c, s = np.cos(alpha), np.sin(alpha)
    loops = [
        r1 * np.cos(t1) + 30 * c - r2 * np.cos(t2) - 90,
        r1 * np.sin(t1) + 30 * s - r2 * np.sin(t2),
        r1 * np.cos(t1) + 15 * (c - ROOT3 * s - 3) - r3 * np.cos(t3),
        r1 * np.sin(t1) + 15 * (s + ROOT3 * c - 3 * ROOT3) - r3 * np.sin(t3),
        x - r1 * np.cos(t1) - 15 * c + 5 * ROOT3 * s,
        y - r1 * np.sin(t1) - 15 * s - 5 * ROOT3 * c,
    ]
    assert np.abs(loops).max() < 1e-11
    names = js.navaro.ACTUATION_MODES[mode]
    expected = [{"theta": t, "rho": r}[name] for name, t, r in zip(names, (t1, t2, t3), (r1, r2, r3), strict=True)]
    assert np.array_equal(robot.actuated(jnp.array([t1, r1, t2, r2, t3, r3])), expected)


def test_eight_modes_are_those_of_the_table():
    letters = {mode: "".join(name[0] for name in names) for mode, names in js.navaro.ACTUATION_MODES.items()}
    assert letters == {1: "ttt", 2: "ttr", 3: "trt", 4: "rtt", 5: "trr", 6: "rrt", 7: "rtr", 8: "rrr"}


def test_workspace_ends_where_the_paper_says(rng):
    """[NAV19 eqs. 13-15]: each leg's greatest length; the least one likewise."""
    robot = js.NavaroII.prototype()
    for x, y, alpha in random_poses(rng, 200):
        c, s = np.cos(alpha), np.sin(alpha)
        squares = [
            10 * ROOT3 * x * s - 10 * ROOT3 * y * c + x**2 - 30 * x * c + y**2 - 30 * y * s + 300,
            (-10 * y * c + 10 * s * (x - 90)) * ROOT3 + (30 * x - 2700) * c + x**2 + y**2 + 30 * y * s - 180 * x + 8400,
            (20 * y * c + (-20 * x + 900) * s - 90 * y) * ROOT3 + x**2 + y**2 - 90 * x - 2700 * c + 8400,
        ]
        lengths = np.sqrt(squares)
        margin = min(lengths.min() - 9, 80 - lengths.max()) / 90
        assert float(js.feasibility(robot, [x, y, alpha]).margin) == pytest.approx(margin, abs=1e-12)


@pytest.mark.parametrize("crosses", [1, 2, 5])
def test_scissor_spans_the_stroke(crosses):
    robot = js.NavaroII.prototype()
    robot = js.NavaroII(robot.base, robot.platform, robot.stroke, crosses=crosses)
    scissor, h = robot.scissor, float(robot.bar_height)
    bar = 2 * float(scissor.link_lengths[0])
    assert bar == pytest.approx(np.sqrt(6481) / crosses) and h == pytest.approx(9 / crosses)  # [NAV19 eq. 30]
    assert bar > 3 * h
    assert float(scissor.height(h)) == pytest.approx(80)  # r_max = n sqrt(l^2 - h^2), eq. 28
    folded = np.sqrt(bar**2 - h**2)
    assert float(scissor.height(folded)) == pytest.approx(9)  # r_min = n h, eq. 27
    for rho in (9.0, 33.0, 80.0):
        assert float(scissor.height(scissor.width(rho))) == pytest.approx(rho)


@functools.cache
def sensed(mode):
    """Random poses, their joints, and what exact and what noisy sensors tell: one program for each mode."""
    rng = np.random.default_rng(mode)
    robot, n = js.NavaroII.prototype(mode), 300
    poses = np.column_stack([45 + rng.uniform(-30, 30, n), 26 + rng.uniform(-30, 30, n), rng.uniform(-3, 3, n)])
    joints = jax.vmap(js.inverse_kinematics, (None, 0))(robot, poses).value
    tell = jax.jit(jax.vmap(js.navaro.identify_assembly, (None, 0)))
    noise = 1e-4 * rng.normal(size=(n, 6)) * np.array([1, 30] * 3)  # rad, and a third of its share of rho
    noise[:3] = [[np.nan, 0, 0, 0, 0, 0], [0, np.nan, 0, 0, 0, 0], [0, 1e4, 0, 0, 0, 0]]
    return poses, joints, tell(robot, joints), tell(robot, joints + noise)


def corner_gaps(poses, others):
    """Root mean square distance of the platform's joints, by complex numbers: (..., 3) and (..., 3) to (...)."""
    corners = np.array([-15 - 5j * ROOT3, 15 - 5j * ROOT3, 10j * ROOT3])
    first, second = (p[..., 0] + 1j * p[..., 1] for p in (poses, others))
    turned = [first[..., None] + corners * np.exp(1j * poses[..., 2, None])]
    turned += [second[..., None] + corners * np.exp(1j * others[..., 2, None])]
    return np.sqrt(np.mean(np.abs(turned[0] - turned[1]) ** 2, axis=-1))


@pytest.mark.parametrize("mode", [1, 8, *exhaustive(2, 3, 4, 5, 6, 7)])
def test_six_sensors_give_the_pose_and_the_assembly_mode(mode):
    poses, _, exact, noisy = sensed(mode)
    lanes = np.arange(len(poses))
    assert corner_gaps(np.asarray(exact.pose), poses).max() < 1e-11 and exact.misfit.max() < 1e-12
    assert exact.index.min() >= 0 and exact.distance.max() < 1e-6
    assert corner_gaps(np.asarray(exact.modes.values)[lanes, exact.index], poses).max() < 1e-6

    # what is not finite tells nothing; the third lane's rho fits no pose of mode 8
    assert (noisy.index[:2] == -1).all() and np.isinf(noisy.distance[:2]).all() and np.isinf(noisy.runner_up[:2]).all()
    assert mode != 8 or (noisy.index[2] == -1 and np.isfinite(noisy.pose[2]).all())
    noisy, poses = jax.tree.map(lambda leaf: np.asarray(leaf)[3:], noisy), poses[3:]
    off = corner_gaps(noisy.pose, poses)
    assert 0 < noisy.misfit.min() and off.max() < 0.02
    gaps = np.where(noisy.modes.valid, corner_gaps(noisy.modes.values, poses[:, None]), np.inf)
    certain = noisy.distance < noisy.runner_up / 4  # elsewhere a second mode is about as near, at a singularity
    assert certain.mean() > 0.9 and (noisy.distance < 0.1).mean() > 0.9
    assert (gaps.argmin(axis=1) == noisy.index)[certain].all()
    shift = np.abs(noisy.distance[certain] - gaps.min(axis=1)[certain])
    assert (shift <= off[certain]).all(), "triangle inequality"


def test_sensors_must_be_six():
    with pytest.raises(ValueError, match=r"expects \(6,\)"):
        js.navaro.identify_assembly(js.NavaroII.prototype(8), np.zeros(3))


@pytest.mark.parametrize("mode", [1, 8, *exhaustive(2, 3, 4, 5, 6, 7)])
def test_parity_and_largest_number_of_assembly_modes(mode):
    poses, _, exact, _ = sensed(mode)
    modes = exact.modes
    turns = js.navaro.ACTUATION_MODES[mode].count("theta")
    assert int(modes.count.max()) <= {0: 6, 1: 6, 2: 4, 3: 2}[turns]
    if turns != 2:  # with two directions, rays let solutions end
        assert (np.asarray(modes.count) % 2 == 0).all()
    gap = jnp.abs(modes.values[..., :2] - poses[:, None, :2]).max(axis=-1)
    assert float(jnp.where(modes.valid, gap, jnp.inf).min(axis=1).max()) < 1e-6


BAD = [
    (dict(mode=9), "mode=9"),
    (dict(platform=np.zeros((3, 2))), "one line"),
    (dict(base=[[0, 0], [1, 1], [2, 2]]), "one line"),
    (dict(base=[[0, 0], [90, 0]]), r"shape \(2, 2\)"),
    (dict(stroke=(80, 9)), "least < greatest"),
    (dict(stroke=(1, 2)), "Widen the stroke"),
    (dict(crosses=0), "at least 1"),
    (dict(platform=[[np.nan, 0], [1, 0], [0, 1]]), "finite"),
]


@pytest.mark.parametrize(("change", "message"), BAD)
def test_impossible_geometry_is_refused(change, message):
    good = js.NavaroII.prototype()
    fields = dict(base=good.base, platform=good.platform, stroke=good.stroke, mode=8) | change
    with pytest.raises(ValueError, match=message):
        js.NavaroII(**fields)


def test_bars_that_cannot_fold_are_refused():
    good = js.NavaroII.prototype()
    with pytest.raises(ValueError, match="l > 3 h"):
        _ = js.NavaroII(good.base, good.platform, (30.0, 60.0)).scissor
    with pytest.raises(ValueError, match="without end"):
        _ = js.NavaroII(good.base, good.platform).scissor


@pytest.mark.parametrize("mode", [1, 8])
def test_a_leg_without_length_is_a_fold_on_which_all_functions_agree(mode):
    """At rho1 = 0 the closure holds for every theta1; the mode ends there, as on any fold."""
    robot = js.NavaroII.prototype(mode)
    x, y = np.asarray(robot.platform[0])
    pose = np.array([-x, -y, 0.0])
    solution, modes = js.inverse_kinematics(robot, pose), js.inverse_kinematics_all(robot, pose)
    assert solution.status == js.Status.CONVERGED and bool(modes.valid.all())
    assert float(solution.value[1]) == 0 and np.isfinite(solution.value).all()
    assert js.feasibility(robot, pose).status == js.Status.CONVERGED
    assert float(js.margins(robot, pose)[0, 0]) == 0
    assert np.isnan(js.inverse_jacobian(robot, pose)).all()  # there is none
    assert float(js.singularities.measures(robot, pose).type1[0]) == 0


def test_robots_of_one_class_that_differ_in_structure_have_joints_of_their_own():
    """Asked in turn: what was found for one mode must not be given for another."""
    for mode in (1, 8, 1, 6, 8):
        robot = js.NavaroII.prototype(mode)
        assert actuated_mask(robot) == sum(robot.actuation(), ())
