"""Forces that hold a load, stiffness, sag, and what a robot can carry.

Wrenches are a force and then a moment about the platform's reference point, twists a velocity of that point and then an
angular velocity, all in the base frame. Actuator forces are positive along increasing joint coordinate. Units are any
consistent ones: newtons, where lengths are meters and masses kilograms.
"""

from jaxscissor.statics._actuator_forces import ActuatorForces, actuator_forces
from jaxscissor.statics._bar_forces import BarForces, bar_forces
from jaxscissor.statics._capability import Capability, force_capability, velocity_capability
from jaxscissor.statics._load import Load
from jaxscissor.statics._mass import mass
from jaxscissor.statics._materials import Material, Section
from jaxscissor.statics._payload import payload
from jaxscissor.statics._sag import Sag, sag
from jaxscissor.statics._stiffness import Stiffness, stiffness

__all__ = [
    "ActuatorForces",
    "BarForces",
    "Capability",
    "Load",
    "Material",
    "Sag",
    "Section",
    "Stiffness",
    "actuator_forces",
    "bar_forces",
    "force_capability",
    "mass",
    "payload",
    "sag",
    "stiffness",
    "velocity_capability",
]
