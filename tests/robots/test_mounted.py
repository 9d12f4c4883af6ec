"""Robots on a base that stands anywhere: what they do is what they did, moved."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxscissor as js
from jaxscissor.robots._spaces import position_size
from tests.conftest import exhaustive
from tests.toys import LinearDelta, ThreePRS

BASE = np.array([0.3, -0.2, 1.0, 0.5, 0.4, 0.3])
FLAT = np.array([3.0, -2.0, 0.5])
CASES = {
    "TSE": js.TripleScissorExtender.prototype,
    "delta": LinearDelta.example,
}
MORE = {
    "NaVARo II": partial(js.NavaroII.prototype, 8),
    "3-PRS": ThreePRS.example,
    "hexapod": js.StewartGough.prototype,
    "Tri-Scott": js.TriScott.prototype,
    "MICABO": js.Micabo.prototype,
}


def base_of(robot):
    return BASE if position_size(robot.space) == 3 else FLAT


def matrix(base):
    return Rotation.from_euler("XYZ", base[3:]).as_matrix() if len(base) == 6 else turn(base[2])


def turn(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@pytest.fixture(params=[*CASES, *exhaustive(*MORE)])
def robot(request):
    return (CASES | MORE)[request.param]()


whole = pytest.mark.parametrize("robot", ["delta", *exhaustive("TSE", *MORE)], indirect=True)


def carried(robot, base, pose):
    """The pose of the robot's own frame in the world, by SciPy."""
    frame, turned = js.frame(robot, pose), matrix(base)
    size = len(turned)
    place = base[:size] + turned @ np.asarray(frame.position)
    whole = np.eye(size) if robot.space.translations == robot.space.dimension else turned @ np.asarray(frame.matrix)
    return js.pose(robot, place, matrix=whole)


@whole
def test_a_mounted_robot_does_what_it_did(robot, rng):
    base = base_of(robot)
    there = js.robots.mounted(robot, base)
    home = robot.home()[0]
    np.testing.assert_allclose(there.home()[0], carried(robot, base, home), atol=1e-12)
    unit = np.where(np.arange(len(home)) < robot.space.translations, 0.05 * float(robot.length), 0.05)
    pose = js.constrained_pose(robot, np.asarray(home) + unit * rng.uniform(-1, 1, len(home))).value
    moved = carried(robot, base, pose)
    one, other = js.inverse_kinematics(robot, pose), js.inverse_kinematics(there, moved)
    assert one.status == other.status == js.Status.CONVERGED
    np.testing.assert_allclose(other.value, one.value, rtol=1e-9, atol=1e-12)
    back = js.forward_kinematics(there, there.actuated(other.value))
    assert back.converged
    np.testing.assert_allclose(back.value, moved, atol=1e-9 * float(robot.length))
    np.testing.assert_allclose(js.margins(there, moved), js.margins(robot, pose), atol=1e-12)
    for name in ("type1", "type2"):
        pair = [getattr(js.singularities.measures(*case), name) for case in ((there, moved), (robot, pose))]
        np.testing.assert_allclose(*pair, atol=1e-9)


def test_moving_the_base_is_moving_the_platform_back(robot):
    """d joints / d base against differences; base and platform shifted together change nothing."""
    base, size = jnp.asarray(base_of(robot)), robot.space.translations
    pose = js.robots.mounted(robot, base).home()[0]

    def joints(base, pose):
        return js.inverse_kinematics(js.robots.mounted(robot, base), pose).value

    def closure(base):
        there = js.robots.mounted(robot, base)
        return jnp.abs(js.residual(there, pose, joints=joints(base, pose)))

    by_base, by_pose = jax.jacfwd(joints, (0, 1))(base, pose)
    np.testing.assert_allclose(by_base[:, :size] + by_pose[:, :size], 0, atol=1e-9)
    for i in (0, len(base) - 1):
        step = 1e-6 * jnp.eye(len(base))[i]
        difference = (joints(base + step, pose) - joints(base - step, pose)) / 2e-6
        np.testing.assert_allclose(by_base[:, i], difference, atol=1e-6 * max(1, np.abs(difference).max()))
    assert jax.jit(closure)(base).shape  # a base that is traced


@pytest.mark.exhaustive
def test_weights_pull_down_in_the_world(prototype):
    """On its side it feels what it felt upright under a gravity turned the other way."""
    there, turned = js.robots.mounted(prototype, BASE), matrix(BASE)
    pose = prototype.home()[0]
    moved = carried(prototype, BASE, pose)
    section = js.statics.Section.rectangle(js.statics.Material.aluminum(), depth=0.03, width=0.006)
    load = js.statics.Load(payload=11.34)
    leaning = dataclasses.replace(load, gravity=turned.T @ np.asarray(load.gravity))
    one = js.statics.actuator_forces(prototype, pose, load=leaning, section=section)
    other = js.statics.actuator_forces(there, moved, load=load, section=section)
    np.testing.assert_allclose(other.value, one.value, rtol=1e-9)
    bars = [
        js.statics.bar_forces(*case, load=which) for *case, which in ((prototype, pose, leaning), (there, moved, load))
    ]
    turned_pins = np.asarray(bars[0].pins) @ turned.T
    np.testing.assert_allclose(bars[1].pins, turned_pins, atol=1e-9 * np.abs(np.asarray(bars[0].pins)).max())


@pytest.mark.exhaustive
def test_a_robot_on_a_robot_has_a_pose_of_its_own(prototype):
    """A delta under the platform of a TSE: its derivative by the TSE's joints, through both, against differences."""
    delta = LinearDelta.example()
    actuated, slides = prototype.home()[1], delta.home()[1] + jnp.array([0.01, -0.02, 0.03])

    def tip(actuated):
        base = js.forward_kinematics(prototype, actuated).value
        return js.forward_kinematics(js.robots.mounted(delta, base), slides).value

    slope = jax.jacfwd(tip)(actuated)
    step = 1e-6 * jnp.eye(6)[1]
    np.testing.assert_allclose(slope[:, 1], (tip(actuated + step) - tip(actuated - step)) / 2e-6, atol=1e-7)


@js.pytree
class Sideways(LinearDelta):
    """Sees a number besides the point."""

    def attachments(self, position, rotation):
        return [(position, position.z)] * 3


def test_what_cannot_be_mounted_is_refused(prototype):
    with pytest.raises(ValueError, match=r"expects a pose \(x, y, z, roll"):
        js.robots.mounted(prototype, FLAT)
    with pytest.raises(ValueError, match="points and directions"):
        js.robots.mounted(Sideways.example(), BASE)
    for space, said in ((js.robots.SO3, "free in all translations"), (js.robots.Schoenflies, "about that axis alone")):
        robot = LinearDelta.example()
        kind = js.pytree(type("Other", (LinearDelta,), {"space": space, "__doc__": ""}))
        with pytest.raises(ValueError, match=said):
            js.robots.mounted(kind(robot.radius, robot.rod), BASE)
