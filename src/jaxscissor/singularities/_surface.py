"""Singular surfaces: the type-2 locus in three coordinates of the pose, as triangles."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor.kinematics._constraints import constrained_pose
from jaxscissor.kinematics._feasibility import reached_margin
from jaxscissor.regions._regions import Box
from jaxscissor.robots._contract import Mechanism
from jaxscissor.singularities._measures import measures

_LANES = 8192  # poses evaluated together, whatever their number: one program per robot


def surface(robot: Mechanism, box: Box, shape: Sequence[int]) -> np.ndarray:
    """Triangles of the surface where the type-2 measure vanishes, as far as the robot reaches.

    The box is cut into cells and these into tetrahedra, in which the measure is interpolated linearly: a surface
    off by about the square of a cell, of which pieces smaller than a cell can be missed.

    Args:
      robot: the robot, in its home working mode; without limits of its stroke the surface has no edges there.
      box: of poses ``(d,)`` of which three coordinates vary.
      shape: cells along those three.

    Returns:
      ``(n, 3, 3)`` triangles, corner by corner, in the three coordinates.

    Raises:
      ValueError: not three coordinates that vary, or a wrong shape.

    Example:
      >>> import jaxscissor as js
      >>> box = js.Box([30.0, 10.0, -0.35], [60.0, 40.0, 0.4])
      >>> triangles = js.singularities.surface(js.NavaroII.prototype(8), box, (3, 3, 3))
      >>> triangles.shape[1:], bool(abs(triangles[..., 2]).max() < 0.05)  # the plane alpha = 0 [NAV19 eq. 38]
      ((3, 3), True)
    """
    low, high = np.asarray(box.low), np.asarray(box.high)
    moving = np.flatnonzero(high > low)
    if len(moving) != 3 or len(shape) != 3 or min(shape) < 1 or len(low) != robot.space.dimension:
        raise ValueError(
            f"Got a box in which {len(moving)} of {len(low)} coordinates vary, and shape {tuple(shape)}; expected "
            f"three that vary of {robot.space.names}, and three positive counts."
        )
    nodes = np.stack(
        np.meshgrid(*(np.linspace(low[i], high[i], n + 1) for i, n in zip(moving, shape, strict=True)), indexing="ij"),
        axis=-1,
    )
    poses = np.broadcast_to(low, (*nodes.shape[:-1], len(low))).copy()
    poses[..., moving] = nodes
    found = jax.tree.map(lambda field: field.reshape(nodes.shape[:-1]), fields(robot, poses.reshape(-1, len(low))))
    triangles, margins = _zero_level(nodes, found.type2, found.margin)
    return triangles[margins.mean(axis=1) >= 0]


class Fields(NamedTuple):
    """What pictures and partitions ask of poses ``(n, d)``: measures, ``nan`` outside the home mode, and margin."""

    type2: Any
    type1: Any  # least magnitude of the legs'
    margin: Any


def fields(robot: Mechanism, poses: np.ndarray) -> Fields:
    """Measures and feasibility margin of poses ``(n, d)``."""
    padded = np.concatenate([poses, np.broadcast_to(poses[:1], (-len(poses) % _LANES, poses.shape[1]))])
    parts = [_fields(robot, jnp.asarray(part)) for part in padded.reshape(-1, _LANES, poses.shape[1])]
    empty = Fields(*[poses[:0, 0]] * 3)
    return jax.tree.map(lambda *column: np.concatenate(column)[: len(poses)], empty, *parts)


@jax.jit
def _fields(robot: Mechanism, poses: jax.Array) -> Fields:
    def each(pose: jax.Array):
        found = measures(robot, constrained_pose(robot, pose).value)
        return Fields(found.type2, jnp.min(jnp.abs(found.type1)), reached_margin(robot, pose))

    return jax.vmap(each)(poses)


def _zero_level(nodes: np.ndarray, values: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles ``(n, 3, 3)`` where values vanish on a grid, and what another quantity is at their corners."""
    corners = np.concatenate([nodes, other[..., None], values[..., None]], axis=-1)
    triangles = [
        triangle
        for order in itertools.permutations(range(3))
        for triangle in _in_tetrahedra(_tetrahedra(corners, order))
    ]
    found = np.concatenate(triangles)
    return found[..., :3], found[..., 3]


def _tetrahedra(corners: np.ndarray, order: Sequence[int]) -> np.ndarray:
    """One tetrahedron of every cell, ``(cells, 4, quantities)``: along the edges in this order to the far corner."""
    shift, steps = [0, 0, 0], []
    for axis in (None, *order):
        if axis is not None:
            shift[axis] = 1
        steps.append(corners[tuple(slice(s, n - 1 + s) for s, n in zip(shift, corners.shape[:3], strict=True))])
    return np.stack([step.reshape(-1, corners.shape[-1]) for step in steps], axis=1)


def _in_tetrahedra(corners: np.ndarray) -> list[np.ndarray]:
    """Triangles ``(n, 3, quantities)``; the last quantity is the one that vanishes there."""
    corners = corners[np.isfinite(corners[..., -1]).all(axis=1)]
    corners = np.take_along_axis(corners, np.argsort(corners[..., -1], axis=1)[..., None], axis=1)
    below = np.sum(corners[..., -1] < 0, axis=1)
    cut = {1: [(0, 1, 0, 2, 0, 3)], 3: [(0, 3, 1, 3, 2, 3)], 2: [(0, 2, 0, 3, 1, 3), (0, 2, 1, 3, 1, 2)]}
    triangles = []
    for count, pieces in cut.items():
        chosen = corners[below == count]
        for a, b, c, d, e, f in pieces:
            low, high = chosen[:, [a, c, e]], chosen[:, [b, d, f]]
            share = low[..., -1:] / (low[..., -1:] - high[..., -1:])
            triangles.append(low + share * (high - low))
    return triangles
