"""Robots that people have, each with its dimensions to type in."""

from jaxscissor.robots.stock._deltas import LinearDelta, RotaryDelta
from jaxscissor.robots.stock._hexapods import Hexaglide, RotaryHexapod
from jaxscissor.robots.stock._planar import FiveBar, FourBar, Planar3RPR, Planar3RRR
from jaxscissor.robots.stock._scissors import ScissorHexapod, ScissorLeg, ScissorLift
from jaxscissor.robots.stock._three_legs import AgileEye, ThreePRS, ThreeUPU

__all__ = [
    "AgileEye",
    "FiveBar",
    "FourBar",
    "Hexaglide",
    "LinearDelta",
    "Planar3RPR",
    "Planar3RRR",
    "RotaryDelta",
    "RotaryHexapod",
    "ScissorHexapod",
    "ScissorLeg",
    "ScissorLift",
    "ThreePRS",
    "ThreeUPU",
]
