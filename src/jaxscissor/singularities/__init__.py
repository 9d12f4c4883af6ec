"""How close a robot is to its singularities, where they lie, and what they divide."""

from jaxscissor.singularities._aspects import aspect_path, aspects, cuspidal_search
from jaxscissor.singularities._distance import distance
from jaxscissor.singularities._measures import measures
from jaxscissor.singularities._mode_plans import plan_modes
from jaxscissor.singularities._surface import surface

__all__ = [
    "aspect_path",
    "aspects",
    "cuspidal_search",
    "distance",
    "measures",
    "plan_modes",
    "surface",
]
