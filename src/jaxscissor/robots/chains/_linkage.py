"""A robot of chains."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp

from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_arrays, as_floats, float_dtype, pytree, static
from jaxscissor._engine.types import PoseLike
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._contract import Attachment, Leg, Mechanism
from jaxscissor.robots._kinds import kinds_of, seen_by_kinds, stacked_legs
from jaxscissor.robots._spaces import SE3, Space
from jaxscissor.robots.chains._chain import Chain


class Linkage(Mechanism):
    """A robot whose legs are chains of joints; a subclass states ``space``, ``chains()`` and ``home_pose()``."""

    def chains(self) -> Sequence[Chain]:
        """One for each leg, where its joints are at home."""
        raise NotImplementedError(f"{type(self).__name__} does not define chains(); see Linkage.")

    def home_pose(self) -> jax.Array:
        """Pose ``(d,)`` of the platform while the joints are where the chains say."""
        raise NotImplementedError(f"{type(self).__name__} does not define home_pose(); see Linkage.")

    @property
    def length(self) -> Scalar:
        """Mean length of the chains."""
        chains = self._chains()
        return sum(chain.reach for chain in chains) / len(chains)

    def _chains(self) -> list[Chain]:
        """In the robot's dtype, also what in them is no dimension of the robot."""
        return jax.tree.map(lambda leaf: leaf.astype(float_dtype(self)), list(self.chains()))

    def legs(self) -> Leg:
        """The chains' legs, stacked."""
        chains, home = self._chains(), self.space.place(self.home_pose())
        if max(kinds_of(chains)) == 0:
            stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *chains)
            return jax.vmap(lambda chain: chain.leg(self.space, home, self.length))(stacked)
        legs = [chain.leg(self.space, home, self.length) for chain in chains]
        return stacked_legs(legs, [chain.seen(self.space, home, *home) for chain in chains])

    def attachments(self, position: Vec, rotation: Rotation) -> list[Attachment]:
        """What each chain holds of the platform."""
        chains, home = self._chains(), self.space.place(self.home_pose())
        seen = [chain.seen(self.space, home, position, rotation) for chain in chains]
        return seen_by_kinds(self._kinds(chains), seen)

    def _kinds(self, chains: Sequence[Chain]) -> list[int]:
        """Number of the kind of each chain's leg; chains of different joints may be legs of one kind."""
        if max(kinds_of(chains)) == 0:
            return [0] * len(chains)
        home = self.space.place(self.home_pose())
        return kinds_of([jax.eval_shape(lambda chain: chain.leg(self.space, home, self.length), c) for c in chains])

    @one_pose()
    def home(self) -> tuple[jax.Array, jax.Array]:
        """Where the chains are described; all joints are zero."""
        pose = self.home_pose()
        return pose, jnp.zeros(sum(map(len, self.actuation())), pose.dtype)


@pytree
class FromChains(Linkage):
    """A robot made of chains by ``robots.linkage``."""

    given: tuple[Chain, ...]
    pose: Any
    pose_space: Any = static()
    pose_dependent: tuple[str, ...] = static(default=())

    @property
    def space(self) -> Any:  # pyright: ignore[reportIncompatibleVariableOverride]
        """As given."""
        return self.pose_space

    @property
    def dependent(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """As given."""
        return self.pose_dependent

    def chains(self) -> Sequence[Chain]:
        """As given."""
        return self.given

    def home_pose(self) -> jax.Array:
        """As given."""
        return self.pose

    def __repr__(self) -> str:
        """Its chains."""
        letters = " and ".join(dict.fromkeys(chain.letters for chain in self.given))
        return f"a robot of {len(self.given)} chains {letters} with pose ({', '.join(self.space.names)})"


def linkage(
    chains: Sequence[Chain], pose: PoseLike, *, space: Space = SE3, dependent: tuple[str, ...] = ()
) -> FromChains:
    """A robot of chains of joints, without mathematics: where the joints are while the platform is at a pose.

    Args:
      chains: one for each leg, of any joints; every point and axis in them is a dimension of the robot.
      pose: ``(d,)`` of the platform there, which is the robot's home.
      space: of the poses: ``SE3``, ``SE2``, ``R3`` or another.
      dependent: coordinates of the pose that the chains bind to the others.

    Returns:
      The robot, with all joint coordinates zero at home.

    Raises:
      ValueError: wrong shape of the pose; chains that cannot follow the platform.

    Example:
      A hexapod with rotary motors:

      >>> import math, jax, jaxscissor as js
      >>> def leg(i):
      ...     base, top = (2 * math.pi / 3 * (i // 2) + (half if i % 2 else -half) for half in (0.3, 0.7))
      ...     radial = math.cos(2 * math.pi / 3 * (i // 2)), math.sin(2 * math.pi / 3 * (i // 2))
      ...     hip = 0.3 * math.cos(base), 0.3 * math.sin(base), 0.0
      ...     knee = hip[0] + 0.2 * radial[0], hip[1] + 0.2 * radial[1], 0.0
      ...     motor = js.Revolute((-radial[1], radial[0], 0.0), hip, actuated=True)
      ...     corner = 0.2 * math.cos(top), 0.2 * math.sin(top), 0.4
      ...     return js.Chain([motor, js.Spherical(knee), js.Spherical(corner)])
      >>> robot = js.robots.linkage([leg(i) for i in range(6)], [0.0, 0.0, 0.4, 0.0, 0.0, 0.0])
      >>> js.inverse_kinematics(robot, [0.0, 0.0, 0.42, 0.1, 0.0, 0.0]).value.shape
      (6,)
    """
    (pose,) = as_arrays(pose)
    if pose.shape != (space.dimension,):
        raise ValueError(
            f"Got a pose of shape {pose.shape}; expected ({space.dimension},) = ({', '.join(space.names)})."
        )
    given, pose = as_floats(tuple(chains), pose)
    robot = FromChains(given, pose, space, dependent)
    robot.legs()  # refuses chains that make no robot
    return robot
