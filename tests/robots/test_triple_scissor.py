"""The Triple Scissor Extender against the physics engine, the quartic, the papers and closed forms."""

import dataclasses
import json
import math
import pathlib
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor.kinematics._jacobians import leg_jacobian
from jaxscissor.robots._contract import joints_by_leg, seen_by_legs
from jaxscissor.robots._over_legs import one_by_one
from tests.conftest import as_users, exhaustive
from tests.oracles import apices, continue_from_home, quartic_joints

INCH = 0.0254
LINKAGE = json.loads((pathlib.Path(__file__).parents[1] / "data" / "tse_linkage_poses.json").read_text())
CASES = [(case["design"], pose) for case in LINKAGE["sets"] for pose in case["poses"]]
PROTOTYPE = (0.2647, math.pi / 6, 0.0186, 0.11765)
DESIGNS = [
    PROTOTYPE,
    (0.45, 0.9, 0.15, 0.1),
    (0.15, -0.2, 0.12, 0.05),
    (0.37, 1.1, 0.27, 0.25),
    (0.35, 0.02, 0.2, 0.05),
    (0.5, -0.6, 0.1, 0.1),
]
solve = as_users(jax.vmap(js.inverse_kinematics, (None, 0)))
all_working_modes = jax.jit(jax.vmap(js.inverse_kinematics_all, (None, 0)))


def linkage_pose(pose):
    rotation = js.Rotation(*(js.Vec(*jnp.asarray(column)) for column in np.array(pose["rotation"]).T))
    return jnp.stack(js.SE3.coordinates(js.Vec(*jnp.asarray(pose["position"])), rotation))


def design_of(ratios):
    return js.TripleScissorExtender.from_ratios(*ratios)


@pytest.mark.parametrize(("design", "pose"), CASES)
def test_the_assembled_linkage_of_the_physics_engine_closes(design, pose):
    robot = js.TripleScissorExtender(**{**design, "link_lengths": jnp.array(design["link_lengths"])})
    joints, target = jnp.array(pose["joints"]), linkage_pose(pose)
    assert np.abs(js.residual(robot, target, joints=joints)).max() <= 1e-12
    inverse = js.inverse_kinematics(robot, target)
    assert bool(inverse.converged) and np.abs(inverse.value - joints).max() <= 1e-9
    forward = js.forward_kinematics(robot, joints)
    position, rotation = js.SE3.place(forward.value)
    assert bool(forward.converged)
    assert np.abs(position.array() - jnp.array(pose["position"])).max() <= 1e-9
    assert np.abs(rotation.array() - np.array(pose["rotation"])).max() <= 1e-9


@pytest.mark.parametrize(("radius", "golden"), [(9.2648, 16.01230939), (10.5228, 15.94165502)])
def test_golden_values_of_the_authors_robot(radius, golden):
    robot = js.TripleScissorExtender(jnp.array([18.0, 14.0, 11.0]), math.pi / 6, radius, 8.0, 2.125, 3.5231)
    assert np.abs(js.inverse_kinematics(robot, [0, 0, 48, 0, 0, 0]).value - golden).max() < 1e-8


@pytest.mark.parametrize("ratios", DESIGNS)
def test_every_pose_gets_the_verdict_of_the_quartic(ratios, random_poses):
    robot = design_of(ratios)
    poses = random_poses(robot, 20_000)
    solution = solve(robot, poses)
    home, none = np.ones(len(poses), bool), np.zeros(len(poses), bool)
    for i, apex in enumerate(apices(ratios, poses)):
        joints, real, u, determinant = quartic_joints(ratios, apex)
        label = real & (joints >= 0).all(axis=-1) & (determinant < 0) & (u > 0)
        assert label.sum(axis=1).max() <= 1, "the home mode is unique"
        expected = np.where(label[..., None], joints, 0).sum(axis=1)
        found = np.asarray(solution.value)[:, 2 * i : 2 * i + 2]
        reached = np.asarray(solution.converged)
        assert np.abs(found - expected)[reached].max() < 1e-9
        home &= label.any(axis=1)
        none |= ~real.any(axis=1)
    assert (np.asarray(solution.converged) == home).all()
    assert ((np.asarray(solution.status) == js.Status.NO_SOLUTION) == none).all()
    assert not np.isin(solution.status, [js.Status.MAX_STEPS, js.Status.NONFINITE]).any()
    assert np.asarray(solution.residual_norm)[home].max() < 1e-12


@pytest.mark.exhaustive
@pytest.mark.parametrize("ratios", [DESIGNS[0], *exhaustive(*DESIGNS[1:4])])
def test_home_is_what_continuation_from_home_reaches(ratios, random_poses):
    robot = design_of(ratios)
    pose, joints = robot.home()
    starts = [apex[:, 0] for apex in apices(ratios, pose[None])]
    poses = random_poses(robot, 60)
    solution = solve(robot, poses)
    targets = apices(ratios, poses)
    followed = 0
    for n in range(len(poses)):
        ends = [continue_from_home(ratios, starts[i], joints[2 * i : 2 * i + 2], targets[i][:, n]) for i in range(3)]
        if any(end is None or min(end) < 0 for end in ends):
            continue
        followed += 1
        assert bool(solution.converged[n])
        assert np.abs(np.concatenate(ends) - solution.value[n]).max() < 1e-8
    assert followed >= 5


@pytest.mark.parametrize("ratios", DESIGNS)
def test_all_working_modes_are_the_real_roots_of_the_quartic(ratios, random_poses):
    robot = design_of(ratios)
    poses = random_poses(robot, 2000)
    modes = all_working_modes(robot, poses)
    for i, apex in enumerate(apices(ratios, poses)):
        joints, real, _, _ = quartic_joints(ratios, apex)
        assert (np.asarray(modes.valid[:, i]).sum(axis=1) == real.sum(axis=1)).all()
        distance = np.abs(np.asarray(modes.values[:, i])[:, :, None] - joints[:, None]).max(axis=-1)
        distance = np.where(real[:, None, :], distance, np.inf).min(axis=-1)
        assert np.where(modes.valid[:, i], distance, 0).max() < 1e-7


@jax.jit
@partial(jax.vmap, in_axes=(None, 0, 0))
def solve_from(robot, pose, guess):
    """Inverse kinematics from a guess, and the legs' modes in the end and at first."""
    solution = js.inverse_kinematics(robot, pose, guess=guess)
    seen = seen_by_legs(robot, *js.SE3.place(pose))
    modes = [
        [leg.mode(q, one) for leg, q, one in one_by_one(robot.legs(), joints_by_leg(robot, joints), seen)]
        for joints in (solution.value, guess)
    ]
    return solution, *(jnp.stack(mode) for mode in modes)


def test_a_guess_chooses_the_working_mode_and_its_loss_is_told(prototype, rng):
    poses = prototype.home()[0][None] + jnp.asarray(rng.uniform(-0.1, 0.1, (500, 6)))
    solution, ended, begun = solve_from(prototype, poses, jnp.asarray(rng.uniform(-0.6, 0.8, (500, 6))))
    closed = np.asarray(solution.residual_norm < 1e-12)
    same = np.asarray(ended == begun).all(axis=1)
    assert (closed & same).sum() > 20 and (closed & ~same).sum() > 20
    assert (np.asarray(solution.converged) == same)[closed].all()


@pytest.mark.parametrize("eta", [0.0, 0.5, -0.5])
def test_degenerate_elimination_on_the_axis_and_on_aligned_slides(eta):
    robot = design_of((0.3, eta, 0.1, 0.1))
    for offset in (0.0, 1e-15, 1e-9, 1e-5):
        pose = robot.home()[0].at[1].add(offset)
        modes = js.inverse_kinematics_all(robot, pose)
        assert bool(js.inverse_kinematics(robot, pose).converged)
        cases = one_by_one(robot.legs(), seen_by_legs(robot, *js.SE3.place(pose)), modes.values, modes.valid)
        for leg, attachment, values, valid in cases:
            for joints in values[valid]:
                assert np.abs(jnp.stack(leg.residual(tuple(joints), attachment))).max() < 1e-12
        gradient = jax.jacfwd(lambda p: js.inverse_kinematics(robot, p).value)(pose)
        assert bool(jnp.all(jnp.isfinite(gradient)))
        assert bool(jnp.all(jnp.isfinite(jax.grad(lambda p: js.feasibility(robot, p).margin)(pose))))


def test_aligned_slides_have_closed_form_joints():
    """At eta = 0 the feet are level with the apex's foot on the slide, w apart: s = w/2 +- x."""
    robot = design_of((0.35, 0.0, 0.2, 0.05))
    pose = np.array([0.03, -0.05, 0.6, 0.2, -0.1, 0.3])
    solution = js.inverse_kinematics(robot, pose)
    for i, (x, y, z) in enumerate(apex[:, 0] for apex in apices((0.35, 0.0, 0.2, 0.05), pose[None])):
        half = 0.35 * math.sqrt(1 - (y**2 + z**2))
        assert np.abs(solution.value[2 * i : 2 * i + 2] - np.array([half + x, half - x])).max() < 1e-13
    assert np.asarray(js.inverse_kinematics_all(robot, pose).valid).sum(axis=1).min() >= 2


def test_a_guess_in_another_mode_is_kept_to(prototype):
    pose = jnp.array([0.1, 0.05, 1.0, 0.1, -0.2, 0.3])
    modes = js.inverse_kinematics_all(prototype, pose)
    home = js.inverse_kinematics(prototype, pose).value
    for choice in range(4):
        guess = modes.values[:, choice].ravel()
        solution = js.inverse_kinematics(prototype, pose, guess=guess + 1e-3)
        assert bool(solution.converged) and np.abs(solution.value - guess).max() < 1e-9
    assert np.abs(js.inverse_kinematics(prototype, pose, guess=home + 0.02).value - home).max() < 1e-9


def test_poses_that_cannot_be_reached_say_why(prototype):
    def status(pose):
        return js.Status(int(js.inverse_kinematics(prototype, pose).status))

    assert status([0, 0, 3.0, 0, 0, 0]) is js.Status.NO_SOLUTION
    assert status([0, 0, np.inf, 0, 0, 0]) is js.Status.NONFINITE
    assert status([0, 0, np.nan, 0, 0, 0]) is js.Status.NONFINITE
    assert status([0, 0, 1e200, 0, 0, 0]) is js.Status.NONFINITE
    assert status([0.7, 0.0, 0.9, 0, 0, 0]) is js.Status.OTHER_MODE
    assert float(js.feasibility(prototype, [0, 0, -0.5, 0, 0, 0]).margin) < 0, "inside the base"
    assert "proved" in js.Status.NO_SOLUTION.message
    with pytest.raises(RuntimeError, match="NO_SOLUTION"):
        js.inverse_kinematics(prototype, [0, 0, 3.0, 0, 0, 0]).raise_if_failed()


def test_feet_wider_apart_than_the_scissor_are_proved_impossible(prototype):
    wide = js.forward_kinematics(prototype, jnp.full(6, 0.6))
    assert wide.status == js.Status.NO_SOLUTION
    assert js.forward_kinematics(prototype, jnp.full(6, jnp.nan)).status == js.Status.NONFINITE


def test_symmetry_turning_pose_and_joints_together(prototype, random_poses):
    poses = random_poses(prototype, 200)
    third = 2 * math.pi / 3
    position, rotation = jax.vmap(js.SE3.place)(poses)
    c, s = math.cos(third), math.sin(third)
    turn = js.Rotation(js.Vec(c, s, 0.0), js.Vec(-s, c, 0.0), js.Vec(0.0, 0.0, 1.0))
    undo = js.Rotation(js.Vec(c, -s, 0.0), js.Vec(s, c, 0.0), js.Vec(0.0, 0.0, 1.0))
    columns = [turn @ (rotation @ column) for column in undo.columns]
    turned = jnp.stack(js.SE3.coordinates(turn @ position, js.Rotation(*columns)), axis=-1)
    before, after = solve(prototype, poses), solve(prototype, turned)
    assert (before.status == after.status).all()
    ok = np.asarray(before.converged)
    assert np.abs(np.roll(before.value, 2, axis=1) - after.value)[ok].max() < 1e-11


def test_scale_invariance(prototype, random_poses):
    poses = random_poses(prototype, 100)
    scale = 39.37
    lengths = {f.name: getattr(prototype, f.name) * scale for f in dataclasses.fields(prototype)}
    for angle in ("actuator_angle", "scissor_angle", "azimuths"):
        lengths[angle] = getattr(prototype, angle)
    large = js.TripleScissorExtender(**lengths)
    scaled = poses * jnp.array([[scale] * 3 + [1.0] * 3])
    a, b = solve(prototype, poses), solve(large, scaled)
    assert (a.status == b.status).all()
    assert np.abs(a.value * scale - b.value).max() < 1e-10
    margins = [
        jax.vmap(lambda p, r=r: js.feasibility(r, p).margin)(p) for r, p in ((prototype, poses), (large, scaled))
    ]
    assert np.abs(margins[0] - margins[1]).max() < 1e-11


def test_the_conventions_of_icra16_are_reachable():
    """Half the distance d of adjacent parallel slides, and apices numbered clockwise [ICRA16 eqs. 4, 26]."""
    d, third = 0.04, 2 * math.pi / 3
    robot = js.TripleScissorExtender.from_ratios(
        0.2647, math.pi / 6, 2 * d / math.sqrt(3), 0.1, azimuths=(0.0, -third, third)
    )
    (first,), (second,), _ = one_by_one(robot.legs())
    along = np.asarray(first.slide_a.array())
    assert np.abs(along - second.slide_b.array()).max() < 1e-15, "adjacent slides are parallel"
    between = np.asarray((second.origin - first.origin).array())
    assert np.linalg.norm(np.cross(between, along)) == pytest.approx(2 * d, rel=1e-12)
    apices_icra = [np.asarray(a.array()) for a in robot.attachments(*js.SE3.place(jnp.zeros(6)))]
    n, t = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    expected = [0.1 * n, -0.1 * (math.sqrt(3) / 2 * t + n / 2), 0.1 * (math.sqrt(3) / 2 * t - n / 2)]
    assert np.abs(np.stack(apices_icra) - np.stack(expected)).max() < 1e-15
    counter = js.TripleScissorExtender.from_ratios(0.2647, math.pi / 6, 2 * d / math.sqrt(3), 0.1)
    pose = jnp.array([0.05, 0.02, 0.7, 0.1, -0.2, 0.3])
    ours, theirs = (js.inverse_kinematics(r, pose).value.reshape(3, 2) for r in (counter, robot))
    assert np.abs(ours[jnp.array([0, 2, 1])] - theirs).max() < 1e-12


def test_ratios_layouts_and_named_robots():
    robot = design_of(DESIGNS[1])
    assert np.abs(robot.ratios - np.array(DESIGNS[1])).max() < 1e-15
    assert js.SLIDE_ANGLES == {
        "delta": math.pi / 6, "triangle": 0.0, "star": math.pi / 3, "hexagonal": -math.pi / 6
    }  # fmt: skip
    prototype = js.TripleScissorExtender.prototype()
    assert (
        float(prototype.length) == pytest.approx(1.727) and np.abs(prototype.ratios - np.array(PROTOTYPE)).max() < 1e-15
    )
    laboratory = js.TripleScissorExtender.laboratory()
    assert float(laboratory.length) == pytest.approx(68 * INCH)
    assert np.abs(laboratory.stroke / INCH - np.array([8.6, 20.6])).max() < 1e-12
    rigid = js.TripleScissorExtender.from_ratios(1.0, 0.0, 0.1, 0.1)
    leg_length = js.inverse_kinematics(rigid, [0.05, 0, 0.8, 0, 0, 0]).value
    apex = np.array([0.15, 0.0, 0.8])
    foot = np.array([0.1, 0.0, 0.0]) + float(leg_length[0]) * np.array([0.0, -1.0, 0.0])
    assert np.linalg.norm(apex - foot) == pytest.approx(1.0, abs=1e-12), "k1 = 1 is a hexapod with rigid legs"


def test_the_closure_is_that_of_the_papers(prototype, random_poses):
    """[RAL17 eqs. 10, 13] and, at eta = 30 deg, [ICRA16 eqs. 13, 17], evaluated as printed."""
    poses = random_poses(prototype, 50)
    length, first = 1.727, 0.2647 * 1.727
    solution = solve(prototype, poses)
    scaled = np.asarray(poses) / np.array([length] * 3 + [1.0] * 3)
    for i, apex in enumerate(apices(PROTOTYPE, scaled)):
        x, y, z = apex * length
        a, b = np.asarray(solution.value)[:, 2 * i : 2 * i + 2].T
        c, s = math.cos(math.pi / 6), math.sin(math.pi / 6)
        eq10 = (a * c - x) ** 2 + (a * s - y) ** 2 - (-b * c - x) ** 2 - (b * s - y) ** 2
        width2 = (a * c + b * c) ** 2 + (a * s - b * s) ** 2
        ratio = (1 - (length / first) ** 2) / 4
        eq13 = (a * c - x) ** 2 + (a * s - y) ** 2 + z**2 - length**2 - ratio * width2
        icra13 = a**2 - math.sqrt(3) * (a + b) * x - b**2 - (a - b) * y
        icra17 = x**2 + y**2 + z**2 - length**2 + a**2 - a * (math.sqrt(3) * x + y) - ratio * (a**2 + a * b + b**2)
        ok = np.asarray(solution.converged)
        for equation in (eq10, eq13, icra13, icra17):
            assert np.abs(equation[ok]).max() < 1e-12


def test_icra_jacobian_at_the_centre_and_its_block_form(prototype):
    """[ICRA16 eqs. 21-33], with c = (1 - (L/l0)^2)/4 and a rotation per leg (see the conventions)."""
    pose, joints = prototype.home()
    slide, height = float(joints[0]), float(pose[2])
    reach = float(prototype.top_radius - prototype.actuator_radius)
    c = (1 - (1 / 0.2647) ** 2) / 4
    across = math.sqrt(3) * slide / (2 * slide - reach)
    below = 6 * c * slide - 2 * slide + reach
    eq26 = np.array([
        [across, (2 * reach - slide) / below, 2 * height / below],
        [-across, (2 * reach - slide) / below, 2 * height / below],
    ])  # fmt: skip
    rows = []
    seen = seen_by_legs(prototype, *js.SE3.place(pose))
    for i, (leg, attachment) in enumerate(one_by_one(prototype.legs(), seen)):
        azimuth = 2 * math.pi * i / 3
        outward, up = np.array([math.cos(azimuth), math.sin(azimuth), 0]), np.array([0, 0, 1])
        local = np.stack([[math.sin(azimuth), -math.cos(azimuth), 0], outward, up])
        regular, scissor = leg_jacobian(leg, attachment, tuple(joints[2 * i : 2 * i + 2]))
        assert bool(regular)
        assert np.abs(scissor - eq26 @ local).max() < 1e-12
        corner = float(prototype.top_radius) * outward
        rows.append(np.asarray(scissor) @ np.hstack([np.eye(3), np.cross(np.eye(3), corner).T]))
    assert np.abs(js.inverse_jacobian(prototype, pose, rates="twist") - np.vstack(rows)).max() < 1e-12


def test_corrected_coefficients_of_the_singularity_condition(prototype):
    """[RAL17 eqs. 16-18]: a21 and a22 with (1 - (L/l0)^2)/4; the printed factor does not differentiate eq. 13."""
    pose = jnp.array([0.1, 0.05, 1.0, 0.1, -0.2, 0.3])
    joints = js.inverse_kinematics(prototype, pose).value
    _, by_joints = js.closure_jacobians(prototype, pose, joints=joints)
    x, y, _ = apices(PROTOTYPE, np.asarray(pose)[None] / np.array([1.727] * 3 + [1.0] * 3))[0][:, 0] * 1.727
    a, b = map(float, joints[:2])
    c, s, ratio = math.cos(math.pi / 6), math.sin(math.pi / 6), (1 - (1 / 0.2647) ** 2) / 4
    a11, a12 = -a + x * c + y * s, b + x * c - y * s
    a21, a22 = a11 + ratio * (a + b * math.cos(math.pi / 3)), ratio * (b + a * math.cos(math.pi / 3))
    ours = np.asarray(by_joints)[:2, :2] * 1.727**2
    determinant = np.linalg.det(ours)
    # eq. 13 is written from A alone, ours from the middle: they differ by half of eq. 10
    assert determinant == pytest.approx(2 * (a11 * a22 - a12 * a21), rel=1e-10) or determinant == pytest.approx(
        -2 * (a11 * a22 - a12 * a21), rel=1e-10
    )


def test_motion_patterns_of_the_papers(prototype):
    """[RAL17 fig. 1, ICRA16 fig. 4] at home: slides moved by a pattern, the platform's twist by its sign."""
    pose, _ = prototype.home()
    forward = np.linalg.inv(js.inverse_jacobian(prototype, pose, rates="twist"))

    def twist(pattern):
        return forward @ np.array(pattern, float)

    up = twist([-1] * 6)
    assert up[2] > 0 and np.abs(np.delete(up, 2)).max() < 1e-12, "all slides inward is up, and nothing else"
    yaw = twist([1, -1] * 3)
    assert abs(yaw[5]) > 0.1 and np.abs(np.delete(yaw, 5)).max() < 1e-12, "alternating slides is yaw"
    tilt = twist([-1, -1, 0, 0, 0, 0])
    corner = np.cross(tilt[3:], [float(prototype.top_radius), 0, 0])[2] + tilt[2]
    assert corner > 0 and abs(tilt[4]) > 0.1 and abs(tilt[5]) < 1e-12, "one scissor inward lifts its corner"
    shift = twist([0, 0, -1, 1, 1, -1])
    assert np.hypot(*shift[:2]) > 0.1 and abs(shift[2]) < 1e-12, "opposite pairs shift sideways"


def test_height_amplification_is_one_over_k1_where_it_is_constant():
    """With equal radii and aligned slides the apex rises over its own slides: sigma_z ~ L / l0 exactly."""
    heights = jnp.array([0.3, 0.6, 0.9])
    rigid = design_of((1.0, 0.0, 0.1, 0.1))
    for k1 in (0.2, 0.5):
        assert np.abs(js.height_amplification(design_of((k1, 0.0, 0.1, 0.1)), rigid, heights) - 1 / k1).max() < 1e-12
    ratio = js.height_amplification(design_of(PROTOTYPE), design_of((1.0, *PROTOTYPE[1:])), heights)
    assert np.ptp(ratio) > 1e-3 and np.abs(ratio - 3.3).max() < 0.02, "not constant, and not the printed 11.487"


def test_leg_dimensions_can_be_changed_one_by_one(prototype):
    """Calibration works on the legs: a longer bar in leg 2 moves its own slides only."""
    pose = jnp.array([0.1, 0.05, 1.0, 0.1, -0.2, 0.3])
    _, (second,), _ = one_by_one(prototype.legs())

    def joints(length):
        leg = dataclasses.replace(second, base_link=length)
        return jnp.stack(leg.start(prototype.attachments(*js.SE3.place(pose))[1])[0])

    nominal = second.base_link
    assert np.abs(joints(nominal) - js.inverse_kinematics(prototype, pose).value[2:4]).max() < 1e-6
    assert np.abs(joints(nominal * 1.01) - joints(nominal)).max() > 1e-3


BAD = [
    (dict(link_lengths=[0.5, -0.1]), "half-bar must be positive"),
    (dict(link_lengths=[0.0, 0.1]), "half-bar must be positive"),
    (dict(link_lengths=[[0.5]]), "one row"),
    (dict(actuator_angle=1.6), "90 deg"),
    (dict(actuator_angle=[0.1]), "actuator_angle of shape"),
    (dict(actuator_radius=-0.1), "length >= 0"),
    (dict(top_radius=0.0), "positive length"),
    (dict(top_offset=math.nan), "finite"),
    (dict(stroke=(0.3, 0.1)), "least < greatest"),
    (dict(stroke=(-0.3, 0.1)), "0 <= least"),
    (dict(scissor_angle=(0.5, 0.2)), "least < greatest"),
    (dict(scissor_angle=(10.0, 70.0)), "radians"),
    (dict(stroke=(5.0, 6.0)), "No level pose"),
    (dict(top_radius=3.0), "No level pose"),
]


@pytest.mark.parametrize(("change", "message"), BAD)
def test_impossible_geometry_is_refused_with_the_reason(change, message):
    good = dict(link_lengths=[0.5, 0.4], actuator_angle=0.5, actuator_radius=0.1, top_radius=0.2)
    js.TripleScissorExtender(**good)
    with pytest.raises(ValueError, match=message):
        js.TripleScissorExtender(**{**good, **change})


def test_more_bad_input():
    with pytest.raises(ValueError, match="l0 <= L"):
        js.TripleScissorExtender.from_ratios(1.2, 0.1, 0.1, 0.1)
    with pytest.raises(ValueError, match="expected 'rpy' or 'twist'"):
        js.inverse_jacobian(js.TripleScissorExtender.prototype(), np.zeros(6), rates="euler")
    whole = js.TripleScissorExtender([18, 14, 11], 0, 2, 8, stroke=(5, 20))
    assert whole.link_lengths.dtype == jnp.result_type(float)


def test_a_robot_of_negative_gradients_is_no_bad_input(prototype):
    gradient = jax.grad(lambda r: js.inverse_kinematics(r, r.home()[0] * 0.9).value.sum())(prototype)
    assert isinstance(gradient, js.TripleScissorExtender)
    flipped = jax.tree.map(lambda leaf: -jnp.abs(leaf) - 1, gradient)
    assert float(flipped.top_radius) < 0 and "top_radius" in repr(flipped)


def test_a_robot_can_be_built_inside_a_compiled_function(prototype):
    def height(radius):
        inner = dataclasses.replace(prototype, top_radius=radius)
        outer = js.TripleScissorExtender.prototype()
        return inner.home()[0][2] + outer.home()[0][2] + js.Scissor(prototype.link_lengths).length

    assert float(jax.jit(height)(prototype.top_radius)) == pytest.approx(float(height(prototype.top_radius)))
    assert float(jax.jit(lambda: dataclasses.replace(prototype).home()[0][2])()) > 1


def test_derivatives_are_finite_on_the_boundary_to_the_last_bit(prototype):
    """On a fold the Jacobian of a leg is zero to rounding, and may be so in one place of a program only."""

    def margin(radius, height):
        return js.feasibility(prototype, jnp.stack([radius, radius / 3, height, *jnp.zeros(3)])).margin

    heights = jnp.linspace(0.4, 1.5, 20_000)
    margins, slopes = (jax.jit(jax.vmap(f)) for f in (margin, jax.grad(margin)))
    low, high = jnp.zeros_like(heights), jnp.ones_like(heights)
    for _ in range(55):
        middle = (low + high) / 2
        inside = margins(middle, heights) >= 0
        low, high = jnp.where(inside, middle, low), jnp.where(inside, high, middle)
    for radius in (low, high, jnp.nextafter(low, low - 1), jnp.nextafter(high, high + 1)):
        assert jnp.isfinite(slopes(radius, heights)).all()


def test_ratios_have_derivatives_up_to_rigid_legs():
    def margin(k1):
        robot = js.TripleScissorExtender.from_ratios(k1, 0.5, 0.02, 0.1)
        return js.feasibility(robot, jnp.array([0.2, 0.1, 0.6, 0.1, 0.0, 0.2])).margin

    slope, step = jax.grad(margin)(1.0), 1e-6
    margins = jax.vmap(margin)(1.0 - step * jnp.arange(3.0))
    assert slope == pytest.approx(float(3 * margins[0] - 4 * margins[1] + margins[2]) / (2 * step), rel=1e-6)
