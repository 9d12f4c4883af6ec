"""A robot as a MuJoCo model."""

from __future__ import annotations

from typing import Literal
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from jaxscissor._engine.types import JointsLike, Numbers, PoseLike
from jaxscissor.export._masses import LIGHT, THICKNESS, Mass, masses_of, moved_mass
from jaxscissor.export._posed import Posed, in_space, posed
from jaxscissor.export._tree import TOP, WORLD, Drive, Joint, Tree, bar_name, tree_of
from jaxscissor.export._xml import add, text_of
from jaxscissor.robots._contract import Mechanism, actuated_mask
from jaxscissor.statics._balance import per_actuator
from jaxscissor.statics._load import Load
from jaxscissor.statics._materials import Section

_SOLIMP = "0.9999 0.9999 0.001 0.5 2"  # of closures, nearly rigid
_FREQUENCY = 50.0  # rad/s, of all that is moved, on one position actuator
_KINDS = {"turn": "hinge", "slide": "slide", "ball": "ball"}
_COLORS = ("0.11 0.16 0.29 1", "0.18 0.5 0.58 1", "0.79 0.54 0.11 1", "0.48 0.23 0.41 1")


def to_mjcf(
    robot: Mechanism,
    pose: PoseLike | None = None,
    *,
    joints: JointsLike | None = None,
    actuators: Literal["position", "force"] = "position",
    actuator_stiffness: Numbers | None = None,
    section: Section | None = None,
    load: Load | None = None,
) -> str:
    """The robot as a MuJoCo model: bars, pins, slides, loop closures and actuators, assembled at a pose.

    The platform is a body of the base with its pose as joints, free in space; bars hang from the base as a tree, and
    ``equality`` constraints close the loops. Numbers in names count from 0 as in the arrays: body ``leg0_bar2`` is
    ``legs()[0].bars(...)[2]``, joint, tendon and actuator ``q3`` are entry 3 of all joints, and have its value.
    A joint that is no freedom of one connection is a tendon: a sum of two slides, or a distance. Contacts are off.
    Closures are soft in MuJoCo: they give way under load by a little, not without.

    Args:
      robot: the robot, whose legs say by ``connections`` how their bars hang together.
      pose: ``(d,)`` at which it is assembled, where all ``ref`` and the first keyframe are. Default: home.
      joints: ``(n,)`` there. Default: those of the home mode.
      actuators: ``"position"`` actuators, in the order of ``robot.actuated``, take the actuated joints as controls, the
        first keyframe holds those of the pose; ``"force"`` actuators take forces.
      actuator_stiffness: ``()`` or ``(m,)`` force per length, or moment per radian, of position actuators, which are
        critically damped. Default: such that all that is moved would swing at 50 rad/s on one. Stiff actuators make for
        short time steps.
      section: of the bars. Default: they weigh nothing, by ``gravcomp``.
      load: masses of platform and payload, and gravity. Default: no masses.

    Returns:
      The text of an XML file, for ``mujoco.MjModel.from_xml_string``.

    Raises:
      ValueError: wrong shapes; a leg without ``connections``; a pose that the home mode does not reach; an unknown kind
        of actuators; a robot that is being traced.

    Example:
      >>> import jaxscissor as js
      >>> text = js.export.to_mjcf(js.StewartGough.prototype(), load=js.statics.Load(payload=10.0))
      >>> text.count("<connect"), text.count("<position")
      (6, 6)
    """
    if actuators not in ("position", "force"):
        raise ValueError(f"Got actuators = {actuators!r}; expected 'position' or 'force'.")
    state = posed(robot, pose, joints, section)
    load = Load() if load is None else load
    tree = tree_of(robot, state, loose_platform=True)
    masses = masses_of(state, tree.bodies, load)
    driven = [drive for drive, used in zip(tree.drives, actuated_mask(robot), strict=True) if used]
    inertias = [moved_mass(masses) * (state.length**2 if drive.angular else 1.0) for drive in driven]
    stiffness = np.array(inertias) * _FREQUENCY**2 if actuator_stiffness is None else actuator_stiffness
    gains = np.asarray(per_actuator(robot, "actuator_stiffness", stiffness, state.joints.dtype))

    root = ElementTree.Element("mujoco", model=type(robot).__name__)
    add(root, "compiler", angle="radian")
    step, gravity = _timestep(inertias, gains), text_of(load.gravity)
    option = add(
        root, "option", timestep=text_of([step]), gravity=gravity, integrator="implicitfast", tolerance="1e-12"
    )
    add(option, "flag", contact="disable")
    default = add(root, "default")
    add(default, "geom", contype="0", conaffinity="0", group="1")
    add(default, "equality", solref=text_of([2 * step, 1.0]), solimp=_SOLIMP)
    _add_bodies(add(root, "worldbody"), state, tree, masses, driven)
    _add_tendons(root, driven)
    _add_equality(root, state, tree)
    _add_actuators(root, driven, gains if actuators == "position" else None)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode")


def _timestep(inertias: list[float], gains: np.ndarray) -> float:
    """MuJoCo's own 2 ms, or the third of a radian in which the lightest driven body would swing on its actuator."""
    return float(min(0.002, 0.33 / np.sqrt(gains / (LIGHT * np.array(inertias))).max()))


def _add_bodies(world: Element, state: Posed, tree: Tree, masses: dict[str, Mass], driven: list[Drive]) -> None:
    """Rails of the base, and all bodies, nested; the platform has its own frame, the others that of the base."""
    radius = THICKNESS * state.length
    for leg in state.legs:
        for start, end in leg.rails:
            _add_rod(world, start, end, 0.7 * radius, "0.7 0.7 0.7 1")
    bars = {bar_name(i, k): (i, bar) for i, leg in enumerate(state.legs) for k, bar in enumerate(leg.bars)}
    elements = {WORLD: (world, np.zeros(3), np.eye(3))}
    for body in tree.bodies:
        parent, origin, turned = elements[body.parent]
        frame = state.rotation if body.name == TOP else np.eye(3)
        place, axes = turned.T @ (body.point - origin), turned.T @ frame
        element = add(parent, "body", name=body.name, pos=text_of(place), xyaxes=text_of(axes[:, :2].T.ravel()))
        elements[body.name] = element, body.point, frame
        mass = masses[body.name]
        if mass.weightless:
            element.set("gravcomp", "1")
        for joint in body.joints:
            motor = LIGHT * moved_mass(masses) * (state.length**2 if joint.kind == "turn" else 1.0)
            _add_joint(element, joint, frame, motor)
        _add_inertial(element, mass, body.point, frame)
        if body.name in bars:
            leg, ends = bars[body.name]
            start, end = ends - body.point
            _add_rod(element, start, end, radius, _COLORS[leg % len(_COLORS)])
        elif body.name == TOP:
            tips = [frame.T @ (in_space(leg.connections[-1].point) - body.point) for leg in state.legs]
            for start, end in zip(tips, tips[1:] + tips[:1], strict=True):
                _add_rod(element, start, end, 1.5 * radius, "0.1 0.1 0.1 1")
        else:
            add(element, "geom", type="sphere", size=text_of([1.5 * radius]), rgba="0.4 0.4 0.4 1")
    for drive in driven:
        if drive.between is not None:
            for name, point in zip((WORLD, TOP), drive.between, strict=True):
                element, origin, frame = elements[name]
                add(element, "site", name=f"q{drive.number}_{name}", pos=text_of(frame.T @ (point - origin)))


def _add_joint(element: Element, joint: Joint, frame: np.ndarray, motor: float) -> None:
    """A joint, and the inertia of the motor behind it where there is one."""
    if joint.kind == "free":
        add(element, "freejoint", name=joint.name)
        return
    found = add(element, "joint", name=joint.name, type=_KINDS[joint.kind])
    if joint.kind != "ball":
        found.set("axis", text_of(frame.T @ joint.axis))
        found.set("ref", text_of([joint.value]))
        if joint.driven:
            found.set("armature", text_of([motor]))


def _add_inertial(element: Element, mass: Mass, origin: np.ndarray, frame: np.ndarray) -> None:
    inertia = frame.T @ mass.inertia @ frame
    entries = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    center = text_of(frame.T @ (mass.center - origin))
    add(element, "inertial", pos=center, mass=text_of([mass.mass]), fullinertia=text_of(entries))


def _add_rod(element: Element, start: np.ndarray, end: np.ndarray, radius: float, color: str) -> None:
    if np.linalg.norm(end - start) > 1e-6 * radius:
        ends = text_of([*start, *end])
        add(element, "geom", type="capsule", fromto=ends, size=text_of([radius]), rgba=color)
    else:
        add(element, "geom", type="sphere", pos=text_of(start), size=text_of([2 * radius]), rgba=color)


def _add_tendons(root: Element, driven: list[Drive]) -> None:
    """What is a joint of the robot but not of one body."""
    tendons = add(root, "tendon")
    for drive in driven:
        if drive.between is not None:
            tendon = add(tendons, "spatial", name=f"q{drive.number}")
            for name in (WORLD, TOP):
                add(tendon, "site", site=f"q{drive.number}_{name}")
        elif _is_sum(drive):
            tendon = add(tendons, "fixed", name=f"q{drive.number}")
            for name, factor in drive.terms.items():
                add(tendon, "joint", joint=name, coef=text_of([factor]))


def _is_sum(drive: Drive) -> bool:
    return list(drive.terms.items()) != [(f"q{drive.number}", 1.0)]


def _add_equality(root: Element, state: Posed, tree: Tree) -> None:
    """Closures, and slides that move alike; a turn whose loop leaves its plane is held in two points of its axis."""
    equality = add(root, "equality")
    bodies = {body.name: body for body in tree.bodies}
    for closure in tree.closures:
        first, second = ("world" if name == WORLD else name for name in (closure.first, closure.second))
        if closure.kind == "rigid":
            add(equality, "weld", name=closure.name, body1=first, body2=second)
            continue
        origin, frame = np.zeros(3), np.eye(3)
        if closure.first != WORLD:
            origin = bodies[closure.first].point
            frame = state.rotation if closure.first == TOP else frame
        points = [closure.point]
        if closure.kind == "turn" and not closure.planar:
            arm = closure.axis * 0.05 * state.length
            points = [closure.point - arm, closure.point + arm]
        for i, point in enumerate(points):
            name, anchor = closure.name + "_2" * i, text_of(frame.T @ (point - origin))
            add(equality, "connect", name=name, body1=first, body2=second, anchor=anchor)
    for first, second in tree.geared:
        add(equality, "joint", name=f"{first}_gear", joint1=first, joint2=second, polycoef="0 1 0 0 0")


def _add_actuators(root: Element, driven: list[Drive], gains: np.ndarray | None) -> None:
    """Motors, or position actuators, and the pose as a keyframe."""
    actuators = add(root, "actuator")
    for i, drive in enumerate(driven):
        name = f"q{drive.number}"
        joined = {"tendon" if drive.between is not None or _is_sum(drive) else "joint": name}
        if gains is None:
            add(actuators, "motor", name=name, **joined)
        else:
            add(actuators, "position", name=name, kp=text_of([gains[i]]), dampratio="1", **joined)
    values = [0.0 if gains is None else drive.value for drive in driven]
    add(add(root, "keyframe"), "key", name="pose", ctrl=text_of(values))
