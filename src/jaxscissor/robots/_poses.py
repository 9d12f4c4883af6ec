"""Poses as people have them: a position with a matrix, a quaternion or Euler angles, and back."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax.scipy.spatial.transform import Rotation as Turn

from jaxscissor._engine.pytree import as_arrays, float_dtype, pytree
from jaxscissor._engine.types import Numbers, PoseLike
from jaxscissor._engine.vectors import Rotation, Vec
from jaxscissor.robots._contract import Mechanism, checked_pose
from jaxscissor.robots._spaces import position_size


@pytree
class Frame:
    """Where a platform is and how it is turned, both in the base frame.

    Attributes:
      position: ``(3,)`` of the platform's reference point, of a planar robot ``(2,)``.
      matrix: ``(3, 3)`` whose columns are the platform's axes, of a planar robot ``(2, 2)``.
    """

    position: jax.Array
    matrix: jax.Array

    @property
    def quaternion(self) -> jax.Array:
        """``(4,)`` unit quaternion (x, y, z, w), scalar last, as SciPy has it."""
        return jnp.asarray(Turn.from_matrix(_in_space(self.matrix)).as_quat())

    def euler(self, sequence: str) -> jax.Array:
        """``(3,)`` angles: ``"xyz"`` about the base's axes, ``"XYZ"`` about the platform's own, as SciPy has them."""
        return jnp.asarray(Turn.from_matrix(_in_space(self.matrix)).as_euler(sequence))


def pose(
    robot: Mechanism,
    position: Numbers,
    *,
    matrix: Numbers | None = None,
    quaternion: Numbers | None = None,
    euler: tuple[str, Numbers] | None = None,
) -> jax.Array:
    """Pose of a robot from where its platform is and how the platform is turned, both seen from the base frame.

    Args:
      robot: the robot.
      position: ``(3,)`` of the platform's reference point, of a planar robot ``(2,)``.
      matrix: ``(3, 3)`` rotation whose columns are the platform's axes, of a planar robot ``(2, 2)``.
      quaternion: ``(4,)`` (x, y, z, w), scalar last, as SciPy has it; of any length but zero.
      euler: the sequence and its angles: ``("zyx", (a, b, c))`` turns about the base's z, then its y, then its x;
        ``("ZYX", (a, b, c))`` about the platform's own z, the new y, the new x, as SciPy has it. A pose's own angles
        are ``("XYZ", (roll, pitch, yaw))``. Not more than one of the three; without any the platform is not turned.

    Returns:
      ``(d,)``, differentiable; ``nan`` where the robot's space has no such pose, such as a tilted one of a robot that
      only translates, or where the matrix is no rotation.

    Raises:
      ValueError: wrong shapes, or more than one orientation.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> turned = js.pose(robot, [0.0, 0.1, 1.0], euler=("zyx", [0.3, 0.0, 0.0]))
      >>> [f"{abs(x):.3f}" for x in (turned[5], *js.frame(robot, turned).quaternion[2:])]
      ['0.300', '0.149', '0.989']
    """
    size = position_size(robot.space)
    given = {"matrix": matrix, "quaternion": quaternion, "euler": euler}
    names = [name for name, value in given.items() if value is not None]
    if len(names) > 1:
        raise ValueError(f"Got {' and '.join(names)}; expected one of them.")
    (position,) = as_arrays(position)
    if position.shape != (size,):
        raise ValueError(f"Got a position of shape {position.shape}; {type(robot).__name__} expects ({size},).")
    turned = _matrix(size, **given)
    dtype = jnp.result_type(float_dtype(robot), position, turned)
    return _pose(robot, position.astype(dtype), turned.astype(dtype))


def frame(robot: Mechanism, pose: PoseLike) -> Frame:
    """Position and rotation of the platform at a pose, both in the base frame: the inverse of ``pose``.

    Args:
      robot: the robot.
      pose: ``(d,)``.

    Returns:
      ``robots.Frame`` with ``position``, ``matrix``, ``quaternion`` and ``euler(sequence)``.

    Raises:
      ValueError: wrong shape of the pose.

    Example:
      >>> import jaxscissor as js
      >>> js.frame(js.NavaroII.prototype(), [45.0, 26.0, 0.5]).euler("xyz").round(3).tolist()
      [0.0, 0.0, 0.5]
    """
    robot, pose = checked_pose(robot, pose)
    return _frame(robot, pose)


@jax.jit
def _frame(robot: Mechanism, pose: jax.Array) -> Frame:
    position, rotation = robot.space.place(pose)
    size = len(position.components)
    return Frame(position.array(), jnp.broadcast_to(rotation.array(), (size, size)).astype(pose.dtype))


def _matrix(size: int, matrix: Numbers | None, quaternion: Numbers | None, euler: tuple[str, Numbers] | None):
    """The rotation as a matrix of the size of a position."""
    if matrix is not None:
        (matrix,) = as_arrays(matrix)
        if matrix.shape != (size, size):
            raise ValueError(f"Got a matrix of shape {matrix.shape}; expected {(size, size)}.")
        return matrix
    if quaternion is not None:
        (quaternion,) = as_arrays(quaternion)
        if quaternion.shape != (4,):
            raise ValueError(f"Got a quaternion of shape {quaternion.shape}; expected (4,), (x, y, z, w).")
        return Turn.from_quat(quaternion).as_matrix()[:size, :size]
    if euler is None:
        return jnp.eye(size)
    sequence, (angles,) = euler[0], as_arrays(euler[1])
    if angles.shape != (len(sequence),):
        raise ValueError(f"Got {angles.shape} angles for the sequence {sequence!r}; expected one for each letter.")
    return Turn.from_euler(sequence, angles).as_matrix()[:size, :size]


@jax.jit
def _pose(robot: Mechanism, position: jax.Array, matrix: jax.Array) -> jax.Array:
    given = Vec(*position), Rotation(*(Vec(*column) for column in matrix.T))
    found = jnp.stack(robot.space.coordinates(*given))
    back, turned = robot.space.place(found)
    off = jnp.max(jnp.abs(turned.array() - matrix)) + jnp.max(jnp.abs(back.array() - position)) / robot.length
    return jnp.where(off < jnp.sqrt(jnp.finfo(found.dtype).eps), found, jnp.nan)


def _in_space(matrix: jax.Array) -> jax.Array:
    size = len(matrix)
    return jnp.eye(3, dtype=matrix.dtype).at[:size, :size].set(matrix)
