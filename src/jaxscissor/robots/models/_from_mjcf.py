"""Robots from MuJoCo's model files."""

from __future__ import annotations

import pathlib
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from jaxscissor._engine.numerics import default_tol
from jaxscissor._engine.programs import run_once
from jaxscissor._engine.pytree import as_floats, float_dtype
from jaxscissor.robots._contract import Joints, roots_from_start, seen_by_legs
from jaxscissor.robots._kinds import LegOfAnyKind
from jaxscissor.robots._over_legs import one_by_one
from jaxscissor.robots._spaces import SE3, Space
from jaxscissor.robots._subspaces import Subspace
from jaxscissor.robots.models._graph import Graph, GraphLeg
from jaxscissor.robots.models._read import read
from jaxscissor.robots.models._robot import FromModel

_STEPS = 0.1, 0.05, 0.02  # in lengths of the robot and radians, from home to where its closures must hold
_INDEPENDENT = 1e-7  # share of a direction that others leave of it, from which on it counts


def from_mjcf(
    path: str | pathlib.Path, *, platform: str, actuated: Sequence[str] | None = None, base: str = "world"
) -> FromModel:
    """A robot from a MuJoCo model: whatever bodies, joints and closed loops stand between its base and its platform.

    What is left of the mechanism without base and platform falls into pieces: the legs. Each may have loops of its own.
    Bodies hang as in the file; ``connect``, ``weld`` and ``joint`` equalities close the loops. The model's own
    configuration, brought to where its loops close, is home. Read by the package ``mujoco`` (the extra of that name);
    meshes and textures are not opened. Masses, springs, contacts, actuators' gains and tendons are left out.

    Args:
      path: of the file, which includes no others.
      platform: the body whose pose is the robot's.
      actuated: names of the joints that actuators move. Default: those of the model's actuators.
      base: the body in whose frame, as it is at home, poses and dimensions are.

    Returns:
      ``robots.FromModel``. Its pose is that of the platform's body; its joint coordinates are the file's, those of a
      ball tan(angle / 2) times the axis from home, without what only spins a rod about itself. Its space has the
      coordinates that are free at home if the others stay where they are; if not all six, of which some depend on the
      others. Its legs are solved from home by Newton's method.

    Raises:
      ValueError: an unknown body or joint; what cannot be expressed, by name; a motion of an actuated joint that leaves
        the platform at rest; loops that do not close; a singular home.

    Example:
      >>> import tempfile, pathlib, jaxscissor as js
      >>> text = js.export.to_mjcf(js.robots.FiveBar.prototype())
      >>> path = pathlib.Path(tempfile.mkdtemp()) / "five_bar.xml"
      >>> _ = path.write_text(text)
      >>> js.robots.from_mjcf(path, platform="platform", actuated=["q0", "q1"])
      a robot of 2 legs with pose (x, y), actuated by q0, q1
    """
    graph, found, frame = read(pathlib.Path(path), platform, base)
    actuated = found if actuated is None else tuple(actuated)
    known = {joint.name: joint.kind for part in graph.parts.values() for joint in part.joints}
    for name in actuated:
        if known.get(name) not in ("R", "P"):
            raise ValueError(
                f"Got {name!r} as actuated; expected some of {[n for n, k in known.items() if k in 'RP']}."
            )
    legs = graph.legs(actuated)
    if not legs:
        raise ValueError(f"Got a model in which nothing joins {platform!r} to {base!r}.")
    scale = (
        float(np.mean([np.linalg.norm(leg.origin(n) - graph.platform_origin) for leg in legs for n in leg.order]))
        or 1.0
    )
    nearby, _, _ = read(pathlib.Path(path), platform, base, scale)
    if _ranks(legs, scale) != _ranks(nearby.legs(actuated), scale):
        raise ValueError(f"Got {path}, whose configuration is singular; expected one in which no leg is stretched.")
    reduced = [_Reduced(leg, scale) for leg in legs]
    bound = np.concatenate([leg.bound for leg in reduced])
    space = _free_space(bound)
    if space is not None:
        kept = [leg for leg in reduced if not leg.only_guides(space.dimension)]
        robot = _built(graph, kept, frame, space, ())
        if _stays(robot):
            return robot
    rows, columns = _independent(bound), ()
    columns = tuple(sorted(_independent(bound[rows].T)))
    start = 0
    for leg in reduced:
        leg.bind = [leg.rest[row - start] for row in rows if start <= row < start + len(leg.rest)]
        start += len(leg.rest)
    return _built(graph, reduced, frame, SE3, tuple(SE3.names[column] for column in columns))


def _ranks(legs: Sequence[GraphLeg], scale: float) -> list[int]:
    """How many equations are independent: of each leg by its joints, by these and the platform, and of all legs."""
    slopes = [leg.slopes(scale) for leg in legs]
    alone = [len(_independent(matrix)) for own, twist in slopes for matrix in (own, np.hstack([own, twist]))]
    together = np.asarray(block_diag(*(own for own, _ in slopes))), np.concatenate([twist for _, twist in slopes])
    return [*alone, len(_independent(np.concatenate(together, axis=1)))]


class _Reduced:
    """A leg with the coordinates and equations that count.

    1. Of the coordinates, the actuated ones first and those of balls last, all that are independent at home are kept;
       the others are idle, as is the spin of a rod between two balls.
    2. As many equations as that, independent by those coordinates, are what the joints solve.
    3. What the others say of the platform's twist, with the joints following, binds it.
    """

    def __init__(self, leg: GraphLeg, scale: float):
        self.leg = leg
        own, twist = leg.slopes(scale)
        sizes = np.array([scale if joint.kind == "P" else 1.0 for joint, _ in leg.coordinates()])
        own = own * sizes[None]
        ranks = [0 if j.name in leg.actuated else 2 if j.kind == "B" else 1 for j, _ in leg.coordinates()]
        kept: list[int] = []
        for rank in (0, 1, 2):
            kept += _independent(own.T, [i for i, r in enumerate(ranks) if r == rank], kept)
        lost = [joint.name for i, (joint, _) in enumerate(leg.coordinates()) if i not in kept and ranks[i] == 0]
        if lost or not kept:
            raise ValueError(
                f"Got joints {lost} as actuated that move while the platform rests, or a leg without joints; expected "
                "joints whose motion the pose of the platform tells."
            )
        self.kept = sorted(kept)
        self.solve = sorted(_independent(own[:, self.kept]))
        self.rest = [i for i in range(len(own)) if i not in self.solve]
        follow = np.linalg.solve(own[np.ix_(self.solve, self.kept)], twist[self.solve])
        self.bound = (twist[self.rest] - own[np.ix_(self.rest, self.kept)] @ follow) * np.array([scale] * 3 + [1.0] * 3)
        self.bind: list[int] = []

    def only_guides(self, freedoms: int) -> bool:
        """Whether it is the platform itself on joints that no motor moves, which leave it these freedoms."""
        graph, own = self.leg.graph, self.leg.joints
        free = not any(joint.name in self.leg.actuated for joint in own) and len(own) == freedoms
        return free and self.leg.order == [graph.platform] and len(self.leg.loops) == 1


def _independent(rows: np.ndarray, among: Sequence[int] | None = None, taken: Sequence[int] = ()) -> list[int]:
    """Numbers of rows that depend neither on each other nor on those taken, the longest remainder first."""
    among = list(range(len(rows))) if among is None else list(among)
    basis: list[np.ndarray] = []

    def rest(row: np.ndarray) -> np.ndarray:
        for _ in range(2):
            for unit in basis:
                row = row - unit * (unit @ row)
        return row

    for number in taken:
        left = rest(rows[number])
        basis.append(left / np.linalg.norm(left))
    found: list[int] = []
    size = max((np.linalg.norm(row) for row in rows), default=0.0)
    while among:
        lengths = [np.linalg.norm(rest(rows[number])) for number in among]
        best = int(np.argmax(lengths))
        if lengths[best] <= _INDEPENDENT * size:
            break
        left = rest(rows[among[best]])
        basis.append(left / np.linalg.norm(left))
        found.append(among.pop(best))
    return found


def _free_space(bound: np.ndarray) -> Space | None:
    """The coordinates that are free at home, if all motions at home are along such."""
    size = max(1.0, np.abs(bound).max(initial=0.0))
    free = [i for i in range(6) if np.abs(bound[:, i]).max(initial=0.0) <= _INDEPENDENT * size]
    if len(free) != 6 - len(_independent(bound)) or sum(i >= 3 for i in free) == 2 or not free:
        return None
    return SE3 if len(free) == 6 else Subspace(SE3, tuple(SE3.names[i] for i in free))


def _built(graph: Graph, legs: list[_Reduced], frame: np.ndarray, space: Any, dependent: tuple[str, ...]) -> FromModel:
    """The robot: its dimensions by the names of the file, and its plans."""
    bodies, axes, points, anchors, values, strokes = ({} for _ in range(6))
    for reduced in legs:
        leg = reduced.leg
        for number in leg.order:
            part = graph.parts[number]
            parent = graph.parent(number)
            bodies[part.name] = _anchor(leg, parent, leg.origin(number))
            for joint in part.joints:
                axes[joint.name], points[joint.name] = joint.axis, joint.place - leg.origin(number)
                values[joint.name], strokes[joint.name] = joint.value, np.array(joint.stroke)
        for loop in leg.loops:
            sides = [_anchor(leg, number, loop.place) for number in (loop.first, loop.second)]
            anchors[loop.name] = np.zeros((2, 3)) if loop.kind == "gear" else np.stack(sides)
    pose, origin = _home_pose(graph.platform_origin, frame, space)
    plans = tuple(reduced.leg.plan(reduced.kept, reduced.solve, reduced.bind) for reduced in legs)
    leaves = as_floats(bodies, axes, points, anchors, values, strokes, origin, pose)
    return FromModel(*leaves, plans, space, dependent)


def _anchor(leg: GraphLeg, number: Any, place: Any) -> np.ndarray:
    """A place from the point of a part, of the base or of the platform where its pose says."""
    if place is None or number == leg.graph.base:
        return np.zeros(3) if place is None else place
    return place - (leg.graph.platform_origin if number is None else leg.origin(number))


def _home_pose(place: np.ndarray, frame: np.ndarray, space: Any) -> tuple[np.ndarray, np.ndarray]:
    """The platform's pose at home, and the place of a pose of zeros; angles are the body's where they can be."""
    names = space.names
    every: dict[str, float] = dict.fromkeys(SE3.names, 0.0)
    every |= dict(zip("xyz", place, strict=True))
    turned = Rotation.from_matrix(frame)
    angles = [name for name in names if name in SE3.names[3:]]
    if len(angles) == 3:
        every |= dict(zip(SE3.names[3:], turned.as_euler("XYZ"), strict=True))
    elif angles:
        vector = turned.as_rotvec()
        axis = SE3.names[3:].index(angles[0])
        every[angles[0]] = vector[axis] if np.linalg.norm(np.delete(vector, axis)) < 1e-9 else 0.0
    origin = np.array([0.0 if name in names else every[name] for name in "xyz"])
    return np.array([every[name] for name in names]), origin


def _stays(robot: FromModel) -> bool:
    """Whether all closures hold where the joints solve theirs, away from home in some directions.

    A platform that moves otherwise opens them by the square of the step.
    """
    pose = np.asarray(robot.pose)
    size = np.where(np.arange(len(pose)) < robot.space.translations, float(robot.length), 1.0)
    away = np.random.default_rng(0).uniform(-1, 1, (3, len(pose)))
    opened = [[float(_open(robot, *as_floats(pose + step * size * way))) for step in _STEPS] for way in away]
    largest = [next((gap for gap in gaps if np.isfinite(gap)), np.inf) for gaps in opened]  # of steps within reach
    return max(largest) < 10 * default_tol(float_dtype(robot))


@run_once
def _open(robot: FromModel, pose: jax.Array) -> jax.Array:
    """How far the worst closure is open at a pose with the joints that solve theirs."""
    legs, seen = robot.legs(), seen_by_legs(robot, *robot.space.place(pose))
    joints, closed = roots_from_start(legs, seen)
    gaps = [jnp.abs(_gaps(leg, q, one)) for leg, q, one in one_by_one(legs, joints, seen)]
    return jnp.where(jnp.all(closed), jnp.max(jnp.concatenate(gaps)), jnp.inf)


def _gaps(leg: Any, joints: Joints, seen: Any) -> jax.Array:
    """All equations of one leg."""
    if not isinstance(leg, LegOfAnyKind):
        return leg.gaps(joints, seen)
    place = leg.place or 0
    return leg.kinds[place].gaps(joints[: len(leg.kinds[place].actuated)], seen[1 + place])
