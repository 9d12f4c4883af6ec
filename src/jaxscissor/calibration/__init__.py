"""A robot's dimensions from measured poses and joints, and what such measurements can tell."""

from jaxscissor.calibration._identifiability import Identifiability, identifiability
from jaxscissor.calibration._identify import Calibration, identify
from jaxscissor.calibration._measures import Markers, heights
from jaxscissor.calibration._next_poses import next_poses

__all__ = [
    "Calibration",
    "Identifiability",
    "Markers",
    "heights",
    "identifiability",
    "identify",
    "next_poses",
]
