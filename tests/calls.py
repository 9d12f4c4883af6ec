"""One call of every public function that computes with a robot, for laws that hold for all of them."""

from functools import partial

import jax
import numpy as np

import jaxscissor as js
from jaxscissor.robots._contract import angular_joints


def margin(robot, pose):
    return js.feasibility(robot, pose).margin


def first(robot, pose):
    return pose[0]


def parabola(x):
    return (x - 2.0) ** 2


def other_parabola(x):
    return x**2


def calls_of(robot):
    """Name -> call; what a robot refuses, such as heights in the plane, is left out."""
    home, _ = robot.home()
    d, linear = robot.space.dimension, robot.space.translations
    unit = np.where(np.arange(d) < linear, float(robot.length), 1)
    pose = np.asarray(home) + unit / 64
    if robot.dependent:
        pose = np.asarray(js.constrained_pose(robot, pose).value)
    frame = js.frame(robot, pose)
    joints = js.inverse_kinematics(robot, pose).value  # at home assembly modes are as near as each other
    actuated, along = np.asarray(robot.actuated(joints)), np.eye(d)[linear - 1]
    reach = unit / 8
    low, high = np.asarray(home) - reach, np.asarray(home) + reach
    box = js.Box(low, high)
    cube, plane = (js.Box(*(np.where(np.arange(d) < k, end, home) for end in (low, high))) for k in (3, 2))
    sample, key, made = box.quasi_random(100), jax.random.key(0), js.design.tolerances(robot)
    poses = np.asarray(sample[:])
    modes = js.forward_kinematics_all(robot, actuated, starts=64)
    two, size = np.stack([pose, pose + unit / 128]), float(robot.length)
    rows, near = np.tile(actuated, (4, 1)), np.asarray(home) + unit * 1e-3 * np.sin(np.arange(4.0))[:, None]
    angular = np.asarray(robot.actuated(np.array(angular_joints(robot))))
    lever, load = np.where(angular, size, 1.0), js.statics.Load(payload=1.0)
    springs = {"actuator_stiffness": 1e3 * lever**2 / size, "load": load}
    bar = js.statics.Section.rectangle(js.statics.Material.aluminum(), depth=0.03, width=0.006)
    known = {"offsets": np.where(angular, 1e-3, 1e-3 * size), "sigma": 1e-4 * unit}
    found = {
        "check_robot": partial(js.check_robot, robot, poses=16),
        "residual": partial(js.residual, robot, pose, joints=joints),
        "inverse_kinematics": partial(js.inverse_kinematics, robot, pose),
        "forward_kinematics": partial(js.forward_kinematics, robot, actuated),
        "forward_kinematics_all": partial(js.forward_kinematics_all, robot, actuated, starts=64),
        "within_limits": partial(js.within_limits, robot, modes),
        "closure_jacobians": partial(js.closure_jacobians, robot, pose, joints=joints),
        "inverse_jacobian": partial(js.inverse_jacobian, robot, pose),
        "gear_ratios": partial(js.gear_ratios, robot, pose),
        "feasibility": partial(js.feasibility, robot, pose),
        "margins": partial(js.margins, robot, pose),
        "constrained_pose": partial(js.constrained_pose, robot, pose),
        "frame": partial(js.frame, robot, pose),
        "pose": partial(js.pose, robot, frame.position, matrix=frame.matrix),
        "singularities.measures": partial(js.singularities.measures, robot, pose),
        "workspace.reach_along": partial(js.workspace.reach_along, robot, pose, along, cells=8),
        "workspace.joint_range": partial(js.workspace.joint_range, robot, box, samples=16, starts=2),
        "worst_over a region": partial(js.workspace.worst_over, robot, first, box, samples=16, starts=2, steps=4),
        "workspace.map": partial(js.workspace.map, js.inverse_jacobian, robot, sample),
        "workspace.worst_over": partial(js.workspace.worst_over, robot, margin, sample),
        "workspace.mean_over": partial(js.workspace.mean_over, robot, margin, sample),
        "design.task_metrics": partial(js.design.task_metrics, robot, poses),
        "workspace.fraction": partial(js.workspace.fraction, robot, sample),
        "workspace.soft_fraction": partial(js.workspace.soft_fraction, robot, sample),
        "workspace.soft_gradient": partial(js.workspace.soft_gradient, robot, sample),
        "its gradient": partial(jax.grad(js.workspace.soft_fraction), robot, sample),
        "workspace.ray_fraction": partial(js.workspace.ray_fraction, robot, box, rays=16, cells=8),
        "workspace.limiting_constraints": partial(js.workspace.limiting_constraints, robot, sample),
        "design.tolerances": partial(js.design.tolerances, robot),
        "design.pose_sensitivity": partial(js.design.pose_sensitivity, robot, pose),
        "design.pose_error": partial(js.design.pose_error, robot, pose, made),
        "design.sample_pose_errors": partial(js.design.sample_pose_errors, robot, pose, made, key, 8),
        "statics.actuator_forces": partial(js.statics.actuator_forces, robot, pose, load=load),
        "statics.payload": partial(js.statics.payload, robot, pose, force_limit=100 * lever),
        "statics.stiffness": partial(js.statics.stiffness, robot, pose, **springs),
        "statics.sag": partial(js.statics.sag, robot, pose, **springs),
        "statics.mass": partial(js.statics.mass, robot, section=bar),
        "motion.follow": partial(js.motion.follow, robot, two),
        "motion.track": partial(js.motion.track, robot, rows[:2]),
        "motion.jog": partial(js.motion.jog, robot, pose, np.tile(unit / 1024, (2, 1))),
        "motion.straight_line": partial(js.motion.straight_line, robot, *two, samples=4),
        "motion.via_points": partial(js.motion.via_points, robot, two, samples=4),
        "calibration.identify": partial(js.calibration.identify, robot, rows, near, **known),
        "calibration.identifiability": partial(js.calibration.identifiability, robot, rows, **known),
        "calibration.next_poses": partial(js.calibration.next_poses, robot, poses[:8], count=2, **known),
        "per_leg": lambda: js.per_leg(robot).home(),
        "design.optimize": partial(js.design.optimize, parabola, 0.5, bounds=(0.0, 1.0), steps=3, starts=2),
        "design.pareto_front": partial(
            js.design.pareto_front, [parabola, other_parabola], 0.3, bounds=(-2.0, 2.0), steps=3, designs=4
        ),
        "design.optimize_variants": partial(
            js.design.optimize_variants, parabola, {"a": {}}, params=0.5, bounds=(0.0, 1.0), steps=3
        ),
    }
    if not robot.dependent:
        force, speed = 100 * lever, size / lever
        found["statics.force_capability"] = partial(js.statics.force_capability, robot, pose, force_limit=force)
        found["statics.velocity_capability"] = partial(js.statics.velocity_capability, robot, pose, speed_limit=speed)
    found["singularities.distance"] = partial(js.singularities.distance, robot, pose, directions=64, steps=4)
    found["distance along a direction"] = partial(js.singularities.distance, robot, pose, direction=along)
    if d > 2:
        found["singularities.surface"] = partial(js.singularities.surface, robot, cube, (2, 2, 2))
    if "z" in robot.space.names:
        found["calibration.heights"] = partial(js.calibration.heights, robot, pose)
        found["workspace.height_range"] = partial(js.workspace.height_range, robot)
        found["height_amplification"] = partial(js.height_amplification, robot, robot, np.asarray(home)[2:3])
    if type(robot.legs()).solutions is not js.Leg.solutions:
        found["inverse_kinematics_all"] = partial(js.inverse_kinematics_all, robot, pose)
    if type(robot.legs()).connections is not js.Leg.connections:
        found["statics.bar_forces"] = partial(js.statics.bar_forces, robot, pose, load=load)
    if isinstance(robot, js.NavaroII):
        found["navaro.identify_assembly"] = partial(js.navaro.identify_assembly, robot, joints)
        found["navaro.swept_area"] = partial(js.navaro.swept_area, robot, poses)
        found["singularities.aspects"] = partial(js.singularities.aspects, robot, plane, (4, 4, 1))
        parts = js.singularities.aspects(robot, plane, (4, 4, 1))
        found["singularities.aspect_path"] = partial(js.singularities.aspect_path, robot, parts, pose, pose)
        found["singularities.cuspidal_search"] = partial(js.singularities.cuspidal_search, robot, parts, tries=8)
        found["singularities.plan_modes"] = partial(
            js.singularities.plan_modes, {8: robot}, np.stack([home, pose]), min_type2=1e-3
        )
    return found
