"""Inverse kinematics: one small Newton solve per leg."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.cpu.chunks import chunked
from jaxscissor._engine.newton import norm
from jaxscissor._engine.numerics import Scalar, default_tol
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_floats
from jaxscissor._engine.types import JointsLike, Number, PoseLike
from jaxscissor.kinematics._legs import MAX_STEPS, place, solve_legs_only
from jaxscissor.kinematics._solution import Solution, Status
from jaxscissor.robots._contract import (
    Mechanism,
    checked_joints,
    checked_pose,
    constraints_on,
    differentiable_roots,
    joints_by_leg,
    joints_together,
)


@one_pose()
def inverse_kinematics(
    robot: Mechanism,
    pose: PoseLike,
    *,
    guess: JointsLike | None = None,
    tol: Number | None = None,
    max_steps: Number = MAX_STEPS,
) -> Solution:
    """Joint coordinates that place the platform at a pose.

    Each leg's closure equations are solved by Newton's method in its home working mode, from a start in
    closed form; the derivatives are those of the implicit function theorem. Unbatched and pure: map it
    with ``jax.vmap``.

    Args:
      robot: the robot; every array in it is differentiable.
      pose: ``(d,)`` in the base frame, lengths in the robot's unit, angles in radians.
      guess: ``(n,)`` joints to start from; they choose the working mode instead of home's.
      tol: closure residual, dimensionless, that counts as zero. Default: by the dtype.
      max_steps: Newton steps before giving up.

    Returns:
      ``Solution`` whose ``value`` is all joints ``(n,)``. The status tells apart: ``CONVERGED`` in the
      home mode (or the guess's), ``OTHER_MODE`` if the robot assembles only in another, ``NO_SOLUTION``
      if that is proved, ``MAX_STEPS``, ``NONFINITE``. Limits of stroke are not judged here: see
      ``feasibility``. Derivatives are zero where the status is not ``CONVERGED``, and those of a leg that is
      singular to rounding. A robot with constraints on its pose has no solution at a pose that breaks them:
      see ``constrained_pose``.

    Raises:
      ValueError: ``pose`` or ``guess`` has the wrong shape.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> js.inverse_kinematics(robot, [0.1, 0.0, 1.0, 0.0, 0.2, 0.0]).value.round(3).tolist()
      [0.439, 0.439, 0.511, 0.333, 0.333, 0.511]
    """
    robot, pose = checked_pose(robot, pose)
    if guess is not None:
        guess = checked_joints(robot, guess)
        robot, pose, guess = as_floats(robot, pose, guess)
    tol = default_tol(pose.dtype) if tol is None else tol
    solution = _solve(*lax.stop_gradient((robot, pose, guess, tol, max_steps)))
    value = _follow(solution.value, solution.converged, robot, pose)
    return Solution(value, solution.status, solution.residual_norm, solution.num_steps)


@chunked
def _solve(robot: Mechanism, pose: jax.Array, guess: jax.Array | None, tol: Scalar, max_steps: Scalar) -> Solution:
    placed = place(robot, pose)
    legs, status = solve_legs_only(robot, placed, guess, tol, max_steps)
    status, norms = jnp.max(status), [*legs.norm]
    joints = joints_together(robot, legs.value)
    constraints = constraints_on(robot, placed.position, placed.rotation, joints)
    if constraints:
        norms.append(norm(constraints))
        status = jnp.where(norms[-1] <= tol, status, jnp.maximum(status, Status.NO_SOLUTION))
    return Solution(
        value=jnp.where(placed.finite, joints, jnp.nan),
        status=jnp.where(placed.finite, status, Status.NONFINITE).astype(jnp.int32),
        residual_norm=jnp.where(placed.finite, norm(norms), jnp.nan),
        num_steps=jnp.max(legs.steps),
    )


@jax.custom_jvp
def _follow(joints: jax.Array, ok: Scalar, robot: Mechanism, pose: jax.Array) -> jax.Array:
    """The joints found at a pose, with the derivative of the implicit function where ok."""
    return joints


@_follow.defjvp
def _follow_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]):
    joints, ok, robot, pose = primals
    joints = jnp.where(jnp.isnan(joints), lax.stop_gradient(robot.home()[1]), joints)  # of a pose that is not finite

    def roots(robot: Mechanism, pose: jax.Array):
        placed, legs = place(robot, pose), joints_by_leg(robot, joints)
        return joints_together(robot, differentiable_roots(placed.legs, placed.attachments, legs, ok))

    _, moved = jax.jvp(roots, (robot, pose), tangents[2:])
    return _follow(*primals), moved  # by itself, so that both outputs are batched along the same axis
