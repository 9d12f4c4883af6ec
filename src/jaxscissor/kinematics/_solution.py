"""What a solve returns: a value, and for every lane a status that says what the value is worth."""

from __future__ import annotations

import enum

import jax
import numpy as np

from jaxscissor._engine.pytree import pytree


class Status(enum.IntEnum):
    """What came of a computation: of a solve (0 to 5, of several legs the largest code), a design, a plan.

    Example:
      >>> Status(3).name, Status(0).message
      ('NO_SOLUTION', 'converged in the home mode, or in the mode of the guess')
    """

    CONVERGED = 0
    OTHER_MODE = 1
    MAX_STEPS = 2
    NO_SOLUTION = 3
    NONFINITE = 4
    SINGULAR = 5
    IMPROVED = 6
    NOT_IMPROVED = 7
    INFEASIBLE = 8
    IMPOSSIBLE = 9
    PLANNED = 10
    NO_CLEAR_MODE = 11
    OUT_OF_REACH = 12
    CONTRADICTION = 13
    INTERRUPTED = 14

    @property
    def message(self) -> str:
        """One sentence."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.CONVERGED: "converged in the home mode, or in the mode of the guess",
    Status.OTHER_MODE: "assembles, but was found only in another mode than home's or the guess's",
    Status.MAX_STEPS: "not converged; try a closer guess or more steps (max_steps). Nothing is proved",
    Status.NO_SOLUTION: "proved to have no solution: the robot cannot be assembled there. If its platform cannot move "
    "freely, complete the pose by constrained_pose",
    Status.NONFINITE: "the input holds nan, infinity or numbers that overflow",
    Status.SINGULAR: "the platform is loose where the iteration ended: the actuated joints do not determine its pose; "
    "of a motion: the next step would reach or cross a singularity",
    Status.IMPROVED: "found a feasible design better than the one given",
    Status.NOT_IMPROVED: "the design given is the best feasible one that was found",
    Status.INFEASIBLE: "no design that was seen keeps the constraints",
    Status.IMPOSSIBLE: "no robot can be built of the best design",
    Status.PLANNED: "found a plan that keeps clear of singularities",
    Status.NO_CLEAR_MODE: "on some steps no mode keeps clear of singularities",
    Status.OUT_OF_REACH: "a pose, or of a plan some poses in every mode, is beyond a limit",
    Status.CONTRADICTION: "more joints are actuated than the platform has freedoms, and no pose near the guess has "
    "them all; the value is the pose of least residual",
    Status.INTERRUPTED: "stopped by the user; the design is the best feasible one until then",
}


@pytree
class Solution:
    """Result of one solve, or of a batch under ``vmap``.

    Attributes:
      value: what was solved for. Where the status is not ``CONVERGED`` it is the closest configuration
        that was found (``nan`` for ``NONFINITE``) and its derivatives are zero.
      status: a ``Status`` code per lane, int32.
      residual_norm: norm of the closure residual at ``value``, dimensionless.
      num_steps: Newton steps taken.
    """

    value: jax.Array
    status: jax.Array
    residual_norm: jax.Array
    num_steps: jax.Array

    @property
    def converged(self) -> jax.Array:
        """Whether the status is ``Status.CONVERGED``."""
        return self.status == Status.CONVERGED

    def raise_if_failed(self) -> Solution:
        """Return the solution itself unless a lane failed; for scripts, outside ``jit``.

        Raises:
          RuntimeError: naming the number of failed lanes and, for the first five, index, status and residual.

        Example:
          >>> import jax.numpy as jnp
          >>> bad = Solution(jnp.zeros((2, 6)), jnp.array([0, 3]), jnp.array([0.0, 0.5]), jnp.array([2, 0]))
          >>> bad.raise_if_failed()
          Traceback (most recent call last):
          RuntimeError: 1 of 2 solves failed. [1]: NO_SOLUTION (residual 5.0e-01), proved to have no solution: ...
        """
        status = np.atleast_1d(np.asarray(self.status))
        norms = np.atleast_1d(np.asarray(self.residual_norm))
        failed = np.argwhere(status != Status.CONVERGED)
        if not len(failed):
            return self
        lines = [
            f"{[int(i) for i in index]}: {Status(status[tuple(index)]).name} "
            f"(residual {norms[tuple(index)]:.1e}), {Status(status[tuple(index)]).message}"
            for index in failed[:5]
        ]
        raise RuntimeError(f"{len(failed)} of {status.size} solves failed. " + "; ".join(lines))
