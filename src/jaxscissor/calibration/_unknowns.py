"""What is calibrated: dimensions of the robot, zeros of the joint sensors and numbers of the measure, by name."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.pytree import broadcast, with_fields
from jaxscissor._engine.types import Numbers, PyTree
from jaxscissor.robots._per_leg import PerLeg


class Nominal(NamedTuple):
    """Everything that may be calibrated, as it is known beforehand."""

    robot: Any
    offsets: jax.Array  # added to the readings of the actuated joints
    measure: tuple[Any, ...]  # the measure, if it holds numbers


class Unknowns(NamedTuple):
    """The dimensions that are calibrated, and how they are known beforehand."""

    names: tuple[str, ...]
    places: np.ndarray  # among the numbers of ``Nominal``, leaf after leaf
    prior: np.ndarray  # standard deviations

    def applied(self, nominal: Nominal, changes: np.ndarray) -> Nominal:
        """What is known beforehand with changes of the dimensions; no program is made for it."""
        leaves, structure = jax.tree.flatten(nominal)
        flat = np.concatenate([np.ravel(np.asarray(leaf)) for leaf in leaves])
        flat[self.places] += changes
        parts = np.split(flat, np.cumsum([np.size(leaf) for leaf in leaves])[:-1])
        moved = [jnp.asarray(part.reshape(np.shape(leaf))) for part, leaf in zip(parts, leaves, strict=True)]
        return jax.tree.unflatten(structure, moved)


def unknowns_of(nominal: Nominal, prior: PyTree, offsets: Numbers) -> Unknowns:
    """The dimensions with a standard deviation above zero that are finite.

    Args:
      prior: standard deviations: of fields of the robot or of the measure by name, or a container like the robot
        (of a robot made by ``per_leg`` also like its copies), or one number for all dimensions of the robot.
      offsets: standard deviations of the sensors' zeros, ``(m,)`` or one for all.

    Raises:
      ValueError: a name of no field, a container of another structure, shapes that do not broadcast, a negative
        standard deviation, or nothing to calibrate.
    """
    zeros = jax.tree.map(np.zeros_like, nominal)
    robot, measure = _deviations(zeros, prior)
    spread = broadcast("offsets", jnp.asarray(offsets, nominal.offsets.dtype), nominal.offsets.shape)
    pairs = jax.tree.leaves(jax.tree.map(_wide, Nominal(robot, spread, measure), nominal))
    deviations = np.concatenate([np.ravel(pair) for pair in pairs]).astype(float)
    values = np.concatenate([np.ravel(np.asarray(leaf)) for leaf in jax.tree.leaves(nominal)])
    if not np.all(deviations >= 0):
        raise ValueError("Got a prior standard deviation that is negative or nan; expected zero (exact) or more.")
    places = np.flatnonzero((deviations > 0) & np.isfinite(values))
    if not len(places):
        raise ValueError(
            "Got nothing to calibrate: give prior standard deviations above zero, such as prior={'top_radius': 1e-3} "
            "or offsets=1e-3."
        )
    names = _names(nominal)
    return Unknowns(tuple(names[i] for i in places), places.astype(np.int32), deviations[places])


def _wide(value: Any, like: Any) -> np.ndarray:
    return np.asarray(broadcast("a prior", jnp.asarray(value), np.shape(like)))


def _deviations(zeros: Nominal, prior: PyTree) -> tuple[Any, tuple[Any, ...]]:
    """Standard deviations of the robot's dimensions and of the measure's, in containers like them."""
    robot, measure = zeros.robot, zeros.measure
    copies = robot.copies if isinstance(robot, PerLeg) else robot
    if prior is None:
        return robot, measure
    if isinstance(prior, Mapping):
        of_measure = {name for name in prior if measure and name in _fields(measure[0]) and name not in _fields(copies)}
        given = with_fields(copies, {name: value for name, value in prior.items() if name not in of_measure})
        if of_measure:
            measure = (with_fields(measure[0], {name: prior[name] for name in of_measure}),)
    elif jax.tree_util.all_leaves([prior]) and np.ndim(prior) == 0:
        given = jax.tree.map(lambda leaf: np.full_like(leaf, prior), copies)
    elif jax.tree.structure(prior) == jax.tree.structure(robot):
        return prior, measure
    elif jax.tree.structure(prior) == jax.tree.structure(copies):
        given = prior
    else:
        raise ValueError(
            f"Got a prior of structure {jax.tree.structure(prior)}; expected names with standard deviations, a "
            "container like the robot, such as design.tolerances gives for a robot made by per_leg, or one number."
        )
    return (PerLeg(given) if isinstance(robot, PerLeg) else given), measure


def _fields(tree: Any) -> list[str]:
    """Names of what holds numbers in a dataclass; of other containers none."""
    fields = dataclasses.fields(tree) if dataclasses.is_dataclass(tree) else ()
    return [field.name for field in fields if not field.metadata.get("static")]


def _names(nominal: Nominal) -> list[str]:
    """A name for every number: ``link_lengths[1] of leg 2``, ``offsets[0]``, ``frame[5]``."""
    names = []
    for path, leaf in jax.tree_util.tree_flatten_with_path(nominal)[0]:
        keys = [key for key in path if not isinstance(key, jax.tree_util.SequenceKey)]
        of_robot = isinstance(nominal.robot, PerLeg) and keys[0] == jax.tree_util.GetAttrKey("robot")
        inner = keys[1 + of_robot :] if len(keys) > 1 else keys
        stem = jax.tree_util.keystr(tuple(inner), simple=True, separator=".")
        for index in np.ndindex(np.shape(leaf)):
            rest = index[1:] if of_robot else index
            place = f"[{', '.join(map(str, rest))}]" if rest else ""
            names.append(f"{stem}{place}" + (f" of leg {index[0] + 1}" if of_robot else ""))
    return names
