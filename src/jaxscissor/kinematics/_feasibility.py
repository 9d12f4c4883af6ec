"""Whether a pose can be used: reached in the home mode, within every limit, and by what margin."""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.newton import fold_distance, implicit, least_squares
from jaxscissor._engine.numerics import Scalar, default_tol, safe_sqrt, smallest
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import pytree
from jaxscissor._engine.types import PoseLike, PyTree
from jaxscissor.kinematics._constraints import constrained_pose
from jaxscissor.kinematics._legs import (
    MAX_STEPS,
    LegResult,
    home_modes,
    leg_status,
    place,
    solve_leg,
)
from jaxscissor.kinematics._solution import Status
from jaxscissor.robots._contract import Attachment, Joints, Leg, Mechanism, checked_pose, constraints_on, leg_residual
from jaxscissor.robots._over_legs import one_by_one, over_legs


@pytree
class Feasibility:
    """Verdict on one pose, or on a batch under ``vmap``.

    Attributes:
      status: see ``inverse_kinematics``: whether the home mode exists there.
      margin: dimensionless, >= 0 where the pose is reached in the home mode within all limits.
    """

    status: jax.Array
    margin: jax.Array

    @property
    def feasible(self) -> jax.Array:
        """Whether the margin is >= 0."""
        return self.margin >= 0


@one_pose()
def feasibility(robot: Mechanism, pose: PoseLike) -> Feasibility:
    """Whether a pose can be used, with a signed margin that is continuous on both sides of the boundary.

    The margin is the least, over all legs, of the distances to the limits (stroke in units of the robot's
    length, scissor angle as width over 2 l0, ...) and of the distance to the edge of the home mode, in
    units of the closure residual. Where the mode does not exist, the joints of least residual stand in.
    The edge is known in closed form for the TSE; for other legs it is the least residual outside, and
    inside the residual to second order at which the solution would fold.

    Args:
      robot: the robot; every array in it is differentiable.
      pose: ``(d,)`` in the base frame.

    Returns:
      ``Feasibility``. The margin is ``-inf`` for a pose that is not finite.

    Raises:
      ValueError: wrong shape of the pose.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> bool(js.feasibility(robot, robot.home()[0]).feasible)
      True
      >>> bool(js.feasibility(robot, [0.0, 0.0, 1.7, 0.0, 0.0, 0.0]).margin < 0)  # above the upper stop
      True
    """
    robot, pose = checked_pose(robot, pose)
    return _feasibility(robot, pose)


def reached_margin(robot: Mechanism, pose: jax.Array) -> Scalar:
    """Margin of the pose with these independent coordinates; where the constraints have no solution, negative."""
    if not robot.dependent:
        return feasibility(robot, pose).margin
    whole = constrained_pose(robot, pose)
    margin = feasibility(robot, jnp.where(whole.converged, whole.value, lax.stop_gradient(robot.home()[0]))).margin
    return jnp.where(whole.converged, margin, jnp.where(jnp.isnan(whole.value[0]), -jnp.inf, -whole.residual_norm))


def _feasibility(robot: Mechanism, pose: jax.Array) -> Feasibility:
    placed = place(robot, pose)
    homes = home_modes(robot, placed)
    margins, statuses = over_legs(_verdict, *lax.stop_gradient((placed.legs, placed.attachments, homes)))
    margin = _least(margins, (placed.legs, placed.attachments), homes)
    status = jnp.max(statuses)
    constraints = constraints_on(robot, placed.position, placed.rotation)
    if constraints:
        # fenced, as it decides twice, and evaluated anew it may round to the other side of the tolerance
        off, tol = fence(safe_sqrt(sum(c * c for c in constraints))), default_tol(pose.dtype)
        status = jnp.where(off <= tol, status, jnp.maximum(status, Status.NO_SOLUTION))
        margin = jnp.where(off <= tol, margin, smallest([margin, -off]))
    margin = jnp.where(placed.finite, margin, -jnp.inf)
    return Feasibility(jnp.where(placed.finite, status, Status.NONFINITE).astype(jnp.int32), margin)


def _verdict(leg: Leg, attachment: Attachment, home: PyTree) -> tuple[Scalar, Scalar]:
    """Margin and status of one leg."""
    margin, result = _leg_margin(leg, attachment, home, False)
    return margin, leg_status(leg, attachment, result)


@jax.custom_jvp
def _least(margins: jax.Array, cases: tuple[Leg, Attachment], homes: PyTree) -> Scalar:
    """Least margin ``(legs,)`` of the legs, given with their attachments and home modes."""
    return smallest([*margins])


@_least.defjvp
def _least_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]):
    """Only the leg that decides has a derivative: it is picked first, and one leg differentiated."""
    (margins, cases, homes), (_, moved, _) = primals, tangents
    chosen, *others = one_by_one(margins, cases, moved, homes)
    for other in others:
        chosen = jax.tree.map(lambda new, old, less=other[0] < chosen[0]: jnp.where(less, new, old), other, chosen)
    _, case, motion, home = chosen
    # fenced on both sides: without, the soft gradient takes 1.3 times as long
    gradient = fence(jax.grad(lambda c: _leg_margin(*c, home, True)[0])(fence(case)))
    products = jax.tree.leaves(jax.tree.map(lambda g, m: jnp.sum(g * m), gradient, motion))
    return _least(*primals), sum(products[1:], products[0])


@functools.partial(jax.jit, static_argnums=3)
def _leg_margin(leg: Leg, attachment: Attachment, home: PyTree, differentiated: bool) -> tuple[Scalar, LegResult]:
    """Margin of one leg, and its solution."""
    margins, result = _leg_margins(leg, attachment, home, differentiated)
    margin = smallest(margins)
    return jnp.where(jnp.isnan(margin), -jnp.inf, margin), result


def _leg_margins(
    leg: Leg, attachment: Attachment, home: PyTree, differentiated: bool
) -> tuple[list[Scalar], LegResult]:
    """Distances of one leg to the edge of the home mode and to every limit, and its solution."""
    tol = default_tol(jnp.result_type(jax.tree.leaves(attachment)[0]))
    result = solve_leg(leg, attachment, home, guess=None, tol=tol, max_steps=MAX_STEPS)
    if differentiated:
        result = result._replace(root=implicit(leg_residual, result.root, result.converged, (leg, attachment)))
    joints, edge = _nearest(leg, attachment, result)
    if differentiated:
        joints, edge = fence((joints, edge))  # else every one of the derivatives evaluates them anew
    return [edge, *leg.margins(joints, attachment)], result


@one_pose()
def margins(robot: Mechanism, pose: PoseLike) -> jax.Array:
    """Distances of a pose from the edge of the home mode and from every limit, leg by leg.

    The least of them is the margin of ``feasibility``. Each alone is smooth, so that as constraints of
    ``design.optimize`` they serve better than their minimum.

    Args:
      robot: the robot; every array in it is differentiable.
      pose: ``(d,)`` in the base frame.

    Returns:
      ``(legs, 1 + limits)``, dimensionless, >= 0 where kept; first the edge of the home mode, then the limits
      as ``robot.legs().limits`` names them; infinite for a limit that is not finite.

    Raises:
      ValueError: wrong shape of the pose.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.NavaroII.prototype()
      >>> found = js.margins(robot, [45.0, 26.0, 0.1])
      >>> found.shape, bool(found.min() == js.feasibility(robot, [45.0, 26.0, 0.1]).margin)
      ((3, 3), True)
    """
    robot, pose = checked_pose(robot, pose)
    placed = place(robot, pose)
    cases = placed.legs, placed.attachments, home_modes(robot, placed)
    found = over_legs(lambda leg, seen, home: jnp.stack(_leg_margins(leg, seen, home, True)[0]), *cases)
    return jnp.where(placed.finite, found, -jnp.inf)


def _nearest(leg: Leg, attachment: Attachment, result: LegResult) -> tuple[Joints, Scalar]:
    """The home joints, or those of least residual, and the signed distance to the home mode's edge."""
    if result.reach is not None:
        pairs = zip(result.root, result.start, strict=True)
        outside = jnp.minimum(result.reach, -jnp.finfo(jnp.result_type(result.reach)).tiny)
        return tuple(jnp.where(result.solved, r, s) for r, s in pairs), jnp.where(result.solved, result.reach, outside)
    args = (leg, attachment)
    closest = least_squares(leg_residual, result.start, args)
    outside = leg.residual(lax.stop_gradient(closest), attachment)
    inside = fold_distance(leg_residual, result.root, args)
    # a root in another mode has no residual: it is as far outside as its own fold
    short = jnp.where(result.converged, inside, safe_sqrt(sum(r * r for r in outside)))
    short = jnp.maximum(short, jnp.finfo(jnp.result_type(short)).tiny)
    joints = tuple(jnp.where(result.solved, r, lax.stop_gradient(c)) for r, c in zip(result.root, closest, strict=True))
    return joints, jnp.where(result.solved, inside, -short)
