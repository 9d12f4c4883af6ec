"""What an optimization returns: the best design, how it was found, and what holds it back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp

from jaxscissor._engine.pytree import pytree, static
from jaxscissor.design._multipliers import Multipliers
from jaxscissor.design._problem import concatenated, constraint_values
from jaxscissor.design._run import Seconds
from jaxscissor.design._summary import summary
from jaxscissor.kinematics._solution import Status
from jaxscissor.workspace._worst_over import Worst


@pytree
class Starts:
    """Best design of every start, on a leading axis: parameters, objective and largest violation.

    A violation counts in units of the median slope that the constraint's entries have at the first start, across
    the bounds.
    """

    params: Any
    objective: jax.Array
    violation: jax.Array


@pytree
class History:
    """What every step found, each ``(steps + 1, starts)``: objective, largest violation; and the multipliers.

    ``multipliers`` is ``(steps + 1, starts, constraints)``: how much the objective would fall if a
    constraint were loosened by one unit.
    """

    objective: jax.Array
    violation: jax.Array
    multipliers: jax.Array


@pytree
class Validation:
    """Metric and least value of the constraints, before and after, on poses that the tuning did not see."""

    before: jax.Array
    after: jax.Array
    constraints_before: jax.Array
    constraints_after: jax.Array

    @property
    def improvement(self) -> jax.Array:
        """By how much the metric fell."""
        return self.before - self.after


@pytree
class DesignResult:
    """Result of ``design.optimize``.

    Attributes:
      params: parameters of the best design.
      robot: what was built of them.
      initial: what was built of the parameters given.
      history: ``History`` of all starts.
      starts: ``Starts``, the best of each.
      multipliers: ``Multipliers``, which constraints and bounds hold the design back.
      objective: of the parameters given and of the best design.
      worst: of every ``design.Throughout``, its least value in the region and the pose that has it, by a search.
      status: ``IMPROVED``; ``NOT_IMPROVED`` on the parameters given; ``INTERRUPTED`` by Ctrl-C, with a design that
        keeps the constraints; ``INFEASIBLE`` if no design kept them; ``NONFINITE`` if no start had a finite objective
        with a finite gradient; ``IMPOSSIBLE`` if ``build`` refuses the best design.
      settled: whether it stopped before the last step because the objective no longer fell.
      seconds: ``first``, until the first step was done, compilation included, and ``others``.
      entries: names of the constraints, and how many entries each has.
      message: what is to be known besides, such as a gradient that is zero or not finite; or nothing.
    """

    params: Any
    robot: Any
    initial: Any
    history: History
    starts: Starts
    multipliers: Multipliers
    objective: tuple[jax.Array, jax.Array]
    worst: tuple[Worst, ...]
    status: Status = static()
    settled: bool = static()
    seconds: Seconds = static()
    entries: tuple[tuple[str, int], ...] = static()
    message: str = static(default="")

    @property
    def ok(self) -> bool:
        """Whether the design keeps the constraints and a robot can be built of it."""
        return self.status in (Status.IMPROVED, Status.NOT_IMPROVED, Status.INTERRUPTED)

    def __str__(self) -> str:
        """What happened, in some ten lines."""
        return summary(self)

    def validate(self, metric: Callable[[Any], Any], constraints: Sequence[Callable[[Any], Any]] = ()) -> Validation:
        """Compare the robot with the initial one by a metric, a hard one on a dense sample of its own.

        Args:
          metric: of a robot, smaller is better.
          constraints: functions of a robot, satisfied where every entry is >= 0.

        Example:
          >>> import jaxscissor as js
          >>> result = js.design.optimize(lambda x: (x - 2.0) ** 2, 0.5, bounds=(0.0, 1.0), steps=50)
          >>> bool(result.validate(lambda x: abs(x - 2.0)).improvement > 0.4)
          True
        """
        values = [jnp.asarray(metric(robot)) for robot in (self.initial, self.robot)]
        least = [
            jnp.min(concatenated(constraint_values(constraints, robot)), initial=jnp.inf)
            for robot in (self.initial, self.robot)
        ]
        return Validation(*values, *least)
