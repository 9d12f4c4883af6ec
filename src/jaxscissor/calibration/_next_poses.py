"""Which poses to measure next."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.types import Numbers, PyTree
from jaxscissor.calibration._measures import Measure
from jaxscissor.calibration._model import Linear, joints_at, modeled, starts_of
from jaxscissor.kinematics import Status
from jaxscissor.regions._samples import PosesLike, each_pose
from jaxscissor.robots._contract import Mechanism
from jaxscissor.workspace._reached import checked_sample


def next_poses(
    robot: Mechanism,
    candidates: PosesLike,
    *,
    count: int,
    prior: PyTree = None,
    sigma: Numbers,
    offsets: Numbers = 0.0,
    measure: Measure | None = None,
    joints: Numbers | None = None,
) -> np.ndarray:
    """The candidates that tell most about the dimensions, the best first.

    One pose after the other is chosen so that the determinant of the information, of the prior and of all poses up to
    it, grows most: a greedy D-optimal design [Fedorov, Theory of optimal experiments, 1972]. A measurement whose noise
    hides a combination of dimensions adds nothing to it, and a pose that repeats another adds little.

    Args:
      robot, prior, offsets, measure: as of ``identify``.
      candidates: ``(n, d)`` poses, or a sample of a region. Limits are not judged: leave out poses that the robot
        may not take, by ``feasibility``.
      count: how many to choose.
      sigma: as of ``identify``, one or ``(k,)``.
      joints: ``(n, m)`` actuated joints at which the same was measured already.

    Returns:
      ``(count,)`` indices of candidates, each at most once; -1 where no candidate is left that the robot reaches.

    Raises:
      ValueError: as ``identify``; a count below one.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.NavaroII.prototype()
      >>> candidates = js.Box([40.0, 20.0, -0.2], [50.0, 30.0, 0.2]).quasi_random(50)
      >>> chosen = js.calibration.next_poses(robot, candidates, count=3, prior={"base": 0.1}, sigma=0.01)
      >>> chosen.shape, len(set(chosen.tolist()))
      ((3,), 3)
    """
    if count < 1:
        raise ValueError(f"Got count={count}; expected at least one.")
    robot, sample = checked_sample(robot, candidates)
    sample = each_pose(sample)
    poses = sample.poses(jnp.arange(len(sample), dtype=jnp.uint32))
    solved = joints_at(robot, poses)
    reached = np.asarray(solved.converged)
    actuated = np.where(reached[:, None], robot.actuated(solved.value), np.nan)

    def information(joints: Numbers, guess: Numbers | None) -> Linear:
        model = modeled(robot, joints, None, prior=prior, sigma=sigma, offsets=offsets, measure=measure)
        return model.at(np.zeros(len(model.unknowns.names)), starts_of(model, guess))

    linear = information(actuated, np.asarray(poses))
    rows, usable = linear.jacobian, linear.status == Status.CONVERGED
    known = np.eye(rows.shape[-1])
    if joints is not None:
        done = information(joints, None)
        before = np.concatenate(list(done.jacobian[done.status == Status.CONVERGED]) or [known[:0]])
        known = known + before.T @ before
    return _greedy(np.where(usable[:, None, None], rows, 0), usable, known, count)


def _greedy(rows: np.ndarray, usable: np.ndarray, known: np.ndarray, count: int) -> np.ndarray:
    """Indices of the rows ``(n, k, p)`` that multiply the determinant of what is known most, one after the other."""
    chosen = np.full(count, -1)
    free = usable.copy()
    for i in range(min(count, int(usable.sum()))):
        gains = np.linalg.slogdet(np.eye(rows.shape[1]) + rows @ np.linalg.inv(known) @ np.swapaxes(rows, 1, 2))[1]
        chosen[i] = best = int(np.argmax(np.where(free, gains, -np.inf)))
        free[best] = False
        known = known + rows[best].T @ rows[best]
    return chosen
