"""Legs described by their joints."""

from jaxscissor.robots.chains._arc import Arc
from jaxscissor.robots.chains._chain import Chain
from jaxscissor.robots.chains._crank import CrankAndRod
from jaxscissor.robots.chains._joints import Prismatic, Revolute, Spherical, Universal
from jaxscissor.robots.chains._linkage import FromChains, Linkage, linkage
from jaxscissor.robots.chains._serial import SerialLeg
from jaxscissor.robots.chains._slide import SlideAndRod
from jaxscissor.robots.chains._telescope import Telescope

__all__ = [
    "Arc",
    "Chain",
    "CrankAndRod",
    "FromChains",
    "Linkage",
    "Prismatic",
    "Revolute",
    "SerialLeg",
    "SlideAndRod",
    "Spherical",
    "Telescope",
    "Universal",
    "linkage",
]
