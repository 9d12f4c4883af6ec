"""Matplotlib pictures: a robot in a pose, its workspace as points and slices, the course of an optimization."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._legs import place
from jaxscissor._vectors import Vec
from jaxscissor.constraints import constrained_pose
from jaxscissor.design import DesignResult
from jaxscissor.feasibility import reached_margin
from jaxscissor.kinematics import inverse_kinematics
from jaxscissor.mechanisms._contract import Mechanism, checked_joints, checked_pose, split_joints

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LEG_COLORS = ("#1b2a49", "#2f7f93", "#c98a1b", "#7a3b69", "#4f8a4f", "#a05a4a")
_RAIL_COLOR = "#9a9a9a"


def robot(robot: Mechanism, pose: Any = None, *, joints: Any = None, ax: Any = None, unit: str = "m") -> Axes:
    """Draw a robot with all its bars and slides.

    Args:
      robot: the robot.
      pose: ``(d,)``; default: home.
      joints: ``(n,)``; default: by inverse kinematics, or at home.
      ax: axes to draw on, three-dimensional for spatial robots; default: new ones.
      unit: of length, for the labels.

    Returns:
      The axes.

    Raises:
      ValueError: wrong shapes, or a pose that the home mode does not reach while no joints are given.
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
    drawing = _drawing(robot, pose, checked_joints(robot, joints))
    ax = _axes(ax, spatial=robot.space.translations == 3)
    for number, (rails, bars) in enumerate(zip(drawing.rails, drawing.bars, strict=True)):
        color = _LEG_COLORS[number % len(_LEG_COLORS)]
        _segments(ax, rails, color=_RAIL_COLOR, linewidth=4, solid_capstyle="round", zorder=1)
        _segments(ax, bars, color=color, linewidth=1.6, marker="o", markersize=2.5)
    if len(drawing.points) > 2:
        outline = np.array([*drawing.points, drawing.points[0]])
        ax.plot(*outline.T, color="black", linewidth=3, solid_joinstyle="round")
    _finish(ax, robot.space.names[: robot.space.translations], unit)
    return ax


class _Drawing(NamedTuple):
    rails: list[Any]  # per leg a list of segments, each a pair of points
    bars: list[Any]
    points: list[Any]  # corners of the platform


@jax.jit
def _drawing(robot: Mechanism, pose: jax.Array, joints: jax.Array) -> _Drawing:
    placed = place(robot, pose)
    legs = list(zip(placed.legs, split_joints(robot, joints), placed.attachments, strict=True))

    def arrays(segments):
        return [tuple(end.array() for end in segment) for segment in segments]

    return _Drawing(
        [arrays(leg.rails(q, attachment)) for leg, q, attachment in legs],
        [arrays(leg.bars(q, attachment)) for leg, q, attachment in legs],
        [attachment.array() for attachment in placed.attachments if isinstance(attachment, Vec)],
    )


@jax.jit
def _margins(robot: Mechanism, poses: jax.Array) -> jax.Array:
    return jax.vmap(lambda pose: reached_margin(robot, pose))(poses)


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
    reached = poses[np.asarray(_margins(robot, poses)) >= 0]
    points = np.asarray(jax.vmap(lambda pose: constrained_pose(robot, pose).value)(reached)[:, :linear])
    ax = _axes(ax, spatial=linear == 3)
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
    robot, pose = checked_pose(robot, pose)
    names = robot.space.names
    if not set(axes) <= set(names):
        raise ValueError(f"Got axes {axes}; expected two of {names}.")
    if set(axes) & set(robot.dependent):
        raise ValueError(f"Got axes {axes}; the constraints determine {robot.dependent}. Take the others.")
    first, second = (names.index(name) for name in axes)
    xs, ys = (np.linspace(a, b, resolution, dtype=pose.dtype) for a, b in zip(low, high, strict=True))

    grid = jnp.broadcast_to(pose, (resolution, resolution, pose.shape[0]))
    grid = grid.at[..., first].set(xs[None, :]).at[..., second].set(ys[:, None])
    margins = np.asarray(_margins(robot, grid.reshape(-1, pose.shape[0]))).reshape(resolution, resolution)
    ax = _axes(ax, spatial=False)
    ax.contourf(xs, ys, margins, levels=[0, np.inf], colors=["0.85"])
    ax.contour(xs, ys, margins, levels=np.arange(0.05, 0.5, 0.05), colors="0.55", linewidths=0.6)
    ax.contour(xs, ys, margins, levels=[0], colors="black", linewidths=1.5)
    angular = [names.index(name) >= robot.space.translations for name in axes]
    for name, is_angle, label in zip(axes, angular, (ax.set_xlabel, ax.set_ylabel), strict=True):
        label(f"{name} (rad)" if is_angle else f"{name} ({unit})")
    if not any(angular):
        ax.set_aspect("equal")
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
    ax = _axes(ax, spatial=False)
    values, violated = np.asarray(result.history.objective), np.asarray(result.history.violation) > 1e-3
    steps = np.arange(len(values))
    for start, (column, off) in enumerate(zip(values.T, violated.T, strict=True)):
        color = _LEG_COLORS[start % len(_LEG_COLORS)]
        ax.plot(steps, column, color=color, linewidth=1.2)
        ax.plot(steps[off], column[off], "o", color=color, markerfacecolor="white", markersize=4)
    ax.set_xlabel("step")
    ax.set_ylabel(label)
    return ax


def _axes(ax: Any, *, spatial: bool) -> Any:
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.figure().add_subplot(projection="3d" if spatial else None)


def _segments(ax: Any, segments: Sequence[Any], **style: Any) -> None:
    for segment in segments:
        ax.plot(*np.array(segment).T, **style)


def _finish(ax: Any, names: Sequence[str], unit: str) -> None:
    for name in names:
        getattr(ax, f"set_{name}label")(f"{name} ({unit})")
    ax.locator_params(nbins=5)
    ax.set_aspect("equal")
