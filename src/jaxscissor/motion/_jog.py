"""Jogging by the inverse Jacobian: as it is, corrected, and closed over a measured pose."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_floats, pytree
from jaxscissor._engine.types import Number, Numbers, PoseLike
from jaxscissor.kinematics._constraints import constrained_pose
from jaxscissor.kinematics._inverse import inverse_kinematics
from jaxscissor.kinematics._solution import Status
from jaxscissor.motion._checks import checked_rows
from jaxscissor.motion._track import At, advance, resting_at
from jaxscissor.motion._trajectory import Stopped, until_stopped
from jaxscissor.motion._watch import Least
from jaxscissor.robots._contract import Mechanism, actuated_mask, checked_freedoms, checked_pose

CONTROLS = "open", "corrected", "closed"


@pytree
class Jog(Stopped):
    """A sequence of ``n`` jogs, the start before them; ``nan`` from where it stopped.

    Attributes:
      commanded: ``(n + 1, d)`` where the platform should be.
      actuated: ``(n + 1, m)`` the actuated joints that were commanded.
      poses: ``(n + 1, d)`` where the platform is with them, by forward kinematics.
      status: ``(n + 1,)``; ``CONVERGED`` as far as the jogs went, from there on the reason why not.
    """

    commanded: jax.Array
    actuated: jax.Array
    poses: jax.Array
    status: jax.Array


def jog(
    robot: Mechanism,
    start: PoseLike,
    displacements: Numbers,
    *,
    control: Literal["open", "corrected", "closed"] = "open",
    noise: Numbers | None = None,
    machine: Mechanism | None = None,
    min_margin: Number = 0.0,
    min_type1: Number = 0.0,
    min_type2: Number = 0.0,
) -> Jog:
    """Move the platform by displacements, one after the other, by the inverse Jacobian J [ICRA16 VI, eq. 19].

    - ``"open"``, as the paper did it: every jog adds dq = J(commanded pose) dx to the actuators. What a jog leaves
      out, of second order in its size, adds up, so that the error at the end of a way is of first order.
    - ``"corrected"``: the same is only the predictor, and Newton's method on the closure the corrector, so that the
      joints are those of the commanded pose, to rounding.
    - ``"closed"``: the platform's pose is measured before every jog, and dq = J(measured pose) times the twist from
      there to the commanded pose. The error is that of one jog and one measurement, whatever the number of jogs.

    The commanded pose moves by the whole displacement whether the platform does or not. The robot keeps its branch
    and stops before a limit or a singularity, as in ``track``.

    Args:
      robot: the robot as it is modelled; every array in it is differentiable.
      start: ``(d,)`` pose in the base frame, in the home mode, where the platform rests and its pose is known.
      displacements: ``(n, d)`` twists in the base frame: translations of the reference point and rotations, in the
        robot's unit and radians. A row of zeros is a pause, in which a closed loop goes on.
      control: see above.
      noise: ``(n, d)`` twists that are added to the pose as it is measured. Only for ``"closed"``; default: none.
      machine: the robot as it is, if it differs from its model; its actuators are counted from the start. Default:
        the model.
      min_margin: least distance of the machine to a limit of its legs, dimensionless; ``-inf`` ignores the limits.
      min_type1, min_type2: least size of the singularity measures of its legs and its platform.

    Returns:
      ``Jog``. Its reason is one of ``track``, or of ``inverse_kinematics`` if the model ends first.

    Raises:
      ValueError: wrong shapes, no displacement, an unknown control, noise that nobody measures, a machine of another
        space or with more or fewer joints, or a robot with more or fewer actuated joints than freedoms.

    Example:
      >>> import jaxscissor as js, numpy as np
      >>> robot, start = js.NavaroII.prototype(), [45.0, 26.0, 0.3]
      >>> jogs = np.tile([0.5, 0.0, 0.0], (20, 1))
      >>> for control in ("open", "corrected", "closed"):
      ...     found = js.motion.jog(robot, start, jogs, control=control)
      ...     off = found.poses - found.commanded
      ...     print(f"{control}: {float(abs(off[-1, :2]).max()):.3f} off after {int(found.covered) - 1} jogs")
      open: 0.058 off after 20 jogs
      corrected: 0.000 off after 20 jogs
      closed: 0.003 off after 20 jogs
    """
    if control not in CONTROLS:
        raise ValueError(f"Got control={control!r}; expected one of {CONTROLS}.")
    if noise is not None and control != "closed":
        raise ValueError(f"Got noise with control={control!r}, which measures nothing; expected control='closed'.")
    checked_freedoms(robot)
    if machine is not None:
        _checked_machine(robot, machine)
    size, names = robot.space.dimension, robot.space.names
    robot, start = checked_pose(robot, start)
    robot, jogs = checked_rows(robot, displacements, size, "displacements", names)
    if noise is None:
        noise = jnp.zeros_like(jogs)
    robot, noise = checked_rows(robot, noise, size, "noise", names)
    if noise.shape != jogs.shape:
        raise ValueError(f"Got noise of shape {noise.shape}; expected that of the displacements, {jogs.shape}.")
    least = Least(min_margin, min_type1, min_type2)
    robot, machine, start, jogs, noise, least = as_floats(robot, machine, start, jogs, noise, least)
    return _jog(robot, machine, start, jogs, noise, least, jnp.int32(CONTROLS.index(control)))


def _checked_machine(robot: Mechanism, machine: Mechanism) -> None:
    checked_freedoms(machine)
    if machine.space is not robot.space or sum(actuated_mask(machine)) != sum(actuated_mask(robot)):
        raise ValueError(
            f"Got a {type(machine).__name__} as the machine of a {type(robot).__name__}; expected one with the same "
            "space of poses and as many actuated joints."
        )


class _Now(NamedTuple):
    """After a jog."""

    before: jax.Array  # the pose commanded before the last one
    commanded: jax.Array
    measured: jax.Array
    actuated: jax.Array
    guess: jax.Array  # all joints of the model where it is solved next
    machine: At


@one_pose()
def _jog(
    robot: Mechanism,
    machine: Mechanism | None,
    start: jax.Array,
    jogs: jax.Array,
    noise: jax.Array,
    least: Least,
    control: jax.Array,
) -> Jog:
    """One program for all controls, which differ in where the model is solved, and to where it looks from there."""
    start = constrained_pose(robot, start).value
    first = inverse_kinematics(robot, start)
    machine, real = (robot, first) if machine is None else (machine, inverse_kinematics(machine, start))
    zeros, counted = robot.actuated(first.value), machine.actuated(real.value)
    corrected = control == CONTROLS.index("corrected")

    def step(now: _Now, case: tuple[jax.Array, jax.Array]) -> tuple[_Now, Any]:
        displacement, error = case
        ahead = constrained_pose(robot, _moved(robot, now.commanded, displacement)).value
        place = lax.select_n(control, now.before, now.commanded, now.measured)
        joints, turn, status = _differential(robot, place, jnp.where(corrected, ahead, now.commanded), now.guess)
        solved = counted + robot.actuated(joints) - zeros
        actuated = jnp.where(corrected, solved, now.actuated + robot.actuated(turn))
        reason = jnp.where(now.machine.reason == Status.CONVERGED, status, now.machine.reason)
        at, sample = advance(machine, actuated, now.machine._replace(reason=reason), least)
        pose = jnp.where(at.reason == Status.CONVERGED, sample[0], lax.stop_gradient(start))
        after = _Now(
            before=now.commanded,
            commanded=ahead,
            measured=_moved(robot, pose, error),
            actuated=actuated,
            guess=lax.stop_gradient(joints + turn),
            machine=at,
        )
        return after, (*until_stopped(at.reason, (now.commanded, actuated, sample[0])), at.reason)

    cases = jax.tree.map(lambda rows: jnp.pad(rows, ((0, 1), (0, 0))), (jogs, noise))  # the end is only looked at
    at = resting_at(machine, start, real.value, jnp.maximum(first.status, real.status))
    now = _Now(start, start, start, counted, lax.stop_gradient(first.value), at)
    return Jog(*lax.scan(step, now, cases)[1])


def _moved(robot: Mechanism, pose: jax.Array, twist: jax.Array) -> jax.Array:
    """The pose after a displacement; by nothing at all it is the very same numbers."""
    space = robot.space
    moved = jnp.stack(space.coordinates(*space.retract(*space.place(pose), tuple(twist))))
    return jnp.where(jnp.any(twist != 0), moved, pose)


def _differential(
    robot: Mechanism, pose: jax.Array, target: jax.Array, guess: jax.Array
) -> tuple[jax.Array, jax.Array, Scalar]:
    """All joints at a pose, their J times the twist from there to a target, and the status of the solve.

    The derivative of inverse kinematics along the twist is the product itself, passive joints included.
    """
    space = robot.space
    placed = space.place(pose)
    twist = space.between(placed, space.place(target))

    def along(way: Scalar) -> tuple[jax.Array, Scalar]:
        moved = space.nudge(*placed, tuple(way * rate for rate in twist))
        solution = inverse_kinematics(robot, jnp.stack(space.coordinates(*moved)), guess=guess)
        return solution.value, solution.status

    zero, one = jnp.zeros_like(pose[0]), jnp.ones_like(pose[0])
    joints, turn, status = jax.jvp(along, (zero,), (one,), has_aux=True)
    return joints, turn, status
