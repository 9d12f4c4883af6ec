"""Robots as files: JSON, MuJoCo and URDF."""

from jaxscissor.export._files import load, save
from jaxscissor.export._mjcf import to_mjcf
from jaxscissor.export._urdf import to_urdf

__all__ = ["load", "save", "to_mjcf", "to_urdf"]
