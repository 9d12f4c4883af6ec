"""Least and greatest values over a region of poses: the worst case of a metric, the strokes that a task needs."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._program import keyed, program
from jaxscissor.kinematics import inverse_kinematics
from jaxscissor.mechanisms._contract import Mechanism, angular_joints
from jaxscissor.regions import Region, Sample

_PROBES = 32  # points around the best one, in every step
_SHRINK = 0.7  # of their distance, when none is better


class Extreme(NamedTuple):
    """A value and the pose where it is taken."""

    value: jax.Array
    pose: jax.Array


class JointRange(NamedTuple):
    """Least and greatest value of every joint, each ``(n,)``, and the poses ``(n, d)`` that need them."""

    low: jax.Array
    high: jax.Array
    low_poses: jax.Array
    high_poses: jax.Array


def minimum_over(
    function: Callable[[jax.Array], Any], region: Region, *, samples: int = 2048, starts: int = 8, steps: int = 200
) -> Extreme:
    """Least value of a function of the pose over a region: a worst case, by sampling and then narrowing in.

    The best of the samples are followed by a random search that narrows down to rounding and walks along
    the region's edge; the function need not be smooth, so margins, singular values and absolute values
    will do. A minimum narrower than the samples' distance can be missed.

    Args:
      function: of a pose ``(d,)``, a scalar; nan counts as worse than any number.
      region: of poses.
      samples: poses at which the search looks first.
      starts: how many of them, the best, are followed.
      steps: of each search.

    Returns:
      ``Extreme``: the value, whose derivative is that of the function at a fixed place in the region
      (Danskin), which is exact; and the pose.

    Raises:
      ValueError: fewer samples than starts, or none.

    Example:
      The least height of the laboratory's region is on its floor:

      >>> import jaxscissor as js
      >>> region = js.Box([-1.0, -1.0, 0.5], [1.0, 1.0, 0.9])
      >>> float(js.minimum_over(lambda pose: pose[2], region).value)
      0.5
    """
    _check(samples, starts)
    return _minimum(function, region, samples=samples, starts=starts, steps=steps)


@program("samples", "starts")
def joint_range(robot: Mechanism, region: Region, *, samples: int = 2048, starts: int = 8) -> JointRange:
    """The values that every joint takes over a region: the stroke that a task needs.

    Joints are those of inverse kinematics, whatever the robot's present stroke; poses that the home mode
    does not reach are left out, so check first that the region is reached where that matters.

    Args:
      robot: the robot.
      region: of poses.
      samples: poses at which each search looks first.
      starts: how many of them are followed, per joint and side.

    Returns:
      ``JointRange``, differentiable in the robot and the region. Angles are unwrapped about those of home.

    Raises:
      ValueError: as for ``minimum_over``.

    Example:
      The stroke of NaVARo II for a disc of radius 25 with all angles to 90 deg [NAV19 eqs. 13-26]:

      >>> import jaxscissor as js, numpy as np
      >>> robot = js.NavaroII.prototype()
      >>> disc = js.Disc([45.0, 15 * np.sqrt(3)], 25.0, -np.pi / 2, np.pi / 2)
      >>> needed = js.joint_range(robot, disc)
      >>> print(f"{float(needed.low[1::2].min()):.4f} {float(needed.high[1::2].max()):.4f}")
      9.6410 79.7723
    """
    _check(samples, starts)
    home = robot.home()[1]
    angular = jnp.array(angular_joints(robot))

    def joints(pose):
        solution = inverse_kinematics(robot, pose)
        away = solution.value - home
        away = jnp.where(angular, away - 2 * math.pi * jnp.round(away / (2 * math.pi)), away)
        return jnp.where(solution.converged, home + away, jnp.nan)

    def least(direction):
        return minimum_over(lambda pose: direction @ joints(pose), region, samples=samples, starts=starts)

    axes = jnp.eye(home.shape[0], dtype=home.dtype)
    found = jax.vmap(least)(jnp.concatenate([axes, -axes]))
    (low, minus_high), (low_poses, high_poses) = (jnp.split(both, 2) for both in found)
    return JointRange(low, -minus_high, low_poses, high_poses)


def _check(samples: int, starts: int) -> None:
    if not 1 <= starts <= samples:
        raise ValueError(f"Got samples={samples} and starts={starts}; expected 1 <= starts <= samples.")


@keyed
def _minimum(function: Any, region: Region, *, samples: int, starts: int, steps: int) -> Extreme:
    def value(unit):
        found = function(region.from_unit(unit))
        return jnp.where(jnp.isnan(found), jnp.inf, found)

    sample = Sample(region, jnp.zeros(region.unit_dimension, jnp.uint32), (), samples)
    units = jax.vmap(sample.unit)(jnp.arange(samples))
    # the place of the minimum stays fixed under differentiation: the search has no derivative
    search, constants = jax.closure_convert(value, units[0])
    constants = lax.stop_gradient(constants)

    def frozen(unit):
        return search(unit, *constants)

    first = jax.vmap(frozen)(units)
    best = jnp.argsort(first)[:starts]
    width = jnp.asarray(samples, units.dtype) ** (-1 / units.shape[1])
    ends, values = jax.vmap(lambda unit, least: _narrow(frozen, unit, least, width, steps))(units[best], first[best])
    pose = region.from_unit(ends[jnp.argmin(values)])
    return Extreme(function(pose), pose)


def _narrow(value, unit, least, width, steps: int):
    """Random search about the best point, in a cube that shrinks whenever it holds nothing better."""

    def step(number, state):
        unit, least, width = state
        key = jax.random.fold_in(jax.random.key(0), number)
        probes = unit[None] + width * jax.random.uniform(key, (_PROBES, unit.shape[0]), unit.dtype, -1, 1)
        probes = jnp.clip(probes, 0, 1)
        values = jax.vmap(value)(probes)
        better = jnp.min(values) < least
        unit = jnp.where(better, probes[jnp.argmin(values)], unit)
        return unit, jnp.minimum(jnp.min(values), least), jnp.where(better, width, width * _SHRINK)

    return lax.fori_loop(0, steps, step, (unit, least, width))[:2]
