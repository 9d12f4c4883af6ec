"""Matplotlib pictures: a robot in a pose, its workspace and singularities, the course of an optimization."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._legs import place
from jaxscissor._numerics import default_tol
from jaxscissor._singularity_pictures import singular_surface as singular_surface
from jaxscissor._singularity_pictures import singularity_map as singularity_map
from jaxscissor._slices import label_slice, margins_of, new_axes, slice_of
from jaxscissor._vectors import Vec
from jaxscissor.constraints import constrained_pose
from jaxscissor.design import DesignResult
from jaxscissor.kinematics import inverse_kinematics
from jaxscissor.mechanisms._contract import Mechanism, checked_joints, checked_pose, split_joints

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.axes import Axes

_LEG_COLORS = ("#1b2a49", "#2f7f93", "#c98a1b", "#7a3b69", "#4f8a4f", "#a05a4a")
_RAIL_COLOR = "#c2c2c2"


def robot(robot: Mechanism, pose: Any = None, *, joints: Any = None, ax: Any = None, unit: str = "m") -> Axes:
    """Draw a robot: its legs' bars in color, its platform black, base and strokes grey, sliders as squares.

    A planar robot is drawn in the plane, with upright scissors laid down beside their legs; on
    three-dimensional axes they stand up.

    Args:
      robot: the robot.
      pose: ``(d,)``; default: home.
      joints: ``(n,)``; default: by inverse kinematics, or at home.
      ax: axes to draw on, three-dimensional for spatial robots; default: new ones.
      unit: of length, for the labels.

    Returns:
      The axes.

    Raises:
      ValueError: wrong shapes, flat axes for a spatial robot, or a pose that the home mode does not reach
        while no joints are given.
    """
    home_pose, home_joints = robot.home()
    if pose is None:
        pose, joints = home_pose, home_joints if joints is None else joints
    robot, pose = checked_pose(robot, pose)
    if joints is None:
        pose = constrained_pose(robot, pose).value
        solution = inverse_kinematics(robot, pose)
        if not bool(solution.converged):
            raise ValueError(f"The home mode does not reach the pose {pose}; give joints to draw another mode.")
        joints = solution.value
    drawing = jax.tree.map(np.asarray, _drawing(robot, pose, checked_joints(robot, joints)))
    ax = new_axes(ax, spatial=robot.space.translations == 3)
    size = 3 if ax.name == "3d" else 2
    if size < robot.space.translations:
        raise ValueError('Got flat axes for a spatial robot; expected axes of add_subplot(projection="3d").')
    for number, (rails, bars) in enumerate(zip(drawing.rails, drawing.bars, strict=True)):
        color = _LEG_COLORS[number % len(_LEG_COLORS)]
        rails, bars = _fitted(rails, size), _fitted(bars, size)
        _segments(ax, rails, color=_RAIL_COLOR, linewidth=3, solid_capstyle="round", zorder=1)
        _segments(ax, bars, color=color, linewidth=1.6, marker="o", markersize=2.5)
        _segments(ax, _on_rails(bars, rails)[:, None], color=color, marker="s", markersize=5)
    feet = np.array([rails[0][0] for rails in drawing.rails if len(rails)])
    outlines = [(feet, dict(color=_RAIL_COLOR, linewidth=1.2, markersize=5, zorder=1))]
    outlines += [(drawing.points, dict(color="black", linewidth=3, markersize=4, solid_joinstyle="round"))]
    for points, style in outlines:
        if len(points):
            closed = np.array([*points, points[0]])
            _segments(ax, _fitted(closed[None], size), marker="o", **style)
    _finish(ax, "xyz"[:size], unit)
    return ax


def animate(
    robot: Mechanism, poses: Any, *, joints: Any = None, ax: Any = None, unit: str = "m", interval: float = 40.0
) -> FuncAnimation:
    """Move a robot along a path, a pose per frame, within the limits that hold all of them.

    Args:
      robot: the robot.
      poses: ``(n, d)`` poses, in order.
      joints: ``(n, joints)``; default: by inverse kinematics.
      ax: axes to draw on, three-dimensional for spatial robots; default: new ones.
      unit: of length, for the labels.
      interval: milliseconds between two frames.

    Returns:
      The animation: ``.save("path.gif")``, or ``.to_jshtml()`` in a notebook. Keep a reference while it plays.

    Raises:
      ValueError: wrong shapes, no poses, or a pose that the home mode does not reach while no joints are given.
    """
    from matplotlib.animation import FuncAnimation

    poses = jnp.asarray(poses)
    if poses.ndim != 2 or not len(poses) or (joints is not None and len(joints) != len(poses)):
        raise ValueError(f"Got poses of shape {poses.shape}; expected (n, d), at least one, and as many joints if any.")
    ax = new_axes(ax, spatial=robot.space.translations == 3)
    names = "xyz" if ax.name == "3d" else "xy"

    def draw(number):
        ax.clear()
        _picture(robot, poses[number], joints=None if joints is None else joints[number], ax=ax, unit=unit)
        return [getattr(ax, f"get_{name}lim")() for name in names]

    limits = np.array([draw(number) for number in range(len(poses))])
    lows, highs = limits[..., 0].min(axis=0), limits[..., 1].max(axis=0)

    def frame(number):
        draw(number)
        for name, low, high in zip(names, lows, highs, strict=True):
            getattr(ax, f"set_{name}lim")(low, high)
        ax.set_aspect("equal")
        return ax.lines

    return FuncAnimation(ax.figure, frame, frames=len(poses), interval=interval)


_picture = robot  # a function that takes a robot of this name


class _Drawing(NamedTuple):
    rails: list[jax.Array]  # per leg (segments, 2, d)
    bars: list[jax.Array]
    points: jax.Array  # (corners of the platform, d)


@jax.jit
def _drawing(robot: Mechanism, pose: jax.Array, joints: jax.Array) -> _Drawing:
    placed = place(robot, pose)
    legs = list(zip(placed.legs, split_joints(robot, joints), placed.attachments, strict=True))

    def arrays(segments):
        ends = [jnp.stack([end.array() for end in segment]) for segment in segments]
        return jnp.stack(ends) if ends else jnp.zeros((0, 2, robot.space.translations), pose.dtype)

    points = [point.array() for point in map(_point, placed.attachments) if point is not None]
    return _Drawing(
        [arrays(leg.rails(q, attachment)) for leg, q, attachment in legs],
        [arrays(leg.bars(q, attachment)) for leg, q, attachment in legs],
        jnp.stack(points) if points else jnp.zeros((0, robot.space.translations), pose.dtype),
    )


def _point(attachment: Any) -> Vec | None:
    """The point of an attachment, which comes first in one that is a point and an axis, or a frame."""
    parts = jax.tree.leaves(attachment, is_leaf=lambda part: isinstance(part, Vec))
    return next((part for part in parts if isinstance(part, Vec)), None)


def _on_rails(bars: np.ndarray, rails: np.ndarray) -> np.ndarray:
    """The bars' ends ``(n, d)`` that lie on a rail, which are sliders."""
    ends = bars.reshape(-1, bars.shape[-1])
    on_any = np.zeros(len(ends), bool)
    for low, high in rails:
        rail = high - low
        if length2 := rail @ rail:
            share = np.clip((ends - low) @ rail / length2, 0, 1)
            off = np.linalg.norm(ends - low - share[:, None] * rail, axis=1)
            on_any |= off < default_tol(ends.dtype) ** 0.5 * length2**0.5
    return ends[on_any]


def _fitted(segments: np.ndarray, size: int) -> np.ndarray:
    """Segments ``(n, points, d)`` in as many dimensions as the axes have.

    A planar leg that stands upright, as a scissor does, is laid down into the plane to its left.
    """
    missing = size - segments.shape[-1]
    if missing >= 0:
        return np.concatenate([segments, np.zeros((*segments.shape[:-1], missing))], axis=-1)
    flat, heights = segments[..., :size], segments[..., size:]
    feet = flat.reshape(-1, size)
    along = feet[np.argmax(np.linalg.norm(feet - feet[0], axis=1))] - feet[0]
    reach = np.linalg.norm(along)
    left = np.array([-along[1], along[0]]) / (reach if reach > 0 else 1)
    return flat + heights * left


def workspace(robot: Mechanism, poses: Any, *, ax: Any = None, unit: str = "m", size: float = 2.0) -> Axes:
    """Cloud of the positions that a robot reaches in its home mode within all limits.

    Args:
      robot: the robot.
      poses: ``(n, d)`` poses or a sample of a region; some ten thousand fill a picture.
      ax: axes to draw on; default: new ones.
      unit: of length, for the labels.
      size: of a dot, in points squared.

    Returns:
      The axes. Dots are shaded by height.
    """
    poses = jnp.asarray(poses)
    linear = robot.space.translations
    reached = poses[np.asarray(margins_of(robot, poses)) >= 0]
    points = np.asarray(jax.vmap(lambda pose: constrained_pose(robot, pose).value)(reached)[:, :linear])
    ax = new_axes(ax, spatial=linear == 3)
    ax.scatter(*points.T, s=size, c=points[:, -1], cmap="viridis", linewidths=0, rasterized=True)
    _finish(ax, robot.space.names[:linear], unit)
    return ax


def workspace_slice(
    robot: Mechanism,
    pose: Any,
    axes: tuple[str, str] = ("x", "z"),
    *,
    low: Sequence[float],
    high: Sequence[float],
    resolution: int = 200,
    ax: Any = None,
    unit: str = "m",
) -> Axes:
    """Slice of the workspace: where the margin is >= 0 when two pose coordinates vary.

    Args:
      robot: the robot.
      pose: ``(d,)``, gives the other coordinates.
      axes: names of the two coordinates.
      low, high: ``(2,)`` range of each.
      resolution: points along each axis.
      ax: axes to draw on; default: new ones.
      unit: of length, for the labels.

    Returns:
      The axes: the workspace grey, its boundary black, thin lines where the margin is 0.05, 0.1, ...

    Raises:
      ValueError: an unknown coordinate or a wrong shape of the pose.
    """
    robot, slice_ = slice_of(robot, pose, axes, low, high, resolution)
    margins = np.asarray(margins_of(robot, slice_.poses)).reshape(slice_.shape)
    ax = new_axes(ax, spatial=False)
    ax.contourf(slice_.xs, slice_.ys, margins, levels=[0, np.inf], colors=["0.85"])
    ax.contour(slice_.xs, slice_.ys, margins, levels=np.arange(0.05, 0.5, 0.05), colors="0.55", linewidths=0.6)
    ax.contour(slice_.xs, slice_.ys, margins, levels=[0], colors="black", linewidths=1.5)
    label_slice(ax, robot, axes, unit)
    return ax


def history(result: DesignResult, *, ax: Any = None, label: str = "objective") -> Axes:
    """Objective over the steps of an optimization, a line per start; hollow where constraints are violated.

    Args:
      result: of ``optimize_design``.
      ax: axes to draw on; default: new ones.
      label: of the vertical axis.

    Returns:
      The axes.
    """
    ax = new_axes(ax, spatial=False)
    values, violated = np.asarray(result.history.objective), np.asarray(result.history.violation) > 1e-3
    steps = np.arange(len(values))
    for start, (column, off) in enumerate(zip(values.T, violated.T, strict=True)):
        color = _LEG_COLORS[start % len(_LEG_COLORS)]
        ax.plot(steps, column, color=color, linewidth=1.2)
        ax.plot(steps[off], column[off], "o", color=color, markerfacecolor="white", markersize=4)
    ax.set_xlabel("step")
    ax.set_ylabel(label)
    return ax


def _segments(ax: Any, segments: np.ndarray, **style: Any) -> None:
    for segment in segments:
        ax.plot(*segment.T, **style)


def _finish(ax: Any, names: Sequence[str], unit: str) -> None:
    spans = {name: float(np.ptp(getattr(ax, f"get_{name}lim")())) for name in names}
    for name, span in spans.items():
        label, share = f"{name} ({unit})" if unit else name, span / max(spans.values())
        getattr(ax, f"set_{name}label")(label, labelpad=8 * share if ax.name == "3d" else None)
        ax.locator_params(axis=name, nbins=max(1, round(5 * share)), min_n_ticks=1)
    ax.set_aspect("equal")
