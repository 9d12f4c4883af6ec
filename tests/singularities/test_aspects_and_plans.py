"""Aspects, cuspidal pairs, mode plans, singular surfaces and swept areas, against closed forms and brute force."""

import dataclasses
import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor.singularities._aspects import least_between
from jaxscissor.singularities._measures import _type2, _without_passive
from jaxscissor.singularities._mode_plans import fewest_switches
from tests.conftest import exhaustive

BOX = js.Box([-50.0, -60.0, -np.pi], [140.0, 130.0, np.pi])
CENTER = np.array([45.0, 15 * np.sqrt(3)])


def endless(mode):
    return dataclasses.replace(js.NavaroII.prototype(mode), stroke=(0.0, np.inf))


@functools.cache
def partition(mode, clearance):
    return js.singularities.aspects(endless(mode), BOX, (24, 24, 24), min_type2=clearance)


def beyond_circle(poses):
    """[NAV19 eqs. 31, 38]: x^2 + y^2 - 90 x - 30 sqrt(3) y + 1800 cos(alpha) - 300, a circle about the middle."""
    return np.sum((poses[..., :2] - CENTER) ** 2, axis=-1) - 3000 + 1800 * np.cos(poses[..., 2])


@pytest.mark.parametrize(("mode", "sheet"), [(1, lambda a: np.cos(a) - 1 / 3), (8, np.sin)])
def test_aspects_of_modes_1_and_8_are_those_of_the_two_factors(mode, sheet):
    found = partition(mode, 0.0)
    poses = np.asarray(BOX.grid(found.labels.shape))
    quarter = 2 * (beyond_circle(poses) > 0) + (sheet(poses[:, 2]) > 0)
    labels = found.labels.ravel()
    assert len(set(zip(labels, quarter, strict=True))) == len(found.sizes), "a region has one combination of signs"
    assert found.sizes[:4].sum() > 0.998 * labels.size, "the angle is periodic; but for cells where sheets cross"
    assert len({quarter[labels == label][0] for label in range(4)}) == 4
    assert (np.bincount(labels) == found.sizes).all() and (np.diff(found.sizes) <= 0).all()
    # the measure is the product of the factors up to a positive or a negative function
    signs = [(-1) ** bin(quarter[labels == label][0]).count("1") for label in range(4)]
    assert abs(np.sum(signs * found.signs[:4])) == 4


def test_a_clearance_leaves_out_what_is_close_to_singular():
    wide, tight = partition(8, 0.0), partition(8, 0.05)
    assert ((tight.labels >= 0) <= (wide.labels >= 0)).all() and tight.sizes.sum() < wide.sizes.sum()
    poses = np.asarray(BOX.grid(tight.labels.shape))
    measures = jax.jit(jax.vmap(lambda pose: js.singularities.measures(endless(8), pose).type2))(poses)
    assert ((tight.labels.ravel() >= 0) == (np.abs(np.asarray(measures)) >= 0.05)).all()


def test_limits_bound_the_aspects_and_angles_wrap():
    robot = js.NavaroII.prototype(8)
    found = js.singularities.aspects(robot, BOX, (16, 16, 8))
    poses = np.asarray(BOX.grid(found.labels.shape))
    reached = np.array([bool(js.feasibility(robot, pose).feasible) for pose in poses[::7]])
    assert ((found.labels.ravel()[::7] >= 0) == reached).all()
    assert found.label([45.0, 26.0, 0.5]) == found.label([45.0, 26.0, 0.5 - 2 * np.pi]) >= 0
    assert found.label([500.0, 26.0, 0.5]) == -1


@pytest.mark.parametrize("mode", exhaustive(2, 5))
def test_a_cuspidal_pair_has_the_same_joints_and_a_regular_path(mode):
    """The paper's open question, answered by an example: verified here by det A of [NAV19 eq. 6]."""
    robot, found = endless(mode), js.singularities.aspects(endless(mode), BOX, (32, 32, 32), min_type2=0.02)
    search = js.singularities.cuspidal_search(robot, found, tries=200)
    assert search.found and search.tried == 200 and search.most == 4
    path = search.path.poses
    ends = [robot.actuated(js.inverse_kinematics(robot, pose).value) for pose in path[[0, -1]]]
    for end in ends:
        away = np.asarray(end - search.joints)
        away = np.where(
            [h == "theta" for h in js.navaro.ACTUATION_MODES[mode]], (away + np.pi) % (2 * np.pi) - np.pi, away
        )
        assert np.abs(away).max() < 1e-6
    assert np.linalg.norm(path[0] - path[-1]) > 1, "two modes, not one"
    dense = np.concatenate([np.linspace(a, b, 50) for a, b in itertools.pairwise(path)])
    type2, lengths = jax.jit(
        jax.vmap(lambda p: (js.singularities.measures(robot, p).type2, js.inverse_kinematics(robot, p).value[1::2]))
    )(dense)
    assert len(set(np.sign(type2).tolist())) == 1 and lengths.min() > 1
    assert np.abs(type2).min() == pytest.approx(search.path.worst, rel=0.02) and search.path.worst >= 0.02
    determinants = np.array([determinant_a(robot, pose) for pose in dense])
    assert len(set(np.sign(determinants))) == 1


def determinant_a(robot, pose):
    """det A of [NAV19 eqs. 3-6], rows by the lines' moments."""
    tips = np.asarray(robot.platform) @ turn(pose[2]).T
    rows = []
    for arm, anchor, joint in zip(tips, np.asarray(robot.base), js.navaro.ACTUATION_MODES[robot.mode], strict=True):
        x, y = pose[:2] + arm - anchor
        h = np.array([-y, x] if joint == "theta" else [x, y])
        rows.append([*h, arm[0] * h[1] - arm[1] * h[0]])
    return np.linalg.det(rows)


def turn(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@pytest.mark.parametrize("mode", [8, *exhaustive(1)])
def test_no_cuspidal_pair_in_modes_1_and_8(mode):
    search = js.singularities.cuspidal_search(endless(mode), partition(mode, 0.0), tries=300)
    assert not search.found and search.tried == 300 and search.most == {1: 2, 8: 4}[mode]
    assert search.path.poses.shape == (0, 3) and search.joints.shape == (0,)


def test_between_two_aspects_there_is_no_path():
    path = js.singularities.aspect_path(endless(8), partition(8, 0.0), [45.0, 26.0, 1.0], [45.0, 26.0, -1.0])
    assert not path.clear and len(path.poses) == 0 and np.isnan(path.worst)
    across = js.singularities.aspect_path(endless(8), partition(8, 0.0), [45.0, 26.0, 1.0], [45.0, 30.0, 2.0])
    assert across.clear and np.abs(np.diff(across.poses, axis=0)).max() < 8


def brute_force(worth, clearance):
    """Changes and least entry of the best of all sequences."""
    rows, columns = worth.shape
    best = None
    for chosen in itertools.product(range(columns), repeat=rows):
        least = min(worth[row, column] for row, column in enumerate(chosen))
        if least >= clearance:
            candidate = (sum(a != b for a, b in itertools.pairwise(chosen)), -least)
            best = candidate if best is None else min(best, candidate)
    return best


def test_planner_is_as_good_as_brute_force(rng):
    changes = []
    for case in range(300):
        rows, columns = rng.integers(1, 7), rng.integers(1, 5)
        worth = rng.uniform(0, 1, (rows, columns)) + (rng.uniform(size=(rows, columns)) < 0.4)
        if case % 2:
            worth = np.round(worth, 1)  # ties
        clearance = min(0.6, worth.max(axis=1).min())
        chosen, least = fewest_switches(worth, clearance)
        picked = worth[np.arange(rows), chosen]
        assert picked.min() == least >= clearance
        changes.append(np.count_nonzero(np.diff(chosen)))
        assert (changes[-1], -least) == brute_force(worth, clearance)
    assert max(changes) >= 3


def test_a_plan_leaves_a_mode_before_its_singularity():
    path = np.linspace([45.0, 26.0, 1.4], [45.0, 26.0, -0.9], 93)  # mode 1 is singular at 1.231, mode 8 at 0
    robots = {mode: js.NavaroII.prototype(mode) for mode in (8, 1)}
    plan = js.singularities.plan_modes(robots, path, min_type2=0.02)
    assert plan.status == js.Status.PLANNED and plan.modes.shape == (93,)
    assert plan.modes[0] == 8 and plan.modes[-1] == 1 and len(plan.switches) == 1
    (switch,) = plan.switches
    assert 0 < path[switch, 2] < np.arccos(1 / 3), "after mode 1's singularity, before mode 8's"
    assert (np.abs(plan.type2[switch]) >= 0.02).all(), "both modes are clear where they change"
    assert plan.attainable >= plan.worst >= 0.02 and plan.blocked.size == 0
    tight = js.singularities.plan_modes(robots, path, min_type2=plan.attainable * 1.001)
    assert tight.status == js.Status.NO_CLEAR_MODE and tight.blocked.size and np.isnan(tight.worst)
    assert tight.modes.size == tight.switches.size == 0 and tight.attainable == plan.attainable


def test_plans_that_cannot_be():
    robots = {8: js.NavaroII.prototype(8)}
    across = np.linspace([45.0, 26.0, 0.5], [45.0, 26.0, -0.5], 20)  # no sample on the locus itself
    plan = js.singularities.plan_modes(robots, across, min_type2=1e-6)
    assert plan.status == js.Status.NO_CLEAR_MODE and plan.blocked.tolist() == [9] and plan.attainable == 0
    away = np.linspace([45.0, 26.0, 0.5], [200.0, 26.0, 0.5], 20)
    plan = js.singularities.plan_modes(robots, away, min_type2=0.01)
    assert plan.status == js.Status.OUT_OF_REACH and np.isnan(plan.attainable)
    for bad, message in (
        (dict(robots={}, path=across, min_type2=0.1), "no robots"),
        (dict(robots=robots, path=across[:1], min_type2=0.1), "at least two"),
        (dict(robots=robots, path=across[:, :2], min_type2=0.1), r"\(20, 2\)"),
        (dict(robots=robots, path=across, min_type2=0.0), "positive"),
    ):
        with pytest.raises(ValueError, match=message):
            js.singularities.plan_modes(**bad)


def test_a_crossing_is_blocked_wherever_it_lies_between_two_poses():
    """Mode 8 along alpha, singular at 0: crossed once before or after the middle, or twice around it."""
    robots = {8: js.NavaroII.prototype(8)}
    for alphas in ([0.3, -0.1], [0.1, -0.3]):
        plan = js.singularities.plan_modes(robots, [[45.0, 26.0, a] for a in alphas], min_type2=1e-6)
        assert plan.status == js.Status.NO_CLEAR_MODE and plan.blocked.tolist() == [0] and plan.attainable == 0
    # the circle of [NAV19 eq. 38] has radius 39.6 at alpha = 0.5: a chord just inside it leaves and enters it again
    radius = np.sqrt(3000 - 1800 * np.cos(0.5))
    ends = CENTER + np.array([[-25.0, 0.98 * radius], [25.0, 0.98 * radius]])
    assert (beyond_circle(np.column_stack([ends, [0.5, 0.5]])) > 0).all()
    assert beyond_circle(np.array([*ends.mean(axis=0), 0.5])) < 0
    chord = js.singularities.plan_modes({8: endless(8)}, np.column_stack([ends, [0.5, 0.5]]), min_type2=1e-6)
    assert chord.status == js.Status.NO_CLEAR_MODE and chord.attainable == 0


def test_switches_are_where_the_modes_change():
    path = np.linspace([45.0, 26.0, 1.4], [45.0, 26.0, -0.9], 93)
    plan = js.singularities.plan_modes({mode: js.NavaroII.prototype(mode) for mode in (8, 1)}, path, min_type2=0.02)
    assert [i for i in range(1, 93) if plan.modes[i] != plan.modes[i - 1]] == plan.switches.tolist()
    used = np.abs(plan.type2[np.arange(93), np.where(plan.modes == 8, 0, 1)])
    assert plan.worst == pytest.approx(used.min(), rel=0.02)


@pytest.mark.parametrize("values", [(1.0, 2.0, 0.2), (2.0, 1.0, 0.2), (1.0, 1.0, 3.0), (1.0, 5.0, 3.2)])
def test_the_least_value_of_a_parabola(values):
    """Start, end and middle, against a dense evaluation of the parabola through them."""
    parabola = np.polyfit([0, 1, 0.5], values, 2)
    dense = np.polyval(parabola, np.linspace(0, 1, 100_001)).min()
    assert float(least_between(*(np.array(v) for v in values))) == pytest.approx(dense, abs=1e-8)


def test_surfaces_lie_on_the_locus():
    triangles = js.singularities.surface(endless(8), BOX, (20, 20, 21))
    corners = triangles.reshape(-1, 3)
    flat = np.minimum(np.abs(np.sin(corners[:, 2])), 1)
    radius = np.sqrt(3000 - 1800 * np.cos(corners[:, 2]))
    off = np.abs(np.linalg.norm(corners[:, :2] - CENTER, axis=1) - radius)
    cells = np.minimum(flat / 0.3, off / 9.5)  # a cell is 9.5 wide and 0.3 high
    assert cells.max() < 1 and np.median(cells) < 0.05, "far off only where the sheets cross"
    plane = triangles[np.abs(triangles[..., 2]).max(axis=1) < 0.3]
    area = np.abs(np.cross(plane[:, 1] - plane[:, 0], plane[:, 2] - plane[:, 0])[:, 2]) / 2
    assert area.sum() == pytest.approx(190 * 190, rel=0.03), "alpha = 0 is covered once, seen from above"

    inside = js.singularities.surface(js.NavaroII.prototype(8), BOX, (20, 20, 21))
    margins = [
        float(js.feasibility(js.NavaroII.prototype(8), triangle.mean(axis=0)).margin) for triangle in inside[::9]
    ]
    assert 0 < len(inside) < len(triangles) and min(margins) > -0.05
    with pytest.raises(ValueError, match="2 of 3 coordinates vary"):
        js.singularities.surface(endless(8), js.Box([0, 0, 0.5], [1, 1, 0.5]), (2, 2, 2))


def test_swept_areas_of_a_disc_seen_from_an_anchor():
    """Tips that fill a disc of radius a at a distance d: kite and sector in front, the rest of the rods behind."""
    robot, n = js.NavaroII.prototype(), 200_000
    poses = np.asarray(js.Disc(CENTER, 20.0, 0.0, 0.0).quasi_random(n))
    d, a, rod = np.hypot(30.0, 10 * np.sqrt(3)), 20.0, 80.0
    front = np.sqrt(d**2 - a**2) * a + a**2 * (np.pi / 2 + np.arcsin(a / d))
    angle = np.linspace(-np.arcsin(a / d), np.arcsin(a / d), 20_001)
    nearest = d * np.cos(angle) - np.sqrt(np.maximum(a**2 - (d * np.sin(angle)) ** 2, 0))
    behind = np.sum((rod - nearest)[1:] ** 2) / 2 * (angle[1] - angle[0])
    scissor = js.navaro.swept_area(robot, poses, "scissor", directions=720)
    prismatic = js.navaro.swept_area(robot, poses, "prismatic", directions=720)
    assert scissor.areas == pytest.approx([front] * 3, rel=0.01)
    assert prismatic.areas == pytest.approx([front + behind] * 3, rel=0.01)
    assert (prismatic.reach >= scissor.reach).all() and scissor.reach.shape == (3, 720)
    toward = np.arctan2(*(CENTER - np.asarray(robot.base)).T[::-1])
    off = np.abs((scissor.directions - toward[:, None] + np.pi) % (2 * np.pi) - np.pi)
    half, edge = np.pi / 720, np.arcsin(a / d)
    assert (scissor.reach[off > edge + half] == 0).all() and (scissor.reach[off < edge - 0.05] > 0).all()
    seen = off < edge - 0.05
    nearer, farther = (
        d * np.cos(angle) + np.sqrt(a**2 - (d * np.sin(angle)) ** 2)
        for angle in (np.where(seen, off + half, 0), np.where(seen, np.maximum(off - half, 0), 0))
    )
    assert (scissor.reach <= farther * (1 + 1e-9))[seen].all(), "no farther than the nearer side of a sector"
    assert (scissor.reach >= nearer)[seen].mean() > 0.95, "some tips are near that side"
    with pytest.raises(ValueError, match="without end"):
        js.navaro.swept_area(endless(8), poses)
    with pytest.raises(ValueError, match="'telescope'"):
        js.navaro.swept_area(robot, poses, "telescope")  # pyright: ignore


def test_a_box_of_other_poses_is_refused():
    with pytest.raises(ValueError, match="box of 2 coordinates"):
        js.singularities.aspects(endless(8), js.Box([0, 0], [1, 1]), (2, 2))


@js.pytree
class Gantry(js.Leg):
    """Three slides along the axes, the last one passive."""

    anchor: js.Vec
    axes: tuple
    actuated = (True, True, False)

    def residual(self, joints, attachment):
        tip = self.anchor - attachment
        for axis, q in zip(self.axes, joints, strict=True):
            tip = tip + axis * q
        return tip.components


@js.pytree
class Gantries(js.Mechanism):
    directions: jax.Array
    space = js.SE3
    length = 1.0

    def legs(self):
        axes = tuple(js.Vec(*(self.directions[:, k, i] for i in range(3))) for k in range(3))
        return Gantry(js.Vec(*(0 * self.directions[:, 0, i] for i in range(3))), axes)


def test_the_measure_is_the_same_however_passive_joints_are_eliminated(rng):
    """Legs with two actuated joints and a passive one, which take the bordered determinant, and NaVARo's three rows."""
    navaro = js.NavaroII.prototype(3)
    gantries = Gantries(jnp.asarray(rng.normal(size=(3, 3, 3))))
    for robot, rows, columns in ((navaro, 6, 9), (gantries, 9, 15)):
        matrix = rng.normal(size=(rows, columns))
        d, flags = robot.space.dimension, np.array(sum(robot.actuation(), ()))
        for leg, (own, d_leg) in enumerate([(rows // 3, columns - d)] * 3):  # joints move their own leg alone
            block = np.zeros((own, d_leg))
            block[:, leg * own : (leg + 1) * own] = rng.normal(size=(own, own))
            matrix[leg * own : (leg + 1) * own, d:] = block
        twist, driven, free = matrix[:, :d], matrix[:, d:][:, flags], matrix[:, d:][:, ~flags]
        basis = np.linalg.svd(free)[0][:, free.shape[1] :].T  # rows that eliminate the passive joints
        a, b = basis @ twist, basis @ driven
        expected = abs(np.linalg.det(a)) / np.sqrt(np.linalg.det(a @ a.T + b @ b.T))
        assert (_without_passive(robot, jnp.asarray(matrix)) is None) == (robot is gantries)
        assert abs(float(_type2(robot, jnp.asarray(matrix)))) == pytest.approx(expected)
