"""How much of a region a robot reaches, measured along lines, with the exact derivative of that measure."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.bracket import last_inside
from jaxscissor._engine.cpu.chunks import lanes_together
from jaxscissor._engine.cpu.fence import fence
from jaxscissor._engine.map_reduce import Execution, differentiable_sum, planned
from jaxscissor._engine.numerics import safe_divide
from jaxscissor._engine.programs import run_once
from jaxscissor._engine.pytree import as_floats, float_dtype, is_concrete
from jaxscissor._engine.types import PyTree
from jaxscissor.regions._regions import Box, Region, Sample
from jaxscissor.regions._samples import without_size
from jaxscissor.robots._contract import Mechanism
from jaxscissor.workspace._reached import check_region, region_margin

_PARTS = 8  # samplings whose changes of sign are refined together
_BLOCK = 512  # places on the rays that are refined at once
_SHRINKS = 16  # steps towards an extremum of the margin, each leaving about 0.7 of the interval
_GOLDEN = 0.381966


class _Settings(NamedTuple):
    """What the compiled program depends on."""

    axes: tuple[int, ...]
    cells: int
    part: int  # rays whose margins are sampled together


class _Rays(NamedTuple):
    """Rays of a chunk ``(n, ...)``: where in the unit cube they start, whereto, points along them, margins there."""

    starts: jax.Array
    directions: jax.Array
    points: jax.Array
    margins: jax.Array


def ray_fraction(
    robot: Mechanism,
    region: Region,
    *,
    rays: int = 4096,
    axes: Sequence[int] = (0,),
    cells: int = 64,
    seed: int = 0,
    execution: Execution = Execution(),
) -> jax.Array:
    """Fraction of a region that a robot reaches, with its exact derivative: no smoothing, folds included.

    A ray is one coordinate of the region's unit cube running from 0 to 1 while the others are fixed. The
    value is the mean over quasi-random rays of the reached length. Along each ray every place where the
    margin of ``feasibility`` changes sign is located to rounding, and moves with the design by the implicit
    function theorem, dt/dtheta = -(dm/dtheta) / (dm/dt).

    With rays along one axis the derivative is exactly that of the value given, whatever their number, and
    tends with it to the integral over the workspace's boundary; few rays that nearly touch the boundary then
    have much weight. With several axes, each crossing counts by the share of its axis in the squared slope of
    the margin, so that no ray needs to touch: the derivative is the same integral and converges faster, but
    is not that of the mean over these very rays.

    The margin is sampled at the ends of equal cells. Every change of sign between two is found, however
    many there are. Gaps and components that lie between two samples are found where the samples around
    them show an extremum of the margin close to zero, if they are wider than a hundredth of a cell; the
    others are missed.

    Args:
      robot: the robot; every array in it is differentiable, once.
      region: of poses, such as ``Cylinder`` or ``workspace.PosePath``; its arrays are differentiable, too.
      rays: number of rays along each axis; one where there is no other axis, as of a ``workspace.PosePath``.
      axes: coordinates of the unit cube along which rays run; 0 is the radius of a cylinder or disc, and the
        first coordinate of a box. The region must have an extent in them.
      cells: cells along each ray.
      seed: shifts the rays, for an independent sample.
      execution: see ``workspace.fraction``; ``chunk_size`` is not used; the checkpoint
        of a gradient is another job than that of the value.

    Returns:
      A scalar between 0 and 1. Memory does not grow with the number of rays; map over robots with ``vmap``.
      The derivative is right to six digits of its largest entry. Where two limits coincide on a whole piece
      of the boundary (crank and link of a straight-line Scott linkage), the measure has a kink, and the
      derivative is that towards one of its sides. A crossing where the margin does not change to first order
      does not move.

    Raises:
      ValueError: a region of poses of another dimension, axes it does not have or along which it has no extent,
        fewer than one ray or cell;
        a checkpoint of another job, or one under ``jit`` or ``vmap``.

    Example:
      >>> import jax, jaxscissor as js
      >>> robot = js.NavaroII.prototype()
      >>> region = js.Box([0.0, 0.0, -0.3], [90.0, 80.0, 0.3])
      >>> value, gradient = jax.value_and_grad(js.workspace.ray_fraction)(robot, region, rays=512)
      >>> round(float(value), 2), bool(gradient.stroke[1] > 0)  # longer legs reach farther
      (0.72, True)
    """
    robot, region = as_floats(robot, region)
    axes = tuple(axes)
    _check(robot, region, rays, axes, cells)
    others = region.unit_dimension - 1
    dtype = float_dtype(region)
    rays = rays if others else 1
    sample = Box(jnp.zeros(others, dtype), jnp.ones(others, dtype)).quasi_random(rays, seed)
    part = max(lanes_together() // cells, 1)
    plan = planned(rays * len(axes), dataclasses.replace(execution, chunk_size=part * _PARTS))
    if execution.mesh is not None:
        part = min(part, plan.chunk)
        plan = dataclasses.replace(plan, chunk=part * -(-plan.chunk // part))
    else:  # whatever the number of rays: one program
        plan = dataclasses.replace(plan, chunk=part * _PARTS)
    settings, inputs = _Settings(axes, cells, part), {"sample": without_size(sample)}
    return differentiable_sum(_add_lengths, _add_rays, settings, plan, (robot, region), inputs) / plan.size


def _check(robot: Mechanism, region: Region, rays: int, axes: tuple[int, ...], cells: int) -> None:
    dimension = region.unit_dimension
    if rays < 1 or cells < 1:
        raise ValueError(f"Got rays={rays} and cells={cells}; expected at least one of each.")
    if not axes or len(set(axes)) < len(axes) or not set(axes) <= set(range(dimension)):
        raise ValueError(f"Got axes={axes}; expected some of the axes 0 to {dimension - 1} of the region's unit cube.")
    check_region(robot, region)
    if is_concrete(region):
        with jax.ensure_compile_time_eval():
            flat = [axis for axis, moves in zip(axes, _moved(region, axes), strict=True) if not moves]
        if flat:
            raise ValueError(
                f"Got axes={axes}, but the region has no extent along {flat}; rays need some. Its axes are 0 to "
                f"{dimension - 1}, in the order of its unit cube."
            )


@partial(run_once, static_argnums=1)
def _moved(region: Region, axes: tuple[int, ...]) -> tuple[jax.Array, ...]:
    """Whether the poses of a region change along each axis of its unit cube."""
    middle = jnp.full(region.unit_dimension, 0.4, float_dtype(region))
    ends = [[region.from_unit(middle.at[axis].set(end)) for end in (0.1, 0.6)] for axis in axes]
    return tuple(jnp.any(one != other) for one, other in ends)


def _add_lengths(
    settings: _Settings, total: PyTree, indices: jax.Array, counted: jax.Array, design: PyTree, sample: Sample
):
    """Add the reached lengths of some rays."""
    return _add_rays(settings, (total, ()), indices, counted, design, sample)[0]


def _add_rays(
    settings: _Settings, totals: PyTree, indices: jax.Array, counted: jax.Array, design: PyTree, sample: Sample
):
    """Add the reached lengths of some rays and, if the totals hold a gradient, their part of the boundary integral."""
    lines = fence(jax.vmap(partial(_line, settings.axes, sample))(indices))  # every cell would draw them anew
    return _chunk(settings, design, lines, counted, totals)


def _line(axes: tuple[int, ...], sample: Sample, number: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Start and direction ``(d,)`` of a ray in the unit cube; neighbours run along different axes."""
    others = sample.pose(number // len(axes))
    axis = jnp.array(axes)[number % len(axes)]
    places = jnp.arange(others.shape[0] + 1)
    ahead, behind = jnp.pad(others, (0, 1)), jnp.pad(others, (1, 0))
    start = jnp.where(places < axis, ahead, jnp.where(places > axis, behind, 0))
    return start, (places == axis).astype(others.dtype)


def _margin(design: tuple[Mechanism, Region], start: jax.Array, direction: jax.Array, point: jax.Array) -> jax.Array:
    robot, region = design
    return region_margin(robot, region, region.from_unit(start + point * direction))


def _chunk(settings: _Settings, design: PyTree, lines: tuple[jax.Array, jax.Array], counted: jax.Array, totals: PyTree):
    """Add a chunk's reached lengths, and their gradient, to the totals.

    1. Sample the margin along every ray and add its extrema, so that it changes its sign at most once per interval.
    2. A ray that ends inside counts its whole length 1; every change of sign at t then adds t or takes it away.
    3. At each change: narrow it down, and place it by one Newton step, t = t0 - m / (dm/dt).
    4. Its derivative by the design is -(dm/ddesign) / (dm/dt), weighted with (dm/dt)^2 / |grad m|^2 times the number of
       axes: rays along all axes together then measure the boundary once, and no ray that grazes it weighs much.
    """
    margins = jax.vmap(_margin, (None, 0, 0, 0))
    rays = _split_at_extrema(
        partial(margins, design), _sampled(partial(margins, design), lines, settings, counted), counted
    )
    inside = rays.margins >= 0
    reached_ends = jnp.sum(counted & inside[:, -1], dtype=jnp.int32)
    used_axes = jnp.zeros(lines[0].shape[1], rays.points.dtype).at[jnp.array(settings.axes)].set(1)

    def add(row: jax.Array, cell: jax.Array, used: jax.Array, totals: PyTree):
        low, high = (rays.points[row, cell + i] for i in (0, 1))
        at_low, at_high = (rays.margins[row, cell + i] for i in (0, 1))
        line = rays.starts[row], rays.directions[row]
        sign = jnp.where(used, jnp.where(inside[row, cell], 1, -1), 0).astype(low.dtype)
        point, beyond, left = last_inside(lambda t: margins(design, *line, t), low, high, at_low, at_high, used)
        _, pull = jax.vjp(lambda d, start: margins(d, start, line[1], point), design, line[0])
        slopes = fence(pull(jnp.ones_like(point))[1])  # the crossing and its weight take them
        slope = jnp.sum(slopes * line[1], axis=1)
        share = jnp.clip(-safe_divide(left, slope * (beyond - point)), 0, 1)
        crossing = point + share * (beyond - point)
        value, gradient = totals
        if jax.tree.leaves(gradient):
            steepness2 = jnp.sum(slopes**2 * used_axes[None], axis=1)
            moved = pull(-sign * len(settings.axes) * safe_divide(slope, steepness2))[0]
            gradient = jax.tree.map(jnp.add, gradient, moved)
        return value + jnp.sum(sign * crossing), gradient

    changes = (inside[:, 1:] != inside[:, :-1]) & counted[:, None]
    return _for_each(changes, add, (totals[0] + reached_ends.astype(totals[0].dtype), totals[1]))


def _sampled(
    judge: Callable[..., Any], lines: tuple[jax.Array, jax.Array], settings: _Settings, counted: jax.Array
) -> _Rays:
    """Margins at the ends of all cells. Both ends of a ray are repeated, farther from zero, to be extrema too."""
    rays, count = lines[0].shape[0], settings.cells + 1
    grid = jnp.arange(count, dtype=lines[0].dtype) / settings.cells
    points = jnp.broadcast_to(grid, (rays, count))

    def sample(part: jax.Array, margins: jax.Array):
        here = (lax.dynamic_slice_in_dim(x, part * settings.part, settings.part) for x in lines)
        found = judge(*(jnp.repeat(x, count, axis=0) for x in here), jnp.tile(grid, settings.part))
        return lax.dynamic_update_slice_in_dim(margins, found.reshape(-1, count), part * settings.part, 0)

    parts = (jnp.sum(counted, dtype=jnp.int32) + settings.part - 1) // settings.part  # the counted rays come first
    margins = lax.fori_loop(0, parts, sample, jnp.zeros((rays, count), grid.dtype))
    points = jnp.concatenate([points[:, :1], points, points[:, -1:]], axis=1)
    margins = jnp.concatenate([2 * margins[:, :1], margins, 2 * margins[:, -1:]], axis=1)
    return _Rays(*lines, points, margins)


def _split_at_extrema(judge: Callable[..., Any], rays: _Rays, counted: jax.Array) -> _Rays:
    """Move samples at which the margin is closest to zero to where it is closest, or has changed its sign.

    Between samples it can come closer by no more than it differs between neighbours, kinks included.
    """
    before, here, after = (jnp.abs(rays.margins[:, i : i - 2 or None]) for i in range(3))
    inside = rays.margins >= 0
    alike = (inside[:, :-2] == inside[:, 1:-1]) & (inside[:, 1:-1] == inside[:, 2:])
    close = (here <= before) & (here < after) & (here < jnp.maximum(before, after) - here)

    def move(row: jax.Array, cell: jax.Array, used: jax.Array, found: PyTree):
        points, margins = found
        triple = tuple(points[row, cell + i] for i in range(3))
        side = jnp.where(inside[row, cell], 1, -1).astype(points.dtype)
        heights = tuple(side * margins[row, cell + i] for i in range(3))
        line = rays.starts[row], rays.directions[row]
        point, height = _lowest(lambda t: side * judge(*line, t), triple, heights)
        place = jnp.where(used, row, points.shape[0]), cell + 1
        return points.at[place].set(point, mode="drop"), margins.at[place].set(side * height, mode="drop")

    points, margins = _for_each(alike & close & counted[:, None], move, (rays.points, rays.margins))
    return rays._replace(points=points, margins=margins)


def _for_each(marked: jax.Array, visit: Callable[..., Any], carry: PyTree):
    """Visit all marked places (row, column), a block of them at a time: their number is not limited."""
    block, columns = min(_BLOCK, marked.size), marked.shape[1]
    places = jnp.nonzero(marked.ravel(), size=marked.size, fill_value=0)[0].astype(jnp.int32)
    places, count = jnp.pad(places, (0, block)), jnp.sum(marked, dtype=jnp.int32)

    def step(state: PyTree):
        first, carry = state
        here = lax.dynamic_slice(places, (first,), (block,))
        used = first + jnp.arange(block, dtype=jnp.int32) < count
        return first + block, visit(here // columns, here % columns, used, carry)

    return lax.while_loop(lambda state: state[0] < count, step, (jnp.int32(0), carry))[1]


def _lowest(
    function: Callable[..., Any], points: tuple[jax.Array, ...], heights: tuple[jax.Array, ...]
) -> tuple[jax.Array, jax.Array]:
    """Point of the least height between the outer of three, or one at which the height is negative."""

    def step(_: object, state: PyTree):
        (a, b, c), (fa, fb, fc) = state
        right = c - b > b - a
        x = b + _GOLDEN * jnp.where(right, c - b, a - b)
        x = jnp.where(fb < 0, b, x)
        fx = function(x)
        lower = fx < fb
        # the new triple: (b, x, c) or (a, b, x) on the right, (a, x, b) or (x, b, c) on the left
        low, high = jnp.where(right, b, x), jnp.where(right, x, b)
        f_low, f_high = jnp.where(right, fb, fx), jnp.where(right, fx, fb)
        middle, f_middle = jnp.where(lower, x, b), jnp.where(lower, fx, fb)
        upper = right == lower
        first, f_first = jnp.where(upper, low, a), jnp.where(upper, f_low, fa)
        last, f_last = jnp.where(upper, c, high), jnp.where(upper, fc, f_high)
        return (first, middle, last), (f_first, f_middle, f_last)

    (_, point, _), (_, height, _) = lax.fori_loop(0, _SHRINKS, step, (points, heights))
    return point, height
