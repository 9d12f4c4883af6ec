"""How motion is geared from the actuators to the platform: gear ratios and height amplification."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from jaxscissor._engine.matrices import inverse, is_regular, singular_values
from jaxscissor._engine.numerics import Scalar, safe_divide, safe_sqrt
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_floats, pytree
from jaxscissor._engine.types import Numbers, PoseLike
from jaxscissor.kinematics._jacobians import constraint_rows, twist_jacobian
from jaxscissor.robots._contract import (
    Mechanism,
    actuated_mask,
    angular_joints,
    checked_freedoms,
    checked_pose,
)


@pytree
class GearRatios:
    """Platform motion per motion of the actuators, of which one that turns moves by the robot's length per radian.

    Attributes:
      translation: as many as the pose has lengths, ascending, dimensionless.
      rotation: as many as it has angles, ascending, radians per unit of length.
      vertical: along z; ``None`` of robots whose pose has no z.
    """

    translation: jax.Array
    rotation: jax.Array
    vertical: Any


@one_pose()
def gear_ratios(robot: Mechanism, pose: PoseLike) -> GearRatios:
    """Spatial gear ratios: reciprocal singular values of the twist Jacobian's blocks [ICRA16 eqs. 18, 34-35].

    Each is the ratio of a translation without rotation, or of a rotation about the reference point, to the motion of
    the actuators. A platform that cannot move freely has no such motions in general: of robots with constraints on the
    pose the ratios are the singular values of both blocks of the twist per unit of actuator motion, over the motions
    that exist, zero where there are fewer, and the vertical one is the greatest rate of z.

    Args:
      robot: the robot; every array in it is differentiable.
      pose: ``(d,)`` in the base frame.

    Returns:
      ``GearRatios``, dimensionless for motors that turn, too: times ``robot.length`` it is length per radian. The
      vertical one is 1 / |column z| where nothing is bound. All ``nan`` where the home mode does not exist, or the
      constraints and the actuators leave the platform loose.

    Raises:
      ValueError: wrong shape; a robot with fewer actuated joints than freedoms.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> round(float(js.gear_ratios(robot, [0, 0, 0.9144, 0, 0, 0]).vertical), 3)
      2.15
    """
    robot, pose = checked_pose(robot, pose)
    checked_freedoms(robot, more=True)
    usable, matrix = _lengths_by_twist(robot, pose)
    linear = robot.space.translations
    bound = constraint_rows(robot, pose)
    if bound is not None:
        return _bound_ratios(robot, usable, matrix, bound)
    any_matrix = jnp.eye(*matrix.shape, dtype=matrix.dtype)
    matrix = jnp.where(usable, matrix, any_matrix)

    def ratios(block: jax.Array):
        if not block.shape[1]:
            return jnp.zeros(0, block.dtype)
        return jnp.where(usable, 1 / singular_values(block), jnp.nan)

    vertical = _vertical(robot, usable, matrix) if "z" in robot.space.names else None
    return GearRatios(ratios(matrix[:, :linear]), ratios(matrix[:, linear:]), vertical)


def _bound_ratios(robot: Mechanism, usable: Scalar, matrix: jax.Array, bound: jax.Array) -> GearRatios:
    """The ratios of a platform that the constraints' rows bind, from the joints' rows and theirs together."""
    whole = jnp.concatenate([matrix, bound])
    usable = usable & is_regular([list(row) for row in whole])
    per_joint = inverse(jnp.where(usable, whole, jnp.eye(len(whole), dtype=whole.dtype)))[:, : len(matrix)]
    linear = robot.space.translations

    def sizes(block: jax.Array):
        if not len(block):
            return jnp.zeros(0, block.dtype)
        filled = jnp.pad(block.T, [(0, max(len(block) - block.shape[1], 0)), (0, 0)])
        return jnp.where(usable, singular_values(filled)[::-1], jnp.nan)

    rise = None
    if "z" in robot.space.names:
        rates = per_joint[robot.space.names.index("z")]
        rise = jnp.where(usable, safe_sqrt(jnp.sum(rates**2)), jnp.nan)
    return GearRatios(sizes(per_joint[:linear]), sizes(per_joint[linear:]), rise)


def _lengths_by_twist(robot: Mechanism, pose: jax.Array) -> tuple[Scalar, jax.Array]:
    """The twist Jacobian with every actuated joint as a length: a norm over turns and lengths would know the unit."""
    usable, matrix = twist_jacobian(robot, pose)
    turns = [angle for angle, used in zip(angular_joints(robot), actuated_mask(robot), strict=True) if used]
    return usable, matrix * jnp.where(jnp.array(turns), robot.length, 1)[:, None]


def _vertical(robot: Mechanism, usable: Scalar, matrix: jax.Array) -> jax.Array:
    """Reciprocal norm of the column that belongs to z."""
    column = matrix[:, robot.space.names.index("z")]
    return jnp.where(usable, safe_divide(1, safe_sqrt(jnp.sum(column**2))), jnp.nan)


@one_pose()
def height_amplification(robot: Mechanism, reference: Mechanism, heights: Numbers) -> jax.Array:
    """Vertical gear ratio of a robot over that of a reference, level on the axis [RAL17 eq. 21].

    Args:
      robot: the robot; every array in it is differentiable.
      reference: the robot to compare with, such as one with k1 = 1.
      heights: z of the platform, any shape, in the robots' unit of length.

    Returns:
      One ratio per height; ``nan`` where either robot does not reach it. It is constant in z only if
      ``top_radius == actuator_radius`` in both robots.

    Raises:
      ValueError: robots whose pose is not spatial.

    Example:
      >>> import jaxscissor as js
      >>> tall = js.TripleScissorExtender.from_ratios(0.25, 0.0, 0.1, 0.1)
      >>> rigid = js.TripleScissorExtender.from_ratios(1.0, 0.0, 0.1, 0.1)
      >>> js.height_amplification(tall, rigid, jnp.array([0.4, 0.8])).round(3).tolist()
      [4.0, 4.0]
    """
    if robot.space.names[:3] != ("x", "y", "z") or reference.space != robot.space:
        raise ValueError("Height amplification compares two robots that move in x, y and z.")
    robot, reference, heights = as_floats(robot, reference, jnp.asarray(heights))

    def ratio(height: Scalar):
        pose = jnp.zeros(robot.space.dimension, height.dtype).at[2].set(height)
        here, there = (_vertical(one, *_lengths_by_twist(one, pose)) for one in (robot, reference))
        return here / there

    return jax.vmap(ratio)(heights.ravel()).reshape(heights.shape)
