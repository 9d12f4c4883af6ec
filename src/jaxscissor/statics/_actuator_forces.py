"""Actuator forces that hold a load."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import pytree
from jaxscissor._engine.types import Numbers, PoseLike
from jaxscissor.kinematics._solution import Status
from jaxscissor.robots._contract import Mechanism
from jaxscissor.statics._balance import balance, checked_case
from jaxscissor.statics._load import Load
from jaxscissor.statics._materials import Section


@pytree
class ActuatorForces:
    """Forces at one pose, or at a batch under ``vmap``; ``nan`` unless ``CONVERGED``.

    Attributes:
      value: ``(m,)`` of the actuators on the mechanism, positive along increasing joint coordinate; of one that turns
        a moment.
      legs: ``(legs, d)`` wrench of each leg on the platform, about its reference point, in the base frame; with the
        wrench, the platform's weights and what constraints exert they add up to zero.
      status: see ``inverse_kinematics``; ``SINGULAR`` where no finite forces hold every wrench.
    """

    value: jax.Array
    legs: jax.Array
    status: jax.Array

    @property
    def ok(self) -> jax.Array:
        """Whether the status is ``CONVERGED``."""
        return self.status == Status.CONVERGED


@one_pose()
def actuator_forces(
    robot: Mechanism,
    pose: PoseLike,
    *,
    wrench: Numbers | None = None,
    load: Load | None = None,
    section: Section | None = None,
) -> ActuatorForces:
    """Forces of the actuators that hold a wrench on the platform and all weights, in the home mode, without friction.

    By virtual work: f . dq + w . t - dV = 0 for every twist t that the robot allows, with the motion dq = J t of the
    actuated joints and the potential V of platform, payload and bars as a function of the pose. So J^T f = dV/dt - w,
    with the forces of constraints on the pose, if there are any, beside f. Of more actuated joints than freedoms these
    are the forces of least norm, a moment counting as a force at a lever of the robot's length; actuators that brace
    against each other add to them.

    Args:
      robot: the robot; every array in it is differentiable.
      pose: ``(d,)`` in the base frame.
      wrench: ``(d,)`` force and moment on the platform, about its reference point, in the base frame, other than
        weights. Default: none.
      load: masses of platform and payload, and gravity. Default: no masses.
      section: of the bars, each of which is a rigid body of the length that it has at home. Default: no weight.

    Returns:
      ``ActuatorForces``, newtons and newton meters where lengths are meters and masses kilograms.

    Raises:
      ValueError: wrong shapes; a robot with fewer actuated joints than freedoms.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> load = js.statics.Load(payload=11.34)
      >>> found = js.statics.actuator_forces(robot, robot.home()[0], load=load)
      >>> [round(float(force), 1) for force in found.value]  # inwards
      [-54.1, -54.1, -54.1, -54.1, -54.1, -54.1]
    """
    case = checked_case(robot, pose, wrench, load, section, more=True)
    state = balance(case)
    forces = state.hold(state.pull - case.wrench)
    exerted = state.leg_forces(case.robot, forces) - state.legs.weight
    legs = jnp.einsum("ln,lnd->ld", exerted, state.legs.moved)
    value, legs = (jnp.where(state.usable, numbers, jnp.nan) for numbers in (forces[: state.actuators], legs))
    return ActuatorForces(value, legs, state.status)
