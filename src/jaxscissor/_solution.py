"""What a solve returns: a value, and for every lane a status that says what the value is worth."""

from __future__ import annotations

import enum
from typing import Any

import jax
import numpy as np

from jaxscissor._pytree import pytree


class Status(enum.IntEnum):
    """Outcome of a solve; of several legs the largest code counts.

    Example:
      >>> Status(3).name
      'NO_SOLUTION'
    """

    CONVERGED = 0
    OTHER_MODE = 1
    MAX_STEPS = 2
    NO_SOLUTION = 3
    NONFINITE = 4
    SINGULAR = 5


_MESSAGES = {
    Status.CONVERGED: "converged in the home mode, or in the mode of the guess",
    Status.OTHER_MODE: "assembles, but was found only in another mode than home's or the guess's",
    Status.MAX_STEPS: "not converged; try a closer guess or more steps (max_steps). Nothing is proved",
    Status.NO_SOLUTION: "proved to have no solution: the robot cannot be assembled there. If its platform cannot move "
    "freely, complete the pose by constrained_pose",
    Status.NONFINITE: "the input holds nan, infinity or numbers that overflow",
    Status.SINGULAR: "the platform is loose where the iteration ended: the actuated joints do not determine its pose",
}


def status_message(code: Any) -> str:
    """One sentence for a status code.

    Example:
      >>> status_message(0)
      'converged in the home mode, or in the mode of the guess'
    """
    return _MESSAGES[Status(int(code))]


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


def raise_if_failed(solution: Solution) -> Solution:
    """Return the solution unless a lane failed; for scripts, outside ``jit``.

    Raises:
      RuntimeError: naming the number of failed lanes and, for the first five, index, status and residual.

    Example:
      >>> import jax.numpy as jnp
      >>> bad = Solution(jnp.zeros((2, 6)), jnp.array([0, 3]), jnp.array([0.0, 0.5]), jnp.array([2, 0]))
      >>> raise_if_failed(bad)
      Traceback (most recent call last):
      RuntimeError: 1 of 2 solves failed. [1]: NO_SOLUTION (residual 5.0e-01), proved to have no solution: ...
    """
    status = np.atleast_1d(np.asarray(solution.status))
    norms = np.atleast_1d(np.asarray(solution.residual_norm))
    failed = np.argwhere(status != Status.CONVERGED)
    if not len(failed):
        return solution
    lines = [
        f"{[int(i) for i in index]}: {Status(status[tuple(index)]).name} "
        f"(residual {norms[tuple(index)]:.1e}), {status_message(status[tuple(index)])}"
        for index in failed[:5]
    ]
    raise RuntimeError(f"{len(failed)} of {status.size} solves failed. " + "; ".join(lines))
