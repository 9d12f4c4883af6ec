"""What keeps a robot out of the poses that it does not reach: which limit of which leg, and where."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.map_reduce import Execution, map_reduce, planned
from jaxscissor._engine.pytree import float_dtype, pytree, static
from jaxscissor._engine.types import PyTree
from jaxscissor.kinematics._constraints import constrained_pose
from jaxscissor.kinematics._feasibility import margins
from jaxscissor.regions._samples import AnySample, PosesLike, each_pose, without_size
from jaxscissor.robots._contract import Mechanism
from jaxscissor.workspace._reached import checked_sample


@pytree
class LimitingConstraints:
    """What keeps a robot out of the poses that it does not reach.

    Attributes:
      share: ``(legs, limits)`` of all poses, those out of reach for this limit of this leg first of all.
      center: ``(legs, limits, d)`` mean of those poses; ``nan`` where there are none.
      other: share of the poses that meet no constraint of the robot or are not finite.
      limits: names of the limits.
    """

    share: jax.Array
    center: jax.Array
    other: jax.Array
    limits: tuple[str, ...] = static()

    def __repr__(self) -> str:
        """The limits in order of their shares, with the mean pose of each."""
        share, center = np.asarray(self.share), np.asarray(self.center)
        if share.ndim != 2:
            return f"LimitingConstraints(share={share.shape})"
        rows = [
            f"  {share[leg, limit]:6.1%}  leg {leg + 1}: {self.limits[limit]}, about {center[leg, limit].round(3)}"
            for leg, limit in zip(*np.unravel_index(np.argsort(-share, axis=None), share.shape), strict=True)
            if share[leg, limit] > 0
        ]
        return "\n".join(
            [f"LimitingConstraints: {share.sum() + float(self.other):.1%} of the poses are out of reach", *rows]
        )


def limiting_constraints(
    robot: Mechanism, poses: PosesLike, *, execution: Execution = Execution()
) -> LimitingConstraints:
    """For every pose out of reach the limit with the least margin: what to change first, and where it helps.

    Args:
      robot: the robot.
      poses: ``(n, d)`` poses, or a sample of a region, whose poses are made chunk by chunk.
      execution: see ``workspace.fraction``.

    Returns:
      ``workspace.LimitingConstraints``. Its shares add up to what ``workspace.fraction`` lacks of one.

    Raises:
      ValueError: poses of the wrong shape, or none.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.NavaroII.prototype()
      >>> sample = js.Box([0.0, 0.0, 0.0], [90.0, 80.0, 0.0]).quasi_random(1000)
      >>> found = js.workspace.limiting_constraints(robot, sample)  # print it for the whole table
      >>> round(float(found.share.sum()), 2), found.limits[1:]
      (0.28, ('shortest leg', 'longest leg'))
    """
    robot, sample = checked_sample(robot, poses)
    sample = each_pose(sample)
    plan = planned(len(sample), execution)
    shape = jax.eval_shape(lambda: margins(robot, robot.home()[0])).shape
    shapes, dtype = (shape, (*shape, robot.space.dimension), ()), float_dtype(robot)
    start = tuple(jnp.zeros(shape, dtype) for shape in shapes)
    inputs = {"robot": robot, "sample": without_size(sample)}
    count, total, other = map_reduce(_count, None, plan, start, inputs)
    center = jnp.where(count[..., None] > 0, total / jnp.maximum(count, 1)[..., None], jnp.nan)
    names = robot.legs().limits or tuple(f"limit {i + 1}" for i in range(shape[1] - 1))
    return LimitingConstraints(count / plan.size, center, other / plan.size, ("edge of the home mode", *names))


def _count(_: object, totals: PyTree, indices: jax.Array, counted: jax.Array, robot: Mechanism, sample: AnySample):
    """Add the poses out of reach to the place of the limit that decides."""
    count, total, other = totals

    def judge(pose: jax.Array):
        whole = constrained_pose(robot, pose)
        each = margins(robot, jnp.where(whole.converged, whole.value, robot.home()[0]))
        each = jnp.where(jnp.isnan(each), -jnp.inf, each)
        least = jnp.min(each)
        first = jnp.arange(each.size).reshape(each.shape) == jnp.argmin(each)
        return first & (least < 0) & whole.converged, ~whole.converged

    poses = sample.poses(indices)
    binds, fails = jax.vmap(judge)(poses)
    binds = (binds & counted[:, None, None]).astype(count.dtype)
    total = total + jnp.einsum("nij,nd->ijd", binds, jnp.where(jnp.isfinite(poses), poses, 0))
    return count + binds.sum(axis=0), total, other + jnp.sum(fails & counted, dtype=other.dtype)
