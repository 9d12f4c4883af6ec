"""Pictures of singular loci, in a slice of the workspace and as surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxscissor._engine.types import PoseLike
from jaxscissor.plot._slices import Slice, label, label_slice, new_axes, slice_of
from jaxscissor.regions._regions import Box
from jaxscissor.robots._contract import Mechanism
from jaxscissor.singularities._surface import fields
from jaxscissor.singularities._surface import surface as surface_triangles

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def singularity_map(
    robot: Mechanism,
    pose: PoseLike,
    axes: tuple[str, str] = ("x", "y"),
    *,
    low: Sequence[float],
    high: Sequence[float],
    resolution: int = 200,
    ax: Axes | None = None,
    unit: str = "m",
) -> Axes:
    """Singular loci in a slice of the workspace, where two pose coordinates vary.

    Args:
      robot: the robot.
      pose: ``(d,)``, gives the other coordinates.
      axes: names of the two coordinates.
      low, high: ``(2,)`` range of each.
      resolution: points along each axis.
      ax: axes to draw on; default: new ones.
      unit: of length, for the labels.

    Returns:
      The axes: the workspace grey with a thin edge; the type-2 locus a thick line, thin lines where the measure is
      +-0.05 (dashed below zero); dots on the edge where it is a type-1 locus, which the home mode cannot cross.

    Raises:
      ValueError: an unknown coordinate or a wrong shape of the pose.
    """
    robot, slice_ = slice_of(robot, pose, axes, low, high, resolution)
    type2, _, margins = (field.reshape(slice_.shape) for field in fields(robot, slice_.poses))
    type2 = np.ma.masked_where(~((margins >= 0) & np.isfinite(type2)), type2)
    ax = new_axes(ax, spatial=False)
    ax.contourf(slice_.xs, slice_.ys, margins, levels=[0, np.inf], colors=["0.88"])
    ax.contour(slice_.xs, slice_.ys, margins, levels=[0], colors="0.5", linewidths=0.8)
    if np.ma.count(type2):
        for levels, width in (([-0.05, 0.05], 0.6), ([0], 2)):
            crossed = [level for level in levels if type2.min() < level < type2.max()]
            if crossed:
                ax.contour(slice_.xs, slice_.ys, type2, levels=crossed, colors="black", linewidths=width)
    folds = _folds(robot, slice_, margins)
    ax.plot(*folds.T, "o", color="black", markersize=3)
    label_slice(ax, robot, axes, unit)
    return ax


def _folds(robot: Mechanism, slice_: Slice, margins: np.ndarray) -> np.ndarray:
    """Points ``(n, 2)`` of the workspace's edge where a leg is at a type-1 singularity, bisected to rounding."""
    grid, inside = slice_.poses.reshape(*slice_.shape, -1), margins >= 0
    ends = []
    for first, second in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        crossing = inside[first] != inside[second]
        pair = np.stack([grid[first][crossing], grid[second][crossing]])
        ends.append(np.where(inside[first][crossing][:, None], pair, pair[::-1]))
    reached, lost = np.concatenate(ends, axis=1)
    if not len(reached):
        return np.zeros((0, 2))
    for _ in range(np.finfo(reached.dtype).nmant * 3 // 4):
        middle = (reached + lost) / 2
        good = (fields(robot, middle).margin >= 0)[:, None]
        reached, lost = np.where(good, middle, reached), np.where(good, lost, middle)
    return reached[fields(robot, reached).type1 < np.finfo(reached.dtype).eps ** 0.25][:, slice_.places]


def surface(
    robot: Mechanism,
    box: Box,
    *,
    shape: Sequence[int] = (24, 24, 24),
    ax: Axes | None = None,
    unit: str = "m",
    color: Any = "0.9",
) -> Axes:
    """The type-2 locus as a surface over three coordinates of the pose, within the workspace.

    Args:
      robot: the robot.
      box: of poses of which three coordinates vary.
      shape: cells along those three.
      ax: three-dimensional axes to draw on; default: new ones.
      unit: of length, for the labels.
      color: of the surface in full light.

    Returns:
      The axes; angles count in radians.

    Raises:
      ValueError: see ``js.singularities.surface``.
    """
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    triangles = surface_triangles(robot, box, shape)
    low, high = np.asarray(box.low), np.asarray(box.high)
    ax = new_axes(ax, spatial=True)
    if len(triangles):
        shades = _lit(triangles / (high - low)[high > low], color)
        ax.add_collection3d(Poly3DCollection(triangles, facecolors=shades, edgecolors=shades, linewidths=0.2))  # pyright: ignore[reportAttributeAccessIssue]
    for number, axis in zip(np.flatnonzero(high > low), "xyz", strict=True):
        getattr(ax, f"set_{axis}lim")(low[number], high[number])
        getattr(ax, f"set_{axis}label")(label(robot, robot.space.names[number], unit))
    return ax


def _lit(triangles: np.ndarray, color: Any) -> np.ndarray:
    """Colors ``(n, 3)`` of triangles in a light from above on both of their sides."""
    from matplotlib.colors import to_rgb

    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    sizes = np.linalg.norm(normals, axis=1, keepdims=True)
    light = np.abs(normals / np.where(sizes > 0, sizes, 1) @ np.array([0.36, -0.48, 0.8]))
    return np.array(to_rgb(color)) * (0.45 + 0.55 * light[:, None])
