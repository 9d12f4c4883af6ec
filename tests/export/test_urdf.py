"""The tree of a URDF with its loops closed, by MuJoCo's kinematics, moves as the library says."""

from functools import partial
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor.robots._contract import actuated_mask
from tests.conftest import exhaustive, tri_scott_skewed
from tests.export.test_mjcf import light, near_home, placed, section_of
from tests.toys import LinearDelta

ROBOTS = {
    "navaro_mode_1": partial(js.NavaroII.prototype, 1),
    "stewart_gough": js.StewartGough.prototype,
    "tse": js.TripleScissorExtender.prototype,
    "tri_scott_skewed": tri_scott_skewed,
    "micabo": js.Micabo.prototype,
}


class Assembly:
    """A URDF's tree in MuJoCo, and its loops as equations; numbers of the file are read by this test alone."""

    def __init__(self, text):
        self.file = ElementTree.fromstring(text)
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        self.held = []  # pairs of (body, point in its frame)
        for closure in self.file.findall("loop_closure"):
            (first, a), (second, b) = (
                (closure.find(end).get("link"), numbers(closure.find(end))) for end in ("first", "second")
            )
            arms = (
                [np.zeros(3)] if closure.get("type") == "ball" else [numbers(closure.find("axis")) * s for s in (-1, 1)]
            )
            self.held += [((first, a + arm), (second, b + arm)) for arm in arms]  # all frames are parallel at zero

    def joint(self, name):
        return mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, name)

    def point(self, body, place):
        """A point and its Jacobian."""
        if body == "base":
            return place, np.zeros((3, self.model.nv))
        found = self.data.body(body)
        point = found.xpos + found.xmat.reshape(3, 3) @ place
        rows = np.zeros((3, self.model.nv))
        mujoco.mj_jac(self.model, self.data, rows, None, point, found.id)
        return point, rows

    def close(self, moves):
        """Newton's method on all loops, with some joints led by ``moves``."""
        for _ in range(30):
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_comPos(self.model, self.data)
            pairs = [[self.point(*end) for end in ends] for ends in self.held]
            errors = [one[0] - other[0] for one, other in pairs]
            rows = [one[1] - other[1] for one, other in pairs]
            for name, move in moves.items():
                errors.append(self.data.qpos[[self.joint(name)]] - move)
                rows.append(np.eye(self.model.nv)[[self.joint(name)]])
            for element in self.file.iter("mimic"):
                (follower,) = (j.get("name") for j in self.file.findall("joint") if element in list(j))
                i, k = self.joint(follower), self.joint(element.get("joint"))
                errors.append(self.data.qpos[[i]] - float(element.get("multiplier")) * self.data.qpos[[k]])
                rows.append(
                    (np.eye(self.model.nv)[i] - float(element.get("multiplier")) * np.eye(self.model.nv)[k])[None]
                )
            error = np.concatenate(errors)
            if np.abs(error).max() < 1e-12:
                return
            self.data.qpos -= np.linalg.lstsq(np.vstack(rows), error, rcond=1e-9)[0]
        raise AssertionError(f"The loops stay open by {np.abs(error).max()}.")

    def platform(self):
        """Position and rotation of the platform's frame, which MuJoCo merges into the platform."""
        (fixed,) = (joint for joint in self.file.findall("joint") if joint.get("name") == "platform_frame")
        rpy = [float(x) for x in fixed.find("origin").get("rpy").split()]
        body, turn = self.data.body("platform"), np.zeros(9)
        quaternion = np.zeros(4)
        mujoco.mju_euler2Quat(quaternion, rpy, "XYZ")
        mujoco.mju_quat2Mat(turn, quaternion)
        frame = body.xmat.reshape(3, 3)
        return body.xpos + frame @ numbers(fixed.find("origin")), frame @ turn.reshape(3, 3)


def numbers(element):
    return np.array([float(x) for x in element.get("xyz").split()])


@pytest.mark.parametrize("name", ["stewart_gough", *exhaustive(*(name for name in ROBOTS if name != "stewart_gough"))])
def test_closing_its_loops_puts_the_platform_where_the_joints_say(name):
    robot = ROBOTS[name]()
    start, pose = near_home(robot, 2, 4) * 0.5 + 0.5 * np.asarray(robot.home()[0])
    before, after = (np.asarray(light(js.inverse_kinematics)(robot, p).value) for p in (start, pose))
    assembly = Assembly(js.export.to_urdf(robot, start, joints=before, section=section_of(robot)))
    assembly.close({})
    assert not assembly.data.qpos.any()  # all loops are closed at zero
    position, rotation = placed(robot, start)
    np.testing.assert_allclose(assembly.platform()[0], position, rtol=0, atol=1e-12 * float(robot.length))
    np.testing.assert_allclose(assembly.platform()[1], rotation, rtol=0, atol=1e-12)
    used = np.flatnonzero(actuated_mask(robot))
    led = {}
    for joint in assembly.file.findall("joint"):
        parts = joint.get("name").replace("q", "").split("_")
        if joint.get("name").startswith("q") and all(part.isdigit() and int(part) in used for part in parts):
            led[joint.get("name")] = sum(after[int(part)] - before[int(part)] for part in parts)
    assert len(led) == len(used)
    assembly.close(led)
    position, rotation = placed(robot, pose)
    np.testing.assert_allclose(assembly.platform()[0], position, rtol=0, atol=1e-9 * float(robot.length))
    np.testing.assert_allclose(assembly.platform()[1], rotation, rtol=0, atol=1e-9)


def test_it_weighs_what_section_and_load_say():
    robot = js.StewartGough.prototype()
    section = js.statics.Section.tube(js.statics.Material.steel(), diameter=0.02)
    text = js.export.to_urdf(robot, section=section, load=js.statics.Load(payload=5.0, platform_mass=3.0))
    masses = {link.get("name"): link.find("inertial/mass") for link in ElementTree.fromstring(text).findall("link")}
    length = float(robot.home()[1].sum())
    bars = sum(float(mass.get("value")) for name, mass in masses.items() if "bar" in name and name[-1].isdigit())
    np.testing.assert_allclose(bars, 7850.0 * np.pi * 0.01**2 * length, rtol=1e-9)
    assert float(masses["platform"].get("value")) == 8.0


def test_a_leg_that_does_not_say_how_its_bars_hang_together_is_refused():
    with pytest.raises(ValueError, match="DeltaLeg does not say how its bars hang together"):
        js.export.to_urdf(LinearDelta.example())
