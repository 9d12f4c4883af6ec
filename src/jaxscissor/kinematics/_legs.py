"""One pose put into a robot, and each leg solved for it: what inverse kinematics and feasibility share."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.newton import implicit, newton
from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.types import Number, PyTree
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.kinematics._solution import Status
from jaxscissor.robots._contract import (
    Attachment,
    Joints,
    Leg,
    Mechanism,
    join_joints,
    leg_residual,
    legs_of,
    seen_by_legs,
    split_joints,
)
from jaxscissor.robots._over_legs import over_legs

MAX_STEPS = 30


class LegResult(NamedTuple):
    """One leg solved for one attachment."""

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
        solved = fence(converged & (leg.mode(root, attachment) == wanted))
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
    legs: list[Any]
    attachments: list[Any]


def place(robot: Mechanism, pose: jax.Array) -> Placed:
    """Evaluate what the legs see of the platform, at the pose and at home."""
    home_pose, _ = robot.home()
    inverse = 1 / lax.stop_gradient(robot.length)
    finite = jnp.isfinite(fence(sum((x * inverse) ** 2 for x in pose)))
    # number by number: a batch of vectors would be stored once more
    pose = jnp.stack([jnp.where(finite, x, h) for x, h in zip(pose, lax.stop_gradient(home_pose), strict=True)])
    position, rotation = robot.space.place(pose)
    legs = legs_of(robot)
    attachments = list(fence(seen_by_legs(robot, len(legs), position, rotation)))
    return Placed(finite, pose, position, rotation, legs, attachments)


def home_modes(robot: Mechanism, placed: Placed) -> list[Scalar | None]:
    """Label of every leg's working mode at home; ``None`` if the leg's reach is known in closed form."""
    leg, attachment = placed.legs[0], placed.attachments[0]
    if jax.eval_shape(lambda leg, attachment: leg.start(attachment), leg, attachment)[1] is not None:
        return [None] * len(placed.legs)
    pose, joints = robot.home()
    cases = list(zip(split_joints(robot, joints), robot.attachments(*robot.space.place(pose)), strict=True))
    return over_legs(lambda leg, case: leg.mode(*case), *lax.stop_gradient((robot.legs(), cases)))


def differentiable_root(leg: Leg, attachment: Attachment, result: LegResult) -> LegResult:
    """The result with the implicit function's derivative of its root."""
    return result._replace(root=implicit(leg_residual, result.root, result.converged, (leg, attachment)))


def solve_legs(
    robot: Mechanism, placed: Placed, guess: jax.Array | None, tol: Number, max_steps: Number
) -> tuple[list[LegResult], list[Scalar]]:
    """Every leg of a placed robot solved, with its status; of the results only the roots have derivatives."""
    results, statuses = solve_legs_only(robot, placed, guess, tol, max_steps)
    cases = zip(placed.legs, placed.attachments, results, strict=True)
    return [differentiable_root(*case) for case in cases], statuses


def solve_legs_only(
    robot: Mechanism, placed: Placed, guess: jax.Array | None, tol: Number, max_steps: Number
) -> tuple[list[LegResult], list[Scalar]]:
    """The same without derivatives."""
    none = [None] * len(placed.legs)
    homes, guesses = (home_modes(robot, placed), none) if guess is None else (none, split_joints(robot, guess))
    seen = list(zip(placed.attachments, homes, guesses, strict=True))

    def solve(leg: Leg, case: PyTree):
        attachment, home, start = case
        result = solve_leg(leg, attachment, home, guess=start, tol=tol, max_steps=max_steps)
        return result, leg_status(leg, attachment, result)

    solved = over_legs(solve, *lax.stop_gradient((robot.legs(), seen)))
    return [result for result, _ in solved], [status for _, status in solved]


def closest_joints(robot: Mechanism, pose: jax.Array, tol: Number) -> jax.Array:
    """All joints of the home working mode at a pose, or where it does not exist the closest to it."""
    results, _ = solve_legs(robot, place(robot, pose), None, tol, MAX_STEPS)
    return join_joints(robot, [result.value for result in results])
