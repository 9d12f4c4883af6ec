"""A configuration to show: home, or a pose with its joints."""

from __future__ import annotations

import jax

from jaxscissor._engine.types import JointsLike, PoseLike
from jaxscissor.kinematics._constraints import constrained_pose
from jaxscissor.kinematics._inverse import inverse_kinematics
from jaxscissor.robots._contract import Mechanism, checked_joints, checked_pose


def configuration(
    robot: Mechanism, pose: PoseLike | None, joints: JointsLike | None
) -> tuple[Mechanism, jax.Array, jax.Array]:
    """Robot, pose and joints in one dtype; by default home, at a pose the joints that the home mode has there.

    Raises:
      ValueError: wrong shapes; a pose that the home mode does not reach while no joints are given.
    """
    if pose is None:
        home_pose, home_joints = robot.home()
        pose, joints = home_pose, home_joints if joints is None else joints
    robot, pose = checked_pose(robot, pose)
    if joints is None:
        pose = constrained_pose(robot, pose).value
        solution = inverse_kinematics(robot, pose)
        if not bool(solution.converged):
            raise ValueError(f"The home mode does not reach the pose {pose}; give joints to show another mode.")
        joints = solution.value
    return robot, pose, checked_joints(robot, joints)
