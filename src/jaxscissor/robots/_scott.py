"""The Scott-Russell straight-line linkage as an element: a link driven along a line, guided by a crank."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxscissor._engine.numerics import Scalar, safe_sqrt
from jaxscissor._engine.pytree import as_arrays, is_concrete, pytree, quantity


@pytree
class Scott:
    """A link from a slider U to an end P, held in between by a crank from a pivot O on the slider's line.

    In the plane, with O as origin and the slider at height d, the link of length L is pinned to the crank of
    length c at the distance m from U. With c = m = L/2 the end P keeps the height of O: the straight line of
    the name [TRI 3]. Turned about the slider's line, the straight line becomes a plane.

    Args:
      link: L, between U and P.
      crank: c. Default: L/2.
      pin: m, from U to the crank's end. Default: L/2.

    Raises:
      ValueError: lengths that are not positive, or m > L.

    Example:
      >>> linkage = Scott(2.0)
      >>> radius, height = linkage.end(1.2)
      >>> round(float(radius), 6), round(float(height), 6)
      (1.6, 0.0)
    """

    link: Any = quantity("m")
    crank: Any = quantity("m", default=None)
    pin: Any = quantity("m", default=None)

    def __post_init__(self):
        (link,) = as_arrays(self.link)
        crank, pin = (link / 2 if value is None else value for value in (self.crank, self.pin))
        for name, value in zip(("link", "crank", "pin"), as_arrays(link, crank, pin), strict=True):
            object.__setattr__(self, name, value)
            if is_concrete(value) and not np.all(np.isfinite(value) & (np.asarray(value) > 0)):
                raise ValueError(f"Got {name} = {value}; expected a positive, finite length.")
        if is_concrete((self.link, self.pin)) and np.any(np.asarray(self.pin) > np.asarray(self.link)):
            raise ValueError(f"Got pin = {self.pin}; the crank holds the link of length {self.link} between its ends.")

    def end(self, slider: Scalar) -> tuple[Scalar, Scalar]:
        """Distance from the slider's line and height over O of the end P, with the slider at d > 0."""
        height = (slider**2 + self.crank**2 - self.pin**2) / (2 * slider)
        radius = safe_sqrt(self.crank**2 - height**2)
        ratio = self.link / self.pin
        return radius * ratio, slider + (height - slider) * ratio

    def room(self, radius: Scalar) -> tuple[Scalar, Scalar]:
        """Squared heights of the link over P and of its pin over O at a radius; both >= 0 where P can be."""
        across = radius * self.pin / self.link
        return self.link**2 - radius**2, self.crank**2 - across**2

    def sliders(self, radius: Scalar) -> list[tuple[Scalar, Scalar]]:
        """The four ways to hold P at a radius: (d, height of P over O). The first has U over P, pin over O."""
        link2, crank2 = self.room(radius)
        drop, pin = safe_sqrt(link2), safe_sqrt(crank2)
        ways = []
        for side in (1, -1):
            for lift in (1, -1):
                slider = side * drop * self.pin / self.link + lift * pin
                ways.append((slider, slider - side * drop))
        return [ways[i] for i in (0, 1, 3, 2)]

    def residual(self, radius2: Scalar, slider: Scalar, height: Scalar) -> tuple[Scalar, Scalar]:
        """Link and crank of their lengths, in units of L^2, with P at a squared radius and a height over O."""
        ratio = self.pin / self.link
        drop = height - slider
        pinned = slider + drop * ratio
        scale = 1 / self.link**2
        return (radius2 + drop**2) * scale - 1, (radius2 * ratio**2 + pinned**2 - self.crank**2) * scale
