"""Cartesian stiffness: of the actuators, of the bars, and what a load adds."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import pytree
from jaxscissor._engine.types import Numbers, PoseLike
from jaxscissor.kinematics._solution import Status
from jaxscissor.robots._contract import Mechanism
from jaxscissor.statics._balance import balance, checked_case, per_actuator
from jaxscissor.statics._bar_compliance import bar_compliance
from jaxscissor.statics._load import Load
from jaxscissor.statics._materials import Section
from jaxscissor.statics._tangent import bordered_inverse, tangent_stiffness


@pytree
class Stiffness:
    """Stiffness at one pose, or at a batch under ``vmap``; ``nan`` unless ``CONVERGED``.

    Attributes:
      matrix: ``(d, d)`` change of the wrench that holds the platform per twist (displacement of the reference point,
        rotation vector), in the base frame.
      compliance: ``(d, d)`` its inverse: twist per additional wrench.
      status: see ``actuator_forces``; ``SINGULAR`` also where the load makes the platform lose all stiffness in some
        direction.
    """

    matrix: jax.Array
    compliance: jax.Array
    status: jax.Array

    @property
    def ok(self) -> jax.Array:
        """Whether the status is ``CONVERGED``."""
        return self.status == Status.CONVERGED


@one_pose()
def stiffness(
    robot: Mechanism,
    pose: PoseLike,
    *,
    actuator_stiffness: Numbers,
    wrench: Numbers | None = None,
    load: Load | None = None,
    section: Section | None = None,
) -> Stiffness:
    """Cartesian stiffness of the platform, in equilibrium at a pose.

    1. The actuators are springs: J^T k J [Gosselin 1990], and the derivative of the balance of forces under a constant
       wrench and weights, the geometric stiffness.
    2. With a section, the bars give way as well: the second derivative of their complementary energy, tension and
       bending in each leg's plane, by the wrench is added to the compliance. Pins have no play, and what bends across
       the legs' planes is rigid; the geometric stiffness of bent bars is left out.

    Without a load the matrix is symmetric. Under a load it is so where the wrench has no moment; a constant moment has
    no potential.

    Args:
      robot: the robot, with a section one whose legs state their ``connections``; every array in it is differentiable.
      pose: ``(d,)`` in the base frame.
      actuator_stiffness: ``()`` or ``(m,)`` force per length of each actuator, moment per radian of one that turns;
        finite.
      wrench: ``(d,)`` force and moment on the platform, about its reference point, in the base frame, other than
        weights. Default: none.
      load: masses of platform and payload, and gravity. Default: no masses.
      section: of the bars, which give way and weigh. Default: rigid and without weight.

    Returns:
      ``Stiffness``. Of a robot with constraints on the pose, motions that they forbid have no compliance, and in the
      matrix no stiffness: it is the one along the motions that are left, at right angles to those forbidden with a turn
      by one radian as long as the robot's length.

    Raises:
      ValueError: wrong shapes; a robot with more or fewer actuated joints than freedoms; a section and legs without
        connections.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.StewartGough.prototype()
      >>> found = js.statics.stiffness(robot, robot.home()[0], actuator_stiffness=1e6)
      >>> bool((abs(found.matrix - found.matrix.T) < 1e-4 * abs(found.matrix).max()).all())
      True
    """
    case = checked_case(robot, pose, wrench, load, section)
    springs = per_actuator(case.robot, "actuator_stiffness", actuator_stiffness, case.pose.dtype)
    state = balance(case)
    forces = state.hold(state.pull - case.wrench)
    tangent = tangent_stiffness(case, state, forces, springs)
    count, bound = len(case.pose), state.rows[state.actuators :]
    compliance = bordered_inverse(jnp.where(state.usable, tangent, 0), bound)[:count, :count]
    ok = state.usable & jnp.any(compliance != 0)
    if case.section is not None:
        bars = bar_compliance(case, state, case.section)
        compliance, ok = compliance + bars.per_wrench, ok & bars.regular
    # which wrenches count as those of the constraints alone depends on what a turn is in units of length
    unit = jnp.where(jnp.arange(count) < case.robot.space.translations, 1, case.robot.length)
    both = unit[:, None] * unit[None]
    matrix = both * bordered_inverse(jnp.where(ok, compliance, 0) * both, bound / unit[None])[:count, :count]
    status = jnp.where(state.usable & ~ok, Status.SINGULAR, state.status).astype(jnp.int32)
    return Stiffness(jnp.where(ok, matrix, jnp.nan), jnp.where(ok, compliance, jnp.nan), status)
