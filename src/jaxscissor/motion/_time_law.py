"""When to be where on a path of joints: as early as the joints' velocities and accelerations allow."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.numerics import Scalar, safe_divide, safe_sqrt
from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_arrays, pytree
from jaxscissor._engine.types import Numbers


@pytree
class TimeLaw:
    """Times along a path of ``n`` samples, from rest to rest; ``nan`` beyond its end.

    Attributes:
      times: ``(n,)`` from zero; in the unit of time of the limits.
      speed: ``(n,)`` samples per unit of time.
      velocities: ``(n, m)`` of the joints.
      accelerations: ``(n, m)`` of the joints just after each sample; at the last one, just before it.
    """

    times: jax.Array
    speed: jax.Array
    velocities: jax.Array
    accelerations: jax.Array


@one_pose()
def time_parametrize(actuated: Numbers, *, max_velocity: Numbers, max_acceleration: Numbers) -> TimeLaw:
    """The fastest law of time along a path of joints under their limits, from rest to rest.

    Time-optimal path parametrization by reachability, TOPP-RA [Pham and Pham, IEEE Transactions on Robotics 34(3),
    2018], which solves the problem of [Bobrow, Dubowsky and Gibson, 1985] on samples. With x the square of the path's
    speed and u its acceleration, the limits |q' u + q'' x| <= a and |q'| sqrt(x) <= v are linear in (u, x), and
    x grows by 2 u from sample to sample:

    1. q' and q'' are differences of second order of the samples.
    2. Backward from rest at the end: the greatest x at each sample from which the next one's can be reached, by
       eliminating u from all pairs of inequalities [Fourier and Motzkin]. The limits hold at both ends of an interval.
    3. Forward from rest: the greatest u that the limits and the next sample's greatest x allow.
    4. An interval takes 2 / (sqrt(x) + sqrt(x of the next sample)).

    So at every sample a velocity is at its limit, or an acceleration just before or after it, but where one limit hands
    over to another. The time is the least one to the second order of the distance of the samples.

    Args:
      actuated: ``(n, m)`` joints along a smooth path, such as ``robot.actuated(follow(...).joints)``, evenly spread
        in a parameter of the path; differentiable. The path ends before the first row that is not finite.
      max_velocity, max_acceleration: ``(m,)`` or one number, positive, per unit of time and its square.

    Returns:
      ``motion.TimeLaw``. The limits hold at the samples; between them a curved path may exceed those of acceleration
      by an amount of the order of the distance of the samples. A path that rests takes no time.

    Raises:
      ValueError: wrong shape, less than three samples, or limits that do not fit the joints.

    Example:
      One joint, 3 m at 1 m/s and 1 m/s^2: one second to start, two at full speed, one to stop:

      >>> import jax.numpy as jnp, jaxscissor as js
      >>> path = jnp.linspace(0.0, 3.0, 301)[:, None]
      >>> law = js.motion.time_parametrize(path, max_velocity=1.0, max_acceleration=1.0)
      >>> f"{float(law.times[-1]):.3f} s, at most {float(law.velocities.max()):.3f} m/s"
      '4.000 s, at most 1.000 m/s'
    """
    path, velocity, acceleration = as_arrays(actuated, max_velocity, max_acceleration)
    if path.ndim != 2 or len(path) < 3:
        raise ValueError(f"Got joints of shape {path.shape}; expected (n, m), n at least 3.")
    for name, limit in (("max_velocity", velocity), ("max_acceleration", acceleration)):
        if limit.shape not in ((), path.shape[1:]):
            raise ValueError(f"Got {name} of shape {limit.shape}; expected one number or {path.shape[1:]}.")
    velocity, acceleration = (jnp.broadcast_to(limit, path.shape[1:]) for limit in (velocity, acceleration))
    return _time_law(path, velocity, acceleration)


def _time_law(path: jax.Array, velocity: jax.Array, acceleration: jax.Array) -> TimeLaw:
    number = jnp.arange(len(path))
    last = jnp.sum(jnp.cumprod(jnp.all(jnp.isfinite(path), axis=1))) - 1
    slope, bend = _derivatives(path, last)
    tops = _fastest(slope / velocity[None], path / velocity[None])
    stages = _stages(slope / acceleration[None], bend / acceleration[None])

    def backward(best: Scalar, case: tuple[Scalar, _Stage, Scalar]) -> tuple[Scalar, Scalar]:
        number, stage, top = case
        found = jnp.where(number < last, _controllable(stage, best, top), 0)
        return found, found

    rest = jnp.zeros_like(tops[0])
    _, best = lax.scan(backward, rest, (number[:-1], stages, tops[:-1]), reverse=True)
    best = jnp.append(best, rest)

    def forward(x: Scalar, case: tuple[_Stage, Scalar]) -> tuple[Scalar, tuple[Scalar, Scalar]]:
        stage, next_best = case
        u = _greatest(stage, x, next_best)
        moved = jnp.clip(x + 2 * u, 0, next_best)
        return moved, (moved, u)

    _, (squares, push) = lax.scan(forward, rest, (stages, best[1:]))
    squares = jnp.concatenate([rest[None], squares])
    speed, taken = safe_sqrt(squares), number <= last
    gone = jnp.cumsum(jnp.where(taken[1:], safe_divide(2, speed[1:] + speed[:-1]), 0))
    push = jnp.append(push, rest)[jnp.where(number < last, number, number - 1)]
    values = TimeLaw(
        times=jnp.concatenate([rest[None], gone]),
        speed=speed,
        velocities=slope * speed[:, None],
        accelerations=slope * push[:, None] + bend * squares[:, None],
    )
    return jax.tree.map(lambda x: jnp.where(taken if x.ndim == 1 else taken[:, None], x, jnp.nan), values)


def _derivatives(path: jax.Array, last: Scalar) -> tuple[jax.Array, jax.Array]:
    """q' and q'' by the sample, of second order also at the ends of the path; beyond them the path rests."""
    number = jnp.arange(len(path))
    path = path[jnp.clip(number, 0, jnp.maximum(last, 0))]
    path = jnp.where(jnp.isfinite(path), path, 0)
    middle = jnp.clip(number, 1, jnp.maximum(last - 1, 1))
    bend = path[middle + 1] - 2 * path[middle] + path[middle - 1]
    slope = (path[middle + 1] - path[middle - 1]) / 2 + (number - middle).astype(path.dtype)[:, None] * bend
    return slope, bend


def _fastest(slope: jax.Array, path: jax.Array) -> jax.Array:
    """Greatest x by the velocities, finite also where the path rests: next to no time passes there."""
    steps = jnp.where(jnp.isfinite(path[1:] - path[:-1]), jnp.abs(path[1:] - path[:-1]), 0)
    whole = lax.stop_gradient(jnp.sum(jnp.max(steps, axis=1)))
    least = float(jnp.finfo(path.dtype).eps) ** 0.5 * jnp.where(whole > 0, whole, 1)
    return 1 / jnp.maximum(jnp.max(jnp.abs(slope), axis=1), least) ** 2


class _Stage(NamedTuple):
    """Inequalities a u + b x <= 1 of one interval, by the accelerations at its start and at its end, ``(2 m,)``.

    Each stands for its opposite too.
    """

    a: jax.Array
    b: jax.Array


def _stages(slope: jax.Array, bend: jax.Array) -> _Stage:
    """At the end of an interval x is x + 2 u."""
    ahead = slope[1:] + 2 * bend[1:]
    return _Stage(jnp.concatenate([slope[:-1], ahead], axis=1), jnp.concatenate([bend[:-1], bend[1:]], axis=1))


def _inequalities(stage: _Stage, best: Scalar) -> tuple[jax.Array, jax.Array, jax.Array]:
    """All a u + b x <= c of an interval: of the accelerations, and 0 <= x + 2 u <= best."""
    one, zero = jnp.ones_like(best), jnp.zeros_like(best)
    a = jnp.concatenate([stage.a, -stage.a, jnp.stack([2 * one, -2 * one])])
    b = jnp.concatenate([stage.b, -stage.b, jnp.stack([one, -one])])
    c = jnp.concatenate([jnp.ones_like(stage.a), jnp.ones_like(stage.a), jnp.stack([best, zero])])
    return a, b, c


def _controllable(stage: _Stage, best: Scalar, top: Scalar) -> Scalar:
    """Greatest x for which there is a u that leads to at most the next sample's best.

    Rest is always allowed, so that every inequality that is left without u bounds x from above or not at all.
    """
    a, b, c = _inequalities(stage, best)
    up, down = jnp.maximum(a, 0)[:, None], jnp.maximum(-a, 0)[None]
    slope, room = b[:, None] * down + b[None] * up, c[:, None] * down + c[None] * up
    pair = (up > 0) & (down > 0) & (slope > 0)
    bounds = jnp.where(pair, safe_divide(room, jnp.where(pair, slope, 0)), jnp.inf)
    alone = (a == 0) & (b > 0)
    bounds_alone = jnp.where(alone, safe_divide(c, jnp.where(alone, b, 0)), jnp.inf)
    return jnp.minimum(jnp.minimum(jnp.min(bounds), jnp.min(bounds_alone)), top)


def _greatest(stage: _Stage, x: Scalar, best: Scalar) -> Scalar:
    """Greatest u at a given x."""
    a, b, c = _inequalities(stage, best)
    above = a > 0
    return jnp.min(jnp.where(above, safe_divide(c - b * x, jnp.where(above, a, 0)), jnp.inf))
