"""Robots saved and loaded: the same to the last bit, and nothing but numbers and names."""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxscissor as js
from jaxscissor._engine.pytree import unchecked
from tests.bound_robots import FiveBar
from tests.conftest import ALL, MORE, ROBOTS, exhaustive
from tests.toys import LinearDelta, Planar3RPR, ThreePRS

OWN = (LinearDelta, Planar3RPR, ThreePRS)


def bits(tree):
    return [(type(x), x.dtype, x.shape, np.asarray(x).tobytes()) for x in map(jnp.asarray, jax.tree.leaves(tree))]


def loaded(robot, path, classes=()):
    js.export.save(robot, path)
    return js.export.load(path, classes)


@pytest.mark.parametrize("name", [*ROBOTS, *exhaustive(*MORE)])
def test_a_loaded_robot_is_the_saved_one(name, tmp_path):
    robot = ALL[name]()
    single = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf, np.float32) / np.float32(3)), robot)
    for one in (robot, single, *([js.per_leg(robot)] if name == "stewart_gough" else [])):
        again = loaded(one, tmp_path / "robot.json", OWN)
        assert jax.tree.structure(again) == jax.tree.structure(one)  # classes and static fields
        assert bits(again) == bits(one)


def test_numbers_that_are_none_keep_their_bits(tmp_path):
    odd = np.array([[np.nan, np.inf, -np.inf], [-0.0, 5e-324, 1 / 3], [1e308, -1e-308, np.pi]])
    robot = unchecked(
        js.NavaroII,
        base=jnp.asarray(odd),
        platform=jnp.asarray(odd[:2], jnp.bfloat16),
        stroke=jnp.arange(2),
        mode=3,
        crosses=2,
    )
    assert bits(loaded(robot, tmp_path / "robot.json")) == bits(robot)
    assert "NaN" not in (tmp_path / "robot.json").read_text()  # which is no JSON


@js.pytree
class Unknown(LinearDelta):
    """A class that the library has not."""


@js.pytree
class Oddity(js.Mechanism):
    """Every kind of field."""

    point: js.Vec
    turn: js.Rotation
    number: float
    parts: list
    notes: dict = js.static()
    names: tuple = js.static(default=("a", ("b", None, True, 2)))


def test_every_kind_of_field_comes_back(tmp_path):
    axes = js.Rotation(js.Vec(0.0, 1.0), js.Vec(-1.0, jnp.float32(0.1)))
    robot = Oddity(
        js.Vec(0.1, jnp.arange(3)), axes, float("inf"), [1, (2.5, None)], {"float": float("-inf"), "on": False}
    )
    again = loaded(robot, tmp_path / "robot.json", [Oddity])
    assert jax.tree.structure(again) == jax.tree.structure(robot)
    assert bits(again) == bits(robot)
    assert type(again.number) is float and again.parts[1][0] == 2.5


def test_a_robot_with_plain_numbers_computes_as_before(tmp_path):
    robot = FiveBar(0.5)
    again = loaded(robot, tmp_path / "robot.json", [FiveBar])
    assert (
        js.inverse_kinematics(again, [0.1, 1.7, 0.0]).value == js.inverse_kinematics(robot, [0.1, 1.7, 0.0]).value
    ).all()


def test_what_a_file_must_not_hold_is_refused(tmp_path):
    path = tmp_path / "robot.json"
    js.export.save(js.StewartGough.prototype(), path)
    good = json.loads(path.read_text())

    def refused(match, classes=(), **changes):
        path.write_text(json.dumps({**good, **changes}))
        with pytest.raises(ValueError, match=match):
            js.export.load(path, classes)

    def with_robot(**changes):
        return {"robot": {**good["robot"], **changes}}

    fields = good["robot"]["fields"]
    refused("format", format="pickle")
    refused("'jaxscissor' 1", version=2)
    refused("classes=\\[Popen\\]", **with_robot(**{"class": "Popen"}))
    refused("known are NavaroII|classes=\\[Mechanism\\]", **with_robot(**{"class": "Mechanism"}))
    refused("expected \\['base', 'platform', 'stroke'\\]", **with_robot(fields={**fields, "__class__": 1}))
    refused("expected \\['base', 'platform', 'stroke'\\]", **with_robot(fields={"base": fields["base"]}))
    refused("dtype 'object'", **with_robot(fields={**fields, "base": {**fields["base"], "dtype": "object"}}))
    refused("18 numbers for an array", **with_robot(fields={**fields, "base": {**fields["base"], "shape": [7]}}))
    refused("damaged", **with_robot(fields={**fields, "base": {**fields["base"], "shape": 3}}))
    refused("fields \\[1\\]", **with_robot(fields=[1]))
    refused("damaged", **with_robot(fields=1))
    refused("expected what js.export.save writes", **with_robot(fields={**fields, "base": {"eval": "1"}}))
    refused("two classes of the name", [dataclasses.make_dataclass("Scott", []) for _ in range(2)])
    refused("with @jaxscissor.pytree", [dict])
    path.write_text("robot")
    with pytest.raises(ValueError, match="no JSON file"):
        js.export.load(path)
    js.export.save(FiveBar(0.1), path)
    with pytest.raises(ValueError, match=r"fields \['half'\]; expected \['crank'"):
        js.export.load(path)  # a FiveBar of one's own, and not the library's
    js.export.save(Unknown.example(), path)
    with pytest.raises(ValueError, match="classes=\\[Unknown\\]"):
        js.export.load(path)


def test_robots_of_chains_and_on_bases_keep_their_spaces(tmp_path):
    pins = [js.Revolute(None, point, actuated=not i) for i, point in enumerate([(0.0, 0), (0.0, 0.2), (0.1, 0.4)])]
    chains = [js.Chain(pins), js.Chain(pins)]
    for robot in (
        js.robots.linkage(chains, [0.1, 0.4], space=js.robots.R2),
        js.robots.mounted(js.StewartGough.prototype(), [0.0, 0, 1, 0, 0, 0]),
        js.robots.ThreeUPU.prototype(),
    ):
        again = loaded(robot, tmp_path / "robot.json")
        assert jax.tree.structure(again) == jax.tree.structure(robot) and again.space == robot.space
        assert bits(again) == bits(robot)


def test_what_no_file_can_hold_is_refused_by_name(tmp_path):
    robot = unchecked(js.NavaroII, base=object(), platform=1.0, stroke=1.0, mode=1, crosses=1)
    with pytest.raises(ValueError, match="NavaroII\\.base of type object"):
        js.export.save(robot, tmp_path / "robot.json")
    with pytest.raises(ValueError, match="outside jit"):
        jax.jit(lambda robot: js.export.save(robot, tmp_path / "robot.json"))(js.StewartGough.prototype())
    assert not (tmp_path / "robot.json").exists()


def test_numbers_of_64_bits_are_not_made_smaller(tmp_path):
    js.export.save(js.StewartGough.prototype(), tmp_path / "robot.json")
    with jax.enable_x64(False), pytest.raises(ValueError, match="jax_enable_x64"):
        js.export.load(tmp_path / "robot.json")
