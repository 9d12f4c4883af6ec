"""Slices of a pose space, and the axes that pictures of them share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np

from jaxscissor._engine.types import PoseLike, PyTree
from jaxscissor.kinematics._feasibility import reached_margin
from jaxscissor.robots._contract import Mechanism, checked_pose

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Slice(NamedTuple):
    """Poses in which two coordinates vary."""

    poses: np.ndarray  # (points, d), the second coordinate slowest
    shape: tuple[int, int]
    xs: np.ndarray
    ys: np.ndarray
    places: list[int]  # of the two coordinates in a pose


def slice_of(
    robot: Mechanism, pose: PoseLike, axes: tuple[str, str], low: PyTree, high: PyTree, resolution: int
) -> tuple[Any, Slice]:
    """The robot and a slice of poses, in one floating dtype."""
    robot, pose = checked_pose(robot, pose)
    names = robot.space.names
    if not set(axes) <= set(names):
        raise ValueError(f"Got axes {axes}; expected two of {names}.")
    if set(axes) & set(robot.dependent):
        raise ValueError(f"Got axes {axes}; the constraints determine {robot.dependent}. Take the others.")
    places = [names.index(name) for name in axes]
    xs, ys = (np.linspace(a, b, resolution, dtype=pose.dtype) for a, b in zip(low, high, strict=True))
    grid = np.broadcast_to(np.asarray(pose), (resolution, resolution, len(names))).copy()
    grid[..., places[0]], grid[..., places[1]] = xs[None, :], ys[:, None]
    return robot, Slice(grid.reshape(-1, len(names)), (resolution, resolution), xs, ys, places)


def label_slice(ax: Axes, robot: Mechanism, axes: tuple[str, str], unit: str) -> None:
    """Label both axes; lengths in both directions keep their proportion."""
    ax.set_xlabel(label(robot, axes[0], unit))
    ax.set_ylabel(label(robot, axes[1], unit))
    if not any(is_angle(robot, name) for name in axes):
        ax.set_aspect("equal")


def is_angle(robot: Mechanism, name: str) -> bool:
    """Whether a pose coordinate is an angle."""
    return robot.space.names.index(name) >= robot.space.translations


def label(robot: Mechanism, name: str, unit: str) -> str:
    """A pose coordinate with its unit; ``unit`` is that of length and may be empty."""
    measured = "rad" if is_angle(robot, name) else unit
    return f"{name} ({measured})" if measured else name


@jax.jit
def margins_of(robot: Mechanism, poses: jax.Array) -> jax.Array:
    """Feasibility margins of poses ``(n, d)``."""
    return jax.vmap(lambda pose: reached_margin(robot, pose))(poses)


def new_axes(ax: Axes | None, *, spatial: bool) -> Axes:
    """The axes given, or new ones."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.figure().add_subplot(projection="3d" if spatial else None)


def finish(ax: Axes, names: Sequence[str], unit: str) -> None:
    spans = {name: float(np.ptp(getattr(ax, f"get_{name}lim")())) for name in names}
    for name, span in spans.items():
        label, share = f"{name} ({unit})" if unit else name, span / max(spans.values())
        getattr(ax, f"set_{name}label")(label, labelpad=8 * share if ax.name == "3d" else None)
        ax.locator_params(axis=name, nbins=max(1, round(5 * share)), min_n_ticks=1)  # pyright: ignore[reportArgumentType]
    ax.set_aspect("equal")
