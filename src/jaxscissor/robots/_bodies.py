"""The rigid bodies of a leg, how they hang together, and which of their freedoms the joint coordinates are.

A leg's bars are its bodies; ``Leg.connections`` says where they are held together. Drawing, weighing and export read
the same description.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from jaxscissor._engine.pytree import pytree, static
from jaxscissor._engine.vectors import Vec

BASE, PLATFORM = -1, -2
"""The parts of a leg's connections that are no bars."""


@pytree
class Freedom:
    """One freedom of a connection, or the three of a ball.

    Attributes:
      kind: ``"turn"`` about the axis, ``"slide"`` along it, or ``"ball"``, about the point in every direction.
      axis: unit direction in the base frame, at this configuration; ``None`` for a ball.
      joints: the leg's joint coordinates whose sum, up to a constant, the freedom's own coordinate is: the motion
        of the second part against the first. Most often one, or none where the freedom is passive. A joint that no
        freedom of a leg names is the distance between the leg's first point on the base and its point on the
        platform.
      geared: slides of a leg with the same number move by the same amount, as the two nuts of a screw with a left
        and a right thread do; ``None``: the freedom moves by itself.
    """

    kind: Literal["turn", "slide", "ball"] = static()
    axis: Vec | None = None
    joints: tuple[int, ...] = static(default=())
    geared: int | None = static(default=None)


@pytree
class Connection:
    """Two parts of a leg held together in a point, up to some freedoms.

    Attributes:
      first, second: a bar, by its number in ``leg.bars``, or ``BASE`` or ``PLATFORM``.
      point: in the base frame, at this configuration, on both parts.
      freedoms: in order from the first part to the second; none is rigid.
    """

    first: int = static()
    second: int = static()
    point: Vec
    freedoms: tuple[Freedom, ...] = ()


def pinned(first: int, second: int, point: Vec, axis: Vec) -> Connection:
    """Two parts that turn against each other about an axis through a point."""
    return Connection(first, second, point, (Freedom("turn", axis),))


def balled(first: int, second: int, point: Vec) -> Connection:
    """Two parts held together by a ball joint."""
    return Connection(first, second, point, (Freedom("ball"),))


def scissor_pins(bars: Sequence[tuple[Vec, Vec]], crossings: Sequence[Vec], axis: Vec) -> list[Connection]:
    """The pins of a scissor whose bars 2i and 2i+1 cross, those of one pair ending where the next pair's start.

    A last pair without a crossing is pinned together at its ends.
    """
    pins = [pinned(2 * i, 2 * i + 1, point, axis) for i, point in enumerate(crossings)]
    for i in range(0, len(bars) - 2, 2):  # the bars change sides at every crossing
        pins += [pinned(i, i + 3, bars[i][1], axis), pinned(i + 1, i + 2, bars[i + 1][1], axis)]
    if 2 * len(crossings) < len(bars):
        pins.append(pinned(len(bars) - 2, len(bars) - 1, bars[-1][1], axis))
    return pins
