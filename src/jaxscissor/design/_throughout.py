"""Constraints over a whole region: at poses that are added where the last design violates them most."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.pytree import as_floats
from jaxscissor._engine.types import PyTree
from jaxscissor.design._problem import FEASIBLE
from jaxscissor.design._result import DesignResult
from jaxscissor.design._run import Seconds
from jaxscissor.kinematics._solution import Status
from jaxscissor.regions._regions import Region
from jaxscissor.workspace._worst_over import Worst, searched

_SEARCH = {"samples": 2048, "starts": 8, "steps": 200}  # see ``workspace.worst_over``


@dataclasses.dataclass(frozen=True, eq=False)
class Throughout:
    """A constraint of ``design.optimize`` that is to be kept at every pose of a region: quantity(robot, pose) >= 0.

    Args:
      quantity: of a robot and a pose, one number or several of one unit; ``nan`` counts as violated but does not pull.
      region: of poses.
      poses: number of poses at which it is kept at a time. Half of them are spread over the region, the others are
        where a design violated it most, the latest ones.
      tolerance: violation that the search over the region may find in the end, in the quantity's unit.
      rounds: optimizations at most.

    Raises:
      ValueError: fewer than two poses or one round, no region.

    Example:
      >>> import jax.numpy as jnp, jaxscissor as js
      >>> region = js.Box(jnp.array([-1.0]), jnp.array([1.0]))
      >>> below = js.design.Throughout(lambda height, x: height - jnp.cos(3 * x[0] + 0.5), region)
      >>> lowest = js.design.optimize(lambda height: height, 2.0, bounds=(0.0, 3.0), steps=20, constraints=[below])
      >>> round(float(lowest.params), 4)
      1.0
    """

    quantity: Callable[[Any, jax.Array], Any]
    region: Region
    poses: int = 32
    tolerance: float = 1e-4
    rounds: int = 10

    def __post_init__(self):
        if not isinstance(self.region, Region):
            raise ValueError(f"Got region={self.region!r}; expected a region of poses, such as js.Box.")
        if self.poses < 2 or self.rounds < 1:
            raise ValueError(f"Got poses={self.poses} and rounds={self.rounds}; expected at least 2 and 1.")

    def at(self, robot: Any, poses: jax.Array) -> jax.Array:
        """The quantity at poses ``(n, d)``."""
        return jax.vmap(lambda pose: self.quantity(robot, pose))(poses)

    def least(self, robot: Any, pose: jax.Array) -> jax.Array:
        """The least entry at one pose, what is not defined included."""
        value = jnp.min(jnp.asarray(self.quantity(robot, pose)))
        return jnp.where(jnp.isnan(value), -jnp.inf, value)

    def first_poses(self) -> jax.Array:
        """Poses all over the region."""
        (region,) = as_floats(self.region)
        return region.quasi_random(self.poses)[:]


def exchanged(
    solve: Callable[[PyTree, tuple[jax.Array, ...]], DesignResult], params: PyTree, limits: Sequence[Throughout]
) -> DesignResult:
    """The best design that keeps constraints over whole regions [Blankenship and Falk, JOTA 19 (1976), 261].

    1. Optimize with the constraints at some poses each.
    2. Search each region for the pose at which the design violates its constraint most.
    3. If none is violated, that is the design, and the searches are its certificate. Else put these poses in the place
       of older ones, and begin again from the design.

    Args:
      solve: optimizes from parameters with the constraints at ``(poses, d)`` of each limit.
      params: the first start.
      limits: the constraints.
    """
    poses = [np.array(limit.first_poses()) for limit in limits]
    results, worst = [], ()
    for number in range(max(limit.rounds for limit in limits)):
        results.append(solve(params, tuple(map(jnp.asarray, poses))))
        params = results[-1].params
        worst = _worst(results[-1].robot, limits)
        ended = results[-1].status is Status.INTERRUPTED or not results[-1].ok
        if ended or not any(map(_violated, limits, worst)):
            break
        for limit, kept, found in zip(limits, poses, worst, strict=True):
            if _violated(limit, found):  # the first half stays where it is
                kept[limit.poses // 2 + number % (limit.poses - limit.poses // 2)] = found.pose
    return _joined(results, limits, worst)


def _worst(robot: Any, limits: Sequence[Throughout]) -> tuple[Worst, ...]:
    return tuple(searched(limit.least, robot, limit.region, **_SEARCH) for limit in limits)


def _kept(result: DesignResult, limits: Sequence[Throughout]) -> bool:
    """Whether the design given keeps all constraints, those over regions everywhere."""
    at_first = float(result.history.violation[0, 0]) <= FEASIBLE
    return at_first and not any(map(_violated, limits, _worst(result.initial, limits)))


def _violated(limit: Throughout, found: Worst) -> bool:
    return not float(found.value) >= -limit.tolerance


def _said(found: Worst) -> str:
    place = np.asarray(found.pose).round(4).tolist()
    return f"What is to hold throughout the region is {float(found.value):.3g} at the pose {place}."


def _joined(results: Sequence[DesignResult], limits: Sequence[Throughout], worst: tuple[Worst, ...]) -> DesignResult:
    """The last result, with the history of all and what the searches found."""
    first, last = results[0], results[-1]
    broken = [_said(found) for limit, found in zip(limits, worst, strict=True) if _violated(limit, found)]
    status = Status.INFEASIBLE if last.ok and broken else last.status
    if status in (Status.IMPROVED, Status.NOT_IMPROVED):  # those of the last optimization compare with its own start
        lower = float(last.objective[1]) < float(first.objective[0])
        status = Status.IMPROVED if lower or not _kept(first, limits) else Status.NOT_IMPROVED
    total = sum(result.seconds.first + result.seconds.others for result in results)
    return dataclasses.replace(
        last,
        initial=first.initial,
        objective=(first.objective[0], last.objective[1]),
        history=jax.tree.map(lambda *parts: jnp.concatenate(parts), *(result.history for result in results)),
        status=status,
        seconds=Seconds(first.seconds.first, total - first.seconds.first),
        worst=worst,
        message=" ".join([*filter(None, [last.message]), *broken]),
    )
