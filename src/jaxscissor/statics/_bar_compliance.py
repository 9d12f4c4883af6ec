"""How the bars of the legs give way under what they carry."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from jaxscissor._engine.numerics import Scalar
from jaxscissor.robots._contract import Attachment, Joints, Leg
from jaxscissor.robots._over_legs import over_legs
from jaxscissor.statics._balance import Balance, Case
from jaxscissor.statics._beams import beams_of, compliance_of
from jaxscissor.statics._bodies import Bodies
from jaxscissor.statics._linkage import linkage_of
from jaxscissor.statics._materials import Section


class BarCompliance(NamedTuple):
    """Of all bars: twist per wrench ``(d, d)``, the twist under wrench and weights ``(d,)``, and whether it exists."""

    per_wrench: jax.Array
    twist: jax.Array
    regular: Scalar


def bar_compliance(case: Case, state: Balance, section: Section) -> BarCompliance:
    """Castigliano's theorem: the platform moves by the derivative of the bars' complementary energy by the wrench.

    What the legs exert on the platform is linear in the wrench, and the energy of each leg's bars is a square of that
    and of their own weight.
    """

    def of_leg(leg: Leg, attachment: Attachment, joints: Joints, bodies: Bodies):
        linkage, parts = linkage_of(leg, joints, attachment, bodies, case.load.gravity)
        return compliance_of(beams_of(linkage, parts), section), linkage.regular

    legs, placed = state.legs, state.placed
    compliance, regular = over_legs(of_leg, placed.legs, placed.attachments, legs.joints, legs.bodies)
    exerted = state.leg_forces(case.robot, state.hold(state.pull - case.wrench)) - legs.weight
    slopes = jax.vmap(lambda forces: state.leg_forces(case.robot, forces))(-state.inverse)  # (d, legs, numbers)
    carried = jnp.concatenate([exerted, jnp.ones_like(exerted[:, :1])], axis=1)
    per_wrench = jnp.einsum("iln,lnm,jlm->ij", slopes, compliance[:, :-1, :-1], slopes)
    twist = jnp.einsum("iln,lnm,lm->i", slopes, compliance[:, :-1], carried)
    return BarCompliance(per_wrench, twist, jnp.all(regular))
