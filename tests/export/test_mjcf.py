"""MuJoCo's model of every robot does what the library says: where it settles, and what its actuators hold."""

import math
from functools import cache, partial
from itertools import product

import jax
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxscissor as js
from jaxscissor.robots import PLATFORM, Connection, Freedom
from jaxscissor.robots._stewart_gough import TelescopicLeg
from tests.conftest import tri_scott_skewed, tse_clockwise
from tests.toys import LinearDelta

ROBOTS = {
    "tse": js.TripleScissorExtender.prototype,
    "navaro_mode_8": js.NavaroII.prototype,
    "tri_scott": js.TriScott.prototype,
    "stewart_gough": js.StewartGough.prototype,
}
MORE = {
    "tse_clockwise": tse_clockwise,
    "navaro_mode_1": partial(js.NavaroII.prototype, 1),
    "navaro_mode_6": partial(js.NavaroII.prototype, 6),
    "tri_scott_skewed": tri_scott_skewed,
    "micabo": js.Micabo.prototype,
    "rotary_hexapod": js.robots.RotaryHexapod.prototype,
    "hexaglide": js.robots.Hexaglide.prototype,
    "planar_3rrr": js.robots.Planar3RRR.prototype,
}


def section_of(robot):
    """Flat bars that do not bend, which of a robot of any unit of length weigh some kilograms together."""
    scale = float(robot.length)
    material = js.statics.Material(math.inf, 2700.0 / scale**3)
    return js.statics.Section.rectangle(material, depth=0.01 * scale, width=0.01 * scale)


def cases(often, few, many):
    """These robots at a few poses, and by ``-m exhaustive`` all of them at many."""
    return pytest.mark.parametrize(
        ("name", "count"),
        [
            *((name, few) for name in often),
            *(pytest.param(*case, marks=pytest.mark.exhaustive) for case in product(ROBOTS | MORE, [many])),
        ],
    )


def made(name):
    return (ROBOTS | MORE)[name]()


def load_of(robot, *, gravity=True):
    """A load out of the middle; in the plane gravity lies in it."""
    planar, length = robot.space is js.SE2, float(robot.length)
    pull = ([1.0, -9.0, 0.0] if planar else [1.0, 0.5, -9.81]) if gravity else [0.0, 0.0, 0.0]
    center = np.array([0.05, 0.02, 0.0 if planar else 0.1]) * length
    return js.statics.Load(11.34, center, 4.0, [0.0, 0.01 * length, 0.0], pull)


def simulated(text):
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return model, data


@cache
def light(function):
    """A function of one pose compiled without most of the optimizations."""
    return jax.jit(function)


def settle(model, data, actuated, *, slowest=1e-9, ramp=400, steps=20_000):
    """Lead the actuated joints smoothly to their places and wait until nothing moves."""
    mujoco.mj_resetDataKeyframe(model, data, 0)
    start = data.ctrl.copy()
    for step in range(steps):
        share = min(step / ramp, 1)
        data.ctrl[:] = start + (actuated - start) * share**2 * (3 - 2 * share)
        mujoco.mj_step(model, data)
        if step > ramp and np.abs(data.qvel).max() < slowest:
            mujoco.mj_forward(model, data)
            return
    raise AssertionError(f"It still moves by {np.abs(data.qvel).max()} after {steps} steps.")


def placed(robot, pose):
    """Position and rotation matrix of a pose, by SciPy."""
    pose = np.asarray(pose)
    if robot.space is js.SE2:
        return np.array([*pose[:2], 0.0]), Rotation.from_euler("z", pose[2]).as_matrix()
    return pose[:3], Rotation.from_euler("XYZ", pose[3:]).as_matrix()


def pose_of(robot, data):
    """The pose of the platform, by SciPy."""
    body = data.body("platform")
    angles = Rotation.from_matrix(body.xmat.reshape(3, 3)).as_euler("XYZ")
    return np.array([*body.xpos[:2], angles[2]] if robot.space is js.SE2 else [*body.xpos, *angles])


def near_home(robot, count, seed):
    """Random poses within the limits."""
    unit = np.where(np.arange(robot.space.dimension) < robot.space.translations, float(robot.length), 1)
    steps = np.random.default_rng(seed).uniform(-0.08, 0.08, (count, len(unit)))
    return np.asarray(robot.home()[0]) + unit * steps


@cases(["tse", "stewart_gough"], 5, 100)
def test_it_settles_where_forward_kinematics_says(name, count):
    robot = made(name)
    text = js.export.to_mjcf(robot, section=section_of(robot), load=load_of(robot, gravity=False))
    model, data = simulated(text)
    assert np.abs(data.efc_pos).max() < 1e-12 * float(robot.length)
    near = 1e-8 * max(1.0, float(robot.length))
    for pose in near_home(robot, count, 0):
        joints = light(js.inverse_kinematics)(robot, pose).value
        if count > 5 or name == "navaro_mode_8":  # elsewhere the pose stands for what the contract's tests prove
            solution = light(js.forward_kinematics)(robot, robot.actuated(joints))
            assert solution.converged
            pose = solution.value
        settle(model, data, robot.actuated(joints))
        position, rotation = placed(robot, pose)
        np.testing.assert_allclose(data.body("platform").xpos, position, rtol=0, atol=near)
        np.testing.assert_allclose(data.body("platform").xmat.reshape(3, 3), rotation, rtol=0, atol=1e-8)
        np.testing.assert_allclose(data.efc_pos, 0, atol=1e-10 * float(robot.length))
        for number, value in enumerate(joints):
            if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"q{number}") >= 0:  # passive ones, too
                np.testing.assert_allclose(data.joint(f"q{number}").qpos[0], value, rtol=0, atol=10 * near)


@cases(["tse"], 3, 20)
def test_virtual_work_of_its_bodies_gives_the_forces_of_statics(name, count):
    robot = made(name)
    load = load_of(robot)
    for pose in near_home(robot, count, 1):
        joints = light(js.inverse_kinematics)(robot, pose).value
        text = js.export.to_mjcf(robot, pose, joints=joints, actuators="force", section=section_of(robot), load=load)
        model, data = simulated(text)
        columns = [data.efc_J.reshape(-1, model.nv).T]
        for one in np.eye(model.nu):
            data.ctrl[:] = one
            mujoco.mj_forward(model, data)
            columns.append(data.qfrc_actuator.copy()[:, None])
        weights = data.qfrc_bias - data.qfrc_passive
        found, *_ = np.linalg.lstsq(np.hstack(columns), weights, rcond=1e-12)
        np.testing.assert_allclose(np.hstack(columns) @ found, weights, rtol=0, atol=1e-9 * np.abs(weights).max())
        forces = light(js.statics.actuator_forces)(robot, pose, load=load, section=section_of(robot))
        assert forces.ok
        most = np.abs(forces.value).max()
        np.testing.assert_allclose(found[-model.nu :], forces.value, rtol=0, atol=1e-9 * most)


@pytest.mark.exhaustive
@cases(["stewart_gough"], 2, 20)
def test_at_rest_it_has_sagged_and_its_actuators_pull_as_statics_says(name, count):
    robot = made(name)
    angular = np.asarray(robot.actuated(np.tile(robot.legs().angular or (False,), 6)[: len(robot.home()[1])]))
    stiffness = 4e4 * np.where(angular, float(robot.length) ** 2, 1.0)
    weights = {"load": load_of(robot), "section": section_of(robot)}
    model, data = simulated(js.export.to_mjcf(robot, actuator_stiffness=stiffness, **weights))
    for pose in near_home(robot, count, 3):
        settle(model, data, robot.actuated(light(js.inverse_kinematics)(robot, pose).value), slowest=1e-8)
        sagged = pose_of(robot, data)
        sag = light(js.statics.sag)(robot, pose, actuator_stiffness=stiffness, **weights)
        forces = light(js.statics.actuator_forces)(robot, sagged, **weights)
        assert sag.ok and forces.ok
        np.testing.assert_allclose(sagged - pose, sag.pose - pose, rtol=0, atol=0.01 * np.abs(sag.pose - pose).max())
        np.testing.assert_allclose(data.actuator_force, forces.value, rtol=0, atol=1e-3 * np.abs(forces.value).max())


@js.pytree
class TwinLeg(TelescopicLeg):
    """The telescopic leg of a user, with two rods side by side and three turns in place of the upper ball."""

    def bars(self, joints, attachment):
        cylinder, rod = super().bars(joints, attachment)
        return [cylinder, rod, rod]

    def connections(self, joints, attachment):
        below, slide, ball = super().connections(joints, attachment)
        first, second = below.freedoms
        (along,) = slide.freedoms
        turns = (first, second, Freedom("turn", along.axis))
        twin = Connection(0, 2, slide.point, (Freedom("slide", along.axis),))
        slide = Connection(1, 0, slide.point, (Freedom("slide", -along.axis, joints=(0,)),))  # of cylinder on rod
        return [below, slide, twin, Connection(1, 2, ball.point), Connection(2, PLATFORM, ball.point, turns)]


@js.pytree
class Twin(js.StewartGough):
    def legs(self):
        legs = super().legs()
        return TwinLeg(legs.anchor, legs.scale, legs.stroke)


def test_a_robot_of_a_user_hangs_together_in_its_own_way():
    robot = Twin(*jax.tree.leaves(js.StewartGough.prototype()))
    text = js.export.to_mjcf(robot)
    assert (text.count("<weld"), text.count("<connect")) == (6, 12)
    model, data = simulated(text)
    (pose,) = near_home(robot, 1, 5)
    settle(model, data, light(js.inverse_kinematics)(robot, pose).value)
    position, rotation = placed(robot, pose)
    np.testing.assert_allclose(data.body("platform").xpos, position, rtol=0, atol=1e-8)
    np.testing.assert_allclose(data.body("platform").xmat.reshape(3, 3), rotation, rtol=0, atol=1e-8)


def test_what_cannot_be_exported_is_told():
    robot = js.StewartGough.prototype()
    with pytest.raises(ValueError, match="DeltaLeg does not say how its bars hang together"):
        js.export.to_mjcf(LinearDelta.example())
    with pytest.raises(ValueError, match="actuators = 'velocity'; expected 'position' or 'force'"):
        js.export.to_mjcf(robot, actuators="velocity")
    with pytest.raises(ValueError, match=r"actuator_stiffness of shape \(2,\); expected \(\) or \(6,\)"):
        js.export.to_mjcf(robot, actuator_stiffness=[1.0, 2.0])
    with pytest.raises(ValueError, match="pose of shape"):
        js.export.to_mjcf(robot, [0.0, 1.0])
    with pytest.raises(ValueError, match="home mode does not reach"):
        js.export.to_mjcf(js.TripleScissorExtender.prototype(), [0.0, 0.0, 3.0, 0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="outside jit"):
        jax.jit(js.export.to_mjcf)(robot)
