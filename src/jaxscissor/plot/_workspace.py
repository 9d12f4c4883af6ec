"""Pictures of a workspace: a cloud of positions, a slice with its limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.types import Numbers, PoseLike
from jaxscissor.kinematics._constraints import constrained_pose
from jaxscissor.plot._slices import finish, label_slice, margins_of, new_axes, slice_of
from jaxscissor.robots._contract import Mechanism
from jaxscissor.robots._spaces import position_size

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def workspace(robot: Mechanism, poses: Numbers, *, ax: Axes | None = None, unit: str = "m", size: float = 2.0) -> Axes:
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
    reached = poses[np.asarray(margins_of(robot, poses)) >= 0]

    def point(pose: jax.Array):
        return robot.space.place(constrained_pose(robot, pose).value)[0].array()

    points = np.asarray(jax.vmap(point)(reached))
    ax = new_axes(ax, spatial=position_size(robot.space) == 3)
    ax.scatter(*points.T, s=size, c=points[:, -1], cmap="viridis", linewidths=0, rasterized=True)
    finish(ax, "xyz"[: points.shape[1]], unit)
    return ax


def workspace_slice(
    robot: Mechanism,
    pose: PoseLike,
    axes: tuple[str, str] = ("x", "z"),
    *,
    low: Sequence[float],
    high: Sequence[float],
    resolution: int = 200,
    ax: Axes | None = None,
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

    Example:
      >>> import jaxscissor as js
      >>> robot = js.NavaroII.prototype()
      >>> ax = workspace_slice(robot, [0, 0, 0.1], ("x", "y"), low=(0, 0), high=(90, 80), resolution=20, unit="")
      >>> ax.get_xlabel()
      'x'
    """
    robot, slice_ = slice_of(robot, pose, axes, low, high, resolution)
    margins = np.asarray(margins_of(robot, slice_.poses)).reshape(slice_.shape)
    ax = new_axes(ax, spatial=False)
    ax.contourf(slice_.xs, slice_.ys, margins, levels=[0, np.inf], colors=["0.85"])
    ax.contour(slice_.xs, slice_.ys, margins, levels=np.arange(0.05, 0.5, 0.05), colors="0.55", linewidths=0.6)
    ax.contour(slice_.xs, slice_.ys, margins, levels=[0], colors="black", linewidths=1.5)
    label_slice(ax, robot, axes, unit)
    return ax
