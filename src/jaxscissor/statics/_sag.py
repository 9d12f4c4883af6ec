"""Where the platform goes under a load when actuators and bars give way."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.newton import implicit
from jaxscissor._engine.numerics import Scalar, safe_sqrt
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import pytree
from jaxscissor._engine.types import Numbers, PoseLike, PyTree
from jaxscissor.kinematics._solution import Status
from jaxscissor.robots._contract import Mechanism, constraints_on
from jaxscissor.statics._balance import Balance, Case, balance, checked_case, per_actuator
from jaxscissor.statics._bar_compliance import bar_compliance
from jaxscissor.statics._load import Load
from jaxscissor.statics._materials import Section
from jaxscissor.statics._tangent import bordered_inverse, tangent_stiffness

_STEPS = 12


@pytree
class Sag:
    """Displacement at one pose, or at a batch under ``vmap``; ``nan`` unless ``CONVERGED``.

    Attributes:
      pose: ``(d,)`` where the platform comes to rest.
      twist: ``(d,)`` the displacement of its reference point and the rotation vector, in the base frame.
      status: see ``actuator_forces``; ``MAX_STEPS`` where no equilibrium was found near the pose.
    """

    pose: jax.Array
    twist: jax.Array
    status: jax.Array

    @property
    def ok(self) -> jax.Array:
        """Whether the status is ``CONVERGED``."""
        return self.status == Status.CONVERGED


@one_pose()
def sag(
    robot: Mechanism,
    pose: PoseLike,
    *,
    actuator_stiffness: Numbers,
    wrench: Numbers | None = None,
    load: Load | None = None,
    section: Section | None = None,
) -> Sag:
    """How far the platform gives way under wrench and weights, the motors holding the joints of an unloaded robot.

    1. The actuators are springs at rest at the joints of the pose. Equilibrium is found by Newton's method with
       the tangent of ``stiffness``, however far that is.
    2. With a section the bars give way as well: to first order, by the derivative of their complementary energy at the
       pose (Castigliano), what bends them by their own weight included.

    Args:
      robot: the robot, with a section one whose legs state their ``connections``; every array in it is differentiable.
      pose: ``(d,)`` of the unloaded platform, in the base frame.
      actuator_stiffness: ``()`` or ``(m,)`` force per length of each actuator, moment per radian of one that turns;
        finite.
      wrench: ``(d,)`` force and moment on the platform, about its reference point, in the base frame, other than
        weights. Default: none.
      load: masses of platform and payload, and gravity. Default: no masses.
      section: of the bars, which give way and weigh. Default: rigid and without weight.

    Returns:
      ``Sag``; its twist is the error of a pose that was commanded without regard to the load.

    Raises:
      ValueError: as ``stiffness``.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> load = js.statics.Load(payload=11.34)
      >>> found = js.statics.sag(robot, robot.home()[0], actuator_stiffness=1e6, load=load)
      >>> bool(found.twist[2] < 0)
      True
    """
    case = checked_case(robot, pose, wrench, load, section)
    springs = per_actuator(case.robot, "actuator_stiffness", actuator_stiffness, case.pose.dtype)
    state = balance(case)
    rest = state.actuated(case.robot)
    start, found, status = _settled(case, state, rest, springs)
    args = (case, rest, springs, lax.stop_gradient(start))
    unknowns = implicit(_imbalance, tuple(lax.stop_gradient(found)), status == Status.CONVERGED, args)
    count = len(case.pose)
    space, placed = case.robot.space, state.placed
    moved = space.retract(*space.place(lax.stop_gradient(start)), unknowns[:count])
    twist = space.between((placed.position, placed.rotation), moved)
    if case.section is not None:
        bars = bar_compliance(case, state, case.section)
        twist = twist + bars.twist
        status = jnp.where((status == Status.CONVERGED) & ~bars.regular, Status.SINGULAR, status)
    ended = jnp.stack(space.coordinates(*space.retract(placed.position, placed.rotation, tuple(twist))))
    ended, twist = (jnp.where(status == Status.CONVERGED, numbers, jnp.nan) for numbers in (ended, twist))
    return Sag(ended, twist, status.astype(jnp.int32))


def _settled(case: Case, state: Balance, rest: jax.Array, springs: jax.Array) -> tuple[jax.Array, jax.Array, Scalar]:
    """The pose of equilibrium, a last small step and the constraints' forces ``(d + c,)``, and the status."""
    case, rest, springs, pose, usable = lax.stop_gradient((case, rest, springs, state.placed.pose, state.usable))
    space, count = case.robot.space, len(case.pose)
    unit = jnp.where(jnp.arange(count) < space.translations, case.robot.length, 1)

    def step(_: object, carry: PyTree):
        pose, _, bound, _, _ = carry
        here = case._replace(pose=pose)
        now = balance(here, bound=False)
        forces = jnp.concatenate([springs * (rest - now.actuated(case.robot)), bound])
        # the curvature of the bars' potential is small and would take long to compile; without it, steps are more
        light = now._replace(legs=now.legs._replace(bodies=None))
        tangent = tangent_stiffness(here, light, forces, springs)
        off = _off(here, now, forces)
        shift = bordered_inverse(tangent, now.rows[now.actuators :]) @ off
        twist = jnp.where(now.usable, shift[:count], 0)
        moved = jnp.stack(space.coordinates(*space.retract(*space.place(pose), tuple(twist))))
        size = safe_sqrt(jnp.sum((twist / unit) ** 2))
        return moved, pose, bound - shift[count:], jnp.where(jnp.any(shift != 0), size, jnp.nan), now.status

    bound = jnp.zeros(state.rows.shape[0] - state.actuators, rest.dtype)
    start = (pose, pose, bound, jnp.full_like(pose[0], jnp.inf), state.status)
    moved, _, bound, size, status = lax.fori_loop(0, _STEPS, step, start)
    close = 1e3 * float(jnp.finfo(size.dtype).eps)
    status = jnp.where((status == Status.CONVERGED) & ~(size <= close), Status.MAX_STEPS, status)
    status = jnp.where(usable, status, state.status)
    return moved, jnp.concatenate([jnp.zeros_like(pose), bound]), status


def _off(case: Case, state: Balance, forces: jax.Array) -> jax.Array:
    """What the forces leave unbalanced of the wrench ``(d,)``, and how far the constraints are from being met."""
    constraints = constraints_on(case.robot, state.placed.position, state.placed.rotation)
    off = case.wrench - state.pull + forces @ state.rows
    return jnp.concatenate([off, -jnp.stack(constraints)]) if constraints else off


def _imbalance(unknowns: tuple[Scalar, ...], args: Any) -> tuple[Scalar, ...]:
    """The same at a step from the start, with these forces of the constraints; in units of none in particular."""
    case, rest, springs, start = args
    space, count = case.robot.space, len(case.pose)
    moved = space.retract(*space.place(start), unknowns[:count])
    here = case._replace(pose=jnp.stack(space.coordinates(*moved)))
    now = balance(here, bound=False)
    bound = jnp.stack([*unknowns[count:]]) if unknowns[count:] else jnp.zeros(0, rest.dtype)
    return tuple(_off(here, now, jnp.concatenate([springs * (rest - now.actuated(case.robot)), bound])))
