"""All the ways in which a robot can be assembled: every working mode of a pose."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from jaxscissor._legs import place
from jaxscissor._newton import norm
from jaxscissor._numerics import default_tol
from jaxscissor._pytree import pytree
from jaxscissor.mechanisms._contract import Mechanism, checked_pose


@pytree
class WorkingModes:
    """Every joint solution of a pose, leg by leg; the robot's working modes are their product.

    Attributes:
      values: ``(legs, modes, joints of a leg)``, padded.
      valid: ``(legs, modes)``, which entries are solutions.
    """

    values: jax.Array
    valid: jax.Array


def inverse_kinematics_all(robot: Mechanism, pose: Any) -> WorkingModes:
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
    return _inverse_kinematics_all(robot, pose)


@jax.jit
def _inverse_kinematics_all(robot: Mechanism, pose: jax.Array) -> WorkingModes:
    placed = place(robot, pose)
    values, valid = [], []
    for leg, attachment in zip(placed.legs, placed.attachments, strict=True):
        solutions = leg.solutions(attachment)
        if solutions is None:
            raise ValueError(
                f"{type(leg).__name__} does not know all its solutions. Give it a method solutions(attachment), or "
                "use inverse_kinematics with several guesses."
            )
        tol = default_tol(pose.dtype)
        closed = [norm(leg.residual(joints, attachment)) <= tol for joints in solutions[0]]
        values.append(jnp.stack([jnp.stack(joints) for joints in solutions[0]]))
        valid.append(jnp.stack([v & c & placed.finite for v, c in zip(solutions[1], closed, strict=True)]))
    return WorkingModes(jnp.stack(values), jnp.stack(valid))
