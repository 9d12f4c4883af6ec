"""Tri-Scott and its relative MICABO [TRI]."""

from jaxscissor.robots.tri_scott._robot import Micabo, TriScott

__all__ = [
    "Micabo",
    "TriScott",
]
