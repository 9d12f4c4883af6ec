"""Forward kinematics: Newton's method on the pose and the passive joints together."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.cpu.chunks import chunked
from jaxscissor._engine.numerics import Scalar, default_tol
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_floats
from jaxscissor._engine.types import ActuatedLike, Number, PoseLike
from jaxscissor.kinematics._legs import closest_joints
from jaxscissor.kinematics._platform import (
    State,
    all_joints,
    assemble,
    assembly_sign,
    contradiction,
    differentiable_pose,
    legs_close,
    state_at,
)
from jaxscissor.kinematics._solution import Solution, Status
from jaxscissor.kinematics._triangle_on_circles import triangle_on_circles
from jaxscissor.robots._contract import (
    Mechanism,
    checked_freedoms,
    checked_joints,
    checked_pose,
    is_redundant,
)

_LANES = 4096  # solved together: a chunk's loop ends with its last lane


@one_pose()
def forward_kinematics(
    robot: Mechanism,
    actuated: ActuatedLike,
    *,
    guess: PoseLike | None = None,
    tol: Number | None = None,
    max_steps: Number = 50,
) -> Solution:
    """Pose that the actuated joints give the platform.

    Newton's method on the pose and the passive joints together, stepping on the rotation group; of a robot with more
    actuated joints than freedoms that of Gauss and Newton, whose pose has the least residual.

    Args:
      robot: the robot; every array in it is differentiable.
      actuated: ``(m,)`` the actuated joints.
      guess: ``(d,)`` pose to start from, which chooses the assembly mode. Default: home.
      tol: closure residual, dimensionless, that counts as zero. Default: by the dtype.
      max_steps: Newton steps before giving up.

    Returns:
      ``Solution`` whose ``value`` is the pose ``(d,)``, pitch within [-90, 90] deg. ``CONVERGED`` in the
      assembly mode of the guess (the sign of its closure determinant), ``OTHER_MODE`` in one of the other
      sign, ``SINGULAR`` where the iteration ended with a loose platform, ``NO_SOLUTION`` where a leg cannot
      take its joints at all, ``CONTRADICTION`` where more of them are actuated than the platform has freedoms and
      they do not agree, ``MAX_STEPS`` (which proves nothing), ``NONFINITE``. Derivatives are zero where the status is
      not ``CONVERGED``.

    Raises:
      ValueError: wrong shape of ``actuated`` or ``guess``; a robot with fewer actuated joints than freedoms.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> pose, joints = robot.home()
      >>> bool(abs(js.forward_kinematics(robot, joints + 0.01).value - pose)[2] > 0.01)
      True
    """
    checked_freedoms(robot, more=True)
    actuated = checked_joints(robot, actuated, actuated_only=True)
    robot, actuated = as_floats(robot, actuated)
    if guess is not None:
        robot, guess = checked_pose(robot, guess)
        robot, actuated, guess = as_floats(robot, actuated, guess)
    tol = default_tol(actuated.dtype) if tol is None else tol
    return _forward_kinematics(robot, actuated, guess, tol, max_steps)


def _forward_kinematics(
    robot: Mechanism, actuated: jax.Array, guess: jax.Array | None, tol: Scalar, max_steps: Scalar
) -> Solution:
    """The pose with the derivative of the implicit function, where the status says that it is what was asked for."""
    state, status, error, steps = _assembled(*lax.stop_gradient((robot, actuated, guess, tol, max_steps)))
    finite = status != Status.NONFINITE
    actuated = jnp.where(finite, actuated, lax.stop_gradient(robot.actuated(robot.home()[1])))
    pose, _ = differentiable_pose(robot, actuated, state, status == Status.CONVERGED)
    return Solution(jnp.where(finite, pose, jnp.nan), status, error, steps)


def _assembled_lane(
    robot: Mechanism, actuated: jax.Array, guess: jax.Array | None, tol: Scalar, max_steps: Scalar
) -> tuple[State, Scalar, Scalar, Scalar]:
    """The state of the platform without derivatives, its status, residual and number of steps.

    1. Home, or the guess with the joints of the home mode there, is where Newton's method starts.
    2. Where it ends, the sign of det d residual / d (twist, passive joints) is compared with that of the start.
    3. The status: not closed, joints that contradict each other, another sign, a singularity, a leg that cannot take
       its joints, in rising order.
    """
    finite = jnp.all(jnp.isfinite(actuated)) & (True if guess is None else jnp.all(jnp.isfinite(guess)))
    start_pose, start_joints = _assembled_guess(robot, guess, finite, tol)
    home_actuated = robot.actuated(start_joints)
    actuated = jnp.where(finite, actuated, home_actuated)
    start = state_at(robot, start_pose, start_joints)
    triangle = triangle_on_circles(robot, actuated)
    state, error, steps = assemble(robot, actuated, start, tol, max_steps, triangle)
    if triangle is None:
        ends = jax.tree.map(lambda *leaves: jnp.stack(leaves), (actuated, state), (home_actuated, start))
        signs = lax.map(lambda end: assembly_sign(robot, *end), ends)  # one after the other through one program
    else:
        signs = assembly_sign(robot, actuated, state, triangle), assembly_sign(robot, home_actuated, start)
    same = signs[0] * signs[1] >= 0  # a guess on a singularity names no mode
    status = jnp.where(error <= tol, jnp.where(same, Status.CONVERGED, Status.OTHER_MODE), Status.MAX_STEPS)
    if is_redundant(robot):
        ended = contradiction(robot, actuated, state) < jnp.sqrt(tol)
        status = jnp.where((error > tol) & ended, Status.CONTRADICTION, status)
    status = jnp.where(signs[0] == 0, Status.SINGULAR, status)
    status = jnp.where(legs_close(robot, all_joints(robot, actuated, state)), status, Status.NO_SOLUTION)
    status = jnp.where(finite, status, Status.NONFINITE).astype(jnp.int32)
    return state, status, jnp.where(finite, error, jnp.nan), steps


_assembled = chunked(_assembled_lane, most=_LANES)


def _assembled_guess(
    robot: Mechanism, guess: jax.Array | None, finite: Scalar, tol: Scalar
) -> tuple[jax.Array, jax.Array]:
    """Pose of the guess and the joints that the home working mode has there, or the closest to it."""
    pose, joints = robot.home()
    if guess is not None:
        pose = jnp.where(finite, guess, pose)
        joints = closest_joints(robot, pose, tol)
    return lax.stop_gradient((pose, joints))
