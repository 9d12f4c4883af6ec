"""Axial force and bending moment along the bars of a leg, and the energy that they store."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxscissor._engine.numerics import Scalar, safe_divide
from jaxscissor.statics._linkage import Linkage
from jaxscissor.statics._materials import Section

_NODES = np.array([-1.0, 0.0, 1.0]) * np.sqrt(0.6) / 2 + 0.5  # Gauss's rule of order five, on a unit interval
_SHARES = np.array([5.0, 8.0, 5.0]) / 18


class Beams(NamedTuple):
    """Stretches of bars between points that forces act on, ``(bars, stretches)``; loads count on the last axis.

    Attributes:
      low, high: where each begins and ends along its bar.
      axial: ``(2, bars, stretches, loads)``, N = axial[0] + axial[1] s, tension positive.
      bending: ``(3, ...)``, M = bending[0] + bending[1] s + bending[2] s^2.
    """

    low: jax.Array
    high: jax.Array
    axial: jax.Array
    bending: jax.Array


def beams_of(linkage: Linkage, parts: list[tuple[int, int]]) -> Beams:
    """Cut every bar in the middle of each stretch, and balance what acts on it before the cut."""
    at, sign = _touching(parts, linkage.lengths.shape[0])
    sign = jnp.asarray(sign, linkage.points.dtype)
    along = linkage.directions
    normal = jnp.stack([-along[:, 1], along[:, 0]], axis=1)
    reach = jnp.einsum("bkc,bc->bk", linkage.points[at] - linkage.starts[:, None], along)
    reach = jnp.where(sign != 0, reach, 0)
    forces = linkage.forces[at] * sign[:, :, None, None]  # (bars, points, 2, loads)
    drawn, across = (jnp.einsum("bkcl,bc->bkl", forces, axis) for axis in (along, normal))
    turning = reach[:, :, None] * across + linkage.moments[at] * sign[:, :, None]

    ends = jnp.stack([jnp.zeros_like(linkage.lengths), linkage.lengths], axis=1)
    knots = jnp.sort(jnp.concatenate([ends, reach], axis=1), axis=1)
    low, high = knots[:, :-1], knots[:, 1:]
    before = ((low + high)[:, :, None] / 2 > reach[:, None]).astype(reach.dtype)  # (bars, stretches, points)
    sums = [jnp.einsum("bsk,bkl->bsl", before, part) for part in (drawn, across, turning)]
    own = linkage.weights / linkage.lengths[:, None]
    own_along, own_across = (jnp.sum(own * axis, axis=1) for axis in (along, normal))
    weighs = jnp.zeros_like(sums[0]).at[:, :, -1]  # the last load is the weight
    own_axial, own_bending = (weighs.set(part[:, None]) for part in (-own_along, own_across / 2))
    return Beams(low, high, jnp.stack([-sums[0], own_axial]), jnp.stack([-sums[2], sums[1], own_bending]))


def _touching(parts: list[tuple[int, int]], bars: int) -> tuple[np.ndarray, np.ndarray]:
    """The connections of every bar, and their signs on it: of rows filled up with zeros, both ``(bars, most)``."""
    found = [
        [(at, 2 * side - 1) for at, pair in enumerate(parts) for side in (0, 1) if pair[side] == bar]
        for bar in range(bars)
    ]
    most = max(map(len, found))
    filled = np.array([row + [(0, 0)] * (most - len(row)) for row in found])
    return filled[..., 0], filled[..., 1]


def combined(beams: Beams, loads: jax.Array) -> Beams:
    """The same under one load, the sum of all ``(loads,)``."""
    return beams._replace(axial=beams.axial @ loads, bending=beams.bending @ loads)


def compliance_of(beams: Beams, section: Section) -> jax.Array:
    """Second derivative of the complementary energy by the loads ``(loads, loads)``.

    The energy is the integral of N^2 / 2 E A + M^2 / 2 E I along all bars, exact for what Gauss's rule integrates.
    """
    shape = beams.low.shape
    width = beams.high - beams.low
    total = jnp.zeros((), width.dtype)
    for node, share in zip(_NODES.tolist(), _SHARES.tolist(), strict=True):
        place = beams.low + width * node
        weight = share * width
        for field, stiffness in ((beams.axial, section.axial_stiffness), (beams.bending, section.bending_stiffness)):
            value = _at(field, place[:, :, None])
            scale = weight / jnp.broadcast_to(stiffness, shape[:1])[:, None]
            total = total + jnp.einsum("bsl,bsm,bs->lm", value, value, scale)
    return total


def greatest(beams: Beams, section: Section | None) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Per bar ``(bars,)`` under one load: the axial force of greatest size, the greatest moment, the greatest stress.

    They are sought at both ends of every stretch and where the moment is stationary in it. Stretches of no length,
    between points that coincide, do not count.
    """
    slope, curvature = beams.bending[1], 2 * beams.bending[2]
    stationary = jnp.clip(-safe_divide(slope, curvature), beams.low, beams.high)
    places = jnp.stack([beams.low, stationary, beams.high], axis=2)
    there = (beams.high - beams.low > 1e-6 * jnp.max(beams.high))[:, :, None]
    axial, bending = (jnp.where(there, _at(f[..., None], places), 0) for f in (beams.axial, beams.bending))
    axial, bending = (field.reshape(field.shape[0], -1) for field in (axial, bending))
    most = jnp.take_along_axis(axial, jnp.argmax(jnp.abs(axial), axis=1)[:, None], axis=1)[:, 0]
    stress = jnp.full_like(most, jnp.nan)
    if section is not None:
        sections = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, most.shape)[:, None], section)
        stress = jnp.max(sections.stress(axial, bending), axis=1)
    return most, jnp.max(jnp.abs(bending), axis=1), stress


def _at(field: jax.Array, place: Scalar) -> jax.Array:
    """A polynomial along the bars, its coefficients on the first axis."""
    value = field[-1]
    for coefficient in field[-2::-1]:
        value = value * place + coefficient
    return value
