"""Robots from model files."""

from jaxscissor.robots.models._from_mjcf import from_mjcf
from jaxscissor.robots.models._plan import BodyPlan, ClosurePlan, JointPlan, LegPlan
from jaxscissor.robots.models._robot import FromModel

__all__ = ["BodyPlan", "ClosurePlan", "FromModel", "JointPlan", "LegPlan", "from_mjcf"]
