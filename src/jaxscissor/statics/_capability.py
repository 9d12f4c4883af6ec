"""Which forces and velocities a platform is capable of: polytopes and ellipsoids of limited actuators."""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.matrices import singular_values
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import pytree
from jaxscissor._engine.types import Numbers, PoseLike
from jaxscissor.kinematics._solution import Status
from jaxscissor.robots._contract import Mechanism
from jaxscissor.statics._balance import Balance, balance, checked_case, per_actuator
from jaxscissor.statics._load import Load
from jaxscissor.statics._materials import Section


@pytree
class Capability:
    """Forces or velocities at one pose, or at a batch under ``vmap``; ``nan`` unless ``CONVERGED``.

    Attributes:
      vertices: ``(2^m, d)`` corners of the polytope: wrenches or twists with every actuator at one of its limits.
      translation: ``(3, 3)`` or ``(2, 2)`` ellipsoid of forces without moment, or of velocities without rotation: those
        x with x' Q x <= 1, for which the actuators' shares of their limits have a norm of at most one.
      rotation: the same of moments without force, or of rotations about the reference point; ``(0, 0)`` if there are
        none.
      translation_radii, rotation_radii: the ellipsoids' half-axes, ascending.
      status: see ``actuator_forces``.
    """

    vertices: jax.Array
    translation: jax.Array
    rotation: jax.Array
    translation_radii: jax.Array
    rotation_radii: jax.Array
    status: jax.Array

    @property
    def ok(self) -> jax.Array:
        """Whether the status is ``CONVERGED``."""
        return self.status == Status.CONVERGED


@one_pose()
def force_capability(
    robot: Mechanism,
    pose: PoseLike,
    *,
    force_limit: Numbers,
    load: Load | None = None,
    section: Section | None = None,
) -> Capability:
    """Wrenches on the platform that actuators of limited force hold, about its reference point, in the base frame.

    With J^T f = dV/dt - w, the polytope is the image of the box |f| <= limit; weights shift it. The ellipsoids are
    those of the actuators alone, without weights.

    Args:
      robot: the robot, without constraints on its pose; every array in it is differentiable.
      pose: ``(d,)`` in the base frame.
      force_limit: ``()`` or ``(m,)`` of each actuator, a moment of one that turns.
      load: masses of platform and payload, and gravity. Default: no masses.
      section: of the bars. Default: no weight.

    Returns:
      ``statics.Capability`` of wrenches.

    Raises:
      ValueError: wrong shapes; a robot with more or fewer actuated joints than freedoms, or constraints on the pose.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.StewartGough.prototype()
      >>> found = js.statics.force_capability(robot, robot.home()[0], force_limit=100.0)
      >>> found.vertices.shape, bool(found.translation_radii[-1] < 600.0)  # six legs of 100 N, not all in one line
      ((64, 6), True)
    """
    case = checked_case(robot, pose, None, load, section)
    limit = per_actuator(case.robot, "force_limit", force_limit, case.pose.dtype)
    state = balance(case)
    _check_free(case.robot, state)
    vertices = state.pull[None] - _corners(limit) @ state.rows
    return _capability(case.robot, state, vertices, (state.inverse / limit[None]).T)


@one_pose()
def velocity_capability(robot: Mechanism, pose: PoseLike, *, speed_limit: Numbers) -> Capability:
    """Twists of the platform that actuators of limited speed allow, in the base frame.

    With dq = J t, the polytope is the image of the box |dq| <= limit under J^-1.

    Args:
      robot: the robot, without constraints on its pose; every array in it is differentiable.
      pose: ``(d,)`` in the base frame.
      speed_limit: ``()`` or ``(m,)`` of each actuated joint.

    Returns:
      ``statics.Capability`` of twists: velocities of the reference point and angular velocities.

    Raises:
      ValueError: wrong shapes; a robot with more or fewer actuated joints than freedoms, or constraints on the pose.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.StewartGough.prototype()
      >>> js.statics.velocity_capability(robot, robot.home()[0], speed_limit=0.1).vertices.shape
      (64, 6)
    """
    case = checked_case(robot, pose, None, None, None)
    limit = per_actuator(case.robot, "speed_limit", speed_limit, case.pose.dtype)
    state = balance(case)
    _check_free(case.robot, state)
    return _capability(case.robot, state, _corners(limit) @ state.inverse.T, state.rows / limit[:, None])


def _check_free(robot: Mechanism, state: Balance) -> None:
    if state.rows.shape[0] > state.actuators:
        raise ValueError(
            f"Got a {type(robot).__name__}, whose pose has constraints: what they bear knows no limit. Use "
            "actuator_forces and inverse_jacobian at the wrenches and twists that matter."
        )


def _corners(limit: jax.Array) -> jax.Array:
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=limit.shape[0])))
    return jnp.asarray(signs, limit.dtype) * limit[None]


def _capability(robot: Mechanism, state: Balance, vertices: jax.Array, shares: jax.Array) -> Capability:
    """The record of a polytope, and of the ellipsoids of vectors whose shares of the limits are ``shares @ x``."""
    linear = robot.space.translations
    usable = state.usable
    shares = jnp.where(usable, shares, jnp.eye(*shares.shape, dtype=shares.dtype))
    blocks = shares[:, :linear], shares[:, linear:]
    forms = [block.T @ block for block in blocks]
    radii = [1 / singular_values(block) if block.shape[1] else jnp.zeros(0, block.dtype) for block in blocks]
    vertices, *forms = (jnp.where(usable, x, jnp.nan) for x in (vertices, *forms, *radii))
    return Capability(vertices, forms[0], forms[1], forms[2], forms[3], state.status)
