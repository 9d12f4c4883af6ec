"""Sets of poses and samples of them, computed on demand; they know no robot."""

from jaxscissor.regions._regions import Box, Cylinder, Disc, Region, Sample
from jaxscissor.regions._tasks import Dexterous, PosePath

__all__ = [
    "Box",
    "Cylinder",
    "Dexterous",
    "Disc",
    "PosePath",
    "Region",
    "Sample",
]
