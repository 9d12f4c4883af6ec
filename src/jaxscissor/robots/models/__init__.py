"""Robots from model files."""

from jaxscissor.robots.models._from_mjcf import from_mjcf
from jaxscissor.robots.models._robot import FromModel

__all__ = ["FromModel", "from_mjcf"]
