"""The contract between a robot and the library: a platform, its legs, and how they are laid out.

    pose --attachments--> what each leg sees of the platform --residual(joints, attachment) = 0--> joints

A robot is a pytree: its arrays are the design, and everything else in the library follows from the
methods below by automatic differentiation. Define a leg and a robot with ``pytree`` and these two bases.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxscissor._engine.matrices import determinant
from jaxscissor._engine.newton import implicit, newton, value_and_jacobian
from jaxscissor._engine.numerics import Scalar, default_tol
from jaxscissor._engine.pytree import as_floats, float_dtype, is_concrete
from jaxscissor._engine.types import JointsLike, PoseLike
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._bodies import Connection
from jaxscissor.robots._circle import Circle
from jaxscissor.robots._method_checks import LEG, ROBOT, actuated_flags, check_methods
from jaxscissor.robots._over_legs import one_by_one, over_legs
from jaxscissor.robots._spaces import Space

Joints = tuple[Scalar, ...]  # the joint coordinates of one leg
MAX_STEPS = 30
"""Newton steps of a leg before giving up."""

Attachment = Any  # what a leg sees of the platform: a point, a point and an axis, ...; pictures take the first point


class LegKind(NamedTuple):
    """What is fixed about one of several stacked legs that are of different kinds."""

    actuated: tuple[bool, ...]  # one entry per joint
    angular: tuple[bool, ...]
    constraints: int  # how many of those that the stacked legs state are its own, the first ones


class Leg:
    """One leg, unbatched. Subclasses are pytrees; the library maps over legs and poses."""

    actuated: ClassVar[tuple[bool, ...]]  # one entry per joint of the leg; False is passive
    angular: ClassVar[tuple[bool, ...] | None] = None
    """Which joints are angles; ``None``: all are lengths. A wrong flag changes gear ratios, and no check can see it."""
    limits: ClassVar[tuple[str, ...] | None] = None  # names of the margins, for reports; None: they are numbered
    each: ClassVar[tuple[LegKind, ...] | None] = None  # of stacked legs of different kinds, what each of them has

    def __init_subclass__(cls, **kwargs: Any):
        super().__init_subclass__(**kwargs)
        check_methods(cls, LEG)

    def alone(self, number: int) -> Leg:
        """The leg, which was this one of stacked legs, where that says of which kind it is. Default: itself."""
        return self

    def residual(self, joints: Joints, attachment: Attachment) -> Joints:
        """Closure equations, as many as joints, dimensionless and of order one."""
        raise _missing(self, "residual(joints, attachment)")

    def start(self, attachment: Attachment) -> tuple[Joints, Scalar | None]:
        """First guess on the home mode, and how far the attachment lies inside that mode's reach.

        The reach is continuous, dimensionless and >= 0 exactly where the home mode exists; where it is
        negative, the guess must be the joints of least residual at the mode's edge, which are not iterated
        further. ``None`` if it is not known in closed form: Newton's success then decides.
        """
        raise _missing(self, "start(attachment)")

    def margins(self, joints: Joints, attachment: Attachment) -> Sequence[Scalar]:
        """Signed distances to the limits, dimensionless, >= 0 where feasible. Default: no limits."""
        return ()

    def constraints(self, joints: Joints, attachment: Attachment) -> Sequence[Scalar]:
        """Equations that the leg imposes on what it sees besides those that its joints solve. Default: none.

        Dimensionless and of order one, as many for each leg. They may depend on the joints, as does a plane that
        turns with the first of them. Their dimensions are the leg's own, so that ``design.tolerances`` and calibration
        see those of every leg.
        """
        return ()

    def bars(self, joints: Joints, attachment: Attachment) -> Sequence[tuple[Vec, Vec]]:
        """Segments to draw, in the base frame; those of a planar robot may have a height too. Default: none."""
        return ()

    def rails(self, joints: Joints, attachment: Attachment) -> Sequence[tuple[Vec, Vec]]:
        """Segments fixed to the base that the leg runs on, to draw, or a joint on it twice. Default: none.

        The first one's first end is the leg's corner of the base.
        """
        return ()

    def connections(self, joints: Joints, attachment: Attachment) -> Sequence[Connection]:
        """How the bars hang together, at this configuration, in the base frame. Default: unknown."""
        return ()

    def mode(self, joints: Joints, attachment: Attachment) -> Scalar:
        """Label of the working mode, an integer. Default: sign of det d residual / d joints."""
        _, rows = value_and_jacobian(lambda q: self.residual(q, attachment), joints)
        return jnp.sign(determinant(rows)).astype(jnp.int32)

    def circle(self, joints: Joints) -> Circle | None:
        """The ``robots.Circle`` of the point that the leg sees while its joints, all of them actuated, stand still.

        The attachment must be that point itself, in the base frame. Of three such legs of a free platform, forward
        kinematics solves for three angles instead of a pose. The circle's tangent t must not change sides:
        t . (grad r1 x grad r2), by the point, of the residual r keeps its sign. Default: unknown.
        """
        return None

    def solutions(self, attachment: Attachment) -> tuple[Sequence[Joints], Sequence[Scalar]] | None:
        """Every root, padded, and which are real. Only this can prove that there is none. Default: unknown."""
        return None

    def assembles(self, attachment: Attachment) -> Scalar | None:
        """Whether there is any root. Default: whether ``solutions`` has one; ``None`` if that is unknown."""
        solutions = self.solutions(attachment)
        return None if solutions is None else functools.reduce(jnp.logical_or, solutions[1])

    def closes(self, joints: Joints) -> Scalar:
        """Whether the leg can be assembled with these joints for some attachment. Default: not known to fail."""
        return True


class _NoSpace:
    """Stands where a robot's space is missing."""

    def __get__(self, robot: Mechanism, cls: type) -> Any:
        raise ValueError(f"{cls.__name__} has no space; set space = SE3, SE2, R3 or another of robots in its class.")


class Mechanism:
    """A parallel robot. Subclasses are pytrees whose leaves are the design."""

    space: ClassVar[Space] = _NoSpace()  # pyright: ignore[reportAssignmentType]
    dependent: ClassVar[tuple[str, ...]] = ()
    """Names of the pose coordinates that the constraints determine from the others (parasitic motion)."""
    joint_order: ClassVar[tuple[int, ...] | None] = None
    """Place in the array of joints of each leg's joints, taken leg by leg; ``None`` is leg by leg."""

    def __init_subclass__(cls, **kwargs: Any):
        super().__init_subclass__(**kwargs)
        check_methods(cls, ROBOT)

    @property
    def length(self) -> Scalar:
        """Characteristic length, which makes poses and measures dimensionless.

        Searches look so far around home: take it as large as the distances between assembly modes.
        """
        raise _missing(self, "length")

    def legs(self) -> Leg:
        """The legs, stacked on the leading axis of every leaf."""
        raise _missing(self, "legs()")

    def attachments(self, position: Vec, rotation: Rotation) -> Sequence[Attachment]:
        """What each leg sees of the platform. No trigonometry here: the library has done it."""
        raise _missing(self, "attachments(position, rotation)")

    def actuation(self) -> tuple[tuple[bool, ...], ...]:
        """Which joints of each leg are actuated. Default: as the leg's class says."""
        stacked = self.legs()
        if stacked.each is not None:
            return tuple(kind.actuated for kind in stacked.each)
        return (actuated_flags(stacked),) * jax.tree.leaves(stacked)[0].shape[0]

    def actuated(self, joints: JointsLike) -> jax.Array:
        """The actuated ones of all joints ``(..., n)``, in the order in which the robot counts them."""
        return jnp.asarray(joints)[..., np.array(actuated_mask(self))]

    def constraints(self, position: Vec, rotation: Rotation) -> Sequence[Scalar]:
        """Equations among the pose alone that belong to no leg (those that do: ``Leg.constraints``). Default: none."""
        return ()

    def home(self) -> tuple[jax.Array, jax.Array]:
        """A consistent (pose, joints) that names the working mode."""
        raise _missing(self, "home()")

    def assemblies(self, joints: jax.Array) -> tuple[jax.Array, jax.Array] | None:
        """Every pose ``(modes, d)`` that the actuated joints allow, padded, and which are real ``(modes,)``.

        Only this can prove how many there are. Default: unknown, and the library searches.
        """
        return None

    def __eq__(self, other: object) -> bool:
        """Whether the other is a robot of the same class with the same dimensions, to the last bit."""
        if not isinstance(other, Mechanism) or jax.tree.structure(self) != jax.tree.structure(other):
            return NotImplemented
        return all(map(np.array_equal, jax.tree.leaves(self), jax.tree.leaves(other)))

    def __hash__(self) -> int:
        return hash(jax.tree.structure(self))  # which equal robots share; their dimensions may be tracers

    def __repr__(self) -> str:
        """A table of the robot's dimensions with units."""
        rows = [(f.name, _shown(getattr(self, f.name)), f.metadata.get("unit", "")) for f in dataclasses.fields(self)]  # type: ignore[arg-type]
        wide = max(len(name) for name, _, _ in rows)
        lines = [f"  {name:<{wide}}  {value}{' ' + unit if unit else ''}" for name, value, unit in rows]
        return "\n".join([type(self).__name__, *lines])


def _missing(self: Any, method: str) -> NotImplementedError:
    return NotImplementedError(
        f"{type(self).__name__} does not define {method}; see {type(self).__mro__[-2].__name__}."
    )


def _shown(value: Any) -> str:
    if not is_concrete(value):
        return str(value)
    return np.array2string(np.asarray(value), precision=5, floatmode="maxprec", separator=", ").replace("\n", "")


def actuation(robot: Mechanism) -> tuple[tuple[bool, ...], ...]:
    """Which joints of each leg are actuated, asked once for all robots of one structure and equal shapes.

    One trace needs it dozens of times, and the answer of most robots takes building all legs.
    """
    leaves, structure = jax.tree.flatten(robot)
    key = structure, tuple(map(jnp.shape, leaves))
    if key not in _ACTUATIONS:
        _ACTUATIONS[key] = robot.actuation()
    return _ACTUATIONS[key]


_ACTUATIONS: dict[Any, tuple[tuple[bool, ...], ...]] = {}


def joint_places(robot: Mechanism) -> np.ndarray:
    """For every leg, where its joints stand in the array of all joints, ``(legs, joints of a leg)``.

    Legs of fewer joints than others are filled up with -1.
    """
    counts = [len(leg) for leg in actuation(robot)]
    order = iter(range(sum(counts)) if robot.joint_order is None else robot.joint_order)
    return np.array([[next(order) if i < count else -1 for i in range(max(counts))] for count in counts])


def actuated_mask(robot: Mechanism) -> tuple[bool, ...]:
    """Which entries of the array of all joints are actuated."""
    return _by_place(robot, actuation(robot))


def angular_joints(robot: Mechanism) -> tuple[bool, ...]:
    """Which entries of the array of all joints are angles."""
    return _by_place(robot, angular_by_leg(robot))


def angular_by_leg(robot: Mechanism) -> list[tuple[bool, ...]]:
    """Which joints of each leg are angles."""
    legs = robot.legs()
    if legs.each is not None:
        return [kind.angular for kind in legs.each]
    return [legs.angular or (False,) * len(leg) for leg in actuation(robot)]


def _by_place(robot: Mechanism, flags: Sequence[Sequence[bool]]) -> tuple[bool, ...]:
    """Flags given leg by leg, in the order of the array of all joints."""
    return tuple(np.concatenate([np.array(leg, bool) for leg in flags])[np.argsort(_places_in_turn(robot))].tolist())


def _places_in_turn(robot: Mechanism) -> np.ndarray:
    """Where the joints stand in the array of all joints, leg by leg."""
    places = joint_places(robot)
    return places[places >= 0]


def joints_by_leg(robot: Mechanism, joints: jax.Array | Joints) -> Joints:
    """The first joint of every leg ``(legs,)``, the second one of every leg, ..., from the array of all joints.

    A joint that a leg does not have is zero.
    """
    places, count = joint_places(robot), len(_places_in_turn(robot))
    if len(joints) != count:
        raise ValueError(f"Got {len(joints)} joints of a {type(robot).__name__}, whose legs have {count}.")
    zero = jnp.zeros_like(joints[0])
    return tuple(jnp.stack([joints[i] if i >= 0 else zero for i in column]) for column in places.T)


def joints_together(robot: Mechanism, joints: Joints) -> jax.Array:
    """The array of all joints, or of a row for each, from those of every leg ``(legs,)``."""
    together = jnp.stack(joints, axis=1)
    together = together.reshape(-1, *together.shape[2:])
    places = joint_places(robot).ravel()
    here = np.flatnonzero(places >= 0)
    order = here[np.argsort(places[here])]
    return together if np.array_equal(order, np.arange(places.size)) else jnp.stack([together[i] for i in order])


def seen_by_legs(robot: Mechanism, position: Vec, rotation: Rotation) -> Attachment:
    """What the legs see of the platform, stacked as they are."""
    return _stacked(_seen_one_by_one(robot, position, rotation))


def _stacked(seen: Sequence[Attachment]) -> Attachment:
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *seen)


def _seen_one_by_one(robot: Mechanism, position: Vec, rotation: Rotation) -> Sequence[Attachment]:
    seen, legs = robot.attachments(position, rotation), len(actuation(robot))
    if len(seen) != legs:
        raise ValueError(
            f"{type(robot).__name__}.attachments(position, rotation) gave {len(seen)} attachments; expected {legs}, "
            "one per leg of legs()."
        )
    return seen


def is_redundant(robot: Mechanism) -> bool:
    """Whether more joints are actuated than the platform has freedoms."""
    return sum(actuated_mask(robot)) > robot.space.dimension - _bound(robot)


def _bound(robot: Mechanism) -> int:
    """Number of constraints on the pose."""
    pose = jax.ShapeDtypeStruct((robot.space.dimension,), float_dtype(robot))
    return len(jax.eval_shape(lambda pose: constraints_on(robot, *robot.space.place(pose)), pose))


def checked_freedoms(robot: Mechanism, *, more: bool = False) -> None:
    """Raise unless there are as many actuated joints as the platform has freedoms, or ``more`` where that will do.

    Raises:
      ValueError: naming both counts.
    """
    dimension, actuated, bound = robot.space.dimension, sum(actuated_mask(robot)), _bound(robot)
    freedoms = dimension - bound
    if actuated != freedoms and not (more and actuated > freedoms):
        raise ValueError(
            f"Got a {type(robot).__name__} with {actuated} actuated joints for {freedoms} freedoms: {dimension} "
            f"coordinates of the pose ({', '.join(robot.space.names)}) and {bound} constraints on it. Expected "
            f"{'at least ' if more else ''}as many actuated joints as freedoms: see actuated of the leg, legs() and "
            "constraints()."
        )


def leg_residual(joints: Joints, args: tuple[Any, Attachment]) -> Joints:
    """Residual of one leg as a function of module level, the form the solver takes."""
    leg, attachment = args
    return leg.residual(joints, attachment)


def differentiable_roots(legs: Any, seen: Attachment, roots: Joints, ok: Scalar) -> Joints:
    """Roots of every leg with the implicit function's derivative, where ok: a flag for all or one for each leg."""
    ok = jnp.broadcast_to(ok, roots[0].shape)
    return over_legs(lambda leg, one, root, ok: implicit(leg_residual, root, ok, (leg, one)), legs, seen, roots, ok)


def closure(robot: Mechanism, legs: Any, joints: jax.Array | Joints, position: Vec, rotation: Rotation) -> Joints:
    """All closure equations, leg by leg, and the constraints on the pose after them."""
    seen, by_leg = _seen_one_by_one(robot, position, rotation), joints_by_leg(robot, joints)
    cases = zip(one_by_one(legs, by_leg), seen, actuation(robot), strict=True)
    equations = [equation for (leg, q), one, own in cases for equation in leg.residual(q, one)[: len(own)]]
    of_legs = _of_legs(legs, by_leg, seen) if _legs_bind(robot) else []
    return (*equations, *of_legs, *robot.constraints(position, rotation))


def constraints_on(
    robot: Mechanism, position: Vec, rotation: Rotation, joints: jax.Array | None = None
) -> tuple[Scalar, ...]:
    """All equations among the pose alone: those of each leg, leg by leg, and the robot's own after them.

    Those of the legs are taken at the joints given, by default at those of the home mode; their derivatives are those
    of joints that follow the pose.
    """
    of_legs: list[Scalar] = []
    if _legs_bind(robot):
        legs, seen = robot.legs(), _seen_one_by_one(robot, position, rotation)
        stacked = _stacked(seen)
        roots, ok = roots_from_start(legs, stacked) if joints is None else (joints_by_leg(robot, joints), True)
        of_legs = _of_legs(legs, differentiable_roots(legs, stacked, roots, ok), seen)
    return (*of_legs, *robot.constraints(position, rotation))


def _of_legs(legs: Any, joints: Joints, seen: Sequence[Attachment]) -> list[Scalar]:
    counts = [None] * len(seen) if legs.each is None else [kind.constraints for kind in legs.each]
    cases = zip(one_by_one(legs, joints), seen, counts, strict=True)
    return [equation for (leg, q), one, count in cases for equation in leg.constraints(q, one)[:count]]


def roots_from_start(legs: Any, seen: Attachment) -> tuple[Joints, Scalar]:
    """Joints of the home mode and which are roots; the compiler drops all this where no constraint reads them."""

    def solved(leg: Leg, one: Attachment) -> tuple[Joints, Scalar]:
        start, reach = leg.start(one)
        tol = default_tol(jnp.result_type(start[0]))
        active = True if reach is None else reach >= 0
        root, error, _ = newton(leg_residual, start, (leg, one), tol=tol, max_steps=MAX_STEPS, active=active)
        return root, error <= tol

    return over_legs(solved, *lax.stop_gradient((legs, seen)))


def _legs_bind(robot: Mechanism) -> bool:
    """Whether legs have constraints, asked once per structure: most have none, and would be built for nothing."""
    leaves, structure = jax.tree.flatten(robot)
    key = structure, tuple(map(jnp.shape, leaves))
    if key not in _BINDING:

        def equations(robot: Mechanism, pose: jax.Array) -> list[Scalar]:
            seen = _seen_one_by_one(robot, *robot.space.place(pose))
            zero = jnp.zeros(len(seen), pose.dtype)
            return _of_legs(robot.legs(), (zero,) * joint_places(robot).shape[1], seen)

        pose = jax.ShapeDtypeStruct((robot.space.dimension,), float_dtype(robot))
        _BINDING[key] = bool(jax.eval_shape(equations, robot, pose))
    return _BINDING[key]


_BINDING: dict[Any, bool] = {}


def checked_pose(robot: Mechanism, pose: PoseLike) -> tuple[Any, jax.Array]:
    """Robot and pose in one floating dtype.

    Raises:
      ValueError: the pose does not have the shape of the robot's space.
    """
    pose = jnp.asarray(pose)
    shape, space = pose.shape, robot.space
    if jnp.iscomplexobj(pose):
        raise ValueError(f"Got a complex pose, {pose.dtype}; expected real numbers.")
    if shape != (space.dimension,):
        raise ValueError(
            f"Got a pose of shape {shape}; {type(robot).__name__} expects ({space.dimension},) = "
            f"({', '.join(space.names)}). Map over a batch of poses with jax.vmap."
        )
    robot, pose = as_floats(robot, pose)
    return robot, pose


def checked_joints(robot: Mechanism, joints: JointsLike, *, actuated_only: bool = False) -> jax.Array:
    """Joints as an array of the robot's dtype.

    Raises:
      ValueError: the array does not have one entry per joint.
    """
    mask = actuated_mask(robot)
    expected = (sum(mask) if actuated_only else len(mask),)
    joints = jnp.asarray(joints)
    if jnp.iscomplexobj(joints):
        raise ValueError(f"Got complex joints, {joints.dtype}; expected real numbers.")
    if joints.shape != expected:
        kind = "actuated joints" if actuated_only else "joints"
        raise ValueError(
            f"Got {kind} of shape {joints.shape}; {type(robot).__name__} expects {expected}. "
            "Map over a batch with jax.vmap."
        )
    return joints
