"""Every function of a robot with the robot as argument: under jit, vmap and derivatives, in both precisions.

Only the precision is told by default, by tracing. What is compiled for this is large: ``-m exhaustive``.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxscissor._engine.numerics import default_tol
from tests.calls import calls_of
from tests.conftest import ALL, exhaustive

# answered by the host, which looks at numbers on the way
HOST = {
    "check_robot",
    "calibration.identify",
    "calibration.identifiability",
    "calibration.next_poses",
    "singularities.surface",
    "singularities.aspects",
    "singularities.aspect_path",
    "singularities.cuspidal_search",
    "singularities.plan_modes",
    "navaro.swept_area",
}
# the first two say that they have no derivative, the last is asked at the kink of a misfit
STILL = {"singularities.distance", "distance along a direction", "navaro.identify_assembly"}
FORWARD_ONLY = {"workspace.soft_gradient", "its gradient"}  # loops that hold nothing for a second reverse pass
COMPUTED = ["linear_delta", "navaro_mode_8"]  # a fixed pose leaves the constraints of a bound robot as it changes
STEP = 1e-6


def functions(robot, dtype=jnp.float64):
    """Name -> function of a robot, of all calls that take one; all other numbers are given, in this precision."""
    return {
        name: partial(_called, call.func, [arg is robot for arg in call.args], *_cast(call, dtype))
        for name, call in calls_of(robot).items()
        if name not in HOST and isinstance(call, partial) and any(arg is robot for arg in call.args)
    }


def _called(function, places, args, keywords, robot):
    return function(*(robot if place else arg for place, arg in zip(places, args, strict=True)), **keywords)


def _cast(call, dtype):
    """Arguments and keywords of a call with all floating arrays in a precision."""

    def leaf(value):
        return value.astype(dtype) if getattr(value, "dtype", None) in (np.float64, np.float32) else value

    return jax.tree.map(leaf, (list(call.args), call.keywords))


def numbers(found):
    """The floating arrays of a result that have a derivative: no padding, no motions, no places of extremes."""
    if hasattr(found, "valid"):
        found = [
            jnp.where(found.valid[..., None], x, 0) for x in (found.values, getattr(found, "joints", found.values))
        ]
    if hasattr(found, "platform_motion"):
        found = found.type1, found.type2
    if hasattr(found, "low_poses"):
        found = found.low, found.high
    return [leaf for leaf in map(jnp.asarray, jax.tree.leaves(found)) if jnp.issubdtype(leaf.dtype, jnp.floating)]


def total(function, robot):
    """One number that depends on all finite numbers of the result, large ones by their logarithm."""
    found = [jnp.where(jnp.isfinite(leaf), leaf, 0) for leaf in numbers(function(robot))]
    return sum(jnp.sum(jnp.arcsinh(leaf)) for leaf in found) + 0.0 * robot.length


def two_of(robot):
    """The robot and one that is a thousandth larger, stacked."""
    return jax.tree.map(lambda leaf: jnp.stack([leaf, leaf * jnp.asarray(1.001, leaf.dtype)]), robot)


@pytest.mark.parametrize("name", ["linear_delta", *exhaustive(*(name for name in ALL if name != "linear_delta"))])
def test_results_keep_single_precision(name):
    robot = ALL[name]()
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), robot)
    for called, function in functions(robot, jnp.float32).items():
        leaves = jax.tree.leaves(jax.eval_shape(function, single))
        assert not any(leaf.dtype == jnp.float64 for leaf in leaves), called


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", COMPUTED)
def test_under_jit_and_vmap_every_function_gives_what_calls_give(name):
    robot = ALL[name]()
    for called, function in functions(robot).items():
        both = two_of(robot)
        first, second = (jax.tree.map(lambda leaf, i=i: leaf[i], both) for i in (0, 1))
        each = [jax.tree.map(np.asarray, jax.jit(function)(one)) for one in (first, second)]
        plain, together = function(first), jax.jit(jax.vmap(function))(both)
        for one, other in zip(jax.tree.leaves(plain), jax.tree.leaves(each[0]), strict=True):
            assert near(one, other), f"{called} gave {one} and under jit {other}"
        stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *each)
        for one, other in zip(jax.tree.leaves(stacked), jax.tree.leaves(together), strict=True):
            assert near(one, other), f"{called} gave {one} and under vmap {other}"


def near(one, other, tol=1e-8):
    """Equal, or floating numbers equal but for rounding relative to the greatest of them, or left over by a solve."""
    one, other = np.asarray(one), np.asarray(other)
    if one.dtype.kind != "f":
        return np.array_equal(one, other)
    size = np.max(np.abs(one[np.isfinite(one)]), initial=0)
    return np.allclose(one, other, rtol=tol, atol=max(tol * size, default_tol(float)), equal_nan=True)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", COMPUTED)
def test_derivatives_by_the_robot_are_those_of_differences_in_both_modes(name):
    robot = ALL[name]()
    rng = np.random.default_rng(0)

    def direction(leaf):
        aside = np.where(np.isfinite(leaf), leaf, 0) * rng.uniform(-1, 1, np.shape(leaf))
        return jnp.asarray(aside, leaf.dtype)

    along = jax.tree.map(direction, robot)
    for called, function in functions(robot).items():
        if called in STILL:
            continue
        one = jax.jit(partial(total, function))
        _, forward = jax.jit(lambda robot, one=one: jax.jvp(one, (robot,), (along,)))(robot)
        ends = (jax.tree.map(lambda a, d, s=s: a + s * STEP * d, robot, along) for s in (1, -1))
        up, down = map(one, ends)
        difference = (up - down) / (2 * STEP)
        scale = max(1.0, abs(float(forward)))
        assert abs(forward - difference) < 1e-5 * scale, f"{called}: {forward} by jvp, {difference} by differences"
        if called not in FORWARD_ONLY:
            gradient = jax.jit(jax.grad(one))(robot)
            leaves = zip(jax.tree.leaves(gradient), jax.tree.leaves(along), strict=True)
            reverse = sum(float(jnp.sum(g * d)) for g, d in leaves)
            assert abs(forward - reverse) < 1e-9 * scale, f"{called}: {forward} by jvp, {reverse} by vjp"
