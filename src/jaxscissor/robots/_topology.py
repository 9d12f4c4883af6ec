"""Degrees of freedom of a mechanism by counting its links and joints."""

from __future__ import annotations

from typing import NamedTuple


class Topology(NamedTuple):
    """Links and joints of a mechanism, as the count of its degrees of freedom needs them.

    Attributes:
      links: number of bodies, the base included.
      freedoms: degrees of freedom of each joint.
      dimension: 6 in space, 3 in the plane.

    Example:
      >>> Topology(links=4, freedoms=(1, 1, 1, 1), dimension=3).mobility  # a four-bar linkage
      1
    """

    links: int
    freedoms: tuple[int, ...]
    dimension: int = 6

    @property
    def mobility(self) -> int:
        """Degrees of freedom by the Kutzbach criterion [TRI eq. 1], idle ones included."""
        return self.dimension * (self.links - 1) - sum(self.dimension - freedom for freedom in self.freedoms)
