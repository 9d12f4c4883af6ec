"""Forward kinematics along a joint trajectory, in one branch."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.numerics import Scalar, default_tol
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_floats
from jaxscissor._engine.types import Number, Numbers, PoseLike
from jaxscissor.kinematics._legs import closest_joints
from jaxscissor.kinematics._platform import State, all_joints, assemble, differentiable_pose, legs_close, state_at
from jaxscissor.kinematics._solution import Status
from jaxscissor.motion._checks import checked_rows
from jaxscissor.motion._trajectory import Trajectory, until_stopped
from jaxscissor.motion._watch import Branch, Least, Watched, named, unnamed, verdict, watched
from jaxscissor.robots._contract import (
    Mechanism,
    actuated_mask,
    checked_freedoms,
    checked_pose,
)

MAX_STEPS = 50


def track(
    robot: Mechanism,
    actuated: Numbers,
    *,
    guess: PoseLike | None = None,
    min_margin: Number = 0.0,
    min_type1: Number = 0.0,
    min_type2: Number = 0.0,
) -> Trajectory:
    """Poses along a joint trajectory, in one branch, until a limit or a singularity.

    1. The guess, in the home working mode, names the branch: the signs of the singularity measures, of which that of
       the platform names the assembly mode.
    2. Every sample is solved by Newton's method, the passive joints included, from the configuration of the one
       before, the first one from the guess.
    3. A sample is covered if it keeps the branch and the least distances asked for, those to singularities of the
       legs included. The motion stops before the first one that does not.

    Args:
      robot: the robot; every array in it is differentiable.
      actuated: ``(n, m)`` the actuated joints, so close together that the pose cannot jump to another assembly mode
        of the same sign.
      guess: ``(d,)`` pose close to the first sample's, which chooses the assembly mode. Default: home.
      min_margin: least distance to a limit of the legs, dimensionless; ``-inf`` ignores the limits.
      min_type1, min_type2: least size of the singularity measures of the legs and of the platform.

    Returns:
      ``Trajectory``. Its reason is ``CONVERGED``; ``OUT_OF_REACH`` before a limit; ``SINGULAR`` before a
      singularity or where the iteration ended with a loose platform; ``OTHER_MODE`` before a jump into an assembly
      mode of the other sign; ``NO_SOLUTION`` where a leg cannot take its joints at all; ``MAX_STEPS`` or
      ``NONFINITE``.

    Raises:
      ValueError: wrong shapes, no sample, or a robot with more or fewer actuated joints than freedoms.

    Example:
      The legs of NaVARo II grow from 45 and turn the platform, until it is loose after half a turn, at 69.28:

      >>> import jaxscissor as js, numpy as np
      >>> robot, middle = js.NavaroII.prototype(mode=8), [45.0, 25.98]
      >>> lengths = np.tile(np.arange(45.0, 75.0)[:, None], 3)
      >>> found = js.motion.track(robot, lengths, guess=[*middle, 1.5])
      >>> print(js.Status(int(found.reason)).name, lengths[found.covered - 1])
      SINGULAR [69. 69. 69.]
    """
    checked_freedoms(robot)
    robot, rows = checked_rows(robot, actuated, sum(actuated_mask(robot)), "actuated joints")
    if guess is not None:
        robot, guess = checked_pose(robot, guess)
    robot, rows, guess, least = as_floats(robot, rows, guess, Least(min_margin, min_type1, min_type2))
    return _track(robot, rows, robot.home()[0] if guess is None else guess, least)


@one_pose()
def _track(robot: Mechanism, rows: jax.Array, guess: jax.Array, least: Least) -> Trajectory:
    """The guess goes first, to name the branch; it may lie beyond a limit."""
    finite = jnp.all(jnp.isfinite(guess))
    pose = jnp.where(finite, guess, robot.home()[0])
    joints = closest_joints(robot, pose, default_tol(pose.dtype))
    status = jnp.where(finite, Status.CONVERGED, Status.NONFINITE).astype(jnp.int32)
    start = resting_at(robot, pose, joints, status)

    def step(at: At, case: tuple[jax.Array, jax.Array]) -> tuple[At, Any]:
        actuated, judged = case
        at, sample = advance(robot, actuated, at, least)
        return at._replace(reason=jnp.where(judged, at.reason, status)), sample

    cases = jnp.concatenate([start.actuated[None], rows]), jnp.arange(len(rows) + 1) > 0
    _, samples = lax.scan(step, start, cases)
    return Trajectory(*(values[1:] for values in samples))


class At(NamedTuple):
    """Where a robot stands, without derivatives, its branch, and why it moves no more."""

    actuated: jax.Array
    state: State
    branch: Branch
    reason: Scalar


def resting_at(robot: Mechanism, pose: jax.Array, joints: jax.Array, status: Scalar) -> At:
    """A robot that has not moved yet."""
    pose, joints = lax.stop_gradient((pose, joints))
    return At(robot.actuated(joints), lax.stop_gradient(state_at(robot, pose, joints)), unnamed(robot), status)


def advance(robot: Mechanism, actuated: jax.Array, last: At, least: Least) -> tuple[At, tuple[jax.Array, ...]]:
    """Move the actuators: where the robot stands then, and the sample, the fields of a ``Trajectory``."""
    tol = default_tol(actuated.dtype)
    finite = jnp.all(jnp.isfinite(actuated))
    actuated = jnp.where(finite, actuated, last.actuated)
    state, error, _ = assemble(robot, actuated, last.state, tol, MAX_STEPS)
    closed = error <= tol
    pose, passive = differentiable_pose(robot, actuated, state, finite & closed)
    joints = all_joints(robot, actuated, state._replace(passive=passive))
    seen = watched(robot, pose, joints)
    branch = named(last.branch, seen)
    status = verdict(_solved(robot, joints, closed, seen, branch), seen, branch, least)
    status = jnp.where(finite, status, Status.NONFINITE)
    reason = jnp.where(last.reason == Status.CONVERGED, status, last.reason).astype(jnp.int32)
    here = lax.stop_gradient((actuated, state))
    actuated, state = jax.tree.map(lambda new, old: jnp.where(reason == Status.CONVERGED, new, old), here, last[:2])
    return At(actuated, state, branch, reason), (*until_stopped(reason, (pose, joints, *seen)), reason)


def _solved(robot: Mechanism, joints: jax.Array, closed: Scalar, seen: Watched, branch: Branch) -> Scalar:
    """Status of the solve: where it failed, whether because the platform is loose there or a leg does not close."""
    side = seen.type2 * branch.type2
    loose = jnp.abs(side) <= default_tol(joints.dtype) ** 0.5
    failed = jnp.where(loose, Status.SINGULAR, Status.MAX_STEPS)
    status = jnp.where(closed, jnp.where(side > 0, Status.CONVERGED, Status.OTHER_MODE), failed)
    return jnp.where(legs_close(robot, joints), status, Status.NO_SOLUTION)
