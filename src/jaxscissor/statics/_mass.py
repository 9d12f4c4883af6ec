"""The mass of a robot."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from jaxscissor._engine.programs import one_pose
from jaxscissor._engine.pytree import as_floats, float_dtype
from jaxscissor.robots._contract import Mechanism
from jaxscissor.statics._bodies import bodies_of
from jaxscissor.statics._load import Load
from jaxscissor.statics._materials import Section


@one_pose()
def mass(robot: Mechanism, *, section: Section, load: Load | None = None) -> jax.Array:
    """Mass of all bars, and of the platform if a load says it; without payload, motors, slides and pins.

    Args:
      robot: the robot; every array in it is differentiable.
      section: of the bars, which have the lengths that they have at home.
      load: of which only the mass of the platform counts.

    Returns:
      ``()``.

    Example:
      >>> import jaxscissor as js
      >>> robot = js.TripleScissorExtender.prototype()
      >>> flat = js.statics.Section.rectangle(js.statics.Material.aluminum(), depth=0.03, width=0.006)
      >>> round(float(js.statics.mass(robot, section=flat)), 2)
      5.04
    """
    (robot,) = as_floats(robot)
    section, load = (jax.tree.map(lambda leaf: jnp.asarray(leaf, float_dtype(robot)), tree) for tree in (section, load))
    total = jnp.sum(bodies_of(robot, section).masses)
    return total if load is None else total + load.platform_mass
