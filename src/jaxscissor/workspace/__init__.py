"""How much of a region a robot reaches, how far it goes, what limits it, and the worst and the mean over poses."""

from jaxscissor._engine.map_reduce import Execution
from jaxscissor.regions import Dexterous, PosePath
from jaxscissor.workspace._fraction import fraction
from jaxscissor.workspace._joint_range import JointRange, joint_range
from jaxscissor.workspace._limiting_constraints import LimitingConstraints, limiting_constraints
from jaxscissor.workspace._map import map
from jaxscissor.workspace._mean_over import mean_over
from jaxscissor.workspace._ray_fraction import ray_fraction
from jaxscissor.workspace._reach import height_range, reach_along
from jaxscissor.workspace._soft_fraction import SoftGradient, soft_fraction, soft_gradient
from jaxscissor.workspace._worst_over import Worst, worst_over

__all__ = [
    "Dexterous",
    "Execution",
    "JointRange",
    "LimitingConstraints",
    "PosePath",
    "SoftGradient",
    "Worst",
    "fraction",
    "height_range",
    "joint_range",
    "limiting_constraints",
    "map",
    "mean_over",
    "ray_fraction",
    "reach_along",
    "soft_fraction",
    "soft_gradient",
    "worst_over",
]
