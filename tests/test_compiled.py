"""What is compiled: how much, how often, and never twice."""

import inspect
import json
import re
import subprocess
import sys

import jax
import numpy as np
import pytest

import jaxscissor as js
from tests.calls import calls_of
from tests.conftest import ALL, as_users, exhaustive, scaled
from tests.kinematics.test_contract import forward

# instructions of the optimized program that ``jax.jit`` makes, for the TSE; what was measured, and five per cent
BUDGETS = {
    "inverse_kinematics": 2900,
    "inverse_kinematics of a batch": 3690,
    "workspace.fraction": 3525,
    "forward_kinematics": 14000,
    "singularities.measures": 9100,
    "workspace.soft_fraction": 11380,
}
UNIT = 4096.0
SMALL = "linear_delta", "navaro_mode_8"  # robots that compile in no time, and have all functions between them
LARGE = {
    "forward_kinematics_all": 28690,
    "jacobian of forward_kinematics": 19400,
    "workspace.ray_fraction": 25760,
    "singularities.distance": 15760,
}
CONSTRUCTION = """
import json, jax
jax.config.update("jax_enable_x64", True)
compiled = []
listen = jax.monitoring.register_event_duration_secs_listener
listen(lambda event, *_, **labels: compiled.append(1) if "backend_compile" in event else None)
import jaxscissor as js
many = {}
for name in ("TripleScissorExtender", "NavaroII", "TriScott", "Micabo", "StewartGough"):
    compiled.clear()
    getattr(js, name).prototype().home()
    many[name] = len(compiled)
compiled.clear()
js.TripleScissorExtender.from_ratios(0.3, 0.4, 0.05, 0.1).home()
many["from_ratios"] = len(compiled)
print(json.dumps(many))
"""


@pytest.fixture
def compiled():
    """A list of the programs that are compiled while the test runs."""
    names = []

    def listen(event, _, **labels):
        if "backend_compile" in event:
            names.append(labels.get("fun_name"))

    jax.monitoring.register_event_duration_secs_listener(listen)
    yield names
    jax.monitoring.unregister_event_duration_listener(listen)


def test_building_a_robot_compiles_two_programs_at_most():
    text = subprocess.run([sys.executable, "-c", CONSTRUCTION], check=True, capture_output=True, text=True).stdout
    assert max(json.loads(text).values()) <= 2, text


def test_every_function_of_a_robot_is_called_here():
    rooms = {"": js, "workspace.": js.workspace, "singularities.": js.singularities, "design.": js.design}
    rooms |= {"navaro.": js.navaro, "motion.": js.motion, "calibration.": js.calibration, "statics.": js.statics}
    things = {room + name: getattr(door, name) for room, door in rooms.items() for name in door.__all__}
    names = {name for name, thing in things.items() if inspect.isfunction(thing) and _takes_a_robot(thing)}
    called = {name for robot in SMALL for name in calls_of(ALL[robot]())}
    assert len(names) > 30 and names <= called


def _takes_a_robot(function):
    return {"robot", "robots", "objective", "objectives", "choices"} & set(inspect.signature(function).parameters)


@pytest.mark.parametrize("name", [*SMALL, *exhaustive(*(name for name in ALL if name not in SMALL))])
def test_a_call_in_another_unit_compiles_nothing_and_gives_the_same_in_that_unit(name, compiled):
    """Two laws by the same calls: equal shapes are one program, and no number of a result knows the unit of length.

    The unit is a power of two, so that numbers of one dimension scale without rounding, and searches do the same.
    """
    robot = ALL[name]()
    calls, again = calls_of(robot), calls_of(scaled(robot, UNIT))
    for function in sorted(set(calls) - (set(calls_of(ALL[SMALL[0]]())) if name == SMALL[1] else set())):
        first = jax.block_until_ready(calls[function]())
        compiled.clear()
        second = jax.block_until_ready(again[function]())
        assert not compiled, f"{function} compiled {compiled} again"
        assert jax.tree.structure(first) == jax.tree.structure(second), function
        for one, other in zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=True):
            assert differs_by_powers(one, other), f"{function} gave {one} and in another unit {other}"


def differs_by_powers(one, other):
    """Whether every number is that of the other unit times a power of the unit from -3 to 3, or both are rounding."""
    one, other = np.asarray(one), np.asarray(other)
    if one.dtype.kind != "f":
        return np.array_equal(one, other)
    zero = [np.abs(x) <= 1e-14 * np.max(np.abs(x[np.isfinite(x)]), initial=0) for x in (one, other)]
    powers = one[..., None] * UNIT ** np.arange(-3.0, 4)
    same = np.any(np.isclose(other[..., None], powers, rtol=1e-9, atol=0, equal_nan=True), axis=-1)
    return np.all(same | (zero[0] & zero[1]))


def test_sizes_are_no_part_of_a_program(prototype, compiled):
    region = js.Cylinder(prototype.length / 2, prototype.length)
    for count in (40_000, 50_000):
        compiled.clear()
        js.workspace.fraction(prototype, region.quasi_random(count))
    assert not compiled
    for rays in (5, 50, 500):
        compiled.clear()
        js.workspace.ray_fraction(prototype, region, rays=rays, cells=8)
    assert not compiled


def instructions(function, *arguments):
    text = as_users(function).lower(*arguments).compile().as_text()
    return len(re.findall(r"^\s+(?:ROOT )?%?[\w.\-]+ = ", text, re.MULTILINE))


def programs(robot):
    """What the budgets are for, with arguments."""
    home, joints = robot.home()
    region = js.Cylinder(robot.length / 2, robot.length)
    poses, actuated = region.quasi_random(100_000)[:], robot.actuated(joints)
    return {
        "inverse_kinematics": (js.inverse_kinematics, robot, home),
        "inverse_kinematics of a batch": (jax.vmap(js.inverse_kinematics, (None, 0)), robot, poses),
        "workspace.fraction": (js.workspace.fraction, robot, poses),
        "forward_kinematics": (js.forward_kinematics, robot, actuated),
        "singularities.measures": (js.singularities.measures, robot, home),
        "workspace.soft_fraction": (jax.value_and_grad(js.workspace.soft_fraction), robot, poses),
        "forward_kinematics_all": (js.forward_kinematics_all, robot, actuated),
        "jacobian of forward_kinematics": (jax.jacfwd(forward, 1), robot, actuated),
        "workspace.ray_fraction": (jax.value_and_grad(js.workspace.ray_fraction), robot, region),
        "singularities.distance": (js.singularities.distance, robot, home),
    }


@pytest.mark.parametrize("name", [*BUDGETS, *(pytest.param(name, marks=pytest.mark.exhaustive) for name in LARGE)])
def test_programs_stay_within_their_budgets(name, prototype):
    many = instructions(*programs(prototype)[name])
    budget = (BUDGETS | LARGE)[name]
    assert 0.8 * budget < many <= budget, "less is welcome: then lower the budget"
