"""Joints of a pose, poses of joints, their derivatives, and whether a pose can be used."""

from jaxscissor.kinematics._all_modes import (
    AssemblyModes,
    WorkingModes,
    forward_kinematics_all,
    inverse_kinematics_all,
    within_limits,
)
from jaxscissor.kinematics._check_robot import check_robot
from jaxscissor.kinematics._constraints import constrained_pose
from jaxscissor.kinematics._dexterity import GearRatios, gear_ratios, height_amplification
from jaxscissor.kinematics._feasibility import Feasibility, feasibility, margins
from jaxscissor.kinematics._forward import forward_kinematics
from jaxscissor.kinematics._inverse import inverse_kinematics
from jaxscissor.kinematics._jacobians import closure_jacobians, inverse_jacobian
from jaxscissor.kinematics._residual import residual
from jaxscissor.kinematics._solution import Solution, Status

__all__ = [
    "AssemblyModes",
    "Feasibility",
    "GearRatios",
    "Solution",
    "Status",
    "WorkingModes",
    "check_robot",
    "closure_jacobians",
    "constrained_pose",
    "feasibility",
    "forward_kinematics",
    "forward_kinematics_all",
    "gear_ratios",
    "height_amplification",
    "inverse_jacobian",
    "inverse_kinematics",
    "inverse_kinematics_all",
    "margins",
    "residual",
    "within_limits",
]
