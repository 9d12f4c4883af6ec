"""What bars are made of, and their cross-section."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.pytree import as_arrays, is_concrete, pytree, quantity
from jaxscissor._engine.types import Numbers


@pytree
class Material:
    """A material, in any consistent units.

    Args:
      youngs_modulus: E, force per area; infinite for bars that do not give way.
      density: mass per volume.
      strength: greatest normal stress that it bears, force per area; only a limit to compare ``bar_forces`` with.

    Example:
      >>> float(Material.aluminum().density)
      2700.0
    """

    youngs_modulus: Any = quantity("Pa")
    density: Any = quantity("kg/m^3")
    strength: Any = quantity("Pa", default=math.inf)

    def __post_init__(self):
        _set_positive(self, ("youngs_modulus", "density", "strength"))

    @classmethod
    def aluminum(cls) -> Material:
        """6061-T6, of which the TSE's plates are cut [ICRA16 VI]: its usual data, up to the yield stress; SI units."""
        return cls(68.9e9, 2700.0, 276e6)

    @classmethod
    def steel(cls) -> Material:
        """Structural steel S235, up to the yield stress; SI units."""
        return cls(210e9, 7850.0, 235e6)


@pytree
class Section:
    """A bar's cross-section, constant along it: what it weighs and how it gives way, in any consistent units.

    Args:
      material: of the bar.
      area: of the section.
      inertia: second moment of area for bending in the leg's plane.
      depth: extent of the section in the leg's plane, at whose ends bending stresses most.

    Every number may be ``()``, the same for all bars, or ``(bars,)``, bar by bar of a leg.

    Example:
      >>> section = Section.rectangle(Material.aluminum(), depth=0.025, width=0.006)
      >>> round(float(section.mass_per_length), 3)
      0.405
    """

    material: Material
    area: Any = quantity("m^2")
    inertia: Any = quantity("m^4")
    depth: Any = quantity("m")

    def __post_init__(self):
        _set_positive(self, ("area", "inertia", "depth"))

    @classmethod
    def rectangle(cls, material: Material, *, depth: Numbers, width: Numbers) -> Section:
        """A flat bar, ``depth`` in the leg's plane and ``width`` across it."""
        depth, width = as_arrays(depth, width)
        return cls(material, depth * width, width * depth**3 / 12, depth)

    @classmethod
    def tube(cls, material: Material, *, diameter: Numbers, wall: Numbers | None = None) -> Section:
        """A round tube of an outer diameter; without a wall a full rod."""
        outer, wall = as_arrays(diameter, 0.5 * np.asarray(diameter) if wall is None else wall)
        inner = outer - 2 * wall
        area, inertia = math.pi / 4 * (outer**2 - inner**2), math.pi / 64 * (outer**4 - inner**4)
        return cls(material, area, inertia, outer)

    @property
    def mass_per_length(self) -> Scalar:
        """Density times area."""
        return self.material.density * self.area

    @property
    def axial_stiffness(self) -> Scalar:
        """E A, a force."""
        return self.material.youngs_modulus * self.area

    @property
    def bending_stiffness(self) -> Scalar:
        """E I, a force times a squared length."""
        return self.material.youngs_modulus * self.inertia

    def stress(self, axial: Scalar, bending: Scalar) -> Scalar:
        """Greatest normal stress under an axial force and a bending moment."""
        return abs(axial) / self.area + abs(bending) * self.depth / (2 * self.inertia)


def _set_positive(tree: Any, names: tuple[str, ...]) -> None:
    arrays = as_arrays(*(getattr(tree, name) for name in names))
    for name, array in zip(names, arrays, strict=True):
        object.__setattr__(tree, name, array)
        if is_concrete(array) and not np.all(np.asarray(array) > 0):
            raise ValueError(f"Got {name} = {array} of a {type(tree).__name__}; expected positive numbers.")
