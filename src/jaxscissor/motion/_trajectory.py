"""What came of a motion: how far it went and, sample by sample, how."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from jaxscissor._engine.pytree import pytree
from jaxscissor.kinematics._solution import Status


class Stopped:
    """A motion that goes on until something stops it; from there on the status is the reason."""

    status: jax.Array

    @property
    def ok(self) -> jax.Array:
        """``(n,)`` which samples were covered, the first ones."""
        return self.status == Status.CONVERGED

    @property
    def covered(self) -> jax.Array:
        """How many samples were covered: the index of the one before which the motion stopped."""
        return jnp.sum(self.ok, axis=-1)

    @property
    def reason(self) -> jax.Array:
        """Why the motion stopped, a ``Status`` code: ``CONVERGED`` if it covered everything."""
        return self.status[..., -1]


@pytree
class Trajectory(Stopped):
    """Configurations along a motion of ``n`` samples; ``nan`` from where it stopped.

    Attributes:
      poses: ``(n, d)``.
      joints: ``(n, joints)``, all of them; ``robot.actuated`` takes the actuated ones.
      margin: ``(n,)`` least distance to a limit, as ``feasibility`` measures it; that to the edge of the working mode
        is in ``type1``. Infinite of a robot without limits.
      type1, type2: ``(n, legs)`` and ``(n,)``, see ``singularities.measures``.
      status: ``(n,)``; ``CONVERGED`` as far as the motion was covered, from there on the reason why not.
    """

    poses: jax.Array
    joints: jax.Array
    margin: jax.Array
    type1: jax.Array
    type2: jax.Array
    status: jax.Array


def until_stopped(status: jax.Array, values: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
    """The values of a sample, ``nan`` unless its status is ``CONVERGED``."""
    return tuple(jnp.where(status == Status.CONVERGED, value, jnp.nan) for value in values)
