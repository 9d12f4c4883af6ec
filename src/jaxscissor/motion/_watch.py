"""What a moving robot must keep clear of: its limits and its singularities."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxscissor._engine.numerics import Scalar, smallest
from jaxscissor._engine.pytree import float_dtype
from jaxscissor._engine.types import Number
from jaxscissor.kinematics._solution import Status
from jaxscissor.robots._contract import Mechanism, actuation, joints_by_leg, seen_by_legs
from jaxscissor.robots._over_legs import over_legs
from jaxscissor.singularities import measures


class Watched(NamedTuple):
    """Distances of one configuration to what it must keep clear of."""

    margin: Scalar  # the least of all legs to their limits, dimensionless; infinite of a robot without limits
    type1: jax.Array  # (legs,)
    type2: Scalar


class Least(NamedTuple):
    """The least distances that are allowed: of the margin, and of the size of the measures."""

    margin: Number
    type1: Number
    type2: Number


def watched(robot: Mechanism, pose: jax.Array, joints: jax.Array) -> Watched:
    """The distances of a configuration that is finite and closes."""
    seen = seen_by_legs(robot, *robot.space.place(pose))
    margins = over_legs(lambda leg, *case: tuple(leg.margins(*case)), robot.legs(), joints_by_leg(robot, joints), seen)
    found = measures(robot, pose, joints=joints)
    every = [margin for leg in zip(*margins, strict=True) for margin in leg]
    return Watched(smallest(every) if every else jnp.full_like(found.type2, jnp.inf), found.type1, found.type2)


class Branch(NamedTuple):
    """Signs of the measures of all configurations that can be reached without a singularity; zero: not named yet."""

    type1: jax.Array
    type2: jax.Array


def unnamed(robot: Mechanism) -> Branch:
    """The branch of a robot that has not been seen yet."""
    dtype = float_dtype(robot)
    return Branch(jnp.zeros(len(actuation(robot)), dtype), jnp.zeros((), dtype))


def named(branch: Branch, seen: Watched) -> Branch:
    """The branch, of the configuration seen if it has not been named yet."""
    signs = lax.stop_gradient(Branch(jnp.sign(seen.type1), jnp.sign(seen.type2)))
    return jax.tree.map(lambda sign, new: jnp.where(sign == 0, new, sign), branch, signs)


def verdict(solved: Scalar, seen: Watched, branch: Branch, least: Least) -> Scalar:
    """Status of a configuration: of its solve, else whether it is clear, on the branch's side of all singularities."""
    type1, type2 = seen.type1 * branch.type1, seen.type2 * branch.type2
    regular = (type2 > 0) & (type2 >= least.type2) & jnp.all((type1 > 0) & (type1 >= least.type1))
    clear = jnp.where(seen.margin >= least.margin, Status.CONVERGED, Status.OUT_OF_REACH)
    clear = jnp.where(regular, clear, Status.SINGULAR)
    return jnp.where(solved == Status.CONVERGED, clear, solved).astype(jnp.int32)
