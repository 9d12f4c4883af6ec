"""One call of every public function that computes with a robot, for laws that hold for all of them."""

from functools import partial

import jax
import numpy as np

import jaxscissor as js


def margin(robot, pose):
    return js.feasibility(robot, pose).margin


def first(pose):
    return pose[0]


def parabola(x):
    return (x - 2.0) ** 2


def other_parabola(x):
    return x**2


def calls_of(robot):
    """Name -> call; what a robot refuses, such as heights in the plane, is left out."""
    home, joints = robot.home()
    d, linear = robot.space.dimension, robot.space.translations
    unit = np.where(np.arange(d) < linear, float(robot.length), 1)
    pose = np.asarray(home) + unit / 64
    if robot.dependent:
        pose = np.asarray(js.constrained_pose(robot, pose).value)
    actuated, along = np.asarray(robot.actuated(joints)), np.eye(d)[linear - 1]
    reach = unit / 8
    low, high = np.asarray(home) - reach, np.asarray(home) + reach
    box = js.Box(low, high)
    cube, plane = (js.Box(*(np.where(np.arange(d) < k, end, home) for end in (low, high))) for k in (3, 2))
    sample, key, made = box.quasi_random(100), jax.random.key(0), js.tolerances(robot)
    poses = np.asarray(sample[:])
    modes = js.forward_kinematics_all(robot, actuated, starts=64)
    found = {
        "check_robot": partial(js.check_robot, robot, poses=16),
        "residual": partial(js.residual, robot, joints, pose),
        "inverse_kinematics": partial(js.inverse_kinematics, robot, pose),
        "forward_kinematics": partial(js.forward_kinematics, robot, actuated),
        "forward_kinematics_all": partial(js.forward_kinematics_all, robot, actuated, starts=64),
        "within_limits": partial(js.within_limits, robot, modes),
        "closure_jacobians": partial(js.closure_jacobians, robot, joints, pose),
        "inverse_jacobian": partial(js.inverse_jacobian, robot, pose),
        "gear_ratios": partial(js.gear_ratios, robot, pose),
        "feasibility": partial(js.feasibility, robot, pose),
        "margins": partial(js.margins, robot, pose),
        "constrained_pose": partial(js.constrained_pose, robot, pose),
        "singularity": partial(js.singularity, robot, pose),
        "reach_along": partial(js.reach_along, robot, pose, along, cells=8),
        "joint_range": partial(js.joint_range, robot, box, samples=16, starts=2),
        "minimum_over": partial(js.minimum_over, first, box, samples=16, starts=2, steps=4),
        "worst_case": partial(js.worst_case, margin, robot, sample),
        "mean_case": partial(js.mean_case, margin, robot, sample),
        "task_metrics": partial(js.task_metrics, robot, poses),
        "workspace_fraction": partial(js.workspace_fraction, robot, sample),
        "soft_workspace_fraction": partial(js.soft_workspace_fraction, robot, sample),
        "soft_workspace_gradient": partial(js.soft_workspace_gradient, robot, sample),
        "its gradient": partial(jax.grad(js.soft_workspace_fraction), robot, sample),
        "exact_workspace_fraction": partial(js.exact_workspace_fraction, robot, box, rays=16, cells=8),
        "binding_limits": partial(js.binding_limits, robot, sample),
        "tolerances": partial(js.tolerances, robot),
        "pose_sensitivity": partial(js.pose_sensitivity, robot, pose),
        "pose_error": partial(js.pose_error, robot, pose, made),
        "sample_pose_errors": partial(js.sample_pose_errors, robot, pose, made, key, 8),
        "per_leg": lambda: js.per_leg(robot).home(),
        "singular_surface": partial(js.singular_surface, robot, cube, (2, 2, 2)),
        "optimize_design": partial(js.optimize_design, parabola, 0.5, bounds=(0.0, 1.0), steps=3, starts=2),
        "pareto_front": partial(
            js.pareto_front, [parabola, other_parabola], 0.3, bounds=(-2.0, 2.0), steps=3, designs=4
        ),
        "optimize_choices": partial(js.optimize_choices, parabola, {"a": {}}, params=0.5, bounds=(0.0, 1.0), steps=3),
    }
    if not robot.dependent:
        found["clearance"] = partial(js.clearance, robot, pose, directions=64, steps=4)
        found["clearance_along"] = partial(js.clearance_along, robot, pose, along)
    if linear == 3:
        found["height_range"] = partial(js.height_range, robot)
        found["height_amplification"] = partial(js.height_amplification, robot, robot, [float(home[2])])
    if type(robot.legs()).solutions is not js.Leg.solutions:
        found["inverse_kinematics_all"] = partial(js.inverse_kinematics_all, robot, pose)
    if isinstance(robot, js.NavaroII):
        found["sensed_mode"] = partial(js.sensed_mode, robot, joints)
        found["swept_area"] = partial(js.swept_area, robot, poses)
        found["aspects"] = partial(js.aspects, robot, plane, (4, 4, 1))
        parts = js.aspects(robot, plane, (4, 4, 1))
        found["aspect_path"] = partial(js.aspect_path, robot, parts, pose, pose)
        found["cuspidal_search"] = partial(js.cuspidal_search, robot, parts, tries=8)
        found["plan_modes"] = partial(js.plan_modes, {8: robot}, np.stack([home, pose]), clearance=1e-3)
    return found
