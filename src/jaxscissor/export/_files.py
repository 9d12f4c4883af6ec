"""A robot as a JSON file, which holds numbers and names and never code."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Iterable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxscissor import robots
from jaxscissor._engine.pytree import unchecked
from jaxscissor._engine.types import PyTree
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._contract import Mechanism
from jaxscissor.robots._spaces import SE2, SE3

_FORMAT, _VERSION = "jaxscissor", 1
_DTYPES = ("bool", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64")
_DTYPES += ("bfloat16", "float16", "float32", "float64")


def save(robot: Mechanism, path: str | os.PathLike[str]) -> None:
    """Write a robot to a JSON file, from which ``load`` makes the same robot to the last bit.

    Args:
      robot: the robot: a ``pytree`` of arrays, numbers, texts, vectors and other such pytrees.
      path: of the file, which is replaced.

    Raises:
      ValueError: something in the robot that is none of these, by its name; a robot that is being traced.

    Example:
      >>> import jaxscissor as js, os, tempfile
      >>> path = os.path.join(tempfile.mkdtemp(), "robot.json")
      >>> js.export.save(js.NavaroII.prototype(mode=6), path)
      >>> js.export.load(path).mode
      6
    """
    state = {"format": _FORMAT, "version": _VERSION, "robot": _written(robot, type(robot).__name__)}
    text = json.dumps(state, indent=2, allow_nan=False)
    with open(path, "w", encoding="utf-8") as file:
        file.write(text + "\n")


def load(path: str | os.PathLike[str], classes: Iterable[type] = ()) -> Any:
    """Read a robot that ``save`` wrote.

    The file's classes are looked up by name among the library's robots and those given; nothing else is made, imported
    or run. The numbers are taken as they are, ``nan`` included: ``js.check_robot`` says whether they make a robot.

    Args:
      path: of the file.
      classes: your own classes of which the robot consists, which go before the library's of the same name.

    Returns:
      The robot: same classes, static fields, shapes, dtypes and bits.

    Raises:
      ValueError: another or a damaged file; a class that is not known; fields that are not the class's; an array of 64
        bits where JAX is set to 32.

    Example:
      >>> import jaxscissor as js, os, tempfile
      >>> path = os.path.join(tempfile.mkdtemp(), "robot.json")
      >>> js.export.save(js.StewartGough.prototype(), path)
      >>> js.export.load(path).base.shape
      (6, 3)
    """
    with open(path, encoding="utf-8") as file:
        text = file.read()
    name = os.fspath(path)
    try:
        state = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f"Got {name!r}, which is no JSON file: {error}.") from error
    if not isinstance(state, dict) or (state.get("format"), state.get("version")) != (_FORMAT, _VERSION):
        raise ValueError(f"Got {name!r}; expected a file of format {_FORMAT!r} {_VERSION}, that js.export.save wrote.")
    own = [getattr(robots, name) for name in robots.__all__]
    own = [cls for cls in own if isinstance(cls, type) and dataclasses.is_dataclass(cls)]
    known = {**_by_name([*own, Vec, Rotation]), **_by_name(classes)}
    try:
        return _read(state.get("robot"), known)
    except (TypeError, KeyError, AttributeError, OverflowError) as error:
        raise ValueError(f"Got {name!r}, a damaged file: {error}.") from error


def _by_name(classes: Iterable[Any]) -> Mapping[str, Any]:
    named: dict[str, Any] = {}
    for cls in classes:
        name = getattr(cls, "__name__", None)
        if cls not in (Vec, Rotation) and not dataclasses.is_dataclass(cls):
            raise ValueError(f"Got classes with {cls!r}; expected classes with @jaxscissor.pytree.")
        if named.setdefault(str(name), cls) is not cls:
            raise ValueError(f"Got two classes of the name {name}; a file knows them by their names alone.")
    return named


def _written(value: Any, name: str) -> Any:
    """A value as JSON; what JSON does not know is an object that says what it is."""
    if value is None or type(value) in (bool, int, str):
        return value
    if type(value) is float:
        return value if math.isfinite(value) else {"float": str(value)}
    if isinstance(value, Tracer):
        raise ValueError(f"Got {name} while it is being traced. A file holds numbers: save outside jit, vmap and grad.")
    if isinstance(value, (jax.Array, np.ndarray, np.generic)) and np.dtype(value.dtype).name in _DTYPES:
        array = np.asarray(value)
        return {"dtype": array.dtype.name, "shape": list(array.shape), "values": _numbers(array)}
    if isinstance(value, tuple | list) and type(value) in (tuple, list):
        return {type(value).__name__: [_written(part, f"{name}[{i}]") for i, part in enumerate(value)]}
    if type(value) is dict and all(type(key) is str for key in value):
        return {"dict": {key: _written(part, f"{name}[{key!r}]") for key, part in value.items()}}
    if isinstance(value, type) and value in (SE2, SE3):
        return {"space": value.__name__}
    cls = type(value)
    if isinstance(value, Vec | Rotation):
        parts = value.components if isinstance(value, Vec) else value.columns
        return {"class": cls.__name__, "parts": [_written(part, f"{name}[{i}]") for i, part in enumerate(parts)]}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        names = [field.name for field in dataclasses.fields(value)]
        return {"class": cls.__name__, "fields": {n: _written(getattr(value, n), f"{name}.{n}") for n in names}}
    raise ValueError(
        f"Got {name} of type {cls.__name__}, which no file can hold; expected arrays, numbers, texts, tuples, vectors "
        "and classes with @jaxscissor.pytree."
    )


def _numbers(array: np.ndarray) -> list[Any]:
    """All entries in order; Python writes a number so that it reads back as the same bits."""
    flat = array.ravel()
    if array.dtype.kind in "biu":
        return flat.tolist()
    return [value if math.isfinite(value) else str(value) for value in map(float, flat)]


def _read(value: Any, classes: Mapping[str, Any]) -> Any:
    if not isinstance(value, dict):
        return value
    kind = tuple(sorted(value))
    if kind == ("dtype", "shape", "values"):
        return _array(value)
    if kind == ("class", "fields"):
        return _object(value, classes)
    if kind == ("class", "parts") and value["class"] in ("Vec", "Rotation"):
        return classes[value["class"]](*(_read(part, classes) for part in value["parts"]))
    readers = {
        ("float",): lambda part: float(part),
        ("space",): lambda part: {space.__name__: space for space in (SE2, SE3)}[part],
        ("tuple",): lambda part: tuple(_read(x, classes) for x in part),
        ("list",): lambda part: [_read(x, classes) for x in part],
        ("dict",): lambda part: {key: _read(x, classes) for key, x in part.items()},
    }
    if kind not in readers:
        raise ValueError(
            f"Got an entry of {', '.join(map(repr, kind)) or 'nothing'}; expected what js.export.save writes."
        )
    return readers[kind](value[kind[0]])


def _array(value: Mapping[str, Any]) -> jax.Array:
    name, shape, values = value["dtype"], tuple(value["shape"]), value["values"]
    if name not in _DTYPES:
        raise ValueError(f"Got an array of dtype {name!r}; expected one of {', '.join(_DTYPES)}.")
    dtype = jnp.dtype(name)
    if jax.dtypes.canonicalize_dtype(dtype) != dtype:
        raise ValueError(
            f"Got an array of {name}, which JAX is set not to hold; call jax.config.update('jax_enable_x64', True) "
            "before loading."
        )
    if math.prod(shape) != len(values):
        raise ValueError(f"Got {len(values)} numbers for an array of shape {shape}.")
    numbers = values if dtype.kind in "biu" else [float(x) for x in values]
    return jnp.asarray(np.array(numbers, np.float64 if dtype.kind not in "biu" else dtype).astype(dtype).reshape(shape))


def _object(value: Mapping[str, Any], classes: Mapping[str, Any]) -> PyTree:
    name, fields = value["class"], value["fields"]
    cls = classes.get(name)
    if cls is None:
        raise ValueError(
            f"Got a robot with a {name!r}; known are {', '.join(classes)}. Pass your own: js.export.load(path, "
            f"classes=[{name}])."
        )
    expected = {field.name for field in dataclasses.fields(cls)}
    if set(fields) != expected:
        raise ValueError(f"Got a {name} with the fields {sorted(fields)}; expected {sorted(expected)}.")
    return unchecked(cls, **{field: _read(part, classes) for field, part in fields.items()})
