"""How far a configuration is from the nearest singularity, along a direction and in all directions."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.matrices import null_vector
from jaxscissor._engine.newton import implicit
from jaxscissor._engine.numerics import Scalar, default_tol, safe_divide
from jaxscissor._engine.programs import one_pose, program
from jaxscissor._engine.pytree import as_arrays, as_floats, pytree
from jaxscissor._engine.types import JointsLike, Number, PoseLike, PyTree, TwistLike
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.kinematics._constraints import constrained_pose
from jaxscissor.kinematics._inverse import inverse_kinematics
from jaxscissor.kinematics._legs import place, solve_legs
from jaxscissor.kinematics._solution import Status
from jaxscissor.regions._regions import Box
from jaxscissor.robots._contract import (
    Mechanism,
    checked_freedoms,
    checked_joints,
    checked_pose,
    closure,
    constraints_on,
    joints_together,
)
from jaxscissor.singularities._measures import closure_matrix, leg_columns, passive_columns, small_determinant

_SLOTS = 16  # nearest singularities that are improved side by side
_SHARES = (1.0, 0.5, 0.2, 0.05)  # of the way from the direction of a walk to the locus's normal
_TURNS = 12
_NEWTON_STEPS = 8  # from the point before; where they do not suffice, the step is halved


@pytree
class SingularityDistance:
    """Way to a singularity, or of a batch under ``vmap``.

    Attributes:
      distance: root of the squared translation and the squared rotation times ``angle_length``; infinite if no
        singularity lies within ``max_distance``.
      translation: ``()``, in the robot's unit of length.
      rotation: ``()`` angle in radians; of a robot with constraints both are of the coordinates that are not dependent.
      pose, joints: ``(d,)`` and ``(n,)``, the singular configuration; the given one if there is none.
      kind: 1 or 2, the type of the singularity; 0 if there is none.
      leg: the leg of a type-1 singularity, else -1.
      status: of ``inverse_kinematics`` at the given pose; unless ``CONVERGED`` the lengths are ``nan``.
    """

    distance: jax.Array
    translation: jax.Array
    rotation: jax.Array
    pose: jax.Array
    joints: jax.Array
    kind: jax.Array
    leg: jax.Array
    status: jax.Array


def distance(
    robot: Mechanism,
    pose: PoseLike,
    *,
    direction: TwistLike | None = None,
    max_distance: Number | None = None,
    joints: JointsLike | None = None,
    angle_length: Number | None = None,
    directions: int = 256,
    steps: int | None = None,
) -> SingularityDistance:
    """Distance to the nearest singularity of either type, or to the first one along a direction.

    In all directions, walks along evenly spread ones find the singularities around, in a weighted metric of poses;
    from the nearest the walk is turned towards the normal of the locus until both agree, the condition of a nearest
    point. The answer is the end of a walk that is regular as far as it goes and meets a singularity there; a
    singularity that only a narrow cone of directions meets can be missed.

    Along one direction, a screw motion of the platform, the joints are followed in steps, so that a working mode other
    than home's is kept, and the end of the way is narrowed down by bisection. Two singularities of one kind closer
    than a step can be missed. Limits of the joints do not count, and may be nearer.

    A robot with constraints on its pose moves along the coordinates that are not ``dependent``, which the constraints
    complete; these are what is walked along and measured. Where the constraints end, the platform is loose.

    Args:
      robot: the robot.
      pose: ``(d,)``; of a robot with constraints one that meets them.
      direction: ``(d,)`` twist (velocity, angular velocity) in the base frame, of any length but zero; of a robot with
        constraints rates of its coordinates, of which the dependent ones do not count. Default: all.
      max_distance: how far to look. Default: the robot's length.
      joints: ``(n,)`` where the working mode is not home's.
      angle_length: length that a turn by one radian counts as. Default: the robot's length.
      directions: number of walks without a direction, rounded up to a multiple of 64.
      steps: of each walk. Default: 64 along a direction, 32 in all.

    Returns:
      ``singularities.SingularityDistance``. Of it only ``distance`` has derivatives, by the robot, the pose and
      ``angle_length``: those of the least distance with its direction held fixed, which are its own (envelope theorem);
      zero where there is no singularity.

    Raises:
      ValueError: wrong shapes, a robot with constraints that names no ``dependent`` coordinates, or one with more or
        fewer actuated joints than freedoms.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.NavaroII.prototype(mode=8)
      >>> nearest = js.singularities.distance(robot, [45.0, 26.0, 0.2])  # loose where it is not turned: 0.2 rad away
      >>> print(f"{float(nearest.rotation):.3f} {int(nearest.kind)}")
      0.200 2
      >>> tse = js.TripleScissorExtender.prototype()
      >>> above = js.singularities.distance(tse, tse.home()[0], direction=[0, 0, 1.0, 0, 0, 0])
      >>> int(above.kind), bool(above.rotation == 0)
      (1, True)
    """
    given = {"max_distance": max_distance, "joints": joints, "angle_length": angle_length}
    if direction is None:
        return _nearest(robot, pose, **given, directions=directions, steps=32 if steps is None else steps)
    return _first_along(robot, pose, direction, **given, steps=64 if steps is None else steps)


@one_pose()
def _first_along(
    robot: Mechanism,
    pose: PoseLike,
    direction: TwistLike,
    *,
    max_distance: Number | None,
    joints: JointsLike | None,
    angle_length: Number | None,
    steps: int,
) -> SingularityDistance:
    robot, pose, where, far, angle = _checked(robot, pose, joints, max_distance, angle_length)
    (direction,) = as_arrays(direction)
    if direction.shape != pose.shape:
        raise ValueError(f"Got a direction of shape {direction.shape}; expected a twist of shape {pose.shape}.")
    direction = direction.astype(pose.dtype)[jnp.array(_free(robot))]
    return _along(robot, pose, direction, far, where, angle, jnp.asarray(steps))


@program("directions")
def _nearest(
    robot: Mechanism,
    pose: PoseLike,
    *,
    max_distance: Number | None,
    joints: JointsLike | None,
    angle_length: Number | None,
    directions: int,
    steps: int,
) -> SingularityDistance:
    robot, pose, where, far, angle = _checked(robot, pose, joints, max_distance, angle_length)
    return _in_all_directions(robot, pose, far, where, angle, directions, jnp.asarray(steps))


def _checked(
    robot: Mechanism,
    pose: PoseLike,
    joints: JointsLike | None,
    max_distance: Number | None,
    angle_length: Number | None,
) -> tuple[Mechanism, jax.Array, jax.Array | None, Scalar, Scalar]:
    robot, pose = checked_pose(robot, pose)
    checked_freedoms(robot)
    if not robot.dependent and constraints_on(robot, *robot.space.place(pose)):
        raise ValueError(
            f"Got a {type(robot).__name__} with constraints on its pose; expected that it names in dependent the "
            "coordinates that they determine."
        )
    if joints is not None:
        joints = checked_joints(robot, joints)
    max_distance = robot.length if max_distance is None else max_distance
    angle_length = robot.length if angle_length is None else angle_length
    return as_floats(robot, pose, joints, max_distance, angle_length)


class _Start(NamedTuple):
    """Where walks begin, and what a unit of each free coordinate of a twist counts as."""

    pose: jax.Array
    position: Vec
    rotation: Rotation
    joints: jax.Array
    metric: jax.Array


class _Walk(NamedTuple):
    """End of a walk; the normal of the locus there."""

    distance: Scalar
    step: jax.Array  # (free,) from the start, in lengths
    normal: jax.Array  # (free,)
    joints: jax.Array
    kind: Scalar
    leg: Scalar


def _start(robot: Mechanism, pose: jax.Array, joints: jax.Array | None, angle_length: Scalar) -> tuple[_Start, Scalar]:
    solution = inverse_kinematics(robot, pose, guess=joints)
    return _begun(robot, pose, solution.value, angle_length), solution.status


def _begun(robot: Mechanism, pose: jax.Array, joints: jax.Array, angle_length: Scalar) -> _Start:
    metric = jnp.where(jnp.array(_free(robot)) < robot.space.translations, 1, angle_length)
    return _Start(pose, *robot.space.place(pose), joints, metric)


def _along(
    robot: Mechanism,
    pose: jax.Array,
    direction: jax.Array,
    max_distance: Scalar,
    joints: jax.Array | None,
    angle_length: Scalar,
    steps: jax.Array,
) -> SingularityDistance:
    moving = robot, pose, angle_length
    robot, pose, direction, max_distance, joints, angle_length = lax.stop_gradient(
        (robot, pose, direction, max_distance, joints, angle_length)
    )
    start, status = _start(robot, pose, joints, angle_length)
    return _result(robot, start, _walk(robot, start, direction * start.metric, max_distance, steps), status, moving)


def _in_all_directions(
    robot: Mechanism,
    pose: jax.Array,
    max_distance: Scalar,
    joints: jax.Array | None,
    angle_length: Scalar,
    directions: int,
    steps: jax.Array,
) -> SingularityDistance:
    """The nearest end of walks in many directions.

    1. Walk in directions that are evenly spread, and keep the nearest few.
    2. Turn each of them towards the normal of the locus that it met, by several shares of the way, and walk again no
       farther than it came; keep what is nearer. Where the direction is the normal, the distance is least.
    """
    moving = robot, pose, angle_length
    robot, pose, max_distance, joints, angle_length = lax.stop_gradient(
        (robot, pose, max_distance, joints, angle_length)
    )
    start, status = _start(robot, pose, joints, angle_length)
    tries, size = len(_SHARES), len(_free(robot))
    rounds = -(-directions // (tries * _SLOTS))
    spread = _spread(rounds * tries * _SLOTS, start.metric).reshape(rounds, tries, _SLOTS, size)
    shares = jnp.asarray(_SHARES, pose.dtype)[:, None, None]

    def improve(number: jax.Array, walks: _Walk):
        """First look around, then turn each of the nearest towards the normal of the locus it met."""
        ahead, aim = (_unit(x) for x in (walks.step, walks.normal))
        aim = aim * jnp.sign(jnp.sum(aim * ahead, axis=1, keepdims=True))
        turned = shares * aim[None] + (1 - shares) * ahead[None]
        look = number < rounds
        ways = jnp.where(look, spread[jnp.minimum(number, rounds - 1)], turned)
        reaches = jnp.where(look, max_distance, jnp.minimum(1.01 * walks.distance, max_distance))
        far = jnp.broadcast_to(reaches, (tries, _SLOTS))
        tried = jax.vmap(jax.vmap(lambda way, far: _walk(robot, start, way, far, steps)))(ways, far)
        choices = jax.tree.map(lambda old, new: jnp.concatenate([old[None], new]), walks, tried)
        return jax.tree.map(lambda leaf: leaf[jnp.argmin(choices.distance, axis=0), jnp.arange(_SLOTS)], choices)

    nowhere = jnp.zeros((_SLOTS, size), pose.dtype)
    none = jnp.zeros(_SLOTS, jnp.int32)
    joined = jnp.broadcast_to(start.joints, (_SLOTS, *start.joints.shape))
    unmet = _Walk(jnp.full(_SLOTS, jnp.inf, pose.dtype), nowhere, nowhere, joined, none, none - 1)
    walks = lax.fori_loop(0, rounds + _TURNS, improve, unmet)
    return _result(robot, start, jax.tree.map(lambda leaf: leaf[jnp.argmin(walks.distance)], walks), status, moving)


def _unit(vectors: jax.Array) -> jax.Array:
    return vectors * safe_divide(1, jnp.linalg.norm(vectors, axis=-1, keepdims=True))


def _spread(count: int, metric: jax.Array) -> jax.Array:
    """Evenly spread directions, those of the axes first."""
    axes = jnp.eye(len(metric), dtype=metric.dtype)
    cube = Box(jnp.zeros_like(metric), jnp.ones_like(metric)).quasi_random(count)[:]
    return jnp.concatenate([axes, -axes, jax.scipy.special.ndtri(cube)])[:count]


class _Seen(NamedTuple):
    """What a walk sees at a point."""

    joints: jax.Array
    kept: jax.Array  # (legs,) whether each leg has stayed in its working mode
    type1: jax.Array  # (legs,) signs of the determinants of the legs' own closure
    type2: Scalar  # determinant of the closure by twist and passive joints
    matrix: jax.Array  # the closure's derivative by twist and all joints


class _Way(NamedTuple):
    """A walk under way."""

    count: Scalar
    low: Scalar  # how far it has come
    width: Scalar  # of the next step
    seen: _Seen  # at the last regular point
    kept: jax.Array  # (legs,) at the last point that was not regular
    ended: Scalar  # whether something ends within the next step
    found: Scalar  # whether it is narrowed down to rounding
    probes: jax.Array  # (2 d,) determinants of type 2 around the end


def _walk(robot: Mechanism, start: _Start, direction: jax.Array, max_distance: Scalar, steps: Scalar) -> _Walk:
    """Follow the joints until a determinant changes sign or a mode ends, then halve the step until it is negligible.

    All points are seen in one place of one loop, as what sees them is long to compile:

    1. Look a step ahead: solve the legs there from the joints at the last regular point, and form the determinants.
    2. If every leg is in its mode and no determinant has changed its sign, go there.
    3. If not, something ends within the step: halve it. Once it is negligible, look four of them ahead. What is regular
       there was a failure of Newton's method though nothing ends, and the walk goes on with the widest step.
    4. If it is not, the end is found: look at two points about it along every coordinate. Their differences are the
       normal of a type-2 locus; that of a type-1 locus follows from the leg that stops there (``_edge_normal``).
    """
    size, dtype = direction.shape[0], direction.dtype
    direction, eps = _unit(direction), float(jnp.finfo(dtype).eps)
    widest = max_distance / steps.astype(dtype)
    around = jnp.concatenate([jnp.eye(size, dtype=dtype), -jnp.eye(size, dtype=dtype)])
    around = around * robot.length * eps ** (1 / 3)

    def unfinished(way: _Way):
        walking = ~way.found & (way.low < max_distance) & (way.count < 8 * steps)
        return jnp.isfinite(max_distance) & (walking | (way.found & (way.count < 2 * size)))

    def go(way: _Way) -> _Way:
        last = way.width < eps**0.5 * widest
        ahead = jnp.where(way.count < 0, 0, way.low + jnp.where(last, 4, 1) * way.width)
        look = jnp.where(way.found, way.low * direction + around[way.count % (2 * size)], ahead * direction)
        seen = _look(robot, start, look, way.seen.joints)
        same = (seen.type1 == way.seen.type1) & seen.kept
        regular = (way.count < 0) | (jnp.all(same) & (jnp.sign(seen.type2) == jnp.sign(way.seen.type2)))
        moved = ~way.found & regular
        found = way.found | (last & ~regular & (way.count >= 0))
        ended = (way.ended | ~regular) & ~(last & regular)
        return _Way(
            count=jnp.where(found & ~way.found, 0, way.count + 1),
            low=jnp.where(moved, ahead, way.low),
            width=jnp.where(last & regular, widest, jnp.where(ended, way.width / 2, way.width)),
            seen=jax.tree.map(lambda new, old: jnp.where(moved, new, old), seen, way.seen),
            kept=jnp.where(way.found | regular, way.kept, same),
            ended=ended,
            found=found,
            probes=jnp.where(way.found, way.probes.at[way.count % (2 * size)].set(seen.type2), way.probes),
        )

    blank = jax.eval_shape(partial(_look, robot, start), direction, start.joints)
    blank = _Seen(start.joints, *(jnp.zeros(x.shape, x.dtype) for x in blank[1:]))
    no, zero = jnp.asarray(False), jnp.zeros_like(max_distance)
    first = _Way(jnp.int32(-1), zero, widest, blank, blank.kept, no, no, jnp.zeros(2 * size, dtype))
    way = lax.while_loop(unfinished, go, first)
    type2 = jnp.all(way.kept)
    leg = jnp.argmin(way.kept).astype(jnp.int32)
    step = way.low * direction
    slope = jnp.nan_to_num(way.probes[:size] - way.probes[size:])
    normal = jnp.where(type2, slope, _edge_normal(robot, start, step, way.seen, leg))
    return _Walk(
        distance=jnp.where(way.found, way.low, jnp.inf),
        step=jnp.where(way.found, step, 0),
        normal=normal,
        joints=jnp.where(way.found, way.seen.joints, start.joints),
        kind=jnp.where(way.found, jnp.where(type2, 2, 1), 0).astype(jnp.int32),
        leg=jnp.where(way.found & ~type2, leg, -1),
    )


def _look(robot: Mechanism, start: _Start, step: jax.Array, joints: jax.Array) -> _Seen:
    (position, rotation), met = _moved(robot, start, step)
    pose = jnp.stack(robot.space.coordinates(position, rotation))
    placed = place(robot, pose)
    legs, _ = solve_legs(robot, placed, joints, default_tol(pose.dtype), _NEWTON_STEPS)
    joints = joints_together(robot, legs.value)
    matrix = fence(closure_matrix(robot, placed.position, placed.rotation, joints))  # every minor reads it
    d = robot.space.dimension
    type1 = jnp.stack([small_determinant(_own(matrix, jnp.array(c) - d, d)) for c in leg_columns(robot)])
    type2 = small_determinant(matrix[:, jnp.array([*range(d), *passive_columns(robot)])])
    type2 = jnp.where(met, type2, jnp.nan)  # of no sign: the walk ends where the constraints do
    return _Seen(joints, legs.converged, jnp.sign(type1), type2, matrix)


def _own(matrix: jax.Array, places: jax.Array, dimension: int) -> jax.Array:
    """A leg's equations by its own joints."""
    return matrix[places][:, places + dimension]


def _free(robot: Mechanism) -> np.ndarray:
    """Places of the coordinates that the constraints leave free."""
    return np.array([i for i, name in enumerate(robot.space.names) if name not in robot.dependent])


def _moved(robot: Mechanism, start: _Start, step: jax.Array) -> tuple[tuple[Vec, Rotation], Scalar]:
    """Where a step leads, along a twist or where coordinates are dependent along the free ones; whether it exists."""
    if not robot.dependent:
        return robot.space.retract(start.position, start.rotation, tuple(step / start.metric)), True
    whole = constrained_pose(robot, start.pose.at[jnp.array(_free(robot))].add(step / start.metric))
    return robot.space.place(whole.value), whole.converged


def _edge_normal(robot: Mechanism, start: _Start, step: jax.Array, seen: _Seen, leg: Scalar) -> jax.Array:
    """Normal of the poses that a leg reaches: A dx + B dq = 0, with u B = 0, leaves u A dx = 0."""
    places = jnp.stack([jnp.array(c) - robot.space.dimension for c in leg_columns(robot)])[leg]
    left = null_vector(_own(seen.matrix, places, robot.space.dimension).T)

    def along(step: jax.Array):
        return left @ jnp.stack(closure(robot, robot.legs(), seen.joints, *_moved(robot, start, step)[0]))[places]

    return jax.grad(along)(step)


def _result(
    robot: Mechanism, start: _Start, walk: _Walk, status: Scalar, moving: tuple[Mechanism, jax.Array, Scalar]
) -> SingularityDistance:
    shift = jnp.array(_free(robot)) < robot.space.translations
    twist = walk.step / start.metric
    translation, rotation = (jnp.linalg.norm(jnp.where(part, twist, 0)) for part in (shift, ~shift))
    reached = jnp.stack(robot.space.coordinates(*_moved(robot, start, walk.step)[0]))
    met = walk.kind > 0
    pose = jnp.where(met, reached, start.pose)
    known = status == Status.CONVERGED
    root = (jnp.where(met, walk.distance, 0),)
    (length,) = implicit(_off_the_locus, root, met & known, (*moving, lax.stop_gradient((pose, walk))))
    distance = jnp.where(met, length, jnp.inf)
    distance, translation, rotation = (jnp.where(known, x, jnp.nan) for x in (distance, translation, rotation))
    kind, leg = (jnp.where(known, x, y).astype(jnp.int32) for x, y in ((walk.kind, 0), (walk.leg, -1)))
    return SingularityDistance(distance, translation, rotation, pose, walk.joints, kind, leg, status)


def _off_the_locus(length: tuple[Scalar], args: PyTree) -> tuple[Scalar]:
    """What is zero where a walk of this length in a fixed direction ends on the locus that it met.

    Type 2: the determinant by twist and passive joints, all joints following the pose. Type 1: u F with the leg's left
    null vector u and its joints held, for by these u F does not change.
    """
    robot, pose, angle_length, (end, walk) = args
    start = _begun(robot, pose, walk.joints, angle_length)
    ahead = _unit(walk.step / lax.stop_gradient(start.metric) * start.metric)  # the twist is held, not its components
    (position, rotation), _ = _moved(robot, start, length[0] * ahead)
    joints = inverse_kinematics(robot, jnp.stack(robot.space.coordinates(position, rotation)), guess=walk.joints).value
    d = robot.space.dimension
    matrix = closure_matrix(robot, position, rotation, joints)
    type2 = small_determinant(matrix[:, jnp.array([*range(d), *passive_columns(robot)])])
    places = jnp.stack([jnp.array(c) - d for c in leg_columns(robot)])[walk.leg]
    there, turned = robot.space.place(end)
    left = null_vector(_own(lax.stop_gradient(closure_matrix(robot, there, turned, walk.joints)), places, d).T)
    type1 = left @ jnp.stack(closure(robot, robot.legs(), walk.joints, position, rotation))[places]
    return (jnp.where(walk.kind == 2, type2, type1),)
