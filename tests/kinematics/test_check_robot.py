"""The check of a user's own robot: every robot of the table passes, and every slip is told by its method."""

import dataclasses
from functools import partial

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from tests.conftest import ALL, ROBOTS, exhaustive
from tests.toys import DeltaLeg, LinearDelta, Planar3RPR

CHECKED = ("navaro_mode_8", "linear_delta")
UP = js.Vec(0.0, 0.0, 1.0)


@pytest.mark.parametrize("name", [*CHECKED, *exhaustive(*(name for name in ALL if name not in CHECKED))])
def test_every_robot_keeps_the_contract(name):
    js.check_robot(ALL[name]())


def test_every_robot_gives_what_its_methods_promise():
    """The cheap part of the check, without a program."""
    for build in ROBOTS.values():
        robot = build()
        pose, joints = robot.home()
        jax.eval_shape(js.feasibility, robot, pose)
        jax.eval_shape(partial(js.residual, robot), pose, joints=joints)


@js.pytree
class RodLeg(DeltaLeg):
    """The delta's leg with its reach and both roots in closed form."""

    def start(self, attachment):
        bar = attachment - self.foot
        room = 1 - (bar.x**2 + bar.y**2) / self.rod**2
        return (bar.z + self.rod * js.safe_sqrt(room),), room

    def solutions(self, attachment):
        (high,), room = self.start(attachment)
        return [(high,), (2 * attachment.z - high,)], [room >= 0] * 2


def delta(leg=None, **methods):
    """A linear delta with some methods of its own, and of its leg."""
    own = js.pytree(type("Mine", (LinearDelta,), {"__annotations__": {}, **methods}))
    kind = js.pytree(type("MyLeg", (RodLeg,), {"__annotations__": {}, **(leg or {})}))
    if "legs" not in methods:
        own = js.pytree(type("Mine", (own,), {"__annotations__": {}, "legs": lambda self: rebuilt(kind, self)}))
    return own(jnp.asarray(0.5), jnp.asarray(1.0))


def rebuilt(kind, robot):
    legs = LinearDelta.legs(robot)
    return kind(*(getattr(legs, field.name) for field in dataclasses.fields(legs)))


def unstacked(robot):
    legs = LinearDelta.legs(robot)
    return [jax.tree.map(lambda leaf, i=i: leaf[i], legs) for i in range(3)]


HOME = LinearDelta.example().home()


@js.pytree
class Empty(js.Mechanism):
    """Nothing but a number."""

    size: jax.Array


@js.pytree
class Spaced(Empty):
    """A space, but no method."""

    space = js.R3


MISTAKES = {
    "no space": (lambda: Empty(jnp.asarray(1.0)), "Empty has no space"),
    "no home": (lambda: Spaced(jnp.asarray(1.0)), r"Spaced does not define home\(\)"),
    "not a pytree": (lambda: type("Plain", (LinearDelta,), {})(jnp.asarray(0.5), jnp.asarray(1.0)), "no pytree"),
    "legs in a list": (lambda: delta(legs=unstacked), r"legs\(\) gave a list of 3.*stacked on a leading axis"),
    "legs without an axis": (lambda: delta(legs=lambda self: unstacked(self)[0]), r"legs\(\) gave"),
    "two attachments": (
        lambda: delta(attachments=lambda self, position, rotation: [position] * 2),
        r"attachments\(position, rotation\) gave 2 attachments; expected 3",
    ),
    "one attachment for all": (
        lambda: delta(attachments=lambda self, position, rotation: position),
        r"attachments\(position, rotation\) gave a Vec",
    ),
    "planar attachments": (
        lambda: delta(attachments=lambda self, position, rotation: [js.Vec(position.x, position.y)] * 3),
        "vectors of 2 and 3 components",
    ),
    "length missing": (lambda: delta(length=property(lambda self: None)), "length gave None"),
    "length an array": (lambda: delta(length=property(lambda self: jnp.ones(1))), "length gave an array of shape"),
    "home without joints": (lambda: delta(home=lambda self: HOME[0]), r"home\(\) gave an array"),
    "home's pose too long": (lambda: delta(home=lambda self: (jnp.zeros(6), HOME[1])), r"home\(\) gave .*x, y, z"),
    "home's joints too many": (lambda: delta(home=lambda self: (HOME[0], jnp.ones(4))), r"home\(\) gave 4 joints"),
    "home does not close": (lambda: delta(home=lambda self: (HOME[0], jnp.ones(3))), r"home\(\) does not close"),
    "home in another mode": (lambda: delta(home=lambda self: (HOME[0], -HOME[1])), "start.. does not lead to"),
    "home beyond a limit": (
        lambda: delta({"margins": lambda self, joints, attachment: (joints[0] - 1,)}),
        r"margins\(\) at home has -0\.13",
    ),
    "residual a scalar": (
        lambda: delta({"residual": lambda self, joints, at: RodLeg.residual(self, joints, at)[0]}),
        r"residual\(joints, attachment\) gave an array of shape \(\)",
    ),
    "one equation too many": (
        lambda: delta({"residual": lambda self, joints, at: (*RodLeg.residual(self, joints, at), joints[0])}),
        r"residual\(joints, attachment\) gave a tuple of 2.*one number per joint",
    ),
    "residual without a derivative": (
        lambda: delta(
            {
                "residual": lambda self, joints, at: RodLeg.residual(
                    self, joints, js.Vec(at.x, (at.y + jax.lax.stop_gradient(at.y)) / 2, at.z)
                )
            }
        ),
        "derivative of inverse kinematics by y is off",
    ),
    "joints only": (lambda: delta({"start": lambda self, at: RodLeg.start(self, at)[0]}), r"start\(attachment\) gave"),
    "a bare joint": (
        lambda: delta({"start": lambda self, at: (RodLeg.start(self, at)[0][0], None)}),
        r"start\(attachment\) gave .*a tuple of numbers",
    ),
    "reach a truth value": (
        lambda: delta({"start": lambda self, at: (RodLeg.start(self, at)[0], RodLeg.start(self, at)[1] >= 0)}),
        r"start\(attachment\) gave .*signed distance",
    ),
    "reach where no root is": (
        lambda: delta({"start": lambda self, at: (RodLeg.start(self, at)[0], RodLeg.start(self, at)[1] + 0.5)}),
        "in reach, but Newton's method finds no root",
    ),
    "no reach where a root is": (
        lambda: delta({"start": lambda self, at: (RodLeg.start(self, at)[0], RodLeg.start(self, at)[1] - 0.7)}),
        "out of reach, but there is a root",
    ),
    "reach with the other sign": (
        lambda: delta({"start": lambda self, at: (RodLeg.start(self, at)[0], -RodLeg.start(self, at)[1])}),
        "at home, where its home mode exists",
    ),
    "actuated missing": (lambda: delta({"actuated": None}), "actuated gave None"),
    "actuated too long": (lambda: delta({"actuated": (True, False)}), r"start\(attachment\) gave .*2 in all"),
    "nothing actuated": (lambda: delta({"actuated": (False,)}), "0 actuated joints for 3 freedoms"),
    "margins a scalar": (
        lambda: delta({"margins": lambda self, joints, attachment: joints[0]}),
        r"margins\(joints, attachment\) gave an array",
    ),
    "limits named wrongly": (lambda: delta({"limits": ("one",)}), r"margins\(joints, attachment\) gave .*1, as many"),
    "solutions without flags": (
        lambda: delta({"solutions": lambda self, at: RodLeg.solutions(self, at)[0]}),
        r"solutions\(attachment\) gave",
    ),
    "solutions that do not close": (
        lambda: delta({"solutions": lambda self, at: ([(at.z,)], [at.z < 9])}),
        r"solutions\(\) has a root that does not meet",
    ),
    "a solution missing": (
        lambda: delta({"solutions": lambda self, at: tuple(part[1:] for part in RodLeg.solutions(self, at))}),
        "not among those of solutions",
    ),
    "two legs": (
        lambda: delta(
            legs=lambda self: jax.tree.map(lambda leaf: leaf[:2], rebuilt(RodLeg, self)),
            attachments=lambda self, position, rotation: [position] * 2,
            home=lambda self: (HOME[0], HOME[1][:2]),
        ),
        "2 actuated joints for 3 freedoms",
    ),
    "a number that is not cast": (
        lambda: delta({"residual": lambda self, joints, at: (jnp.sum(jnp.stack(joints)) + 1e-9 * at.z - 1,)}),
        "home.. does not close",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_told_by_the_method_that_makes_it(name):
    build, message = MISTAKES[name]
    with pytest.raises(ValueError, match=message):
        js.check_robot(build(), poses=64)


def test_the_robot_that_the_mistakes_are_made_in_is_right():
    js.check_robot(delta())


def test_a_robot_of_single_precision_stays_so_whatever_its_methods_compute_with():
    """With 64 bits allowed, an array of NumPy made the legs, and with them every result, double."""
    anchors = np.array(LinearDelta.example().legs().foot.array(), float)

    def legs(self):
        return RodLeg(js.Vec(*jnp.asarray(anchors.T)), jnp.asarray(np.ones(3)))

    robot = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), delta(legs=legs))
    solution = js.inverse_kinematics(robot, np.array([0.1, 0.0, 0.1], np.float32))
    assert solution.value.dtype == jnp.float32
    assert js.forward_kinematics(robot, solution.value).value.dtype == jnp.float32
    assert js.singularities.measures(robot, np.zeros(3, np.float32)).type2.dtype == jnp.float32


def test_complex_numbers_are_refused_and_the_size_of_a_batch_may_stay_open():
    robot = Planar3RPR.example()
    with pytest.raises(ValueError, match="complex pose"):
        js.inverse_kinematics(robot, np.array([0.4, 0.3, 0.1 + 0j]))
    with pytest.raises(ValueError, match="complex joints"):
        js.forward_kinematics(robot, np.array([0.4, 0.3, 0.1 + 0j]))
    (size,) = jax.export.symbolic_shape("n")
    poses = jax.ShapeDtypeStruct((size, 3), jnp.result_type(float))
    solve = jax.jit(lambda poses: jax.vmap(js.inverse_kinematics, (None, 0))(robot, poses).value)
    exported = jax.export.export(solve)(poses)
    some = js.Box([0.3, 0.3, -0.5], [0.6, 0.6, 0.5]).quasi_random(5)[:]
    np.testing.assert_allclose(exported.call(some), solve(some), rtol=1e-12)
