"""Pictures of a robot in a pose, still and moving."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.numerics import default_tol
from jaxscissor._engine.types import JointsLike, Numbers, PoseLike
from jaxscissor._engine.vectors import Vec
from jaxscissor.kinematics._configuration import configuration
from jaxscissor.kinematics._legs import place
from jaxscissor.plot._slices import finish, new_axes
from jaxscissor.robots._contract import Mechanism, joints_by_leg
from jaxscissor.robots._over_legs import one_by_one
from jaxscissor.robots._spaces import position_size

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.axes import Axes

LEG_COLORS = ("#1b2a49", "#2f7f93", "#c98a1b", "#7a3b69", "#4f8a4f", "#a05a4a")
_RAIL_COLOR = "#c2c2c2"


def robot(
    robot: Mechanism,
    pose: PoseLike | None = None,
    *,
    joints: JointsLike | None = None,
    ax: Axes | None = None,
    unit: str = "m",
) -> Axes:
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

    Example:
      >>> import jaxscissor as js
      >>> js.plot.robot(js.NavaroII.prototype(), unit="").get_ylabel()
      'y'
    """
    robot, pose, joints = configuration(robot, pose, joints)
    drawing = jax.tree.map(np.asarray, _drawing(robot, pose, joints))
    ax = new_axes(ax, spatial=position_size(robot.space) == 3)
    size = 3 if ax.name == "3d" else 2
    if size < position_size(robot.space):
        raise ValueError('Got flat axes for a spatial robot; expected axes of add_subplot(projection="3d").')
    for number, (rails, bars) in enumerate(zip(drawing.rails, drawing.bars, strict=True)):
        color = LEG_COLORS[number % len(LEG_COLORS)]
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
    finish(ax, "xyz"[:size], unit)
    return ax


def animate(
    robot: Mechanism,
    poses: Numbers,
    *,
    joints: JointsLike | None = None,
    ax: Axes | None = None,
    unit: str = "m",
    interval: float = 40.0,
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

    Example:
      >>> import jaxscissor as js
      >>> robot = js.NavaroII.prototype()
      >>> film = js.plot.animate(robot, [[45.0, 26.0, 0.1], [45.0, 28.0, 0.1]])
      >>> "<img" in film.to_jshtml()  # what a notebook shows
      True
    """
    from matplotlib.animation import FuncAnimation

    poses, given = jnp.asarray(poses), None if joints is None else jnp.asarray(joints)
    if poses.ndim != 2 or not len(poses) or (given is not None and len(given) != len(poses)):
        raise ValueError(f"Got poses of shape {poses.shape}; expected (n, d), at least one, and as many joints if any.")
    ax = new_axes(ax, spatial=position_size(robot.space) == 3)
    names = "xyz" if ax.name == "3d" else "xy"

    def draw(number: int):
        ax.clear()
        _picture(robot, poses[number], joints=None if given is None else given[number], ax=ax, unit=unit)
        return [getattr(ax, f"get_{name}lim")() for name in names]

    limits = np.array([draw(number) for number in range(len(poses))])
    lows, highs = limits[..., 0].min(axis=0), limits[..., 1].max(axis=0)

    def frame(number: int):
        draw(number)
        for name, low, high in zip(names, lows, highs, strict=True):
            getattr(ax, f"set_{name}lim")(low, high)
        ax.set_aspect("equal")
        return ax.lines

    return FuncAnimation(ax.figure, frame, frames=len(poses), interval=interval)  # pyright: ignore[reportArgumentType]


_picture = robot  # a function that takes a robot of this name


class _Drawing(NamedTuple):
    rails: list[jax.Array]  # per leg (segments, 2, d)
    bars: list[jax.Array]
    points: jax.Array  # (corners of the platform, d)


@jax.jit
def _drawing(robot: Mechanism, pose: jax.Array, joints: jax.Array) -> _Drawing:
    placed = place(robot, pose)
    legs = list(one_by_one(placed.legs, joints_by_leg(robot, joints), placed.attachments))

    def arrays(segments: jax.Array):
        ends = [jnp.stack([end.array() for end in segment]) for segment in segments]
        return jnp.stack(ends) if ends else jnp.zeros((0, 2, position_size(robot.space)), pose.dtype)

    points = [point.array() for point in (_point(seen) for _, _, seen in legs) if point is not None]
    return _Drawing(
        [arrays(leg.rails(q, attachment)) for leg, q, attachment in legs],
        [arrays(leg.bars(q, attachment)) for leg, q, attachment in legs],
        jnp.stack(points) if points else jnp.zeros((0, position_size(robot.space)), pose.dtype),
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


def _segments(ax: Axes, segments: np.ndarray, **style: Any) -> None:
    for segment in segments:
        ax.plot(*segment.T, **style)
