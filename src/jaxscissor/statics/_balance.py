"""The balance of forces at a pose, by virtual work: what actuator forces, payload, stiffness and sag share."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.left_inverse import left_inverse
from jaxscissor._engine.numerics import Scalar, default_tol, safe_divide, safe_sqrt
from jaxscissor._engine.types import Numbers, PoseLike, PyTree
from jaxscissor.kinematics._jacobians import constraint_rows, leg_jacobian
from jaxscissor.kinematics._legs import MAX_STEPS, Placed, place, solve_legs
from jaxscissor.kinematics._solution import Status
from jaxscissor.robots._contract import (
    Attachment,
    Joints,
    Leg,
    Mechanism,
    actuated_mask,
    angular_joints,
    checked_freedoms,
    checked_pose,
    constraints_on,
    joints_by_leg,
    joints_together,
    seen_by_legs,
)
from jaxscissor.robots._over_legs import over_legs
from jaxscissor.statics._bodies import Bodies, bodies_of, weight_potential
from jaxscissor.statics._load import Load
from jaxscissor.statics._materials import Section


class Case(NamedTuple):
    """A robot at a pose with what weighs on it, every array in one dtype."""

    robot: Any
    pose: jax.Array
    wrench: jax.Array  # on the platform, (d,)
    load: Load
    section: Section | None


class LegState(NamedTuple):
    """The legs at a pose, stacked, as the balance sees them; numbers are those of an attachment."""

    joints: Joints
    motion: jax.Array  # d joints / d numbers
    weight: jax.Array  # d potential of the bars / d numbers
    moved: jax.Array  # d numbers / d twist
    bodies: Bodies | None


class Balance(NamedTuple):
    """The legs at a pose, and the matrix that carries actuator forces and constraints to wrenches."""

    placed: Placed
    legs: LegState
    rows: jax.Array  # d (actuated joints, constraints) / d twist, square
    inverse: jax.Array  # of the rows; zero where there is none, so that whatever follows is finite
    actuators: int
    pull: jax.Array  # d potential of all weights / d twist
    status: Scalar

    @property
    def usable(self) -> Scalar:
        """Whether all numbers exist."""
        return self.status == Status.CONVERGED

    def hold(self, wrench: jax.Array) -> jax.Array:
        """Actuator and constraint forces ``(d,)`` that exert a wrench ``(d,)`` on the platform."""
        return wrench @ self.inverse

    def actuated(self, robot: Mechanism) -> jax.Array:
        """The actuated joints ``(m,)``."""
        return robot.actuated(joints_together(robot, self.legs.joints))

    def leg_forces(self, robot: Mechanism, forces: jax.Array) -> jax.Array:
        """What each leg exerts on the platform ``(legs, numbers)``, along what it sees, weights of its bars apart."""
        return jnp.einsum("lk,lkn->ln", pushes_of_legs(robot, forces), self.legs.motion)


def pushes_of_legs(robot: Mechanism, forces: jax.Array) -> jax.Array:
    """Of actuator forces, which others may follow, those on each leg's joints ``(legs, joints)``; passive ones none."""
    driven = np.flatnonzero(actuated_mask(robot))
    every = jnp.zeros(len(actuated_mask(robot)), forces.dtype).at[driven].set(forces[: len(driven)])
    return jnp.stack(joints_by_leg(robot, every), axis=1)


def checked_case(
    robot: Mechanism,
    pose: PoseLike,
    wrench: Numbers | None,
    load: Load | None,
    section: Section | None,
    *,
    more: bool = False,
) -> Case:
    """The arguments that all functions of this room take, in the dtype of robot and pose.

    Raises:
      ValueError: a wrong shape, or a robot with fewer actuated joints than freedoms; with more, unless
        these will do.
    """
    robot, pose = checked_pose(robot, pose)
    checked_freedoms(robot, more=more)
    wrench = jnp.zeros_like(pose) if wrench is None else jnp.asarray(wrench)
    if wrench.shape != pose.shape:
        raise ValueError(
            f"Got a wrench of shape {wrench.shape}; {type(robot).__name__} expects {pose.shape}: a force and then a "
            "moment about the platform's reference point, both in the base frame."
        )
    load = Load() if load is None else load
    given = jax.tree.map(lambda leaf: jnp.asarray(leaf, pose.dtype), (wrench, load, section))
    return Case(robot, pose, *given)


def per_actuator(robot: Mechanism, name: str, values: Numbers, dtype: Any) -> jax.Array:
    """One number per actuated joint, from as many or from one.

    Raises:
      ValueError: another shape.
    """
    count = sum(actuated_mask(robot))
    values = jnp.asarray(values, dtype)
    if values.shape not in ((), (count,)):
        raise ValueError(f"Got {name} of shape {values.shape}; expected () or ({count},), one per actuated joint.")
    return jnp.broadcast_to(values, (count,))


def balance(case: Case, *, bound: bool = True) -> Balance:
    """Put the robot at the pose; not ``bound``, constraints on the pose may be broken there.

    1. Solve its legs, and differentiate each one's joints and its bars' potential by what it sees of the platform.
    2. Differentiate what the legs see, the potential of platform and payload and the constraints by the twist.
    3. Join: rows of the actuated joints and of the constraints, and the slope of all potentials.
    """
    robot = case.robot
    placed = place(robot, case.pose)
    results, status = solve_legs(robot, placed, None, default_tol(case.pose.dtype), MAX_STEPS)
    status = jnp.where(placed.finite, jnp.max(status), Status.NONFINITE)
    bodies = None if case.section is None else bodies_of(robot, case.section)
    slopes = partial(_leg_slopes, gravity=case.load.gravity)
    regular, motion, weight = over_legs(slopes, placed.legs, placed.attachments, results.value, bodies)
    moved, pull = _platform_slopes(case, placed)
    legs = LegState(results.value, motion, weight, moved, bodies)
    driven = jnp.einsum("lkn,lnd->kld", motion, moved)
    rows = robot.actuated(joints_together(robot, tuple(driven)).T).T
    actuators = len(rows)
    constraints = constraint_rows(robot, case.pose)
    if constraints is not None:
        off = jnp.stack(constraints_on(robot, placed.position, placed.rotation))
        broken = jnp.sqrt(jnp.sum(off**2)) > default_tol(off.dtype)
        status = jnp.where(broken & bound, jnp.maximum(status, Status.NO_SOLUTION), status)
        rows = jnp.concatenate([rows, constraints])
    pull = pull + jnp.einsum("ln,lnd->d", weight, moved)
    usable = fence(jnp.all(regular) & (status == Status.CONVERGED))  # a verdict, which every entry would evaluate anew
    rows = jnp.where(usable, rows, 0)
    inverse = _inverse(robot, rows)
    singular = (status == Status.CONVERGED) & ~jnp.any(inverse != 0)
    status = jnp.where(singular, Status.SINGULAR, status).astype(jnp.int32)
    return Balance(placed, legs, rows, inverse, actuators, pull, status)


def _inverse(robot: Mechanism, rows: jax.Array) -> jax.Array:
    """Inverse of the rows by twist, made free of units before and given them after; zero where they are singular.

    Of more rows than columns the pseudoinverse, so that the forces are those of least norm, a moment counting as a
    force at a lever of the robot's length.
    """
    length = jnp.where(jnp.arange(rows.shape[1]) < robot.space.translations, 1, robot.length)
    scaled = rows / length[None]
    if len(rows) > len(length):
        turns = [turn for turn, used in zip(angular_joints(robot), actuated_mask(robot), strict=True) if used]
        unitless = jnp.array([*turns, *[True] * (len(rows) - len(turns))])
        size = jnp.where(unitless, 1 / robot.length, 1)
        unit = scaled / size[:, None]
        return (left_inverse(unit.T @ unit) @ unit.T) / size[None] / length[:, None]
    size = safe_sqrt(jnp.sum(scaled**2, axis=1))
    unit = scaled * safe_divide(1, size)[:, None]
    return left_inverse(unit) * safe_divide(1, size)[None] / length[:, None]


def _leg_slopes(
    leg: Leg, attachment: Attachment, joints: Joints, bodies: Bodies | None, gravity: jax.Array
) -> tuple[Scalar, jax.Array, jax.Array]:
    """Whether a leg is regular, and the derivatives of its joints and of its bars' potential by its attachment."""
    regular, motion = leg_jacobian(leg, attachment, joints)
    return jnp.asarray(regular), motion, slope_of_weight(leg, attachment, joints, motion, bodies, gravity)


def slope_of_weight(
    leg: Leg, attachment: PyTree, joints: Joints, motion: jax.Array, bodies: Bodies | None, gravity: jax.Array
) -> jax.Array:
    """d potential of a leg's bars / d numbers of its attachment, its joints following by ``motion``."""
    if bodies is None:
        return jnp.zeros_like(motion[0])

    numbers, tree = jax.tree.flatten(attachment)
    count = len(numbers)

    def potential(values: jax.Array) -> Scalar:
        seen = jax.tree.unflatten(tree, tuple(values[:count]))
        return weight_potential(leg, tuple(values[count:]), seen, bodies, gravity)

    slope = jax.grad(potential)(jnp.stack([*numbers, *joints]))
    return slope[:count] + slope[count:] @ motion


def _platform_slopes(case: Case, placed: Placed) -> tuple[jax.Array, jax.Array]:
    """By twist: what the legs see ``(legs, numbers, d)``, and the potential of platform and payload ``(d,)``."""

    def seen(twist: jax.Array):
        moved = case.robot.space.nudge(placed.position, placed.rotation, tuple(twist))
        return numbers_of(seen_by_legs(case.robot, *moved)), case.load.potential(*moved)

    return jax.jacfwd(seen)(jnp.zeros_like(case.pose))


def numbers_of(stacked: Attachment) -> jax.Array:
    """The numbers of stacked attachments ``(legs, numbers)``."""
    return jnp.stack(jax.tree.leaves(stacked), axis=1)
