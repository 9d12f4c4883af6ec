"""The best robot within bounds, by the gradient of any metric; what inexact dimensions do to the pose."""

from jaxscissor.design._methods import SQP, AugmentedLagrangian
from jaxscissor.design._optimize import optimize
from jaxscissor.design._pareto import ParetoFront, optimize_variants, pareto_front
from jaxscissor.design._result import DesignResult
from jaxscissor.design._task_metrics import TaskMetrics, task_metrics
from jaxscissor.design._throughout import Throughout
from jaxscissor.design._tolerances import (
    PoseError,
    PoseErrorSamples,
    pose_error,
    pose_sensitivity,
    sample_pose_errors,
    tolerances,
)

__all__ = [
    "SQP",
    "AugmentedLagrangian",
    "DesignResult",
    "ParetoFront",
    "PoseError",
    "PoseErrorSamples",
    "TaskMetrics",
    "Throughout",
    "optimize",
    "optimize_variants",
    "pareto_front",
    "pose_error",
    "pose_sensitivity",
    "sample_pose_errors",
    "task_metrics",
    "tolerances",
]
