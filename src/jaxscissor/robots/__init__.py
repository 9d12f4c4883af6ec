"""Robots, one file or folder per family, the elements they are made of, and the contract that they fulfil."""

from jaxscissor.robots._bodies import BASE, PLATFORM, Connection, Freedom
from jaxscissor.robots._circle import Circle
from jaxscissor.robots._contract import Leg, LegKind, Mechanism
from jaxscissor.robots._kinds import LegOfAnyKind
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
from jaxscissor.robots.chains import (
    Arc,
    Chain,
    CrankAndRod,
    FromChains,
    Linkage,
    Prismatic,
    Revolute,
    SerialLeg,
    SlideAndRod,
    Spherical,
    Telescope,
    Universal,
    linkage,
)
from jaxscissor.robots.models import BodyPlan, ClosurePlan, FromModel, JointPlan, LegPlan, from_mjcf
from jaxscissor.robots.stock import (
    AgileEye,
    FiveBar,
    FourBar,
    Hexaglide,
    LinearDelta,
    Planar3RPR,
    Planar3RRR,
    RotaryDelta,
    RotaryHexapod,
    ScissorHexapod,
    ScissorLeg,
    ScissorLift,
    ThreePRS,
    ThreeUPU,
)
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
    "AgileEye",
    "Arc",
    "BodyPlan",
    "Chain",
    "Circle",
    "ClosurePlan",
    "Connection",
    "CrankAndRod",
    "FiveBar",
    "FourBar",
    "Frame",
    "Freedom",
    "FromChains",
    "FromModel",
    "Hexaglide",
    "JointPlan",
    "Leg",
    "LegKind",
    "LegOfAnyKind",
    "LegPlan",
    "LinearDelta",
    "Linkage",
    "Mechanism",
    "Micabo",
    "Mounted",
    "MountedLeg",
    "NavaroII",
    "PerLeg",
    "Planar3RPR",
    "Planar3RRR",
    "Prismatic",
    "Revolute",
    "RotaryDelta",
    "RotaryHexapod",
    "Schoenflies",
    "Scissor",
    "ScissorHexapod",
    "ScissorLeg",
    "ScissorLift",
    "Scott",
    "SerialLeg",
    "SlideAndRod",
    "Space",
    "Spherical",
    "StewartGough",
    "Subspace",
    "Telescope",
    "ThreePRS",
    "ThreeUPU",
    "Topology",
    "TriScott",
    "TripleScissorExtender",
    "Universal",
    "frame",
    "from_mjcf",
    "linkage",
    "mounted",
    "per_leg",
    "pose",
]
