"""A check of a user's own robot against the contract."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.newton import newton, norm
from jaxscissor._engine.numerics import default_tol
from jaxscissor._engine.programs import run_once
from jaxscissor._engine.pytree import as_floats
from jaxscissor.kinematics._constraints import constrained_pose
from jaxscissor.kinematics._feasibility import margins
from jaxscissor.kinematics._forward import forward_kinematics
from jaxscissor.kinematics._inverse import inverse_kinematics
from jaxscissor.kinematics._legs import MAX_STEPS, place
from jaxscissor.kinematics._residual import residual
from jaxscissor.kinematics._solution import Status
from jaxscissor.robots._contract import (
    Attachment,
    Joints,
    Leg,
    Mechanism,
    actuation,
    angular_joints,
    checked_freedoms,
    joints_by_leg,
    leg_residual,
    seen_by_legs,
)
from jaxscissor.robots._over_legs import one_by_one, over_legs

_ANGLES = 0.3, 2.0, 4.0  # on a circle
_STEP, _CLOSE = 1e-5, 1e-4  # of differences, and how well they agree with derivatives


def check_robot(robot: Mechanism, *, poses: int = 256, seed: int = 0) -> None:
    """Check a robot against the contract, and say what is wrong with which method.

    To be run once, while a robot of one's own is being written; it compiles some programs and takes some seconds. It
    checks

    1. what the methods give: how many, of which shapes, and at least as many actuated joints as freedoms;
    2. home: it closes, inverse kinematics and forward kinematics give it back, its margins are not negative;
    3. ``start`` at random poses around home: where the reach is >= 0 Newton's method finds a root in home's working
       mode, and where it is negative there is none;
    4. ``circle``: the equations hold all around it; ``solutions``: each closes, and no other root is found from them;
    5. derivatives of inverse kinematics against differences, and everything once more in single precision.

    Args:
      robot: the robot, with its numbers.
      poses: number of random poses.
      seed: of the random poses.

    Raises:
      ValueError: everything that was found wrong, one line for each.

    Example:
      >>> import jaxscissor as js
      >>> js.check_robot(js.StewartGough.prototype())
    """
    (robot,) = as_floats(robot)
    for group in (_counts, _circles, _home, partial(_random_poses, poses=poses, seed=seed), _single_precision):
        try:
            found = list(group(robot))
        except (ValueError, NotImplementedError) as error:  # a method that gave the wrong thing; the rest rests on it
            found = [str(error)]
        if found:
            lines = "\n".join(f"  {line}" for line in found)
            raise ValueError(f"{type(robot).__name__} does not keep the contract:\n{lines}")


def _counts(robot: Mechanism) -> Iterator[str]:
    """What can be told without evaluating anything; the methods themselves refuse what is wrong with them."""
    space = robot.space
    pose, joints = robot.home()

    def alone(robot: Mechanism, pose: jax.Array):
        cases = one_by_one(robot.legs(), seen_by_legs(robot, *space.place(pose)))
        return robot.length, [(leg.start(seen), leg.solutions(seen)) for leg, seen in cases]

    def together(robot: Mechanism, pose: jax.Array, joints: jax.Array):
        cases = one_by_one(robot.legs(), joints_by_leg(robot, joints), seen_by_legs(robot, *space.place(pose)))
        return [[getattr(leg, name)(*case) for name in ("residual", "margins", "mode")] for leg, *case in cases]

    jax.eval_shape(alone, robot, pose)
    count = sum(map(len, actuation(robot)))
    if joints.shape != (count,):
        yield f"home() gave {len(joints)} joints; the legs have {count}: one entry per joint, leg by leg."
        return
    jax.eval_shape(together, robot, pose, joints)
    checked_freedoms(robot, more=True)


def _home(robot: Mechanism) -> Iterator[str]:
    pose, joints = robot.home()
    tol = default_tol(pose.dtype)
    if not (np.isfinite(pose).all() and np.isfinite(joints).all()):
        yield f"home() gave numbers that are not finite: {pose}, {joints}."
        return
    error = np.abs(residual(robot, pose, joints=joints))
    if error.max() > 1e3 * tol:
        yield (
            f"home() does not close: equation {int(error.argmax())} of residual and constraints is {error.max():.1e} "
            "there, and should be zero. Give joints that meet the legs' equations at the pose."
        )
        return
    reaches = np.asarray(_reaches(robot, pose))
    if (reaches < -1e3 * tol).any():
        yield (
            f"start() gives leg {int(reaches.argmin()) + 1} the reach {reaches.min():.2g} at home, where its home mode "
            "exists; the reach must be >= 0 wherever it does."
        )
        return
    solution = inverse_kinematics(robot, pose)
    apart = _apart(robot, solution.value, joints)
    if solution.status != Status.CONVERGED or apart > np.sqrt(tol):
        yield (
            f"inverse_kinematics at home's pose says {Status(int(solution.status)).name} and ends {apart:.1e} from "
            "home's joints: start() does not lead to the working mode of home()."
        )
    back = forward_kinematics(robot, robot.actuated(joints))
    if back.status != Status.CONVERGED:
        yield f"forward_kinematics at home's joints says {Status(int(back.status)).name}: home() may be singular."
    least = np.asarray(margins(robot, pose)).min()
    if least < 0:
        yield f"margins() at home has {least:.2g}: home() is beyond a limit, so that no pose around it is feasible."


def _circles(robot: Mechanism) -> Iterator[str]:
    errors = np.asarray(_off_circles(robot))
    if errors.max(initial=0) > 1e3 * default_tol(errors.dtype):
        yield (
            f"circle() of leg {int(errors.argmax()) + 1} leaves the points that the leg can hold with home's joints: "
            f"residual() is {errors.max():.1e} on it, and should be zero."
        )


@run_once
def _off_circles(robot: Mechanism) -> jax.Array:
    """Largest residual on the circle of every leg that knows its own, at home's joints."""
    cases = one_by_one(robot.legs(), joints_by_leg(robot, robot.home()[1]))
    found = [(leg, own, leg.circle(own)) for leg, own in cases]
    known = [(leg, own, circle) for leg, own, circle in found if circle is not None]
    errors = [[norm(leg.residual(own, circle.at(angle))) for angle in _ANGLES] for leg, own, circle in known]
    return jnp.max(jnp.array(errors), axis=1) if errors else jnp.zeros(0)


@run_once
def _reaches(robot: Mechanism, pose: jax.Array) -> jax.Array:
    """The reach of every leg at a pose; zero where none is known."""
    placed = place(robot, pose)
    found = [leg.start(seen)[1] for leg, seen in one_by_one(placed.legs, placed.attachments)]
    return jnp.stack([jnp.zeros_like(pose[0]) if reach is None else reach for reach in found])


def _random_poses(robot: Mechanism, *, poses: int, seed: int) -> Iterator[str]:
    drawn = _drawn(robot, poses, seed)
    report = _legs_reports(robot, drawn)
    for mistake, what in (
        (report.no_root, "start() says that the home mode is in reach, but Newton's method finds no root of it"),
        (report.root, "start() says that the home mode is out of reach, but there is a root of it"),
        (report.open, "solutions() has a root that does not meet residual()"),
        (report.missing, "the root of inverse kinematics is not among those of solutions()"),
    ):
        if np.any(mistake):
            yield _at(drawn, np.asarray(mistake), what)
    yield from _derivatives(robot, drawn[: poses // 8 + 1])


class _LegsReport(NamedTuple):
    """Mistakes at a pose, one truth value per leg."""

    no_root: jax.Array  # where the reach is >= 0
    root: jax.Array  # where it is negative
    open: jax.Array
    missing: jax.Array


@run_once
@partial(jax.vmap, in_axes=(None, 0))
def _legs_reports(robot: Mechanism, pose: jax.Array) -> _LegsReport:
    placed = place(robot, pose)
    home_pose, home_joints = robot.home()
    at_home = seen_by_legs(robot, *robot.space.place(home_pose))
    return over_legs(_leg_report, placed.legs, placed.attachments, joints_by_leg(robot, home_joints), at_home)


def _leg_report(leg: Leg, attachment: Attachment, home: Joints, at_home: Any) -> _LegsReport:
    tol = default_tol(jnp.result_type(home[0]))
    edge = 1e3 * tol  # nearer than this to the edge of a mode, rounding decides

    def solved(guess: Joints):
        root, error, _ = newton(leg_residual, guess, (leg, attachment), tol=tol, max_steps=MAX_STEPS)
        return root, (error <= tol) & (leg.mode(root, attachment) == leg.mode(home, at_home))

    start, reach = leg.start(attachment)
    root, found = solved(start)
    no = jnp.asarray(False)
    no_root = no if reach is None else (reach > edge) & ~found
    beyond = no if reach is None else (reach < -edge) & (found | solved(home)[1])
    solutions = leg.solutions(attachment)
    if solutions is None:
        return _LegsReport(no_root, beyond, no, no)
    values, real = jnp.stack([jnp.stack(joints) for joints in solutions[0]]), jnp.stack(solutions[1])
    errors = jnp.stack([norm(leg.residual(joints, attachment)) for joints in solutions[0]])
    apart = jnp.max(jnp.abs(values - jnp.stack(root)[None]), axis=1)
    missing = found & ~jnp.any(real & (apart < jnp.sqrt(edge) * (1 + norm(root))))
    return _LegsReport(no_root, beyond, jnp.any(real & (errors > edge)), missing)


def _joints(robot: Mechanism, pose: jax.Array) -> jax.Array:
    """The joints at a pose that the constraints complete; ``nan`` where there are none."""
    solution = inverse_kinematics(robot, constrained_pose(robot, pose).value)
    return jnp.where(solution.converged, solution.value, jnp.nan)


_constrained = run_once(jax.vmap(constrained_pose, (None, 0)))
_slopes = run_once(jax.vmap(jax.jacfwd(_joints, 1), (None, 0)))
_ends = run_once(jax.vmap(jax.vmap(_joints, (None, 0)), (None, 0)))


def _derivatives(robot: Mechanism, poses: jax.Array) -> Iterator[str]:
    """Derivatives of inverse kinematics by the pose against differences, along the constraints if there are any."""

    free = [i for i, name in enumerate(robot.space.names) if name not in robot.dependent]
    unit = np.where(np.arange(len(robot.space.names)) < robot.space.translations, float(robot.length), 1.0)
    steps = _STEP * np.stack([sign * unit * np.eye(len(unit))[i] for i in free for sign in (1, -1)])
    slopes = np.asarray(_slopes(robot, poses)) * unit
    ends = np.asarray(_ends(robot, poses[:, None] + steps[None]))
    whole = np.isfinite(ends).all(axis=(1, 2))
    if not whole.any():
        yield "inverse_kinematics converges at none of the random poses around home."
        return
    for number, i in enumerate(free):
        difference = (ends[whole, 2 * number] - ends[whole, 2 * number + 1]) / (2 * _STEP)
        off = np.abs(slopes[whole][:, :, i] - difference).max() / max(1.0, np.abs(difference).max())
        if not off < _CLOSE:
            yield (
                f"the derivative of inverse kinematics by {robot.space.names[i]} is off by {off:.1e} from differences: "
                "residual() has a number that JAX cannot differentiate, or that does not reach it as a JAX array."
            )


def _single_precision(robot: Mechanism) -> Iterator[str]:
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), robot)
    pose, joints = single.home()
    solution = inverse_kinematics(single, pose)
    kinds = {str(x.dtype) for x in (pose, joints, solution.value, margins(single, pose))}
    if kinds != {"float32"}:
        yield f"a robot in float32 gives {sorted(kinds)}: a number of another type enters one of its methods."
    if solution.status != Status.CONVERGED:
        yield (
            f"in float32 inverse kinematics at home says {Status(int(solution.status)).name}: residual() loses digits; "
            "make its terms of order one before they are subtracted."
        )


def _drawn(robot: Mechanism, count: int, seed: int) -> jax.Array:
    """Random poses that meet the constraints, first near home, then up to a length of the robot and a radian away."""
    home, _ = robot.home()
    unit = np.where(np.arange(len(home)) < robot.space.translations, float(robot.length), 1.0)
    away = np.linspace(0.05, 1, count)[:, None] * np.random.default_rng(seed).uniform(-1, 1, (count, len(home)))
    drawn = jnp.asarray(np.asarray(home) + unit * away, home.dtype)
    whole = _constrained(robot, drawn)
    return whole.value[np.asarray(whole.converged)]


def _apart(robot: Mechanism, one: jax.Array, other: jax.Array) -> float:
    """Largest difference of two sets of joints, lengths in units of the robot's, angles around the circle."""
    x = np.asarray(one - other)
    turned = np.arctan2(np.sin(x), np.cos(x))
    return float(np.abs(np.where(angular_joints(robot), turned, x / float(robot.length))).max())


def _at(poses: jax.Array, wrong: np.ndarray, what: str) -> str:
    """The sentence with how often and where, for an array ``(poses, legs)``."""
    pose, leg = map(int, np.argwhere(wrong)[0])
    where = np.asarray(poses[pose]).round(4).tolist()
    return f"{what}: at {int(wrong.any(axis=1).sum())} of {len(poses)} random poses, first leg {leg + 1} at {where}."
