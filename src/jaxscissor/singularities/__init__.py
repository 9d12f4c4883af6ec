"""How close a robot is to its singularities, where they lie, and what they divide."""

from jaxscissor.singularities._aspects import AspectPath, Aspects, CuspidalSearch, aspect_path, aspects, cuspidal_search
from jaxscissor.singularities._distance import SingularityDistance, distance
from jaxscissor.singularities._measures import Measures, measures
from jaxscissor.singularities._mode_plans import ModePlan, plan_modes
from jaxscissor.singularities._surface import surface

__all__ = [
    "AspectPath",
    "Aspects",
    "CuspidalSearch",
    "Measures",
    "ModePlan",
    "SingularityDistance",
    "aspect_path",
    "aspects",
    "cuspidal_search",
    "distance",
    "measures",
    "plan_modes",
    "surface",
]
