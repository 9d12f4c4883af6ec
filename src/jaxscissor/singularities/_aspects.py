"""Aspects: the connected parts of a workspace without a singularity, and paths that stay inside one."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.numerics import Scalar
from jaxscissor._engine.pytree import pytree
from jaxscissor._engine.types import PoseLike, PyTree
from jaxscissor.kinematics._all_modes import forward_kinematics_all
from jaxscissor.kinematics._constraints import constrained_pose
from jaxscissor.kinematics._inverse import inverse_kinematics
from jaxscissor.regions._regions import Box
from jaxscissor.robots._contract import Mechanism
from jaxscissor.singularities._surface import fields

_HALVINGS = 4  # of a line between two cells, before it counts as blocked
_CHECKS = 20  # poses at which every straight piece of a path is verified


@pytree
class Aspects:
    """Partition of a box of poses into regions free of type-2 singularities, cell by cell.

    Attributes:
      labels: of the grid's shape, the number of each cell's region, the largest region 0; -1 where the centre is
        out of reach or too close to a singularity.
      sizes: ``(regions,)`` number of cells.
      signs: ``(regions,)`` of the type-2 measure.
      links: ``(m, 2)`` flat indices of neighbouring cells that are joined.
      box: the poses.
      min_type2: least magnitude of the measure that counts as clear.
    """

    labels: np.ndarray
    sizes: np.ndarray
    signs: np.ndarray
    links: np.ndarray
    box: Box
    min_type2: float

    def cell(self, pose: PoseLike) -> int:
        """Flat index of the cell of a pose ``(d,)``, -1 outside the box. Full turns of an angle make no difference."""
        low, span = np.asarray(self.box.low), np.asarray(self.box.high - self.box.low)
        offset, shape = np.asarray(pose) - low, np.array(self.labels.shape)
        offset = np.where(_full_turns(self.box), offset % (2 * math.pi), offset)
        if np.any((offset < 0) | (offset > span)):
            return -1
        places = np.minimum((offset / np.where(span > 0, span, 1) * shape).astype(int), shape - 1)
        return int(np.ravel_multi_index(tuple(places), self.labels.shape))

    def label(self, pose: PoseLike) -> int:
        """Number of the region of a pose's cell; -1 if it is in none."""
        cell = self.cell(pose)
        return -1 if cell < 0 else int(self.labels.ravel()[cell])


@pytree
class AspectPath:
    """A path between two poses, straight between its points in the coordinates of poses.

    Attributes:
      poses: ``(n, d)``, angles unwrapped; ``(0, d)`` if the poses are not in one region.
      worst: least magnitude of the type-2 measure at 20 poses of every piece; ``nan`` without a path.
      clear: whether it is within the workspace, of one sign and at least the min_type2 at each of them.
    """

    poses: np.ndarray
    worst: float
    clear: bool


@pytree
class CuspidalSearch:
    """Two assembly modes of the same joints that a path without singularity joins, or that none was found.

    Attributes:
      path: from one mode to the other; without poses if none was found.
      joints: ``(m,)`` the actuated joints at its ends; ``(0,)`` if none was found.
      tried: number of joint vectors tried.
      most: greatest number of assembly modes in reach that one of them had.
    """

    path: AspectPath
    joints: np.ndarray
    tried: int
    most: int

    @property
    def found(self) -> bool:
        """Whether there is such a path."""
        return self.path.clear


def aspects(robot: Mechanism, box: Box, shape: Sequence[int], *, min_type2: float = 0.0) -> Aspects:
    """Partition a box of poses into aspects: regions in reach, within all limits, without a type-2 singularity.

    Cells of a grid are joined to their neighbours, also across the ends of an angle whose range is a full turn,
    if the measure keeps its sign and the min_type2 at both centres, in the middle and on the parabola through the
    three; where that comes close to zero the line is halved, up to four times. Passages narrower than a cell are
    missed, and regions that touch only through them come out separate: a finer grid shows what holds.

    Args:
      robot: the robot, in its home working mode.
      box: of poses ``(d,)``; a coordinate whose two limits agree stays fixed.
      shape: cells along each coordinate.
      min_type2: poses whose type-2 measure is smaller than this in magnitude count as singular.

    Returns:
      ``singularities.Aspects``.

    Raises:
      ValueError: a box that is not one of the robot's poses, or a wrong shape.

    Example:
      In actuation mode 8 of NaVARo II the locus is alpha = 0 or pi, and a circle at any other alpha [NAV19 eq. 38]:

      >>> import math, jaxscissor as js
      >>> robot = js.NavaroII.prototype(8)
      >>> robot = js.NavaroII(robot.base, robot.platform, mode=8)  # no end of stroke
      >>> box = js.Box([-60.0, -60.0, -math.pi], [150.0, 150.0, math.pi])
      >>> found = js.singularities.aspects(robot, box, (16, 16, 8))
      >>> found.sizes.size, found.signs.sum()
      (4, np.int64(0))
    """
    if box.unit_dimension != robot.space.dimension:
        raise ValueError(
            f"Got a box of {box.unit_dimension} coordinates; {type(robot).__name__} expects {robot.space.names}."
        )
    centres = np.asarray(box.grid(shape))
    type2 = usable_type2(robot, centres)
    links = [_links(robot, box, shape, centres, type2, min_type2, axis) for axis in range(len(shape))]
    links = np.concatenate(links)
    from scipy.sparse.csgraph import connected_components  # importing it with the package would cost a tenth

    _, parts = connected_components(_graph(len(centres), links), directed=False)
    labels, sizes = _numbered(parts, _clear(type2, min_type2))
    _, first = np.unique(np.append(-1, labels), return_index=True)
    signs = np.sign(type2[first[1:] - 1]).astype(int)
    return Aspects(labels.reshape(tuple(shape)), sizes, signs, links, box, min_type2)


def aspect_path(robot: Mechanism, partition: Aspects, start: PoseLike, goal: PoseLike) -> AspectPath:
    """Path between two poses through the fewest cells of one aspect, verified densely.

    Args:
      robot: that was partitioned.
      partition: of ``singularities.aspects``.
      start, goal: ``(d,)`` poses.

    Returns:
      ``singularities.AspectPath``; ``clear`` is false too if the pieces to the poses from their cells' centres are not.

    Example:
      >>> import math, jaxscissor as js
      >>> robot, box = js.NavaroII.prototype(8), js.Box([45.0, 26.0, -math.pi], [45.0, 26.0, math.pi])
      >>> turns = js.singularities.aspects(robot, box, (1, 1, 64))  # alpha alone: singular at 0, out of reach at 2.4
      >>> js.singularities.aspect_path(robot, turns, [45.0, 26.0, 0.5], [45.0, 26.0, 1.5]).clear
      True
      >>> js.singularities.aspect_path(robot, turns, [45.0, 26.0, 0.5], [45.0, 26.0, -0.5]).clear
      False
    """
    start, goal = np.asarray(start, float), np.asarray(goal, float)
    label = partition.label(start)
    if label < 0 or label != partition.label(goal):
        return AspectPath(np.zeros((0, len(start))), math.nan, False)
    chain = _shortest(partition.labels.size, partition.links, partition.cell(start), partition.cell(goal))
    centres = np.asarray(partition.box.grid(partition.labels.shape))[chain]
    poses = np.stack([start, *centres, goal])
    turning = np.flatnonzero(_full_turns(partition.box))
    poses[:, turning] = np.unwrap(poses[:, turning], axis=0)
    values = usable_type2(robot, between(poses, _CHECKS)) * partition.signs[label]
    worst = float(np.min(values))
    return AspectPath(poses, worst, bool(worst >= partition.min_type2 and worst > 0))


def cuspidal_search(robot: Mechanism, partition: Aspects, *, tries: int = 500, seed: int = 0) -> CuspidalSearch:
    """Look for two assembly modes of the same actuated joints in one aspect: such a robot is called cuspidal.

    Joints of quasi-random poses of the box are put through ``forward_kinematics_all``. All poses considered are in
    the home working mode and within all limits, and so is the path that is found.

    Args:
      robot: that was partitioned.
      partition: of ``singularities.aspects``, with a min_type2 if the path is to keep away from singularities.
      tries: poses drawn; those out of reach are not tried.
      seed: shifts them.

    Returns:
      ``singularities.CuspidalSearch``. That none was found proves nothing.

    Example:
      >>> import math, jaxscissor as js
      >>> box = js.Box([0.0, 0.0, -math.pi], [90.0, 80.0, math.pi])
      >>> robot = js.NavaroII.prototype(8)
      >>> js.singularities.cuspidal_search(robot, js.singularities.aspects(robot, box, (8, 8, 8)), tries=16).found
      False
    """
    drawn = np.asarray(partition.box.quasi_random(tries, seed))
    reached = np.isfinite(usable_type2(robot, drawn))
    values, valid, joints = (np.asarray(part)[reached] for part in _same_joints(robot, jnp.asarray(drawn)))
    usable = np.isfinite(usable_type2(robot, values.reshape(-1, drawn.shape[1]))).reshape(valid.shape) & valid
    tried, most = len(joints), int(np.max(usable.sum(axis=1), initial=0))
    for poses, actuated in zip((v[u] for v, u in zip(values, usable, strict=True)), joints, strict=True):
        labels = [partition.label(pose) for pose in poses]
        for i, j in itertools.combinations(range(len(poses)), 2):
            if labels[i] == labels[j] >= 0:
                path = aspect_path(robot, partition, poses[i], poses[j])
                if path.clear:
                    return CuspidalSearch(path, actuated, tried, most)
    return CuspidalSearch(AspectPath(drawn[:0], math.nan, False), joints[:0, 0], tried, most)


def between(poses: np.ndarray, count: int) -> np.ndarray:
    """Poses ``(m, d)`` on straight lines between those given, ``count`` per line and the last pose."""
    share = np.arange(count)[None, :, None] / count
    lines = poses[:-1, None] * (1 - share) + poses[1:, None] * share
    return np.concatenate([lines.reshape(-1, poses.shape[1]), poses[-1:]])


def usable_type2(robot: Mechanism, poses: np.ndarray) -> np.ndarray:
    """Type-2 measure of poses ``(n, d)`` in the home mode within all limits, elsewhere ``nan``."""
    found = fields(robot, poses)
    return np.where(found.margin >= 0, found.type2, np.nan)


@jax.jit
def _same_joints(robot: Mechanism, poses: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Assembly modes, which are real, and the actuated joints, of each of the poses ``(n, d)``."""

    def modes(pose: jax.Array):
        joints = robot.actuated(inverse_kinematics(robot, constrained_pose(robot, pose).value).value)
        found = forward_kinematics_all(robot, joints)
        return found.values, found.valid, joints

    return jax.vmap(modes)(poses)


def _full_turns(box: Box) -> np.ndarray:
    """``(d,)``: which coordinates are angles that go all the way round."""
    span = np.asarray(box.high - box.low)
    return np.isclose(span, 2 * math.pi)


def _clear(type2: np.ndarray, min_type2: float) -> np.ndarray:
    return (np.abs(type2) >= min_type2) & (type2 != 0) & np.isfinite(type2)


def _links(
    robot: Mechanism,
    box: Box,
    shape: Sequence[int],
    centres: np.ndarray,
    type2: np.ndarray,
    min_type2: float,
    axis: int,
) -> np.ndarray:
    """``(m, 2)`` cells joined to their next neighbours along one axis of the grid."""
    cells = np.arange(len(centres)).reshape(tuple(shape))
    count = shape[axis] if _full_turns(box)[axis] else shape[axis] - 1
    first = np.take(cells, range(count), axis).ravel()
    second = np.take(cells, range(1, count + 1), axis, mode="wrap").ravel()
    ends = np.stack([first, second], axis=1)
    ends = ends[_clear(type2[ends], min_type2).all(axis=1) & (type2[first] * type2[second] > 0)]
    step = np.asarray(box.high - box.low)[axis] / shape[axis] * (np.arange(len(shape)) == axis)
    start, values = centres[ends[:, 0]], type2[ends]
    return ends[_keeps_clear(robot, start, start + step, values[:, 0], values[:, 1], min_type2, _HALVINGS)]


def _keeps_clear(
    robot: Mechanism,
    start: PyTree,
    end: np.ndarray,
    at_start: Scalar,
    at_end: Scalar,
    min_type2: float,
    halvings: int,
) -> np.ndarray:
    """``(n,)`` whether the measure keeps its sign and the min_type2 on lines between poses ``(n, d)``.

    Certain where the parabola through the values at the ends and in the middle stays farther from zero than it
    bends; other lines are halved, and refused when they have been halved often enough.
    """
    middle = (start + end) / 2
    at_middle, sign = usable_type2(robot, middle), np.sign(at_start)
    least = least_between(sign * at_start, sign * at_end, sign * at_middle)
    certain = least > np.abs((at_start + at_end) / 2 - at_middle)
    clear = (least > 0) & (least >= min_type2)
    open_ = np.flatnonzero(clear & ~certain)
    if not (len(open_) and halvings):
        return clear & certain
    starts, ends = np.concatenate([start[open_], middle[open_]]), np.concatenate([middle[open_], end[open_]])
    before, after = (
        np.concatenate([at[open_] for at in pair]) for pair in ((at_start, at_middle), (at_middle, at_end))
    )
    halves = _keeps_clear(robot, starts, ends, before, after, min_type2, halvings - 1)
    clear[open_] = halves.reshape(2, -1).all(axis=0)
    return clear


def least_between(start: np.ndarray, end: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Least value of the parabola through values at the ends and in the middle: negative between two crossings."""
    bend, slope = (start + end) / 2 - middle, (end - start) / 2
    inside = 2 * bend > np.abs(slope)
    dip = middle - slope**2 / (4 * np.where(inside, bend, 1))
    return np.where(inside, dip, np.minimum(np.minimum(start, end), middle))


def _numbered(parts: np.ndarray, clear: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Labels by falling size, -1 where not clear, and the sizes."""
    names, places, sizes = np.unique(parts[clear], return_inverse=True, return_counts=True)
    order = np.argsort(-sizes, kind="stable")
    rank = np.empty(len(names), int)
    rank[order] = np.arange(len(names))
    labels = np.full(len(parts), -1)
    labels[clear] = rank[places]
    return labels, sizes[order]


def _shortest(count: int, links: np.ndarray, start: int, goal: int) -> list[int]:
    """Nodes of a path of fewest links between two nodes of one component."""
    from scipy.sparse.csgraph import breadth_first_order

    _, previous = breadth_first_order(_graph(count, links), goal, directed=False)
    chain = [start]
    while chain[-1] != goal:
        chain.append(int(previous[chain[-1]]))
    return chain


def _graph(count: int, links: np.ndarray) -> Any:
    """The cells as nodes, joined by links ``(n, 2)``."""
    from scipy.sparse import csr_array

    return csr_array((np.ones(len(links)), links.T), (count, count))
