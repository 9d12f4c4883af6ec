"""What is measured of the platform: its pose, markers on it, its height, or a user's function of robot and pose."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from jaxscissor._engine.pytree import as_arrays, pytree, quantity
from jaxscissor._engine.types import PoseLike, PyTree
from jaxscissor._engine.vectors import Vec
from jaxscissor.robots._contract import Attachment, Mechanism
from jaxscissor.robots._spaces import SE2, SE3
from jaxscissor.robots._subspaces import R3

Measure = Callable[[Any, jax.Array], jax.Array]  # (robot, pose) -> the numbers that are measured, () or (k,)
Parts = tuple[
    Callable[..., jax.Array], tuple[PyTree, ...]
]  # a function without numbers, and the numbers it takes first

_FRAMES = {(3, 6): SE3, (2, 3): SE2, (3, 3): R3}  # by the size of a point and of the frame


@pytree
class Markers:
    """Positions of points on the platform, as motion capture or a laser tracker measures them.

    The TSE's authors tracked markers at the three apices of the platform [ICRA16 VI]: ``Markers()``.

    Args:
      points: ``(markers, 3)`` in the platform frame, of planar robots ``(markers, 2)``. Default: where the legs
        hold the platform; such markers move with the dimensions of the legs' ends.
      frame: pose of the measuring frame in the base frame, in the coordinates of the robot's space (for a robot
        that does not turn, too, ``(6,)`` is a frame that may be turned). Default: the base frame.

    A marker that was not seen is ``nan`` among the measured numbers. Points and frame can be calibrated with the
    robot: name them in ``prior``.

    Raises:
      ValueError: points or a frame of the wrong shape.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> seen = js.calibration.Markers()(robot, robot.home()[0])
      >>> [round(float(number), 3) for number in seen[:3]]  # the end of the first leg
      [0.203, 0.0, 1.29]
    """

    points: Any = quantity("m", default=None)
    frame: Any = quantity("m, rad", default=None)

    def __post_init__(self):
        given = {name: getattr(self, name) for name in ("points", "frame") if getattr(self, name) is not None}
        for name, array in zip(given, as_arrays(*given.values()), strict=True):
            object.__setattr__(self, name, array)
        if self.points is not None and (self.points.ndim != 2 or self.points.shape[1] not in (2, 3)):
            raise ValueError(f"Got points of shape {self.points.shape}; expected (markers, 3), or (markers, 2).")
        if self.frame is not None and self.frame.shape not in ((3,), (6,)):
            raise ValueError(f"Got a frame of shape {self.frame.shape}; expected a pose, (6,) or in the plane (3,).")

    def __call__(self, robot: Mechanism, pose: PoseLike) -> jax.Array:
        """The markers' coordinates one after the other, in the measuring frame."""
        position, rotation = robot.space.place(jnp.asarray(pose))
        if self.points is None:
            points = [_point(attachment) for attachment in robot.attachments(position, rotation)]
        else:
            points = [position + rotation @ Vec(*point) for point in self.points]
        if self.frame is not None:
            size = len(points[0].components), len(self.frame)
            if size not in _FRAMES:
                raise ValueError(f"Got a frame of {size[1]} numbers for points of {size[0]}; expected a pose.")
            origin, axes = _FRAMES[size].place(self.frame)
            points = [Vec(*(axis.dot(point - origin) for axis in axes.columns)) for point in points]
        return jnp.stack([component for point in points for component in point.components])


def heights(robot: Mechanism, pose: PoseLike) -> jax.Array:
    """Height of the platform's reference point ``(1,)``, as a probe or a dial gauge measures it.

    Raises:
      ValueError: a robot whose pose has no z.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> round(float(js.calibration.heights(robot, robot.home()[0])[0]), 3)
      1.29
    """
    if "z" not in robot.space.names:
        raise ValueError(f"Got a {type(robot).__name__} with pose ({', '.join(robot.space.names)}); it has no height.")
    return jnp.asarray(pose)[jnp.array([robot.space.names.index("z")])]


def pose_of(robot: Mechanism, pose: jax.Array) -> jax.Array:
    """The pose itself, which is measured where nothing else is said."""
    return pose


def parts_of(measure: Measure | None) -> Parts:
    """A measure as a function that holds no numbers, for which a program is kept, and the numbers."""
    if measure is None:
        return pose_of, ()
    if jax.tree_util.all_leaves([measure]):  # a function, not a container of numbers
        return measure, ()
    return type(measure).__call__, (measure,)


def deviation(
    function: Callable[..., jax.Array], numbers: PyTree, robot: Mechanism, pose: jax.Array, target: jax.Array
) -> jax.Array:
    """What is measured less what the robot at a pose would show ``(k,)``; of poses, the twist from one to the other."""
    if function is pose_of:
        return robot.space.between(robot.space.place(pose), robot.space.place(target))
    return target - shown(function, numbers, robot, pose)


def shown(function: Callable[..., jax.Array], numbers: PyTree, robot: Mechanism, pose: jax.Array) -> jax.Array:
    """The numbers ``(k,)`` that the robot at a pose would show."""
    return jnp.atleast_1d(function(*numbers, robot, pose))


def _point(attachment: Attachment) -> Vec:
    """The point of an attachment, which comes first in one that is a point and an axis, or a frame."""
    parts = jax.tree.leaves(attachment, is_leaf=lambda part: isinstance(part, Vec))
    return next(part for part in parts if isinstance(part, Vec))
