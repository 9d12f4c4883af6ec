"""The greatest payload that the actuators hold."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp

from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import unchecked
from jaxscissor._engine.types import Numbers, PoseLike
from jaxscissor.robots._contract import Mechanism
from jaxscissor.statics._balance import balance, checked_case, per_actuator
from jaxscissor.statics._load import Load
from jaxscissor.statics._materials import Section


@one_pose()
def payload(
    robot: Mechanism,
    pose: PoseLike,
    *,
    force_limit: Numbers,
    wrench: Numbers | None = None,
    load: Load | None = None,
    section: Section | None = None,
) -> jax.Array:
    """Greatest mass that the platform can carry at a pose, no actuator exerting more than its limit either way.

    The forces of ``actuator_forces`` are linear in the mass, so that each actuator gives two bounds in closed form.

    Args:
      robot: the robot; every array in it is differentiable.
      pose: ``(d,)`` in the base frame.
      force_limit: ``()`` or ``(m,)`` of each actuator, a moment of one that turns.
      wrench: ``(d,)`` force and moment on the platform, about its reference point, in the base frame, other than
        weights. Default: none.
      load: mass of the platform, where the payload has its center, and gravity; its own payload does not count.
      section: of the bars. Default: no weight.

    Returns:
      ``()`` the mass; infinite where it takes no force, negative by how much too heavy the robot itself is, ``nan``
      where the home mode does not exist, the pose is singular, or no mass at all is within the limits. As a function of
      robot and pose it is a metric for ``workspace.map``, ``workspace.worst_over`` and ``design.optimize``.

    Raises:
      ValueError: wrong shapes; a robot with more or fewer actuated joints than freedoms.

    Example:
      >>> import jax.numpy as jnp, jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> def carried(robot, pose):
      ...     return js.statics.payload(robot, pose, force_limit=100.0)
      >>> task = jnp.array([[0, 0, 0.6, 0, 0, 0], [0, 0, 1.2, 0, 0, 0]])
      >>> worst = js.workspace.worst_over(robot, carried, task)
      >>> round(float(worst.value), 1), round(float(worst.pose[2]), 1)
      (6.9, 0.6)
    """
    load = Load() if load is None else load
    fields = {field.name: getattr(load, field.name) for field in dataclasses.fields(load)}
    case = checked_case(robot, pose, wrench, unchecked(Load, **fields | {"payload": 0.0}), section)
    limit = per_actuator(case.robot, "force_limit", force_limit, case.pose.dtype)
    state = balance(case)
    space, placed = case.robot.space, state.placed

    def weight(twist: jax.Array) -> jax.Array:
        return case.load.payload_potential(*space.nudge(placed.position, placed.rotation, tuple(twist)))

    empty, each = (
        state.hold(wrench)[: state.actuators]
        for wrench in (state.pull - case.wrench, jax.grad(weight)(jnp.zeros_like(case.pose)))
    )
    taken = each != 0
    safe = jnp.where(taken, each, 1)
    way = jnp.sign(safe)
    most = jnp.min(jnp.where(taken, (way * limit - empty) / safe, jnp.inf))
    least = jnp.max(jnp.where(taken, (-way * limit - empty) / safe, -jnp.inf))
    kept = jnp.all(taken | (jnp.abs(empty) <= limit))
    return jnp.where(state.usable & kept & (least <= most), most, jnp.nan)
