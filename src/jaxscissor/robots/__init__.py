"""Robots, one file or folder per family, the elements they are made of, and the contract that they fulfil."""

from jaxscissor.robots._bodies import BASE, PLATFORM, Connection, Freedom
from jaxscissor.robots._contract import Leg, Mechanism
from jaxscissor.robots._navaro import NavaroII
from jaxscissor.robots._per_leg import PerLeg, per_leg
from jaxscissor.robots._scissor import Scissor
from jaxscissor.robots._scott import Scott
from jaxscissor.robots._spaces import R3, SE2, SE3
from jaxscissor.robots._stewart_gough import StewartGough
from jaxscissor.robots._topology import Topology
from jaxscissor.robots.tri_scott import Micabo, TriScott
from jaxscissor.robots.triple_scissor import SLIDE_ANGLES, TripleScissorExtender

__all__ = [
    "BASE",
    "PLATFORM",
    "R3",
    "SE2",
    "SE3",
    "SLIDE_ANGLES",
    "Connection",
    "Freedom",
    "Leg",
    "Mechanism",
    "Micabo",
    "NavaroII",
    "PerLeg",
    "Scissor",
    "Scott",
    "StewartGough",
    "Topology",
    "TriScott",
    "TripleScissorExtender",
    "per_leg",
]
