"""Derivatives of the closure: its Jacobians A and B, and the inverse Jacobian of the robot."""

from __future__ import annotations

from typing import Literal

import jax
import jax.numpy as jnp

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.matrices import solve_regular
from jaxscissor._engine.newton import value_and_jacobian
from jaxscissor._engine.numerics import Scalar, default_tol
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_floats
from jaxscissor._engine.types import JointsLike, PoseLike
from jaxscissor.kinematics._inverse import inverse_kinematics
from jaxscissor.kinematics._legs import MAX_STEPS, Placed, place, solve_legs
from jaxscissor.kinematics._residual import flat_residual
from jaxscissor.robots._contract import (
    Attachment,
    Joints,
    Leg,
    Mechanism,
    checked_joints,
    checked_pose,
    constraints_on,
    joints_together,
    seen_by_legs,
)
from jaxscissor.robots._over_legs import over_legs


@one_pose()
def closure_jacobians(
    robot: Mechanism, pose: PoseLike, *, joints: JointsLike | None = None
) -> tuple[jax.Array, jax.Array]:
    """Derivatives of the closure residual, A with respect to the pose and B to the joints.

    A dp + B dq = 0 along every motion [RAL17 eq. 16, ICRA16 eq. 24, after Gosselin and Angeles].

    Args:
      robot: the robot.
      pose: ``(d,)`` in the base frame; A is taken with respect to its coordinates, angles included.
      joints: ``(n,)`` all joints. Default: those of the home mode.

    Returns:
      A ``(m, d)`` and B ``(m, n)``, rows as in ``residual``; ``nan`` where the home mode does not exist.

    Raises:
      ValueError: wrong shapes.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> a, b = js.closure_jacobians(robot, robot.home()[0])
      >>> a.shape, b.shape
      ((6, 6), (6, 6))
    """
    robot, pose = checked_pose(robot, pose)
    if joints is None:
        solution = inverse_kinematics(robot, pose)
        joints = jnp.where(solution.converged, solution.value, jnp.nan)
    robot, joints, pose = as_floats(robot, checked_joints(robot, joints), pose)
    by_joints, by_pose = jax.jacfwd(flat_residual, (1, 2))(robot, joints, pose)
    return by_pose, by_joints


@one_pose("rates")
def inverse_jacobian(robot: Mechanism, pose: PoseLike, *, rates: Literal["rpy", "twist"] = "rpy") -> jax.Array:
    """Derivative of the actuated joints with respect to the pose, in the home mode.

    Built leg by leg, as J_S J_C [ICRA16 eq. 23]: each leg's closure is a small system of its own.

    Args:
      robot: the robot; every array in it is differentiable.
      pose: ``(d,)`` in the base frame.
      rates: ``"rpy"`` for the rates of the pose coordinates; ``"twist"`` for the velocity of the
        platform's reference point and the angular velocity, both in the base frame, which has no
        singular angle.

    Returns:
      ``(m, d)``; ``nan`` where the home mode does not exist, or a leg is singular.

    Raises:
      ValueError: wrong shape, or unknown ``rates``.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> lift = js.inverse_jacobian(robot, robot.home()[0])[:, 2]
      >>> bool((lift < 0).all())  # all slides inward is up
      True
    """
    if rates not in ("rpy", "twist"):
        raise ValueError(f"Got rates={rates!r}; expected 'rpy' or 'twist'.")
    robot, pose = checked_pose(robot, pose)
    usable, matrix = twist_jacobian(robot, pose)
    if rates == "rpy":
        matrix = matrix @ robot.space.rates_to_twist(pose)
    return jnp.where(usable, matrix, jnp.nan)


@jax.jit
def twist_jacobian(robot: Mechanism, pose: jax.Array) -> tuple[Scalar, jax.Array]:
    """Whether the home mode is regular at the pose, and d actuated joints / d twist; zero where it is not."""
    placed = place(robot, pose)
    results, _ = solve_legs(robot, placed, None, default_tol(pose.dtype), MAX_STEPS)
    platform = _platform_jacobian(robot, placed)

    def of_leg(leg: Leg, seen: Attachment, joints: Joints, moved: jax.Array):
        invertible, jacobian = leg_jacobian(leg, seen, joints)
        return invertible, tuple(jacobian @ moved)

    invertible, rows = over_legs(of_leg, placed.legs, placed.attachments, results.value, platform)
    usable = placed.finite & jnp.all(results.solved & invertible)
    matrix = robot.actuated(joints_together(robot, rows).T).T
    return usable, jnp.where(usable, matrix, 0)


def constraint_rows(robot: Mechanism, pose: jax.Array) -> jax.Array | None:
    """d constraints / d twist at a pose ``(constraints, d)``; ``None`` of a robot without any."""
    finite = jnp.all(jnp.isfinite(pose))
    position, rotation = robot.space.place(jnp.where(finite, pose, robot.home()[0]))
    still = tuple(jnp.zeros_like(pose[0]) for _ in range(robot.space.dimension))

    def equations(twist: Joints):
        return constraints_on(robot, *robot.space.nudge(position, rotation, twist))

    if not jax.eval_shape(equations, still):
        return None
    _, rows = value_and_jacobian(equations, still)
    return jnp.stack([jnp.stack(row) for row in rows])


@jax.jit
def leg_jacobian(leg: Leg, attachment: Attachment, joints: Joints) -> tuple[Scalar, jax.Array]:
    """J_S of one leg: whether invertible, and d joints / d attachment, ``(joints, numbers)`` [ICRA16 eq. 21]."""
    numbers, tree = jax.tree.flatten(attachment)
    _, by_joints = value_and_jacobian(lambda q: leg.residual(q, attachment), joints)
    _, by_numbers = value_and_jacobian(lambda a: leg.residual(joints, jax.tree.unflatten(tree, a)), tuple(numbers))
    by_joints, by_numbers = fence((by_joints, by_numbers))  # without, the inverse Jacobian takes 1.15 times as long
    rhs = [jnp.stack([-e for e in row]) for row in by_numbers]
    rows, invertible = solve_regular(by_joints, rhs)
    return invertible, jnp.stack(rows)


def _platform_jacobian(robot: Mechanism, placed: Placed) -> jax.Array:
    """J_C: d attachment / d twist of every leg, ``(legs, numbers, d)`` [ICRA16 eq. 20]."""
    still = tuple(jnp.zeros_like(placed.pose[0]) for _ in range(robot.space.dimension))

    def moved(twist: Joints):
        seen = seen_by_legs(robot, *robot.space.nudge(placed.position, placed.rotation, twist))
        return jnp.stack(jax.tree.leaves(seen), axis=1)

    return jnp.stack([jax.jvp(moved, (still,), (_basis(still, j),))[1] for j in range(len(still))], axis=-1)


def _basis(zero: tuple[Scalar, ...], j: int) -> tuple[Scalar, ...]:
    return tuple(jnp.ones_like(x) if i == j else x for i, x in enumerate(zero))
