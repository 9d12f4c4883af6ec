"""How the balance of forces changes with the pose."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp

from jaxscissor._engine.left_inverse import left_inverse
from jaxscissor._engine.numerics import safe_divide, safe_sqrt
from jaxscissor._engine.types import PyTree
from jaxscissor.kinematics._jacobians import leg_jacobian
from jaxscissor.robots._contract import Attachment, Joints, Leg, constraints_on, seen_by_legs
from jaxscissor.robots._over_legs import over_legs
from jaxscissor.statics._balance import Balance, Case, numbers_of, pushes_of_legs, slope_of_weight
from jaxscissor.statics._bodies import Bodies


def tangent_stiffness(case: Case, state: Balance, forces: jax.Array, actuator_stiffness: jax.Array) -> jax.Array:
    """d (wrench that holds the platform) / d twist ``(d, d)``, with springs in the actuators and a constant wrench.

    With the slope G = dV/dt - J^T f - C^T c of everything but the wrench, where actuator forces change by -k dq:
    K = J^T k J + dG/dt at constant forces f and c. The second part is taken in two steps, from the platform to the
    attachments and from there through each leg, whose joints follow by its own Jacobian.

    Args:
      case, state: robot and pose.
      forces: ``(d,)`` of actuators, then of constraints.
      actuator_stiffness: ``(m,)``.
    """
    driven = state.rows[: state.actuators]
    legs, placed = state.legs, state.placed
    curved = partial(_leg_curvature, gravity=case.load.gravity)
    pushes = pushes_of_legs(case.robot, forces)
    pulls, curvature = over_legs(curved, placed.legs, placed.attachments, legs.joints, pushes, legs.bodies)
    total = driven.T @ (actuator_stiffness[:, None] * driven)
    total = total + jnp.einsum("lni,lnm,lmj->ij", legs.moved, curvature, legs.moved)
    return total + _platform_curvature(case, state, pulls, forces[state.actuators :])


def bordered_inverse(matrix: jax.Array, rows: jax.Array) -> jax.Array:
    """Inverse of [[K, C^T], [C, 0]] for a stiffness or compliance K ``(d, d)`` and rows C ``(c, d)``; zero if none.

    Unknowns and equations are scaled by K's diagonal first, so that no unit matters.
    """
    scale = safe_divide(1, jnp.sqrt(jnp.abs(jnp.where(jnp.diag(matrix) == 0, 1, jnp.diag(matrix)))))
    scaled = rows * scale[None]
    each = safe_divide(1, safe_sqrt(jnp.sum(scaled**2, axis=1)))
    scaled = scaled * each[:, None]
    corner = jnp.zeros((rows.shape[0], rows.shape[0]), matrix.dtype)
    whole = jnp.block([[matrix * scale[:, None] * scale[None], scaled.T], [scaled, corner]])
    both = jnp.concatenate([scale, each])
    return left_inverse(whole) * both[:, None] * both[None]


def _leg_curvature(
    leg: Leg, attachment: Attachment, joints: Joints, pushes: jax.Array, bodies: Bodies | None, gravity: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """First and second derivative of V - f . q of one leg, by what it sees of the platform."""
    numbers, tree = jax.tree.flatten(attachment)
    count = len(numbers)

    def slope(values: jax.Array) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        seen, q = jax.tree.unflatten(tree, tuple(values[:count])), tuple(values[count:])
        _, motion = leg_jacobian(leg, seen, q)
        value = slope_of_weight(leg, seen, q, motion, bodies, gravity) - pushes @ motion
        return value, (value, motion)

    both, (value, motion) = jax.jacfwd(slope, has_aux=True)(jnp.stack([*numbers, *joints]))
    return value, both[:, :count] + both[:, count:] @ motion


def _platform_curvature(case: Case, state: Balance, pulls: jax.Array, bound: jax.Array) -> jax.Array:
    """Second derivative by twist of what the legs see, the platform's potential and the constraints, weighed by forces.

    The first step goes along the twist of which the derivative is the wrench, after the second.
    """
    robot = case.robot
    space, placed = robot.space, state.placed

    def energy(step: jax.Array, moved: PyTree) -> jax.Array:
        position, rotation = space.nudge(*moved, tuple(step))
        numbers = numbers_of(seen_by_legs(robot, position, rotation))
        total = case.load.potential(position, rotation) + jnp.sum(pulls * numbers)
        for force, equation in zip(bound, constraints_on(robot, position, rotation), strict=True):
            total = total - force * equation
        return total

    still = jnp.zeros_like(case.pose)

    def wrench(twist: jax.Array) -> jax.Array:
        return jax.grad(energy)(still, space.nudge(placed.position, placed.rotation, tuple(twist)))

    return jax.jacfwd(wrench)(still)
