"""The bodies of a robot as a tree that hangs from the base, and the closures of the loops that were cut for it."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from jaxscissor.export._posed import Posed, PosedLeg, in_space
from jaxscissor.robots._bodies import BASE, PLATFORM, Connection, Freedom
from jaxscissor.robots._contract import Mechanism, joint_places

WORLD, TOP = "base", "platform"
_CUT_LAST = 5


class Joint(NamedTuple):
    """One freedom of a body against its parent, about or along an axis in the base frame; ``free`` has all six."""

    name: str
    kind: Literal["turn", "slide", "ball", "free"]
    axis: np.ndarray
    value: float  # its coordinate at this configuration
    driven: bool = False  # whether joints of the robot are its coordinate


class Body(NamedTuple):
    """A rigid body, held by its parent in a point; joints in order from the parent to it."""

    name: str
    parent: str
    point: np.ndarray
    joints: tuple[Joint, ...]


class Closure(NamedTuple):
    """Two bodies held together that do not hang from one another, in a point, on an axis if they only turn."""

    name: str
    kind: Literal["ball", "turn", "rigid"]
    first: str
    second: str
    point: np.ndarray
    axis: np.ndarray
    planar: bool  # whether the loop moves in a plane across the axis, so that the point alone closes it


class Drive(NamedTuple):
    """What a joint of the robot is: a sum of joints of the tree with factors, or the distance of two points."""

    number: int  # in the array of all joints
    value: float
    angular: bool
    terms: dict[str, float]
    between: tuple[np.ndarray, np.ndarray] | None


class Tree(NamedTuple):
    """Bodies, parents first; closures; names of joints that move alike; every joint of the robot."""

    bodies: list[Body]
    closures: list[Closure]
    geared: list[tuple[str, str]]
    drives: list[Drive]


class _Link(NamedTuple):
    """A connection between named bodies."""

    name: str
    first: str
    second: str
    point: np.ndarray
    joints: tuple[Joint, ...]


def bar_name(leg: int, bar: int) -> str:
    """The body of a bar."""
    return f"leg{leg}_bar{bar}"


def tree_of(robot: Mechanism, state: Posed, *, loose_platform: bool) -> Tree:
    """Hang all bodies from the base.

    1. Name every connection and its freedoms; hang the platform from the base with the freedoms of its space, unless
       these are all six and it is not to be loose.
    2. Keep the connections that are dearest to cut, as long as they close no loop (Kruskal): rigid ones and slides,
       then pins, then pins on slides, then balls, then those of the platform.
    3. Direct what is kept from the base outwards.
    4. Cut the others at their ball or their last turn; freedoms before and after it get carriages of their own.
    """
    links, geared = [], {}
    free = robot.space.dimension == 6
    if loose_platform or not free:
        links.append(_platform_link(robot, state, free))
    for number, leg in enumerate(state.legs):
        links += _links(robot, state, number, leg, geared)
    kept, cut = _spanning(links)
    bodies, closures = _directed(kept), []
    for link in cut:
        carriages, closure = _cut(link)
        bodies += carriages
        closures.append(closure)
    closures = [closure._replace(planar=_is_planar(closure, bodies)) for closure in closures]
    pairs = [(names[0], other) for names in geared.values() for other in names[1:]]
    return Tree(_parents_first(bodies), closures, pairs, _drives(robot, state))


def _platform_link(robot: Mechanism, state: Posed, free: bool) -> _Link:
    """The platform on the base, with its pose's coordinates as joints where there are fewer than six."""
    if free:
        joints = [Joint(TOP, "free", np.eye(3)[2], 0.0)]
    else:
        linear = robot.space.translations
        kinds = ["slide"] * linear + ["turn"] * (robot.space.dimension - linear)
        joints = [
            Joint(f"{TOP}_{name}", kind, axis, float(value))  # type: ignore[arg-type]
            for name, kind, axis, value in zip(robot.space.names, kinds, state.axes, state.pose, strict=True)
        ]
    return _Link(TOP, WORLD, TOP, state.position, tuple(joints))


def _links(
    robot: Mechanism, state: Posed, number: int, leg: PosedLeg, geared: dict[tuple[int, int], list[str]]
) -> list[_Link]:
    """The connections of one leg."""
    places, links = joint_places(robot)[number].tolist(), []
    for connection in leg.connections:
        first, second = (_part_name(number, part) for part in (connection.first, connection.second))
        name = f"leg{number}_{first.removeprefix(f'leg{number}_')}_{second.removeprefix(f'leg{number}_')}"
        joints = []
        for freedom in connection.freedoms:
            joint = _joint(freedom, name, [places[i] for i in freedom.joints], state.joints)
            taken = [other.name for other in joints]
            joint = joint._replace(name=joint.name + "_2" * taken.count(joint.name))
            if freedom.geared is not None:
                geared.setdefault((number, freedom.geared), []).append(joint.name)
            joints.append(joint)
        links.append(_Link(name, first, second, in_space(connection.point), tuple(joints)))
    return links


def _part_name(leg: int, part: int) -> str:
    return {BASE: WORLD, PLATFORM: TOP}.get(part) or bar_name(leg, part)


def _joint(freedom: Freedom, name: str, numbers: list[int], joints: np.ndarray) -> Joint:
    named = "_".join(f"q{i}" for i in numbers)
    axis = np.eye(3)[2] if freedom.axis is None else in_space(freedom.axis)
    value = float(joints[numbers].sum()) if numbers else 0.0
    return Joint(named or f"{name}_{freedom.kind}", freedom.kind, axis, value, bool(numbers))


def _dearness(link: _Link) -> int:
    kinds = [joint.kind for joint in link.joints]
    if TOP in (link.first, link.second):
        return 0 if link.first == WORLD else _CUT_LAST
    if "ball" in kinds:
        return 4
    return 0 if "turn" not in kinds else 2 + ("slide" in kinds)


def _spanning(links: Sequence[_Link]) -> tuple[list[_Link], list[_Link]]:
    group: dict[str, str] = {}

    def root(name: str) -> str:
        while name in group:
            name = group[name]
        return name

    kept, cut = [], []
    for link in sorted(links, key=_dearness):
        first, second = root(link.first), root(link.second)
        if first == second:
            cut.append(link)
        else:
            group[first] = second
            kept.append(link)
    return kept, cut


def _directed(links: Iterable[_Link]) -> list[Body]:
    bodies, reached, left = [], {WORLD}, list(links)
    while left:
        for link in left:
            if link.first in reached:
                bodies.append(Body(link.second, link.first, link.point, link.joints))
            elif link.second in reached:
                bodies.append(Body(link.first, link.second, link.point, _reversed(link.joints)))
            else:
                continue
            reached.add(bodies[-1].name)
            left.remove(link)
            break
        else:
            names = sorted({link.first for link in left} | {link.second for link in left})
            raise ValueError(f"Got connections in which nothing holds {', '.join(names)} to the base or the platform.")
    return bodies


def _reversed(joints: Sequence[Joint]) -> tuple[Joint, ...]:
    """The same freedoms seen from the other body: its coordinates stay the motion of the second against the first."""
    return tuple(joint._replace(axis=-joint.axis) for joint in reversed(joints))


def _cut(link: _Link) -> tuple[list[Body], Closure]:
    """Carriages for all freedoms but the one at which the connection is cut, and its closure."""
    kinds = [joint.kind for joint in link.joints]
    turns = [i for i, kind in enumerate(kinds) if kind in ("ball", "turn")]
    at = turns[-1] if turns else len(kinds)
    first, second, carriages = link.first, link.second, []
    if before := link.joints[:at]:
        first = f"{link.name}_carriage"
        carriages.append(Body(first, link.first, link.point, before))
    if after := link.joints[at + 1 :]:
        second = f"{link.name}_far_carriage"
        carriages.append(Body(second, link.second, link.point, _reversed(after)))
    kind, axis = ("rigid", np.eye(3)[2]) if at == len(kinds) else (kinds[at], link.joints[at].axis)
    return carriages, Closure(link.name, kind, first, second, link.point, axis, False)  # type: ignore[arg-type]


def _is_planar(closure: Closure, bodies: Sequence[Body]) -> bool:
    """Whether all joints around the loop turn about parallel axes, or slide across them."""
    by_name = {body.name: body for body in bodies}

    def ways(name: str) -> list[Body]:
        return [] if name == WORLD else [by_name[name], *ways(by_name[name].parent)]

    first, second = ({body.name for body in ways(name)} for name in (closure.first, closure.second))
    joints = itertools.chain.from_iterable(by_name[name].joints for name in first ^ second)
    across = {"turn": 1.0, "slide": 0.0}
    return all(
        joint.kind in across and abs(abs(joint.axis @ closure.axis) - across[joint.kind]) < 1e-6 for joint in joints
    )


def _parents_first(bodies: Sequence[Body]) -> list[Body]:
    """Depth first, as files nest them."""
    children: dict[str, list[Body]] = {}
    for body in bodies:
        children.setdefault(body.parent, []).append(body)

    def below(name: str) -> list[Body]:
        return [x for body in children.get(name, []) for x in (body, *below(body.name))]

    return below(WORLD)


def _drives(robot: Mechanism, state: Posed) -> list[Drive]:
    """Every joint of the robot, in its order."""
    drives, angular = [], robot.legs().angular
    for places, leg in zip(joint_places(robot).tolist(), state.legs, strict=True):
        sums = sorted({f.joints for c in leg.connections for f in c.freedoms if f.joints})
        members = np.array([[float(i in s) for i in range(len(places))] for s in sums])
        factors = np.linalg.pinv(members.reshape(len(sums), len(places)))
        names = ["_".join(f"q{places[i]}" for i in s) for s in sums]
        for i, number in enumerate(places):
            terms = {name: round(f, 12) for name, f in zip(names, factors[i], strict=True) if abs(f) > 1e-9}
            between = None if terms else _ends(leg.connections)
            drives.append(Drive(number, float(state.joints[number]), bool(angular and angular[i]), terms, between))
    return sorted(drives, key=lambda drive: drive.number)


def _ends(connections: Sequence[Connection]) -> tuple[np.ndarray, np.ndarray]:
    """The leg's first point on the base, and its last on the platform."""
    foot = next(c for c in connections if BASE in (c.first, c.second))
    tip = next(c for c in connections if PLATFORM in (c.first, c.second))
    return in_space(foot.point), in_space(tip.point)
