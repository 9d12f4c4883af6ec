"""NaVARo II: what drives its legs, what its sensors tell, the ground that it sweeps [NAV19]."""

from jaxscissor.navaro._assembly_modes import identify_assembly
from jaxscissor.navaro._drive import Clutch, DriveTrain, drive_mobility, drive_mode
from jaxscissor.navaro._footprint import swept_area
from jaxscissor.robots._navaro import ACTUATION_MODES

__all__ = [
    "ACTUATION_MODES",
    "Clutch",
    "DriveTrain",
    "drive_mobility",
    "drive_mode",
    "identify_assembly",
    "swept_area",
]
