"""A robot as a URDF: the tree of its bodies, and the loops that a tree cannot hold as a list beside it."""

from __future__ import annotations

import math
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from jaxscissor._engine.types import JointsLike, PoseLike
from jaxscissor.export._masses import THICKNESS, Mass, masses_of
from jaxscissor.export._posed import Posed, in_space, posed
from jaxscissor.export._tree import TOP, WORLD, Body, Joint, Tree, bar_name, tree_of
from jaxscissor.export._xml import add, text_of
from jaxscissor.robots._contract import Mechanism
from jaxscissor.statics._load import Load
from jaxscissor.statics._materials import Section

_KINDS = {"turn": "continuous", "slide": "prismatic"}


def to_urdf(
    robot: Mechanism,
    pose: PoseLike | None = None,
    *,
    joints: JointsLike | None = None,
    section: Section | None = None,
    load: Load | None = None,
) -> str:
    """The robot as a URDF: a tree of links, zero at a pose, and the loops that were cut as ``loop_closure`` elements.

    URDF knows trees alone. Readers skip what they do not know, so that the closures stand in the same file: each with
    a ``type`` of ``ball``, ``turn`` or ``fixed``, two links, the point in the frame of each, and the axis of a turn in
    that of the first. All frames are parallel to the base at the pose, but ``platform_frame``, which is the platform's.
    Names are those of ``to_mjcf``; joint ``q0_q3`` moves as the sum of the joints 0 and 3 does. A ball is three turns.
    The robot's limits are not exported.

    Args:
      robot: the robot, whose legs say by ``connections`` how their bars hang together.
      pose: ``(d,)`` at which all joints of the file are zero. Default: home.
      joints: ``(n,)`` there. Default: those of the home mode.
      section: of the bars. Default: a tenth of the platform's mass each.
      load: masses of platform and payload. Default: one.

    Returns:
      The text of an XML file.

    Raises:
      ValueError: wrong shapes; a leg without ``connections``; a pose that the home mode does not reach; a robot that is
        being traced.

    Example:
      >>> import jaxscissor as js
      >>> from xml.etree import ElementTree
      >>> file = ElementTree.fromstring(js.export.to_urdf(js.StewartGough.prototype()))
      >>> [closure.get("type") for closure in file.findall("loop_closure")]
      ['ball', 'ball', 'ball', 'ball', 'ball']
    """
    state = posed(robot, pose, joints, section)
    load = Load() if load is None else load
    tree = tree_of(robot, state, loose_platform=False)
    masses = masses_of(state, tree.bodies, load)
    root = ElementTree.Element("robot", name=type(robot).__name__)
    add(root, "link", name=WORLD)
    bars = {bar_name(i, k): bar for i, leg in enumerate(state.legs) for k, bar in enumerate(leg.bars)}
    points = {WORLD: np.zeros(3)}
    geared = {second: first for first, second in tree.geared}
    for body in tree.bodies:
        offset = body.point - points[body.parent]
        points[body.name] = body.point
        _add_joints(root, body, offset, geared, state.length)
        lines = [bars[body.name]] if body.name in bars else _outline(state) if body.name == TOP else []
        _add_link(root, body, masses[body.name], lines, state.length)
    add(root, "link", name=f"{TOP}_frame")
    frame = add(root, "joint", name=f"{TOP}_frame", type="fixed")
    _connect(frame, TOP, f"{TOP}_frame", state.position - points[TOP], state.rotation)
    _add_closures(root, tree, points)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode")


def _add_joints(root: Element, body: Body, offset: np.ndarray, geared: dict[str, str], length: float) -> None:
    """One URDF joint per freedom, with links of next to no mass between them."""
    singles = [single for joint in body.joints for single in _singles(joint)]
    parent = body.parent
    for i, single in enumerate(singles):
        last = i == len(singles) - 1
        child = body.name if last else f"{single.name}_link"
        element = add(root, "joint", name=single.name, type=_KINDS[single.kind])
        _connect(element, parent, child, offset if i == 0 else np.zeros(3), np.eye(3))
        add(element, "axis", xyz=text_of(single.axis))
        if single.kind == "slide":  # a limit is not optional
            add(
                element,
                "limit",
                lower=text_of([-10 * length]),
                upper=text_of([10 * length]),
                effort="1e9",
                velocity="1e9",
            )
        if single.name in geared:
            add(element, "mimic", joint=geared[single.name], multiplier="1", offset="0")
        if not last:
            small = 1e-6
            between = add(root, "link", name=child)
            _add_inertial(between, Mass(small, body.point, small * np.eye(3) * length**2, True), body.point)
        parent = child
    if not singles:
        _connect(add(root, "joint", name=f"{body.name}_fixed", type="fixed"), parent, body.name, offset, np.eye(3))


def _singles(joint: Joint) -> list[Joint]:
    """A joint as turns and slides."""
    if joint.kind != "ball":
        return [joint]
    axes = zip("xyz", np.eye(3), strict=True)
    return [Joint(f"{joint.name}_{name}", "turn", axis, 0.0) for name, axis in axes]


def _connect(element: Element, parent: str, child: str, offset: np.ndarray, turn: np.ndarray) -> None:
    add(element, "parent", link=parent)
    add(element, "child", link=child)
    add(element, "origin", xyz=text_of(offset), rpy=text_of(_roll_pitch_yaw(turn)))


def _roll_pitch_yaw(turn: np.ndarray) -> tuple[float, float, float]:
    """URDF's angles, about fixed axes: Rz(yaw) Ry(pitch) Rx(roll)."""
    pitch = math.atan2(-turn[2, 0], math.hypot(turn[2, 1], turn[2, 2]))
    return math.atan2(turn[2, 1], turn[2, 2]), pitch, math.atan2(turn[1, 0], turn[0, 0])


def _add_link(root: Element, body: Body, mass: Mass, lines: list[np.ndarray], length: float) -> None:
    link = add(root, "link", name=body.name)
    _add_inertial(link, mass, body.point)
    for start, end in lines:
        along, reach = end - start, float(np.linalg.norm(end - start))
        if reach > 0:
            visual = add(link, "visual")
            angles = [0.0, math.acos(along[2] / reach), math.atan2(along[1], along[0])]
            add(visual, "origin", xyz=text_of((start + end) / 2 - body.point), rpy=text_of(angles))
            size = {"radius": text_of([THICKNESS * length]), "length": text_of([reach])}
            add(add(visual, "geometry"), "cylinder", **size)


def _add_inertial(link: Element, mass: Mass, point: np.ndarray) -> None:
    inertial = add(link, "inertial")
    add(inertial, "origin", xyz=text_of(mass.center - point))
    add(inertial, "mass", value=text_of([mass.mass]))
    entries = {f"i{'xyz'[i]}{'xyz'[k]}": text_of([mass.inertia[i, k]]) for i in range(3) for k in range(i, 3)}
    add(inertial, "inertia", **entries)


def _outline(state: Posed) -> list[np.ndarray]:
    tips = [in_space(leg.connections[-1].point) for leg in state.legs]
    return [np.stack(pair) for pair in zip(tips, tips[1:] + tips[:1], strict=True)]


def _add_closures(root: Element, tree: Tree, points: dict[str, np.ndarray]) -> None:
    for closure in tree.closures:
        kind = "fixed" if closure.kind == "rigid" else closure.kind
        element = add(root, "loop_closure", name=closure.name, type=kind)
        for tag, name in (("first", closure.first), ("second", closure.second)):
            add(element, tag, link=name, xyz=text_of(closure.point - points[name]))
        if closure.kind == "turn":
            add(element, "axis", xyz=text_of(closure.axis))
