"""What the bodies of an exported robot weigh."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jaxscissor.export._posed import Posed, in_space
from jaxscissor.export._tree import TOP, Body, bar_name
from jaxscissor.statics._load import Load

THICKNESS, LIGHT = 0.005, 0.1  # radius of a bar over the robot's length; masses that are not given over those that are


class Mass(NamedTuple):
    """Mass, center and inertia ``(3, 3)`` about it, in the base frame; what is weightless has mass all the same."""

    mass: float
    center: np.ndarray
    inertia: np.ndarray
    weightless: bool


def masses_of(state: Posed, bodies: list[Body], load: Load) -> dict[str, Mass]:
    """Mass of every body: bars as thin rods, platform and payload as a thick disc.

    Simulators cannot move what has no mass, and not well what has next to none. Where none is given, the platform has
    one, a bar a tenth of the platform's, and a carriage a tenth of all; gravity does not pull at them.
    """
    given = float(load.payload) + float(load.platform_mass)
    total = given or 1.0
    found = {TOP: _platform(state, load, total, not given)}
    radius = THICKNESS * state.length
    for number, leg in enumerate(state.legs):
        for i, (start, end) in enumerate(leg.bars):
            mass, center = LIGHT * total, (start + end) / 2
            if leg.weighed is not None:
                mass, center = float(leg.weighed[0][i]), leg.weighed[1][i]
            along, square = end - start, (end - start) @ (end - start)
            axial = np.outer(along, along) / (square or 1.0)
            inertia = mass * (square / 12 * (np.eye(3) - axial) + radius**2 / 4 * (np.eye(3) + axial))
            found[bar_name(number, i)] = Mass(mass, center, inertia, leg.weighed is None)
    carriage = LIGHT * moved_mass(found)
    for body in bodies:
        found.setdefault(body.name, Mass(carriage, body.point, np.eye(3) * carriage * radius**2, True))
    return found


def moved_mass(masses: dict[str, Mass]) -> float:
    """Mass of all that has weight, or of the platform."""
    return sum(mass.mass for mass in masses.values() if not mass.weightless) or masses[TOP].mass


def _platform(state: Posed, load: Load, total: float, weightless: bool) -> Mass:
    """Platform and payload."""
    parts = [
        (float(load.payload), np.asarray(load.payload_center)),
        (float(load.platform_mass), np.asarray(load.platform_center)),
    ]
    middle = sum(mass * center for mass, center in parts) / total
    tips = [in_space(leg.connections[-1].point) - state.position for leg in state.legs]
    size = max(max(float(np.linalg.norm(tip)) for tip in tips), THICKNESS * state.length)
    up = state.rotation[:, 2]
    inertia = total * size**2 / 4 * (np.eye(3) + 0.9 * np.outer(up, up))
    for mass, center in parts:
        arm = state.rotation @ (center - middle)
        inertia = inertia + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Mass(total, state.position + state.rotation @ middle, inertia, weightless)
