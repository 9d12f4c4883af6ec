"""The Triple Scissor Extender [RAL17, ICRA16]."""

from jaxscissor.robots.triple_scissor._robot import SLIDE_ANGLES, TripleScissorExtender

__all__ = [
    "SLIDE_ANGLES",
    "TripleScissorExtender",
]
