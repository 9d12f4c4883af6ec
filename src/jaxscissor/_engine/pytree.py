"""Dataclasses that are JAX pytrees, validated when built by hand and never when rebuilt by JAX."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar, TypeVarTuple, dataclass_transform

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxscissor._engine.types import PyTree

T = TypeVar("T")

Trees = TypeVarTuple("Trees")


def static(**kwargs: Any) -> Any:
    """Declare a dataclass field that is part of the pytree's structure, not one of its leaves.

    Example:
      >>> @pytree
      ... class Rod:
      ...     length: float
      ...     name: str = static(default="rod")
      >>> jax.tree.leaves(Rod(2.0))
      [2.0]
    """
    return dataclasses.field(metadata={"static": True}, **kwargs)


def quantity(unit: str, **kwargs: Any) -> Any:
    """Declare an array field with its unit, which the printed table of a robot shows.

    Example:
      >>> @pytree
      ... class Rod:
      ...     length: jax.Array = quantity("m")
      >>> dataclasses.fields(Rod)[0].metadata["unit"]
      'm'
    """
    return dataclasses.field(metadata={"unit": unit}, **kwargs)


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(static, quantity))
def pytree(cls: type[T]) -> type[T]:
    """Make a class a frozen dataclass whose fields are pytree children.

    JAX rebuilds pytrees with tracers, gradients (which may be negative) and placeholders inside, so
    rebuilding skips ``__init__`` and with it every check of the values.

    Example:
      >>> @pytree
      ... class Link:
      ...     length: jax.Array
      >>> jax.tree.leaves(Link(jnp.float32(2.0)))
      [Array(2., dtype=float32)]
    """
    plain = cls.__repr__ is object.__repr__
    cls = dataclasses.dataclass(frozen=True, eq=False, repr=plain)(cls)
    fields = dataclasses.fields(cls)  # type: ignore[arg-type]
    children = tuple(f.name for f in fields if not f.metadata.get("static"))
    constants = tuple(f.name for f in fields if f.metadata.get("static"))

    def flatten(self):
        return [getattr(self, n) for n in children], tuple(getattr(self, n) for n in constants)

    def flatten_with_keys(self):
        values, aux = flatten(self)
        return [(jax.tree_util.GetAttrKey(n), v) for n, v in zip(children, values, strict=True)], aux

    def unflatten(aux: PyTree, values: PyTree):
        return unchecked(cls, **dict(zip(children, values, strict=True)), **dict(zip(constants, aux, strict=True)))

    jax.tree_util.register_pytree_with_keys(cls, flatten_with_keys, unflatten, flatten)
    return cls


def unchecked(cls: type[T], **values: Any) -> T:
    """Build a dataclass without its ``__init__``, from values that are right by construction."""
    self = object.__new__(cls)
    for name, value in values.items():
        object.__setattr__(self, name, value)
    return self


def with_fields(tree: T, values: dict[str, Any]) -> T:
    """Copy of a dataclass pytree with other values in some array fields, broadcast to the shapes there.

    Raises:
      ValueError: a name that is no array field, or a value that does not broadcast.
    """
    fields = dataclasses.fields(tree)  # type: ignore[arg-type]
    arrays = [f.name for f in fields if not f.metadata.get("static")]
    content = {f.name: getattr(tree, f.name) for f in fields}
    for name, value in values.items():
        if name not in arrays:
            raise ValueError(f"Got {name!r}; expected one of the dimensions of {type(tree).__name__}: {arrays}.")
        content[name] = broadcast(name, jnp.asarray(value, float_dtype(tree)), content[name].shape)
    return unchecked(type(tree), **content)


def broadcast(name: str, value: jax.Array, shape: tuple[int, ...]) -> jax.Array:
    """The array in a shape.

    Raises:
      ValueError: naming it, if it does not broadcast.
    """
    try:
        return jnp.broadcast_to(value, shape)
    except ValueError as error:
        raise ValueError(f"Got {name} of shape {value.shape}; expected one that broadcasts to {shape}.") from error


def is_concrete(tree: PyTree) -> bool:
    """Whether every leaf holds numbers that can be looked at, as opposed to tracers or placeholders."""
    return all(isinstance(leaf, jax.Array) and not isinstance(leaf, Tracer) for leaf in jax.tree.leaves(tree))


def float_dtype(*values: Any) -> Any:
    """The widest floating dtype among arrays; integers and Python numbers follow, alone they give the default."""
    arrays = [leaf for leaf in jax.tree.leaves(values) if hasattr(leaf, "dtype")]
    dtypes = [jnp.result_type(leaf) for leaf in arrays if not getattr(leaf, "weak_type", False)]
    floats = [dtype for dtype in dtypes if jnp.issubdtype(dtype, jnp.floating)]
    return max(floats, key=lambda dtype: dtype.itemsize) if floats else jnp.result_type(float)


def as_floats(*trees: *Trees) -> tuple[*Trees]:
    """Convert every leaf of the trees to one common floating dtype."""
    dtype = float_dtype(*trees)
    return tuple(jax.tree.map(lambda leaf: _array(leaf, dtype), tree) for tree in trees)  # pyright: ignore[reportReturnType]


def as_arrays(*values: Any) -> tuple[jax.Array, ...]:
    """Convert numbers, arrays and rows of them to arrays of one common floating dtype."""
    dtype = float_dtype(*values)
    return tuple(_array(value, dtype) for value in values)


def refuse_unregistered(leaf: Any) -> None:
    """Raise if a leaf is an object whose class JAX does not know.

    Raises:
      ValueError: naming the class.
    """
    if dataclasses.is_dataclass(leaf):
        raise ValueError(
            f"Got a {type(leaf).__name__}, whose class is no pytree; put @jaxscissor.pytree above it, also if it "
            "inherits from a class that has it."
        )


def _array(value: Any, dtype: jax.typing.DTypeLike) -> jax.Array:
    """The value as an array of a dtype; of numbers by NumPy, which compiles nothing."""
    refuse_unregistered(value)
    if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(value)):
        return jnp.asarray(value, dtype)
    return jnp.asarray(np.asarray(value, dtype), dtype)
