"""NaVARo II: what drives its legs, what its sensors tell, the ground that it sweeps [NAV19]."""

from jaxscissor.navaro._assembly_modes import IdentifiedAssembly, identify_assembly
from jaxscissor.navaro._drive import Clutch, DriveMobility, DriveTrain, drive_mobility, drive_mode
from jaxscissor.navaro._footprint import SweptArea, swept_area
from jaxscissor.robots._navaro import ACTUATION_MODES

__all__ = [
    "ACTUATION_MODES",
    "Clutch",
    "DriveMobility",
    "DriveTrain",
    "IdentifiedAssembly",
    "SweptArea",
    "drive_mobility",
    "drive_mode",
    "identify_assembly",
    "swept_area",
]
