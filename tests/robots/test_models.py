"""Robots from model files: against the robots that were written to them, and against MuJoCo."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from tests.conftest import exhaustive

mujoco = pytest.importorskip("mujoco")
THIRDS = 2 * np.pi / 3 * np.arange(3)
STEP = 1e-6


def around(radius, angle, height=0.0):
    return np.array([radius * np.cos(angle), radius * np.sin(angle), height])


def text(numbers):
    return " ".join(repr(float(number)) for number in numbers)


def delta_text():
    """A delta with parallelograms: two rods between balls on each crank, which also can spin, and a hanging hook."""
    bodies, loops, motors = "", "", ""
    for i, angle in enumerate(THIRDS):
        side = np.cross([0, 0, 1.0], around(1, angle))
        crank, knee = around(0.2, angle), around(0.15, angle, -0.1)
        rods = ""
        for k, sign in enumerate((1, -1)):
            elbow = knee + 0.04 * sign * side
            end = around(0.05, angle, -0.45) + 0.04 * sign * side - crank - elbow
            rods += f'<body name="rod{i}{k}" pos="{text(elbow)}"><joint name="ball{i}{k}" type="ball"/></body>'
            loops += f'<connect name="tip{i}{k}" body1="rod{i}{k}" body2="platform" anchor="{text(end)}"/>'
        hook = '<body name="hook"><joint name="loose"/></body>' if i == 0 else ""
        bodies += (
            f'<body name="crank{i}" pos="{text(crank)}"><joint name="motor{i}" axis="{text(side)}"/>{rods}{hook}</body>'
        )
        motors += f'<motor joint="motor{i}"/>'
    platform = '<body name="platform" pos="0 0 -0.45"><freejoint/></body>'
    return model_text(bodies + platform, loops, f"<actuator>{motors}</actuator>")


def gripper_text(offset=0):
    """Two four-bars whose cranks a gear joins; the motor is on one side and the platform on the other."""
    bodies, loops = "", ""
    for name, x, sign in (("left", -0.1, -1), ("right", 0.1, 1)):
        rod = f'<body name="{name}_coupler" pos="{sign * 0.02} 0 0.05"><joint name="{name}_pin" axis="0 1 0"/></body>'
        bodies += (
            f'<body name="{name}_crank" pos="{x} 0 0"><joint name="{name}_motor" axis="0 1 0" ref="0.2"/>{rod}</body>'
        )
        bodies += (
            f'<body name="{name}_rocker" pos="{x - sign * 0.03} 0 0.01"><joint name="{name}_rock" axis="0 1 0"/></body>'
        )
        place = np.array([x + sign * 0.01, 0, 0.09]) - [x - sign * 0.03, 0, 0.01]
        loops += f'<connect name="{name}_tip" body1="{name}_rocker" body2="{name}_coupler" anchor="{text(place)}"/>'
    loops += f'<joint name="gear" joint1="right_motor" joint2="left_motor" polycoef="{offset} -1 0.3 0 0"/>'
    return model_text(bodies, loops)


def model_text(bodies, loops, more=""):
    inertia = '<inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>'
    bodies = bodies.replace("><joint", f">{inertia}<joint").replace("><freejoint", f">{inertia}<freejoint")
    return (
        f'<mujoco><compiler angle="radian"/><worldbody>{bodies}</worldbody><equality>{loops}</equality>{more}</mujoco>'
    )


def load(tmp_path, text, **named):
    path = tmp_path / "model.xml"
    path.write_text(text)
    return js.robots.from_mjcf(path, **named)


def settled(model, values, platform):
    """Where MuJoCo puts the platform with some joints held, its loops closed by steps of Gauss and Newton."""
    data = mujoco.MjData(model)
    held = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in values]
    data.qpos[model.jnt_qposadr[held]] = list(values.values())
    free = np.setdiff1d(np.arange(model.nv), model.jnt_dofadr[held])
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    for _ in range(30):
        mujoco.mj_fwdPosition(model, data)
        step = np.zeros(model.nv)
        step[free] = -np.linalg.lstsq(data.efc_J.reshape(-1, model.nv)[:, free], data.efc_pos, rcond=1e-8)[0]
        mujoco.mj_integratePos(model, data.qpos, step, 1.0)
    assert np.abs(data.efc_pos).max() < 1e-12
    return data.body(platform).xpos.copy(), data.body(platform).xmat.reshape(3, 3).copy()


@pytest.mark.parametrize("build", [js.robots.FiveBar, *exhaustive(js.robots.RotaryDelta, js.robots.ThreePRS)])
def test_an_exported_robot_comes_back(build, tmp_path, rng):
    given = build.prototype()
    home = given.home()[0]
    names = [f"q{i}" for i in range(sum(map(sum, given.actuation())))]
    robot = load(tmp_path, js.export.to_mjcf(given), platform="platform", actuated=names)
    assert robot.space.names == given.space.names and set(robot.dependent) == set(given.dependent)
    assert sorted(robot.actuated_names) == names
    poses = home[None] + 0.05 * given.length * jnp.asarray(rng.uniform(-1, 1, (20, len(home))))
    poses = jax.vmap(js.constrained_pose, (None, 0))(given, poses).value
    solve = jax.vmap(js.inverse_kinematics, (None, 0))
    ours, theirs = jax.jit(solve)(robot, poses), jax.jit(solve)(given, poses)
    assert ours.converged.all()
    np.testing.assert_allclose(robot.actuated(ours.value), given.actuated(theirs.value), atol=1e-11)
    js.export.save(robot, tmp_path / "robot.json")
    again = js.export.load(tmp_path / "robot.json")
    assert jax.tree.structure(again) == jax.tree.structure(robot)
    assert all(map(np.array_equal, jax.tree.leaves(again), jax.tree.leaves(robot)))


@pytest.mark.exhaustive
def test_a_delta_with_parallelograms_moves_as_in_mujoco(tmp_path, rng):
    robot = load(tmp_path, delta_text(), platform="platform")
    assert robot.space.names == ("x", "y", "z") and robot.actuated_names == ("motor0", "motor1", "motor2")
    assert len(robot.joint_names) == 15 and "loose" not in robot.joint_names  # of each ball the spin is idle
    model = mujoco.MjModel.from_xml_string(delta_text())
    forward = jax.jit(js.forward_kinematics)
    for turns in rng.uniform(-0.3, 0.3, (5, 3)):
        found = forward(robot, jnp.asarray(turns))
        place, frame = settled(model, dict(zip(robot.actuated_names, turns, strict=True)), "platform")
        assert found.converged
        np.testing.assert_allclose(found.value, place, atol=1e-10)
        np.testing.assert_allclose(frame, np.eye(3), atol=1e-10)
        back = js.inverse_kinematics(robot, found.value)
        np.testing.assert_allclose(robot.actuated(back.value), turns, atol=1e-10)


def test_gears_and_loops_within_a_leg_move_as_in_mujoco(tmp_path):
    text = gripper_text(0.05)  # which is not closed as the file has it
    robot = load(tmp_path, text, platform="right_coupler", actuated=["left_motor"])
    assert len(robot.dependent) == 5
    model = mujoco.MjModel.from_xml_string(text)
    for turn in (0.1, 0.3, 0.5):
        found = js.forward_kinematics(robot, [turn])
        place, frame = settled(model, {"left_motor": turn}, "right_coupler")
        assert found.converged
        np.testing.assert_allclose(found.value[:3], place, atol=1e-10)
        np.testing.assert_allclose(js.frame(robot, found.value).matrix, frame, atol=1e-10)


@pytest.mark.exhaustive
def test_derivatives_by_a_body_are_those_of_mujoco(tmp_path):
    robot, turns = load(tmp_path, delta_text(), platform="platform"), jnp.array([0.1, -0.1, 0.2])

    def place(x):
        moved = {**robot.bodies, "rod00": robot.bodies["rod00"] + x, "rod01": robot.bodies["rod01"] + x}
        return js.forward_kinematics(js.robots.FromModel(**(vars(robot) | {"bodies": moved})), turns).value

    slope, ends = jax.jit(jax.jacfwd(place))(jnp.zeros(3)), []
    for sign in (1, -1):
        model = mujoco.MjModel.from_xml_string(delta_text())
        for name in ("rod00", "rod01"):
            model.body(name).pos += sign * STEP * np.array([0.3, -0.5, 0.7])
        ends.append(settled(model, dict(zip(robot.actuated_names, np.asarray(turns), strict=True)), "platform")[0])
    np.testing.assert_allclose(slope @ jnp.array([0.3, -0.5, 0.7]), (ends[0] - ends[1]) / (2 * STEP), atol=1e-8)


TENDON = "<tendon><fixed name='cable'><joint joint='motor0' coef='1'/></fixed></tendon>"


@pytest.mark.parametrize(
    ("change", "named", "said"),
    [
        (lambda text: text, {"platform": "plattform"}, "no body"),
        (lambda text: text, {"platform": "platform", "actuated": ["ball00"]}, "as actuated"),
        (lambda text: text, {"platform": "platform", "base": "platform"}, "no joint moves"),
        (
            lambda text: text.replace("<equality>", "<include file='x'/><equality>"),
            {"platform": "platform"},
            "includes",
        ),
        (
            lambda text: text.replace("<equality>", TENDON + "<equality><tendon name='rope' tendon1='cable'/>"),
            {"platform": "platform"},
            "rope",
        ),
    ],
)
def test_what_cannot_be_expressed_is_refused_by_name(change, named, said, tmp_path):
    with pytest.raises(ValueError, match=said):
        load(tmp_path, change(delta_text()), **named)


def test_a_singular_home_is_refused(tmp_path):
    """Two links in one line: by first order they would hold the platform where it is."""
    links = (
        '<body name="a"><joint axis="0 0 1" name="qa"/><body name="b" pos="1 0 0"><joint axis="0 0 1"/></body></body>'
    )
    top = '<body name="top" pos="2 0 0"><freejoint/></body>'
    loops = '<connect body1="b" body2="top" anchor="1 0 0"/>'
    with pytest.raises(ValueError, match="singular"):
        load(tmp_path, model_text(links + top, loops), platform="top", actuated=["qa"])
