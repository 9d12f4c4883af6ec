"""A robot as a model file describes it."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from jaxscissor._engine.numerics import Scalar, safe_sqrt
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import float_dtype, pytree, quantity, static
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._contract import (
    Attachment,
    Leg,
    Mechanism,
    differentiable_roots,
    joints_together,
    roots_from_start,
    seen_by_legs,
)
from jaxscissor.robots._kinds import kinds_of, seen_by_kinds, stacked_legs
from jaxscissor.robots.models._leg import ModelLeg
from jaxscissor.robots.models._plan import LegPlan


@pytree
class FromModel(Mechanism):
    """A robot made from a model file by ``robots.from_mjcf``. Its dimensions have the names that the file gives them.

    All are along the axes of the base, as they are at home.

    Attributes:
      bodies: from the origin of what a body hangs from to its own.
      axes: of pins and slides.
      points: from the origin of a body to its joint.
      anchors: ``(2, 3)`` from the origins of two bodies to where a loop is closed.
      values: coordinates of joints at home, an angle or a length, as in the file.
      strokes: ``(2,)`` least and greatest.
      origin: ``(3,)`` where the platform's coordinates are all zero.
      pose: ``(d,)`` at home.
      plans: how the legs hang together.
      pose_space, pose_dependent: of the poses, and coordinates that the legs bind.
    """

    bodies: dict[str, Any] = quantity("m")
    axes: dict[str, Any]
    points: dict[str, Any] = quantity("m")
    anchors: dict[str, Any] = quantity("m")
    values: dict[str, Any]
    strokes: dict[str, Any]
    origin: Any = quantity("m")
    pose: Any
    plans: tuple[LegPlan, ...] = static()
    pose_space: Any = static()
    pose_dependent: tuple[str, ...] = static(default=())

    @property
    def space(self) -> Any:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The coordinates of the platform that the legs leave free at home."""
        return self.pose_space

    @property
    def dependent(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Coordinates that the legs bind to the others."""
        return self.pose_dependent

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names in the file of all joint coordinates, in their order."""
        return tuple(joint.name for plan in self.plans for joint in plan.coordinates())

    @property
    def actuated_names(self) -> tuple[str, ...]:
        """Names in the file of the actuated joints, in their order."""
        return tuple(joint.name for plan in self.plans for joint in plan.coordinates() if joint.actuated)

    @property
    def length(self) -> Scalar:
        """Mean over the legs of all distances from body to body and to the closures."""
        vectors = [*self.bodies.values(), *(side for sides in self.anchors.values() for side in sides)]
        return sum(safe_sqrt(jnp.sum(vector**2)) for vector in vectors) / len(self.plans)

    def _legs(self) -> list[ModelLeg]:
        return [self._leg(plan) for plan in self.plans]

    def _leg(self, plan: LegPlan) -> ModelLeg:
        joints = [joint.name for body in plan.bodies for joint in body.joints]
        closures = [c.name for c in plan.closures]
        dtype = float_dtype(self)

        def rows(values: dict[str, Any], names: list[str], *shape: int) -> jax.Array:
            return jnp.stack([values[name] for name in names]) if names else jnp.zeros((0, *shape), dtype)

        return ModelLeg(
            bodies=rows(self.bodies, [body.name for body in plan.bodies], 3),
            axes=rows(self.axes, joints, 3),
            points=rows(self.points, joints, 3),
            values=rows(self.values, joints),
            strokes=rows(self.strokes, joints, 2),
            anchors=rows(self.anchors, closures, 2, 3),
            scale=self.length,
            plan=plan.without_names(),
        )

    def legs(self) -> Leg:
        """The parts of the mechanism that join base and platform."""
        legs = self._legs()
        return stacked_legs(legs, [self._seen(*self.space.place(self.pose))] * len(legs))

    def _seen(self, position: Vec, rotation: Rotation) -> Attachment:
        """The platform's origin, and how it is turned from home."""
        axes = self.space.place(self.pose)[1].columns
        turned = [rotation @ Vec(*(axis.components[i] for axis in axes)) for i in range(3)]
        columns = [Vec(*(jnp.asarray(x, self.origin.dtype) for x in column.components)) for column in turned]
        return position + Vec(*self.origin), tuple(columns)

    def attachments(self, position: Vec, rotation: Rotation) -> list[Attachment]:
        """Every leg sees the platform's frame."""
        kinds = kinds_of(self._legs())
        return seen_by_kinds(kinds, [self._seen(position, rotation)] * len(kinds))

    @one_pose()
    def home(self) -> tuple[jax.Array, jax.Array]:
        """The pose of the file, and the joints that belong to it, which follow the dimensions."""
        legs, seen = self.legs(), seen_by_legs(self, *self.space.place(self.pose))
        return self.pose, joints_together(self, differentiable_roots(legs, seen, *roots_from_start(legs, seen)))

    def __repr__(self) -> str:
        """Its legs and what is actuated."""
        names = ", ".join(self.actuated_names)
        return f"a robot of {len(self.plans)} legs with pose ({', '.join(self.space.names)}), actuated by {names}"
