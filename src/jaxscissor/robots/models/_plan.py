"""What is fixed about a leg that a model file describes: its bodies, joints and closures, and which equations count."""

from __future__ import annotations

import dataclasses

BASE, PLATFORM = -1, -2  # parents of bodies that hang from them, and sides of closures


@dataclasses.dataclass(frozen=True)
class JointPlan:
    """A joint of a body: ``"R"`` a pin, ``"P"`` a slide, ``"B"`` a ball."""

    name: str
    kind: str
    coordinates: tuple[int, ...] = (0,)  # of a ball those of three that are not idle; none of a joint that is
    actuated: bool = False


@dataclasses.dataclass(frozen=True)
class BodyPlan:
    """A body that hangs from the base, from the platform or from an earlier body of its leg."""

    name: str
    parent: int
    joints: tuple[JointPlan, ...]


@dataclasses.dataclass(frozen=True)
class ClosurePlan:
    """Two bodies held together: ``"point"`` in a point, ``"frame"`` rigidly; ``"gear"`` is of two joints."""

    name: str
    kind: str
    first: int  # of a gear the number of a joint coordinate, as the second, which may be missing
    second: int
    polynomial: tuple[float, ...] = ()


@dataclasses.dataclass(frozen=True)
class LegPlan:
    """A part of the mechanism that joins base and platform, whatever loops it has itself.

    ``solve`` are the equations that its joints solve, ``bind`` those that bind the platform; the others follow.
    """

    bodies: tuple[BodyPlan, ...]
    closures: tuple[ClosurePlan, ...]
    solve: tuple[int, ...] = ()
    bind: tuple[int, ...] = ()

    def without_names(self) -> LegPlan:
        """Equal for legs of one kind."""
        bodies = tuple(
            dataclasses.replace(
                body, name="", joints=tuple(dataclasses.replace(joint, name="") for joint in body.joints)
            )
            for body in self.bodies
        )
        closures = tuple(dataclasses.replace(closure, name="") for closure in self.closures)
        return dataclasses.replace(self, bodies=bodies, closures=closures)

    def coordinates(self) -> list[JointPlan]:
        """The joint of each coordinate, in turn."""
        return [joint for body in self.bodies for joint in body.joints for _ in joint.coordinates]
