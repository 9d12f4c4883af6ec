"""Kinematics of parallel robots with scissor legs, differentiable from end to end."""

import importlib.metadata

from jaxscissor import plot as plot
from jaxscissor._numerics import limit_margins as limit_margins
from jaxscissor._numerics import safe_sqrt as safe_sqrt
from jaxscissor._pytree import pytree as pytree
from jaxscissor._pytree import quantity as quantity
from jaxscissor._pytree import static as static
from jaxscissor._solution import Solution as Solution
from jaxscissor._solution import Status as Status
from jaxscissor._solution import raise_if_failed as raise_if_failed
from jaxscissor._solution import status_message as status_message
from jaxscissor._spaces import R3 as R3
from jaxscissor._spaces import SE2 as SE2
from jaxscissor._spaces import SE3 as SE3
from jaxscissor._vectors import Rotation as Rotation
from jaxscissor._vectors import Vec as Vec
from jaxscissor.assembly import forward_kinematics_all as forward_kinematics_all
from jaxscissor.assembly import inverse_kinematics_all as inverse_kinematics_all
from jaxscissor.assembly import within_limits as within_limits
from jaxscissor.constraints import constrained_pose as constrained_pose
from jaxscissor.design import DesignStatus as DesignStatus
from jaxscissor.design import optimize_design as optimize_design
from jaxscissor.dexterity import gear_ratios as gear_ratios
from jaxscissor.dexterity import height_amplification as height_amplification
from jaxscissor.exact import exact_workspace_fraction as exact_workspace_fraction
from jaxscissor.extremes import joint_range as joint_range
from jaxscissor.extremes import minimum_over as minimum_over
from jaxscissor.feasibility import feasibility as feasibility
from jaxscissor.jacobians import closure_jacobians as closure_jacobians
from jaxscissor.jacobians import inverse_jacobian as inverse_jacobian
from jaxscissor.kinematics import forward_kinematics as forward_kinematics
from jaxscissor.kinematics import inverse_kinematics as inverse_kinematics
from jaxscissor.kinematics import residual as residual
from jaxscissor.mechanisms._contract import Leg as Leg
from jaxscissor.mechanisms._contract import Mechanism as Mechanism
from jaxscissor.mechanisms.navaro import ACTUATION_MODES as ACTUATION_MODES
from jaxscissor.mechanisms.navaro import NavaroII as NavaroII
from jaxscissor.mechanisms.navaro_drive import Clutch as Clutch
from jaxscissor.mechanisms.navaro_drive import DriveTrain as DriveTrain
from jaxscissor.mechanisms.navaro_drive import drive_mobility as drive_mobility
from jaxscissor.mechanisms.navaro_drive import drive_mode as drive_mode
from jaxscissor.mechanisms.stewart import StewartGough as StewartGough
from jaxscissor.mechanisms.tri_scott import Micabo as Micabo
from jaxscissor.mechanisms.tri_scott import TriScott as TriScott
from jaxscissor.mechanisms.triple_scissor import SLIDE_ANGLES as SLIDE_ANGLES
from jaxscissor.mechanisms.triple_scissor import TripleScissorExtender as TripleScissorExtender
from jaxscissor.metrics import TaskMetrics as TaskMetrics
from jaxscissor.metrics import WorstCase as WorstCase
from jaxscissor.metrics import mean_case as mean_case
from jaxscissor.metrics import task_metrics as task_metrics
from jaxscissor.metrics import worst_case as worst_case
from jaxscissor.mobility import Topology as Topology
from jaxscissor.regions import Box as Box
from jaxscissor.regions import Cylinder as Cylinder
from jaxscissor.regions import Disc as Disc
from jaxscissor.scissor import Scissor as Scissor
from jaxscissor.scott import Scott as Scott
from jaxscissor.sensing import SensedMode as SensedMode
from jaxscissor.sensing import sensed_mode as sensed_mode
from jaxscissor.singularity import Singularity as Singularity
from jaxscissor.singularity import singularity as singularity
from jaxscissor.workspace import soft_workspace_fraction as soft_workspace_fraction
from jaxscissor.workspace import workspace_fraction as workspace_fraction

__version__ = importlib.metadata.version("jaxscissor")
