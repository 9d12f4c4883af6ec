"""Matplotlib pictures: robots, workspaces, singularities, designs and the course of an optimization."""

from jaxscissor.plot._design import before_after, front, sensitivity
from jaxscissor.plot._history import history
from jaxscissor.plot._robot import animate, robot
from jaxscissor.plot._singularities import singularity_map, surface
from jaxscissor.plot._workspace import workspace, workspace_slice

__all__ = [
    "animate",
    "before_after",
    "front",
    "history",
    "robot",
    "sensitivity",
    "singularity_map",
    "surface",
    "workspace",
    "workspace_slice",
]
