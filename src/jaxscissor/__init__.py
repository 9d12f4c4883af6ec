"""Kinematics of parallel robots with scissor legs, differentiable from end to end."""

import importlib.metadata as _metadata

from jaxscissor import calibration, design, export, motion, navaro, plot, robots, singularities, statics, workspace
from jaxscissor._engine.numerics import limit_margins, safe_sqrt
from jaxscissor._engine.pytree import pytree, quantity, static
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.kinematics import (
    Solution,
    Status,
    check_robot,
    closure_jacobians,
    constrained_pose,
    feasibility,
    forward_kinematics,
    forward_kinematics_all,
    gear_ratios,
    height_amplification,
    inverse_jacobian,
    inverse_kinematics,
    inverse_kinematics_all,
    margins,
    residual,
    within_limits,
)
from jaxscissor.regions import Box, Cylinder, Disc
from jaxscissor.robots import (
    R3,
    SE2,
    SE3,
    SLIDE_ANGLES,
    Leg,
    Mechanism,
    Micabo,
    NavaroII,
    Scissor,
    Scott,
    StewartGough,
    TripleScissorExtender,
    TriScott,
    frame,
    per_leg,
    pose,
)

__version__ = _metadata.version("jaxscissor")

__all__ = [
    "R3",
    "SE2",
    "SE3",
    "SLIDE_ANGLES",
    "Box",
    "Cylinder",
    "Disc",
    "Leg",
    "Mechanism",
    "Micabo",
    "NavaroII",
    "Rotation",
    "Scissor",
    "Scott",
    "Solution",
    "Status",
    "StewartGough",
    "TriScott",
    "TripleScissorExtender",
    "Vec",
    "calibration",
    "check_robot",
    "closure_jacobians",
    "constrained_pose",
    "design",
    "export",
    "feasibility",
    "forward_kinematics",
    "forward_kinematics_all",
    "frame",
    "gear_ratios",
    "height_amplification",
    "inverse_jacobian",
    "inverse_kinematics",
    "inverse_kinematics_all",
    "limit_margins",
    "margins",
    "motion",
    "navaro",
    "per_leg",
    "plot",
    "pose",
    "pytree",
    "quantity",
    "residual",
    "robots",
    "safe_sqrt",
    "singularities",
    "static",
    "statics",
    "within_limits",
    "workspace",
]


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
