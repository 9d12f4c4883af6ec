"""A robot whose legs have dimensions of their own: one copy of the robot for every leg."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.newton import newton
from jaxscissor._engine.numerics import Scalar, default_tol
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_floats, pytree, with_fields
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._contract import (
    Attachment,
    Joints,
    Leg,
    Mechanism,
    actuation,
    differentiable_roots,
    joints_by_leg,
    joints_together,
    leg_residual,
    seen_by_legs,
)
from jaxscissor.robots._over_legs import over_legs

_MAX_STEPS = 30


@pytree
class PerLeg(Mechanism):
    """A robot of which each leg, and what it holds of the platform, is built to dimensions of its own.

    Leg i and its attachment are those of the i-th copy of the robot. What belongs to no leg is the nominal
    robot's, whose dimensions are the means of the copies': characteristic length, constraints on the pose,
    home pose. The home joints are those of the copies at that pose, found from the nominal robot's; they
    name the same working mode as long as the copies differ little.

    Attributes:
      copies: the robot with a leading axis of one entry per leg on every array; it is a container and no
        robot by itself.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.per_leg(js.TripleScissorExtender.prototype())
      >>> robot.copies.top_radius.shape, robot.copies.link_lengths.shape
      ((3,), (3, 3))
    """

    copies: Any

    @property
    def space(self) -> Any:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The space of the robot's poses."""
        return self.copies.space

    @property
    def dependent(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The robot's dependent pose coordinates."""
        return self.copies.dependent

    @property
    def joint_order(self) -> tuple[int, ...] | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The robot's order of joints."""
        return self.copies.joint_order

    @property
    def nominal(self) -> Any:
        """The robot of which each dimension is the mean of the copies'."""
        return jax.tree.map(lambda leaf: jnp.mean(leaf, axis=0), self.copies)

    @property
    def length(self) -> Scalar:
        """The nominal robot's."""
        return self.nominal.length

    def legs(self) -> Leg:
        """Leg i of copy i."""
        every = jax.vmap(lambda robot: robot.legs())(self.copies)
        return jax.tree.map(lambda leaf: jnp.stack([leaf[i, i] for i in range(leaf.shape[0])]), every)

    def attachments(self, position: Vec, rotation: Rotation) -> list[Attachment]:
        """Attachment i of copy i."""
        every = jax.vmap(lambda robot: robot.attachments(position, rotation))(self.copies)
        return [jax.tree.map(lambda leaf, i=i: leaf[i], seen) for i, seen in enumerate(every)]

    def actuation(self) -> tuple[tuple[bool, ...], ...]:
        """The robot's."""
        return self.nominal.actuation()

    def constraints(self, position: Vec, rotation: Rotation) -> Any:
        """Those of the nominal robot."""
        return self.nominal.constraints(position, rotation)

    @one_pose()
    def home(self) -> tuple[jax.Array, jax.Array]:
        """The nominal robot's home pose, and the legs' joints there."""
        pose, joints = self.nominal.home()
        seen, tol = seen_by_legs(self, *self.space.place(pose)), default_tol(pose.dtype)

        def settle(leg: Leg, attachment: Attachment, start: Joints):
            return newton(leg_residual, start, (leg, attachment), tol=tol, max_steps=_MAX_STEPS)

        roots, error, _ = over_legs(settle, *lax.stop_gradient((self.legs(), seen, joints_by_leg(self, joints))))
        return pose, joints_together(self, differentiable_roots(self.legs(), seen, roots, error <= tol))

    def __repr__(self) -> str:
        """The table of the dimensions, leg by leg."""
        return f"{type(self).__name__} {self.copies!r}"


def per_leg(robot: Mechanism, **dimensions: Any) -> PerLeg:
    """The robot with dimensions of its own for each leg.

    The numbers that a symmetric robot's legs share, such as the link lengths of the Triple Scissor
    Extender, become one number per leg; kinematics, Jacobians, margins, gradients and pictures work on the
    result as on any robot.

    Args:
      robot: any robot.
      **dimensions: fields of the robot by name, ``(legs, *shape)``, or what broadcasts to that, in place of
        the robot's own.

    Returns:
      ``robots.PerLeg``, whose ``copies`` is a robot with a leading axis ``(legs,)`` on every array.

    Raises:
      ValueError: a name that is no field of the robot, or values that do not broadcast.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> crooked = js.per_leg(robot, top_radius=robot.top_radius + jnp.array([0.0, 1e-3, 0.0]))
      >>> pose, joints = robot.home()
      >>> moved = js.inverse_kinematics(crooked, pose).value - joints
      >>> [bool(abs(q) > 1e-6) for q in moved]  # those of the second leg
      [False, False, True, True, False, False]
    """
    return PerLeg(with_fields(copies_of(robot), dimensions))


def copies_of(robot: Mechanism) -> Any:
    """The robot with a leading axis ``(legs,)`` on every array."""
    legs = len(actuation(robot))
    (robot,) = as_floats(robot)
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (legs, *leaf.shape)), robot)
