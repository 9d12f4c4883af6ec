"""How close a configuration is to a singularity, after Gosselin and Angeles: type 1, type 2 and both at once."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.scipy.linalg import block_diag

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.matrices import determinant, null_vector, solve_regular
from jaxscissor._engine.numerics import Scalar, safe_divide, safe_sqrt
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_floats, pytree
from jaxscissor._engine.types import JointsLike, PoseLike
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.kinematics._inverse import inverse_kinematics
from jaxscissor.kinematics._solution import Status
from jaxscissor.robots._contract import (
    Attachment,
    Joints,
    Leg,
    Mechanism,
    actuation,
    angular_by_leg,
    checked_freedoms,
    checked_joints,
    checked_pose,
    constraints_on,
    is_redundant,
    joints_by_leg,
    seen_by_legs,
)
from jaxscissor.robots._over_legs import one_by_one, over_legs


@pytree
class Measures:
    """Measures of one configuration, or of a batch under ``vmap``; all ``nan`` unless ``CONVERGED``.

    Attributes:
      type1: ``(legs,)``, zero where a leg is stretched or folded and its joints can move while the platform
        rests: two working modes meet. Within -1 and 1.
      type2: ``()``, zero where the platform can move while the actuators rest: two assembly modes meet.
        Within -1 and 1.
      constraint: ``()``, zero where the constraints on the pose depend on each other, so that the platform has a
        freedom more whatever the actuators do (a constraint singularity). From 0 to 1, where they are at right
        angles; 1 of a robot without constraints.
      joint_motion: ``(legs, joints of a leg)`` motion of each leg's joints closest to one with the platform at rest;
        of a leg with fewer joints than others it ends in zeros.
      platform_motion: ``(d,)`` twist that the constraints allow, closest to one with the actuators at rest.
      status: see ``inverse_kinematics``.
    """

    type1: jax.Array
    type2: jax.Array
    constraint: jax.Array
    joint_motion: jax.Array
    platform_motion: jax.Array
    status: jax.Array

    @property
    def type3(self) -> jax.Array:
        """Zero where both types meet at once: the sum of the squares of type 2 and the least type 1."""
        return self.type2**2 + jnp.min(self.type1**2, axis=-1)

    @property
    def leg(self) -> jax.Array:
        """The leg that is closest to a type-1 singularity."""
        return jnp.argmin(jnp.abs(self.type1), axis=-1)


@one_pose()
def measures(robot: Mechanism, pose: PoseLike, *, joints: JointsLike | None = None) -> Measures:
    """Type-1 and type-2 singularity measures of a configuration, with the motions that go with them.

    With A and B the derivatives of the closure by twist and actuated joints, the passive joints eliminated,
    A t + B dq = 0, the type-2 measure is det A / sqrt(det(A A^T + B B^T)), and a leg's type-1 measure the
    same with its own B instead of A in front and the platform's translations and its rotations about the leg's
    end in A: coordinates of the space of motions, which are free of the scale of the equations. Lengths count in
    units of the robot's length [RAL17 eqs. 16-18, NAV19 eqs. 1-6]. Of robots with constraints on the pose, these
    stand below A, and their norms in the denominator, so that the type-2 measure is zero also where they, C, depend on
    each other: sqrt(det(C C^T)) over their norms is the measure of constraint singularities [after Zlatanov, Bonev and
    Gosselin]. Of a robot with more actuated joints than freedoms, dq = M t, the type-2 measure is
    sqrt(det M^T M / det(1 + M^T M)), which has no sign.

    Args:
      robot: the robot; every array in it is differentiable.
      pose: ``(d,)`` in the base frame.
      joints: ``(n,)`` all joints, which choose the working mode. Default: those of the home mode.

    Returns:
      ``singularities.Measures``, differentiable across the loci. The signs are those of the robot's equations: what
      counts is whether they differ, as from those at home. The type-2 measure falls with the gearing as well, so that
      small values far from a change of sign mean a weak, not a singular, robot. The motions have norm one with
      lengths in units of the robot's length, no meaningful sign, and no derivative.

    Raises:
      ValueError: wrong shapes; a robot with fewer actuated joints than freedoms.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.NavaroII.prototype(mode=8)
      >>> found = js.singularities.measures(robot, [45.0, 26.0, 0.0])  # similar triangles, not turned: it is loose
      >>> bool(abs(found.type2) < 1e-6), bool((abs(found.type1) > 0.1).all())
      (True, True)
    """
    robot, pose = checked_pose(robot, pose)
    checked_freedoms(robot, more=True)
    if joints is not None:
        joints = checked_joints(robot, joints)
        robot, pose, joints = as_floats(robot, pose, joints)
    return _measured(robot, pose, joints)


def _measured(robot: Mechanism, pose: jax.Array, joints: jax.Array | None) -> Measures:
    if joints is None:
        solution = inverse_kinematics(robot, pose)
        configuration, status = solution.value, solution.status
    else:
        configuration = joints
        status = jnp.where(jnp.all(jnp.isfinite(joints)), Status.CONVERGED, Status.NONFINITE)
    home_pose, home_joints = robot.home()
    usable = jnp.all(jnp.isfinite(pose)) & (status == Status.CONVERGED)
    placed = robot.space.place(jnp.where(usable, pose, home_pose))
    position, rotation = fence(placed)  # every derivative of the closure would evaluate the rotation anew
    type1, type2, matrix = _measures(robot, position, rotation, jnp.where(usable, configuration, home_joints))
    joint_motion, platform_motion = _motions(*lax.stop_gradient((robot, matrix)))
    found = Measures(
        type1=type1,
        type2=type2,
        constraint=_independence(robot, matrix),
        joint_motion=joint_motion,
        platform_motion=platform_motion,
        status=status.astype(jnp.int32),
    )
    return jax.tree.map(lambda x: x if x.dtype == jnp.int32 else jnp.where(usable, x, jnp.nan), found)


def _measures(robot: Mechanism, position: Vec, rotation: Rotation, joints: jax.Array):
    """Both measures at given joints, and the matrix they come from."""
    matrix = fence(closure_matrix(robot, position, rotation, joints))  # both measures and the motions take it apart
    d = robot.space.dimension
    rows = [matrix[columns[0] - d : columns[-1] + 1 - d] for columns in leg_columns(robot)]  # one per joint
    own = [block[:, columns[0] : columns[-1] + 1] for block, columns in zip(rows, leg_columns(robot), strict=True)]
    ends = one_by_one(fence(seen_by_legs(robot, position, rotation)))
    cases = zip(rows, ends, strict=True)
    moved = [_about_its_end(robot, block[:, :d], position, rotation, *end) for block, end in cases]
    if len({block.shape for block in own}) == 1:
        type1 = jax.vmap(_alone)(jnp.stack(own), jnp.stack(moved))
    else:
        type1 = jnp.stack([_alone(*blocks) for blocks in zip(own, moved, strict=True)])
    return type1, _redundant_type2(robot, matrix) if is_redundant(robot) else _type2(robot, matrix), matrix


def _about_its_end(
    robot: Mechanism, by_twist: jax.Array, position: Vec, rotation: Rotation, attachment: Any
) -> jax.Array:
    """The columns of a leg's twist with rotations about the point that it holds, so that those it allows do not count.

    Turning about that point carries the platform's reference point along; the translation that this takes is added.
    """
    linear = robot.space.translations
    vectors = [v for v in jax.tree.leaves(attachment, is_leaf=lambda x: isinstance(x, Vec)) if isinstance(v, Vec)]
    if linear in (0, robot.space.dimension) or not vectors:
        return by_twist
    arm = (vectors[0] - position) * (1 / robot.length)
    body = Vec(*(column.dot(arm) for column in rotation.columns))

    def turned(turn: jax.Array):
        twist = (*(jnp.zeros_like(turn[0]) for _ in range(linear)), *turn)
        return (robot.space.nudge(position, rotation, twist)[1] @ body).array()[:linear]

    carried = -jax.jacfwd(turned)(jnp.zeros(robot.space.dimension - linear, by_twist.dtype))
    return jnp.concatenate([by_twist[:, :linear], by_twist[:, linear:] + by_twist[:, :linear] @ carried], axis=1)


def _alone(own: jax.Array, moved: jax.Array) -> Scalar:
    """The type-1 measure of a leg whose equations move so with its own joints and with the platform."""
    return safe_divide(small_determinant(own), safe_sqrt(small_determinant(_gram(own) + _gram(moved))))


def _gram(rows: jax.Array) -> jax.Array:
    return jnp.sum(rows[:, None] * rows[None], axis=-1)


def _type2(robot: Mechanism, matrix: jax.Array) -> Scalar:
    d, flags = robot.space.dimension, sum(actuation(robot), ())
    actuated = [d + i for i, a in enumerate(flags) if a]
    passive = passive_columns(robot)
    reduced = _without_passive(robot, matrix)
    if reduced is not None:
        matrix, passive = reduced, []
    twist, driven, free = matrix[:, :d], matrix[:, jnp.array(actuated)], matrix[:, jnp.array(passive, int)]
    legs = len(actuated) + len(passive)  # rows; those of the constraints follow
    # det(N A A^T N^T + N B B^T N^T) for any N that eliminates the passive columns, without choosing one
    # fenced, as every minor of the determinant would evaluate the products anew
    gram = fence(twist[:legs] @ twist[:legs].T + driven[:legs] @ driven[:legs].T)
    corner = jnp.zeros((len(passive), len(passive)), gram.dtype)
    bordered = jnp.block([[gram, free[:legs]], [free[:legs].T, corner]]) if passive else gram
    bound = jnp.prod(jnp.sum(twist[legs:] ** 2, axis=1))
    return safe_divide(
        small_determinant(jnp.concatenate([twist, free], axis=1)),
        safe_sqrt(jnp.abs(small_determinant(bordered)) * bound),
    )


def _redundant_type2(robot: Mechanism, matrix: jax.Array) -> Scalar:
    """The same of more actuated joints than freedoms: sqrt(det M^T M / det(1 + M^T M)), M = d (actuated, bound) / dt.

    With as many it is |det A| / sqrt(det(A A^T + B B^T)), as M = -B^-1 A then.
    """
    d, flags = robot.space.dimension, sum(actuation(robot), ())
    joints = len(flags)
    rows, regular = solve_regular([list(row[d:]) for row in matrix[:joints]], list(-matrix[:joints, :d]))
    moved = jnp.stack([row for row, actuated in zip(rows, flags, strict=True) if actuated])
    gram = moved.T @ moved + matrix[joints:, :d].T @ matrix[joints:, :d]
    share = safe_divide(small_determinant(gram), small_determinant(gram + jnp.eye(d, dtype=gram.dtype)))
    return jnp.where(regular, safe_sqrt(share), jnp.nan)


def _independence(robot: Mechanism, matrix: jax.Array) -> Scalar:
    """Volume of the unit vectors along the constraints' rows."""
    rows = matrix[sum(map(len, actuation(robot))) :, : robot.space.dimension]
    if not len(rows):
        return jnp.ones_like(matrix[0, 0])
    units = fence(rows * safe_divide(1, safe_sqrt(jnp.sum(rows**2, axis=1)))[:, None])
    return safe_sqrt(small_determinant(_gram(units)))


def _without_passive(robot: Mechanism, matrix: jax.Array) -> jax.Array | None:
    """Closure rows free of passive joints where every leg leaves one row, by the minors of its passive columns, or all.

    Three rows instead of nine for a planar robot; ``None`` for legs with several actuated joints and passive ones.
    """
    rows, first = [], robot.space.dimension
    for columns, flags in zip(leg_columns(robot), actuation(robot), strict=True):
        block, count = matrix[jnp.array(columns) - first], flags.count(False)
        if count not in (0, len(flags) - 1):
            return None
        if count:
            free = block[:, jnp.array([column for column, a in zip(columns, flags, strict=True) if not a])]
            minors = [(-1) ** i * small_determinant(jnp.delete(free, i, axis=0)) for i in range(len(flags))]
            block = (jnp.stack(minors) @ block)[None]
        rows.append(block)
    constraints = matrix[sum(map(len, actuation(robot))) :]
    return jnp.concatenate([*rows, constraints])


def closure_matrix(robot: Mechanism, position: Vec, rotation: Rotation, joints: jax.Array) -> jax.Array:
    """Derivative of the closure by (twist, joints leg by leg), lengths in units of the robot's length.

    1. The attachments and the constraints by the twist.
    2. For each leg its residual along those, and by its own joints.
    3. The rows of leg i: its block by the twist, its own block at the place of its joints; the constraints' rows last.
    """
    d, counts = robot.space.dimension, [len(leg) for leg in actuation(robot)]
    turns = [(*leg, *[True] * (max(counts) - len(leg))) for leg in angular_by_leg(robot)]
    units = jnp.where(jnp.array(turns), 1, robot.length)

    def placed(twist: jax.Array):
        lengths = [robot.length * s if i < robot.space.translations else s for i, s in enumerate(twist)]
        moved = robot.space.nudge(position, rotation, lengths)
        return seen_by_legs(robot, *moved), constraints_on(robot, *moved, joints)

    (seen, _), (shifts, constraints) = _pushed(placed, jnp.zeros(d, joints.dtype))

    def of_leg(leg: Leg, q: Joints, attachment: Attachment, shift: Attachment, units: jax.Array):

        def turned(steps: jax.Array):
            return leg.residual(tuple(x + unit * s for x, unit, s in zip(q, units, steps, strict=True)), attachment)

        by_twist = jax.vmap(lambda tangent: jax.jvp(partial(leg.residual, q), (attachment,), (tangent,))[1])(shift)
        _, by_joints = _pushed(turned, jnp.zeros(len(q), joints.dtype))
        return jnp.stack(by_twist), jnp.stack(by_joints)

    shifts = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 1, 0), shifts)
    by_twist, by_joints = over_legs(of_leg, robot.legs(), joints_by_leg(robot, joints), seen, shifts, units)
    own = block_diag(*(block[:count, :count] for block, count in zip(by_joints, counts, strict=True)))
    moved = jnp.concatenate([block[:count] for block, count in zip(by_twist, counts, strict=True)])
    rows = [jnp.concatenate([moved, own], axis=1)]
    rows += [jnp.pad(row, (0, own.shape[1]))[None] for row in constraints]
    return jnp.concatenate(rows)


def _pushed(function: Callable[[jax.Array], Any], at: jax.Array) -> tuple[Any, Any]:
    """Value, and the derivatives by every entry on a leading axis."""
    push = jax.vmap(lambda basis: jax.jvp(function, (at,), (basis,)), out_axes=(None, 0))
    return push(jnp.eye(len(at), dtype=at.dtype))


def leg_columns(robot: Mechanism) -> list[list[int]]:
    """Columns of the closure matrix that belong to each leg's joints."""
    columns, start = [], robot.space.dimension
    for leg in actuation(robot):
        columns.append(list(range(start, start + len(leg))))
        start += len(leg)
    return columns


def passive_columns(robot: Mechanism) -> list[int]:
    """Columns of the closure matrix that belong to passive joints."""
    return [robot.space.dimension + i for i, actuated in enumerate(sum(actuation(robot), ())) if not actuated]


def _motions(robot: Mechanism, matrix: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Right singular vectors of the least singular values: joints with the platform at rest, twist with actuators."""
    d = robot.space.dimension
    joints = [null_vector(matrix[jnp.array(columns) - d][:, jnp.array(columns)]) for columns in leg_columns(robot)]
    most = max(map(len, joints))
    joints = [jnp.pad(motion, (0, most - len(motion))) for motion in joints]
    twist = null_vector(_with_constraints_first(robot, matrix[:, jnp.array([*range(d), *passive_columns(robot)])]))[:d]
    scale = jnp.where(jnp.arange(d) < robot.space.translations, robot.length, 1)
    return jnp.stack(joints), scale * twist * safe_divide(1, safe_sqrt(jnp.sum(twist**2)))


def _with_constraints_first(robot: Mechanism, matrix: jax.Array) -> jax.Array:
    """The matrix with the legs' rows freed from motions that are bound, and those bound more than any leg binds.

    The constraints' rows are made orthonormal one after the other; one that depends on those before binds nothing.
    """
    legs = sum(map(len, actuation(robot)))
    rows, bound = matrix[:legs], list(matrix[legs:])
    if not bound:
        return matrix
    eps = float(jnp.finfo(matrix.dtype).eps)
    for i, row in enumerate(bound):
        rest = row
        for before in bound[:i]:
            rest = rest - before * jnp.sum(before * row)
        size, whole = safe_sqrt(jnp.sum(rest**2)), safe_sqrt(jnp.sum(row**2))
        bound[i] = rest * jnp.where(size > 16 * eps * whole, safe_divide(1, size), 0)
    for row in bound:
        rows = rows - jnp.sum(rows * row[None], axis=1)[:, None] * row[None]
    return jnp.concatenate([rows, jnp.stack(bound) * safe_sqrt(jnp.sum(matrix[:legs] ** 2))])


def small_determinant(matrix: jax.Array) -> Scalar:
    """Determinant, unrolled; a polynomial where rank is lost."""
    return determinant([[matrix[i, j] for j in range(matrix.shape[1])] for i in range(matrix.shape[0])])
