"""Forward kinematics of a platform whose corners swing on circles, against the closure equations that it bypasses."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor._engine.pytree import unchecked
from jaxscissor.kinematics._platform import assembly_sign, state_at
from jaxscissor.robots._contract import joints_by_leg
from jaxscissor.robots._over_legs import one_by_one
from jaxscissor.robots.triple_scissor._leg import ScissorLeg
from jaxscissor.singularities._measures import closure_matrix
from tests.conftest import tse_clockwise


@jax.jit
def _signs(robot, pose, joints):
    """Of the three distances by the angles, and of all closure equations by the twist."""
    matrix = closure_matrix(robot, *robot.space.place(pose), joints)[:, :6]
    return assembly_sign(robot, joints, state_at(robot, pose, joints)), jnp.sign(jnp.linalg.det(matrix))


def test_three_angles_tell_the_assembly_modes_that_the_closure_tells(rng):
    """At every pose with these joints, in all modes, the two determinants differ by a factor that keeps its sign."""
    products, seen = [], []
    for robot in (js.TripleScissorExtender.prototype(), tse_clockwise()):
        _, joints = robot.home()
        for _ in range(8):
            held = joints + 0.05 * robot.length * jnp.asarray(rng.normal(size=6))
            modes = js.forward_kinematics_all(robot, held)
            for other in modes.values[modes.valid]:
                mine, closure = _signs(robot, other, held)
                products.append(float(mine * closure))
                seen.append(float(mine))
    assert len(products) > 40 and set(seen) == {-1.0, 1.0}
    assert len(set(products)) == 1


def test_a_leg_holds_its_point_anywhere_on_its_circle(rng):
    robot = js.TripleScissorExtender.prototype()
    _, joints = robot.home()
    joints = joints + 0.05 * robot.length * jnp.asarray(rng.normal(size=6))
    for leg, own in one_by_one(robot.legs(), joints_by_leg(robot, joints)):
        circle = leg.circle(own)
        for angle in rng.uniform(-np.pi, np.pi, 5):
            np.testing.assert_allclose(leg.residual(own, circle.at(angle)), 0, atol=1e-14)
        cosine, sine = circle.nearest(circle.at(0.7) + 0.3 * circle.first.cross(circle.second))
        np.testing.assert_allclose([cosine, sine], [np.cos(0.7), np.sin(0.7)], atol=1e-14)


def test_a_circle_that_is_none_is_told_by_the_check():
    @js.pytree
    class Crooked(ScissorLeg):
        def circle(self, joints):
            circle = super().circle(joints)
            return circle._replace(first=1.1 * circle.first)

    @js.pytree
    class Robot(js.TripleScissorExtender):
        def legs(self):
            legs = super().legs()
            return unchecked(Crooked, **{f.name: getattr(legs, f.name) for f in dataclasses.fields(legs)})

    robot = js.TripleScissorExtender.prototype()
    crooked = unchecked(Robot, **{f.name: getattr(robot, f.name) for f in dataclasses.fields(robot)})
    with pytest.raises(ValueError, match=r"circle\(\) of leg 1 leaves"):
        js.check_robot(crooked)
