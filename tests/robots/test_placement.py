"""A robot that is moved in the world does what it did, moved; and robots that are none are refused."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor.kinematics._all_modes import AssemblyModes
from tests.conftest import tri_scott_skewed

TILT = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 3)))[0]
TILT = TILT * np.linalg.det(TILT)
YAW = 0.7
TURN = np.array([[np.cos(YAW), -np.sin(YAW), 0], [np.sin(YAW), np.cos(YAW), 0], [0, 0, 1]])
SHIFT = np.array([3.0, -2.0, 0.0])


def hexapod(turn, shift):
    robot = js.StewartGough.prototype()
    return dataclasses.replace(robot, base=np.asarray(robot.base) @ turn.T + shift)


def turned_extender(turn, shift):
    robot = js.TripleScissorExtender.prototype()
    return dataclasses.replace(robot, azimuths=robot.azimuths + np.arctan2(turn[1, 0], turn[0, 0]))


def moved_masts(turn, shift):
    robot = tri_scott_skewed()
    return dataclasses.replace(robot, masts=np.asarray(robot.masts) @ turn[:2, :2].T + shift[:2])


def moved_anchors(mode, turn, shift):
    robot = js.NavaroII.prototype(mode)
    return dataclasses.replace(robot, base=np.asarray(robot.base) @ turn[:2, :2].T + shift[:2])


CASES = {
    "Gough-Stewart, tilted": (hexapod, TILT, SHIFT * np.array([1, 1, 0]) + 1),
    "Gough-Stewart, on its side": (hexapod, np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), SHIFT),
    "TSE": (turned_extender, TURN, 0 * SHIFT),  # the platform's joints turn with the legs
    "Tri-Scott": (moved_masts, TURN, SHIFT),
    **{f"NaVARo II, mode {m}": (functools.partial(moved_anchors, m), TURN, 10 * SHIFT) for m in (1, 8)},
}


@pytest.fixture(params=CASES)
def pair(request):
    """The robot, the moved robot, and what the motion makes of a pose."""
    build, turn, shift = CASES[request.param]
    robot, moved = build(np.eye(3), np.zeros(3)), build(turn, shift)
    body = TURN.T if request.param == "TSE" else np.eye(3)

    def carried(pose):
        if robot.space is js.SE2:
            alpha = pose[2] + YAW
            place = turn[:2, :2] @ pose[:2] + shift[:2]
            return np.array([*place, np.arctan2(np.sin(alpha), np.cos(alpha))])
        position, rotation = robot.space.place(jnp.asarray(pose))
        matrix = turn @ np.asarray(rotation.array()) @ body
        columns = js.Rotation(*(js.Vec(*map(jnp.asarray, column)) for column in matrix.T))
        place = turn @ np.asarray(position.array()) + shift
        return np.array(robot.space.coordinates(js.Vec(*map(jnp.asarray, place)), columns))

    return robot, moved, carried


def poses_around_home(robot, rng):
    home = np.asarray(robot.home()[0])
    scale = np.where(np.arange(len(home)) < robot.space.translations, 0.05 * float(robot.length), 0.1)
    return home + scale * rng.uniform(-1, 1, (4, len(home)))


def test_a_moved_robot_does_what_it_did(pair, rng):
    robot, moved, carried = pair
    home, joints = robot.home()
    np.testing.assert_allclose(moved.home()[0], carried(home), atol=1e-9 * float(robot.length))
    turned = np.asarray(moved.legs().angular or (False,) * len(moved.legs().actuated))
    same = ~np.tile(turned, len(robot.actuation()))  # angles are measured from the x axis of the world
    np.testing.assert_allclose(np.asarray(moved.home()[1])[same], np.asarray(joints)[same], rtol=1e-9)
    for pose in poses_around_home(robot, rng):
        there = carried(pose)
        solved, again = js.inverse_kinematics(robot, pose), js.inverse_kinematics(moved, there)
        assert solved.status == again.status == js.Status.CONVERGED
        np.testing.assert_allclose(np.asarray(again.value)[same], np.asarray(solved.value)[same], rtol=1e-9)
        back = js.forward_kinematics(moved, moved.actuated(again.value))
        assert back.status == js.forward_kinematics(robot, robot.actuated(solved.value)).status
        np.testing.assert_allclose(back.value, there, atol=1e-7 * float(robot.length))
        for function in (js.margins, js.gear_ratios, measures):
            for one, other in zip(*map(jax.tree.leaves, (function(robot, pose), function(moved, there))), strict=True):
                if function is not js.gear_ratios or np.ndim(one):  # the vertical one knows the world's z
                    np.testing.assert_allclose(other, one, atol=1e-9)


def measures(robot, pose):
    found = js.singularities.measures(robot, pose)
    return np.abs(found.type1), found.type2


@pytest.mark.parametrize("pair", [name for name in CASES if "Gough" not in name], indirect=True)  # that has no formula
def test_the_modes_within_limits_are_those_moved(pair):
    robot, moved, _ = pair
    joints = robot.actuated(robot.home()[1])
    there = moved.actuated(moved.home()[1])
    one, other = js.forward_kinematics_all(robot, joints), js.forward_kinematics_all(moved, there)
    assert int(one.count) == int(other.count)
    assert int(js.within_limits(robot, one).sum()) == int(js.within_limits(moved, other).sum()) >= 1


def test_a_hexapod_hangs_or_stands_and_keeps_its_side():
    """Both assembly modes close; only the one on home's side counts, whichever way is down."""
    for turn in (np.eye(3), CASES["Gough-Stewart, on its side"][1]):
        moved = hexapod(turn, np.zeros(3))
        pose = np.asarray(moved.home()[0])
        position, _ = moved.space.place(jnp.asarray(pose))
        mirrored = -np.asarray(position.array())
        flipped = np.array([*mirrored, *pose[3:]])
        joints = jnp.stack([moved.home()[1]] * 2)
        both = AssemblyModes(jnp.stack([pose, flipped]), jnp.ones(2, bool), joints, jnp.int32(2), False)
        assert js.within_limits(moved, both).tolist() == [True, False]


def test_geometry_that_holds_no_platform_is_refused():
    robot = js.TripleScissorExtender.prototype()
    for azimuths in ((0.0, 0.0, 0.0), (0.0, 0.0, 2.0), (0.0, np.pi, 0.0), (0.0, 2.0, 2 * np.pi)):
        with pytest.raises(ValueError, match="three different directions"):
            dataclasses.replace(robot, azimuths=azimuths)


@pytest.mark.parametrize("kind", [js.TriScott, js.Micabo])
@pytest.mark.parametrize("high", [np.inf, 3.0])
def test_a_stroke_without_a_lower_end_leaves_a_finite_home(kind, high):
    robot = dataclasses.replace(kind.prototype(), stroke=[[-np.inf, high], [-np.inf, high]])
    pose, joints = robot.home()
    assert np.isfinite(pose).all() and np.isfinite(joints).all()
    assert float(js.feasibility(robot, pose).margin) >= 0
