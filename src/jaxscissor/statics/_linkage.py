"""The forces in the pins and bars of one leg, in its plane, as a linear system."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.left_inverse import left_inverse
from jaxscissor._engine.numerics import Scalar, safe_divide, safe_sqrt
from jaxscissor._engine.vectors import Vec
from jaxscissor.robots._bodies import PLATFORM, Connection
from jaxscissor.robots._contract import Attachment, Joints, Leg
from jaxscissor.statics._bodies import Bodies, bar_ends, centers_of, in_space


class Linkage(NamedTuple):
    """The bars of a leg in its plane, and what every load does to them. Loads count on the last axis.

    The first loads are units of what the leg exerts on the platform, one per number of the attachment; the last one is
    the bars' own weight.
    """

    regular: Scalar
    axes: jax.Array  # (2, 3) of the plane, in the base frame
    starts: jax.Array  # (bars, 2) in the plane
    directions: jax.Array  # (bars, 2)
    lengths: jax.Array  # (bars,)
    points: jax.Array  # (connections, 2)
    forces: jax.Array  # (connections, 2, loads) that the first part exerts on the second
    moments: jax.Array  # (connections, loads), in the plane
    weights: jax.Array  # (bars, 2), whole


def linkage_of(
    leg: Leg, joints: Joints, attachment: Attachment, bodies: Bodies | None, gravity: jax.Array
) -> tuple[Linkage, list[tuple[int, int]]]:
    """Solve a leg's bars for every load; and the parts that each connection holds together.

    1. The plane is normal to the first axis about which two bars turn, or if none do, any two parts.
    2. Every connection carries a force with two components in it. Without a turn it carries a moment as well, and a
       turn that is a joint of the robot is held and does so, too. A slide that is neither a joint nor geared to another
       slide moves freely: nothing acts along it. The platform takes what the leg exerts on it, and no moment; across
       the plane of motion of a planar robot it takes any force.
    3. Three equations of equilibrium per bar, moments in units of the longest bar, are solved for all loads.

    Raises:
      ValueError: a leg that says nothing about its connections, holds the platform by other than one point, or is
        over-constrained in its own plane.
    """
    connections = list(leg.connections(joints, attachment))
    _check(leg, connections, attachment)
    parts = [(connection.first, connection.second) for connection in connections]
    starts, ends = bar_ends(leg, joints, attachment)
    normal = _normal(connections)
    across = ends[0] - starts[0]
    across = _unit(across - normal * jnp.sum(across * normal))
    axes = jnp.stack([across, jnp.cross(normal, across)])
    origin = starts[:1]
    starts, ends, points = (
        (place - origin) @ axes.T for place in (starts, ends, jnp.stack([in_space(c.point) for c in connections]))
    )
    lengths = safe_sqrt(jnp.sum((ends - starts) ** 2, axis=1))
    scale = jnp.max(lengths)

    at, ways, turns = _unknowns(connections, axes, len(attachment.components))
    columns = _on_body(ways, points[at], scale) + jnp.asarray(np.outer(turns, [0, 0, 1]), ways.dtype)
    signs = jnp.asarray(_incidence(parts, at, len(lengths)), ways.dtype)
    matrix = jnp.einsum("bj,jr->brj", signs, columns).reshape(-1, len(at))
    if matrix.shape[0] < matrix.shape[1]:
        raise ValueError(
            f"Got a {type(leg).__name__} with {matrix.shape[1]} forces in its plane for {matrix.shape[0]} equations of "
            "equilibrium: it is over-constrained. Expected connections() with fewer constraints."
        )
    state = (joints, attachment, bodies, gravity)
    loads, weights, reactions = _loads(leg, state, axes, origin, points, parts, scale, len(lengths))
    inverse = left_inverse(matrix)
    found = inverse @ -loads
    held = jnp.asarray(np.arange(len(parts))[:, None] == at, ways.dtype)  # which unknowns are of which connection
    forces = reactions + jnp.einsum("cj,jx,jl->cxl", held, ways, found)
    moments = jnp.einsum("cj,jl->cl", held * jnp.asarray(turns, ways.dtype)[None], found) * scale
    directions = (ends - starts) * safe_divide(1, lengths)[:, None]
    solved = Linkage(jnp.any(inverse != 0), axes, starts, directions, lengths, points, forces, moments, weights)
    return solved, parts


def _unknowns(connections: list[Connection], axes: jax.Array, size: int) -> tuple[np.ndarray, jax.Array, np.ndarray]:
    """What the connections carry in the plane: of which one each unknown is, its direction, whether it is a moment."""
    at, ways, turns = [], [], []
    still = jnp.zeros(2, axes.dtype)
    for number, connection in enumerate(connections):
        if connection.second == PLATFORM:  # what acts along the attachment's numbers is given
            carried = [axes[:, 2]] if size < len(connection.point.components) else []
            held = False
        else:
            carried, held = _carried(connection, axes)
        at += [number] * (len(carried) + held)
        ways += [*carried, *[still] * held]
        turns += [*[0] * len(carried), *[1] * held]
    return np.array(at), jnp.stack(ways), np.array(turns)


def _carried(connection: Connection, axes: jax.Array) -> tuple[list[jax.Array], bool]:
    """Directions of the forces that a connection between bars carries in the plane, and whether a moment."""
    kinds = {freedom.kind for freedom in connection.freedoms if not freedom.joints and freedom.geared is None}
    ways = list(jnp.eye(2, dtype=axes.dtype))
    if "slide" in kinds:
        along = next(axes @ in_space(f.axis) for f in connection.freedoms if f.kind == "slide")  # type: ignore[arg-type]
        ways = [jnp.stack([-along[1], along[0]])]
    return ways, not kinds & {"turn", "ball"}


def _on_body(forces: jax.Array, points: jax.Array, scale: Scalar) -> jax.Array:
    """Forces ``(n, 2)`` at points, and their moments about the origin ``(n, 3)``."""
    moments = (points[:, 0] * forces[:, 1] - points[:, 1] * forces[:, 0]) / scale
    return jnp.concatenate([forces, moments[:, None]], axis=1)


def _incidence(parts: list[tuple[int, int]], at: np.ndarray, bars: int) -> np.ndarray:
    """Which bars each unknown acts on ``(bars, unknowns)``: +1 on the second part, -1 on the first."""
    first, second = np.array(parts)[at].T
    numbers = np.arange(bars)[:, None]
    return 1.0 * (second == numbers) - (first == numbers)


def _loads(
    leg: Leg,
    state: tuple[Joints, Attachment, Bodies | None, jax.Array],
    axes: jax.Array,
    origin: jax.Array,
    points: jax.Array,
    parts: list[tuple[int, int]],
    scale: Scalar,
    bars: int,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """What acts on the bars from outside, ``(3 bars, loads)``; weights per bar; and the force on the platform."""
    joints, attachment, bodies, gravity = state
    size = len(attachment.components)
    holds = next(i for i, pair in enumerate(parts) if pair[1] == PLATFORM)
    units = axes[:, :size]  # components in the plane of the units of the attachment's numbers
    on_bar = _on_body(-units.T, jnp.broadcast_to(points[holds], (size, 2)), scale)
    loads = jnp.zeros((bars, 3, size + 1), axes.dtype).at[parts[holds][0], :, :size].set(on_bar.T)
    reactions = jnp.zeros((len(parts), 2, size + 1), axes.dtype).at[holds, :, :size].set(units)
    weights = jnp.zeros((bars, 2), axes.dtype)
    if bodies is not None:
        weights = bodies.masses[:, None] * (axes @ gravity)[None]
        centers = (centers_of(leg, joints, attachment, bodies) - origin) @ axes.T
        loads = loads.at[:, :, size].set(_on_body(weights, centers, scale))
    return loads.reshape(3 * bars, -1), weights, reactions


def _normal(connections: list[Connection]) -> jax.Array:
    turns = [
        (min(connection.first, connection.second) < 0, freedom.axis)
        for connection in connections
        for freedom in connection.freedoms
        if freedom.kind == "turn"
    ]
    return in_space(min(turns, key=lambda turn: turn[0])[1])  # type: ignore[arg-type]


def _check(leg: Leg, connections: list[Connection], attachment: Attachment) -> None:
    name = type(leg).__name__
    if not connections:
        raise ValueError(f"Got a {name} without connections; expected connections(joints, attachment) of its class.")
    holding = [connection for connection in connections if connection.second == PLATFORM]
    if len(holding) != 1 or holding[0].first < 0 or not isinstance(attachment, Vec):
        raise ValueError(
            f"Got a {name} whose bars hold the platform in {len(holding)} connections; expected one, from a bar to "
            "PLATFORM, and a point as attachment."
        )
    if not any(freedom.kind == "turn" for connection in connections for freedom in connection.freedoms):
        raise ValueError(f"Got a {name} none of whose connections turns about an axis; its plane is not known.")


def _unit(values: jax.Array) -> jax.Array:
    return values * safe_divide(1, safe_sqrt(jnp.sum(values**2)))
