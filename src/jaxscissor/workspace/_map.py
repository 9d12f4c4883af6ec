"""A function of one pose over many of them, in chunks."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp

from jaxscissor._engine.cpu.chunks import in_chunks
from jaxscissor._engine.map_reduce import Execution
from jaxscissor._engine.programs import keyed
from jaxscissor._engine.types import PyTree
from jaxscissor.regions._samples import AnySample, PosesLike, each_pose
from jaxscissor.robots._contract import Mechanism
from jaxscissor.workspace._reached import checked_sample

Function = Callable[[Mechanism, jax.Array], PyTree]  # (robot, pose) -> arrays in any containers


def map(function: Function, robot: Mechanism, poses: PosesLike, *, execution: Execution = Execution()) -> PyTree:
    """The results of a function at many poses, on a leading axis, as ``jax.vmap`` gives them.

    ``jax.vmap`` holds the intermediate results of all poses at once; this holds those of a chunk, and the results.

    Args:
      function: of a robot and a pose, such as ``js.inverse_jacobian`` or one of your own; it returns arrays in
        any containers. It is kept with its program: another call with it compiles nothing.
      robot: the robot; every array in it is differentiable.
      poses: ``(n, d)`` poses, or a sample of a region, of a ``workspace.Dexterous`` region each with every
        orientation.
      execution: of which only the size of a chunk counts.

    Returns:
      What the function returns, every array with a leading axis ``(n,)``.

    Raises:
      ValueError: poses of the wrong shape, or none; an execution with a mesh or a checkpoint.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.NavaroII.prototype()
      >>> sample = js.Disc([45.0, 26.0], 10.0, -0.1, 0.1).quasi_random(1000)
      >>> js.workspace.map(js.inverse_jacobian, robot, sample).shape
      (1000, 3, 3)
    """
    if execution.mesh is not None or execution.checkpoint is not None:
        raise ValueError("Got an execution with a mesh or a checkpoint; a map has no sum to share out or to save.")
    robot, sample = checked_sample(robot, poses)
    sample = each_pose(sample)
    return _mapped(function, robot, sample, most=execution.chunk_size)


@keyed
def _mapped(function: Function, robot: Mechanism, sample: AnySample, *, most: int | None) -> PyTree:
    def part(indices: jax.Array) -> PyTree:
        return jax.vmap(function, (None, 0))(robot, sample.poses(indices))

    return in_chunks(part, jnp.arange(len(sample), dtype=jnp.uint32), len(sample), most)
