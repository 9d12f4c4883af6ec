"""Robots, one file or folder per family, the elements they are made of, and the contract that they fulfil."""

from jaxscissor.robots._bodies import BASE, PLATFORM, Connection, Freedom
from jaxscissor.robots._contract import Leg, Mechanism
from jaxscissor.robots._mounted import Mounted, MountedLeg, mounted
from jaxscissor.robots._navaro import NavaroII
from jaxscissor.robots._per_leg import PerLeg, per_leg
from jaxscissor.robots._poses import Frame, frame, pose
from jaxscissor.robots._scissor import Scissor
from jaxscissor.robots._scott import Scott
from jaxscissor.robots._spaces import SE2, SE3, Space
from jaxscissor.robots._stewart_gough import StewartGough
from jaxscissor.robots._subspaces import R1, R2, R3, SO3, Schoenflies, Subspace
from jaxscissor.robots._topology import Topology
from jaxscissor.robots.tri_scott import Micabo, TriScott
from jaxscissor.robots.triple_scissor import SLIDE_ANGLES, TripleScissorExtender

__all__ = [
    "BASE",
    "PLATFORM",
    "R1",
    "R2",
    "R3",
    "SE2",
    "SE3",
    "SLIDE_ANGLES",
    "SO3",
    "Connection",
    "Frame",
    "Freedom",
    "Leg",
    "Mechanism",
    "Micabo",
    "Mounted",
    "MountedLeg",
    "NavaroII",
    "PerLeg",
    "Schoenflies",
    "Scissor",
    "Scott",
    "Space",
    "StewartGough",
    "Subspace",
    "Topology",
    "TriScott",
    "TripleScissorExtender",
    "frame",
    "mounted",
    "per_leg",
    "pose",
]
