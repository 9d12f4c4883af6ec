"""Forces in the pins and bars of scissor legs."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import pytree
from jaxscissor._engine.types import Numbers, PoseLike
from jaxscissor.kinematics._solution import Status
from jaxscissor.robots._contract import Attachment, Joints, Leg, Mechanism
from jaxscissor.robots._over_legs import over_legs
from jaxscissor.statics._balance import balance, checked_case
from jaxscissor.statics._beams import beams_of, combined, greatest
from jaxscissor.statics._bodies import Bodies
from jaxscissor.statics._linkage import linkage_of
from jaxscissor.statics._load import Load
from jaxscissor.statics._materials import Section


@pytree
class BarForces:
    """Forces in the legs at one pose, or at a batch under ``vmap``; ``nan`` unless ``CONVERGED``.

    Attributes:
      pins: ``(legs, connections, 3)`` force that the first part of each of the leg's ``connections`` exerts on the
        second, in the leg's plane, in the base frame.
      axial: ``(legs, bars)`` axial force of greatest size along each bar, tension positive.
      bending: ``(legs, bars)`` greatest bending moment along each bar, in the leg's plane.
      stress: ``(legs, bars)`` greatest normal stress; ``nan`` without a section.
      status: see ``actuator_forces``; ``SINGULAR`` also where a leg is stretched or folded flat.
    """

    pins: jax.Array
    axial: jax.Array
    bending: jax.Array
    stress: jax.Array
    status: jax.Array

    @property
    def ok(self) -> jax.Array:
        """Whether the status is ``CONVERGED``."""
        return self.status == Status.CONVERGED


@one_pose()
def bar_forces(
    robot: Mechanism,
    pose: PoseLike,
    *,
    wrench: Numbers | None = None,
    load: Load | None = None,
    section: Section | None = None,
) -> BarForces:
    """Forces in the pins and bars of every leg that hold a wrench and all weights, each leg in its own plane.

    Each leg hands to the platform what virtual work says (``actuator_forces``); the pins follow from the equilibrium of
    its bars. Across its plane a scissor of parallel pins is over-constrained: how its pins share moments there depends
    on their play, and no number is given. Forces across a leg's plane, such as a part of its bars' weight, do not
    count.

    Args:
      robot: a robot whose legs state their ``connections``; every array in it is differentiable.
      pose: ``(d,)`` in the base frame.
      wrench: ``(d,)`` force and moment on the platform, about its reference point, in the base frame, other than
        weights. Default: none.
      load: masses of platform and payload, and gravity. Default: no masses.
      section: of the bars, whose weight is spread evenly along them. Default: no weight.

    Returns:
      ``BarForces``. A bar's moment is linear between the points that hold it, but for its weight.

    Raises:
      ValueError: wrong shapes; legs without connections, or over-constrained in their plane.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> found = js.statics.bar_forces(robot, robot.home()[0], load=js.statics.Load(payload=11.34))
      >>> [round(float(moment), 1) for moment in found.bending[0]]  # lowest bars first
      [15.7, 15.7, 6.9, 6.9, 0.0, 0.0]
    """
    case = checked_case(robot, pose, wrench, load, section)
    state = balance(case)
    pulls = state.leg_forces(case.robot, state.hold(state.pull - case.wrench)) - state.legs.weight

    def of_leg(leg: Leg, attachment: Attachment, joints: Joints, bodies: Bodies | None, pull: jax.Array):
        linkage, parts = linkage_of(leg, joints, attachment, bodies, case.load.gravity)
        loads = jnp.append(pull, jnp.ones((), pull.dtype))
        pins = (linkage.forces @ loads) @ linkage.axes
        return linkage.regular, (pins, *greatest(combined(beams_of(linkage, parts), loads), case.section))

    legs, placed = state.legs, state.placed
    regular, found = over_legs(of_leg, placed.legs, placed.attachments, legs.joints, legs.bodies, pulls)
    solved = jnp.all(regular)
    status = jnp.where(state.usable & ~solved, Status.SINGULAR, state.status).astype(jnp.int32)
    pins, axial, bending, stress = (jnp.where(status == Status.CONVERGED, values, jnp.nan) for values in found)
    return BarForces(pins, axial, bending, stress, status)
