"""Trajectories: jogging, following poses without drift, tracking joints, paths through poses and laws of time."""

from jaxscissor.motion._follow import follow
from jaxscissor.motion._jog import Jog, jog
from jaxscissor.motion._paths import straight_line, via_points
from jaxscissor.motion._time_law import TimeLaw, time_parametrize
from jaxscissor.motion._track import track
from jaxscissor.motion._trajectory import Trajectory

__all__ = [
    "Jog",
    "TimeLaw",
    "Trajectory",
    "follow",
    "jog",
    "straight_line",
    "time_parametrize",
    "track",
    "via_points",
]
