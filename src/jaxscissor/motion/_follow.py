"""Inverse kinematics along a list of poses, in one branch."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_floats
from jaxscissor._engine.types import JointsLike, Number, Numbers
from jaxscissor.kinematics._constraints import constrained_pose
from jaxscissor.kinematics._inverse import inverse_kinematics
from jaxscissor.kinematics._solution import Status
from jaxscissor.motion._checks import checked_rows
from jaxscissor.motion._trajectory import Trajectory, until_stopped
from jaxscissor.motion._watch import Branch, Least, named, unnamed, verdict, watched
from jaxscissor.robots._contract import Mechanism, checked_freedoms, checked_joints


def follow(
    robot: Mechanism,
    poses: Numbers,
    *,
    guess: JointsLike | None = None,
    min_margin: Number = 0.0,
    min_type1: Number = 0.0,
    min_type2: Number = 0.0,
) -> Trajectory:
    """Joints along a list of poses, in one branch, until a limit or a singularity.

    1. The first pose is solved from the guess, or in the home mode; it names the branch: the working mode of every
       leg, and the signs of the singularity measures.
    2. Every other pose is solved by Newton's method from the joints of the one before, to rounding, so that nothing
       drifts.
    3. A pose is covered if it is solved in the working mode of the one before, lies on the branch's side of all
       singularities, and keeps the least distances asked for. The motion stops before the first pose that is not.

    What lies between two poses is not seen: put them so close that no two singularities, and no two crossings of a
    limit, lie between neighbors. Dependent coordinates of robots that have some are completed by ``constrained_pose``.

    Args:
      robot: the robot; every array in it is differentiable.
      poses: ``(n, d)`` in the base frame, as from ``straight_line`` and ``via_points``.
      guess: ``(joints,)`` from which the first pose is solved; they choose the working mode. Default: home's.
      min_margin: least distance to a limit of the legs, dimensionless; ``-inf`` ignores the limits.
      min_type1, min_type2: least size of the singularity measures of the legs and of the platform.

    Returns:
      ``Trajectory``. Its reason is ``CONVERGED``; ``OUT_OF_REACH`` before a limit, ``SINGULAR`` before a
      singularity, or a sample beyond one, or a status of ``inverse_kinematics``, as at the end of a working mode.

    Raises:
      ValueError: wrong shapes, no pose, or a robot with more or fewer actuated joints than freedoms.

    Example:
      Mode 8 of NaVARo II is loose where its triangles are parallel, at alpha = 0 [NAV19 eq. 38]:

      >>> import jaxscissor as js
      >>> robot = js.NavaroII.prototype(mode=8)
      >>> path = js.motion.straight_line(robot, [45.0, 26.0, 0.5], [50.0, 30.0, -0.42], samples=24)
      >>> found = js.motion.follow(robot, path)
      >>> print(int(found.covered), js.Status(int(found.reason)).name, f"{float(path[found.covered - 1, 2]):.2f}")
      13 SINGULAR 0.02
    """
    checked_freedoms(robot)
    robot, poses = checked_rows(robot, poses, robot.space.dimension, "poses", robot.space.names)
    if guess is not None:
        guess = checked_joints(robot, guess)
    robot, poses, guess, least = as_floats(robot, poses, guess, Least(min_margin, min_type1, min_type2))
    return _follow(robot, poses, guess, least)


class _Last(NamedTuple):
    """The last pose that was covered, without derivatives, the branch, and why the motion stopped."""

    pose: jax.Array
    joints: jax.Array
    branch: Branch
    reason: Scalar


@one_pose()
def _follow(robot: Mechanism, poses: jax.Array, guess: jax.Array | None, least: Least) -> Trajectory:
    def step(last: _Last, pose: jax.Array) -> tuple[_Last, Any]:
        whole = constrained_pose(robot, pose)
        solution = inverse_kinematics(robot, whole.value, guess=last.joints)
        solved = jnp.where(whole.converged, solution.status, whole.status)
        # what was not solved is not looked at: a nan would spread into the derivatives of its neighbors
        here = _where(solved == Status.CONVERGED, (whole.value, solution.value), last[:2])
        seen = watched(robot, *here)
        branch = named(last.branch, seen)
        reason = jnp.where(last.reason == Status.CONVERGED, verdict(solved, seen, branch, least), last.reason)
        pose, joints = lax.stop_gradient(_where(reason == Status.CONVERGED, here, last[:2]))
        return _Last(pose, joints, branch, reason), (*until_stopped(reason, (*here, *seen)), reason)

    home = lax.stop_gradient(robot.home())
    first = inverse_kinematics(robot, constrained_pose(robot, poses[0]).value, guess=guess)
    pose, joints = lax.stop_gradient(_where(first.converged, (poses[0], first.value), home))
    return Trajectory(*lax.scan(step, _Last(pose, joints, unnamed(robot), first.status), poses)[1])


def _where(condition: Any, yes: Any, no: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), yes, no)
