"""One pose put into a robot, and each leg solved for it: what inverse kinematics and feasibility share."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.newton import newton
from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.types import Number
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.kinematics._solution import Status
from jaxscissor.robots._contract import (
    MAX_STEPS,
    Attachment,
    Joints,
    Leg,
    Mechanism,
    differentiable_roots,
    joints_by_leg,
    joints_together,
    leg_residual,
    seen_by_legs,
)
from jaxscissor.robots._over_legs import over_legs


class LegResult(NamedTuple):
    """One leg solved for one attachment, or every leg, stacked."""

    root: Joints  # without derivative; worthless where not solved
    start: Joints  # the first guess, which beyond the home mode's edge has the least residual
    solved: Scalar  # whether the root is in the wanted mode
    converged: Scalar  # whether it is a root at all
    reach: Scalar | None
    norm: Scalar
    steps: Scalar

    @property
    def value(self) -> Joints:
        """The root, or where there is none the closest joints, with zero derivative."""
        fixed = lax.stop_gradient(self.start)
        return tuple(jnp.where(self.converged, r, s) for r, s in zip(self.root, fixed, strict=True))


def solve_leg(
    leg: Leg,
    attachment: Attachment,
    home: Scalar | None,
    *,
    guess: Joints | None,
    tol: Scalar,
    max_steps: Scalar,
) -> LegResult:
    """Solve one leg in the mode with its home's label, or in the guess's if a guess is given.

    1. Start from the guess, or from the leg's own, which comes with the reach of the home mode if it is known.
    2. Newton's method, unless the reach says that the home mode does not exist.
    3. The root counts if its residual does and, where no reach is known, if its mode is the one wanted.
    """
    args = (leg, attachment)
    start, reach = leg.start(attachment) if guess is None else (guess, None)
    reach = fence(reach)  # it decides more than once, and evaluated anew it may round to the other side of zero
    active = jnp.asarray(True) if reach is None else lax.stop_gradient(reach) >= 0
    root, error, steps = newton(leg_residual, start, args, tol=tol, max_steps=max_steps, active=active)
    converged = active & (error <= tol)
    if reach is None:
        wanted = home if guess is None else leg.mode(guess, attachment)
        solved = fence(converged & (leg.mode(root, attachment) == wanted))  # a verdict: once
    else:
        solved = converged
    return LegResult(root, start, solved, converged, reach, error, steps)


def leg_status(leg: Leg, attachment: Attachment, result: LegResult) -> Scalar:
    """Status of one leg; where the home mode fails, the existence of any root decides between the failures."""
    exists = leg.assembles(lax.stop_gradient(attachment))
    if exists is None:
        failure = jnp.where(result.converged, Status.OTHER_MODE, Status.MAX_STEPS)
    else:
        exists = exists | result.converged
        failure = jnp.where(exists, Status.OTHER_MODE, Status.NO_SOLUTION)
        if result.reach is None:  # a guess was given and Newton did not get there: nothing is proved by that
            failure = jnp.where(exists & ~result.converged, Status.MAX_STEPS, failure)
        else:
            failure = jnp.where(result.reach >= 0, Status.MAX_STEPS, failure)
    return jnp.where(result.solved, Status.CONVERGED, failure).astype(jnp.int32)


class Placed(NamedTuple):
    """A pose put into the robot: nan and infinity replaced by home, so that nothing spreads."""

    finite: Scalar
    pose: jax.Array
    position: Vec
    rotation: Rotation
    legs: Any  # stacked, as are the attachments
    attachments: Attachment


def place(robot: Mechanism, pose: jax.Array) -> Placed:
    """Evaluate what the legs see of the platform, at the pose and at home."""
    home_pose, _ = robot.home()
    inverse = 1 / lax.stop_gradient(robot.length)
    finite = jnp.isfinite(fence(sum((x * inverse) ** 2 for x in pose)))  # once, not for every coordinate
    # number by number: a batch of vectors would be stored once more
    pose = jnp.stack([jnp.where(finite, x, h) for x, h in zip(pose, lax.stop_gradient(home_pose), strict=True)])
    position, rotation = robot.space.place(pose)
    seen = fence(seen_by_legs(robot, position, rotation))  # every derivative of a leg would turn the platform anew
    return Placed(finite, pose, position, rotation, robot.legs(), seen)


def home_modes(robot: Mechanism, placed: Placed) -> Scalar | None:
    """Label of every leg's working mode at home; ``None`` if the leg's reach is known in closed form."""
    leg, seen = jax.tree.map(lambda leaf: leaf[0], (placed.legs, placed.attachments))
    if jax.eval_shape(lambda leg, seen: leg.start(seen), leg, seen)[1] is not None:
        return None
    pose, joints = robot.home()
    cases = placed.legs, joints_by_leg(robot, joints), seen_by_legs(robot, *robot.space.place(pose))
    return over_legs(lambda leg, q, seen: leg.mode(q, seen), *lax.stop_gradient(cases))


def solve_legs(
    robot: Mechanism, placed: Placed, guess: jax.Array | None, tol: Number, max_steps: Number
) -> tuple[LegResult, Scalar]:
    """Every leg of a placed robot solved, with its status; of the results only the roots have derivatives."""
    results, status = solve_legs_only(robot, placed, guess, tol, max_steps)
    root = differentiable_roots(placed.legs, placed.attachments, results.root, results.converged)
    return results._replace(root=root), status


def solve_legs_only(
    robot: Mechanism, placed: Placed, guess: jax.Array | None, tol: Number, max_steps: Number
) -> tuple[LegResult, Scalar]:
    """The same without derivatives."""
    homes, guesses = (home_modes(robot, placed), None) if guess is None else (None, joints_by_leg(robot, guess))

    def solve(leg: Leg, attachment: Attachment, home: Scalar | None, start: Joints | None):
        result = solve_leg(leg, attachment, home, guess=start, tol=tol, max_steps=max_steps)
        return result, leg_status(leg, attachment, result)

    return over_legs(solve, *lax.stop_gradient((placed.legs, placed.attachments, homes, guesses)))


def closest_joints(robot: Mechanism, pose: jax.Array, tol: Number) -> jax.Array:
    """All joints of the home working mode at a pose, or where it does not exist the closest to it."""
    results, _ = solve_legs(robot, place(robot, pose), None, tol, MAX_STEPS)
    return joints_together(robot, results.value)
