"""Bodies, joints and closures of a compiled model at home, as the legs between its base and its platform."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxscissor.robots.models._plan import BASE, PLATFORM, BodyPlan, ClosurePlan, JointPlan, LegPlan


@dataclasses.dataclass(eq=False)
class Part:
    """A rigid part of the model: a body with all that hangs from it without joints. All in the base's frame at home."""

    name: str
    parent: int | None  # number of the part that it hangs from
    origin: np.ndarray
    joints: list[PartJoint]
    loose: bool  # hangs by a free joint, which holds nothing


@dataclasses.dataclass(eq=False)
class PartJoint:
    """A joint by which a part hangs."""

    name: str
    kind: str
    axis: np.ndarray
    place: np.ndarray
    value: float
    stroke: tuple[float, float]


@dataclasses.dataclass(eq=False)
class Loop:
    """A closure between two parts at a place, or of a gear between two joints."""

    name: str
    kind: str
    first: Any
    second: Any
    place: Any = None
    polynomial: tuple[float, ...] = ()


@dataclasses.dataclass(eq=False)
class Graph:
    """The whole model."""

    parts: dict[int, Part]
    loops: list[Loop]
    base: int
    platform: int
    platform_origin: np.ndarray

    def legs(self, actuated: Sequence[str]) -> list[GraphLeg]:
        """What joins base and platform, one leg for each piece that is left without both.

        1. Parts that hang from one another, are closed to one another or geared belong together.
        2. Pieces that do not hold the platform are no legs, and neither is what dangles from one.
        3. The platform is a body of its own where it hangs from a leg, closed rigidly to where its pose says.
        """
        legs = []
        for piece in self._pieces():
            piece = self._without_danglers(piece, actuated)
            if self._holds_platform(piece):
                legs.append(GraphLeg(self, piece, actuated))
        return legs

    def parent(self, part: int) -> int | None:
        """What a part hangs from by joints that hold it."""
        return None if self.parts[part].loose else self.parts[part].parent

    def _pieces(self) -> list[list[int]]:
        """Numbers of parts; the platform is among those of the piece that it hangs from."""
        group = {number: number for number in self.parts}

        def top(number: int) -> int:
            while group[number] != number:
                number = group[number]
            return number

        def join(one: int, other: int) -> None:
            if not {one, other} & {self.base}:
                group[top(one)] = top(other)

        owner = {joint.name: number for number, part in self.parts.items() for joint in part.joints}
        for number in self.parts:
            parent = self.parent(number)
            if parent is not None and parent != self.platform:
                join(number, parent)
        for loop in self.loops:
            ends: tuple[Any, Any] = loop.first, loop.second
            if loop.kind == "gear":
                ends = owner.get(loop.first), owner.get(loop.second)
                if ends[0] is None or (loop.second is not None and ends[1] is None):
                    raise ValueError(f"Got the gear {loop.name!r} of a joint that is none of this mechanism's.")
            if None not in ends and (self.platform not in ends or loop.kind == "gear"):
                join(*ends)
        pieces: dict[int, list[int]] = {}
        for number in self.parts:
            hung = number != self.platform or self.parent(number) is not None
            if number != self.base and hung:
                pieces.setdefault(top(number), []).append(number)
        return list(pieces.values())

    def _without_danglers(self, piece: list[int], actuated: Sequence[str]) -> list[int]:
        """Leave out ends of the tree that nothing holds and no motor moves."""
        piece = list(piece)
        used = {name for loop in self.loops for name in (loop.first, loop.second)}
        while True:
            parents = {self.parent(number) for number in piece}
            ends = [
                number
                for number in piece
                if number not in parents | {self.platform}
                and number not in used
                and not {joint.name for joint in self.parts[number].joints} & (used | set(actuated))
            ]
            if not ends:
                return piece
            piece = [number for number in piece if number not in ends]

    def _holds_platform(self, piece: list[int]) -> bool:
        hung = any(self.parent(number) == self.platform for number in piece)
        held = any(
            loop.kind != "gear"
            and self.platform in (loop.first, loop.second)
            and {loop.first, loop.second} & set(piece)
            for loop in self.loops
        )
        return self.platform in piece or hung or held


class GraphLeg:
    """One leg: its parts in the order of the tree, and how its equations change with joints and platform at home."""

    def __init__(self, graph: Graph, piece: list[int], actuated: Sequence[str]):
        self.graph, self.actuated = graph, actuated
        self.order = self._sorted(piece)
        self.joints = [joint for number in self.order for joint in graph.parts[number].joints]
        names = {joint.name for joint in self.joints}
        self.loops = [loop for loop in graph.loops if self._is_own(loop, names)]
        if graph.platform in piece:
            self.loops.append(
                Loop(f"{graph.parts[graph.platform].name} held", "frame", graph.platform, None, graph.platform_origin)
            )

    def _is_own(self, loop: Loop, names: set[str]) -> bool:
        if loop.kind == "gear":
            return loop.first in names
        ends, top = {loop.first, loop.second}, self.graph.platform
        return bool(ends & (set(self.order) - {top})) or (top in self.order and ends == {top, self.graph.base})

    def _sorted(self, piece: list[int]) -> list[int]:
        """Parents first.

        Raises:
          ValueError: a part that hangs from neither base nor platform.
        """
        order: list[int] = []
        roots = {self.graph.base, self.graph.platform}
        while len(order) < len(piece):
            ready = [n for n in piece if n not in order and self.graph.parent(n) in roots | set(order)]
            if not ready:
                rest = [self.graph.parts[n].name for n in piece if n not in order]
                raise ValueError(f"Got bodies {rest} that hang from neither base nor platform by joints.")
            order += ready
        return order

    def origin(self, number: int) -> np.ndarray:
        """Where a part's point is; the platform's is where its pose says, also where it hangs from a leg."""
        return self.graph.platform_origin if number == self.graph.platform else self.graph.parts[number].origin

    def coordinates(self) -> list[tuple[PartJoint, int]]:
        """Joint and number of each coordinate, three of a ball."""
        return [(joint, k) for joint in self.joints for k in range(3 if joint.kind == "B" else 1)]

    def slopes(self, scale: float) -> tuple[np.ndarray, np.ndarray]:
        """Of all equations at home by all coordinates and by the platform's twist ``(equations, 6)``."""
        own, platform = [], []
        for loop in self.loops:
            if loop.kind == "gear":
                row = np.zeros((1, len(self.coordinates())))
                for name, factor in ((loop.first, 1.0), (loop.second, -loop.polynomial[1])):
                    row[0, [i for i, (joint, _) in enumerate(self.coordinates()) if joint.name == name]] = factor
                own.append(row)
                platform.append(np.zeros((1, 6)))
                continue
            sides = [
                self._motion(number, loop.place, rigid=loop.kind == "frame") for number in (loop.first, loop.second)
            ]
            own.append(sides[0][0] - sides[1][0])
            platform.append(sides[0][1] - sides[1][1])
        units = {"gear": [1.0], "point": [1 / scale] * 3, "frame": [1 / scale] * 3 + [0.5] * 3}
        unit = np.concatenate([units[loop.kind] for loop in self.loops])[:, None]
        return np.concatenate(own) * unit, np.concatenate(platform) * unit

    def _motion(self, number: int | None, place: np.ndarray, *, rigid: bool) -> tuple[np.ndarray, np.ndarray]:
        """Velocity of a place on a part, and its angular velocity if rigid, by coordinates and by the platform's twist.

        ``None`` is the platform where its pose says.
        """
        rows = 6 if rigid else 3
        by_joints, by_twist = np.zeros((6, len(self.coordinates()))), np.zeros((6, 6))
        hung = number in self.order
        while number is not None and number in self.order:
            for i, (joint, k) in enumerate(self.coordinates()):
                if joint in self.graph.parts[number].joints:
                    axis = np.eye(3)[k] if joint.kind == "B" else joint.axis
                    if joint.kind == "P":
                        by_joints[:3, i] = axis
                    else:
                        speed = 2.0 if joint.kind == "B" else 1.0
                        by_joints[:3, i], by_joints[3:, i] = speed * np.cross(axis, place - joint.place), speed * axis
            number = self.graph.parent(number)
        if (number == self.graph.platform) or (number is None and not hung):
            arm = place - self.graph.platform_origin
            x, y, z = arm
            by_twist[:3, :3], by_twist[3:, 3:] = np.eye(3), np.eye(3)
            by_twist[:3, 3:] = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
        return by_joints[:rows], by_twist[:rows]

    def plan(self, kept: Sequence[int], solve: Sequence[int], bind: Sequence[int]) -> LegPlan:
        """What is fixed about the leg, with the coordinates that are kept and the equations that count."""
        bodies, number = [], 0
        for part in self.order:
            joints = []
            for joint in self.graph.parts[part].joints:
                size = 3 if joint.kind == "B" else 1
                own = tuple(k for k in range(size) if number + k in kept)
                joints.append(JointPlan(joint.name, joint.kind, own, joint.name in self.actuated))
                number += size
            bodies.append(BodyPlan(self.graph.parts[part].name, self._side(self.graph.parent(part)), tuple(joints)))
        places = {joint.name: i for i, (joint, _) in enumerate(self.coordinates())}
        places = {name: [*kept].index(i) for name, i in places.items() if i in kept}
        closures = []
        for loop in self.loops:
            if loop.kind == "gear":
                if loop.first not in places:
                    raise ValueError(f"Got the gear {loop.name!r} of a joint that may turn while the platform rests.")
                ends = places[loop.first], places.get(loop.second, -1)
            else:
                ends = self._side(loop.first), PLATFORM if loop.second is None else self._side(loop.second)
            closures.append(ClosurePlan(loop.name, loop.kind, *ends, loop.polynomial))
        return LegPlan(tuple(bodies), tuple(closures), tuple(solve), tuple(bind))

    def _side(self, number: int | None) -> int:
        if number in self.order:
            return self.order.index(number)
        return PLATFORM if number == self.graph.platform else BASE
