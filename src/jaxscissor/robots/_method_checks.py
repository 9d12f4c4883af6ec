"""What a robot's methods give, checked and cast as they give it: a mistake is told by the name of its method."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.pytree import float_dtype
from jaxscissor._engine.types import PyTree
from jaxscissor.robots._bodies import Connection
from jaxscissor.robots._circle import Circle

Check = Callable[..., Any]  # (self, what the method gave, *its arguments) -> what the library is given


def check_methods(cls: type, checks: Mapping[str, Check]) -> None:
    """Put a check behind every method and property that a class defines itself."""
    for name, check in checks.items():
        method = cls.__dict__.get(name)
        if isinstance(method, property) and method.fget is not None:
            setattr(cls, name, property(_checked(method.fget, name, check), doc=method.__doc__))
        elif callable(method):
            setattr(cls, name, _checked(method, name, check))


def _checked(method: Callable[..., Any], name: str, check: Check) -> Callable[..., Any]:
    @functools.wraps(method)
    def call(self: Any, *args: Any) -> Any:
        given = method(self, *args)
        own = getattr(type(self), name)
        if (
            getattr(own, "fget", own) is not call
        ):  # called by the method of a subclass, which makes something else of it
            return given
        return check(self, given, *args)

    return call


def cast(tree: PyTree, dtype: jax.typing.DTypeLike) -> Any:
    """All floating arrays of a tree in one dtype; Python numbers follow their neighbours anyway."""

    def leaf(value):
        floating = hasattr(value, "dtype") and jnp.issubdtype(value.dtype, jnp.floating)
        return jnp.asarray(value, dtype) if floating and value.dtype != dtype else value

    return jax.tree.map(leaf, tree)


def refuse(self: Any, method: str, got: Any, expected: str) -> ValueError:
    """The error that a method gave something else than expected."""
    return ValueError(f"{type(self).__name__}.{method} gave {_described(got)}; expected {expected}.")


def is_number(value: Any, *, flag: bool = False) -> bool:
    """Whether a value is one real number, or one truth value."""
    if isinstance(value, (bool, np.bool_)):
        return flag
    if isinstance(value, (int, float)):
        return not flag
    kind = jnp.bool_ if flag else jnp.number
    return getattr(value, "shape", None) == () and jnp.issubdtype(value.dtype, kind) and not jnp.iscomplexobj(value)


def numbers(value: Any) -> bool:
    """Whether a value is a tuple or list of numbers."""
    return isinstance(value, (tuple, list)) and all(map(is_number, value))


def _described(value: Any) -> str:
    if isinstance(value, (tuple, list)):
        return f"a {type(value).__name__} of {len(value)}: ({', '.join(map(_described, value))})"[:200]
    if hasattr(value, "shape"):
        return f"an array of shape {value.shape} and {value.dtype}"
    return f"{value!r}"[:80] if isinstance(value, (bool, int, float, type(None))) else f"a {type(value).__name__}"


def checked_legs(self: Any, legs: Any) -> Any:
    """Legs stacked on the leading axis of every array."""
    leaves = jax.tree.leaves(legs)
    counts = {leaf.shape[0] if getattr(leaf, "shape", ()) else None for leaf in leaves}
    if isinstance(legs, (list, tuple)) or not leaves or len(counts) != 1 or None in counts:
        expected = "one leg in whose every array the legs are stacked on a leading axis: "
        raise refuse(self, "legs()", legs, expected + "jax.tree.map(lambda *leaves: jnp.stack(leaves), *legs)")
    return cast(legs, float_dtype(self))


def checked_attachments(self: Any, seen: Any, position: Any, rotation: Any) -> Any:
    """One attachment per leg."""
    if not isinstance(seen, (list, tuple)) or hasattr(seen, "components"):
        raise refuse(self, "attachments(position, rotation)", seen, "a list with what each leg sees of the platform")
    return cast(list(seen), _dtype((position, rotation)))


def checked_constraints(self: Any, constraints: Any, position: Any, rotation: Any) -> Any:
    """Equations, one number each."""
    if not numbers(constraints):
        raise refuse(self, "constraints(position, rotation)", constraints, "a list with one number per equation")
    return cast(list(constraints), _dtype((position, rotation)))


def checked_leg_constraints(self: Any, constraints: Any, joints: tuple[Any, ...], attachment: PyTree) -> Any:
    """Equations, one number each."""
    if not numbers(constraints):
        raise refuse(self, "constraints(joints, attachment)", constraints, "a list with one number per equation")
    return cast(list(constraints), jnp.result_type(joints[0]))


def checked_home(self: Any, home: Any) -> tuple[Any, Any]:
    """Pose and joints as arrays."""
    dimension = self.space.dimension
    if not isinstance(home, (tuple, list)) or len(home) != 2 or np.shape(home[0]) != (dimension,):
        raise refuse(self, "home()", home, f"(pose, joints) with a pose ({', '.join(self.space.names)})")
    if np.ndim(home[1]) != 1:
        raise refuse(self, "home()", home, "(pose, joints) with all joints in one array")
    pose, joints = (value if hasattr(value, "dtype") else np.asarray(value, float) for value in home)
    return cast((pose, joints), float_dtype(self))


def checked_length(self: Any, length: Any) -> Any:
    """One number."""
    if not is_number(length):
        raise refuse(self, "length", length, "one positive number, the size of the robot")
    return cast(length, float_dtype(self))


def checked_residual(self: Any, equations: Any, joints: tuple[Any, ...], attachment: PyTree) -> Any:
    """As many equations as joints."""
    if not numbers(equations) or len(equations) != len(joints):
        expected = f"a tuple with one number per joint of the leg, {len(joints)} in all"
        raise refuse(self, "residual(joints, attachment)", equations, expected)
    return cast(tuple(equations), jnp.result_type(joints[0]))


def checked_start(self: Any, start: Any, attachment: PyTree) -> tuple[Any, Any]:
    """Joints and the signed reach."""
    pair = isinstance(start, (tuple, list)) and len(start) == 2
    if not pair or not numbers(start[0]):
        raise refuse(self, "start(attachment)", start, "(joints, reach): a tuple of numbers, and a number or None")
    joints, reach = start
    count = len(actuated_flags(self))
    if len(joints) != count:
        expected = f"one number per entry of {type(self).__name__}.actuated, {count} in all"
        raise refuse(self, "start(attachment)", start, expected)
    if reach is not None and not is_number(reach):
        raise refuse(self, "start(attachment)", start, "as reach None or a signed distance, not a truth value")
    return cast((tuple(joints), reach), _dtype(attachment))


def actuated_flags(leg: Any) -> tuple[bool, ...]:
    """Which joints of a leg are actuated, as its class says."""
    flags = getattr(leg, "actuated", None)
    if not isinstance(flags, tuple) or not flags or not all(isinstance(flag, bool) for flag in flags):
        raise refuse(leg, "actuated", flags, "a tuple with True or False for each joint of a leg, such as (True,)")
    return flags


def checked_margins(self: Any, margins: Any, joints: tuple[Any, ...], attachment: PyTree) -> Any:
    """One number per limit."""
    if not numbers(margins) or len(margins) != len(self.limits or margins):
        named = f"{len(self.limits)}, as many as limits has names" if self.limits else "one per limit"
        raise refuse(self, "margins(joints, attachment)", margins, f"a tuple of numbers, {named}")
    return cast(tuple(margins), jnp.result_type(joints[0]))


def checked_solutions(self: Any, solutions: Any, attachment: PyTree) -> Any:
    """All roots, and which are real."""
    if solutions is None:
        return None
    pair = isinstance(solutions, (tuple, list)) and len(solutions) == 2
    lists = pair and all(isinstance(part, (tuple, list)) for part in solutions)
    if not lists or len(solutions[0]) != len(solutions[1]) or not all(map(numbers, solutions[0])):
        expected = "(roots, real): a list of tuples of joints, and as many truth values"
        raise refuse(self, "solutions(attachment)", solutions, expected)
    if not all(is_number(real, flag=True) for real in solutions[1]):
        raise refuse(self, "solutions(attachment)", solutions[1], "truth values, which roots are real")
    return cast(tuple(solutions), _dtype(attachment))


def checked_circle(self: Any, circle: Any, joints: tuple[Any, ...]) -> Any:
    """A circle, if the leg knows one."""
    if circle is None:
        return None
    if not isinstance(circle, Circle) or not all(len(part.components) == 3 for part in circle):
        raise refuse(self, "circle(joints)", circle, "a robots.Circle of three vectors in space, or None")
    return cast(circle, jnp.result_type(joints[0]))


def checked_connections(self: Any, connections: Any, joints: tuple[Any, ...], attachment: PyTree) -> Any:
    """A list of connections."""
    if not isinstance(connections, (tuple, list)) or not all(isinstance(one, Connection) for one in connections):
        expected = "a list of robots.Connection, one for every place where two parts are held together"
        raise refuse(self, "connections(joints, attachment)", connections, expected)
    return cast(list(connections), jnp.result_type(joints[0]))


def _dtype(tree: PyTree) -> Any:
    return jnp.result_type(jax.tree.leaves(tree)[0])


ROBOT: Mapping[str, Check] = {
    "legs": checked_legs,
    "attachments": checked_attachments,
    "constraints": checked_constraints,
    "home": checked_home,
    "length": checked_length,
}
LEG: Mapping[str, Check] = {
    "residual": checked_residual,
    "start": checked_start,
    "margins": checked_margins,
    "constraints": checked_leg_constraints,
    "circle": checked_circle,
    "solutions": checked_solutions,
    "connections": checked_connections,
}
