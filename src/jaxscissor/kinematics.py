"""Inverse kinematics, one small Newton solve per leg; forward kinematics, Newton on the pose."""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._batching import chunked
from jaxscissor._legs import MAX_STEPS, closest_joints, place, solve_legs
from jaxscissor._newton import implicit, norm
from jaxscissor._numerics import Scalar, default_tol
from jaxscissor._platform import all_joints, assemble, assembly_sign, differentiable_pose, state_at
from jaxscissor._program import one_pose
from jaxscissor._pytree import as_floats
from jaxscissor._solution import Solution, Status
from jaxscissor.mechanisms._contract import (
    Mechanism,
    checked_freedoms,
    checked_joints,
    checked_pose,
    closure,
    join_joints,
    leg_residual,
    legs_of,
    split_joints,
)


@one_pose()
def residual(robot: Mechanism, joints: Any, pose: Any) -> jax.Array:
    """Closure residual of all legs, and of the constraints on the pose after them; dimensionless.

    Args:
      robot: the robot.
      joints: ``(n,)`` all joint coordinates.
      pose: ``(d,)`` pose in the base frame.

    Returns:
      ``(n + constraints,)``, zero where the robot assembles.

    Raises:
      ValueError: wrong shapes.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> pose, joints = robot.home()
      >>> bool(abs(js.residual(robot, joints, pose)).max() < 1e-6)
      True
    """
    robot, pose = checked_pose(robot, pose)
    joints = checked_joints(robot, joints)
    return flat_residual(*as_floats(robot, joints, pose))


def flat_residual(robot: Mechanism, joints: jax.Array, pose: jax.Array) -> jax.Array:
    """``residual`` of arrays whose shapes and dtypes are known to be right."""
    return jnp.stack(closure(robot, legs_of(robot), split_joints(robot, joints), *robot.space.place(pose)))


@one_pose()
def inverse_kinematics(
    robot: Mechanism, pose: Any, *, guess: Any = None, tol: Any = None, max_steps: Any = MAX_STEPS
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
def _solve(robot: Mechanism, pose: jax.Array, guess: Any, tol: Scalar, max_steps: Scalar) -> Solution:
    placed = place(robot, pose)
    results, statuses = solve_legs(robot, placed, guess, tol, max_steps)
    norms = [r.norm for r in results]
    status = functools.reduce(jnp.maximum, statuses)
    constraints = robot.constraints(placed.position, placed.rotation)
    if constraints:
        norms.append(norm(constraints))
        status = jnp.where(norms[-1] <= tol, status, jnp.maximum(status, Status.NO_SOLUTION))
    return Solution(
        value=jnp.where(placed.finite, join_joints(robot, [r.value for r in results]), jnp.nan),
        status=jnp.where(placed.finite, status, Status.NONFINITE).astype(jnp.int32),
        residual_norm=jnp.where(placed.finite, norm(norms), jnp.nan),
        num_steps=functools.reduce(jnp.maximum, [r.steps for r in results]),
    )


@jax.custom_jvp
def _follow(joints: jax.Array, ok: Scalar, robot: Mechanism, pose: jax.Array) -> jax.Array:
    """The joints found at a pose, with the derivative of the implicit function where ok."""
    return joints


@_follow.defjvp
def _follow_jvp(primals, tangents):
    joints, ok, robot, pose = primals
    joints = jnp.where(jnp.isnan(joints), lax.stop_gradient(robot.home()[1]), joints)  # of a pose that is not finite

    def roots(robot, pose):
        placed = place(robot, pose)
        cases = zip(placed.legs, placed.attachments, split_joints(robot, joints), strict=True)
        return join_joints(robot, [implicit(leg_residual, q, ok, (leg, seen)) for leg, seen, q in cases])

    _, moved = jax.jvp(roots, (robot, pose), tangents[2:])
    return _follow(*primals), moved  # by itself, so that both outputs are batched along the same axis


@one_pose()
def forward_kinematics(
    robot: Mechanism, joints: Any, *, guess: Any = None, tol: Any = None, max_steps: Any = 50
) -> Solution:
    """Pose that the actuated joints give the platform.

    Newton's method on the pose and the passive joints together, stepping on the rotation group.

    Args:
      robot: the robot; every array in it is differentiable.
      joints: ``(m,)`` the actuated joints.
      guess: ``(d,)`` pose to start from, which chooses the assembly mode. Default: home.
      tol: closure residual, dimensionless, that counts as zero. Default: by the dtype.
      max_steps: Newton steps before giving up.

    Returns:
      ``Solution`` whose ``value`` is the pose ``(d,)``, pitch within [-90, 90] deg. ``CONVERGED`` in the
      assembly mode of the guess (the sign of its closure determinant), ``OTHER_MODE`` in one of the other
      sign, ``SINGULAR`` where the iteration ended with a loose platform, ``NO_SOLUTION`` where a leg cannot
      take its joints at all, ``MAX_STEPS`` (which proves nothing), ``NONFINITE``. Derivatives are zero where
      the status is not ``CONVERGED``.

    Raises:
      ValueError: ``joints`` or ``guess`` has the wrong shape; a robot with more or fewer actuated joints than freedoms.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> pose, joints = robot.home()
      >>> bool(abs(js.forward_kinematics(robot, joints + 0.01).value - pose)[2] > 0.01)
      True
    """
    checked_freedoms(robot)
    joints = checked_joints(robot, joints, actuated_only=True)
    robot, joints = as_floats(robot, joints)
    if guess is not None:
        robot, guess = checked_pose(robot, guess)
        robot, joints, guess = as_floats(robot, joints, guess)
    tol = default_tol(joints.dtype) if tol is None else tol
    return _forward_kinematics(robot, joints, guess, tol, max_steps)


def _forward_kinematics(robot: Mechanism, joints: jax.Array, guess: Any, tol: Scalar, max_steps: Scalar) -> Solution:
    finite = jnp.all(jnp.isfinite(joints)) & (True if guess is None else jnp.all(jnp.isfinite(guess)))
    start_pose, start_joints = _assembled_guess(robot, guess, finite, tol)
    home_actuated = robot.actuated(start_joints)
    joints = jnp.where(finite, joints, home_actuated)
    start = state_at(robot, start_pose, start_joints)
    state, error, steps = assemble(robot, joints, start, tol, max_steps)

    ends = jax.tree.map(lambda *leaves: jnp.stack(leaves), (joints, state), (home_actuated, start))
    signs = lax.map(lambda end: assembly_sign(robot, *end), ends)  # one after the other through one program
    same = signs[0] * signs[1] >= 0  # a guess on a singularity names no mode
    status = jnp.where(error <= tol, jnp.where(same, Status.CONVERGED, Status.OTHER_MODE), Status.MAX_STEPS)
    status = jnp.where(signs[0] == 0, Status.SINGULAR, status)
    for leg, q in zip(legs_of(robot), split_joints(robot, all_joints(robot, joints, state)), strict=True):
        status = jnp.where(leg.closes(q), status, Status.NO_SOLUTION)
    status = jnp.where(finite, status, Status.NONFINITE).astype(jnp.int32)
    pose, _ = differentiable_pose(robot, joints, state, status == Status.CONVERGED)
    return Solution(
        value=jnp.where(finite, pose, jnp.nan),
        status=status,
        residual_norm=jnp.where(finite, error, jnp.nan),
        num_steps=steps,
    )


def _assembled_guess(robot: Mechanism, guess: Any, finite: Scalar, tol: Scalar) -> tuple[jax.Array, jax.Array]:
    """Pose of the guess and the joints that the home working mode has there, or the closest to it."""
    pose, joints = robot.home()
    if guess is not None:
        pose = jnp.where(finite, guess, pose)
        joints = closest_joints(robot, pose, tol)
    return lax.stop_gradient((pose, joints))
