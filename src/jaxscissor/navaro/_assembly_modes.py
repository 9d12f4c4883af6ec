"""The assembly mode of NaVARo II from its six sensors."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from jaxscissor._engine.numerics import Scalar, safe_sqrt
from jaxscissor._engine.programs import program
from jaxscissor._engine.pytree import as_floats, pytree
from jaxscissor._engine.types import JointsLike
from jaxscissor.kinematics._all_modes import AssemblyModes, forward_kinematics_all
from jaxscissor.robots._contract import checked_joints
from jaxscissor.robots._navaro import NavaroII


@pytree
class IdentifiedAssembly:
    """Where all six sensors say that NaVARo II is, and which assembly mode of its three motors that is.

    Attributes:
      pose: ``(3,)`` of ``NavaroII.sensed_pose``.
      misfit: of the sensors among one another, as there.
      index: of the nearest mode in ``modes``; -1 if there is none, or a sensor is not finite.
      distance: from ``pose`` to that mode, root mean square over the platform's joints, in the robot's unit of
        length; infinite if there is none.
      runner_up: the same to the next mode. Beside a singularity it is about as near, or errors of the sensors
        leave neither: then ``distance`` is far above them.
      modes: every pose that the actuated joints allow, of ``forward_kinematics_all``.
    """

    pose: jax.Array
    misfit: jax.Array
    index: jax.Array
    distance: jax.Array
    runner_up: jax.Array
    modes: AssemblyModes


@program()
def identify_assembly(robot: NavaroII, joints: JointsLike) -> IdentifiedAssembly:
    """Which assembly mode NaVARo II is in, told by the sensors of its passive joints [NAV19 2].

    The pose that fits all six sensors is compared with all that the three actuated joints allow.

    Args:
      robot: the robot, in its actuation mode.
      joints: ``(6,)`` all joints as measured; see ``navaro.DriveTrain.scissor`` for rho from the screw's position.

    Returns:
      ``navaro.IdentifiedAssembly``.

    Raises:
      ValueError: wrong shape of the joints.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.NavaroII.prototype(mode=8)
      >>> pose, joints = robot.home()
      >>> sensed = js.navaro.identify_assembly(robot, joints)
      >>> bool(abs(sensed.modes.values[sensed.index] - pose).max() < 1e-3)
      True
    """
    joints = checked_joints(robot, joints)
    robot, joints = as_floats(robot, joints)
    modes = forward_kinematics_all(robot, robot.actuated(joints))
    pose, misfit = robot.sensed_pose(joints)
    distances = jax.vmap(lambda mode: _distance(robot, mode, pose))(modes.values)
    known = modes.valid & jnp.all(jnp.isfinite(joints))
    distances = jnp.where(known, distances, jnp.inf)
    nearest = jnp.argmin(distances)
    others = jnp.where(jnp.arange(len(distances)) == nearest, jnp.inf, distances)
    index = jnp.where(jnp.any(known), nearest, -1).astype(jnp.int32)
    return IdentifiedAssembly(pose, misfit, index, distances[nearest], jnp.min(others), modes)


def _distance(robot: NavaroII, one: jax.Array, two: jax.Array) -> Scalar:
    """Root mean square distance of the platform's joints between two poses."""
    points = zip(*(robot.attachments(*robot.space.place(pose)) for pose in (one, two)), strict=True)
    gaps = [p - q for p, q in points]
    return safe_sqrt(sum(gap.dot(gap) for gap in gaps) / len(gaps))
