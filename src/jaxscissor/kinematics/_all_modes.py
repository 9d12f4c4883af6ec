"""All the ways in which a robot can be assembled: the working modes of a pose, the assembly modes of its joints."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.distinct import distinct
from jaxscissor._engine.newton import norm
from jaxscissor._engine.numerics import Scalar, default_tol
from jaxscissor._engine.programs import one_pose, program
from jaxscissor._engine.pytree import as_floats, pytree, static
from jaxscissor._engine.types import JointsLike, Number, PoseLike, PyTree
from jaxscissor._engine.vectors import Vec
from jaxscissor.kinematics._legs import MAX_STEPS, LegResult, closest_joints, place, solve_legs
from jaxscissor.kinematics._platform import State, all_joints, assemble, differentiable_pose, state_at
from jaxscissor.kinematics._solution import Status
from jaxscissor.robots._contract import (
    Mechanism,
    checked_freedoms,
    checked_joints,
    checked_pose,
    joints_by_leg,
    seen_by_legs,
)
from jaxscissor.robots._over_legs import one_by_one
from jaxscissor.robots._spaces import position_size
from jaxscissor.robots._upright import normal_of


@pytree
class WorkingModes:
    """Every joint solution of a pose, leg by leg; the robot's working modes are their product.

    Attributes:
      values: ``(legs, modes, joints of a leg)``, padded.
      valid: ``(legs, modes)``, which entries are solutions.
    """

    values: jax.Array
    valid: jax.Array


@one_pose()
def inverse_kinematics_all(robot: Mechanism, pose: PoseLike) -> WorkingModes:
    """All joint solutions of a pose, of every leg, in closed form.

    For the TSE these are the up to four meeting points of an ellipse and a hyperbola [RAL17 eqs. 10, 13].

    Args:
      robot: the robot; every array in it is differentiable.
      pose: ``(d,)`` in the base frame.

    Returns:
      ``WorkingModes``; entries that are not ``valid`` hold the nearest real point and have zero
      derivative. A pose that is not finite has no valid entry.

    Raises:
      ValueError: wrong shape of the pose, or a robot whose legs have no closed form.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> js.inverse_kinematics_all(robot, robot.home()[0]).valid.sum(axis=1).tolist()
      [4, 4, 4]
    """
    robot, pose = checked_pose(robot, pose)
    placed, tol = place(robot, pose), default_tol(pose.dtype)
    homes, statuses = solve_legs(robot, placed, None, tol, MAX_STEPS)
    values, valid = [], []
    for leg, attachment, home, status in one_by_one(placed.legs, placed.attachments, homes, statuses):
        solutions = leg.solutions(attachment)
        if solutions is None:
            raise ValueError(
                f"{type(leg).__name__} does not know all its solutions. Give it a method solutions(attachment), or "
                "use inverse_kinematics with several guesses."
            )
        closed = jnp.stack([norm(leg.residual(joints, attachment)) <= tol for joints in solutions[0]])
        found = jnp.stack(solutions[1]) & closed
        # the status has decided whether there is any root: within rounding of an edge its verdict counts
        found = jnp.where(status == Status.NO_SOLUTION, False, jnp.where(jnp.any(found), found, closed))
        roots, found = _with_home(jnp.stack([jnp.stack(joints) for joints in solutions[0]]), found, home)
        values.append(roots)
        valid.append(found & placed.finite)
    return WorkingModes(jnp.stack(values), jnp.stack(valid))


def _with_home(roots: jax.Array, found: jax.Array, home: LegResult) -> tuple[jax.Array, jax.Array]:
    """The roots of a leg, with that of the home mode as inverse kinematics has it where it is decided by the reach.

    Where two modes meet, rounding decides whether the closed form sees both or none.
    """
    if home.reach is None:
        return roots, found
    root = jnp.stack(home.root)
    apart = jnp.sum(lax.stop_gradient(roots - root[None]) ** 2, axis=1)
    own = fence(home.solved & (jnp.arange(len(apart)) == jnp.argmin(apart)))  # it decides twice
    return jnp.where(own[:, None], root[None], roots), found | own


@pytree
class AssemblyModes:
    """Every pose that the actuated joints allow.

    Attributes:
      values: ``(modes, d)`` poses, padded.
      valid: ``(modes,)``, which entries are assembly modes.
      joints: ``(modes, n)`` all joints in each mode, the passive ones included.
      count: how many were found, which is more than ``modes`` if they did not fit.
      complete: whether the count is that of an elimination, as opposed to a search.
    """

    values: jax.Array
    valid: jax.Array
    joints: jax.Array
    count: jax.Array
    complete: bool = static()


@program("starts", "modes")
def forward_kinematics_all(
    robot: Mechanism,
    joints: JointsLike,
    *,
    tol: Number | None = None,
    apart: Number | None = None,
    starts: int = 8192,
    modes: int = 40,
    seed: int = 0,
) -> AssemblyModes:
    """All assembly modes: every pose that the actuated joints give the platform, limits of stroke aside.

    Robots that define ``assemblies``, as the TSE, NaVARo II, Tri-Scott and MICABO do, yield all modes. Others are
    searched by Newton's method from many poses, within two of the robot's lengths around home, which may miss some:
    see ``complete``. In either case:

    1. Newton's method on the closure equations, from every pose of the elimination or of the search.
    2. Drop what does not close, and of poses closer than ``apart`` all but one.
    3. Attach the implicit function's derivative to what is left.

    Args:
      robot: the robot; every array in it is differentiable.
      joints: ``(m,)`` the actuated joints.
      tol: closure residual, dimensionless, that counts as zero. Default: by the dtype.
      apart: modes closer than this, in lengths of the robot and entries of the rotation matrix, count as one.
        Default: 64 square roots of the dtype's rounding, as close as two modes can be told apart.
      starts: poses that a search starts from.
      modes: at most so many modes are returned from a search.
      seed: of the poses that a search starts from.

    Returns:
      ``AssemblyModes``; entries that are not ``valid`` have zero derivative. Joints that are not finite, or
      that fit no pose, have no valid entry. Which modes are physically sensible: see ``within_limits``.

    Raises:
      ValueError: wrong shape of the joints; a robot with fewer actuated joints than freedoms.

    Example:
      >>> import jax, jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> modes = js.forward_kinematics_all(robot, robot.home()[1])
      >>> int(modes.count), modes.values.shape, modes.complete
      (16, (16, 6), True)
    """
    checked_freedoms(robot, more=True)
    joints = checked_joints(robot, joints, actuated_only=True)
    robot, joints = as_floats(robot, joints)
    tol = default_tol(joints.dtype) if tol is None else tol
    apart = 64 * float(jnp.finfo(joints.dtype).eps) ** 0.5 if apart is None else apart
    fixed, actuated = lax.stop_gradient((robot, joints))
    finite = jnp.all(jnp.isfinite(joints))
    actuated = jnp.where(finite, actuated, fixed.actuated(fixed.home()[1]))
    known = fixed.assemblies(actuated)
    if known is None:
        poses, valid, steps = _anywhere(fixed, starts, seed), jnp.ones(starts, bool), 60
    else:
        (poses, valid), modes, steps = known, known[1].shape[0], 10

    def polish(pose: jax.Array):
        start = state_at(fixed, pose, closest_joints(fixed, pose, tol))
        state, error, _ = assemble(fixed, actuated, start, tol, steps)
        return state, error <= tol

    states, closed = jax.vmap(polish)(poses)
    place = jax.vmap(lambda state: _location(fixed, state))(states)
    indices, count = distinct(place, closed & valid & finite, apart, modes)
    chosen = jax.tree.map(lambda leaf: leaf[indices], states)
    found = jnp.arange(modes) < count

    def value(state: PyTree, ok: jax.Array):
        pose, passive = differentiable_pose(robot, joints, state, ok)
        return pose, all_joints(robot, joints, State(state.position, state.rotation, passive))

    values, configurations = jax.vmap(value)(chosen, found)
    return AssemblyModes(values, found, configurations, count, known is not None)


def _location(robot: Mechanism, state: State) -> jax.Array:
    """Numbers that two states share only if they are the same pose: position in lengths of the robot, rotation."""
    position = state.position.array() / robot.length
    return jnp.concatenate([position, jnp.broadcast_to(state.rotation.array(), (len(position),) * 2).ravel()])


def _anywhere(robot: Mechanism, count: int, seed: Scalar) -> jax.Array:
    """Random poses about home: positions within a cube of twice the robot's length, all orientations alike."""
    home, _ = robot.home()
    d, linear = robot.space.dimension, robot.space.translations
    unit = jax.random.uniform(jax.random.key(seed), (count, d), home.dtype, -1, 1)
    if d - linear == 3:  # pitch spreads like the sine, so that no axis is preferred
        unit = unit.at[:, -2].set(jnp.arcsin(unit[:, -2]) / jnp.pi)
    shifts = jnp.arange(d) < linear
    scale = jnp.where(shifts, robot.length, jnp.asarray(jnp.pi, home.dtype))
    return jnp.where(shifts, home, 0)[None] + unit * scale[None]


@one_pose()
def within_limits(robot: Mechanism, modes: AssemblyModes) -> jax.Array:
    """Which assembly modes are physically sensible: on home's side of the base, not upside down, within all limits.

    The base is the plane of the legs' first rails, or where they have none the plane z = 0. Upside down is what is
    turned over against home.

    Args:
      robot: the robot.
      modes: of ``forward_kinematics_all``.

    Returns:
      ``(modes,)``; never true where ``modes.valid`` is not.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> modes = js.forward_kinematics_all(robot, robot.home()[1])
      >>> int(js.within_limits(robot, modes).sum())  # yaw 0 and yaw 180 deg
      2
    """
    robot, values, joints = as_floats(robot, modes.values, modes.joints)
    home = robot.space.place(robot.home()[0])
    spatial = position_size(robot.space) == 3

    def sensible(pose: jax.Array, joints: jax.Array):
        position, rotation = robot.space.place(pose)
        seen = seen_by_legs(robot, position, rotation)
        legs = list(one_by_one(robot.legs(), joints_by_leg(robot, joints), seen))
        margins = [margin for leg, q, attachment in legs for margin in leg.margins(q, attachment)]
        if spatial:
            corners = [rails[0][0] for rails in (leg.rails(q, seen) for leg, q, seen in legs) if rails]
            sides = [_side(corners, place) for place in (position, home[0])]
            margins += [sides[0] * sides[1], rotation.columns[2].dot(home[1].columns[2])]
        return jnp.all(jnp.stack([jnp.asarray(m, pose.dtype) for m in margins]) >= 0) if margins else jnp.asarray(True)

    return modes.valid & jax.vmap(sensible)(values, joints)


def _side(corners: Sequence[Vec], position: Vec) -> Scalar:
    """Distance from the plane of three or more corners of the base, else the height."""
    if len(corners) < 3:
        return position.z
    points = jnp.stack([corner.array() for corner in corners])
    return normal_of(points).dot(position - Vec(*jnp.mean(points, axis=0)))
